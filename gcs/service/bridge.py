"""Bridge: the MAVLink endpoints of a mission in a process of their own, and heartbeats that nothing delays.

Command connects over zenoh and sees the links of a bridge as its own (`gcs.io.cluster.bridge_links`). The
bridge frames, checks signatures, routes other ground stations, and sends. It knows nothing of missions. While
command is slow, restarted or replaced it goes on with the heartbeats (`gcs.mavlink.router.heartbeats`).
"""

from __future__ import annotations

import asyncio
import contextlib
import secrets
from collections.abc import Callable, Mapping
from copy import deepcopy
from functools import partial
from typing import Final

from gcs.core.lease.bridge_lease import accepts, answer_ask, extend_lease, start_lease
from gcs.core.lease.lease_messages import Ask, Epoch
from gcs.errors import WireError
from gcs.io.background_writer import BackgroundWriter
from gcs.io.clock import RunClock, steady_ns
from gcs.io.cluster.bridge_messages import (
    MAX_BATCH,
    BridgeStatus,
    ClockTime,
    Down,
    Message,
    Packet,
    Up,
    decode,
    encode,
)
from gcs.io.event_loop import on_loop
from gcs.io.links.manager import Links
from gcs.io.recording.frame_log import FrameLog
from gcs.io.zenoh.key_expressions import bridge_key
from gcs.io.zenoh.session import ZenohSession
from gcs.mavlink.frames.codec import FrameTable
from gcs.mavlink.router.heartbeats import HeartbeatKeeper
from gcs.model import NS_PER_S, Notice, NoticeCode, Parameter, network_of

_TICK_S: Final = 0.05
_STATUS_S: Final = 1.0
_END_S: Final = 1.0
_COLLECT_S: Final = 0.005
"""Time in which datagrams are collected for one message: each message costs as much as ten datagrams."""
_MAX_OFF_NS: Final = NS_PER_S
"""Difference of the run clocks here and of command at which that of command is taken."""
_STALL_NS: Final = NS_PER_S
"""Time between two ticks that shows that the bridge stood still."""
_MAX_EPOCH: Final = 2**62
"""Above all numbers of epochs."""
_MAX_UNSENT: Final = 200
"""Messages that wait for command. Those of a command that is stopped are dropped."""


