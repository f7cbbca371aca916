"""Words of the replanning triggers: each with its kind for counts, and its text for operators."""

from __future__ import annotations

from typing import Final, NamedTuple

from gcs.model import Cause, Label, target_name, vehicle_name


class Reason(NamedTuple):
    """One trigger of a plan."""

    cause: Cause
    text: str


URGENT: Final[frozenset[Cause]] = frozenset(
    (
        "map changed",
        "operator order",
        "agent set aside",
        "agent unfit",
        "agent joined",
        "agent in danger",
        "approved plan changed",
    )
)
"""Kinds that replace a proposal before an operator had the time to read it."""


def of_agent(cause: Cause, vehicle: int, what: str) -> Reason:
    """Return a trigger about an agent."""
    return Reason(cause, f"agent {vehicle_name(vehicle)} {what}")


def occupied(vehicle: int) -> Reason:
    """Return that a vehicle needs another altitude layer."""
    return of_agent("layer occupied", vehicle, "would meet another vehicle in its altitude layer")


def of_target(cause: Cause, target: Label, what: str) -> Reason:
    """Return a trigger about a target."""
    return Reason(cause, f"target {target_name(target)} {what}")


def agent_gone(vehicle: int, untaskable: str | None, *, is_lost: bool, is_down: bool = False) -> Reason:
    """Return why an agent is not planned for any more; `untaskable` is why it must not be tasked."""
    if is_lost:
        return of_agent("agent lost", vehicle, "lost")
    if is_down:
        return of_agent("agent down", vehicle, "down")
    if untaskable is None:
        return of_agent("agent not tracked", vehicle, "is not tracked")
    return of_agent("agent set aside", vehicle, untaskable)
