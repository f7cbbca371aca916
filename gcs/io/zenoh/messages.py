"""What flows on zenoh and in recordings: keys, topics and their JSON. The one place where it is defined.

On zenoh every key of a mission begins with ``swarm/<mission>``:

=============================================  ==================================================
``swarm/<mission>/sensor/<name>/scan``         a sensor's scan (see ``docs/sensors.md``); heard by the service
``swarm/<mission>/picture/agents``, ``targets``  `Picture`, after each scan
``swarm/<mission>/plan``                       `Plan`
``swarm/<mission>/upload``                     `UploadReport`
``swarm/<mission>/agent_status``               `AgentStatus`
``swarm/<mission>/notice``                     `Notice`
``swarm/<mission>/ended``                      `MissionEnded`
``swarm/<mission>/order``                      an operator's order (``docs/orders.md``), heard by the service
``swarm/<mission>/answer``                     `OrderAnswer`
``swarm/<mission>/proposal``                   `Proposal`, when a plan waits for an operator's word
``swarm/<mission>/truth``                      `Truth`, from a simulated world alone
=============================================  ==================================================

Payloads are JSON (RFC 8259, UTF-8). Records of `gcs.model` are objects with the record's field names; arrays
are (nested) lists of numbers, bytes are base64 text, tuples are lists. Floats are written with the shortest
digits that give the same double back, so that what was written is read again bit for bit. Recordings hold
the same JSON.

A scan on zenoh differs from the record; it has a file of its own, `gcs.io.zenoh.scans`.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any, Final, TypeAlias, TypeVar

import msgspec
import numpy as np

from gcs.errors import WireError
from gcs.model import (
    AgentStatus,
    BadInput,
    ClockStep,
    Datagram,
    Effect,
    Event,
    LinkNews,
    MissionEnded,
    Notice,
    Order,
    OrderAnswer,
    Picture,
    Plan,
    Proposal,
    Resumed,
    Scan,
    Send,
    Tick,
    Truth,
    Upload,
    UploadAnswer,
    UploadReport,
    read_only,
)

MAX_PAYLOAD_BYTES = 2 * 1024 * 1024

Recordable: TypeAlias = Event | Effect | Truth
RecordT = TypeVar("RecordT")

TOPICS: Final[dict[type, str]] = {
    Datagram: "/event/datagram",
    Scan: "/event/scan",
    Tick: "/event/tick",
    BadInput: "/event/bad_input",
    LinkNews: "/event/link",
    ClockStep: "/event/clock_step",
    Order: "/event/order",
    UploadAnswer: "/event/upload_answer",
    Resumed: "/event/resumed",
    Send: "/effect/send",
    Upload: "/effect/upload_order",
    Picture: "/effect/picture",
    Plan: "/effect/plan",
    UploadReport: "/effect/upload",
    Notice: "/effect/notice",
    AgentStatus: "/effect/agent_status",
    MissionEnded: "/effect/ended",
    OrderAnswer: "/effect/answer",
    Proposal: "/effect/proposal",
    Truth: "/truth",
}
"""Topic of each record in a recording; pictures have one for each kind, below theirs."""

_EFFECT_KEYS: Final[dict[type, str]] = {
    Plan: "plan",
    UploadReport: "upload",
    AgentStatus: "agent_status",
    Notice: "notice",
    MissionEnded: "ended",
    OrderAnswer: "answer",
    Proposal: "proposal",
}


# ---------------------------------------------------------------- keys


def scan_key(mission: str, sensor: str) -> str:
    """Key on which a sensor publishes its scans."""
    return f"swarm/{mission}/sensor/{sensor}/scan"


def sensor_of(key: str) -> str:
    """Return the name of the sensor that publishes on a scan's key; empty for another key."""
    parts = key.split("/")
    return parts[3] if len(parts) == 5 and parts[4] == "scan" else ""


def sensor_scan_keys(mission: str) -> str:
    """Key expression of the scans of every sensor of a mission."""
    return scan_key(mission, "*")


def truth_key(mission: str) -> str:
    """Key on which a simulated world publishes the truth."""
    return f"swarm/{mission}/truth"


def effect_key(mission: str, effect: Effect) -> str:
    """Key on which the service publishes an effect.

    Raises
    ------
    TypeError
        For a `Send`: its bytes go to a vehicle, not to zenoh.
    """
    if isinstance(effect, Picture):
        return f"swarm/{mission}/picture/{effect.kind}"
    name = _EFFECT_KEYS.get(type(effect))
    if name is None:
        raise TypeError(f"{type(effect).__name__} is not published")
    return f"swarm/{mission}/{name}"


def topic_of(record: Recordable) -> str:
    """Topic of a record in a recording."""
    topic = TOPICS[type(record)]
    return f"{topic}/{record.kind}" if isinstance(record, Picture) else topic


# ---------------------------------------------------------------- records of the model


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


def encode(record: Recordable) -> bytes:
    """Write a record of `gcs.model` as JSON."""
    return _encode(record)


def decode(source: str, payload: bytes, record_type: type[RecordT]) -> RecordT:
    """Read a record of `gcs.model` back from its JSON.

    Raises
    ------
    WireError
        When the payload is not the JSON of such a record; `source` says where it came from.
    """
    record = parsed(source, payload, _decoders[record_type])
    if isinstance(record, Scan) and record.z_m.size == 0:  # JSON has no (0, 2)
        record = replace(record, z_m=read_only(np.empty((0, 2))))
    assert isinstance(record, record_type)
    return record


def encode_effect(effect: Effect) -> bytes:
    """Write an effect as the service publishes it."""
    return _encode(effect)


def encode_truth(truth: Truth) -> bytes:
    """Write the truth as a simulated world publishes it."""
    return _encode(truth)


def decode_truth(key: str, payload: bytes) -> Truth:
    """Read what a simulated world published.

    Raises
    ------
    WireError
        When it is not the JSON of a `Truth`.
    """
    return decode(key, payload, Truth)


# ---------------------------------------------------------------- what came from outside


def parsed(source: str, payload: bytes, decoder: msgspec.json.Decoder[RecordT]) -> RecordT:
    """Decode what came from outside.

    Raises
    ------
    WireError
        When it is too long, no JSON, or not of the decoder's form.
    """
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise WireError(source, f"{len(payload)} bytes are more than the {MAX_PAYLOAD_BYTES} allowed")
    try:
        return decoder.decode(payload.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise WireError(source, f"not UTF-8 text (byte {error.start})") from None
    except msgspec.ValidationError as error:
        raise WireError(source, _plain(str(error))) from None
    except msgspec.DecodeError as error:
        raise WireError(source, f"not JSON: {error}") from None
    except RecursionError:
        raise WireError(source, "nested too deeply") from None


def _plain(problem: str) -> str:
    """Turn msgspec's wording into "field: what was expected"."""
    problem, _, path = problem.partition(" - at `")
    problem = re.sub(r"Object missing required field `(\w+)`", r"the field `\1` is missing", problem)
    problem = (
        problem.replace("Expected", "expected").replace("`object`", "an object").replace("`array`", "a list")
    )
    field = path.rstrip("`").removeprefix("$").removeprefix(".")
    return f"{field}: {problem}" if field else problem
