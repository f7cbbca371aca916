"""Composition: sources fill one queue, one consumer feeds the fold, sinks take what comes out.

Sources are the MAVLink links, zenoh scans and orders, and a ticker; each stamps its events with the run's
clock and puts them into one bounded queue. The consumer hands every event to the recorder and the sinks
*before* it works it, so that a recording holds exactly what the fold saw, in its order. When the queue
is full, new input is dropped and counted; ticks never pile up.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

from gcs.config import Config
from gcs.core.engine import Engine
from gcs.core.operator.replies import named
from gcs.errors import GcsError, RecordingError, WireError
from gcs.io.clock import ClockWatch, RunClock
from gcs.io.links.garbage import GarbageFilter
from gcs.io.links.manager import Links
from gcs.io.mavsdk.uploader import MavsdkUploader
from gcs.io.output import QueuedText, Writer
from gcs.io.records import encode
from gcs.io.zenoh.keys import effect_key, order_key, sensor_of, sensor_scan_keys
from gcs.io.zenoh.order_inbox import OrderInbox
from gcs.io.zenoh.scans import decode_scan
from gcs.io.zenoh.session import ZenohSession
from gcs.model import (
    NS_PER_S,
    BadInput,
    ClockStep,
    Datagram,
    Effect,
    Event,
    Level,
    LinkNews,
    MissionEnded,
    Notice,
    PersistedState,
    Picture,
    Plan,
    Resumed,
    Scan,
    Send,
    Tick,
    Truth,
    Upload,
    system_of,
    vehicle_name,
)

TICK_NS = NS_PER_S // 20
QUEUE_SIZE = 20_000
_BUSY = 100
"""Events in the queue beyond which orders wait for the next tick."""
_FINISH_S = 30.0
"""How long the end waits for missions on their way: as long as one takes where a third of all is lost."""
_TIMES_KEPT = 10_000
_MAX_UNPUBLISHED = 1000
_PUBLISH_S = 5.0
"""How long the end waits for subscribers that take nothing: zenoh gives them up after as long."""
LAG_WARNING_NS = NS_PER_S // 2
LAG_TEXT = "this machine cannot keep up"
"""Begins the one notice that is the service's own: it is recorded, and no replay gives it."""


class Recording(Protocol):
    """Takes what a recording is made of; every method may raise `RecordingError`."""

    def record_event(self, event: Event) -> None:
        """Record what goes into the fold."""

    def record_effect(self, t_ns: int, effect: Effect, payload: bytes = b"") -> None:
        """Record what came out of the fold."""

    def record_truth(self, truth: Truth) -> None:
        """Record the truth of a simulated world."""


class Sink(Protocol):
    """Takes everything that goes into and comes out of the fold, in order."""

    def event(self, event: Event) -> None:
        """Take an event, before the fold works it."""

    def effect(self, t_ns: int, effect: Effect) -> None:
        """Take an effect."""


@dataclass(slots=True)
class Health:
    """How the service itself is doing."""

    scan_ms: deque[float] = field(default_factory=lambda: deque(maxlen=_TIMES_KEPT))
    plan_ms: deque[float] = field(default_factory=lambda: deque(maxlen=_TIMES_KEPT))
    dropped: int = 0
    """Events that found the queue full."""
    worst_lag_s: float = 0.0
    """Longest run time that an event waited in the queue."""


