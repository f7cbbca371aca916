"""Link timeouts: after how long a silent vehicle is stale, and its link is down.

A vehicle that is heard by HIGH_LATENCY2 alone may miss two reports.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from gcs.mavlink.fleet.telemetry_table import ADDRESS, NO_ADDRESS
from gcs.model import NS_PER_S, NoticeCode, Notify

if TYPE_CHECKING:
    from gcs.mavlink.fleet.fleet_state import VehicleLink
    from gcs.mavlink.fleet.vehicle import Vehicle

STALE_AFTER_S: Final = 2.5
"""Timeout after which a vehicle is stale: first notice to the operator."""
LOST_AFTER_S: Final = 5.0
"""Timeout after which the link is down and the vehicle may appear at another address."""
STALE_AFTER_NS: Final = round(STALE_AFTER_S * NS_PER_S)
LOST_AFTER_NS: Final = round(LOST_AFTER_S * NS_PER_S)
STALE_PERIODS: Final = 2.5
"""The same timeouts in periods of high-latency reports."""
_LOST_PERIODS: Final = 5.0
_CLAIM_NS: Final = 10 * NS_PER_S
"""Time without frames from another address that ends an id conflict."""


def stale_after_ns(link: VehicleLink) -> int:
    """Return the time without a frame after which a vehicle is stale."""
    slow = link.high_latency
    return STALE_AFTER_NS if slow is None else round(STALE_PERIODS * slow.period_ns)


def lost_after_ns(link: VehicleLink) -> int:
    """Return the time without a frame after which the link to a vehicle is down."""
    slow = link.high_latency
    return LOST_AFTER_NS if slow is None else round(_LOST_PERIODS * slow.period_ns)


def check_liveness(vehicle: Vehicle, t_ns: int, notify: Notify) -> None:
    """Notify of timeouts, and of the end of an id conflict."""
    link = vehicle.link
    silent_ns = t_ns - vehicle.heard_t_ns
    if link.liveness in ("alive", "stale") and silent_ns > lost_after_ns(link):
        link.liveness = "down"
        vehicle.record[ADDRESS] = NO_ADDRESS
        notify(NoticeCode.LINK_DOWN, silence_s=silent_ns / NS_PER_S)
    elif link.liveness == "alive" and silent_ns > stale_after_ns(link):
        link.liveness = "stale"
        vehicle.record[ADDRESS] = NO_ADDRESS
        notify(NoticeCode.LINK_STALE, silence_s=silent_ns / NS_PER_S)
    elif link.liveness == "alive":
        vehicle.check_position_age(t_ns, notify)
        vehicle.check_consistency(t_ns, notify)
        vehicle.check_battery(notify)
    if link.claimed_t_ns is not None and t_ns - link.claimed_t_ns > _CLAIM_NS:
        link.claimed_t_ns = None
        notify(NoticeCode.ID_CONFLICT_OVER)
