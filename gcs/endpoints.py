"""Where a MAVLink link is: connection strings as pymavlink, MAVProxy and MAVSDK users write them.

======================================  =====================================================================
``udpin:HOST:PORT``                     listen on UDP; whoever sends here is answered there
``udpout:HOST:PORT``                    send to HOST:PORT, and hear its answers
``tcp:HOST:PORT``                       connect over TCP, again and again until it works
``tcpin:HOST:PORT``                     accept TCP connections
``serial:/dev/ttyUSB0:57600``           a serial port and its baud rate
======================================  =====================================================================

Also understood: ``udp:`` (as pymavlink means it: ``udpin:``), ``tcpout:``, ``//`` behind the colon, a comma
before the baud rate, a bare device path, and no host where one listens (all addresses). What an endpoint is
called everywhere (recordings, views) is its canonical form: the one in the table.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from gcs.errors import LinkError

Transport: TypeAlias = Literal["udpin", "udpout", "tcp", "tcpin", "serial"]

DEFAULT_BAUD: Final = 57_600
_KINDS: Final[dict[str, Transport]] = {
    "udpin": "udpin",
    "udp": "udpin",
    "udpout": "udpout",
    "tcp": "tcp",
    "tcpout": "tcp",
    "tcpin": "tcpin",
    "serial": "serial",
}
_SCHEME: Final = re.compile(r"(?P<kind>[A-Za-z_]+):(//)?(?P<rest>.*)", re.DOTALL)
_NET: Final = re.compile(r"(?P<host>[^\s:/\[\]]*):(?P<port>\d{1,5})/?")
_SERIAL: Final = re.compile(r"(?P<device>/[^\s:,]+)([:,](?P<baud>\d{1,8}))?")
_FORMS: Final = (
    "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or serial:/dev/DEVICE:BAUD, "
    "such as udpin:0.0.0.0:14550"
)


@dataclass(frozen=True, slots=True)
class Endpoint:
    """One end of a MAVLink link; `str` gives its canonical form."""

    kind: Transport
    host: str = ""
    port: int = 0
    """0, where one listens, takes a free port."""
    device: str = ""
    baud: int = 0

    @property
    def listens(self) -> bool:
        """Whether others come to it, rather than it going to somebody."""
        return self.kind in ("udpin", "tcpin")

    @property
    def remote(self) -> str:
        """The only peer of an endpoint that does not listen, as it is written in events; else empty."""
        if self.listens:
            return ""
        return self.device or f"{self.host}:{self.port}"

    def __str__(self) -> str:
        if self.kind == "serial":
            return f"serial:{self.device}:{self.baud}"
        return f"{self.kind}:{self.host}:{self.port}"


Role: TypeAlias = Literal["vehicles", "read-only", "full"]
"""Whether vehicles are there, or another ground station, and what that may do."""


@dataclass(frozen=True, slots=True)
class Link:
    """An endpoint with what it is for."""

    endpoint: Endpoint
    network: int = 0
    role: Role = "vehicles"
    adsb: bool = False
    """Whether the targets' tracks are offered there."""

    @property
    def name(self) -> str:
        """What the link is called in events, recordings and views."""
        return str(self.endpoint)


def parse_endpoint(text: str) -> Endpoint:
    """Read a connection string.

    Raises
    ------
    LinkError
        When it is none; the text says what would be.
    """
    if text.startswith("/"):
        return _serial(text, text)
    match = _SCHEME.fullmatch(text)
    kind = None if match is None else _KINDS.get(match["kind"].lower())
    if match is None or kind is None:
        raise LinkError(text, f"expected {_FORMS}")
    if kind == "serial":
        return _serial(text, match["rest"])
    return _net(text, kind, match["rest"])


def _net(text: str, kind: Transport, rest: str) -> Endpoint:
    net = _NET.fullmatch(rest)
    if net is None:
        raise LinkError(text, f"expected {kind}:HOST:PORT, such as {kind}:127.0.0.1:14550 (IPv4 or a name)")
    host, port = net["host"], int(net["port"])
    if port > 65_535:
        raise LinkError(text, f"expected a port up to 65535, got {port}")
    if kind in ("udpin", "tcpin"):
        return Endpoint(kind, host or "0.0.0.0", port)  # noqa: S104  asked for by leaving the host out
    if not host or port == 0:
        raise LinkError(text, f"expected a host and a port to go to, such as {kind}:127.0.0.1:14550")
    return Endpoint(kind, host, port)


def _serial(text: str, rest: str) -> Endpoint:
    match = _SERIAL.fullmatch(rest)
    if match is None:
        raise LinkError(text, "expected serial:/dev/DEVICE:BAUD, such as serial:/dev/ttyUSB0:57600")
    baud = int(match["baud"]) if match["baud"] else DEFAULT_BAUD
    if baud == 0:
        raise LinkError(text, "expected a baud rate above 0, such as 57600")
    return Endpoint("serial", device=match["device"], baud=baud)
