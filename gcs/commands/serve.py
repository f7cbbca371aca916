"""`gcs run`: central command alone, on the links that the mission file names."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console

from gcs.app import Service, wait_for_interrupt
from gcs.commands.sinks import RecorderSink, open_recorder, view_for, warm_up
from gcs.config import Config, parse, read_text
from gcs.edge.clock import RunClock
from gcs.edge.recorder import Recorder, Run
from gcs.edge.udp import UdpLink
from gcs.edge.whereabouts import announced
from gcs.edge.zenoh_bus import Bus


def serve(scenario: str, seed: int, console: Console, *, headless: bool, out: Path | None) -> None:
    """Serve until interrupted; leaves a recording.

    Raises
    ------
    ConfigError, LinkError
        When the mission file is wrong or a port cannot be had.
    """
    text, source = read_text(scenario)
    config = parse(text, source)
    warm_up(console)
    name, run = f"{config.name}-{datetime.now(tz=UTC):%Y%m%d-%H%M%S}", Run(config.name, seed)
    with open_recorder(out, name, text, run, config.recording.rotate_mb) as recorder:
        asyncio.run(_serve(config, seed, recorder, console, headless=headless))
        console.print(f"recording: {recorder.folder}", highlight=False)


async def _serve(config: Config, seed: int, recorder: Recorder, console: Console, *, headless: bool) -> None:
    link = UdpLink(config.links.mavlink)
    stop = asyncio.Event()
    undo = wait_for_interrupt(stop)
    role = {config.links.zenoh_role: config.links.zenoh}
    with Bus(**role) as bus, announced(config.name, config.links.zenoh):
        service = Service(config, seed, link, bus)
        service.sinks += [RecorderSink(recorder)]
        console.print(
            f"listening on {config.links.mavlink} and zenoh {config.links.zenoh}; Ctrl-C ends it",
            highlight=False,
        )
        async with view_for(service, console, speed=1.0, headless=headless):
            await service.run(RunClock(), stop)
    undo()
