"""Links in bridges, as command sees them: `gcs.io.links.manager.Links` in other processes.

What is to be sent waits until the event loop has processed what is due, and then goes as one message to each
bridge. A thread of zenoh decodes what bridges receive; the loop gets it in order.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

from gcs.core.lease.lease_messages import TIMES, Answer, Ask
from gcs.errors import GcsError, LinkError, WireError
from gcs.io.background_writer import BackgroundWriter
from gcs.io.clock import RunClock, steady_ns
from gcs.io.cluster.bridge_messages import (
    MAX_BATCH,
    BridgeStatus,
    ClockTime,
    Down,
    Packet,
    Up,
    decode,
    encode,
)
from gcs.io.cluster.bridge_settings import BridgeSettings
from gcs.io.cluster.command_lease import CommandLease
from gcs.io.cluster.lateness import MAX_LATE_NS, Lateness
from gcs.io.event_loop import on_loop
from gcs.io.links.vehicle_links import LinkHandler
from gcs.io.zenoh.key_expressions import bridge_key
from gcs.io.zenoh.session import ZenohSession
from gcs.mavlink.frames.codec import FrameTable, scan
from gcs.mavlink.frames.signing import SigningCounters
from gcs.mavlink.router.router import PortCounters
from gcs.model import NS_PER_S, NoticeCode, NoticeContent, Picture

_MAX_UNSENT: Final = 200
"""Messages that wait for a bridge that does not read."""
_MAX_UNREAD: Final = 500
"""Messages of a bridge that wait for the loop; later ones are dropped, as by the buffer of a socket."""
_MAX_SILENCE_NS: Final = 6 * NS_PER_S // 5
"""A bridge sends its status each second."""
_SILENT_NS: Final = 15 * NS_PER_S
"""Silence after which the session is opened again: longer than a start of a bridge, and than zenoh's lease of
10 s, after which zenoh connects again by itself, but for some cases (its issue 2806)."""
_BLOCKED_S: Final = 6.0
"""Time after which zenoh has given up a blocked message."""
_MAX_ASKS: Final = 2
"""Asks that wait for a bridge that does not read: the next one asks again."""
_ANSWER_S: Final = 1.0
_END_S: Final = 1.0


class BridgeLinks:
    """The links of one bridge.

    Parameters
    ----------
    settings : BridgeSettings
        Settings of the bridge, which has opened their links.
    connect : callable
        Opens a session that reaches the bridge; again after a long silence.
    lease : CommandLease
        Lease of this node over all bridges.
    supervise : callable
        Keeps the bridge running; returns a notice when it has ended.
    ports : mapping
        Port of each endpoint by name.
    scan : callable
        Returns the frames of a datagram.

    Raises
    ------
    LinkError, ConfigError
        As `connect` does.
    """

    def __init__(
        self,
        settings: BridgeSettings,
        connect: Callable[[], ZenohSession],
        lease: CommandLease,
        supervise: Callable[[], NoticeContent | None] = lambda: None,
        ports: Mapping[str, int] | None = None,
        scan: Callable[[bytes], FrameTable] = scan,
    ) -> None:
        self.links = settings.links
        self.bridge = settings.name
        self.name = f"bridge {settings.name}"
        """Name in notices."""
        self._vehicles = settings.vehicles
        self._connect = connect
        self._bus = connect()
        self._key = partial(bridge_key, settings.mission, settings.name)
        self._lease = lease
        self._scan = scan
        self._supervise = supervise
        self._status = BridgeStatus(ports=dict(ports or {}), unsent={}, stations={}, counters={})
        self._has_status = False
        self._is_busy: Callable[[int], bool] = lambda _: False
        self._busy: tuple[int, ...] | None = None
        """Busy vehicles that the bridge knows of; None if it knows nothing yet."""
        self._sends: list[Packet] = []
        self._targets: Picture | None = None
        self._unread: deque[Up] = deque()
        self._missed = 0
        """Messages that were dropped here or never came."""
        self._late = 0
        """Datagrams that came late."""
        self._lateness = Lateness()
        self._boot = 0
        self._number: int | None = None
        """Of the newest message of the bridge."""
        self._heard_ns = self._steady_since_ns = self._connected_ns = steady_ns()
        """Monotonic times: of its last message, of the first one after a silence, of the newest session."""
        self._writer = BackgroundWriter(self.name, _MAX_UNSENT)
        self._asks = BackgroundWriter(f"{self.name}, lease", _MAX_ASKS)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._handler: LinkHandler | None = None

    def start(
        self,
        loop: asyncio.AbstractEventLoop,
        handler: LinkHandler,
        busy: Callable[[int], bool] = lambda _: False,
    ) -> None:
        """Start receiving; `busy` returns True during a mission transfer to a vehicle."""
        self._handler = handler
        self._is_busy = busy
        if self._loop is None:  # else a standby begins to command
            self._loop = loop
            self._subscribe(self._bus)

    def _subscribe(self, bus: ZenohSession) -> None:
        bus.subscribe(self._key("up"), self._take)
        bus.subscribe(self._key("status"), self._take_status)

    def _connect_again(self) -> None:
        """Replace a session that hears nothing, on a thread: it may not have come back after a silence."""
        with contextlib.suppress(GcsError):  # later again
            bus = self._connect()
            if self._loop is not None:
                self._subscribe(bus)
            old = self._bus
            self._bus = bus
            old.close()  # ends a message that was blocked
            self._writer.drain(_BLOCKED_S)
            if self._writer.error is not None:
                self._writer = BackgroundWriter(self.name, _MAX_UNSENT)

    # ------------------------------------------------------------ in

    def _take(self, key: str, payload: bytes) -> None:
        """Decode a message, on a thread of zenoh."""
        with contextlib.suppress(WireError):  # of another version: the start of the bridge tells it
            message = decode(key, payload, Up)
            self._note_heard()
            if len(self._unread) >= _MAX_UNREAD:
                return  # the number of the next one shows it
            self._unread.append(message)
            if self._loop is not None:
                on_loop(self._loop, self._read)

    def _take_status(self, key: str, payload: bytes) -> None:
        with contextlib.suppress(WireError):
            self._status = decode(key, payload, BridgeStatus)
            self._has_status = True
            self._note_heard()

    def _note_heard(self) -> None:
        now_ns = steady_ns()
        if now_ns - self._heard_ns > _MAX_SILENCE_NS:
            self._steady_since_ns = now_ns
        self._heard_ns = now_ns

    def is_steady(self) -> bool:
        """Return True if the bridge is heard, and was for a lease without a silence."""
        now_ns = steady_ns()
        is_heard = now_ns - self._heard_ns <= _MAX_SILENCE_NS
        return is_heard and now_ns - self._steady_since_ns >= TIMES.lease_ns

    def _read(self) -> None:
        """Pass on what a bridge has received."""
        handler = self._handler
        assert handler is not None
        while self._unread:
            message = self._unread.popleft()
            if message.boot != self._boot:  # it has started again
                self._boot = message.boot
                self._busy = None
            elif self._number is not None:
                self._missed += max(0, message.number - self._number - 1)
            self._number = message.number
            late_ns = self._lateness.of(message.boot, message.sent_ns, steady_ns())
            packets = message.packets if late_ns <= MAX_LATE_NS else ()
            self._late += len(message.packets) - len(packets)
            for packet in packets:
                handler.on_datagram(packet.link, packet.peer, self._scan(packet.data))
            for notice in message.notices:
                handler.on_notice(str(notice.subject), notice.code, **notice.parameters)

    # ------------------------------------------------------------ out

    def send(self, link: str, peer: str, data: bytes) -> None:
        """Send to a peer of a link. Without the lease nothing is sent."""
        if not self._sends and self._loop is not None:
            self._loop.call_soon(self._flush)
        self._sends.append(Packet(link, peer, data))

    def picture(self, picture: Picture) -> None:
        """Set the newest picture of the targets."""
        if picture.kind == "targets":
            self._targets = picture

    def tick(self) -> None:
        """Tell the bridge that command is alive, and which vehicles are busy."""
        self._flush()

    def ask(self, ask: Ask) -> None:
        """Ask the bridge for the lease, or renew it; on a thread, since a stopped bridge may block it."""
        now_ns = steady_ns()
        if now_ns - max(self._heard_ns, self._connected_ns) > _SILENT_NS:
            self._connected_ns = now_ns
            threading.Thread(target=self._connect_again, name=f"connect {self.name}", daemon=True).start()
        if self._writer.error is None:  # else another node is to command
            self._asks.put(lambda: self._send_ask(ask))

    def _send_ask(self, ask: Ask) -> None:
        with contextlib.suppress(LinkError):  # the session has ended
            self._bus.ask(self._key("lease"), encode(ask), _ANSWER_S, self._take_answer, lambda: None)

    def _take_answer(self, key: str, payload: bytes) -> None:
        """Take an answer about the lease, on a thread of zenoh."""
        with contextlib.suppress(WireError):
            answer = decode(key, payload, Answer)
            if self._loop is not None:
                on_loop(self._loop, self._lease.note_answer, self.bridge, answer)

    def _flush(self) -> None:
        sends = self._sends
        self._sends = []
        permit = self._lease.permit(self.bridge)
        if permit is None:
            return
        busy = tuple(vehicle for vehicle in self._vehicles if self._is_busy(vehicle))
        targets = self._targets
        self._targets = None
        clock = RunClock() if self._handler is None else self._handler.clock
        first = Down(
            permit=permit,
            packets=tuple(sends[:MAX_BATCH]),
            busy=busy if busy != self._busy else None,
            targets=targets,
            clock=ClockTime.of(clock),
        )
        self._busy = busy
        self._put(first)
        for begin in range(MAX_BATCH, len(sends), MAX_BATCH):
            self._put(Down(permit=permit, packets=tuple(sends[begin : begin + MAX_BATCH])))

    def _put(self, message: Down) -> None:
        self._writer.put(lambda: self._bus.publish(self._key("down"), encode(message)))

    def close(self, *, in_order: bool) -> None:
        """Tell the bridge that command ends, if it ends in order."""
        if in_order and (permit := self._lease.permit(self.bridge)):
            self._put(Down(permit=permit, ends=True))
        self._writer.drain(_END_S)

    def disconnect(self) -> None:
        """Close the session."""
        self._bus.close()

    # ------------------------------------------------------------ state

    def ports(self) -> dict[str, int]:
        """Return the port of each endpoint by name."""
        return self._status.ports

    def supervise(self) -> NoticeContent | None:
        """Start a bridge on this machine again that has ended; return an alarm of its end."""
        return self._supervise()

    def notice(self) -> NoticeContent | None:
        """Return the next notice about the bridge, if any."""
        if ended := self.supervise():
            return ended
        if late := self._late:
            self._late = 0
            return NoticeCode.BRIDGE_LATE, {"late": late}
        if missed := self._missed:
            self._missed = 0
            return NoticeCode.BRIDGE_LOSSES, {"missed": missed}
        return self._writer.notice()

    def ground_stations(self, t_ns: int) -> dict[str, list[str]]:  # noqa: ARG002
        """Return the clients of each endpoint as "HOST:PORT (system/component, ...)"."""
        names = [link.name for link in self.links if link.role != "vehicles"]
        return {name: self._status.stations.get(name, []) for name in names}

    def counters(self) -> dict[str, PortCounters]:
        """Return the counters of the clients' endpoints, by name."""
        return self._status.counters

    def unsent(self) -> dict[str, int]:
        """Return the number of sends that the system refused, by endpoint."""
        return {link.name: self._status.unsent.get(link.name, 0) for link in self.links}

    def is_keyed(self, link: str, vehicle: int | None = None) -> bool | None:
        """Return True if frames of a vehicle on a link must be signed; without a vehicle: of any system.

        None until the bridge has told it.
        """
        if not self._has_status:
            return None
        if vehicle is None:
            return link in self._status.keyed_links
        return (link, vehicle) in self._status.keyed_vehicles

    def signing_counters(self) -> Mapping[str, SigningCounters]:
        """Return the counters of signatures, by link."""
        return self._status.signing
