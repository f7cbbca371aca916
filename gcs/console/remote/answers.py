"""Answers of a service to its consoles, over zenoh.

A query is handed to the loop of the service, which reads the state between two events: a bounded time, since
a console asks for what it lacks. Encoding and sending are on a thread: a console that does not read blocks
this thread for some seconds at most, and nothing else.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import Final

from gcs.console.engine.vehicle_details import vehicle_detail
from gcs.console.remote.messages import (
    NewsEncoder,
    decode_detail_request,
    decode_request,
    encode_detail,
)
from gcs.console.source import UnknownVehicleError
from gcs.console.view.feed import Feed
from gcs.core.engine import Engine
from gcs.errors import WireError
from gcs.io.background_writer import BackgroundWriter
from gcs.io.event_loop import on_loop
from gcs.io.zenoh.key_expressions import console_feed_key, console_vehicle_key
from gcs.io.zenoh.session import ZenohSession

_MAX_WAITING: Final = 64
"""Answers that wait for their turn; more are dropped, and asked for again."""
_MAX_PER_S: Final = 400
"""Queries a second, of all consoles; one with a page asks ten times a second."""

Reply = Callable[[bytes], None]


class ConsoleAnswers:
    """Answers the queries of consoles, from construction on; made on the loop of the service."""

    def __init__(self, bus: ZenohSession, engine: Engine, feed: Feed) -> None:
        self._engine = engine
        self._feed = feed
        self._encoder = NewsEncoder()
        self._writer = BackgroundWriter("console", _MAX_WAITING)
        self._loop = asyncio.get_running_loop()
        self._second = 0
        self._answered = 0
        mission = engine.config.name
        bus.answer(console_feed_key(mission), self._on_loop(self._answer_news))
        bus.answer(console_vehicle_key(mission, "*"), self._on_loop(self._answer_detail))

    def _on_loop(self, answer: Callable[[str, bytes, Reply], None]) -> Callable[[str, bytes, Reply], None]:
        """Return a function that hands a query to the loop; too many a second are not answered."""

        def hand_over(key: str, payload: bytes, reply: Reply) -> None:
            second = int(time.monotonic())
            self._answered = 1 if second != self._second else self._answered + 1
            self._second = second
            if self._answered <= _MAX_PER_S:
                on_loop(self._loop, answer, key, payload, reply)

        return hand_over

    def _answer_news(self, _key: str, payload: bytes, reply: Reply) -> None:
        with contextlib.suppress(WireError):  # not a console: no answer
            request = decode_request(payload)
            news = self._feed.pull(request)
            self._writer.put(lambda: reply(self._encoder.encode(news, request.capture)))

    def _answer_detail(self, key: str, payload: bytes, reply: Reply) -> None:
        name = key.rpartition("/")[2]
        if not self._feed.t_ns or not name.isdecimal():
            return
        try:
            verified = decode_detail_request(payload).verified
            detail = vehicle_detail(self._engine, int(name), self._feed.t_ns, verified)
        except UnknownVehicleError:
            detail = None
        except (WireError, ValueError):
            return
        self._writer.put(lambda: reply(encode_detail(detail)))
