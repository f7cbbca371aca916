"""Keys to vehicles over a real endpoint: `gcs keys install` and `gcs keys rotate` at work."""

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
from gcs.model import NS_PER_S, Level, system_of

_TURN_S: Final = 0.05


@dataclass(frozen=True, slots=True)
class Wanted:
    """One vehicle's new key, and what it holds by our knowledge."""

    vehicle: int
    key: bytes
    old: bytes | None


@dataclass(frozen=True, slots=True)
class Result:
    """What became of one vehicle's key."""

    vehicle: int
    ok: bool
    detail: str
    sent: bool
    """Whether the key went out: a vehicle that was given one may hold it, whatever it answered."""


def install(
    endpoint: Endpoint,
    wanted: Sequence[Wanted],
    times: TimeFile,
    timeout_s: float,
    settled: Callable[[Result], None],
    news: Callable[[str], None],
) -> None:
    """Give vehicles their keys, all at a time; `settled` takes each result when it is there.

    Raises
    ------
    LinkError
        When the endpoint cannot be had.
    ConfigError, OSError
        When the signing time cannot be read or kept.
    """
    asyncio.run(_Run(endpoint, wanted, times, settled, news).run(timeout_s))


class _Run:
    """One endpoint, open for as long as it takes; the listener of its transport."""

    def __init__(
        self,
        endpoint: Endpoint,
        wanted: Sequence[Wanted],
        times: TimeFile,
        settled: Callable[[Result], None],
        news: Callable[[str], None],
    ) -> None:
        self._endpoint, self._wanted, self._times = endpoint, wanted, times
        self._settled, self._news = settled, news
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
                await asyncio.sleep(_TURN_S)
        finally:
            transport.close()
            self._times.write(self._time, self._streams)

    def _next_time(self, t_ns: int) -> int:
        self._time = max(self._time + 1, timestamp_of(t_ns))
        return self._time

    def _settle(self, vehicle: int, installation: SigningSetup) -> None:
        if installation.outcome:
            del self._pending[vehicle]
            ok, sent = installation.outcome == "done", installation.sent > 0
            self._settled(Result(vehicle, ok, installation.detail, sent))

    def heard(self, peer: str, data: bytes) -> None:
        for frame in scan(data).frames:
            for vehicle, installation in self._pending.items():
                if frame.system_id == installation.system_id:
                    self._peers[vehicle] = peer
                    installation.receive(frame)

    def joined(self, peer: str) -> None:
        """Nobody is known before he speaks."""

    def gone(self, peer: str) -> None:
        """It is tried again until time is up."""

    def news(self, level: Level, text: str) -> None:
        if level != "info":
            self._news(text)
