"""A tap between vehicles and a service: when each vehicle hears a heartbeat, and what it is sent else.

It can lose datagrams, pass them on twice, and in another order, as a radio network does.
"""

from __future__ import annotations

import random
import selectors
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.fleet.heartbeat import is_heartbeat
from gcs.mavlink.frames.codec import GCS_SYSTEM_ID, scan


class Sent(NamedTuple):
    """A datagram to a vehicle that is no heartbeat, or one of a vehicle with a part of a mission transfer."""

    unix_s: float
    peer: str
    """Address of the vehicle as the service sees it."""
    data: bytes
    is_up: bool


@dataclass(slots=True)
class Radio:
    """Probabilities for each datagram, both ways."""

    loss: float = 0.0
    twice: float = 0.0
    late: float = 0.0
    """To arrive after the next one of the same vehicle and direction."""


_UP: Final = frozenset(
    {
        dialect.MAVLINK_MSG_ID_MISSION_ACK,
        dialect.MAVLINK_MSG_ID_MISSION_COUNT,
        dialect.MAVLINK_MSG_ID_MISSION_ITEM_INT,
    }
)


class HeartbeatTap:
    """Passes datagrams on, on a thread.

    Vehicles send to `port`, and the tap to `service`, from one socket for each of them.
    """

    def __init__(self, port: int, service: int, seed: int = 1) -> None:
        self.radio = Radio()
        self._random = random.Random(seed)
        self._held: dict[tuple[Any, bool], bytes] = {}
        """Datagrams that wait for the next one, by vehicle and direction."""
        self.heard_s: dict[Any, list[float]] = {}
        """Monotonic times by vehicle's address."""
        self.sent: list[Sent] = []
        self.service = service
        self._down = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._down.bind(("127.0.0.1", port))
        self._ups: dict[Any, socket.socket] = {}
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._down, selectors.EVENT_READ)
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._ends.is_set():
            for key, _ in self._selector.select(0.2):
                with suppress(OSError):
                    self._pass_on(key)

    def _pass_on(self, key: selectors.SelectorKey) -> None:
        assert isinstance(key.fileobj, socket.socket)
        if key.fileobj is self._down:
            data, vehicle = self._down.recvfrom(65_536)
            if vehicle not in self._ups:
                up = self._ups[vehicle] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                up.connect(("127.0.0.1", self.service))
                up.setblocking(False)  # what was readable may be an error that a send has reported
                self._selector.register(up, selectors.EVENT_READ, vehicle)
            self._by_radio(data, (vehicle, True), self._send_up)
            return
        self._by_radio(key.fileobj.recv(65_536), (key.data, False), self._send_down)

    def _by_radio(self, data: bytes, way: tuple[Any, bool], send: Callable[[bytes, Any], None]) -> None:
        """Pass a datagram on, as the radio does."""
        radio = self.radio
        if self._random.random() < radio.loss:
            return
        if way not in self._held and self._random.random() < radio.late:
            self._held[way] = data
            return
        for one in (data, self._held.pop(way, b"")):
            if one:
                send(one, way[0])
                if self._random.random() < radio.twice:
                    send(one, way[0])

    def _send_up(self, data: bytes, vehicle: Any) -> None:
        up = self._ups[vehicle]
        up.send(data)
        frames = scan(data)
        if any(frame.message_id in _UP for frame in frames):
            self._note(up, data, is_up=True)

    def _send_down(self, data: bytes, vehicle: Any) -> None:
        if any(frame.system_id == GCS_SYSTEM_ID and is_heartbeat(frame) for frame in scan(data)):
            self.heard_s.setdefault(vehicle, []).append(time.monotonic())
        else:
            self._note(self._ups[vehicle], data, is_up=False)
        self._down.sendto(data, vehicle)

    def _note(self, up: socket.socket, data: bytes, *, is_up: bool) -> None:
        host, port = up.getsockname()
        self.sent.append(Sent(time.time(), f"{host}:{port}", data, is_up))

    def gaps_s(self, begin_s: float, end_s: float) -> list[float]:
        """Return the longest time without a heartbeat at each vehicle in an interval."""
        return [max(_gaps(times, begin_s, end_s)) for times in self.heard_s.values()]

    def end(self) -> None:
        self._ends.set()
        self._thread.join()
        for one in (self._down, *self._ups.values()):
            one.close()


def _gaps(times: list[float], begin_s: float, end_s: float) -> Iterator[float]:
    within = [begin_s, *(one for one in times if begin_s < one < end_s), end_s]
    return (later - earlier for earlier, later in pairwise(within))
