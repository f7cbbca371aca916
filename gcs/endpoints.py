"""MAVLink endpoints: connection strings as in pymavlink, MAVProxy and MAVSDK.

======================================  =====================================================================
``udpin:HOST:PORT``                     listen on UDP; answers go to each sender
``udpout:HOST:PORT``                    send to HOST:PORT, and receive its answers
``tcp:HOST:PORT``                       connect over TCP, with reconnects
``tcpin:HOST:PORT``                     accept TCP connections
``serial:/dev/ttyUSB0:57600``           a serial port and its baud rate
======================================  =====================================================================

Also accepted: ``udp:`` (``udpin:``, as in pymavlink), ``tcpout:``, ``//`` after the colon, a comma before the
baud rate, a bare device path, and no host for a listening endpoint (all addresses). Recordings and views use
the canonical form of the table.
"""

from __future__ import annotations

import ipaddress
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
    """0 on a listening endpoint: any free port."""
    device: str = ""
    baud: int = 0

    @property
    def listens(self) -> bool:
        """True if peers connect to it."""
        return self.kind in ("udpin", "tcpin")

    @property
    def remote(self) -> str:
        """The one peer of an outgoing endpoint; else empty."""
        if self.listens:
            return ""
        return self.device or f"{self.host}:{self.port}"

    def __str__(self) -> str:
        if self.kind == "serial":
            return f"serial:{self.device}:{self.baud}"
        return f"{self.kind}:{self.host}:{self.port}"


Role: TypeAlias = Literal["vehicles", "read-only", "full"]
"""Vehicles, or other ground stations and their access."""


@dataclass(frozen=True, slots=True)
class Link:
    """An endpoint and its purpose."""

    endpoint: Endpoint
    network: int = 0
    role: Role = "vehicles"
    adsb: bool = False
    """True if target tracks are sent there as ADSB_VEHICLE."""
    bridge: str = ""
    """Bridge that opens it; empty: the only one."""
    redundant: bool = False
    """True if vehicles of other links may be heard here as well."""
    traffic: bool = False
    """True if receivers for ADS-B and Remote ID with system ids of their own report aircraft here."""

    @property
    def name(self) -> str:
        """Name of the link in events, recordings and views."""
        return f"{self.bridge}/{self.endpoint}" if self.bridge else str(self.endpoint)


def parse_endpoint(text: str) -> Endpoint:
    """Parse a connection string.

    Raises
    ------
    LinkError
        It is not an endpoint; the text shows the accepted forms.
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
    host = net["host"]
    port = int(net["port"])
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


def is_loopback(zenoh: str) -> bool:
    """Return True if an endpoint of zenoh, such as tcp/127.0.0.1:7447, is reached from this machine only."""
    host = zenoh.partition("/")[2].rpartition(":")[0].removeprefix("[").removesuffix("]")
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
