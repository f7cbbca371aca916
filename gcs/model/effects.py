"""Effects: what the engine returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from gcs.model.basics import Label
from gcs.model.notices import Notice
from gcs.model.orders import OrderAnswer, Proposal
from gcs.model.picture import LaggedPicture, Picture
from gcs.model.plans import Plan
from gcs.model.status import SwarmStatus
from gcs.safe_text import printable


@dataclass(frozen=True, slots=True)
class Send:
    """Bytes for a peer of a link."""

    link: str
    peer: str
    data: bytes


@dataclass(frozen=True, slots=True)
class UploadReport:
    """Result of one mission upload."""

    t_ns: int
    vehicle: int
    mission_id: int
    items: int
    ok: bool
    detail: str
    """Why the upload failed, or how it was verified."""
    duration_s: float
    retries: int

    def __post_init__(self) -> None:
        """Make the detail safe to show."""
        object.__setattr__(self, "detail", printable(self.detail))


AgentStatusWord: TypeAlias = Literal["active", "arrived", "lost", "down"]
"""Status of an agent; down: its vehicle came to the ground elsewhere than by a planned landing."""


@dataclass(frozen=True, slots=True)
class AgentStatus:
    """Status of an agent, estimated from tracks and reports."""

    t_ns: int
    vehicle: int
    status: AgentStatusWord
    target: Label | None = None
    """Target that it has reached."""
    position_m: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class MissionEnded:
    """Every target has the agents that it needs, or no agent is left that could fly to one."""

    t_ns: int
    arrived: tuple[int, ...]
    lost: tuple[int, ...]
    surplus: tuple[int, ...] = ()
    down: tuple[int, ...] = ()


Effect: TypeAlias = (
    Send
    | Picture
    | LaggedPicture
    | Plan
    | UploadReport
    | Notice
    | AgentStatus
    | MissionEnded
    | OrderAnswer
    | Proposal
    | SwarmStatus
)
