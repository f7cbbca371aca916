"""Frames that change numbers only, folded in by a compiled kernel.

Most of what a vehicle sends is quiet: the next position in a row, its battery and fix, a heartbeat that says
what the last one said (unless somebody attends to it), and everything that nobody here reads and that only
counts for loss and liveness. Such frames change a few integers of the vehicle's row in `VehicleTable.table`
and cause nothing. All other frames, and these whenever anything about them is out of the ordinary (from
another address, after a silence, late, a place that may not be), are left to `Fleet` and `Vehicle`, which
work on the same rows: theirs is the simple form that says what is right, and leaving any frame to them is
always correct.

Fields lie in the payload by size (https://mavlink.io/en/messages/common.html), and zeros at the end of a
MAVLink 2 payload are left out (https://mavlink.io/en/guide/serialization.html#payload_truncation).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs import jit
from gcs.geo import LocalFrame
from gcs.mavlink.fleet.position_checks import EARTH_RADIUS_M, MAX_ALT_M, MIN_ALT_M, NULL_DEG
from gcs.mavlink.fleet.position_plausibility import BOOTS_APART_S, SLACK_M, STANDING_M_S
from gcs.mavlink.fleet.telemetry_table import (
    ADDRESS,
    ALT_MM,
    BATTERY_PERCENT,
    BEAT,
    BEST_FIX,
    BOOT_MS,
    BOOT_OFFSET_NS,
    BOOT_RUN,
    FIX_TYPE,
    FRAMES,
    HEADING_CDEG,
    HEARD_NS,
    LAST_SEQUENCE,
    LAT_1E7DEG,
    LEG,
    LON_1E7DEG,
    LOST,
    NOBODY,
    NONE,
    PLACE_NS,
    PLACES,
    SIGNS,
    V_EAST_CM_S,
    V_NORTH_CM_S,
    WATCHED,
    WIDTH,
    Row,
)
from gcs.mavlink.frames import batches, fast_scan
from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID
from gcs.mavlink.frames.fast_scan import (
    CHECKED,
    COMPONENT,
    MESSAGE_ID,
    OFFSET,
    SEQUENCE,
    SIGNED,
    SYSTEM,
    Frames,
)
from gcs.model import network_of, system_of

_POSITION: Final[int] = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
_SYS_STATUS: Final[int] = dialect.MAVLINK_MSG_ID_SYS_STATUS
_HEARTBEAT: Final[int] = dialect.MAVLINK_MSG_ID_HEARTBEAT
_GPS: Final[int] = dialect.MAVLINK_MSG_ID_GPS_RAW_INT
_NAVIGATION: Final[int] = dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT
_FIX_3D: Final[int] = dialect.GPS_FIX_TYPE_3D_FIX
_AUTOPILOT: Final = AUTOPILOT_COMPONENT_ID
_BOOT_WRAP_MS: Final = 1 << 32
_NS_PER_MS: Final = 1_000_000
_SYSTEMS: Final = 256
_IDS: Final = 512
_LOUD: Final = 2
_V1: Final = 0xFE
_EARTH_M: Final = EARTH_RADIUS_M
_M_PER_1E7: Final = math.radians(1e-7) * EARTH_RADIUS_M
_STANDING2: Final = round((100.0 * STANDING_M_S) ** 2)
_NULL_1E7: Final = round(NULL_DEG * 1e7)
_LOW_MM: Final = round(MIN_ALT_M * 1e3)
_HIGH_MM: Final = round(MAX_ALT_M * 1e3)
_BOOTS_APART_NS: Final = round(BOOTS_APART_S * 1e9)
_MARGIN: Final = 0.98
"""Of the greatest distance, and of what is in reach: nearer than that the kernel is sure, whatever the last
bit of its sine and the shape of the Earth say."""


@jit.leaf
def _byte(data, begin, offset, size):  # type: ignore[no-untyped-def]
    return np.int64(data[begin + offset]) if offset < size else np.int64(0)


@jit.leaf
def _number(data, begin, offset, size, width):  # type: ignore[no-untyped-def]
    """Little-endian and unsigned."""
    value = np.int64(0)
    for k in range(width):
        value |= _byte(data, begin, offset + k, size) << 8 * k
    return value


@jit.leaf
def _signed(data, begin, offset, size, width):  # type: ignore[no-untyped-def]
    value = _number(data, begin, offset, size, width)
    half = np.int64(1) << 8 * width - 1
    return (value ^ half) - half


@jit.leaf
def _is_near(lat, lon, origin):  # type: ignore[no-untyped-def]
    """Return True if a place (1e-7 degrees) is well within reach (`position_checks.distance_m`).

    The way along the meridian and then along the equator's circle is never shorter: it mostly suffices.
    """
    around = math.radians(abs(lat * 1e-7 - origin[0]) + abs(lon * 1e-7 - origin[1]))
    if _EARTH_M * around < _MARGIN * origin[2]:
        return True
    lat1, lat0 = math.radians(lat * 1e-7), math.radians(origin[0])
    half_lat, half_lon = (lat0 - lat1) / 2.0, math.radians(origin[1] - lon * 1e-7) / 2.0
    chord = math.sin(half_lat) ** 2 + math.cos(lat1) * math.cos(lat0) * math.sin(half_lon) ** 2
    return 2.0 * _EARTH_M * math.asin(min(1.0, math.sqrt(chord))) < _MARGIN * origin[2]


@jit.leaf
def _goes_on(row, boot_ms, t_ns, lat, lon, speed2, max_speed_m_s):  # type: ignore[no-untyped-def]
    """Return True if a position surely goes on from the one before (`position_plausibility`).

    `speed2` is the square of the speed, in cm/s. A way to the east is never longer than on the equator: that
    mostly suffices, and spares the cosine.
    """
    if row[WATCHED] or speed2 > max_speed_m_s * max_speed_m_s * 1e4:
        return False
    if row[PLACES] == 0:
        return True
    if lat == row[LAT_1E7DEG] and lon == row[LON_1E7DEG] and speed2 >= _STANDING2:
        return False
    if abs(t_ns - boot_ms * _NS_PER_MS - row[BOOT_OFFSET_NS]) >= _BOOTS_APART_NS:
        return False
    north_m = (lat - row[LAT_1E7DEG]) * _M_PER_1E7
    east_m = (lon - row[LON_1E7DEG]) * _M_PER_1E7
    reach_m = _MARGIN * (max_speed_m_s * (boot_ms - row[BOOT_MS] & _BOOT_WRAP_MS - 1) * 1e-3 + SLACK_M)
    if north_m * north_m + east_m * east_m < reach_m * reach_m:
        return True
    east_m *= math.cos(math.radians(lat * 1e-7))
    return north_m * north_m + east_m * east_m < reach_m * reach_m


@jit.leaf
def _take_position(data, begin, size, t_ns, row, origin):  # type: ignore[no-untyped-def]
    """Take a position that is newer and can be believed; return whether it was taken."""
    boot_ms = _number(data, begin, 0, size, 4)
    if row[BOOT_MS] != NONE:
        ahead_ms = boot_ms - row[BOOT_MS] & _BOOT_WRAP_MS - 1
        if ahead_ms == 0 or ahead_ms >= _BOOT_WRAP_MS // 2:
            return False
    if row[BEST_FIX] != NONE and row[BEST_FIX] < _FIX_3D:
        return False
    lat, lon = _signed(data, begin, 4, size, 4), _signed(data, begin, 8, size, 4)
    alt = _signed(data, begin, 12, size, 4)
    if abs(lat) >= 900_000_000 or abs(lon) >= 1_800_000_000 or not _LOW_MM < alt < _HIGH_MM:
        return False
    if (abs(lat) <= _NULL_1E7 and abs(lon) <= _NULL_1E7) or not _is_near(lat, lon, origin):
        return False
    v_north, v_east = _signed(data, begin, 20, size, 2), _signed(data, begin, 22, size, 2)
    if not _goes_on(row, boot_ms, t_ns, lat, lon, v_east * v_east + v_north * v_north, origin[3]):
        return False
    row[BOOT_MS], row[BOOT_OFFSET_NS], row[BOOT_RUN] = boot_ms, t_ns - boot_ms * _NS_PER_MS, 0
    row[PLACE_NS], row[LAT_1E7DEG], row[LON_1E7DEG], row[ALT_MM] = t_ns, lat, lon, alt
    row[V_NORTH_CM_S], row[V_EAST_CM_S] = v_north, v_east
    row[HEADING_CDEG] = _number(data, begin, 26, size, 2)
    row[PLACES] += 1
    return True


@jit.leaf
def _count(row, sequence, t_ns):  # type: ignore[no-untyped-def]
    """Count a frame and the gap before it; return by how much `LOST` changed."""
    row[FRAMES] += 1
    row[HEARD_NS] = t_ns
    before = row[LOST]
    if row[LAST_SEQUENCE] == NONE:
        row[LAST_SEQUENCE] = sequence
        return 0
    ahead = sequence - row[LAST_SEQUENCE] & 255
    if 0 < ahead < 128:
        row[LOST] += ahead - 1
        row[LAST_SEQUENCE] = sequence
    elif ahead >= 128:
        row[LOST] = max(0, before - 1)
    return row[LOST] - before


@jit.leaf
def _fold_on(data, frames, at, address, t_ns, rows_of, table, origin):  # type: ignore[no-untyped-def]
    """Fold frames in from row `at` on; stop before the first that is not quiet.

    `rows_of` holds the row of each system id (`NONE` for strangers), then for each message id 0 when nobody
    reads it, 1 when only the vehicle's record does, `_LOUD` when others want every one.

    Returns the row of `frames` where it stopped, and the change of all `LOST`.
    """
    lost = 0
    while at <= frames[0, 0]:
        if frames[at, CHECKED] == 0:
            at += 1
            continue
        index, message_id = rows_of[frames[at, SYSTEM]], frames[at, MESSAGE_ID]
        if index == NONE or frames[at, COMPONENT] != _AUTOPILOT:
            break
        row = table[index]
        if row[ADDRESS] != address or row[SIGNS] != frames[at, SIGNED]:
            break
        if message_id < _IDS and rows_of[_SYSTEMS + message_id]:
            offset = frames[at, OFFSET]
            begin = offset + (6 if data[offset] == _V1 else 10)
            size = np.int64(data[offset + 1])
            if rows_of[_SYSTEMS + message_id] == _LOUD:
                break
            if message_id == _POSITION:
                if not _take_position(data, begin, size, t_ns, row, origin):
                    break
            elif message_id == _GPS:
                row[FIX_TYPE] = _byte(data, begin, 28, size)
                row[BEST_FIX] = max(row[BEST_FIX], row[FIX_TYPE])
            elif message_id == _SYS_STATUS:
                percent = _signed(data, begin, 30, size, 1)
                row[BATTERY_PERCENT] = percent if 0 <= percent <= 100 else NONE
            elif message_id == _HEARTBEAT:
                beat = _number(data, begin, 0, size, 8)
                if beat == NONE or beat != row[BEAT]:
                    break
            elif message_id == _NAVIGATION:
                if row[LEG]:
                    break
            else:
                break
        lost += _count(row, frames[at, SEQUENCE], t_ns)
        at += 1
    return at, lost


@jit.kernel
def _fold(data, frames, at, address, t_ns, rows_of, table, origin):  # type: ignore[no-untyped-def]
    return _fold_on(data, frames, at, address, t_ns, rows_of, table, origin)


class VehicleTable:
    """The rows of all vehicles, and the quiet frames that change them.

    Parameters
    ----------
    table : (n, WIDTH) array
        The rows.
    vehicles : sequence of int
        Whose they are, in order.
    frames : Frames
        Of the datagram that is worked.
    read, loud : collection of int
        Message ids that somebody reads; those among or beside them of which no frame is quiet.
    frame : LocalFrame
    bounds : (float, float)
        Metres from the frame's origin beyond which places are none of ours, and the greatest ground speed.
    """

    def __init__(
        self,
        table: Row,
        vehicles: Sequence[int],
        frames: Frames,
        read: Collection[int],
        loud: Collection[int],
        frame: LocalFrame,
        bounds: tuple[float, float],
    ) -> None:
        if max((*read, *loud), default=0) >= _IDS:
            raise ValueError(f"message ids that are read must be below {_IDS}")
        empty = np.full(_SYSTEMS + _IDS, NONE, np.int64)
        empty[_SYSTEMS:] = np.isin(np.arange(_IDS), list(read))
        empty[_SYSTEMS:][list(loud)] = _LOUD
        self._rows_of: dict[int, Row] = {}
        for index, vehicle in enumerate(vehicles):
            rows_of = self._rows_of.setdefault(network_of(vehicle), empty.copy())
            rows_of[system_of(vehicle)] = index
        self._table, self._frames = table, frames
        self._origin = np.array([frame.lat_deg, frame.lon_deg, *bounds])

    def fold(self, data: bytes, at: int, address: int, t_ns: int, network: int) -> tuple[int, int]:
        """Fold a datagram's frames in from row `at` of their table on, up to the first that is not quiet.

        Returns the row of that frame, one past the last when there is none; and the change of losses.
        """
        rows_of = self._rows_of.get(network)
        if rows_of is None or address == NOBODY:
            return at, 0
        next_at, lost = _fold(data, self._frames.table, at, address, t_ns, rows_of, self._table, self._origin)
        return next_at, lost


def warm_up_calls() -> list[jit.Call]:
    """List one call of each kernel, those of framing and gathering among them."""
    frames = np.zeros((2, CHECKED + 1), np.int32)
    rows_of, table = np.full(_SYSTEMS + _IDS, NONE, np.int64), np.zeros((1, WIDTH), np.int64)
    return [
        *fast_scan.warm_up_calls(),
        *batches.warm_up_calls(),
        (_fold, b"\xfd", frames, 1, 0, 0, rows_of, table, np.zeros(4)),
    ]


def warm_up() -> None:
    """Load the kernels from the cache, or compile them."""
    jit.warm_up(__name__)
