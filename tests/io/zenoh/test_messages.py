"""What a sensor publishes is read exactly, and nothing hostile gets past the door."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.errors import WireError
from gcs.geo import LocalFrame
from gcs.io.record_json import MAX_PAYLOAD_BYTES, decode, encode
from gcs.io.recording.topics import topic_of
from gcs.io.zenoh.key_expressions import effect_key, scan_key
from gcs.io.zenoh.scans import MAX_DETECTIONS, decode_scan, encode_scan
from gcs.model import (
    AgentStatus,
    Datagram,
    LaggedPicture,
    MissionEnded,
    Picture,
    Plan,
    Route,
    Scan,
    Send,
    Sensor,
    Tick,
    Track,
    Truth,
    TruthObject,
    read_only,
)

FRAME = LocalFrame(33.2098, -87.5692, 60.0)
KEY = "swarm/demo/sensor/radar/scan"
T_NS = 1_767_225_600_000_000_000

metres = st.floats(-1e7, 1e7)


def good() -> dict:
    return {
        "sensor": {
            "name": "radar",
            "detection_probability": 0.95,
            "clutter_density_per_m2": 5e-6,
            "noise_cov_m2": [[10.0, 1.0], [1.0, 4.0]],
            "field_of_view_m": [0.0, 0.0, 2000.0, 2000.0],
        },
        "origin": {"lat_deg": FRAME.lat_deg, "lon_deg": FRAME.lon_deg},
        "measured_t_ns": T_NS,
        "z_m": [[1.5, 2.0], [3, 4]],
    }


def changed(path: str, value: object) -> bytes:
    message = good()
    *parents, last = path.split(".")
    table = message
    for parent in parents:
        table = table[parent]
    table[last] = value
    return json.dumps(message).encode()


def read(payload: bytes, key: str = KEY) -> Scan:
    return decode_scan(key, payload, T_NS + 5, FRAME)


def test_a_scan_arrives_as_it_was_published() -> None:
    scan = read(json.dumps(good()).encode())
    assert (scan.t_ns, scan.measured_t_ns, scan.sensor.name) == (T_NS + 5, T_NS, "radar")
    assert scan.z_m.tolist() == [[1.5, 2.0], [3.0, 4.0]]
    assert scan.sensor.noise_cov_m2.tolist() == [[10.0, 1.0], [1.0, 4.0]]
    assert not scan.z_m.flags.writeable


@given(st.lists(st.tuples(metres, metres), max_size=8), st.integers(0, 2**63 - 1))
def test_our_own_scans_survive_the_wire_bit_for_bit(points: list[tuple[float, float]], measured: int) -> None:
    sensor = Sensor("radar", 1.0, 0.0, read_only(np.eye(2) / 3.0), (-5.0, 0.0, 5.0, 0.1))
    scan = Scan(7, measured, sensor, read_only(np.reshape(points, (-1, 2))))
    back = decode_scan(scan_key("m", "radar"), encode_scan(scan, FRAME), 7, FRAME)
    assert back.z_m.shape == scan.z_m.shape
    assert back.z_m.tobytes() == scan.z_m.tobytes()
    assert back.sensor.noise_cov_m2.tobytes() == sensor.noise_cov_m2.tobytes()
    assert (back.t_ns, back.measured_t_ns) == (7, measured)


@pytest.mark.parametrize(
    ("path", "value", "says"),
    [
        ("sensor.detection_probability", 1.01, "sensor.detection_probability: expected"),
        ("sensor.detection_probability", -0.1, "sensor.detection_probability: expected"),
        ("sensor.detection_probability", float("nan"), "not JSON"),
        ("sensor.detection_probability", "0.9", "sensor.detection_probability: expected"),
        ("sensor.clutter_density_per_m2", -1e-9, "sensor.clutter_density_per_m2: expected"),
        ("sensor.clutter_density_per_m2", float("inf"), "not JSON"),
        ("sensor.noise_cov_m2", [[-1.0, 0.0], [0.0, 1.0]], "a variance cannot be negative"),
        ("sensor.noise_cov_m2", [[1.0, 2.0], [2.0, 1.0]], "not positive semi-definite"),
        ("sensor.noise_cov_m2", [[1.0, 0.5], [0.0, 1.0]], "symmetric"),
        ("sensor.noise_cov_m2", [1.0, 1.0], "sensor.noise_cov_m2"),
        ("sensor.noise_cov_m2", [[1.0, 0.0, 0.0]] * 3, "sensor.noise_cov_m2"),
        (
            "sensor.field_of_view_m",
            [0.0, 0.0, 0.0, 1.0],
            "sensor.field_of_view_m: expected [east_min",
        ),
        ("sensor.field_of_view_m", [0.0, 0.0, 1.0], "sensor.field_of_view_m"),
        ("sensor.name", "sonar", "`sonar` published on the key of `radar`"),
        ("sensor.name", "../etc", "sensor.name"),
        ("measured_t_ns", -1, "measured_t_ns: expected"),
        ("measured_t_ns", 2**64, "measured_t_ns"),
        ("measured_t_ns", 1.5, "measured_t_ns: expected"),
        ("z_m", [[1.0]], "z_m"),
        ("z_m", [[1.0, 2.0, "high"]], "z_m"),
        ("z_m", [[1.0, None]], "z_m"),
        ("z_m", [[1.0, 1e9]], "z_m"),
        ("z_m", [[0, 0]] * (MAX_DETECTIONS + 1), "z_m"),
        ("origin.lat_deg", 91.0, "origin.lat_deg: expected"),
        ("origin.lat_deg", FRAME.lat_deg + 2e-5, "m from the mission's origin"),
    ],
)
def test_a_wrong_field_is_refused_by_name(path: str, value: object, says: str) -> None:
    with pytest.raises(WireError) as caught:
        read(changed(path, value))
    assert caught.value.key == KEY
    assert says in caught.value.problem


def test_a_missing_field_is_named() -> None:
    message = good()
    del message["sensor"]["noise_cov_m2"]
    with pytest.raises(WireError, match="sensor: the field `noise_cov_m2` is missing"):
        read(json.dumps(message).encode())


def test_an_origin_within_a_metre_is_the_same_origin() -> None:
    read(changed("origin.lat_deg", FRAME.lat_deg + 0.8e-5))


def test_unknown_fields_are_passed_over() -> None:
    assert len(read(changed("beam_width_deg", 3.0)).z_m) == 2


@pytest.mark.parametrize(
    ("payload", "says"),
    [
        (b"", "not JSON"),
        (b"\xff\xfe\x00", "not UTF-8"),
        (b'{"z_m": "\xc3\x28"}', "not UTF-8"),
        (b"[1, 2]", "expected an object"),
        (b"{", "not JSON"),
        (b'{"beam": ' + b"[" * 100_000, "nested too deeply"),
        (b" " * (MAX_PAYLOAD_BYTES + 1), "bytes are more than"),
        (json.dumps(good()).encode().replace(b"0.95", b"1e999"), "out of range"),
    ],
)
def test_what_is_no_scan_is_refused_with_a_reason(payload: bytes, says: str) -> None:
    with pytest.raises(WireError) as caught:
        read(payload)
    assert says in caught.value.problem


@pytest.mark.parametrize("key", ["swarm/demo/truth", "swarm/a/b/sensor/radar/scan", "radar", ""])
def test_a_scan_on_another_key_is_refused(key: str) -> None:
    with pytest.raises(WireError):
        read(json.dumps(good()).encode(), key)


@given(st.data())
def test_damaged_bytes_give_a_scan_or_a_wire_error_and_nothing_else(data: st.DataObject) -> None:
    payload = bytearray(json.dumps(good()).encode())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(payload) - 1))
        payload[at : at + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=3))
    try:
        scan = read(bytes(payload))
    except WireError:
        return
    assert np.isfinite(scan.z_m).all()
    assert 0.0 <= scan.sensor.detection_probability <= 1.0
    assert np.linalg.eigvalsh(scan.sensor.noise_cov_m2).min() >= -1e-6


def test_every_double_survives_a_record() -> None:
    values = [0.1, 1 / 3, 5e-324, -0.0, 1.7976931348623157e308, math.pi]
    track = Track((3, 1), read_only(values[:4]), read_only(np.full((4, 4), values[5])), values[0])
    picture = Picture(1, 1, "agents", (track,), read_only(values))
    back = decode("here", encode(picture), Picture)
    assert back.cardinality.tobytes() == picture.cardinality.tobytes()
    assert back.tracks[0].mean.tobytes() == track.mean.tobytes()
    assert back.tracks[0].label == (3, 1)
    assert not back.tracks[0].cov.flags.writeable


def test_an_empty_scan_keeps_its_shape() -> None:
    sensor = Sensor("radar", 0.9, 0.0, read_only(np.eye(2)), (0.0, 0.0, 1.0, 1.0))
    assert decode("here", encode(Scan(1, 1, sensor, read_only(np.empty((0, 2))))), Scan).z_m.shape == (0, 2)


@given(st.binary(max_size=300))
def test_any_bytes_survive_a_datagram(data: bytes) -> None:
    datagram = Datagram(1, "udp", "127.0.0.1:1", data)
    assert decode("here", encode(datagram), Datagram) == datagram


def test_truth_and_plans_survive() -> None:
    truth = Truth(5, (TruthObject("agents", 1, 2.5, -3.5, False),))
    assert decode("k", encode(truth), Truth) == truth
    plan = Plan(1, 2, (Route(1, (0, 2), read_only([[1.0, 2.0]]), 3.0),), (4,), ((0, 1),), "why", (1,))
    back = decode("k", encode(plan), Plan)
    assert (back.routes[0].target, back.unassigned_targets, back.changed) == ((0, 2), ((0, 1),), (1,))
    status = AgentStatus(1, 2, "arrived", (0, 3), (1.0, 2.0))
    assert decode("k", encode(status), AgentStatus) == status


def test_truth_with_unknown_kinds_is_refused() -> None:
    with pytest.raises(WireError, match="kind"):
        decode(
            "k",
            b'{"t_ns": 1, "objects": [{"kind": "ufo", "id": 1, "east_m": 0, "north_m": 0, "alive": true}]}',
            Truth,
        )


def test_every_published_effect_has_a_key_of_its_own_and_bytes_for_vehicles_none() -> None:
    picture = Picture(1, 1, "targets", (), read_only([1.0]))
    assert effect_key("m", picture) == "swarm/m/picture/targets"
    late = LaggedPicture(2, 1, "targets", ())
    assert effect_key("m", late) == "swarm/m/picture/targets_lagged"
    assert topic_of(late) == "/effect/lagged_picture"
    assert effect_key("m", MissionEnded(1, (), ())) == "swarm/m/ended"
    with pytest.raises(TypeError):
        effect_key("m", Send("a", "b", b""))
    assert topic_of(picture) == "/effect/picture/targets"
    assert topic_of(Tick(1)) == "/event/tick"
