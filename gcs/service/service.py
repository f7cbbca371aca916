"""The service: event sources, one queue, the engine, and sinks for its effects.

Sources are the MAVLink links, scans and orders on zenoh, and a ticker. Each stamps its events with the run
clock and puts them into one bounded queue. The consumer gives every event to the recorder and the sinks
before the engine gets it, so a recording has exactly the events of the engine, in their order. When the queue
is full, new input is dropped and counted. Ticks never accumulate.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable, Iterator
from functools import partial

from gcs.config import Config
from gcs.core.engine import Engine
from gcs.core.snapshot import PeriodicSnapshots, encode_state
from gcs.core.state import State
from gcs.errors import GcsError, LinkError, RecordingError, ReplacedError, WireError
from gcs.io.background_writer import BackgroundWriter
from gcs.io.clock import ClockWatch, RunClock
from gcs.io.event_loop import on_loop
from gcs.io.links.garbage import GarbageFilter
from gcs.io.links.vehicle_links import VehicleLinks
from gcs.io.record_json import encode, encode_shown
from gcs.io.zenoh.key_expressions import (
    effect_key,
    order_key,
    sensor_of,
    sensor_scan_keys,
    status_request_key,
)
from gcs.io.zenoh.order_inbox import OrderInbox
from gcs.io.zenoh.scans import decode_scan
from gcs.io.zenoh.session import ZenohSession
from gcs.mavlink.frames.codec import FrameTable
from gcs.model import (
    NS_PER_S,
    BadInput,
    ClockStep,
    Datagram,
    Effect,
    Event,
    LaggedPicture,
    LinkNews,
    Notice,
    NoticeCode,
    Order,
    Parameter,
    Picture,
    Plan,
    Resumed,
    Scan,
    Send,
    Snapshot,
    Tick,
    Truth,
)
from gcs.service.service_load import ServiceLoad
from gcs.service.sinks import Output, Recording, Sink

TICK_NS = NS_PER_S // 20
QUEUE_SIZE = 20_000
_MAX_QUEUED_FRAMES = 128
"""Number of frames of a datagram that are queued with it. Hostile datagrams have thousands, in four times the
memory of their bytes; these are scanned again."""
_BUSY = 100
"""Events in the queue beyond which orders wait for the next tick."""
_FINISH_S = 30.0
"""Wait for uploads in progress at the end: the time of one upload at 30 % loss."""
_STALL_S = 1.0
"""The lease of a service that stood still for longer may have ended."""
OUTAGE_S = 5.0
"""A service that stood still for longer continues as after a restart: vehicles were heard, but not by it."""
_KEY_NOT_MISSING_NS = 10 * NS_PER_S
"""Time without frames that are signed with a key that is not here, after which none is missing."""
_PROVEN_NS = 60 * NS_PER_S
"""A state from a journal that has been in use for so long makes sense."""
_LEARN_S = 1.0
_LEARN_POLL_S = 0.02
_MAX_UNPUBLISHED = 1000
_PUBLISH_S = 5.0
"""Wait at the end for subscribers that do not read; zenoh drops them after the same time."""


class Service:
    """Central command on real links.

    Parameters
    ----------
    config : Config
        The mission.
    seed : int
        Seed of the map's random obstacles.
    links : VehicleLinks
        MAVLink links to vehicles and other ground stations.
    bus : ZenohSession
        Session for scans, orders and published effects.
    """

    def __init__(self, config: Config, seed: int, links: VehicleLinks, bus: ZenohSession) -> None:
        self.config = config
        self.engine = Engine(config, seed)
        self.health = ServiceLoad()
        self.clock = RunClock()
        self.links = links
        self._bus = bus
        self.recorder: Recording | None = None
        self.sinks: list[Sink] = []
        """Live view, evaluator, journal and others."""
        self._publisher = BackgroundWriter("zenoh", _MAX_UNPUBLISHED)
        self.outputs: list[Output] = [self._publisher]
        """Outputs whose failures become alarms."""
        self._garbage = GarbageFilter()
        self._queue: asyncio.Queue[tuple[Event, FrameTable | None]] = asyncio.Queue(QUEUE_SIZE)
        self._orders = OrderInbox(config.local_frame, config.name)
        self._resumed_from: Snapshot | None = None
        self._is_resumed = False
        """True while the state is that of a journal, and has not been in use for long."""
        self._proven_t_ns: int | None = None
        """Time from which that state has proved to make sense."""
        self._consumed_t_ns: int | None = None
        """Time of the last event."""
        self._tick_waits = False
        self._keyless_t_ns: dict[int, int] = {}
        """Last time at which a vehicle signed its frames with a key that is not here."""
        self._snapshots = PeriodicSnapshots()

    def resume(self, snapshot: Snapshot, state: State) -> None:
        """Continue from the state of an earlier service; call this before `run`.

        Raises
        ------
        ValueError
            If the state makes no sense for this mission; the service then begins without it.
        """
        try:
            self.engine.state = state
        except ValueError:
            self.engine.state = State.initial(agent.vehicle for agent in self.config.agents)
            raise
        self._resumed_from = snapshot
        self._is_resumed = True

    async def run(
        self,
        clock: RunClock,
        stop: asyncio.Event,
        end_with_mission: bool = False,
        at_once: asyncio.Event | None = None,
    ) -> None:
        """Run until `stop` is set.

        With `end_with_mission`, at most until the mission has ended, and its vehicles that land have landed.
        With `at_once`, uploads in progress are finished first, until `at_once` is set.

        Raises
        ------
        GcsError
            When a source or a sink fails. A recording that cannot be written does not raise: it ends with an
            alarm, and the flight continues.
        """
        resumed = self._resumed_from
        if resumed is not None:  # the wall clock may have been set back since
            clock = clock.not_before(resumed.t_ns)
        self.clock = clock
        failure: GcsError | None = None
        in_order = False
        loop = asyncio.get_running_loop()
        if resumed is not None:  # before anything else is heard
            self._record(lambda recorder: recorder.record_snapshot(resumed))
            self._put(Resumed(clock.now_ns(), resumed.t_ns))
        self.links.start(loop, self, lambda vehicle: bool(self.engine.state.tasking.stage(vehicle)))
        self._bus.subscribe(
            sensor_scan_keys(self.config.name),
            lambda key, payload: on_loop(loop, self._on_scan, key, payload),
        )
        for key in (order_key(self.config.name), status_request_key(self.config.name)):
            self._bus.subscribe(key, partial(self._on_order, loop))
        self._bus.watch_nodes(lambda name: on_loop(loop, self._on_unknown_node, name))
        try:
            async with asyncio.TaskGroup() as group:
                ticker = group.create_task(self._tick())
                consumer = group.create_task(self._consume(stop, end_with_mission))
                await stop.wait()
                if at_once is not None:
                    await self._finish(at_once)
                ticker.cancel()
                consumer.cancel()
            in_order = True
        except* GcsError as failures:
            failure = _first(failures)
        finally:
            self.links.close(in_order=in_order)
            self._publisher.drain(_PUBLISH_S)
        if failure is not None:
            raise failure

    async def _finish(self, at_once: asyncio.Event) -> None:
        """Wait for uploads in progress: an interrupted one may leave an inconsistent mission."""
        unfinished = self._partly_uploaded()
        if not unfinished:
            return
        self.on_notice("ending", NoticeCode.UPLOADS_AWAITED, vehicles=tuple(unfinished))
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_FINISH_S):
                while self._partly_uploaded() and not at_once.is_set():
                    await asyncio.sleep(TICK_NS / NS_PER_S)
        unfinished = self._partly_uploaded()
        if unfinished:
            vehicles = {"vehicles": tuple(unfinished)}
            notice = Notice(self.clock.now_ns(), NoticeCode.UPLOADS_UNFINISHED, "ended", vehicles)
            self._process(LinkNews(notice))

    def _partly_uploaded(self) -> list[int]:
        """Return the vehicles whose onboard missions an upload in progress may have changed."""
        tasking = self.engine.stages.tasking
        return sorted(vehicle for vehicle in tasking.state.stages if tasking.may_be_inconsistent(vehicle))

    def _put(self, event: Event, frames: FrameTable | None = None) -> bool:
        """Queue an event, and the frames of a datagram; return False if the queue is full."""
        try:
            self._queue.put_nowait((event, frames))
        except asyncio.QueueFull:
            self.health.dropped += 1
            return False
        return True

    def now_ns(self) -> int:
        """Return the run time now."""
        return self.clock.now_ns()

    def on_datagram(self, link: str, peer: str, frames: FrameTable) -> None:
        """Queue a datagram of a link."""
        t_ns = self.clock.now_ns()
        frames = self._garbage.filter_datagram(t_ns, link, frames)
        data = frames.data
        if not data:
            return
        self._put(Datagram(t_ns, link, peer, data), frames if frames.count <= _MAX_QUEUED_FRAMES else None)

    def on_notice(self, subject: str, code: NoticeCode, /, **parameters: Parameter) -> None:
        """Queue a notice about a link, an output or a part of the service."""
        self._put(LinkNews(Notice(self.clock.now_ns(), code, subject, parameters)))

    def _on_scan(self, key: str, payload: bytes) -> None:
        t_ns = self.clock.now_ns()
        try:
            self._put(decode_scan(key, payload, t_ns, self.config.local_frame))
        except WireError as error:
            self._put(BadInput(t_ns, key, str(error), sensor_of(key)))

    def _on_unknown_node(self, name: str) -> None:
        self.on_notice("zenoh", NoticeCode.NODE_WITHOUT_RIGHTS, name=name)

    def _on_order(self, loop: asyncio.AbstractEventLoop, key: str, payload: bytes) -> None:
        """Take an order on a thread of zenoh; one that is refused does not reach the event loop."""
        if self._orders.put(key, payload):
            on_loop(loop, self._queue_orders_unless_busy)

    def _queue_orders_unless_busy(self) -> None:
        if self._queue.qsize() < _BUSY:
            self._queue_orders()

    def _queue_orders(self) -> None:
        t_ns = self.clock.now_ns()
        may_command = self.links.may_command()
        for event in (*self._orders.take_due(t_ns), *self._orders.news(t_ns, order_key(self.config.name))):
            if may_command or not isinstance(event, Order) or event.action == "status":
                self._put(event)
            else:  # another node may carry it out; senders repeat it
                self._orders.forget(event.order_id)
                self.on_notice("command", NoticeCode.ORDER_NOT_TAKEN, action=event.action)

    def _answer_refused_orders(self) -> None:
        """Tell senders that their orders are not taken: these never were events, so nothing is recorded."""
        t_ns = self.clock.now_ns()
        for answer in self._orders.take_refusals(t_ns):
            key = effect_key(self.config.name, answer)
            self._publisher.put(partial(self._bus.publish, key, encode(answer)))
            for sink in self.sinks:
                sink.effect(t_ns, answer)

    async def _tick(self) -> None:
        t_ns = max(self.clock.now_ns(), self.clock.start_t_ns)
        watch = ClockWatch()
        while True:
            t_ns = max(t_ns + TICK_NS, self.clock.now_ns() - TICK_NS)
            await asyncio.sleep(max(0.0, self.clock.wall_s_until(t_ns)))
            if self.clock.wall_s_until(t_ns) < -_STALL_S:
                await self._learn_who_commands()
            self._watch_lag(self.clock.now_ns() - t_ns)
            step_ns = watch.step_ns()
            if step_ns:
                self._put(ClockStep(self.clock.now_ns(), step_ns))
            if not self._tick_waits:
                self._tick_waits = self._put(Tick(self.clock.now_ns()))

    async def _learn_who_commands(self) -> None:
        """Ask for the lease after a stop: if another node has it, no conclusion is drawn from the silence."""
        until_s = time.monotonic() + _LEARN_S
        while not self.links.may_command() and time.monotonic() < until_s:
            self.links.ask_for_lease()
            await asyncio.sleep(_LEARN_POLL_S)
            self._check_lease()

    async def _consume(self, stop: asyncio.Event, end_with_mission: bool) -> None:
        while True:
            event, frames = await self._queue.get()
            if isinstance(event, Tick):
                self._tick_waits = False
                self.links.tick(event.t_ns)
                self._check_lease()
                self._queue_orders()
                self._answer_refused_orders()
                self._check_keys()
                self._check_outputs()
            self._watch_lag(self.clock.now_ns() - event.t_ns)
            self._bridge_outage(event.t_ns)
            self._process(event, frames)
            if end_with_mission and self.engine.state.has_ended and not self._are_landing():
                stop.set()
                return

    def _are_landing(self) -> bool:
        """Return True while a vehicle that is heard, and whose mission lands, is in the air."""
        agents = self.engine.state.agents
        landing = [agents[v] for v, one in self.config.airframes_of_agents.items() if one.end == "land"]
        return any(agent.link.liveness == "alive" and agent.flight.phase.is_in_air for agent in landing)

    def _bridge_outage(self, t_ns: int) -> None:
        """Continue as after a restart if the service stood still: ticks come all the time."""
        last_t_ns = self._consumed_t_ns
        self._consumed_t_ns = t_ns
        if last_t_ns is not None and t_ns - last_t_ns > OUTAGE_S * self.clock.speed * NS_PER_S:
            self._process(Resumed(t_ns, last_t_ns))

    def _check_lease(self) -> None:
        """Raise `LinkError` when another node commands the vehicles; `ReplacedError` if it is ours."""
        if other := self.links.commander():
            problem = f"{other} commands the vehicles; this service sends nothing and ends"
            raise (ReplacedError if self.config.links.standby else LinkError)("bridge", problem)

    def _check_outputs(self) -> None:
        """Queue notices about failed outputs and about filtered noise."""
        for output in self.outputs:
            content = output.notice()
            if content is not None:
                code, parameters = content
                self.on_notice(output.name, code, **parameters)
        for link, count in self._garbage.take_dropped(self.clock.now_ns()).items():
            self.on_notice(link, NoticeCode.NOISE_DROPPED, count=count)

    def _check_keys(self) -> None:
        """Queue an alarm for each vehicle that signs its frames and has no key here, and later its end."""
        fleet = self.engine.stages.fleet
        t_ns = self.clock.now_ns()
        for agent in self.config.agents:
            vehicle = agent.vehicle
            if fleet.is_signed(vehicle) and self.links.is_keyed(fleet.link(vehicle), vehicle) is False:
                if vehicle not in self._keyless_t_ns:
                    self._put(LinkNews(Notice(t_ns, NoticeCode.KEY_MISSING, vehicle)))
                self._keyless_t_ns[vehicle] = t_ns
            elif t_ns - self._keyless_t_ns.get(vehicle, t_ns) > _KEY_NOT_MISSING_NS:
                del self._keyless_t_ns[vehicle]
                self._put(LinkNews(Notice(t_ns, NoticeCode.KEY_NOT_MISSING, vehicle)))

    def _process(self, event: Event, frames: FrameTable | None = None) -> None:
        """Record an event, step the engine and carry out its effects.

        Pictures leave before the rest of a scan is processed: a plan for hundreds of vehicles takes long.
        """
        snapshot = None if self.recorder is None else self._snapshots.before(event, self.engine.state)
        if snapshot is not None:
            self._record(lambda recorder: recorder.record_snapshot(snapshot))
        self._record(lambda recorder: recorder.record_event(event))
        for sink in self.sinks:
            sink.event(event)
        started = time.perf_counter()
        effects: list[Effect] = []
        shown = 0
        for effect in self._step(event, frames):
            effects.append(effect)
            if len(effects) == shown + 1 and isinstance(effect, Picture | LaggedPicture | Notice):
                self._carry_out(event.t_ns, effect)
                shown += 1
        took_ms = (time.perf_counter() - started) * 1e3
        if isinstance(event, Scan):
            self.health.scan_ms.append(took_ms)
        for effect in effects[shown:]:
            if isinstance(effect, Plan):
                self.health.plan_ms.append(took_ms)
            self._carry_out(event.t_ns, effect)

    def _step(self, event: Event, frames: FrameTable | None) -> Iterator[Effect]:
        """Step the engine. If a state from a journal soon turns out to be wrong, continue without it.

        A later error is one of the program: it ends the service, which is started again from its journal.
        """
        if self._proven_t_ns is None:
            self._proven_t_ns = event.t_ns + _PROVEN_NS
        self._is_resumed = self._is_resumed and event.t_ns < self._proven_t_ns
        try:
            yield from self.engine.effects(event, frames)
        except Exception as error:
            if not self._is_resumed:
                raise
            self._is_resumed = False
            self.engine.state = State.initial(agent.vehicle for agent in self.config.agents)
            snapshot = Snapshot(event.t_ns, encode_state(self.engine.state))
            self._record(lambda recorder: recorder.record_snapshot(snapshot))
            problem = f"its state makes no sense ({error!r})"
            self.on_notice("journal", NoticeCode.JOURNAL_REFUSED, problem=problem)

    def _carry_out(self, t_ns: int, effect: Effect) -> None:
        payload = b""
        if isinstance(effect, Send):
            self.links.send(effect.link, effect.peer, effect.data)
        else:
            if isinstance(effect, Picture):
                self.links.picture(effect)
            payload = encode(effect)
            shown = encode_shown(effect) if isinstance(effect, Notice) else payload
            self._publisher.put(partial(self._bus.publish, effect_key(self.config.name, effect), shown))
        self._record(lambda recorder: recorder.record_effect(t_ns, effect, payload))
        for sink in self.sinks:
            sink.effect(t_ns, effect)

    def truth(self, truth: Truth) -> None:
        """Record the ground truth of a simulated world."""
        self._record(lambda recorder: recorder.record_truth(truth))

    def _record(self, write: Callable[[Recording], None]) -> None:
        """Record, or continue without a recording if it cannot be written."""
        if self.recorder is None:
            return
        try:
            write(self.recorder)
        except RecordingError as error:
            self.recorder = None
            t_ns = self.clock.now_ns()
            notice = Notice(t_ns, NoticeCode.RECORDING_ENDED, "recording", {"problem": str(error)})
            self._carry_out(t_ns, notice)

    def _watch_lag(self, lag_ns: int) -> None:
        """Warn once if events wait in the queue, or if ticks come late."""
        t_ns = self.clock.now_ns()
        notice = self.health.note_lag(lag_ns, t_ns, is_fast=self.clock.speed > 1.0)
        if notice is not None:
            self._carry_out(t_ns, notice)


def _first(failures: BaseExceptionGroup[GcsError]) -> GcsError:
    """Return the first error of a nested group."""
    first = failures.exceptions[0]
    return _first(first) if isinstance(first, BaseExceptionGroup) else first
