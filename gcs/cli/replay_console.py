"""Console of `gcs replay`: the page of one replay, or of two beside each other, in this process."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

from rich.console import Console

if TYPE_CHECKING:
    from gcs.cli.analyse.run_file import RunFile
    from gcs.console.server import ConsoleServer
    from gcs.console.source import Source
    from gcs.service.replay import Replay
from gcs.cli.console_options import PageOptions, opened, show_address


@contextmanager
def replay_page(replay: Replay, options: PageOptions, console: Console, file: RunFile) -> Iterator[str]:
    """Serve the console of a replay while the context lasts; yield its address, empty without one.

    Raises
    ------
    ConsoleError
        When it cannot be served as the options say.
    """
    with _page(lambda: replay_source(replay, file), options, console) as server:
        yield _address(server)


def _address(server: ConsoleServer | None) -> str:
    return "" if server is None else server.url


@contextmanager
def comparison_page(
    runs: Sequence[tuple[Replay, RunFile]], options: PageOptions, console: Console
) -> Iterator[None]:
    """Serve the console of two replays while the context lasts.

    Raises
    ------
    ConsoleError
        When it cannot be served as the options say.
    """
    first, other = (partial(replay_source, *run) for run in runs)
    with _page(first, options, console, other):
        yield


def replay_source(replay: Replay, file: RunFile) -> Source:
    """Return what the console needs of the replay of a file."""
    from gcs.console.engine.captures import capture
    from gcs.console.engine.replay_run import local_source

    return local_source(
        replay,
        lambda t_ns: capture(replay.engine, t_ns),
        playback=replay.playback,
        on_restart=replay.on_restart,
        recording=file.path if file.is_recording() else None,
        has_other_settings=file.has_other_settings,
        title=file.title,
        start_t_ns=replay.start_t_ns,
    )


@contextmanager
def _page(
    source: Callable[[], Source],
    options: PageOptions,
    console: Console,
    other: Callable[[], Source] | None = None,
) -> Iterator[ConsoleServer | None]:
    found = opened(options, console)
    if found is None:
        yield None
        return
    from gcs.console.server import ConsoleServer
    from gcs.console.web.tiles import Tiles

    tiles = None if options.map_file is None else Tiles(options.map_file)
    server = ConsoleServer(source(), found[0], tiles, other and other(), found[1])
    show_address(server.url, options, console)
    try:
        yield server
    finally:
        server.close()
