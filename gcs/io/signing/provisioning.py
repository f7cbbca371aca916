"""Signing keys to vehicles over an endpoint: `gcs keys install` and `gcs keys rotate`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from gcs.endpoints import Endpoint
from gcs.io.clock import RunClock, unix_ns
from gcs.io.links.manager import TRANSPORTS
from gcs.io.signing.keystore import TimeFile
from gcs.mavlink.fleet.heartbeat import HEARTBEAT_PERIOD_NS, heartbeat
from gcs.mavlink.frames.codec import Encoder, scan
from gcs.mavlink.frames.signing import timestamp_of
from gcs.mavlink.services.signing_setup import SigningSetup
from gcs.model import NS_PER_S, Notice, NoticeCode, Parameter, system_of

_TICK_S: Final = 0.05


@dataclass(frozen=True, slots=True)
class KeyInstallation:
    """One vehicle's new key, and the key that it has as far as known."""

    vehicle: int
    key: bytes
    old: bytes | None


@dataclass(frozen=True, slots=True)
class Result:
    """Result for one vehicle."""

    vehicle: int
    ok: bool
    detail: str
    sent: bool
    """True if the key was sent: the vehicle may have it, with any answer."""


def install(
    endpoint: Endpoint,
    wanted: Sequence[KeyInstallation],
    times: TimeFile,
    timeout_s: float,
    on_result: Callable[[Result], None],
    news: Callable[[str], None],
) -> None:
    """Install keys on all vehicles at once; `on_result` takes each result.

    Raises
    ------
    LinkError
        The endpoint cannot be opened.
    ConfigError, OSError
        The signing time cannot be read or saved.
    """
    asyncio.run(_Run(endpoint, wanted, times, on_result, news).run(timeout_s))


class _Run:
    """One open endpoint; the listener of its transport."""

    def __init__(
        self,
        endpoint: Endpoint,
        wanted: Sequence[KeyInstallation],
        times: TimeFile,
        on_result: Callable[[Result], None],
        news: Callable[[str], None],
    ) -> None:
        self._endpoint = endpoint
        self._wanted = wanted
        self._times = times
        self._on_result = on_result
        self._news = news
        self._time, self._streams = times.read(unix_ns())
        self._pending: dict[int, SigningSetup] = {}
        self._peers: dict[int, str] = {}
        self._encode = Encoder()

    async def run(self, timeout_s: float) -> None:
        transport = TRANSPORTS[self._endpoint.kind](self._endpoint)
        transport.start(asyncio.get_running_loop(), self)
        try:
            clock = RunClock()
            end_ns = clock.now_ns() + int(timeout_s * NS_PER_S)
            self._pending = {
                one.vehicle: SigningSetup(system_of(one.vehicle), one.key, one.old, self._next_time, end_ns)
                for one in self._wanted
            }
            beat_ns = 0
            while self._pending:
                t_ns = clock.now_ns()
                if t_ns - beat_ns >= HEARTBEAT_PERIOD_NS:
                    beat_ns = t_ns
                    for peer in {self._endpoint.remote, *self._peers.values()} - {""}:
                        transport.send(peer, self._encode(heartbeat()))
                for vehicle, installation in list(self._pending.items()):
                    for frame in installation.poll(t_ns):
                        transport.send(self._peers[vehicle], frame)
                    self._settle(vehicle, installation)
                await asyncio.sleep(_TICK_S)
        finally:
            transport.close()
            self._times.write(self._time, self._streams)

    def _next_time(self, t_ns: int) -> int:
        self._time = max(self._time + 1, timestamp_of(t_ns))
        return self._time

    def _settle(self, vehicle: int, installation: SigningSetup) -> None:
        if installation.outcome:
            del self._pending[vehicle]
            ok = installation.outcome == "done"
            sent = installation.sent > 0
            self._on_result(Result(vehicle, ok, installation.detail, sent))

    def heard(self, peer: str, data: bytes) -> None:
        for frame in scan(data).frames:
            for vehicle, installation in self._pending.items():
                if frame.system_id == installation.system_id:
                    self._peers[vehicle] = peer
                    installation.receive(frame)

    def connected(self, peer: str) -> None:
        """Do nothing: a peer is known by its first frame."""

    def disconnected(self, peer: str) -> None:
        """Do nothing: the transport reconnects until the deadline."""

    def notify(self, code: NoticeCode, /, **parameters: Parameter) -> None:
        if code.level != "info":
            self._news(Notice(0, code, None, parameters).text)
