"""MessagePack (https://msgpack.org) between the processes of a mission: arrays, and errors in what comes."""

from __future__ import annotations

from typing import Any, TypeVar

import msgspec
import numpy as np

from gcs.errors import WireError
from gcs.model import array_of_parts, array_parts

T = TypeVar("T")


def encoder() -> msgspec.msgpack.Encoder:
    """Return an encoder of records with arrays."""
    return msgspec.msgpack.Encoder(enc_hook=_to_plain)


def decoder(kind: Any) -> msgspec.msgpack.Decoder[Any]:
    """Return a decoder of records with arrays, which are read-only."""
    return msgspec.msgpack.Decoder(kind, dec_hook=array_of_parts)


def decode(source: str, payload: bytes, decode_as: msgspec.msgpack.Decoder[T], max_bytes: int) -> T:
    """Return the message in a payload; `source` says in the error where it came from.

    Raises
    ------
    WireError
        If it is too long, or not of the decoder's form, as from another version.
    """
    if len(payload) > max_bytes:
        raise WireError(source, f"{len(payload)} bytes are more than the {max_bytes} allowed")
    try:
        return decode_as.decode(payload)
    except (msgspec.DecodeError, ValueError, TypeError, RecursionError) as error:
        raise WireError(source, f"not a message of this version: {error}") from None


def _to_plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return array_parts(value)
    raise NotImplementedError(type(value).__name__)
