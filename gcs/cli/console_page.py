"""Console of `gcs demo`, `gcs run` and `gcs replay`: options, start and end."""

from __future__ import annotations

import threading
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rich.console import Console

from gcs.errors import ConsoleError

if TYPE_CHECKING:
    from gcs.cli.analyse.run_file import RunFile
    from gcs.console import ConsoleServer
    from gcs.console.server import Source
    from gcs.service.replay import Replay
    from gcs.service.service import Service


@dataclass(frozen=True, slots=True)
class PageOptions:
    """The options of the console."""

    address: str | None = None
    """HOST:PORT or "off"; None: the default address."""
    access: Path | None = None
    """Folder with certificate, key and tokens."""
    opens_browser: bool = False
    map_file: Path | None = None
    """MBTiles file under the map."""
    compares: bool = False
    """True if it compares two recordings, which nothing else shows."""

    @property
    def is_asked_for(self) -> bool:
        """True if an option asks for the console."""
        is_moved = self.access is not None or self.address not in (None, "off")
        return self.compares or self.opens_browser or self.map_file is not None or is_moved

    def check(self) -> None:
        """Check the options before a run begins.

        Raises
        ------
        ConsoleError
            For a text that is no address, an address that needs another access, a map that cannot be read.
        """
        if self.compares and self.address == "off":
            raise ConsoleError("--compare shows two recordings in the console; leave out --console off")
        if self.address not in (None, "off") or self.access is not None:
            from gcs.console.web.access import parse_access

            parse_access(self.address, self.access)
        if self.map_file is not None:
            from gcs.console.web.tiles import Tiles

            Tiles(self.map_file)


DEFAULT_PAGE: Final = PageOptions()


@contextmanager
def service_page(
    service: Service, options: PageOptions, console: Console, speed: float, mission_file: str | None = None
) -> Iterator[str]:
    """Serve the console of a live service while the context lasts; yield its address, empty without one.

    Parameters
    ----------
    mission_file : str, optional
        Mission file of a service whose vehicles `gcs preflight` can check.

    Raises
    ------
    ConsoleError
        When it cannot be served as the options say.
    """

    def source() -> Source:
        from gcs.console.server import Source
        from gcs.console.view.capture import Capture, capture
        from gcs.console.view.schema import ServiceState
        from gcs.model import NS_PER_S

        def take(t_ns: int) -> Capture:
            recorder = service.recorder
            stations = service.links.ground_stations(t_ns).values()
            state = ServiceState(
                lag_s=round(max(0.0, (service.clock.now_ns() - t_ns) / NS_PER_S / speed), 3),
                dropped=service.health.dropped,
                is_recording=recorder is not None,
                space=None if recorder is None else recorder.space,
                stations=tuple(one for found in stations for one in found),
            )
            return capture(service.engine, t_ns, state)

        return Source(service, take, service.give_order, speed, mission_file=mission_file)

    with _page(source, options, console) as server:
        if server is not None:
            service.outputs.append(server)
        yield _address(server)


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
    from gcs.console.server import Source
    from gcs.console.view.capture import capture

    return Source(
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
    server = _started(source, options, console, other)
    if server is None:
        yield None
        return
    console.print(f"console: {server.url}", highlight=False, markup=False, soft_wrap=True)
    if options.opens_browser:  # A browser in a terminal would block.
        threading.Thread(target=webbrowser.open, args=(server.url,), daemon=True).start()
    try:
        yield server
    finally:
        server.close()


def _started(
    source: Callable[[], Source],
    options: PageOptions,
    console: Console,
    other: Callable[[], Source] | None,
) -> ConsoleServer | None:
    """Return the server; None without one.

    A failure is an error only if an option asks for the console.
    """
    if options.address == "off":
        return None
    try:
        from gcs.console import ConsoleServer
        from gcs.console.web.access import parse_access
        from gcs.console.web.tiles import Tiles

        access = parse_access(options.address, options.access)
        tiles = None if options.map_file is None else Tiles(options.map_file)
        return None if access is None else ConsoleServer(source(), access, tiles, other and other())
    except (ConsoleError, ImportError) as error:
        if options.is_asked_for:
            raise ConsoleError(str(error)) from None
        console.print(f"no console: {error}", style="yellow", highlight=False, markup=False, soft_wrap=True)
        return None
