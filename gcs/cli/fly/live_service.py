"""Service of `gcs run`, from its start to Ctrl-C."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Final

from rich.console import Console

from gcs.cli.console_options import DEFAULT_PAGE, PageOptions
from gcs.cli.link_table import link_rows, link_table
from gcs.cli.run_setup import display, open_recorder, warm_up
from gcs.cli.service_console import service_page
from gcs.cli.warm_up_progress import flying
from gcs.cli.zenoh_security import zenoh_warnings
from gcs.config import Config, parse, read_text
from gcs.errors import ConfigError
from gcs.io.background_writer import QueuedText, off_loop
from gcs.io.clock import RunClock
from gcs.io.cluster.all_bridges import AllBridges
from gcs.io.event_loop import on_loop
from gcs.io.recording.folder import Run
from gcs.io.recording.recorder_thread import RecorderThread
from gcs.io.systemd import watched
from gcs.io.zenoh.discovery import announced
from gcs.io.zenoh.key_expressions import events_key
from gcs.io.zenoh.session import ZenohSession, from_this_machine, service_bus
from gcs.mavlink.frames.fast_scan import Scanner
from gcs.mistake_codes import MistakeCode
from gcs.report.run.summary import recording_facts
from gcs.service.bridge_connection import bridges_for_standby, bridges_of, is_bridge_of_other_node
from gcs.service.event_publisher import EventPublisher
from gcs.service.journal import Journal, JournalSink, fingerprint
from gcs.service.node_supervisor import is_supervised_by_system, supervise_node
from gcs.service.resume import default_path, resume_from_journal
from gcs.service.service import Service
from gcs.service.signals import fly_on_after_hangup, wait_for_interrupt
from gcs.service.standby import IgnoredLinks, Standby, TakeOver

_LEARN_S: Final = 5.0
"""Time in which a service of a mission with a standby learns who commands; a lease is decided in less."""
_LEARN_POLL_S: Final = 0.05
_CONNECT_S: Final = 1.5
"""Time in which the other node connects, which tries once a second."""
_GIVE_WAY_S: Final = 10.0
"""Time in which a standby starts a bridge again and takes over."""


@dataclass(frozen=True)
class RunStorage:
    """Where a run is recorded, and what it continues from."""

    recording: Path | None
    journal: Path | None
    """None: that of the mission's name, in the folder of the recordings."""
    resume: bool | None
    """True: resume from the journal. False: do not. None: if it is recent."""


