"""Reasons for plans: each in words for operators, with its kind for figures and counts."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, NamedTuple

from gcs.model import Cause, Label, target_name, vehicle_name


class Reason(NamedTuple):
    """One reason for a plan."""

    cause: Cause
    text: str


URGENT: Final[frozenset[Cause]] = frozenset(
    {"taken up again", "map changed", "agent set aside", "agent in danger", "approved plan changed"}
)
"""Kinds that replace a proposed plan before an operator had the time to read it."""
FIRST_PLAN = Reason("first plan", "first plan")
TAKEN_UP = Reason("taken up again", "taken up again")


def gone(vehicle: int, untaskable: str | None, *, is_lost: bool) -> Reason:
    """Return why an agent is not planned for any more; `untaskable` says why it cannot be tasked."""
    if is_lost:
        return Reason("agent lost", f"{_agent(vehicle)} lost")
    if untaskable is None:
        return Reason("agent not tracked", f"{_agent(vehicle)} is not tracked")
    return Reason("agent set aside", f"{_agent(vehicle)} {untaskable}")


def joined(vehicle: int) -> Reason:
    """Return that an agent is planned for from now on."""
    return Reason("agent joined", f"{_agent(vehicle)} joined")


def idle(vehicle: int) -> Reason:
    """Return that an agent has no route although a target needs one."""
    return Reason("agent idle", f"{_agent(vehicle)} has no route")


def in_danger(vehicle: int) -> Reason:
    """Return that an agent would hit an obstacle."""
    return Reason("agent in danger", f"{_agent(vehicle)} would hit an obstacle")


def passed(vehicle: int, target: Label) -> Reason:
    """Return that an agent passed its target without having reached it."""
    return Reason("agent passed its target", f"{_agent(vehicle)} passed target {target_name(target)}")


def appeared(target: Label) -> Reason:
    """Return that a target is newly confirmed."""
    return Reason("target appeared", f"target {target_name(target)} appeared")


def lost(target: Label) -> Reason:
    """Return that the target of a route is not confirmed any more."""
    return Reason("target lost", f"target {target_name(target)} is not tracked any more")


def moved(target: Label, moved_m: float) -> Reason:
    """Return how far a target is from the end of its route."""
    return Reason("target moved", f"target {target_name(target)} moved {moved_m:.0f} m")


def map_changed(news: str) -> Reason:
    """Return which no-fly zone was closed or opened."""
    return Reason("map changed", news)


def approved_changed(what: str) -> Reason:
    """Return why a plan that an operator confirmed cannot be flown as it was shown."""
    return Reason("approved plan changed", what)


def in_words(reasons: Iterable[Reason]) -> str:
    """Return all reasons as an operator reads them."""
    return "; ".join(reason.text for reason in reasons)


def kinds(reasons: Iterable[Reason]) -> tuple[Cause, ...]:
    """Return each kind once, in the order in which it is first named."""
    return tuple(dict.fromkeys(reason.cause for reason in reasons))


def _agent(vehicle: int) -> str:
    return f"agent {vehicle_name(vehicle)}"
