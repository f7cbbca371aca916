"""A plan that waits to be confirmed, in words: the same in the live view, in the log and by `gcs order`."""

from __future__ import annotations

from typing import Final

from gcs.model import NS_PER_S, Proposal, Route, RouteFigures, target_name, vehicle_name

MAX_ROUTES: Final = 6
"""Where room is short, so many are told; `gcs order plan` prints all."""
REMIND_S: Final = 60.0
"""A plan that waits is told of again so often in the log, with its figures as they are by then."""
_SAME_M: Final = 10.0


def proposal_title(proposal: Proposal, t_ns: int | None = None) -> str:
    """Return what waits, for how long, and why; `t_ns`: now, the proposal's own time by default."""
    age_s = proposal.age_s if t_ns is None else (t_ns - proposal.shown_t_ns) / NS_PER_S
    return f"plan {proposal.plan_id} waits to be confirmed, shown {age_s:.0f} s ago: {proposal.reason}"


def route_lines(proposal: Proposal, limit: int | None = None) -> list[str]:
    """Return one line for each route: target, length, time of flight, separation and clearance."""
    figures = {one.vehicle: one for one in proposal.figures}
    lines = [_route_line(route, figures.get(route.vehicle)) for route in proposal.routes]
    if limit is None or len(lines) <= limit:
        return lines
    return [*lines[:limit], f"and {len(lines) - limit} more (gcs order plan)"]


def _route_line(route: Route, figures: RouteFigures | None) -> str:
    text = f"agent {vehicle_name(route.vehicle)} → {target_name(route.target)}: {route.length_m:.0f} m"
    if figures is None:
        return text
    if abs(figures.length_m - figures.shown_length_m) >= _SAME_M:
        text += f" (was {figures.shown_length_m:.0f} m)"
    text += f", arrives in {figures.arrival_s:.0f} s"
    if figures.separation_m is None:
        text += ", alone at its altitude"
    else:
        text += f", separation {figures.separation_m:.0f} m"
    if figures.clearance_m is not None:
        text += f", clearance {figures.clearance_m:.0f} m"
    return text + (", ends before the target" if figures.is_short else "")


class ProposalLog:
    """Which proposals are news for a log: new numbers, other vehicles, and now and then a reminder."""

    def __init__(self) -> None:
        self._told: tuple[int, tuple[int, ...]] | None = None
        self._told_t_ns = 0

    def is_news(self, proposal: Proposal) -> bool:
        """Tell whether a log should have a line for this, and take it as told."""
        what = proposal.plan_id, tuple(route.vehicle for route in proposal.routes)
        if what == self._told and proposal.t_ns - self._told_t_ns < REMIND_S * NS_PER_S:
            return False
        self._told, self._told_t_ns = what, proposal.t_ns
        return True
