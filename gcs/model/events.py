"""What goes into the fold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from gcs.model.basics import Level
from gcs.model.memory import PersistedState
from gcs.model.orders import Order
from gcs.model.scans import Scan
from gcs.safe_text import printable


@dataclass(frozen=True, slots=True)
class Datagram:
    """Bytes that arrived on a link. `peer` is the sender as the link writes it ("127.0.0.1:50000")."""

    t_ns: int
    link: str
    peer: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Tick:
    """Time passed. Every timer of the fold is driven by it."""

    t_ns: int


@dataclass(frozen=True, slots=True)
class BadInput:
    """Something arrived at the edge that could not be read; it is counted and shown, never raised."""

    t_ns: int
    source: str
    problem: str
    sensor: str = ""
    """Name of the sensor whose scan it was; empty for other input."""

    def __post_init__(self) -> None:
        """Make what came from outside safe to show."""
        object.__setattr__(self, "source", printable(self.source))
        object.__setattr__(self, "problem", printable(self.problem))
        object.__setattr__(self, "sensor", printable(self.sensor))


@dataclass(frozen=True, slots=True)
class LinkNews:
    """What the edge has to say of a MAVLink link: lost, there again, somebody kept out."""

    t_ns: int
    link: str
    level: Level
    text: str

    def __post_init__(self) -> None:
        """Make what came from outside safe to show."""
        object.__setattr__(self, "link", printable(self.link))
        object.__setattr__(self, "text", printable(self.text))


@dataclass(frozen=True, slots=True)
class ClockStep:
    """The machine's wall clock was set. Run time is monotonic and goes on; sensors' times may have moved."""

    t_ns: int
    step_ns: int
    """How far the wall clock was moved forward; negative when back."""


@dataclass(frozen=True, slots=True)
class UploadAnswer:
    """What the program that uploads in our place says of one `Upload`."""

    t_ns: int
    vehicle: int
    mission_id: int
    ok: bool
    begun: bool
    """Whether the vehicle may have begun to change what it stores."""
    detail: str

    def __post_init__(self) -> None:
        """Make what came from outside safe to show."""
        object.__setattr__(self, "detail", printable(self.detail))


@dataclass(frozen=True, slots=True)
class Resumed:
    """The service was started anew and takes up where an earlier one was."""

    t_ns: int
    memory: PersistedState


Event: TypeAlias = Datagram | Scan | Tick | BadInput | LinkNews | ClockStep | Order | UploadAnswer | Resumed