class Bridge:
    """One bridge.

    Parameters
    ----------
    links : Links
        Its endpoints, open.
    vehicles : iterable of int
        Our vehicles.
    mission, name : str
        Of the mission and of the bridge.
    bus : ZenohSession
        Session at which command connects.
    failover_s : float
        Time after the last sign of command for which heartbeats go on.
    frame_log : FrameLog, optional
        Where its frames are kept.
    is_only : bool
        True if the mission has no other bridge.
    """

    def __init__(
        self,
        links: Links,
        vehicles: tuple[int, ...],
        mission: str,
        name: str,
        bus: ZenohSession,
        failover_s: float,
        frame_log: FrameLog | None = None,
        *,
        is_only: bool = True,
    ) -> None:
        self.clock = RunClock()
        self.links = links
        self.has_ended = False
        """True if command has said that it ends."""
        self._vehicles = vehicles
        self._bus = bus
        self._key = partial(bridge_key, mission, name)
        self._heartbeats = HeartbeatKeeper(int(failover_s * NS_PER_S))
        self._busy: frozenset[int] = frozenset()
        self._packets: list[Packet] = []
        self._notices: list[Notice] = []
        self._failed_links: dict[str, Mapping[str, Parameter]] = {}
        """Parameters of the last notice of each link that is down."""
        self._told_epoch: Epoch | None = None
        """Epoch of the command that was told of them."""
        self._frame_log = frame_log
        self._frames: list[tuple[int, bytes]] = []
        """Datagrams that wait for the log, both ways."""
        self._frames_writer = BackgroundWriter("frames", _MAX_UNSENT)
        self._is_unrecorded = False
        self._number = 0
        self._boot = secrets.randbits(63)
        self._lease = start_lease(self._boot, steady_ns(), is_only_bridge=is_only)
        self._ran_ns = steady_ns()
        """Monotonic time at which this process was last seen to run."""
        self._dropped = 0
        """Datagrams that command did not take since the last warning."""
        self._refused = 0
        """Datagrams of command without the lease, or late, since the last warning."""
        self._writer = BackgroundWriter("command", _MAX_UNSENT)
        self._answers = BackgroundWriter("lease", _MAX_UNSENT)
        """Apart: a command that is stopped blocks the other one for seconds; a standby needs the lease."""
        self._loop: asyncio.AbstractEventLoop | None = None

    async def run(self, stop: asyncio.Event) -> None:
        """Serve until `stop` is set."""
        loop = self._loop = asyncio.get_running_loop()
        self.links.start(loop, self, lambda vehicle: vehicle in self._busy)
        self._bus.subscribe(self._key("down"), partial(self._on_down, loop))
        self._bus.answer(self._key("lease"), partial(self._on_ask, loop))
        timers = [loop.create_task(self._repeat(_TICK_S, self._tick))]
        timers.append(loop.create_task(self._repeat(_STATUS_S, self._publish_status)))
        timers.append(loop.create_task(self._repeat(_STATUS_S, self._keep_frames)))
        try:
            stopped = loop.create_task(stop.wait())
            await asyncio.wait({stopped, *timers}, return_when=asyncio.FIRST_COMPLETED)
            for timer in timers:
                if timer.done():
                    timer.result()  # a program error
        finally:
            for timer in timers:
                timer.cancel()
            self.links.close()
            self._keep_frames()
            self._frames_writer.drain(_END_S)

    async def _repeat(self, period_s: float, action: Callable[[], None]) -> None:
        while True:
            action()
            await asyncio.sleep(period_s)

    def _tick(self) -> None:
        self._note_running()
        if error := self._writer.error or self._answers.error:
            raise error  # nothing is published any more: the bridge is to be started again
        t_ns = self.now_ns()
        self.links.tick(t_ns)
        for (link, peer), data in self._heartbeats.due(t_ns):
            self._send(t_ns, link, peer, data)
        if self._dropped:
            self.on_notice("bridge", NoticeCode.BRIDGE_UNREAD, count=self._dropped)
            self._dropped = 0
        if self._refused:
            self.on_notice("bridge", NoticeCode.BRIDGE_REFUSED, count=self._refused)
            self._refused = 0

    def _note_running(self) -> None:
        """Leave the lease to its holder when the bridge stood still and could not renew it."""
        now_ns = steady_ns()
        if now_ns - self._ran_ns > _STALL_NS:
            self._lease = extend_lease(self._lease, now_ns)
        self._ran_ns = now_ns

    def has_lost_command(self) -> bool:
        """Return True if command was not heard for the time of a failover: the heartbeats have ended."""
        return self._heartbeats.have_ended(self.now_ns())

    # ------------------------------------------------------------ from the links

    def now_ns(self) -> int:
        """Return the run time now."""
        return self.clock.now_ns()

    def on_datagram(self, link: str, peer: str, frames: FrameTable) -> None:
        """Pass a datagram on to command."""
        self._flush_soon()
        self._packets.append(Packet(link, peer, frames.data))
        self._note_frames(self.now_ns(), frames.data)

    def on_notice(self, subject: str, code: NoticeCode, /, **parameters: Parameter) -> None:
        """Pass a notice on to command."""
        self._flush_soon()
        self._notices.append(Notice(self.now_ns(), code, subject, parameters))
        if code is NoticeCode.LINK_FAILED:
            self._failed_links[subject] = parameters
        elif code is NoticeCode.LINK_OPEN:
            self._failed_links.pop(subject, None)

    def _flush_soon(self) -> None:
        """Send what is received, together with what arrives in the next milliseconds."""
        if not (self._packets or self._notices) and self._loop is not None:
            self._loop.call_later(_COLLECT_S, self._flush)

    def _flush(self) -> None:
        packets = self._packets
        notices = self._notices
        self._packets = []
        self._notices = []
        for begin in range(0, max(1, len(packets)), MAX_BATCH):
            part = tuple(packets[begin : begin + MAX_BATCH])
            message = Up(
                number=self._number,
                boot=self._boot,
                sent_ns=steady_ns(),
                packets=part,
                notices=() if begin else tuple(notices),
            )
            self._number += 1
            if not self._publish("up", message):
                self._dropped += len(part)

    def _publish(self, what: str, message: Message) -> bool:
        return self._writer.put(lambda: self._bus.publish(self._key(what), encode(message)))

    def _publish_status(self) -> None:
        links = self.links
        t_ns = self.now_ns()
        keyed = frozenset(
            (link.name, vehicle)
            for link in links.links
            for vehicle in self._vehicles
            if network_of(vehicle) == link.network and links.is_keyed(link.name, vehicle)
        )
        status = BridgeStatus(
            ports=links.ports(),
            unsent=links.unsent(),
            stations=links.ground_stations(t_ns),
            counters=deepcopy(links.counters()),
            keyed_links=tuple(link.name for link in links.links if links.is_keyed(link.name)),
            keyed_vehicles=keyed,
            signing=deepcopy(dict(links.signing_counters())),
        )
        self._publish("status", status)

    # ------------------------------------------------------------ frames

    def _note_frames(self, t_ns: int, data: bytes) -> None:
        if self._frame_log is not None:
            self._frames.append((t_ns, data))

    def _keep_frames(self) -> None:
        """Write what was received and sent since the last time, on a thread; tell when that fails."""
        log = self._frame_log
        frames = self._frames
        self._frames = []
        if log is None or not frames:
            return
        self._frames_writer.put(partial(log.write, frames))
        if bool(log.problem) is not self._is_unrecorded:
            self._is_unrecorded = bool(log.problem)
            code = NoticeCode.BRIDGE_UNRECORDED if log.problem else NoticeCode.BRIDGE_RECORDED
            self.on_notice("bridge", code, **({"problem": log.problem} if log.problem else {}))

    # ------------------------------------------------------------ from command

    def _on_ask(
        self, loop: asyncio.AbstractEventLoop, key: str, payload: bytes, reply: Callable[[bytes], None]
    ) -> None:
        """Take a question for the lease, on a thread of zenoh."""
        with contextlib.suppress(WireError):
            ask = decode(key, payload, Ask)
            if 0 <= ask.seen < _MAX_EPOCH:
                on_loop(loop, self._answer, ask, reply)

    def _answer(self, ask: Ask, reply: Callable[[bytes], None]) -> None:
        self._note_running()
        self._lease, answer = answer_ask(self._lease, ask, steady_ns())
        self._answers.put(lambda: reply(encode(answer)))

    def _on_down(self, loop: asyncio.AbstractEventLoop, key: str, payload: bytes) -> None:
        """Take a message of command, on a thread of zenoh."""
        with contextlib.suppress(WireError):  # another version
            on_loop(loop, self.obey, decode(key, payload, Down))

    def obey(self, message: Down) -> None:
        """Carry out a message of the node that has the lease."""
        if not accepts(self._lease, message.permit, steady_ns()):
            self._refused += len(message.packets)
            return
        if message.clock is not None and not self._is_in_time(message.clock):
            self.clock = message.clock.clock()
            self._heartbeats.end()  # their times are of the clock before; command's next ones begin anew
        self._tell_failed_links(message.permit.epoch)
        t_ns = self.now_ns()
        self._heartbeats.note_command(t_ns)
        if message.busy is not None:
            self._busy = frozenset(message.busy)
        if message.targets is not None:
            self.links.picture(message.targets)
        for packet in message.packets:
            self._heartbeats.note_sent(t_ns, (packet.link, packet.peer), packet.data)
            self._send(t_ns, packet.link, packet.peer, packet.data)
        if message.ends:
            self.has_ended = True
            self._heartbeats.end()

    def _tell_failed_links(self, epoch: Epoch) -> None:
        """Pass on which links are down to a command that begins: it was not there when they failed."""
        if epoch == self._told_epoch:
            return
        self._told_epoch = epoch
        for link, parameters in self._failed_links.items():
            self.on_notice(link, NoticeCode.LINK_FAILED, **parameters)

    def _send(self, t_ns: int, link: str, peer: str, data: bytes) -> None:
        self.links.send(link, peer, data)
        self._note_frames(t_ns, data)

    def _is_in_time(self, command: ClockTime) -> bool:
        """Return True if the clock here is about that of command."""
        off_ns = abs(command.t_ns - self.now_ns())
        return command.speed == self.clock.speed and off_ns <= _MAX_OFF_NS * command.speed
