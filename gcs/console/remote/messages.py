"""News of a run as bytes, and back: MessagePack (https://msgpack.org).

Records are those of `gcs.model`; arrays are their dtype, shape and bytes. Parts of a capture that have not
changed since the last one of a console are left out: map, no-fly zones, routes, the proposed plan.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, get_args, get_type_hints

import msgspec
from msgspec import UNSET, Raw, UnsetType

from gcs.console.view.capture import Capture, same_routes
from gcs.console.view.news import News, NewsRequest
from gcs.console.view.page_records import VehicleDetail
from gcs.errors import WireError
from gcs.io.message_pack import decode, decoder, encoder
from gcs.model import (
    Effect,
    Order,
)

_MAX_REQUEST_BYTES: Final = 4096
_MAX_NEWS_BYTES: Final = 64 * 1024 * 1024


class DetailRequest(msgspec.Struct, frozen=True):
    """What a console knows of a vehicle: number and time of its last verified mission."""

    verified: tuple[int, int] = (0, 0)


_COMPARED: Final[dict[str, Callable[[Any, Any], bool]]] = {
    "routes": same_routes,
    "proposal": lambda one, other: one is other,
    "map": lambda one, other: one is other,
    "zones": lambda one, other: one == other,
}
"""Parts of a capture that are sent when they have changed."""

_Captured: Final = msgspec.defstruct(
    "_Captured",
    [
        (name, kind | UnsetType, UNSET) if name in _COMPARED else (name, kind)
        for name, kind in get_type_hints(Capture).items()
    ],
    kw_only=True,
)
"""A capture, without the parts that have not changed."""

_OTHERWISE: Final = {"effects": list[tuple[int, str, Raw]], "capture": _Captured | None}
_News: Final = msgspec.defstruct("_News", list((get_type_hints(News) | _OTHERWISE).items()))
"""The fields of `News`; each effect has the name of its type."""


_encode: Final = encoder().encode
_news: Final = decoder(_News)
_request: Final = msgspec.msgpack.Decoder(NewsRequest)
_detail_request: Final = msgspec.msgpack.Decoder(DetailRequest)
_detail: Final = msgspec.msgpack.Decoder(VehicleDetail | None)
_effects: Final[dict[str, msgspec.msgpack.Decoder[Any]]] = {
    kind.__name__: decoder(kind) for kind in (*get_args(Effect), Order)
}


def encode_request(request: NewsRequest | DetailRequest) -> bytes:
    """Return a request as bytes."""
    return _encode(request)


def encode_detail(detail: VehicleDetail | None) -> bytes:
    """Return the details of a vehicle as bytes; None: the mission has no such vehicle."""
    return _encode(detail)


def decode_request(payload: bytes) -> NewsRequest:
    """Return a request for news.

    Raises
    ------
    WireError
        If it is none.
    """
    return decode("news", payload, _request, _MAX_REQUEST_BYTES)


def decode_detail_request(payload: bytes) -> DetailRequest:
    """Return a request for the details of a vehicle.

    Raises
    ------
    WireError
        If it is none.
    """
    return decode("news", payload, _detail_request, _MAX_REQUEST_BYTES)


def decode_detail(payload: bytes) -> VehicleDetail | None:
    """Return the details of a vehicle; None: the mission has no such vehicle.

    Raises
    ------
    WireError
        If they are none.
    """
    found: VehicleDetail | None = decode("news", payload, _detail, _MAX_NEWS_BYTES)
    return found


class NewsEncoder:
    """Encodes news for several consoles: each part of a capture once."""

    def __init__(self) -> None:
        self._last: Capture | None = None
        self._always: dict[str, Any] = {}
        """Parts of the last capture that are always sent."""
        self._changed: dict[str, tuple[int, Raw]] = {}
        """The other parts: number of the capture in which each has changed, and its bytes."""

    def encode(self, news: News, known: int) -> bytes:
        """Return news as bytes for a console that has the capture of the number `known`."""
        fields = {name: getattr(news, name) for name in _News.__struct_fields__}
        fields["effects"] = [(t_ns, type(one).__name__, Raw(_encode(one))) for t_ns, one in news.effects]
        if news.capture is not None:
            fields["capture"] = self._captured(news.capture, 0 if news.begins_anew else known)
        return _encode(fields)

    def _captured(self, capture: Capture, known: int) -> dict[str, Any]:
        if capture is not self._last:
            self._note(capture)
            self._last = capture
        parts = {name: raw for name, (number, raw) in self._changed.items() if number > known}
        return self._always | parts

    def _note(self, capture: Capture) -> None:
        """Encode a new capture; keep the bytes of what has not changed."""
        last = self._last
        self._always = {
            "number": capture.number,
            "t_ns": capture.t_ns,
            "status": Raw(_encode(capture.status)),
            "telemetry": Raw(_encode(capture.telemetry)),
            "service": capture.service,
        }
        for name, is_same in _COMPARED.items():
            value = getattr(capture, name)
            if last is None or capture.number <= last.number or not is_same(getattr(last, name), value):
                self._changed[name] = (capture.number, Raw(_encode(value)))


def decode_news(payload: bytes, last: Capture | None) -> News:
    """Return news.

    Parameters
    ----------
    last : Capture or None
        The last capture of this console: what is left out is as in it.

    Raises
    ------
    WireError
        If they are none, or of another version.
    """
    found = decode("news", payload, _news, _MAX_NEWS_BYTES)
    fields = {name: getattr(found, name) for name in _News.__struct_fields__}
    effects = [
        (t_ns, decode("news", bytes(raw), _effects[kind], _MAX_NEWS_BYTES))
        for t_ns, kind, raw in found.effects
        if kind in _effects
    ]
    captured = None
    if found.capture is not None:
        captured = _completed(found.capture, None if found.begins_anew else last)
    return News(**{**fields, "effects": effects, "capture": captured})


def _completed(found: Any, last: Capture | None) -> Capture:
    """Return a capture, with what was left out."""
    fields = {name: getattr(found, name) for name in _Captured.__struct_fields__}
    missing = [name for name, value in fields.items() if value is UNSET]
    if missing and last is None:
        raise WireError("news", f"there is no {missing[0]}")
    return Capture(**{**fields, **{name: getattr(last, name) for name in missing}})
