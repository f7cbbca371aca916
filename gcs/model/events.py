"""Events: what the engine receives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from gcs.model.notices import Notice
from gcs.model.orders import Order
from gcs.model.sensors import Scan
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
    """Passage of time; it drives every timer of the engine."""

    t_ns: int


@dataclass(frozen=True, slots=True)
class BadInput:
    """Input that could not be decoded; it is counted and shown, never raised."""

    t_ns: int
    source: str
    problem: str
    sensor: str = ""
    """Name of the sensor that sent it; empty for other input."""

    def __post_init__(self) -> None:
        """Make what came from outside safe to show."""
        object.__setattr__(self, "source", printable(self.source))
        object.__setattr__(self, "problem", printable(self.problem))
        object.__setattr__(self, "sensor", printable(self.sensor))


@dataclass(frozen=True, slots=True)
class LinkNews:
    """Change of a MAVLink link: lost, restored, or a sender refused."""

    notice: Notice
    """About the link; shown as it is."""

    @property
    def t_ns(self) -> int:
        """Time of the change."""
        return self.notice.t_ns


@dataclass(frozen=True, slots=True)
class ClockStep:
    """Step of the machine's wall clock; run time is monotonic, sensors' times may have stepped too."""

    t_ns: int
    step_ns: int
    """Step of the wall clock, positive forward."""


@dataclass(frozen=True, slots=True)
class Resumed:
    """Restart of the service: its state is that of the one before."""

    t_ns: int
    saved_t_ns: int
    """Time of that state."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """State of the decision core before the next event; no event itself."""

    t_ns: int
    data: bytes
    """The state as `gcs.core.snapshot` encodes it."""


Event: TypeAlias = Datagram | Scan | Tick | BadInput | LinkNews | ClockStep | Order | Resumed
