"""One-line texts for the operator: in the live view, in the log and by `gcs order`."""

from __future__ import annotations

from typing import Final

from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Effect,
    Label,
    MissionEnded,
    Notice,
    OrderAnswer,
    Plan,
    Proposal,
    Route,
    RouteFigures,
    UploadReport,
    target_name,
    vehicle_name,
)

MAX_ROUTES: Final = 6
"""Routes of a proposed plan in the live view and the log; `gcs order plan` prints all."""
_MIN_LENGTH_CHANGE_M: Final = 10.0


def target_text(label: Label | None) -> str:
    """Return the name of a target, or a dash."""
    return "–" if label is None else target_name(label)


def effect_line(effect: Effect) -> tuple[str, str] | None:
    """Return the operator's line for an effect and its level; None for an effect without one."""
    match effect:
        case Notice(vehicle=None):
            return effect.text, effect.level
        case Notice(vehicle=int(vehicle)):
            return f"agent {vehicle_name(vehicle)}: {effect.text}", effect.level
        case Plan():
            routes = ", ".join(
                f"{vehicle_name(route.vehicle)} → {target_name(route.target)} ({route.length_m:.0f} m)"
                for route in effect.routes
                if route.vehicle in effect.changed
            )
            return f"plan: {effect.reason}; re-tasked: {routes or 'none'}", "info"
        case UploadReport(ok=True):
            text = f"mission of {effect.items} items {effect.detail} in {effect.duration_s:.2f} s"
            return f"agent {vehicle_name(effect.vehicle)}: {text}, {effect.retries} retries", "info"
        case UploadReport():
            return f"agent {vehicle_name(effect.vehicle)}: mission transfer failed: {effect.detail}", "alarm"
        case AgentStatus(status="arrived"):
            text = f"agent {vehicle_name(effect.vehicle)}: reached target {target_text(effect.target)}"
            return text, "info"
        case AgentStatus(status="lost"):
            return f"agent {vehicle_name(effect.vehicle)}: lost", "alarm"
        case AgentStatus(target=(_, _)):
            text = f"agent {vehicle_name(effect.vehicle)}: leaves target {target_text(effect.target)}"
            return text, "info"
        case AgentStatus(status="down"):
            return f"agent {vehicle_name(effect.vehicle)}: down", "alarm"
        case AgentStatus():
            return f"agent {vehicle_name(effect.vehicle)}: is back", "warning"
        case OrderAnswer():
            return answer_line(effect)
        case Proposal(routes=()):
            return None
        case Proposal():
            routes = "; ".join(route_lines(effect, MAX_ROUTES))
            return f"{proposal_title(effect)}: {routes}", "warning"
        case MissionEnded():
            surplus = f", {len(effect.surplus)} surplus" if effect.surplus else ""
            down = f", {len(effect.down)} down" if effect.down else ""
            counts = f"{len(effect.arrived)} arrived, {len(effect.lost)} lost{down}{surplus}"
            return f"mission ended: {counts}", "info"
    return None


def answer_line(answer: OrderAnswer) -> tuple[str, str]:
    """Return the line for the answer to an order, and its level."""
    agent = "" if answer.vehicle is None else f" agent {vehicle_name(answer.vehicle)}"
    level = {"refused": "warning", "failed": "alarm"}.get(answer.state, "info")
    return f"order {answer.action}{agent} {answer.state}: {answer.detail}", level


def proposal_title(proposal: Proposal, t_ns: int | None = None) -> str:
    """Return number, age and reason of a proposed plan at `t_ns`, by default the proposal's own time."""
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
    text = f"agent {vehicle_name(route.vehicle)} → {target_name(route.target)}"
    if figures is None:
        return f"{text}: {route.length_m:.0f} m"
    text += f": {figures.length_m:.0f} m"
    if abs(figures.length_m - figures.shown_length_m) >= _MIN_LENGTH_CHANGE_M:
        text += f" (was {figures.shown_length_m:.0f} m)"
    text += f", arrives in {figures.arrival_s:.0f} s"
    if figures.separation_m is None:
        text += ", alone at its altitude"
    else:
        text += f", separation {figures.separation_m:.0f} m"
    if figures.clearance_m is not None:
        text += f", clearance {figures.clearance_m:.0f} m"
    return text + (", ends before the target" if figures.is_short else "")
