"""Records of `gcs.model` as JSON.

The JSON (RFC 8259, UTF-8) is the same on zenoh, in recordings and in the journal. Records are objects with
the record's field names; arrays are (nested) lists of numbers, bytes are base64 text, tuples are lists.
Floats are written with the shortest digits that give the same double, so that records are read back bit for
bit.

Only scans and orders on zenoh have forms of their own (`gcs.io.zenoh.scans`, `gcs.io.zenoh.order_messages`).
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any, Final, TypeVar

import msgspec
import numpy as np

from gcs.allowed_words import with_allowed_words
from gcs.errors import WireError
from gcs.io.recording.topics import TOPICS
from gcs.model import Notice, Scan, read_only

MAX_PAYLOAD_BYTES = 2 * 1024 * 1024
_MAX_RECORD_BYTES: Final = 64 * 1024 * 1024
"""A snapshot of a thousand vehicles has some 20 MB."""

RecordT = TypeVar("RecordT")


def _to_plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise NotImplementedError(type(value).__name__)


def _from_plain(_type: type, value: Any) -> Any:
    return read_only(value)


_encode = msgspec.json.Encoder(enc_hook=_to_plain).encode
_decoders: Final[dict[type, msgspec.json.Decoder[Any]]] = {
    record_type: msgspec.json.Decoder(record_type, dec_hook=_from_plain) for record_type in TOPICS
}


def encode(record: object) -> bytes:
    """Return a record of `gcs.model`, or one that has such records, as JSON."""
    return _encode(record)


def encode_shown(notice: Notice) -> bytes:
    """Return a notice as JSON for programs that show it: with its level and its text."""
    return _encode(shown_fields(notice))


def shown_fields(notice: Notice) -> dict[str, Any]:
    """Return the fields of a notice for programs that show it, its level and its text among them."""
    fields = {name: getattr(notice, name) for name in ("t_ns", "code", "level", "subject", "parameters")}
    return fields | {"text": notice.line}


def decode(source: str, payload: bytes, record_type: type[RecordT]) -> RecordT:
    """Return the record of `gcs.model` in a JSON text.

    Raises
    ------
    WireError
        If the payload is not the JSON of such a record; `source` is its origin.
    """
    record = decode_json(source, payload, _decoders[record_type], _MAX_RECORD_BYTES)
    if isinstance(record, Scan) and record.z_m.size == 0:  # JSON has no (0, 2)
        record = replace(record, z_m=read_only(np.empty((0, 2))))
    assert isinstance(record, record_type)
    return record


def decode_json(
    source: str,
    payload: bytes,
    decoder: msgspec.json.Decoder[RecordT],
    max_bytes: int = MAX_PAYLOAD_BYTES,
) -> RecordT:
    """Return the object in JSON from another program.

    `source` says in the error where the JSON came from.

    Raises
    ------
    WireError
        If it is too long, no JSON, or not of the decoder's form.
    """
    if len(payload) > max_bytes:
        raise WireError(source, f"{len(payload)} bytes are more than the {max_bytes} allowed")
    try:
        return decoder.decode(payload.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise WireError(source, f"not UTF-8 text (byte {error.start})") from None
    except msgspec.ValidationError as error:
        raise WireError(source, _plain(str(error), decoder.type)) from None
    except msgspec.DecodeError as error:
        raise WireError(source, f"not JSON: {error}") from None
    except RecursionError:
        raise WireError(source, "nested too deeply") from None


def _plain(problem: str, kind: Any) -> str:
    """Return msgspec's message in the form "field: expected ..."."""
    problem, _, path = problem.partition(" - at `")
    problem = with_allowed_words(problem, kind, path)
    problem = re.sub(r"Object missing required field `(\w+)`", r"the field `\1` is missing", problem)
    problem = (
        problem.replace("Expected", "expected").replace("`object`", "an object").replace("`array`", "a list")
    )
    field = path.rstrip("`").removeprefix("$").removeprefix(".")
    return f"{field}: {problem}" if field else problem
