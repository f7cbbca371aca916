"""Service of `gcs run`, from its start to Ctrl-C."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console

from gcs.cli.console_page import DEFAULT_PAGE, PageOptions, service_page
from gcs.cli.link_table import link_rows, link_table
from gcs.cli.run_setup import display, open_recorder, warm_up
from gcs.config import Config, parse, read_text
from gcs.io.background_writer import QueuedText, off_loop
from gcs.io.clock import RunClock
from gcs.io.links.manager import Links
from gcs.io.recording.folder import Run
from gcs.io.recording.writer_thread import RecorderThread
from gcs.io.signing.link_signing import LinkSigning
from gcs.io.zenoh.discovery import announced
from gcs.io.zenoh.session import service_bus
from gcs.mavlink.frames.fast_scan import Scanner
from gcs.report.run.summary import recording_facts
from gcs.service.journal import Journal, JournalSink, fingerprint
from gcs.service.resume import default_path, resume_from_journal
from gcs.service.service import Service, fly_on_after_hangup, wait_for_interrupt


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
) -> None:
    """Serve until interrupted; write a recording, and a journal to resume from.

    Raises
    ------
    ConfigError, LinkError
        When the mission file is wrong or a port cannot be opened.
    """
    page.check()
    text, source = read_text(scenario)
    config = parse(text, source)
    warm_up(console)
    name = f"{config.name}-{datetime.now(tz=UTC):%Y%m%d-%H%M%S}"
    with (
        off_loop(console) as view,
        open_recorder(out, name, text, Run(config.name, seed), config.recording) as recorder,
    ):
        path = journal_path or default_path(config.name)
        journal = Journal(path, config.name, fingerprint(text, seed))
        signing = LinkSigning(config.mavlink_links, config.links.key_file(source))
        vehicles = [agent.vehicle for agent in config.agents]
        links = Links(config.mavlink_links, vehicles, config.local_frame, signing, Scanner())
        asyncio.run(
            _serve(
                config,
                source,
                seed,
                links,
                recorder,
                journal,
                console,
                view,
                clock,
                resume,
                page,
                headless=headless,
            )
        )
        for name, value in recording_facts(str(recorder.folder)):
            console.print(f"{name}: {value}", highlight=False, markup=False, soft_wrap=True)


async def _serve(
    config: Config,
    source: str,
    seed: int,
    links: Links,
    recorder: RecorderThread,
    journal: Journal,
    console: Console,
    view: QueuedText,
    clock: RunClock,
    resume: bool | None,
    page: PageOptions = DEFAULT_PAGE,
    *,
    headless: bool,
) -> None:
    stop, at_once = asyncio.Event(), asyncio.Event()
    undo, undo_hangup = wait_for_interrupt(stop, at_once), fly_on_after_hangup(view)
    table = config.links
    with (
        service_bus(table.zenoh_role, table.zenoh) as (bus, zenoh_endpoint),
        announced(config.name, zenoh_endpoint),
    ):
        service = Service(config, seed, links, bus)
        resume_from_journal(service, journal, resume, clock.now_ns(), console)
        keeper = JournalSink(service, journal)
        service.recorder = recorder
        service.outputs += [view.writer, recorder.writer, keeper.writer]
        service.sinks.append(keeper)
        console.print(
            f"MAVLink on {', '.join(link.name for link in links.links)}; zenoh on {config.links.zenoh}; "
            "Ctrl-C ends it",
            highlight=False,
        )
        async with (
            service_page(service, bus, zenoh_endpoint, page, console, clock.speed, source) as url,
            display(service, console, speed=clock.speed, headless=headless, page_url=url),
        ):
            await service.run(clock, stop, at_once=at_once)
        keeper.write(service.now_ns())
        keeper.close()
        console.print(link_table(link_rows(service.engine.stages.fleet, links, service.now_ns())))
    undo()
    undo_hangup()
