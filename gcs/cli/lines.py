"""What an operator is told, in one line each: in the live view, in the log and by `gcs order`."""

from __future__ import annotations

from gcs.cli.proposal import MAX_ROUTES, proposal_title, route_lines
from gcs.model import (
    AgentStatus,
    Effect,
    Label,
    MissionEnded,
    Notice,
    OrderAnswer,
    Plan,
    Proposal,
    UploadReport,
    target_name,
    vehicle_name,
)


def target_text(label: Label | None) -> str:
    """Return the name of a target, or a dash."""
    return "–" if label is None else target_name(label)


def effect_line(effect: Effect) -> tuple[str, str] | None:
    """One line for an operator and its level; None for what only machines care about."""
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
            return f"plan: {effect.reason}; re-tasked: {routes or 'nobody'}", "info"
        case UploadReport(ok=True):
            return (
                (
                    f"agent {vehicle_name(effect.vehicle)}: mission of {effect.items} items {effect.detail} "
                    f"in {effect.duration_s:.2f} s, {effect.retries} retries"
                ),
                "info",
            )
        case UploadReport():
            return f"agent {vehicle_name(effect.vehicle)}: mission transfer failed: {effect.detail}", "alarm"
        case AgentStatus(fate="arrived"):
            return (
                f"agent {vehicle_name(effect.vehicle)}: reached target {target_text(effect.target)}",
                "info",
            )
        case AgentStatus(fate="dead"):
            return f"agent {vehicle_name(effect.vehicle)}: lost", "alarm"
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
            spare = f", {len(effect.spare)} to spare" if effect.spare else ""
            return f"mission ended: {len(effect.arrived)} arrived, {len(effect.dead)} lost{spare}", "info"
    return None


def answer_line(answer: OrderAnswer) -> tuple[str, str]:
    """One line for what became of an order, and its level."""
    who = "" if answer.vehicle is None else f" agent {vehicle_name(answer.vehicle)}"
    level = {"refused": "warning", "failed": "alarm"}.get(answer.state, "info")
    return f"order {answer.action}{who} {answer.state}: {answer.detail}", level
