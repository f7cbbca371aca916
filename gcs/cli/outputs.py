"""What several commands share: recorder, view, judge."""

from __future__ import annotations

import asyncio
import gc
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Protocol

from rich.console import Console
from rich.live import Live

from gcs.cli.live_view import LiveView, PlainLines
from gcs.cli.warm_up_progress import load_kernels
from gcs.config import Config
from gcs.config.tables import RecordingTable
from gcs.core.airspace.obstacle_map import mission_grid
from gcs.core.engine import Engine
from gcs.io.console import Printable, console_for
from gcs.io.links.manager import Links
from gcs.io.output import is_busy
from gcs.io.private_files import new_folder
from gcs.io.recording.folder import Run, remove_empty, versions
from gcs.io.recording.reader import read
from gcs.io.recording.writer import DiskBudget, Recorder
from gcs.io.recording.writer_thread import RecorderThread
from gcs.model import Effect, Event
from gcs.report.run.evaluation import Evaluator
from gcs.service.service import Sink

_REFRESH_S = 0.25
_COLLECT_AFTER = 100_000
"""Objects allocated between garbage collections in flight: fewer than in a start, for short pauses."""


class EvaluatorSink:
    """Feeds the judge."""

    def __init__(self, judge: Evaluator) -> None:
        self._judge = judge

    def event(self, event: Event) -> None:
        """Events say nothing that the judge needs."""

    def effect(self, _t_ns: int, effect: Effect) -> None:
        """Keep an effect, to hold it against the truth."""
        self._judge.effect(effect)


class Shown(Protocol):
    """What a view needs of a run: a live service, or a replay."""

    config: Config
    command: Engine
    sinks: list[Sink]

    @property
    def links(self) -> Links | None:
        """None in a replay."""


@asynccontextmanager
async def view_for(run: Shown, console: Console, *, speed: float, headless: bool) -> AsyncIterator[None]:
    """Show a run while it lasts: live where there is a terminal that can draw, plain lines elsewhere."""
    if headless or not console.is_terminal or console.is_dumb_terminal:
        run.sinks.append(PlainLines(console))
        yield
        return
    view = LiveView(run.config, run.command, speed, run.links)
    run.sinks.append(view)
    shown = Printable(view)
    with Live(shown, console=console, screen=True, auto_refresh=False, vertical_overflow="crop") as live:
        refresher = asyncio.create_task(_refresh(live))
        try:
            yield
        finally:
            refresher.cancel()


async def _refresh(live: Live) -> None:
    """Draw on the event loop, between events: a thread would read state while it changes.

    A terminal that has not taken the last frame gets no other: it loses frames, and nothing else.
    """
    while True:
        if not is_busy(live.console):
            live.refresh()
        await asyncio.sleep(_REFRESH_S)


def open_recorder(
    out: Path | None, name: str, config_text: str, run: Run, table: RecordingTable
) -> RecorderThread:
    """Start a recording in `out`, or in a new folder under ``runs/``.

    One in `out` that ended before its first record, as after a SIGKILL, is replaced, and that is said.

    Raises
    ------
    RecordingError
        When the folder cannot be written, or holds a recording already.
    """
    folder = out if out is not None else new_folder(Path("runs"), name)
    if _remove_empty(folder):
        text = f"{folder} held an empty recording, of a run that was killed at its start: replaced"
        console_for(stderr=True).print(text, highlight=False, markup=False, soft_wrap=True)
    room = DiskBudget(int(table.rotate_mb * 1e6), table.max_gb * 1e9, table.min_free_mb * 1e6)
    return RecorderThread(Recorder(folder, config_text, versions(), run, room))


def _remove_empty(folder: Path) -> bool:
    try:
        return remove_empty(folder)
    except OSError:
        return False  # the recorder says what is wrong


def draw_recording(folder: Path, config: Config, seed: int) -> Path:
    """Draw the picture of a recorded run into its folder; return the file."""
    from gcs.report.plots.figures import draw_run
    from gcs.report.plots.maps import Ground

    ground = Ground.of(mission_grid(config, seed))
    picture = folder / "run.png"
    draw_run(
        (record.value for record in read(folder)),
        picture,
        obstacles_m=ground.obstacles_m,
        cell_m=ground.cell_m,
        title=f"{config.name}, seed {seed}",
    )
    return picture


def warm_up(console: Console, *rooms: str) -> None:
    """Have the kernels of rooms, or all that fly, ready, and memory in order, before a run begins."""
    load_kernels(console, *rooms)
    gc.collect()
    gc.freeze()  # what is loaded by now stays: the collector need not look through it again and again
    gc.set_threshold(_COLLECT_AFTER, *gc.get_threshold()[1:])
