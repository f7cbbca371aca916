"""Telemetry table: one record of integers per vehicle, in the units of the link.

Integers, so that the compiled kernel (`gcs.mavlink.fleet.fast_telemetry`) and Python
(`gcs.mavlink.fleet.vehicle`) agree to the last bit.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from gcs.model import IntArray

VehicleRecord = IntArray
"""Integers of one vehicle, by the columns below."""

(
    ADDRESS,  # number of its address while it is heard, else NO_ADDRESS
    HEARD_NS,
    LAST_SEQUENCE,  # NONE before its first frame, after a reboot or a link loss
    FRAMES,
    LOST,
    IS_SIGNED,  # 1 if its last frame was signed
    BOOT_MS,  # time since boot of the newest position; NONE before the first
    BOOT_OFFSET_NS,  # our clock less the vehicle's, at the newest position
    IN_LATE_RUN,  # 1 during a run of reports behind the newest (BootClock)
    FIX_TYPE,
    BEST_FIX,
    BATTERY_PERCENT,
    SENSORS_FAILED,  # MAV_SYS_STATUS_SENSOR bits that are enabled and not healthy; NONE before SYS_STATUS
    SENSORS_GOOD,  # those that are enabled and healthy
    THROTTLE_PERCENT,
    ESTIMATOR_FLAGS,  # EKF_STATUS_FLAGS or ESTIMATOR_STATUS_FLAGS
    LANDED_STATE,  # MAV_LANDED_STATE
    POSITION_NS,  # arrival of the last accepted position; its fields follow
    LAT_1E7DEG,
    LON_1E7DEG,
    ALT_MM,
    V_NORTH_CM_S,
    V_EAST_CM_S,
    V_DOWN_CM_S,
    HEADING_CDEG,
    POSITIONS,  # number of accepted positions
    CHECK_NEXT,  # 1 if the next position needs the checks in Python
    DUE_NS,  # no timer is due before
    LEG_WATCHED,  # 1 if NAV_CONTROLLER_OUTPUT is not routine
    HEARTBEAT_KEY,  # first eight bytes of its last heartbeat; NONE to forward the next one
    WIDTH,
) = range(31)

NONE: Final = -1
NO_ADDRESS: Final = -1


def new_table(vehicles: int) -> IntArray:
    """Return the records of vehicles that were never heard."""
    table = np.zeros((vehicles, WIDTH), np.int64)
    unknown = [ADDRESS, LAST_SEQUENCE, BOOT_MS, HEARTBEAT_KEY, LANDED_STATE]
    unknown += [FIX_TYPE, BEST_FIX, BATTERY_PERCENT, SENSORS_FAILED, SENSORS_GOOD]
    unknown += [THROTTLE_PERCENT, ESTIMATOR_FLAGS]
    table[:, unknown] = NONE
    return table
