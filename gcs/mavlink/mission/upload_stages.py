"""Stages, transitions and results of a mission upload."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final


class Stage(StrEnum):
    """Stage of an upload."""

    NEW = "new"
    PARK = "park"
    """LOITER is commanded, before an upload or before a selection."""
    UPLOAD = "upload"
    VERIFY = "verify"
    """The onboard mission is read back."""
    SELECT = "select"
    """The first item is selected."""
    MODE = "mode"
    """AUTO is commanded."""
    HOLD = "hold"
    """LOITER is commanded, before clearing."""
    CLEAR = "clear"
    """The onboard mission is removed, and its absence read back."""
    DONE = "done"


TRANSITIONS: Final[Mapping[Stage, frozenset[Stage]]] = {
    stage: frozenset(following)
    for stage, following in {
        Stage.NEW: (Stage.PARK, Stage.UPLOAD, Stage.HOLD, Stage.CLEAR, Stage.DONE),
        Stage.PARK: (Stage.UPLOAD, Stage.SELECT, Stage.DONE),
        Stage.UPLOAD: (Stage.UPLOAD, Stage.VERIFY, Stage.MODE, Stage.HOLD, Stage.CLEAR, Stage.DONE),
        Stage.VERIFY: (
            Stage.PARK,
            Stage.UPLOAD,
            Stage.VERIFY,
            Stage.SELECT,
            Stage.MODE,
            Stage.HOLD,
            Stage.CLEAR,
            Stage.DONE,
        ),
        Stage.SELECT: (
            Stage.PARK,
            Stage.UPLOAD,
            Stage.VERIFY,
            Stage.MODE,
            Stage.HOLD,
            Stage.CLEAR,
            Stage.DONE,
        ),
        Stage.MODE: (Stage.UPLOAD, Stage.VERIFY, Stage.HOLD, Stage.CLEAR, Stage.DONE),
        Stage.HOLD: (Stage.HOLD, Stage.CLEAR, Stage.DONE),
        Stage.CLEAR: (Stage.HOLD, Stage.CLEAR, Stage.DONE),
        Stage.DONE: (),
    }.items()
}
"""Stages that may follow each stage; `docs/missions.md` shows them with their conditions."""


LIST_TRANSITIONS: Final[Mapping[Stage, frozenset[Stage]]] = {
    Stage.NEW: frozenset((Stage.CLEAR, Stage.UPLOAD, Stage.VERIFY)),
    Stage.CLEAR: frozenset((Stage.CLEAR, Stage.VERIFY, Stage.DONE)),
    Stage.UPLOAD: frozenset((Stage.UPLOAD, Stage.VERIFY, Stage.DONE)),
    Stage.VERIFY: frozenset((Stage.CLEAR, Stage.UPLOAD, Stage.DONE)),
    Stage.DONE: frozenset(),
}
"""The same for fences and rally points, which need no change of mode."""


class TransitionError(AssertionError):
    """A transition that the table does not have: a programming error.

    `gcs.core.tasking.active_uploads` ends such an upload with an alarm, `gcs.mavlink.mission.list_task` as
    failed.
    """

    def __init__(self, before: Stage, after: Stage) -> None:
        super().__init__(f"{before} to {after}")


class OnboardState(StrEnum):
    """Onboard mission at the end of an upload."""

    EQUAL = "equal"
    """The uploaded mission, read back."""
    OLD = "old"
    """The mission before."""
    WHOLE = "whole"
    """One of the two."""
    CLEARED = "cleared"
    """None."""
    UNKNOWN = "unknown"
    """Possibly inconsistent, unless uploads are atomic."""


@dataclass(frozen=True, slots=True)
class UploadResult:
    """Result of a mission upload."""

    t_ns: int
    ok: bool
    """True if the mission is stored, verified and being flown."""
    onboard: OnboardState
    detail: str
    duration_s: float
    retries: int
    was_held: bool
    """True if the vehicle was put into LOITER. It then flies its mission only if `ok`."""
    selected: bool
    """True if the vehicle flies its stored mission. Before its first item is selected it flies an item of the
    mission before, and counts on from that number."""
