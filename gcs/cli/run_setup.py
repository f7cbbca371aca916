"""Set-up of a run for `gcs demo`, `gcs run`, `gcs replay`: display, recorder, kernels, garbage collection."""

from __future__ import annotations

import asyncio
import gc
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final, Protocol

from rich.console import Console
from rich.live import Live

from gcs.cli.live_view import LiveView, PlainLines
from gcs.cli.warm_up_progress import load_kernels
from gcs.config import Config
from gcs.config.schema import RecordingTable
from gcs.core.engine import Engine
from gcs.io.background_writer import is_busy
from gcs.io.links.vehicle_links import VehicleLinks
from gcs.io.private_files import new_folder
from gcs.io.recording.folder import RUNS_FOLDER, Run, remove_empty, versions
from gcs.io.recording.recorder import DiskBudget, Recorder
from gcs.io.recording.recorder_thread import RecorderThread
from gcs.io.terminal import Printable, console_for
from gcs.service.sinks import Sink

_REFRESH_S: Final = 0.25
_GC_THRESHOLD: Final = 100_000
"""Objects allocated between garbage collections in flight: fewer than at start-up, for short pauses."""


class DisplayedRun(Protocol):
    """A live service or a replay, as far as the display needs it."""

    config: Config
    engine: Engine
    sinks: list[Sink]

    @property
    def links(self) -> VehicleLinks | None:
        """The links of a live service; None in a replay."""


@asynccontextmanager
async def display(
    run: DisplayedRun,
    console: Console,
    *,
    speed: float,
    headless: bool,
    page_url: str = "",
    start_t_ns: int | None = None,
) -> AsyncIterator[None]:
    """Show a run while the context lasts: a live view in a terminal that can draw, else plain lines.

    The live view names the address of the console, `page_url`. Times count from `start_t_ns`, by default the
    first event.
    """
    if headless or not console.is_terminal or console.is_dumb_terminal:
        run.sinks.append(PlainLines(console, start_t_ns))
        yield
        return
    view = LiveView(run.config, run.engine, speed, run.links, page_url, start_t_ns)
    run.sinks.append(view)
    with Live(
        Printable(view), console=console, screen=True, auto_refresh=False, vertical_overflow="crop"
    ) as live:
        refresher = asyncio.create_task(_refresh(live))
        try:
            yield
        finally:
            refresher.cancel()


async def _refresh(live: Live) -> None:
    """Draw on the event loop, between events: a thread would read state while it changes.

    A slow terminal loses frames and does not delay the service.
    """
    while True:
        if not is_busy(live.console):
            live.refresh()
        await asyncio.sleep(_REFRESH_S)


def open_recorder(
    out: Path | None, name: str, config_text: str, run: Run, table: RecordingTable
) -> RecorderThread:
    """Start a recording in `out`, or in a new folder under ``runs/``.

    An empty recording in `out`, as a SIGKILL at start-up leaves it, is replaced with a message.

    Raises
    ------
    RecordingError
        When the folder cannot be written, or has a recording already.
    """
    folder = out if out is not None else new_folder(RUNS_FOLDER, name)
    if _remove_empty(folder):
        text = f"{folder} had an empty recording of a run that was killed at its start; it was replaced"
        console_for(stderr=True).print(text, highlight=False, markup=False, soft_wrap=True)
    budget = DiskBudget(int(table.rotate_mb * 1e6), table.max_gb * 1e9, table.min_free_mb * 1e6)
    return RecorderThread(Recorder(folder, config_text, versions(), run, budget))


def _remove_empty(folder: Path) -> bool:
    try:
        return remove_empty(folder)
    except OSError:
        return False  # The recorder reports the error.


def warm_up(console: Console, *modules: str) -> None:
    """Load the kernels of modules, by default those of a flight, and tune the garbage collector."""
    load_kernels(console, *modules)
    gc.collect()
    gc.freeze()  # Objects loaded so far stay: exclude them from later collections.
    gc.set_threshold(_GC_THRESHOLD, *gc.get_threshold()[1:])
