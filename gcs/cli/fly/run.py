"""`gcs run`: central command alone, on the links that the mission file names."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console

from gcs.cli.link_table import link_rows, link_table
from gcs.cli.outputs import open_recorder, view_for, warm_up
from gcs.config import Config, parse, read_text
from gcs.io.clock import RunClock
from gcs.io.links.manager import Links
from gcs.io.output import QueuedText, off_loop
from gcs.io.recording.folder import Run
from gcs.io.recording.writer_thread import RecorderThread
from gcs.io.signing.gate import Signing
from gcs.io.zenoh.discovery import announced
from gcs.io.zenoh.session import service_bus
from gcs.service.journal import Journal, fingerprint
from gcs.service.resume import JournalSink, default_path, take_up
from gcs.service.service import Service, fly_on_after_hangup, wait_for_interrupt


@dataclass(frozen=True, slots=True)
class ServeOptions:
    """What the command line says."""

    scenario: str
    seed: int
    headless: bool
    out: Path | None
    resume: bool | None
    journal: Path | None
    clock: RunClock


def serve(options: ServeOptions, console: Console) -> None:
    """Serve until interrupted; leaves a recording, and a journal to resume from.

    Raises
    ------
    ConfigError, LinkError
        When the mission file is wrong or a port cannot be had.
    """
    text, source = read_text(options.scenario)
    config = parse(text, source)
    warm_up(console)
    name, run = f"{config.name}-{datetime.now(tz=UTC):%Y%m%d-%H%M%S}", Run(config.name, options.seed)
    with (
        off_loop(console) as view,
        open_recorder(options.out, name, text, run, config.recording) as recorder,
    ):
        journal = Journal(
            options.journal or default_path(config.name), config.name, fingerprint(text, options.seed)
        )
        signing = Signing(config.mavlink_links, config.links.key_file(source), kernel=True)
        asyncio.run(_serve(config, options, signing, recorder, journal, console, view))
        console.print(f"recording: {recorder.folder}", highlight=False, markup=False, soft_wrap=True)


async def _serve(
    config: Config,
    options: ServeOptions,
    signing: Signing,
    recorder: RecorderThread,
    journal: Journal,
    console: Console,
    view: QueuedText,
) -> None:
    vehicles = [agent.vehicle for agent in config.agents]
    links = Links(config.mavlink_links, vehicles, config.local_frame, signing)
    stop, at_once = asyncio.Event(), asyncio.Event()
    undo, undo_hangup = wait_for_interrupt(stop, at_once), fly_on_after_hangup(view)
    table = config.links
    with service_bus(table.zenoh_role, table.zenoh) as (bus, door), announced(config.name, door):
        service = Service(config, options.seed, links, bus)
        take_up(service, journal, options.resume, options.clock.now_ns(), console)
        keeper = JournalSink(service, journal)
        service.recorder = recorder
        service.outputs += [view.writer, recorder.writer, keeper.writer]
        service.sinks.append(keeper)
        console.print(
            f"MAVLink on {', '.join(link.name for link in links.links)}; zenoh on {config.links.zenoh}; "
            "Ctrl-C ends it",
            highlight=False,
        )
        async with view_for(service, console, speed=options.clock.speed, headless=options.headless):
            await service.run(options.clock, stop, at_once=at_once)
        keeper.write(options.clock.now_ns())
        keeper.close()
        console.print(link_table(link_rows(service.command.fleet, links, service.now_ns())))
    undo()
    undo_hangup()
