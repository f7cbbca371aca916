"""Control authority over one vehicle: why it gets no mission, which events change that, one table of both.

Reasons to leave a vehicle alone may overlap: a held vehicle may be landing, too. So each state but OURS is
a claim that begins and ends by itself. The authority is the highest claim; without one the vehicle is ours.
An event keeps the claims that it neither begins nor ends.

Claims by events (orders, other stations, audits, chosen modes) are recorded: `Claims`. Claims that telemetry
and mission show at any time (`DERIVED`) are computed when they are asked for: `Control` has both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import Final, Literal, Self, TypeAlias

AuthorityWord: TypeAlias = Literal[
    "ours",
    "held",
    "returning",
    "overridden",
    "landing",
    "other station",
    "unverified",
    "grounded",
    "rejecting",
    "unsupported",
    "landed",
    "down",
]
"""Authority over a vehicle, for operators; see `Authority`."""
Suspension: TypeAlias = Literal["hold", "return", "found"]
"""Why a vehicle is suspended: ordered to hold or to return, or found with a mission that is not ours."""


class Authority(IntEnum):
    """Who controls a vehicle, with the word and the reason for operators. A higher one prevails."""

    word: AuthorityWord
    reason: str
    """Why the vehicle gets no mission; `{}` is the mode, the ground station or the cause."""

    OURS = "ours", ""
    GROUNDED = "grounded", "stands where its take-off is not clear"
    REJECTING = "rejecting", "rejects its mission: {}"
    """Its navigator does; until the next attempt (`gcs.core.tasking.rejections`)."""
    COMMANDED = "overridden", "is commanded by {} and left alone"
    """By another ground station, to another mode; until its heartbeat shows the mode."""
    OTHER_MODE = "overridden", "is in {} and left alone"
    """In a mode other than AUTO and LOITER."""
    OVERRIDDEN = "overridden", "is in {} and left alone"
    """In a mode that a pilot, another station or a failsafe chose."""
    LANDING = "landing", "is landing and left alone"
    UNSUPPORTED = "unsupported", "has a firmware that is not known here"
    OTHER_STATION = "other station", "has a mission of {} and is left alone"
    UNVERIFIED = "unverified", "does not answer the download of its onboard mission"
    RESUMING = "ours", "is commanded to wait in LOITER"
    OTHER_MISSION = "other station", "flies another mission"
    """By an audit: it stores another mission than the last verified one."""
    SECOND_COMMANDER = "other station", "is commanded by another service with our ids"
    """It answers requests that this service did not send."""
    RETURNING = "returning", "returns by order"
    HELD = "held", "is held by order"
    LANDED = "landed", "has landed; `gcs order ready` makes it available again"
    DOWN = "down", "is down; `gcs order ready` makes it available again"

    def __new__(cls, word: AuthorityWord, reason: str) -> Self:
        """Number the members in their order."""
        member = int.__new__(cls, len(cls.__members__))
        member._value_ = len(cls.__members__)
        member.word = word
        member.reason = reason
        return member


SUSPENSIONS: Final[dict[Authority, Suspension]] = {
    Authority.HELD: "hold",
    Authority.RETURNING: "return",
    Authority.OTHER_MISSION: "found",
}
"""Claims that last until an order, and over a restart; at most one of them at a time."""


class ControlEvent(Enum):
    """Event that may change the control of a vehicle; the values are words for the documentation."""

    HOLD = "hold"
    RETURN = "return"
    RESUME = "resume"
    MODE_CHOSEN = "mode not commanded"
    AUTO_SEEN = "AUTO"
    WAITING_SEEN = "our LOITER"
    """LOITER that was commanded, before the first mission, or at the end of one."""
    STATION_COMMANDS = "foreign mode command"
    COMMAND_SETTLED = "mode shown"
    MISSION_COMPLETE = "mission complete"
    NO_MISSION_SEEN = "no valid mission"
    """LOITER is explained: the vehicle has no mission that it would fly."""
    MISSION_REJECTED = "mission rejected"
    NEXT_ATTEMPT = "next attempt"
    """After a changed parameter, or the end of a pause."""
    STATION_WRITES = "foreign upload"
    UPLOAD_VERIFIED = "upload verified"
    AUDIT_LATE = "audit unanswered"
    AUDIT_EQUAL = "audit equal"
    AUDIT_DIFFERENT = "audit different"
    COMMANDED_ELSEWHERE = "second commander"
    MISSION_LOST = "empty after reboot"
    REBOOT = "reboot"
    AGENT_LOST = "agent lost"
    TOUCHED_DOWN = "planned touchdown"
    CAME_DOWN = "touchdown elsewhere"
    AIRBORNE_AGAIN = "in the air again"
    READY = "ready"


_A = Authority
_E = ControlEvent
TRANSITIONS: Final[dict[Authority, tuple[ControlEvent, tuple[ControlEvent, ...]]]] = {
    _A.REJECTING: (_E.MISSION_REJECTED, (_E.RESUME, _E.NEXT_ATTEMPT, _E.UPLOAD_VERIFIED)),
    _A.COMMANDED: (_E.STATION_COMMANDS, (_E.RESUME, _E.COMMAND_SETTLED)),
    _A.OVERRIDDEN: (
        _E.MODE_CHOSEN,
        (_E.RESUME, _E.AUTO_SEEN, _E.WAITING_SEEN, _E.MISSION_COMPLETE, _E.NO_MISSION_SEEN),
    ),
    _A.OTHER_STATION: (_E.STATION_WRITES, (_E.RESUME, _E.UPLOAD_VERIFIED)),
    _A.UNVERIFIED: (_E.AUDIT_LATE, (_E.RESUME, _E.AUDIT_EQUAL, _E.AUDIT_DIFFERENT, _E.MISSION_LOST)),
    _A.OTHER_MISSION: (_E.AUDIT_DIFFERENT, (_E.HOLD, _E.RETURN, _E.RESUME)),
    _A.SECOND_COMMANDER: (_E.COMMANDED_ELSEWHERE, (_E.RESUME,)),
    _A.RETURNING: (_E.RETURN, (_E.HOLD, _E.RESUME, _E.AUDIT_DIFFERENT)),
    _A.HELD: (_E.HOLD, (_E.RETURN, _E.RESUME, _E.AUDIT_DIFFERENT)),
    _A.LANDED: (_E.TOUCHED_DOWN, (_E.READY, _E.AIRBORNE_AGAIN)),
    _A.DOWN: (_E.CAME_DOWN, (_E.READY, _E.AIRBORNE_AGAIN)),
}
"""The event that begins each recorded claim, and those that end it; `docs/orders.md` shows them."""
DERIVED: Final[dict[Authority, str]] = {
    _A.GROUNDED: "its take-off is not clear",
    _A.OTHER_MODE: "in neither AUTO nor LOITER",
    _A.LANDING: "on its final approach",
    _A.UNSUPPORTED: "its firmware is not known",
    _A.RESUMING: "commanded to LOITER by an order to resume",
}
"""Claims that hold while their condition does; in words for the documentation."""
_BEGUN: Final = {
    event: tuple(claim for claim, (begins, _) in TRANSITIONS.items() if event is begins)
    for event in ControlEvent
}
_ENDED: Final = {
    event: tuple(claim for claim, (_, ends) in TRANSITIONS.items() if event in ends) for event in ControlEvent
}


@dataclass(frozen=True, slots=True)
class Claim:
    """Claim to a vehicle."""

    since_t_ns: int | None
    """None for a derived claim."""
    detail: str = ""
    """Mode, ground station or cause that the reason names."""


@dataclass(frozen=True, slots=True)
class Control:
    """Control of one vehicle: all claims to it at one time."""

    claims: Mapping[Authority, Claim] = field(default_factory=dict)

    @property
    def authority(self) -> Authority:
        """Who controls the vehicle."""
        return max(self.claims, default=Authority.OURS)

    @property
    def is_ours(self) -> bool:
        """True if no other controls the vehicle; it may still get no mission."""
        return self.authority <= Authority.REJECTING

    @property
    def reason(self) -> str:
        """Why the vehicle gets no mission, in words; empty if it is ours."""
        authority = self.authority
        return authority.reason.format(self.detail(authority))

    @property
    def suspension(self) -> Suspension | None:
        """Why the vehicle is suspended until an order; None if it is not."""
        return next((word for claim, word in SUSPENSIONS.items() if claim in self.claims), None)

    def detail(self, authority: Authority) -> str:
        """Return the mode, ground station or cause of a claim; empty without the claim."""
        claim = self.claims.get(authority)
        return "" if claim is None else claim.detail


@dataclass(slots=True)
class Claims:
    """Recorded claims to one vehicle."""

    begun: dict[Authority, Claim] = field(default_factory=dict)

    def __contains__(self, authority: Authority) -> bool:
        """Return True if a claim goes on."""
        return authority in self.begun

    def detail(self, authority: Authority) -> str:
        """Return the mode, ground station or cause of a claim; empty without the claim."""
        return Control(self.begun).detail(authority)

    def since_t_ns(self, authority: Authority) -> int | None:
        """Return when a claim began; None without it."""
        claim = self.begun.get(authority)
        return None if claim is None else claim.since_t_ns

    def apply(self, event: ControlEvent, t_ns: int, detail: str = "") -> None:
        """Process an event; a claim that goes on keeps its time."""
        for authority in _ENDED[event]:
            self.begun.pop(authority, None)
        for authority in _BEGUN[event]:
            self.begin(authority, t_ns, detail)

    def begin(self, authority: Authority, t_ns: int, detail: str) -> None:
        """Begin a claim; one that goes on keeps its time."""
        claim = self.begun.get(authority)
        if claim is None or claim.detail != detail:
            self.begun[authority] = Claim(t_ns, detail)
