"""What flows on zenoh and in recordings: keys, topics and their JSON. The one place where it is defined.

On zenoh every key of a mission begins with ``swarm/<mission>``:

=============================================  ==================================================
``swarm/<mission>/sensor/<name>/scan``         a sensor's scan (see ``docs/sensors.md``); heard by the service
``swarm/<mission>/picture/agents``, ``targets``  `Picture`, after each scan
``swarm/<mission>/plan``                       `Plan`
``swarm/<mission>/upload``                     `UploadReport`
``swarm/<mission>/fate``                       `Fate`
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

A scan's JSON differs from the record: it names the origin of its local frame and not the time of arrival,
which only the receiver knows. It comes from outside and is believed only after every check below.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import lru_cache
from typing import Annotated, Any, Final, TypeAlias, TypeVar

import msgspec
import numpy as np
from msgspec import Meta

from gcs.errors import WireError
from gcs.geo import LocalFrame
from gcs.model import (
    BadInput,
    Datagram,
    Effect,
    Event,
    Fate,
    MissionEnded,
    Notice,
    Order,
    OrderAnswer,
    Picture,
    Plan,
    Proposal,
    Scan,
    Send,
    Sensor,
    Tick,
    Truth,
    Upload,
    UploadAnswer,
    UploadReport,
    read_only,
)

MAX_DETECTIONS = 20_000
MAX_PAYLOAD_BYTES = 2 * 1024 * 1024
MAX_ORIGIN_OFFSET_M = 1.0
"""How far a sensor's origin may lie from the mission's."""

Recordable: TypeAlias = Event | Effect | Truth
RecordT = TypeVar("RecordT")

TOPICS: Final[dict[type, str]] = {
    Datagram: "/event/datagram",
    Scan: "/event/scan",
    Tick: "/event/tick",
    BadInput: "/event/bad_input",
    Order: "/event/order",
    UploadAnswer: "/event/upload_answer",
    Send: "/effect/send",
    Upload: "/effect/upload_order",
    Picture: "/effect/picture",
    Plan: "/effect/plan",
    UploadReport: "/effect/upload",
    Notice: "/effect/notice",
    Fate: "/effect/fate",
    MissionEnded: "/effect/ended",
    OrderAnswer: "/effect/answer",
    Proposal: "/effect/proposal",
    Truth: "/truth",
}
"""Topic of each record in a recording; pictures have one for each kind, below theirs."""

_EFFECT_KEYS: Final[dict[type, str]] = {
    Plan: "plan",
    UploadReport: "upload",
    Fate: "fate",
    Notice: "notice",
    MissionEnded: "ended",
    OrderAnswer: "answer",
    Proposal: "proposal",
}


# ---------------------------------------------------------------- keys


def scan_key(mission: str, sensor: str) -> str:
    """Key on which a sensor publishes its scans."""
    return f"swarm/{mission}/sensor/{sensor}/scan"


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


# ---------------------------------------------------------------- scans, from anybody

_NAME = r"^[A-Za-z0-9_-]{1,64}$"
_SCAN_KEY = re.compile(r"swarm/[^/]+/sensor/(?P<sensor>[^/]+)/scan")

_Metres = Annotated[float, Meta(ge=-1e7, le=1e7)]
_Variance = Annotated[float, Meta(ge=-1e10, le=1e10)]
_Row = tuple[_Variance, _Variance]


class SensorMessage(msgspec.Struct, frozen=True, kw_only=True):
    """What a sensor says of itself, in each of its scans."""

    name: Annotated[str, Meta(pattern=_NAME)]
    detection_probability: Annotated[float, Meta(ge=0.0, le=1.0)]
    clutter_density_per_m2: Annotated[float, Meta(ge=0.0, le=1.0)]
    noise_cov_m2: tuple[_Row, _Row]
    field_of_view_m: tuple[_Metres, _Metres, _Metres, _Metres]


class OriginMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Where on WGS84 the sensor's east/north begin."""

    lat_deg: Annotated[float, Meta(ge=-90.0, le=90.0)]
    lon_deg: Annotated[float, Meta(ge=-180.0, le=180.0)]


