"""Checks of a single position report: range, fix, null island, distance; its order: late, or after a reboot.

Reasons for a refusal, which are counted:

* ``range``: no latitude, longitude or height on Earth;
* ``no fix``: before the first 3D fix since boot, if the vehicle reports fixes at all;
* ``null``: within 110 m of latitude and longitude zero. ArduPlane reports about (1e-4, -3e-5) degrees before
  its EKF has an origin;
* ``far``: too far from the mission's origin along the great circle (on the tangent plane the far side of the
  Earth is near again);
* ``late``: measured before an accepted report. Datagrams overtake each other.

Time since boot separates a reboot from late reports. Late reports come between newer ones. After a reboot the
vehicle's clock runs on steadily from an earlier value, and no newer report comes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from gcs.geo import LocalFrame
from gcs.mavlink.fleet.telemetry_table import (
    BOOT_MS,
    BOOT_OFFSET_NS,
    IN_LATE_RUN,
    NONE,
    VehicleRecord,
)
from gcs.mavlink.services.retry import ns

ReportOrder: TypeAlias = Literal["new", "late", "rebooted"]

EARTH_RADIUS_M: Final = 6_371_000.0
NULL_DEG: Final = 1e-3
MIN_ALT_M: Final = -1_000.0
MAX_ALT_M: Final = 50_000.0
MAX_DISTANCE_M: Final = 100_000.0
"""Distance from the frame's origin beyond which a position report is refused."""
_BOOT_WRAP_MS: Final = 1 << 32
_NS_PER_MS: Final = 1_000_000
_CONFIRM_NS: Final = ns(2.0)
MIN_JUMP_NS: Final = ns(5.0)
MAX_LATE_NS: Final = ns(30.0)
"""By how much one link of a vehicle may be later than another, assumed."""
_MAX_JITTER_NS: Final = ns(1.0)


@dataclass(slots=True)
class BootClock:
    """A vehicle's time since boot: detects late reports and reboots.

    Reports behind the latest one form a *run* while their clock and ours advance alike, within
    `_MAX_JITTER_NS`. A run of `_CONFIRM_NS` whose clock is at least `min_jump_ns` behind is a reboot:
    `MIN_JUMP_NS`, as a link becomes slower by less; `MAX_LATE_NS` after a change of link, until a new report
    comes there.
    """

    run: tuple[int, int, int] = (0, 0, 0)
    """First arrival, its offset between our clock and the vehicle's, and the number of reports."""

    def add_report(self, record: VehicleRecord, boot_ms: int, t_ns: int, min_jump_ns: int) -> ReportOrder:
        """Add a report's time since boot to a vehicle's record; only "new" and "rebooted" reports count."""
        latest_ms = record.item(BOOT_MS)
        latest_offset_ns = record.item(BOOT_OFFSET_NS)
        offset_ns = t_ns - boot_ms * _NS_PER_MS
        ahead_ms = 1 if latest_ms == NONE else (boot_ms - latest_ms) % _BOOT_WRAP_MS
        if 0 < ahead_ms < _BOOT_WRAP_MS // 2:
            return _set_latest(record, boot_ms, offset_ns, "new")
        if offset_ns - latest_offset_ns < min_jump_ns:
            return "late"
        if not record[IN_LATE_RUN] or abs(offset_ns - self.run[1]) > _MAX_JITTER_NS:
            self.run = (t_ns, offset_ns, 0)
            record[IN_LATE_RUN] = True
        began_t_ns, run_offset_ns, reports = self.run
        self.run = (began_t_ns, run_offset_ns, reports + 1)
        if reports >= 2 and t_ns - began_t_ns >= _CONFIRM_NS:
            return _set_latest(record, boot_ms, offset_ns, "rebooted")
        return "late"


def _set_latest(record: VehicleRecord, boot_ms: int, offset_ns: int, order: ReportOrder) -> ReportOrder:
    record[BOOT_MS] = boot_ms
    record[BOOT_OFFSET_NS] = offset_ns
    record[IN_LATE_RUN] = False
    return order


def position_problem(
    lat_deg: float, lon_deg: float, alt_msl_m: float, frame: LocalFrame, max_distance_m: float
) -> str:
    """Return why a position cannot be a vehicle's; empty if it can."""
    if abs(lat_deg) > 90.0 or abs(lon_deg) > 180.0 or not MIN_ALT_M < alt_msl_m < MAX_ALT_M:
        return "range"
    if abs(lat_deg) < NULL_DEG and abs(lon_deg) < NULL_DEG:
        return "null"
    if distance_m(lat_deg, lon_deg, frame.lat_deg, frame.lon_deg) > max_distance_m:
        return "far"
    return ""


def distance_m(lat1_deg: float, lon1_deg: float, lat2_deg: float, lon2_deg: float) -> float:
    """Return the great-circle distance on a sphere (haversine), within 0.5 %."""
    lat1 = math.radians(lat1_deg)
    lat2 = math.radians(lat2_deg)
    half_lat = (lat2 - lat1) / 2.0
    half_lon = math.radians(lon2_deg - lon1_deg) / 2.0
    chord = math.sin(half_lat) ** 2 + math.cos(lat1) * math.cos(lat2) * math.sin(half_lon) ** 2
    return 2.0 * EARTH_RADIUS_M * math.asin(min(1.0, math.sqrt(chord)))
