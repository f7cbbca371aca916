"""A short visit to the vehicles: links open, conversations with each, links closed again.

For commands that are no service: `gcs preflight`, `gcs fence` and `gcs param`. While it lasts
heartbeats go out, as from any ground station; nothing is sent to a vehicle that has not been heard.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Sequence
from typing import Protocol

from gcs.config import Config
from gcs.io.clock import RunClock
from gcs.io.links.manager import Links
from gcs.io.signing.gate import Signing
from gcs.io.vehicles.access import entrance_of
from gcs.mavlink.fleet.fleet import Fleet, FleetSettings
from gcs.mavlink.frames.codec import Message
from gcs.model import NS_PER_S, Datagram, Level, system_of

_TICK_S = 0.05


class Talk(Protocol):
    """A conversation with one vehicle."""

    vehicle: int

    @property
    def is_done(self) -> bool:
        """Whether it has ended."""

    def poll(self, t_ns: int) -> list[bytes]:
        """Let time pass; returns frames to send."""

    def receive(self, message: Message, t_ns: int) -> list[bytes]:
        """Take a message of the vehicle; returns frames to send."""


class VehicleSession:
    """The links of a mission file, or those of its running service, and the vehicles there.

    Parameters
    ----------
    source : str
        The mission file: its keys lie beside it.
    link : str or None
        Where to look instead, such as another ground station's forward endpoint.
    writes : bool
        True if something on the vehicles is to be changed.

    Raises
    ------
    ConfigError, LinkError
        When the keys cannot be used, or an endpoint cannot be had.
    """

    def __init__(
        self,
        config: Config,
        source: str,
        also: Iterable[int] = (),
        link: str | None = None,
        *,
        writes: bool = False,
    ) -> None:
        vehicles = [agent.vehicle for agent in config.agents]
        self.entrance = entrance_of(config, link, writes=writes)
        links, is_direct = self.entrance.links, link is None and self.entrance.service is None
        self.clock = RunClock()
        self.fleet = Fleet(
            vehicles,
            config.local_frame,
            FleetSettings(position_rate_hz=config.telemetry.rate_hz),
            links=links,
            own=self.entrance.own,
            extra_ids=also,
            kernel=False,  # a visit is short: it would take longer to load
        )
        signing = Signing(links, config.links.key_file(source) if is_direct else None)
        self.links = Links(links, vehicles, config.local_frame, signing)
        self.news: list[tuple[str, Level, str]] = []
        self._talks: dict[int, Talk] = {}

    async def run(
        self,
        talks: Sequence[Talk],
        wait_s: float,
        shown: Callable[[], None] = lambda: None,
        enough: Callable[[], bool] = lambda: True,
    ) -> None:
        """Talk until all have ended and it is `enough`, or for `wait_s`; `shown` is called now and then."""
        self._talks = {talk.vehicle: talk for talk in talks}
        loop = asyncio.get_running_loop()
        self.links.start(loop, self)
        end_t_ns = self.now_ns() + int(wait_s * NS_PER_S)
        try:
            while self.now_ns() < end_t_ns:
                self._poll()
                shown()
                if all(talk.is_done for talk in talks) and enough():
                    return
                await asyncio.sleep(_TICK_S)
        finally:
            self.links.close()

    def _poll(self) -> None:
        t_ns = self.now_ns()
        for send in self.fleet.poll(t_ns):
            self.links.send(send.link, send.peer, send.data)
        self.fleet.notices()
        for vehicle, talk in self._talks.items():
            if self.fleet.link(vehicle):
                self._send(vehicle, talk.poll(t_ns))

    def _send(self, vehicle: int, frames: Iterable[bytes]) -> None:
        for send in self.fleet.address_frames(vehicle, frames):
            self.links.send(send.link, send.peer, send.data)

    def has_key(self, vehicle: int) -> bool:
        """Return True if there is a signing key for a vehicle here, or the service between us may have it."""
        if self.entrance.service is not None:
            return True
        return self.links.signing.gate.is_keyed(self.fleet.link(vehicle), system_of(vehicle))

    # ------------------------------------------------------------ as `gcs.io.links.manager.Taker`

    def now_ns(self) -> int:
        """Wall time."""
        return self.clock.now_ns()

    def on_datagram(self, link: str, peer: str, data: bytes) -> None:
        """Take what came."""
        t_ns = self.now_ns()
        for vehicle, message in self.fleet.receive(Datagram(t_ns, link, peer, data)):
            talk = self._talks.get(vehicle)
            if talk is not None:
                self._send(vehicle, talk.receive(message, t_ns))

    def on_link_news(self, link: str, level: Level, text: str) -> None:
        """Keep what there is to say of a link."""
        self.news.append((link, level, text))
