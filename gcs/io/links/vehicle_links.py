"""What command needs of the MAVLink links, wherever they are: in this process, or in bridges."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Protocol

from gcs.endpoints import Link
from gcs.io.clock import RunClock
from gcs.mavlink.frames.codec import FrameTable
from gcs.mavlink.frames.signing import SigningCounters
from gcs.mavlink.router.router import PortCounters
from gcs.model import NoticeCode, Parameter, Picture


class LinkHandler(Protocol):
    """Receives what the links deliver: command, or a bridge."""

    clock: RunClock

    def now_ns(self) -> int:
        """Run time."""

    def on_datagram(self, link: str, peer: str, frames: FrameTable) -> None:
        """Process a datagram from a vehicle, or one that was sent on to a vehicle."""

    def on_notice(self, subject: str, code: NoticeCode, /, **parameters: Parameter) -> None:
        """Process an operator notice about a link."""


class VehicleLinks(Protocol):
    """MAVLink links to vehicles and other ground stations."""

    links: tuple[Link, ...]

    def start(
        self,
        loop: asyncio.AbstractEventLoop,
        handler: LinkHandler,
        busy: Callable[[int], bool] = ...,
    ) -> None:
        """Start receiving; `busy` returns True during a mission transfer to a vehicle."""

    def send(self, link: str, peer: str, data: bytes) -> None:
        """Send to a peer of a link."""

    def picture(self, picture: Picture) -> None:
        """Set the newest picture of the targets."""

    def tick(self, t_ns: int) -> None:
        """Advance the timers."""

    def close(self, *, in_order: bool) -> None:
        """Release everything; `in_order` if the run has ended as it should, and not by an error."""

    def commander(self) -> str:
        """Return the name of another node that commands the vehicles now; empty if there is none."""

    def may_command(self) -> bool:
        """Return True if this node may send to the vehicles."""

    def ask_for_lease(self) -> None:
        """Ask for the right to send, when that is due."""

    def ground_stations(self, t_ns: int) -> dict[str, list[str]]:
        """Return the clients of each endpoint as "HOST:PORT (system/component, ...)"."""

    def counters(self) -> dict[str, PortCounters]:
        """Return the counters of the clients' endpoints, by name."""

    def unsent(self) -> dict[str, int]:
        """Return the number of sends that the system refused, by endpoint."""

    def is_keyed(self, link: str, vehicle: int | None = None) -> bool | None:
        """Return True if frames of a vehicle on a link must be signed; without a vehicle: of any system.

        None if that is not known yet.
        """

    def signing_counters(self) -> Mapping[str, SigningCounters]:
        """Return the counters of signatures, by link."""