class Service:
    """Central command on real links.

    Parameters
    ----------
    config : Config
        The mission.
    seed : int
        Makes the random obstacles of the map.
    links : Links
        Where vehicles and other ground stations talk to us.
    bus : Bus
        Where sensors publish.
    """

    def __init__(self, config: Config, seed: int, links: Links, bus: ZenohSession) -> None:
        self.config = config
        self.command = Engine(config, seed)
        self.health = Health()
        self.clock = RunClock()
        self.links = links
        self._bus = bus
        self.recorder: Recording | None = None
        self.sinks: list[Sink] = []
        """View, judge, journal: what is here when an event is taken sees it."""
        self._publisher = Writer("zenoh", _MAX_UNPUBLISHED)
        self.outputs: list[Writer] = [self._publisher]
        """Told of when one fails or stops taking anything."""
        self._garbage = GarbageFilter()
        self._queue: asyncio.Queue[Event] = asyncio.Queue(QUEUE_SIZE)
        self._orders = OrderInbox(config.local_frame)
        self._memory: PersistedState | None = None
        self._tick_waits = False
        self._lag_warned = False
        self._keyless: set[int] = set()
        self._uploader: MavsdkUploader | None = None
        if config.mission.uploader == "mavsdk":
            self._uploader = MavsdkUploader(
                self._send_for_uploader, self._put, self._tell_of_uploader, lambda: self.clock.now_ns()
            )

    def resume(self, memory: PersistedState) -> None:
        """Take up where an earlier service was; call it before `run`."""
        self._memory = memory

    async def run(
        self,
        clock: RunClock,
        stop: asyncio.Event,
        end_with_mission: bool = False,
        at_once: asyncio.Event | None = None,
    ) -> None:
        """Serve until `stop` is set, or until the mission ends when `end_with_mission`.

        With `at_once`, missions that are on their way then are finished first, unless that is set, too.

        Raises
        ------
        GcsError
            Whatever made a room or a sink fail. A recording that cannot be written any further does not: it
            ends with an alarm, and the flight goes on.
        """
        self.clock = clock
        failure: GcsError | None = None
        loop = asyncio.get_running_loop()
        if self._memory is not None:  # before anything else is heard
            self._put(Resumed(clock.now_ns(), self._memory))
        self.links.start(loop, self, lambda vehicle: vehicle in self.command.tasking.stages)
        self._bus.subscribe(
            sensor_scan_keys(self.config.name),
            lambda key, payload: on_loop(loop, self._on_scan, key, payload),
        )
        self._bus.subscribe(
            order_key(self.config.name), lambda key, payload: on_loop(loop, self._on_order, key, payload)
        )
        try:
            async with asyncio.TaskGroup() as group:
                ticker = group.create_task(self._tick())
                consumer = group.create_task(self._consume(stop, end_with_mission))
                uploader = None if self._uploader is None else group.create_task(self._uploader.run())
                await stop.wait()
                if at_once is not None:
                    await self._finish(at_once)
                if uploader is not None:
                    uploader.cancel()
                ticker.cancel()
                consumer.cancel()
        except* GcsError as failures:
            failure = _first(failures)
        finally:
            self.links.close()
            self._publisher.drain(_PUBLISH_S)
        if failure is not None:
            raise failure

    async def _finish(self, at_once: asyncio.Event) -> None:
        """Wait for missions on their way: a vehicle whose transfer breaks off may hold a mix of two."""
        mixed = self._between_missions()
        if not mixed:
            return
        text = f"waiting until missions on their way are delivered ({named(mixed)}); Ctrl-C again: at once"
        self.on_link_news("ending", "warning", text)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_FINISH_S):
                while self._between_missions() and not at_once.is_set():
                    await asyncio.sleep(TICK_NS / NS_PER_S)
        mixed = self._between_missions()
        if mixed:
            text = f"{named(mixed)} may hold a mix of two missions: start again, or hold them by hand"
            self._work(LinkNews(self.clock.now_ns(), "ended", "alarm", text))

    def _between_missions(self) -> list[int]:
        """Vehicles to which a mission is on its way, not those for which one waits."""
        tasking = self.command.tasking
        return sorted(vehicle for vehicle in tasking.stages if tasking.may_be_inconsistent(vehicle))

    def _put(self, event: Event) -> bool:
        """Queue an event; return whether there was room."""
        try:
            self._queue.put_nowait(event)
        except asyncio.QueueFull:
            self.health.dropped += 1
            return False
        return True

    def now_ns(self) -> int:
        """Run time."""
        return self.clock.now_ns()

    def on_datagram(self, link: str, peer: str, data: bytes) -> None:
        """Queue what came over a link."""
        t_ns = self.clock.now_ns()
        data = self._garbage.filter_datagram(t_ns, link, data)
        if not data:
            return
        self._put(Datagram(t_ns, link, peer, data))
        if self._uploader is not None and not self.command.external_uploads.hosts(link):
            self._uploader.forward(data)

    def on_link_news(self, link: str, level: Level, text: str) -> None:
        """Queue what there is to say of a link."""
        self._put(LinkNews(self.clock.now_ns(), link, level, text))

    def _send_for_uploader(self, vehicle: int, frame: bytes) -> None:
        for send in self.command.fleet.address_frames(vehicle, [frame]):
            self.links.send(send.link, send.peer, send.data)

    def _tell_of_uploader(self, text: str) -> None:
        self._put(BadInput(self.clock.now_ns(), "mavsdk", text))

    def _on_scan(self, key: str, payload: bytes) -> None:
        t_ns = self.clock.now_ns()
        try:
            self._put(decode_scan(key, payload, t_ns, self.config.local_frame))
        except WireError as error:
            self._put(BadInput(t_ns, key, str(error), sensor_of(key)))

    def _on_order(self, key: str, payload: bytes) -> None:
        self._orders.put(key, payload)
        if self._queue.qsize() < _BUSY:
            self._take_orders()

    def _take_orders(self) -> None:
        t_ns = self.clock.now_ns()
        for event in (*self._orders.take_due(t_ns), *self._orders.news(t_ns, order_key(self.config.name))):
            self._put(event)

    async def _tick(self) -> None:
        t_ns = max(self.clock.now_ns(), self.clock.start_t_ns)
        watch = ClockWatch()
        while True:
            t_ns = max(t_ns + TICK_NS, self.clock.now_ns() - TICK_NS)
            await asyncio.sleep(max(0.0, self.clock.wall_s_until(t_ns)))
            self._watch_lag(self.clock.now_ns() - t_ns)
            step_ns = watch.step_ns()
            if step_ns:
                self._put(ClockStep(self.clock.now_ns(), step_ns))
            if not self._tick_waits:
                self._tick_waits = self._put(Tick(self.clock.now_ns()))

    async def _consume(self, stop: asyncio.Event, end_with_mission: bool) -> None:
        while True:
            event = await self._queue.get()
            if isinstance(event, Tick):
                self._tick_waits = False
                self.links.tick(event.t_ns)
                self._take_orders()
                self._tell_keyless()
                self._tell_outputs()
            self._watch_lag(self.clock.now_ns() - event.t_ns)
            ended = self._work(event)
            if ended and end_with_mission:
                stop.set()
                return

    def _tell_outputs(self) -> None:
        for output in self.outputs:
            news = output.news()
            if news is not None:
                self.on_link_news(output.name, *news)
        for link, text in self._garbage.news(self.clock.now_ns()):
            self.on_link_news(link, "warning", text)

    def _tell_keyless(self) -> None:
        """Say once of each vehicle that signs its frames that there is no key for it here."""
        fleet, gate = self.command.fleet, self.links.signing.gate
        for agent in self.config.agents:
            vehicle = agent.vehicle
            if not fleet.is_signed(vehicle) or vehicle in self._keyless:
                continue
            if not gate.is_keyed(fleet.link(vehicle), system_of(vehicle)):
                self._keyless.add(vehicle)
                text = (
                    f"agent {vehicle_name(vehicle)} signs its frames, and there is no key for it here; "
                    "it may ignore all that we send: put its key into links.keys (docs/signing.md)"
                )
                self.on_link_news(fleet.link(vehicle), "alarm", text)

    def _work(self, event: Event) -> bool:
        self._record(lambda recorder: recorder.record_event(event))
        for sink in self.sinks:
            sink.event(event)
        started = time.perf_counter()
        effects = self.command.step(event)
        took_ms = (time.perf_counter() - started) * 1e3
        if isinstance(event, Scan):
            self.health.scan_ms.append(took_ms)
        for effect in effects:
            if isinstance(effect, Plan):
                self.health.plan_ms.append(took_ms)
            self._carry_out(event.t_ns, effect)
        return any(isinstance(effect, MissionEnded) for effect in effects)

    def _carry_out(self, t_ns: int, effect: Effect) -> None:
        payload = b""
        if isinstance(effect, Send):
            self.links.send(effect.link, effect.peer, effect.data)
        elif isinstance(effect, Upload):
            if self._uploader is not None:
                self._uploader.upload(effect)
        else:
            if isinstance(effect, Picture):
                self.links.picture(effect)
            payload = encode(effect)
            self._publisher.put(partial(self._bus.publish, effect_key(self.config.name, effect), payload))
        self._record(lambda recorder: recorder.record_effect(t_ns, effect, payload))
        for sink in self.sinks:
            sink.effect(t_ns, effect)

    def truth(self, truth: Truth) -> None:
        """Record the truth of a simulated world."""
        self._record(lambda recorder: recorder.record_truth(truth))

    def _record(self, write: Callable[[Recording], None]) -> None:
        """Record; whoever is in the air needs us more than a recording that cannot be written."""
        if self.recorder is None:
            return
        try:
            write(self.recorder)
        except RecordingError as error:
            self.recorder = None
            t_ns = self.clock.now_ns()
            self._carry_out(t_ns, Notice(t_ns, "alarm", f"recording {error}; the flight goes on unrecorded"))

    def _watch_lag(self, lag_ns: int) -> None:
        """Say once when the service runs behind its clock: events wait, or the loop itself comes late."""
        self.health.worst_lag_s = max(self.health.worst_lag_s, lag_ns / NS_PER_S)
        if lag_ns > LAG_WARNING_NS and not self._lag_warned:
            self._lag_warned = True
            t_ns = self.clock.now_ns()
            text = (
                f"{LAG_TEXT}: {lag_ns / NS_PER_S:.1f} s of run time behind, "
                f"{self.health.dropped} events dropped; {self._lag_remedy()}"
            )
            self._carry_out(t_ns, Notice(t_ns, "warning", text))

    def _lag_remedy(self) -> str:
        if self.clock.speed > 1.0:
            return "a lower --speed would help"
        return "end other programs here, lower telemetry.rate_hz, or publish fewer scans a second"


def _first(failures: BaseExceptionGroup[GcsError]) -> GcsError:
    """Return the first error of a group, however deep."""
    first = failures.exceptions[0]
    return _first(first) if isinstance(first, BaseExceptionGroup) else first


def on_loop(
    loop: asyncio.AbstractEventLoop, callback: Callable[[str, bytes], None], key: str, payload: bytes
) -> None:
    """Hand a message from a thread of zenoh's to the loop; what comes after the loop's end is dropped."""
    with contextlib.suppress(RuntimeError):
        loop.call_soon_threadsafe(callback, key, payload)


def fly_on_after_hangup(view: QueuedText) -> Callable[[], object]:
    """Let go of the terminal on SIGHUP, and fly on without it; return what undoes that."""
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGHUP, view.hang_up)
    return lambda: loop.remove_signal_handler(signal.SIGHUP)


def wait_for_interrupt(*stops: asyncio.Event) -> Callable[[], None]:
    """Set the first of `stops` on SIGINT or SIGTERM, the next one on the next; return what undoes that."""
    loop = asyncio.get_running_loop()

    def interrupt() -> None:
        next((stop for stop in stops if not stop.is_set()), stops[-1]).set()

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, interrupt)

    def undo() -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.remove_signal_handler(number)

    return undo
