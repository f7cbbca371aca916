"""A short session with vehicles for one-off commands: links open, one task per vehicle, links closed.

Heartbeats are sent meanwhile, as by any ground station. Nothing is sent to a vehicle that was not heard.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, Protocol

from gcs.config import Config
from gcs.geo import LocalFrame
from gcs.io.clock import RunClock
from gcs.io.links.manager import Links
from gcs.io.signing.link_signing import LinkSigning
from gcs.io.vehicles.vehicle_access import VehicleAccess, vehicle_access
from gcs.mavlink.fleet.fleet import Fleet, FleetSettings
from gcs.mavlink.frames.codec import FrameTable, Message
from gcs.model import NS_PER_S, Datagram, Notice, NoticeCode, Parameter, system_of

_TICK_S = 0.05
NOT_HEARD: Final = "not heard: is it on, with this system id, and sending to this machine?"
"""Result for a vehicle that did not report."""


class VehicleTask(Protocol):
    """Exchange with one vehicle."""

    vehicle: int

    @property
    def is_done(self) -> bool:
        """True if it has ended."""

    def poll(self, t_ns: int) -> list[bytes]:
        """Advance the timers; return the frames to send."""

    def receive(self, message: Message, t_ns: int) -> list[bytes]:
        """Process a message of the vehicle; return the frames to send."""


class VehicleSession:
    """Links to vehicles, and the vehicles there.

    Parameters
    ----------
    vehicles : iterable of int
    frame : LocalFrame
        Frame of their positions.
    access : VehicleAccess
        Links to them, and our ids there.
    extra_ids : iterable of int
        Message ids that the tasks need besides the fleet's.
    keys : Path, optional
        Key file of the links.
    position_rate_hz : float, optional
        Rate of their position reports.

    Raises
    ------
    ConfigError, LinkError
        The keys cannot be used, or an endpoint cannot be opened.
    """

    def __init__(
        self,
        vehicles: Iterable[int],
        frame: LocalFrame,
        access: VehicleAccess,
        extra_ids: Iterable[int] = (),
        keys: Path | None = None,
        position_rate_hz: float | None = None,
    ) -> None:
        vehicles = list(vehicles)
        links = access.links
        self.access = access
        self.clock = RunClock()
        settings = FleetSettings(extra_ids=tuple(extra_ids))
        if position_rate_hz is not None:
            settings = replace(settings, position_rate_hz=position_rate_hz)
        self.fleet = Fleet(
            vehicles,
            frame,
            settings,
            links=links,
            own=access.own,
            kernel=False,  # a session is shorter than the loading of kernels
        )
        signing = LinkSigning(links, keys)
        self.links = Links(links, vehicles, frame, signing)
        self.notices: list[Notice] = []
        self._tasks: dict[int, VehicleTask] = {}

    @classmethod
    def of_mission(
        cls,
        config: Config,
        source: str,
        extra_ids: Iterable[int] = (),
        link: str | None = None,
        *,
        writes: bool = False,
    ) -> VehicleSession:
        """Return a session over the links of a mission file, or through its running service.

        Parameters
        ----------
        source : str
            Path of the mission file, for its key file.
        link : str or None
            Endpoint to use instead, such as another ground station's forward endpoint.
        writes : bool
            True if something on the vehicles is to be changed.

        Raises
        ------
        ConfigError, LinkError
            The keys cannot be used, or an endpoint cannot be opened.
        """
        access = vehicle_access(config, link, writes=writes)
        is_direct = link is None and access.service is None
        return cls(
            [agent.vehicle for agent in config.agents],
            config.local_frame,
            access,
            extra_ids,
            config.links.key_file(source) if is_direct else None,
            config.telemetry.rate_hz,
        )

    async def run(
        self,
        tasks: Sequence[VehicleTask],
        wait_s: float,
        shown: Callable[[], None] = lambda: None,
        enough: Callable[[], bool] = lambda: True,
    ) -> None:
        """Run until all tasks have ended and `enough` returns True, or for `wait_s`.

        `shown` is called at each tick.
        """
        self._tasks = {task.vehicle: task for task in tasks}
        loop = asyncio.get_running_loop()
        self.links.start(loop, self)
        end_t_ns = self.now_ns() + int(wait_s * NS_PER_S)
        try:
            while self.now_ns() < end_t_ns:
                self._poll()
                shown()
                if all(task.is_done for task in tasks) and enough():
                    return
                await asyncio.sleep(_TICK_S)
        finally:
            self.links.close()

    def _poll(self) -> None:
        t_ns = self.now_ns()
        for send in self.fleet.poll(t_ns):
            self.links.send(send.link, send.peer, send.data)
        self.fleet.notices()
        for vehicle, task in self._tasks.items():
            if self.fleet.link(vehicle):
                self._send(vehicle, task.poll(t_ns))

    def _send(self, vehicle: int, frames: Iterable[bytes]) -> None:
        for send in self.fleet.address_frames(vehicle, frames):
            self.links.send(send.link, send.peer, send.data)

    def has_key(self, vehicle: int) -> bool:
        """Return True if a vehicle has a signing key here, or a service in between may have it."""
        if self.access.service is not None:
            return True
        return self.links.signing.gate.is_keyed(self.fleet.link(vehicle), system_of(vehicle))

    # ------------------------------------------------------------ as `gcs.io.links.manager.LinkHandler`

    def now_ns(self) -> int:
        """Return the run time."""
        return self.clock.now_ns()

    def on_datagram(self, link: str, peer: str, frames: FrameTable) -> None:
        """Process a datagram."""
        t_ns = self.now_ns()
        for vehicle, message in self.fleet.receive(Datagram(t_ns, link, peer, frames.data), frames):
            task = self._tasks.get(vehicle)
            if task is not None:
                self._send(vehicle, task.receive(message, t_ns))

    def on_notice(self, subject: str, code: NoticeCode, /, **parameters: Parameter) -> None:
        """Keep a notice about a link."""
        self.notices.append(Notice(self.now_ns(), code, subject, parameters))
