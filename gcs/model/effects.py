"""What comes out of the fold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from gcs.model.basics import Label, Level
from gcs.model.orders import OrderAnswer, Proposal
from gcs.model.picture import Picture
from gcs.model.plans import Plan
from gcs.safe_text import printable


@dataclass(frozen=True, slots=True)
class Send:
    """Bytes for a peer of a link."""

    link: str
    peer: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Upload:
    """A mission that another program is to upload; `UploadAnswer` says how that went."""

    vehicle: int
    mission_id: int
    frames: bytes
    """MISSION_ITEM_INT frames, in order, one behind the other."""


@dataclass(frozen=True, slots=True)
class UploadReport:
    """How one mission transfer ended."""

    t_ns: int
    vehicle: int
    mission_id: int
    items: int
    ok: bool
    detail: str
    """Why it failed, or how it went: "verified by read-back"."""
    duration_s: float
    retries: int

    def __post_init__(self) -> None:
        """Make the detail safe to show."""
        object.__setattr__(self, "detail", printable(self.detail))


@dataclass(frozen=True, slots=True)
class Notice:
    """Something an operator should know."""

    t_ns: int
    level: Level
    text: str
    """Of printable characters alone, whatever a vehicle or another ground station said."""
    vehicle: int | None = None

    def __post_init__(self) -> None:
        """Make the text safe to show."""
        object.__setattr__(self, "text", printable(self.text))


@dataclass(frozen=True, slots=True)
class AgentStatus:
    """What became of an agent, as central command sees it from measurements."""

    t_ns: int
    vehicle: int
    fate: Literal["flying", "arrived", "dead"]
    target: Label | None = None
    position_m: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class MissionEnded:
    """Every agent has arrived, is dead, or is left over when every target has what it needs."""

    t_ns: int
    arrived: tuple[int, ...]
    dead: tuple[int, ...]
    spare: tuple[int, ...] = ()


Effect: TypeAlias = (
    Send
    | Upload
    | Picture
    | Plan
    | UploadReport
    | Notice
    | AgentStatus
    | MissionEnded
    | OrderAnswer
    | Proposal
)
