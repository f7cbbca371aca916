"""Vocabulary of an upload: stages, events, choices, and what the vehicle stores at its end.

`gcs.mavlink.mission.upload_rules` says what follows on what.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from gcs.mavlink.mission.items import Item


class Stage(StrEnum):
    """Stage of an upload.

    new         Before the begin.
    park        LOITER is commanded, before an upload or before a selection.
    upload      The vehicle requests the items.
    verify      The onboard list is read back.
    select      The first item is selected.
    mode        AUTO is commanded.
    diagnose    A PX4 is in Hold: MISSION_CURRENT tells a rejected mission from a mode that was chosen.
    hold        LOITER is commanded, before clearing.
    clear       The onboard list is removed, and its absence read back.
    done        After the end.
    """

    NEW = "new"
    PARK = "park"
    UPLOAD = "upload"
    VERIFY = "verify"
    SELECT = "select"
    MODE = "mode"
    DIAGNOSE = "diagnose"
    HOLD = "hold"
    CLEAR = "clear"
    DONE = "done"


class Choice(StrEnum):
    """Branch between two stages, without a wait.

    compare     Is the list that is read back complete, and equal?
    retry       May the list be uploaded again?
    remove      Must the onboard mission be removed?
    resume      Does a vehicle in LOITER fly its old mission again?
    activate    May the vehicle fly its stored mission?
    overridden  What does a vehicle store that others control now?
    """

    COMPARE = "compare"
    RETRY = "retry"
    REMOVE = "remove"
    RESUME = "resume"
    ACTIVATE = "activate"
    OVERRIDDEN = "overridden"


class Event(StrEnum):
    """What happens to an upload.

    Orders:

    start            Upload the list.
    download         Only read it.
    start clearing   Remove a mission that may be inconsistent.
    abandon          The vehicle goes to LOITER: nothing is started.
    stop             It goes to another mode, or gets a newer mission: nothing that could undo it is sent.
    yield            Another service with our ids commands it: nothing is started, and no mission is left that
                     must not be flown.
    reboot           The vehicle has rebooted.
    restart          This service had an outage.

    Messages of the vehicle have their MAVLink names. Any message or tick is

    override         while a pilot, a failsafe or another station controls the vehicle.

    Time, each tick: the first wait that is over.

    in AUTO          Before any other: the vehicle is in AUTO, and will take its next item.
    overtime         All uploads and read-backs together take too long.
    failed           No request has followed a failure ACK.
    overdue          The next request, or the ACK after the last item, does not come.
    stalled          A transfer goes on without a further item.
    unanswered       The tries of the stage's request are used up.
    tick             None is over.
    """

    START = "start"
    DOWNLOAD = "download"
    START_CLEARING = "start clearing"
    ABANDON = "abandon"
    STOP = "stop"
    YIELD = "yield"
    REBOOT = "reboot"
    RESTART = "restart"
    OVERRIDE = "override"
    HEARTBEAT = "HEARTBEAT"
    MISSION_REQUEST = "MISSION_REQUEST"
    MISSION_ACK = "MISSION_ACK"
    MISSION_COUNT = "MISSION_COUNT"
    MISSION_ITEM = "MISSION_ITEM"
    MISSION_CURRENT = "MISSION_CURRENT"
    COMMAND_ACK = "COMMAND_ACK"
    IN_AUTO = "in AUTO"
    OVERTIME = "overtime"
    FAILED = "failed"
    OVERDUE = "overdue"
    STALLED = "stalled"
    UNANSWERED = "unanswered"
    TICK = "tick"


class RuleError(AssertionError):
    """An event for which the table has no rule: a programming error, which ends the upload as failed."""

    def __init__(self, source: Stage | Choice, event: Event | None) -> None:
        super().__init__(f"no rule for {event or 'the choice'} in {source}")


class OnboardState(StrEnum):
    """Onboard mission, as far as known."""

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
    """Result of an upload."""

    t_ns: int
    ok: bool
    """True if the list is stored and verified, and a mission is flown."""
    onboard: OnboardState
    detail: str
    duration_s: float
    retries: int
    was_held: bool
    """True if the vehicle was put into LOITER. It then flies its mission only if `ok`."""
    selected: bool
    """True if the vehicle flies its stored mission. Before its first item is selected it flies an item of the
    mission before, and counts on from that number."""
    items: tuple[Item, ...] | None
    """Onboard items by the last read-back; None if they are unknown."""
