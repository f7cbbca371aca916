"""Connection of `gcs tak` to TAK, by pytak. It is made again when it breaks; events in between are lost."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import signal
import time
import warnings
from collections.abc import Iterator
from configparser import ConfigParser
from typing import Any, Final

from rich.console import Console

from gcs.cli.following import frame_of, news_of
from gcs.console.source import Source
from gcs.console.view.news import News
from gcs.errors import ConfigError, GcsError
from gcs.mistake_codes import MistakeCode
from gcs.model import Order
from gcs.report.export.cot import CotEvents, CotStyle, Now
from gcs.report.operator_lines import effect_notice

_PERIOD_S: Final = 1.0
_ROUTES_S: Final = 10.0
"""Between repetitions of the routes: displays that start later get them, too."""
_SEND_S: Final = 10.0
"""Time in which TAK must take an event."""
_RETRY_S: Final = 5.0
_READ_BYTES: Final = 65536
_URL: Final = re.compile(r"(udp|udp\+broadcast|tcp|tls)://[^/\s]+:\d{1,5}$")


class TakLink:
    """Connection to TAK.

    Raises
    ------
    GcsError
        When the URL is wrong, or pytak is not installed.
    """

    def __init__(self, url: str) -> None:
        if not _URL.match(url):
            raise ConfigError(
                url,
                "",
                MistakeCode.WRONG_TYPE,
                "expected tcp://HOST:PORT, tls://HOST:PORT or udp://HOST:PORT",
            )
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # about parts that are not used
                import pytak
        except ImportError:
            raise GcsError("gcs tak needs pytak: pip install 'swarm-gcs[tak]'") from None
        self._pytak = pytak
        self._url = url
        parser = ConfigParser(interpolation=None)
        settings = {name: value for name, value in os.environ.items() if name.startswith("PYTAK_")}
        is_datagram = url.startswith("udp")
        parser["tak"] = settings | {"COT_URL": url.replace("://", "+wo://", 1) if is_datagram else url}
        parser["tak"]["TAK_PROTO"] = "0"  # XML, which every version reads
        self._config = parser["tak"]

    def serve(self, source: Source, style: CotStyle, console: Console, *, has_alarms: bool) -> None:
        """Send what the service shows, until Ctrl-C."""

        def say(text: str, style: str = "") -> None:
            console.print(text, style=style, highlight=False, markup=False, soft_wrap=True)

        events = _Events(source, style, has_alarms=has_alarms)

        async def run() -> None:
            ends = asyncio.Event()
            for number in (signal.SIGINT, signal.SIGTERM):
                asyncio.get_running_loop().add_signal_handler(number, ends.set)
            sending = asyncio.create_task(self._send(source, events, say))
            ended = asyncio.create_task(ends.wait())
            await asyncio.wait({sending, ended}, return_when=asyncio.FIRST_COMPLETED)
            for task in (sending, ended):
                task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await sending

        asyncio.run(run())

    async def _send(self, source: Source, events: _Events, say: Any) -> None:
        """Send for ever; connect again when the connection breaks."""
        is_down = False
        while True:
            try:
                async with asyncio.timeout(_SEND_S):
                    reader, writer = await self._pytak.protocol_factory(self._config)
            except SyntaxError as error:  # pytak's error for wrong settings, TLS files among them
                raise GcsError(f"{self._url}: {error}") from None
            except (OSError, TimeoutError) as error:
                if not is_down:
                    say(f"no connection to {self._url}: {error or 'timeout'}; trying again", "yellow")
                is_down = True
                await asyncio.sleep(_RETRY_S)
                continue
            is_down = False
            say(f"{source.mission.name}: sending to {self._url}; Ctrl-C ends it")
            reading = asyncio.create_task(_discard(reader))
            try:
                worker = self._pytak.TXWorker(asyncio.Queue(), self._config, writer)
                async for news in news_of(source, _PERIOD_S):
                    for event in events.of(news):
                        async with asyncio.timeout(_SEND_S):
                            await worker.send_data(event)
                    if reading.done():
                        raise ConnectionError("it was closed")
            except (OSError, TimeoutError) as error:
                say(f"lost the connection to {self._url}: {error or 'timeout'}", "yellow")
            finally:
                reading.cancel()
                writer.close()
            await asyncio.sleep(_RETRY_S)


class _Events:
    """Events of a service's news."""

    def __init__(self, source: Source, style: CotStyle, *, has_alarms: bool) -> None:
        self._cot = CotEvents(source.mission.name, frame_of(source.mission), style)
        self._has_alarms = has_alarms
        self._is_begun = False
        self._routes: Any = None
        self._routes_s = 0.0

    def of(self, news: News) -> Iterator[bytes]:
        """Yield the events of news. Alarms from before the start are left out."""
        now = Now(news.t_ns, time.time_ns())
        capture = news.capture
        if capture is not None:
            yield from self._cot.vehicles(capture.status, now)
        for picture in news.pictures:
            if picture.kind == "targets":
                yield from self._cot.targets(picture, now)
        if capture is not None:
            is_changed = capture.routes is not self._routes
            if is_changed or time.monotonic() - self._routes_s > _ROUTES_S:
                self._routes = capture.routes
                self._routes_s = time.monotonic()
                yield from self._cot.routes(capture.routes, now)
        if self._has_alarms and self._is_begun:
            for _, effect in news.effects:
                notice = None if isinstance(effect, Order) else effect_notice(effect)
                if notice is not None:
                    yield from self._cot.alarm(notice, now)
        self._is_begun = True


async def _discard(reader: Any) -> None:
    """Read what comes in until the end; a server that sends must not wait. Datagrams are not received."""
    if reader is None:
        await asyncio.Event().wait()
    while await reader.read(_READ_BYTES):
        pass
