"""Which vehicles are not ours to task, as their mode, their mission and our orders show at any time.

The other claims are recorded when their events happen (`gcs.model.authority`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gcs.core.authority.authority_state import AgentAuthority
from gcs.core.operator.records import AgentOrders
from gcs.core.replanning.records import AgentRoutes
from gcs.core.takeoff.takeoff_state import AgentTakeoff
from gcs.core.tasking.tasking_state import AgentTasking
from gcs.core.tasking.terminal_phase import terminal_phase
from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.fleet.fleet_state import VehicleLink
from gcs.model import Authority

_MISSION_MODES: Final = ("", AUTO, LOITER)
"""Before the first heartbeat, on a mission, and waiting for one."""


def derived_claims(
    link: VehicleLink,
    authority: AgentAuthority,
    tasking: AgentTasking,
    takeoff: AgentTakeoff,
    orders: AgentOrders,
    routes: AgentRoutes,
) -> Iterator[tuple[Authority, str]]:
    """Yield the derived claims to one vehicle, each with the mode that its reason names.

    A vehicle that flies RTL after its mission, and has missed its target, is ours: it gets another mission.
    """
    has_missed_in_rtl = authority.mode.has_ended and tasking.route_end.has_missed
    if takeoff.blocked:
        yield Authority.GROUNDED, ""
    if link.mode not in _MISSION_MODES and not has_missed_in_rtl:
        yield Authority.OTHER_MODE, link.mode
    if terminal_phase(tasking, link, authority.mode) == "landing":
        yield Authority.LANDING, ""
    if link.address is not None and link.profile is None:
        yield Authority.UNSUPPORTED, ""
    command = orders.command
    if command is not None and command.action == "resume" and routes.flown is None:
        yield Authority.RESUMING, ""