def serve(
    scenario: str,
    seed: int,
    console: Console,
    *,
    headless: bool,
    storage: RunStorage,
    clock: RunClock,
    page: PageOptions = DEFAULT_PAGE,
    is_standby: bool = False,
) -> None:
    """Serve until interrupted; write a recording, and a journal to resume from.

    A standby first follows the service that commands, until that is gone. So does a service of a mission with
    a standby that commands by now.

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
            MistakeCode.MISSING_KEY,
            "expected the endpoint of the standby, such as "
            "tcp/127.0.0.1:7448; the same mission file is for all",
        )
    start = 1
    out = storage.recording
    if config.links.standby and not is_supervised_by_system():
        start = supervise_node(partial(_say_on, console))
        if out is not None and start > 1:
            out = out.with_name(f"{out.name}-{start}")
    warm_up(console, *flying(config))
    follows = is_standby or is_bridge_of_other_node(config, source, config.mavlink_links)
    connected = bridges_for_standby if follows else bridges_of
    journal = Journal(storage.journal or default_path(config.name), config.name, fingerprint(text, seed))
    name = f"{config.name}-{datetime.now(tz=UTC):%Y%m%d-%H%M%S}"
    with (
        off_loop(console) as view,
        connected(config, source, config.mavlink_links, Scanner(), journal.path.parent) as links,
    ):
        flight = _Flight(
            config=config,
            source=source,
            tls=config.links.tls_folder(source),
            seed=seed,
            console=console,
            view=view,
            links=links,
            record=partial(open_recorder, out, name, text, Run(config.name, seed), config.recording),
            journal=journal,
            fingerprint=journal.belongs_to,
            clock=clock,
            page=page,
            resume=storage.resume,
            headless=headless,
            is_standby=is_standby,
            is_started_again=start > 1,
        )
        asyncio.run(flight.run())


@dataclass(frozen=True, kw_only=True)
class _Flight:
    """A service from its start to its end."""

    config: Config
    source: str
    tls: Path | None
    """Folder of the certificate for zenoh."""
    seed: int
    console: Console
    view: QueuedText
    links: AllBridges
    record: Callable[[], RecorderThread]
    journal: Journal
    fingerprint: str
    clock: RunClock
    page: PageOptions
    resume: bool | None
    headless: bool
    is_standby: bool
    is_started_again: bool
    """True if this node ended by a fault before."""

    async def run(self) -> None:
        """Command until interrupted; as a standby, only when the service that commands is gone."""
        stop = asyncio.Event()
        at_once = asyncio.Event()
        undo = wait_for_interrupt(stop, at_once)
        undo_hangup = fly_on_after_hangup(self.view)
        try:
            with self._bus() as (bus, endpoint):
                for warning in zenoh_warnings(self.config.links, bus.node):
                    self.console.print(warning, style="yellow", highlight=False, markup=False, soft_wrap=True)
                async with watched():
                    follows = self.is_standby or await self._is_commanded(bus, stop)
                    taken = await self._follow(bus, stop) if follows else None
                    if taken is not None or not follows:
                        with announced(self.config.name, endpoint, self.tls):
                            await self._command(bus, endpoint, taken, stop, at_once)
        finally:
            undo()
            undo_hangup()

    @contextmanager
    def _bus(self) -> Iterator[tuple[ZenohSession, str]]:
        """Open the session of sensors, operators and standby; yield it, and the endpoint for orders."""
        table = self.config.links
        if not self.is_standby:
            with service_bus(table.zenoh_role, table.zenoh, self.tls) as found:
                yield found
            return
        with ZenohSession(listen=table.standby, connect=table.zenoh, tls=self.tls) as bus:
            yield bus, from_this_machine(table.standby)

    async def _is_commanded(self, bus: ZenohSession, stop: asyncio.Event) -> bool:
        """Return True if the mission has a standby, and that commands: it has taken over before."""
        if not self.config.links.standby:
            return False
        if self.is_started_again and await self._gives_way(bus):
            return True
        self.links.start(asyncio.get_running_loop(), IgnoredLinks())
        until_s = monotonic() + _LEARN_S
        while monotonic() < until_s and not stop.is_set() and not self.links.may_command():
            if self.links.commander():
                return True
            self.links.ask_for_lease()
            await asyncio.sleep(_LEARN_POLL_S)
        return False

    async def _gives_way(self, bus: ZenohSession) -> bool:
        """Give a standby that is there time to take over: its state is newer than the journal.

        Return True if it commands.
        """
        loop = asyncio.get_running_loop()
        key = events_key(self.config.name)
        await asyncio.sleep(_CONNECT_S)
        if not bus.is_subscribed(key):
            return False
        heard = asyncio.Event()
        end = bus.subscribe(key, lambda *_: on_loop(loop, heard.set))
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(heard.wait(), _GIVE_WAY_S)
        end()
        return heard.is_set()

    async def _follow(self, bus: ZenohSession, stop: asyncio.Event) -> TakeOver | None:
        """Follow the service that commands; return where to go on, or None if it ended in order."""
        standby = Standby(self.config, self.seed, bus, self.fingerprint, self._say)
        self.links.start(asyncio.get_running_loop(), IgnoredLinks())
        other = self.config.links.zenoh if self.is_standby else self.config.links.standby
        self._say(f"standby of {other}; Ctrl-C ends it")
        taken = await standby.follow(self.links, stop)
        if taken is None:
            self._say("ends" if stop.is_set() else "command has ended")
        elif taken.is_newest:
            self._say("takes over")
        else:
            self._say("takes over with a state that is older than that of command: orders may be missing")
        return taken

    async def _command(
        self,
        bus: ZenohSession,
        endpoint: str,
        taken: TakeOver | None,
        stop: asyncio.Event,
        at_once: asyncio.Event,
    ) -> None:
        """Command, with a recording, a journal, a console and a display."""
        service = Service(self.config, self.seed, self.links, bus)
        clock = self.clock
        if taken is not None:
            clock = taken.clock
        if taken is None or not self._resume(service, taken):
            resume_from_journal(service, self.journal, self.resume, clock.now_ns(), self.console)
        keeper = JournalSink(service, self.journal)
        publisher = EventPublisher(service, bus, self.fingerprint)
        with self.record() as recorder:
            service.recorder = recorder
            service.outputs += [
                self.view.writer,
                recorder.writer,
                keeper.writer,
                publisher.writer,
                publisher,
                self.links,
                *self.links.bridges,
            ]
            service.sinks += [keeper, publisher]
            names = ", ".join(link.name for link in self.links.links)
            self._say(f"MAVLink on {names}; zenoh on {endpoint}; Ctrl-C ends it")
            speed = clock.speed
            async with (
                service_page(service, bus, endpoint, self.page, self.console, speed, self.source) as url,
                display(service, self.console, speed=speed, headless=self.headless, page_url=url),
            ):
                await service.run(clock, stop, at_once=at_once)
            publisher.close()
            keeper.write(service.now_ns())
            keeper.close()
            rows = link_rows(service.engine.stages.fleet, self.links, service.now_ns())
            self.console.print(link_table(rows))
        for name, value in recording_facts(str(recorder.folder)):
            self._say(f"{name}: {value}")

    def _resume(self, service: Service, taken: TakeOver) -> bool:
        """Continue from the state of a standby; return False if it makes no sense."""
        try:
            service.resume(taken.snapshot, taken.state)
        except ValueError as error:
            self._say(f"the state of the standby is not used: {error}")
            return False
        return True

    def _say(self, text: str) -> None:
        _say_on(self.console, text)


def _say_on(console: Console, text: str) -> None:
    console.print(text, highlight=False, markup=False, soft_wrap=True)
