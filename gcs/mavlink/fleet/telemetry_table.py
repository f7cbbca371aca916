"""What a vehicle's quiet frames change: one row of integers for each, as they came over the link.

Integers, so that a compiled kernel (`gcs.mavlink.fleet.fast_telemetry`) and Python
(`gcs.mavlink.fleet.vehicle`) can work on the same row and agree to the last bit.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

Row = npt.NDArray[np.int64]
"""One vehicle's integers."""

(
    ADDRESS,  # number of the address at which it is alive, NOBODY while it is not
    HEARD_NS,
    LAST_SEQUENCE,  # NONE before its first frame, and after a reboot or a silence
    FRAMES,
    LOST,
    SIGNS,  # whether its last frame was signed
    BOOT_MS,  # time since boot of the newest position; NONE before the first
    BOOT_OFFSET_NS,  # our clock less the vehicle's, at the newest position
    BOOT_RUN,  # whether a run of reports behind the newest is being watched
    FIX_TYPE,
    BEST_FIX,
    BATTERY_PERCENT,
    PLACE_NS,  # when the last position came that was believed, and its fields as they came
    LAT_1E7DEG,
    LON_1E7DEG,
    ALT_MM,
    V_NORTH_CM_S,
    V_EAST_CM_S,
    HEADING_CDEG,
    PLACES,  # number of positions believed
    WATCHED,  # whether the next position must be held against more than the one before
    DUE_NS,  # before then there is nothing to send to it by the clock
    LEG,  # whether somebody looks how it flies its leg: NAV_CONTROLLER_OUTPUT is not quiet then
    BEAT,  # the first eight bytes of its last heartbeat; NONE when the next one matters whatever it says
    WIDTH,
) = range(25)

NONE: Final = -1
NOBODY: Final = -1


def new_row() -> Row:
    """Make the row of a vehicle that was never heard."""
    row = np.zeros(WIDTH, np.int64)
    row[[ADDRESS, LAST_SEQUENCE, BOOT_MS, FIX_TYPE, BEST_FIX, BATTERY_PERCENT, BEAT]] = NONE
    return row
