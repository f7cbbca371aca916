"""Two recordings side by side in the console, replayed at the same mission time."""

from __future__ import annotations

import asyncio
import itertools
from dataclasses import replace

from rich.console import Console

from gcs.cli.analyse.playback import ReplayOptions, duration_s, open_source
from gcs.cli.analyse.run_file import RunFile
from gcs.cli.replay_console import comparison_page
from gcs.cli.run_setup import warm_up
from gcs.cli.warm_up_progress import flying
from gcs.errors import ConsoleError, RecordingError
from gcs.io.recording.reader import Damage
from gcs.service.replay import Replay
from gcs.service.signals import wait_for_interrupt


def run_comparison(options: ReplayOptions, other: RunFile, console: Console) -> int:
    """Serve both recordings until the user interrupts; return the exit code.

    Raises
    ------
    ConsoleError
        For options that a comparison has no use for, or a console that cannot be served.
    RecordingError, ConfigError
        When a file cannot be read or has no events, or its mission or seed is missing.
    """
    if options.verify or options.headless or options.as_json:
        raise ConsoleError("--compare is for the console: leave out --verify, --headless and --json")
    options.page.check()
    both = options, replace(options, file=other)
    replays = linked_replays(both, console)
    warm_up(console, *flying(replays[0].config))
    asyncio.run(_play(replays, both, console))
    return 130


def linked_replays(both: tuple[ReplayOptions, ReplayOptions], console: Console) -> list[Replay]:
    """Return replays that stay at the same time, and at their ends.

    Raises
    ------
    RecordingError, ConfigError
        When a file cannot be read or has no events, or its mission or seed is missing.
    """
    replays = [_replay_of(one, console) for one in both]
    for one, peer in zip(replays, reversed(replays), strict=True):
        one.playback.peer = peer.playback
    return replays


def _replay_of(options: ReplayOptions, console: Console) -> Replay:
    source = open_source(options, console)
    path = options.file.path
    first = list(itertools.islice(source.records, 1))
    damage = first[0].value if first and isinstance(first[0].value, Damage) else None
    if damage is not None or not first:
        raise RecordingError(str(path), f"has no events to replay{f': {damage.problem}' if damage else ''}")
    replay = replace(source, records=itertools.chain(first, source.records)).replay(options.window)
    replay.playback.duration_s = duration_s(options, replay.start_t_ns)
    replay.playback.stays_at_end = True
    return replay


async def _play(replays: list[Replay], both: tuple[ReplayOptions, ...], console: Console) -> None:
    stop = asyncio.Event()
    undo = wait_for_interrupt(stop)
    files = [one.file for one in both]
    speed = both[0].speed or 1.0
    try:
        with comparison_page(list(zip(replays, files, strict=True)), both[0].page, console):
            await asyncio.gather(*(replay.run(stop, speed) for replay in replays))
    finally:
        undo()
