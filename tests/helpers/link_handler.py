"""Central command's side of real sockets, for tests: it keeps what it is given, and the time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import Encoder, FrameTable, scan
from gcs.model import Notice, NoticeCode, Parameter


class RecordingHandler:
    def __init__(self, t_ns: int) -> None:
        self.t_ns = t_ns
        self.heard: list[tuple[str, str, bytes]] = []
        self.notices: list[Notice] = []

    def now_ns(self) -> int:
        return self.t_ns

    def on_datagram(self, link: str, peer: str, frames: FrameTable) -> None:
        self.heard.append((link, peer, frames.data))

    def on_notice(self, subject: str, code: NoticeCode, /, **parameters: Parameter) -> None:
        self.notices.append(Notice(self.t_ns, code, subject, parameters))

    def count(self, code: NoticeCode) -> int:
        """Return how often a notice came."""
        return sum(notice.code is code for notice in self.notices)

    def frames(self) -> int:
        return sum(len(scan(data).frames) for _, _, data in self.heard)

    async def until(self, condition: Callable[[], Any], what: str) -> None:
        """Wait for something that real sockets bring about."""
        for _ in range(2000):
            if condition():
                return
            await asyncio.sleep(0.005)
        raise AssertionError(f"{what}; notices: {self.notices}")


def beat(system: int, component: int = 1, *, ground: bool = False) -> bytes:
    """A vehicle's heartbeat, or a ground station's."""
    kind, autopilot = (6, 8) if ground else (1, 3)
    message = dialect.MAVLink_heartbeat_message(kind, autopilot, 0, 0, 4, 3)
    return Encoder(system, component)(message)


def run(coroutine: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(coroutine, 30.0))
