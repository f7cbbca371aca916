"""Run in this process, for the console: a replay."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

from gcs.config import Config
from gcs.console.engine.captures import mission_info
from gcs.console.engine.vehicle_details import vehicle_detail
from gcs.console.source import Source
from gcs.console.view.capture import Capture
from gcs.console.view.feed import Feed
from gcs.console.view.news import News, NewsRequest
from gcs.console.view.page_records import RunInfo, VehicleDetail
from gcs.console.web.playback_control import Playback
from gcs.core.engine import Engine

T = TypeVar("T")

_ANSWER_S: Final = 1.0
"""Time in which the loop of the run answers."""


class DisplayedRun(Protocol):
    """A service or a replay, as far as the console needs it."""

    config: Config
    engine: Engine
    sinks: list[Any]


def feed_of(run: DisplayedRun, info: RunInfo, take: Callable[[int], Capture], start_t_ns: int | None) -> Feed:
    """Return the feed of a run, among its sinks."""
    # A replay that begins again has another fleet.
    feed = Feed(mission_info(run.config, info), take, lambda: run.engine.stages.fleet.states(), start_t_ns)
    run.sinks.append(feed)
    return feed


def local_source(
    run: DisplayedRun,
    take: Callable[[int], Capture],
    *,
    playback: Playback,
    title: str = "",
    on_restart: list[Callable[[], None]] | None = None,
    recording: Path | None = None,
    has_other_settings: bool = False,
    start_t_ns: int | None = None,
) -> Source:
    """Return what the console needs of a replay, called on its loop.

    Parameters
    ----------
    take : callable
        Returns a capture of the run at a time.
    on_restart : list of callable, optional
        Where to put what is called when the replay begins again at another time.
    start_t_ns : int, optional
        Start of the run; by default its first event.
    """
    loop = asyncio.get_running_loop()
    info = RunInfo(kind="replay", begun=str(time.time_ns()), title=title)
    feed = feed_of(run, info, take, start_t_ns)
    if on_restart is not None:
        on_restart.append(feed.restart)

    async def on_loop(function: Callable[[], T]) -> T | None:
        """Return the result of a function that is called on the loop of the run; None if it does not run."""
        if loop.is_closed():
            return None

        async def call() -> T:
            return function()

        try:
            called = asyncio.run_coroutine_threadsafe(call(), loop)
            return await asyncio.wait_for(asyncio.wrap_future(called), _ANSWER_S)
        except (TimeoutError, RuntimeError):
            return None

    async def pull(request: NewsRequest) -> News | None:
        return await on_loop(lambda: feed.pull(request))

    async def detail(vehicle: int, verified: tuple[int, int]) -> VehicleDetail | None:
        if not feed.t_ns:
            return None
        return await on_loop(lambda: vehicle_detail(run.engine, vehicle, feed.t_ns, verified))

    return Source(
        mission=mission_info(run.config, info),
        pull=pull,
        detail=detail,
        playback=playback,
        call=loop.call_soon_threadsafe,
        recording=recording,
        has_other_settings=has_other_settings,
    )