class ScanMessage(msgspec.Struct, frozen=True, kw_only=True):
    """A scan on the wire. Fields that are not known here are passed over."""

    sensor: SensorMessage
    origin: OriginMessage
    measured_t_ns: Annotated[int, Meta(ge=0, le=2**63 - 1)]
    z_m: Annotated[list[tuple[_Metres, _Metres]], Meta(max_length=MAX_DETECTIONS)]


_scan_decoder = msgspec.json.Decoder(ScanMessage)


def encode_scan(scan: Scan, frame: LocalFrame) -> bytes:
    """Write a scan as a sensor publishes it; `frame` is the one that its east/north refer to."""
    return _encode(
        {
            "sensor": scan.sensor,
            "origin": {"lat_deg": frame.lat_deg, "lon_deg": frame.lon_deg},
            "measured_t_ns": scan.measured_t_ns,
            "z_m": scan.z_m,
        }
    )


def decode_scan(key: str, payload: bytes, t_ns: int, frame: LocalFrame) -> Scan:
    """Read what somebody published as a scan; believe nothing.

    Parameters
    ----------
    key
        The key it was published on.
    t_ns
        When it arrived.
    frame
        The mission's local frame: a scan of another one is refused.

    Raises
    ------
    WireError
        When it does not have the form of ``docs/sensors.md``; the text says which field is at fault and why.
    """
    message = parsed(key, payload, _scan_decoder)
    sensor = _believed_sensor(key, message.sensor)
    offset_m = _origin_offset_m(frame, message.origin)
    if not offset_m <= MAX_ORIGIN_OFFSET_M:
        raise WireError(
            key,
            f"origin: ({message.origin.lat_deg}, {message.origin.lon_deg}) lies {offset_m:.1f} m from the "
            f"mission's origin ({frame.lat_deg}, {frame.lon_deg}); give east/north in the mission's frame",
        )
    return Scan(t_ns, message.measured_t_ns, sensor, read_only(np.reshape(message.z_m, (-1, 2))))


def _believed_sensor(key: str, message: SensorMessage) -> Sensor:
    match = _SCAN_KEY.fullmatch(key)
    if match is None:
        raise WireError(key, "not a key for scans, which is swarm/<mission>/sensor/<name>/scan")
    if message.name != match["sensor"]:
        raise WireError(key, f"sensor.name: `{message.name}` published on the key of `{match['sensor']}`")
    (a, b), (c, d) = message.noise_cov_m2
    if a < 0.0 or d < 0.0:
        raise WireError(key, f"sensor.noise_cov_m2: a variance cannot be negative, got {a} and {d}")
    if not math.isclose(b, c, rel_tol=1e-9, abs_tol=1e-12):
        raise WireError(key, f"sensor.noise_cov_m2: a covariance is symmetric, got {b} and {c}")
    if b * b > a * d * (1.0 + 1e-9):
        raise WireError(key, f"sensor.noise_cov_m2: not positive semi-definite: {b}**2 > {a} * {d}")
    east_min, north_min, east_max, north_max = message.field_of_view_m
    if not (east_min < east_max and north_min < north_max):
        raise WireError(
            key, "sensor.field_of_view_m: expected [east_min, north_min, east_max, north_max] with min < max"
        )
    return Sensor(
        message.name,
        message.detection_probability,
        message.clutter_density_per_m2,
        read_only(message.noise_cov_m2),
        message.field_of_view_m,
    )


@lru_cache(maxsize=256)
def _origin_offset_m(frame: LocalFrame, origin: OriginMessage) -> float:
    return math.hypot(*frame.to_local(origin.lat_deg, origin.lon_deg))


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
