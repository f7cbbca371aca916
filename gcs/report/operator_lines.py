"""One-line texts for the operator, in the live view, in the log and by `gcs order`: plans, answers."""

from __future__ import annotations

from typing import Final

from gcs.model import (
    NS_PER_S,
    AgentStatus,
    AnswerState,
    Effect,
    Label,
    MissionEnded,
    Notice,
    NoticeCode,
    OrderAnswer,
    Parameter,
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


def effect_notice(effect: Effect) -> Notice | None:
    """Return what the operator is told of an effect; None if nothing."""
    match effect:
        case Notice():
            return effect
        case Plan():
            routes = ", ".join(
                f"{vehicle_name(route.vehicle)} → {target_name(route.target)} ({route.length_m:.0f} m)"
                for route in effect.routes
                if route.vehicle in effect.changed
            )
            plan = {"reason": effect.reason, "routes": routes or "none"}
            return Notice(effect.t_ns, NoticeCode.PLAN_MADE, None, plan)
        case UploadReport():
            code = NoticeCode.MISSION_VERIFIED if effect.ok else NoticeCode.MISSION_FAILED
            return Notice(effect.t_ns, code, effect.vehicle, _upload(effect))
        case AgentStatus():
            target = {"target": target_text(effect.target)}
            return Notice(effect.t_ns, _status_code(effect), effect.vehicle, target)
        case OrderAnswer():
            return answer_notice(effect)
        case Proposal() if effect.routes:
            routes = "; ".join(route_lines(effect, MAX_ROUTES))
            plan = {"plan": f"{proposal_title(effect)}: {routes}"}
            return Notice(effect.t_ns, NoticeCode.PLAN_WAITS, None, plan)
        case MissionEnded():
            return Notice(effect.t_ns, NoticeCode.MISSION_ENDED, None, _counts(effect))
    return None


def _upload(report: UploadReport) -> dict[str, Parameter]:
    return {
        "items": report.items,
        "detail": report.detail,
        "duration_s": report.duration_s,
        "retries": report.retries,
    }


def _status_code(status: AgentStatus) -> NoticeCode:
    if status.status == "arrived":
        return NoticeCode.TARGET_REACHED
    if status.status == "lost":
        return NoticeCode.AGENT_LOST
    if status.target is not None:
        return NoticeCode.TARGET_LEFT
    return NoticeCode.AGENT_DOWN if status.status == "down" else NoticeCode.AGENT_BACK


def _counts(ended: MissionEnded) -> dict[str, Parameter]:
    return {
        "arrived": len(ended.arrived),
        "lost": len(ended.lost),
        "down": len(ended.down) or "",
        "surplus": len(ended.surplus) or "",
    }


_ANSWER_CODES: Final[dict[AnswerState, NoticeCode]] = {
    "accepted": NoticeCode.ORDER_ACCEPTED,
    "done": NoticeCode.ORDER_DONE,
    "refused": NoticeCode.ORDER_REFUSED,
    "failed": NoticeCode.ORDER_FAILED,
}


def answer_notice(answer: OrderAnswer) -> Notice:
    """Return the notice of an answer to an order."""
    about = {"action": answer.action, "detail": answer.detail}
    return Notice(answer.t_ns, _ANSWER_CODES[answer.state], answer.vehicle, about)


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
