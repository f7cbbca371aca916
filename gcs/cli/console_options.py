"""Options of the console: its address, which is printed here, who may open it, its socket, the browser.

Mistakes in the options end the command at once: the socket is opened here.
"""

from __future__ import annotations

import threading
import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rich.console import Console

from gcs.errors import ConsoleError

if TYPE_CHECKING:
    from gcs.console.web.console_access import Access
    from gcs.console.web.listener import Listener


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
            from gcs.console.web.console_access import parse_access

            parse_access(self.address, self.access)
        if self.map_file is not None:
            from gcs.console.web.tiles import Tiles

            Tiles(self.map_file)


DEFAULT_PAGE: Final = PageOptions()


def opened(options: PageOptions, console: Console) -> tuple[Access, Listener] | None:
    """Return who may open the console, and its socket; None without a console.

    A failure is an error only if an option asks for the console.
    """
    try:
        return open_listener(options)
    except ConsoleError as error:
        if options.is_asked_for:
            raise
        console.print(f"no console: {error}", style="yellow", highlight=False, markup=False, soft_wrap=True)
        return None


def open_listener(options: PageOptions) -> tuple[Access, Listener] | None:
    """Return who may open the console, and its socket; None for ``--console off``.

    Raises
    ------
    ConsoleError
        When it cannot be served as the options say.
    """
    from gcs.console.web.console_access import parse_access, tls_context
    from gcs.console.web.listener import bind

    access = parse_access(options.address, options.access)
    if access is None:
        return None
    if access.folder is not None:
        tls_context(access.folder)
    return access, bind(access)


def show_address(url: str, options: PageOptions, console: Console) -> None:
    """Print the address; open the browser, if that is wanted."""
    console.print(f"console: {url}", highlight=False, markup=False, soft_wrap=True)
    if options.opens_browser:  # A browser in a terminal would block.
        threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
