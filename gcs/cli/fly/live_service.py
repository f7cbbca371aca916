"""Service of `gcs run`, from its start to Ctrl-C."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import KW_ONLY, dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from rich.console import Console

from gcs.cli.console_page import DEFAULT_PAGE, PageOptions, service_page
from gcs.cli.link_table import link_rows, link_table
from gcs.cli.run_setup import display, open_recorder, warm_up
from gcs.config import Config, parse, read_text
from gcs.errors import ConfigError
from gcs.io.background_writer import QueuedText, off_loop
from gcs.io.clock import RunClock
from gcs.io.cluster.bridge_links import BridgeLinks
from gcs.io.recording.folder import Run
from gcs.io.recording.writer_thread import RecorderThread
from gcs.io.zenoh.discovery import announced
from gcs.io.zenoh.session import ZenohSession, service_bus
from gcs.mavlink.frames.fast_scan import Scanner
from gcs.report.run.summary import recording_facts
from gcs.service.bridge_start import bridge_of, bridge_of_command
from gcs.service.event_publisher import EventPublisher
from gcs.service.journal import Journal, JournalSink, fingerprint
from gcs.service.resume import default_path, resume_from_journal
from gcs.service.service import Service, fly_on_after_hangup, wait_for_interrupt
from gcs.service.standby import IgnoredLinks, Standby, TakeOver


def serve(
    scenario: str,
    seed: int,
    console: Console,
    *,
    headless: bool,
    out: Path | None,
    resume: bool | None,
    journal_path: Path | None,
    clock: RunClock,
    page: PageOptions = DEFAULT_PAGE,
    is_standby: bool = False,
) -> None:
    """Serve until interrupted; write a recording, and a journal to resume from.

    A standby first follows the service that commands, until that is gone.

    Raises
    ------
    ConfigError, LinkError
        When the mission file is wrong or a port cannot be opened.
    """
    page.check()
    text, source = read_text(scenario)
    config = parse(text, source)
    if is_standby and not config.links.standby:
        raise ConfigError(
            source,
            "links.standby",
            "expected the endpoint of the standby, such as "
            "tcp/127.0.0.1:7448; the same mission file is for all",
        )
    warm_up(console)
    connected = bridge_of_command if is_standby else bridge_of
    flight = _Flight(config, source, seed, console, clock, page, fingerprint(text, seed), headless=headless)
    name = f"{config.name}-{datetime.now(tz=UTC):%Y%m%d-%H%M%S}"
    with (
        off_loop(console) as view,
        connected(config, config.mavlink_links, config.links.key_file(source), Scanner()) as links,
    ):
        journal = Journal(journal_path or default_path(config.name), config.name, flight.fingerprint)
        record = partial(open_recorder, out, name, text, Run(config.name, seed), config.recording)
        asyncio.run(flight.run(links, record, journal, view, resume, is_standby=is_standby))


@dataclass(frozen=True)
class _Flight:
    """A service from its start to its end."""

    config: Config
    source: str
    seed: int
    console: Console
    clock: RunClock
    page: PageOptions
    fingerprint: str
    _: KW_ONLY
    headless: bool

    async def run(
        self,
        links: BridgeLinks,
        record: Callable[[], RecorderThread],
        journal: Journal,
        view: QueuedText,
        resume: bool | None,
        *,
        is_standby: bool,
    ) -> None:
        """Command until interrupted; as a standby, only when the service that commands is gone."""
        stop = asyncio.Event()
        at_once = asyncio.Event()
        undo = wait_for_interrupt(stop, at_once)
        undo_hangup = fly_on_after_hangup(view)
        try:
            with self._bus(is_standby=is_standby) as (bus, endpoint):
                taken = await self._follow(bus, links, stop) if is_standby else None
                if is_standby and taken is None:
                    return
                with announced(self.config.name, endpoint), record() as recorder:
                    service = Service(self.config, self.seed, links, bus)
                    if taken is None:
                        resume_from_journal(service, journal, resume, self.clock.now_ns(), self.console)
                    else:
                        service.resume(taken.snapshot, taken.state)
                    clock = self.clock if taken is None else taken.clock
                    await self._command(service, bus, recorder, journal, view, clock, stop, at_once)
                for name, value in recording_facts(str(recorder.folder)):
                    self._say(f"{name}: {value}")
                rows = link_rows(service.engine.stages.fleet, links, service.now_ns())
                self.console.print(link_table(rows))
        finally:
            undo()
            undo_hangup()

    @contextmanager
    def _bus(self, *, is_standby: bool) -> Iterator[tuple[ZenohSession, str]]:
        """Open the session of sensors, operators and standby; yield it, and the endpoint for orders."""
        table = self.config.links
        if not is_standby:
            with service_bus(table.zenoh_role, table.zenoh) as found:
                yield found
            return
        with ZenohSession(listen=table.standby, connect=table.zenoh) as bus:
            yield bus, table.standby

    async def _follow(self, bus: ZenohSession, links: BridgeLinks, stop: asyncio.Event) -> TakeOver | None:
        """Follow the service that commands; return where to go on, or None if it ended in order."""
        standby = Standby(
            self.config, self.seed, bus, self.fingerprint, lambda text: self._say(f"standby: {text}")
        )
        links.start(asyncio.get_running_loop(), IgnoredLinks(), lambda _: False)
        self._say(f"standby for {self.config.links.zenoh}; Ctrl-C ends it")
        taken = await standby.follow(links, stop)
        self._say("standby: command has ended" if taken is None else "standby: takes over")
        return taken

    async def _command(
        self,
        service: Service,
        bus: ZenohSession,
        recorder: RecorderThread,
        journal: Journal,
        view: QueuedText,
        clock: RunClock,
        stop: asyncio.Event,
        at_once: asyncio.Event,
    ) -> None:
        """Command, with a recording, a journal, a console and a display."""
        links = service.links
        keeper = JournalSink(service, journal)
        publisher = EventPublisher(service, bus, self.fingerprint)
        service.recorder = recorder
        service.outputs += [view.writer, recorder.writer, keeper.writer, publisher.writer]
        if isinstance(links, BridgeLinks):
            service.outputs.append(links)
        service.sinks += [keeper, publisher]
        names = ", ".join(link.name for link in links.links)
        self._say(f"MAVLink on {names}; zenoh on {self.config.links.zenoh}; Ctrl-C ends it")
        with service_page(service, self.page, self.console, clock.speed, self.source) as url:
            async with display(
                service, self.console, speed=clock.speed, headless=self.headless, page_url=url
            ):
                await service.run(clock, stop, at_once=at_once)
        publisher.close()
        keeper.write(service.now_ns())
        keeper.close()

    def _say(self, text: str) -> None:
        self.console.print(text, highlight=False, markup=False, soft_wrap=True)
