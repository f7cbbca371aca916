"""Fast telemetry path: a compiled kernel applies routine frames to the telemetry table.

Most frames are routine: the next position, battery, GPS fix, an unchanged heartbeat, and messages that are
only counted. They change integers of the vehicle's record and cause nothing else. Every other frame goes to
`Fleet` and `Vehicle`, and so does any frame that is unusual: from another address, after a timeout, late, at
an implausible position. Those two work on the same records and are the reference.

Field offsets: https://mavlink.io/en/messages/common.html (fields are ordered by size). Zeros at the end of a
MAVLink 2 payload are truncated (https://mavlink.io/en/guide/serialization.html#payload_truncation).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs import jit
from gcs.geo import LocalFrame
from gcs.mavlink.fleet.checks.position_checks import (
    EARTH_RADIUS_M,
    MAX_ALT_M,
    MAX_DISTANCE_M,
    MIN_ALT_M,
    NULL_DEG,
)
from gcs.mavlink.fleet.checks.position_plausibility import (
    MAX_STANDING_M_S,
    MIN_BOOT_DIFFERENCE_S,
    POSITION_SLACK_M,
)
from gcs.mavlink.fleet.telemetry_table import (
    ADDRESS,
    ALT_MM,
    BATTERY_PERCENT,
    BEST_FIX,
    BOOT_MS,
    BOOT_OFFSET_NS,
    CHECK_NEXT,
    ESTIMATOR_FLAGS,
    FIX_TYPE,
    FRAMES,
    HEADING_CDEG,
    HEARD_NS,
    HEARTBEAT_KEY,
    IN_LATE_RUN,
    IS_SIGNED,
    LANDED_STATE,
    LAST_SEQUENCE,
    LAT_1E7DEG,
    LEG_WATCHED,
    LON_1E7DEG,
    LOST,
    NO_ADDRESS,
    NONE,
    POSITION_NS,
    POSITIONS,
    SENSORS_FAILED,
    SENSORS_GOOD,
    THROTTLE_PERCENT,
    V_DOWN_CM_S,
    V_EAST_CM_S,
    V_NORTH_CM_S,
    WIDTH,
    VehicleRecord,
)
from gcs.mavlink.frames import batches, fast_scan, fast_verify
from gcs.mavlink.frames.codec import (
    AUTOPILOT_COMPONENT_ID,
    CHECKED,
    COMPONENT,
    MESSAGE_ID,
    OFFSET,
    SEQUENCE,
    SIGNED,
    SYSTEM,
    FrameTable,
)
from gcs.mavlink.frames.fast_scan import Bytes
from gcs.model import FloatArray, Int32Array, IntArray, network_of, system_of

_POSITION: Final[int] = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
_SYS_STATUS: Final[int] = dialect.MAVLINK_MSG_ID_SYS_STATUS
_HEARTBEAT: Final[int] = dialect.MAVLINK_MSG_ID_HEARTBEAT
_GPS: Final[int] = dialect.MAVLINK_MSG_ID_GPS_RAW_INT
_HUD: Final[int] = dialect.MAVLINK_MSG_ID_VFR_HUD
_EKF: Final[int] = dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT
_ESTIMATOR: Final[int] = dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS
_EXTENDED: Final[int] = dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
_NAVIGATION: Final[int] = dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT
_FIX_3D: Final[int] = dialect.GPS_FIX_TYPE_3D_FIX
_AUTOPILOT: Final = AUTOPILOT_COMPONENT_ID
_BOOT_RANGE_MS: Final = 1 << 32
"""The time since boot begins again at zero after 49 days."""
_SEQUENCE_RANGE: Final = 1 << 8
_NS_PER_MS: Final = 1_000_000
_SYSTEM_IDS: Final = 256
_MESSAGE_IDS: Final = 512
_SLOW_PATH: Final = 2
_V1: Final = 0xFE
_EARTH_RADIUS_M: Final = EARTH_RADIUS_M
_M_PER_1E7: Final = math.radians(1e-7) * EARTH_RADIUS_M
_MAX_STANDING_CM2_S2: Final = round((100.0 * MAX_STANDING_M_S) ** 2)
_NULL_1E7: Final = round(NULL_DEG * 1e7)
_MIN_ALT_MM: Final = round(MIN_ALT_M * 1e3)
_MAX_ALT_MM: Final = round(MAX_ALT_M * 1e3)
_MIN_BOOT_DIFFERENCE_NS: Final = round(MIN_BOOT_DIFFERENCE_S * 1e9)
_SURE_FRACTION: Final = 0.98
"""Fraction of a limit within which the kernel is sure despite rounding and the shape of the Earth."""


@jit.leaf
def _byte(data: Bytes, begin: int, offset: int, size: int) -> int:
    return jit.int64(data[begin + offset]) if offset < size else jit.int64(0)


@jit.leaf
def _number(data: Bytes, begin: int, offset: int, size: int, width: int) -> int:
    """Return a little-endian unsigned number."""
    value = jit.int64(0)
    for k in range(width):
        value |= _byte(data, begin, offset + k, size) << (8 * k)
    return value


@jit.leaf
def _signed(data: Bytes, begin: int, offset: int, size: int, width: int) -> int:
    value = _number(data, begin, offset, size, width)
    half = jit.int64(1) << (8 * width - 1)
    return (value ^ half) - half


@jit.inlined
def _lead(count: int, before: int, count_range: int) -> int:
    """Return by how much a counter is ahead of an earlier value, 0 to `count_range` - 1.

    `count_range` is a power of two, at which the counter begins again at zero. A value from before has a lead
    of half of it or more.
    """
    return (count - before) & (count_range - 1)


@jit.leaf
def _is_near(lat: int, lon: int, origin: FloatArray) -> bool:
    """Return True if a position (1e-7 degrees) is well within reach (`checks.position_checks.distance_m`).

    The sum of the distances along the meridian and along the equator is an upper bound that mostly suffices.
    """
    around = math.radians(abs(lat * 1e-7 - origin[0]) + abs(lon * 1e-7 - origin[1]))
    if _EARTH_RADIUS_M * around < _SURE_FRACTION * origin[2]:
        return True
    lat1 = math.radians(lat * 1e-7)
    lat0 = math.radians(origin[0])
    half_lat = (lat0 - lat1) / 2.0
    half_lon = math.radians(origin[1] - lon * 1e-7) / 2.0
    chord = math.sin(half_lat) ** 2 + math.cos(lat1) * math.cos(lat0) * math.sin(half_lon) ** 2
    return 2.0 * _EARTH_RADIUS_M * math.asin(min(1.0, math.sqrt(chord))) < _SURE_FRACTION * origin[2]


@jit.leaf
def _is_plausible(
    record: IntArray, boot_ms: int, t_ns: int, lat: int, lon: int, speed2: int, max_speed_m_s: float
) -> bool:
    """Return True if a position surely continues the one before (`checks.position_plausibility`).

    `speed2` is the square of the speed in cm/s. The distance east on the equator is an upper bound that
    mostly suffices and saves the cosine.
    """
    if record[CHECK_NEXT] or speed2 > max_speed_m_s * max_speed_m_s * 1e4:
        return False
    if record[POSITIONS] == 0:
        return True
    if lat == record[LAT_1E7DEG] and lon == record[LON_1E7DEG] and speed2 >= _MAX_STANDING_CM2_S2:
        return False
    if abs(t_ns - boot_ms * _NS_PER_MS - record[BOOT_OFFSET_NS]) >= _MIN_BOOT_DIFFERENCE_NS:
        return False
    north_m = (lat - record[LAT_1E7DEG]) * _M_PER_1E7
    east_m = (lon - record[LON_1E7DEG]) * _M_PER_1E7
    elapsed_ms = _lead(boot_ms, record[BOOT_MS], _BOOT_RANGE_MS)
    reach_m = _SURE_FRACTION * (max_speed_m_s * elapsed_ms * 1e-3 + POSITION_SLACK_M)
    if north_m * north_m + east_m * east_m < reach_m * reach_m:
        return True
    east_m *= math.cos(math.radians(lat * 1e-7))
    return north_m * north_m + east_m * east_m < reach_m * reach_m


@jit.leaf
def _apply_position(
    data: Bytes, begin: int, size: int, t_ns: int, record: IntArray, origin: FloatArray
) -> bool:
    """Store a position that is newer and plausible; return True if it was stored."""
    boot_ms = _number(data, begin, 0, size, 4)
    if record[BOOT_MS] != NONE:
        ahead_ms = _lead(boot_ms, record[BOOT_MS], _BOOT_RANGE_MS)
        if ahead_ms == 0 or ahead_ms >= _BOOT_RANGE_MS // 2:
            return False
    if record[BEST_FIX] != NONE and record[BEST_FIX] < _FIX_3D:
        return False
    lat = _signed(data, begin, 4, size, 4)
    lon = _signed(data, begin, 8, size, 4)
    alt = _signed(data, begin, 12, size, 4)
    if abs(lat) >= 900_000_000 or abs(lon) >= 1_800_000_000 or not _MIN_ALT_MM < alt < _MAX_ALT_MM:
        return False
    if (abs(lat) <= _NULL_1E7 and abs(lon) <= _NULL_1E7) or not _is_near(lat, lon, origin):
        return False
    v_north = _signed(data, begin, 20, size, 2)
    v_east = _signed(data, begin, 22, size, 2)
    if not _is_plausible(record, boot_ms, t_ns, lat, lon, v_east * v_east + v_north * v_north, origin[3]):
        return False
    record[BOOT_MS] = boot_ms
    record[BOOT_OFFSET_NS] = t_ns - boot_ms * _NS_PER_MS
    record[IN_LATE_RUN] = 0
    record[POSITION_NS] = t_ns
    record[LAT_1E7DEG] = lat
    record[LON_1E7DEG] = lon
    record[ALT_MM] = alt
    record[V_NORTH_CM_S] = v_north
    record[V_EAST_CM_S] = v_east
    record[V_DOWN_CM_S] = _signed(data, begin, 24, size, 2)
    record[HEADING_CDEG] = _number(data, begin, 26, size, 2)
    record[POSITIONS] += 1
    return True


@jit.leaf
def _count(record: IntArray, sequence: int, t_ns: int) -> int:
    """Count a frame and the gap before it; return the change of `LOST`."""
    record[FRAMES] += 1
    record[HEARD_NS] = t_ns
    before = record[LOST]
    if record[LAST_SEQUENCE] == NONE:
        record[LAST_SEQUENCE] = sequence
        return 0
    ahead = _lead(sequence, record[LAST_SEQUENCE], _SEQUENCE_RANGE)
    if 0 < ahead < _SEQUENCE_RANGE // 2:
        record[LOST] += ahead - 1
        record[LAST_SEQUENCE] = sequence
    elif ahead >= _SEQUENCE_RANGE // 2:
        record[LOST] = max(0, before - 1)
    return record[LOST] - before


@jit.leaf
def _apply_frames(
    data: Bytes, frames: Int32Array, at: int, address: int, t_ns: int, lookup: IntArray, table: IntArray,
    origin: FloatArray,
) -> tuple[int, int]:  # fmt: skip
    """Apply frames from row `at` on; stop at the first that is not routine.

    `lookup` holds the record number of each system id (`NONE` for unknown systems). For each message id it
    then holds 0 if it is only counted, 1 if only the vehicle's record needs it, `_SLOW_PATH` if it is never
    routine.

    Returns the row of `frames` at which it stopped, and the change of all `LOST`.
    """
    lost = 0
    while at < len(frames):
        if frames[at, CHECKED] == 0:
            at += 1
            continue
        index = lookup[frames[at, SYSTEM]]
        message_id = frames[at, MESSAGE_ID]
        if index == NONE or frames[at, COMPONENT] != _AUTOPILOT:
            break
        record = table[index]
        if record[ADDRESS] != address or record[IS_SIGNED] != frames[at, SIGNED]:
            break
        if message_id < _MESSAGE_IDS and lookup[_SYSTEM_IDS + message_id]:
            offset = frames[at, OFFSET]
            begin = offset + (6 if data[offset] == _V1 else 10)
            size = jit.int64(data[offset + 1])
            if lookup[_SYSTEM_IDS + message_id] == _SLOW_PATH:
                break
            if message_id == _POSITION:
                if not _apply_position(data, begin, size, t_ns, record, origin):
                    break
            elif message_id == _GPS:
                record[FIX_TYPE] = _byte(data, begin, 28, size)
                record[BEST_FIX] = max(record[BEST_FIX], record[FIX_TYPE])
            elif message_id == _SYS_STATUS:
                percent = _signed(data, begin, 30, size, 1)
                record[BATTERY_PERCENT] = percent if 0 <= percent <= 100 else NONE
                enabled = _number(data, begin, 4, size, 4)
                healthy = _number(data, begin, 8, size, 4)
                record[SENSORS_FAILED] = enabled & ~healthy
                record[SENSORS_GOOD] = enabled & healthy
            elif message_id == _HUD:
                record[THROTTLE_PERCENT] = _number(data, begin, 18, size, 2)
            elif message_id == _EKF:
                record[ESTIMATOR_FLAGS] = _number(data, begin, 20, size, 2)
            elif message_id == _ESTIMATOR:
                record[ESTIMATOR_FLAGS] = _number(data, begin, 40, size, 2)
            elif message_id == _EXTENDED:
                record[LANDED_STATE] = _byte(data, begin, 1, size)
            elif message_id == _HEARTBEAT:
                key = _number(data, begin, 0, size, 8)
                if key == NONE or key != record[HEARTBEAT_KEY]:
                    break
            elif message_id == _NAVIGATION:
                if record[LEG_WATCHED]:
                    break
            else:
                break
        lost += _count(record, frames[at, SEQUENCE], t_ns)
        at += 1
    return at, lost


@jit.kernel
def _apply_kernel(
    data: Bytes, frames: Int32Array, at: int, address: int, t_ns: int, lookup: IntArray, table: IntArray,
    origin: FloatArray,
) -> tuple[int, int]:  # fmt: skip
    return _apply_frames(data, frames, at, address, t_ns, lookup, table, origin)


class VehicleTable:
    """Telemetry table of all vehicles, and the kernel that applies routine frames to it.

    Parameters
    ----------
    table : (n, WIDTH) array
        Records.
    vehicles : sequence of int
        Vehicle of each record.
    read_ids, slow_ids : collection of int
        Message ids that are needed, and those of which no frame is routine.
    frame : LocalFrame
    max_speed_m_s : float
        Ground speed above which a report is refused.
    """

    def __init__(
        self,
        table: VehicleRecord,
        vehicles: Sequence[int],
        read_ids: Collection[int],
        slow_ids: Collection[int],
        frame: LocalFrame,
        max_speed_m_s: float,
    ) -> None:
        if max((*read_ids, *slow_ids), default=0) >= _MESSAGE_IDS:
            raise ValueError(f"message ids that are needed must be below {_MESSAGE_IDS}")
        empty = np.full(_SYSTEM_IDS + _MESSAGE_IDS, NONE, np.int64)
        empty[_SYSTEM_IDS:] = np.isin(np.arange(_MESSAGE_IDS), list(read_ids))
        empty[_SYSTEM_IDS:][list(slow_ids)] = _SLOW_PATH
        self._lookup_of_network: dict[int, VehicleRecord] = {}
        for index, vehicle in enumerate(vehicles):
            lookup = self._lookup_of_network.setdefault(network_of(vehicle), empty.copy())
            lookup[system_of(vehicle)] = index
        self._table = table
        self._origin = np.array([frame.lat_deg, frame.lon_deg, MAX_DISTANCE_M, max_speed_m_s])

    def apply_frames(
        self, frames: FrameTable, at: int, address: int, t_ns: int, network: int
    ) -> tuple[int, int]:
        """Apply a datagram's frames from row `at` on, up to the first that is not routine.

        Returns the row of that frame (one past the last if all are routine), and the change of losses.
        """
        lookup = self._lookup_of_network.get(network)
        if lookup is None or address == NO_ADDRESS:
            return at, 0
        next_at, lost = _apply_kernel(
            frames.data, frames.rows, at, address, t_ns, lookup, self._table, self._origin
        )
        return next_at, lost


def warm_up_calls() -> list[jit.Call]:
    """Return one call of each kernel, including those for framing, batches and signatures."""
    frames = np.zeros((2, CHECKED + 1), np.int32)
    lookup = np.full(_SYSTEM_IDS + _MESSAGE_IDS, NONE, np.int64)
    table = np.zeros((1, WIDTH), np.int64)
    return [
        *fast_scan.warm_up_calls(),
        *batches.warm_up_calls(),
        *fast_verify.warm_up_calls(),
        (_apply_kernel, b"\xfd", frames, 0, 0, 0, lookup, table, np.zeros(4)),
    ]


def warm_up() -> None:
    """Load the kernels from the cache, or compile them."""
    jit.warm_up(__name__)
