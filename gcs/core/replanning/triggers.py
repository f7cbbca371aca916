"""Why plans are made: each reason in an operator's words, with its kind for pictures and counts."""

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
"""Reasons that do not wait until an operator could read the plan before."""
FIRST_PLAN = Reason("first plan", "first plan")
TAKEN_UP = Reason("taken up again", "taken up again")


def gone(vehicle: int, untaskable: str | None, *, is_lost: bool) -> Reason:
    """Tell why an agent is not planned for any more; `untaskable`: why not, if it cannot be tasked."""
    if is_lost:
        return Reason("agent lost", f"{_agent(vehicle)} lost")
    if untaskable is None:
        return Reason("agent not tracked", f"{_agent(vehicle)} is not tracked")
    return Reason("agent set aside", f"{_agent(vehicle)} {untaskable}")


def joined(vehicle: int) -> Reason:
    """Tell that an agent is planned for from now on."""
    return Reason("agent joined", f"{_agent(vehicle)} joined")


def idle(vehicle: int) -> Reason:
    """Tell that an agent has no route although there are targets to spare."""
    return Reason("agent idle", f"{_agent(vehicle)} has no route")


def in_danger(vehicle: int) -> Reason:
    """Tell that an agent would fly into something."""
    return Reason("agent in danger", f"{_agent(vehicle)} would hit an obstacle")


def passed(vehicle: int, target: Label) -> Reason:
    """Tell that an agent passed its target, and was not seen to reach it."""
    return Reason("agent passed its target", f"{_agent(vehicle)} passed target {target_name(target)}")


def appeared(target: Label) -> Reason:
    """Tell that a target is believed that was not before."""
    return Reason("target appeared", f"target {target_name(target)} appeared")


def lost(target: Label) -> Reason:
    """Tell that a target that somebody flies to is not believed any more."""
    return Reason("target lost", f"target {target_name(target)} is not tracked any more")


def moved(target: Label, moved_m: float) -> Reason:
    """Tell how far a target is from where its route ends."""
    return Reason("target moved", f"target {target_name(target)} moved {moved_m:.0f} m")


def map_changed(news: str) -> Reason:
    """Tell what was closed or opened, in words."""
    return Reason("map changed", news)


def approved_changed(what: str) -> Reason:
    """Tell why a plan that an operator confirmed is not the one that would be flown now."""
    return Reason("approved plan changed", what)


def in_words(reasons: Iterable[Reason]) -> str:
    """Return all reasons as an operator reads them."""
    return "; ".join(reason.text for reason in reasons)


def kinds(reasons: Iterable[Reason]) -> tuple[Cause, ...]:
    """Return each kind once, in the order in which it is first named."""
    return tuple(dict.fromkeys(reason.cause for reason in reasons))


def _agent(vehicle: int) -> str:
    return f"agent {vehicle_name(vehicle)}"
