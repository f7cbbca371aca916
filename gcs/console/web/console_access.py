"""Access to the console: its address and port, its tokens, and TLS.

On a loopback address everybody on this machine may operate, as over zenoh. Any other address needs a folder
with a TLS certificate and a token.
"""

from __future__ import annotations

import hmac
import ipaddress
import socket
import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gcs.console.view.page_records import Role
from gcs.errors import ConsoleError
from gcs.files import read_bytes

DEFAULT_HOST: Final = "127.0.0.1"
DEFAULT_PORT: Final = 8480
CERTIFICATE = "cert.pem"
KEY = "key.pem"
OPERATE = "operate.token"
VIEW = "view.token"
_MIN_TOKEN: Final = 16
_MAX_BYTES: Final = 64 * 1024


@dataclass(frozen=True, slots=True)
class Access:
    """Address of the console, and who may use it there."""

    host: str = DEFAULT_HOST
    port: int | None = None
    """None: the default port, or the next free one."""
    operate_token: str = ""
    view_token: str = ""
    folder: Path | None = None
    """Folder with certificate and key; None: plain HTTP."""

    @property
    def needs_token(self) -> bool:
        """True if each request must have a token."""
        return bool(self.operate_token)

    @property
    def scheme(self) -> str:
        """Scheme of the URL."""
        return "http" if self.folder is None else "https"

    def url(self, port: int) -> str:
        """Return the address for a browser."""
        host = self.host
        if host in ("0.0.0.0", "::"):  # noqa: S104  not an address that a browser opens
            host = socket.gethostname()
        host = f"[{host}]" if ":" in host else host
        return f"{self.scheme}://{host}:{port}/"

    def role(self, token: str) -> Role | None:
        """Return the role of a token; None for a wrong one."""
        if not self.needs_token:
            return "operate"
        given = token.encode()
        if hmac.compare_digest(given, self.operate_token.encode()):
            return "operate"
        if self.view_token and hmac.compare_digest(given, self.view_token.encode()):
            return "view"
        return None


def parse_access(text: str | None, folder: Path | None) -> Access | None:
    """Return the access that ``--console`` and ``--console-access`` name; None for `off`.

    Raises
    ------
    ConsoleError
        For a text that is no address, and for an address other than loopback without token and TLS.
    """
    if text == "off":
        return None
    host, port = _address(text) if text else (DEFAULT_HOST, None)
    if folder is None:
        if not _is_loopback(host):
            raise ConsoleError(
                f"console: {host} can be reached from other machines; it needs --console-access FOLDER with "
                f"{CERTIFICATE}, {KEY} and {OPERATE} (docs/console.md)"
            )
        return Access(host, port)
    for name in (CERTIFICATE, KEY, OPERATE):
        if not (folder / name).is_file():
            raise ConsoleError(
                f"console: {folder / name} is missing: docs/console.md#from-other-machines has the commands"
            )
    _require_private(folder / KEY)
    operate = _token(folder / OPERATE)
    view = _token(folder / VIEW) if (folder / VIEW).exists() else ""
    return Access(host, port, operate, view, folder)


def tls_context(folder: Path) -> ssl.SSLContext:
    """Return the TLS settings of a server.

    Raises
    ------
    ConsoleError
        When certificate or key cannot be read.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(folder / CERTIFICATE, folder / KEY)
    except (OSError, ssl.SSLError) as error:
        raise ConsoleError(f"console: {folder}: certificate or key cannot be read ({error})") from None
    return context


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise ConsoleError(f"console: expected HOST:PORT or off, got {text!r}")
    return host, int(port)


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _token(path: Path) -> str:
    _require_private(path)
    try:
        token = read_bytes(path, _MAX_BYTES).decode().strip()
    except (OSError, UnicodeDecodeError) as error:
        raise ConsoleError(f"console: {path} cannot be read ({error})") from None
    if len(token) < _MIN_TOKEN:
        raise ConsoleError(f"console: {path}: expected a token of at least {_MIN_TOKEN} characters")
    return token


def _require_private(path: Path) -> None:
    try:
        mode = path.stat().st_mode
    except OSError as error:
        raise ConsoleError(f"console: {path} cannot be read ({error})") from None
    if mode & 0o077:
        raise ConsoleError(f"console: {path} may be read by others; chmod 600 it")
