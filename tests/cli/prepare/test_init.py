"""A user would begin with a mission file that `gcs check` refuses, or have a hostile file read."""

from __future__ import annotations

import json
import socket
import struct
import threading

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from typer.testing import CliRunner

from gcs.cli import app
from gcs.config import load
from gcs.io.recording.folder import Run
from gcs.io.recording.recorder import Recorder
from gcs.mavlink.frames.codec import Encoder
from gcs.model import Tick

HOME = (47.3977, 8.5456)
PLAN = {
    "fileType": "Plan",
    "version": 1,
    "mission": {
        "cruiseSpeed": 18,
        "plannedHomePosition": [*HOME, 488.0],
        "items": [
            {"type": "SimpleItem", "command": 22, "params": [15, 0, 0, None, 0, 0, 50]},
            {"type": "SimpleItem", "command": 16, "params": [0, 0, 0, None, 47.401, 8.548, 50]},
            {"type": "ComplexItem", "complexItemType": "survey"},
            {"type": "SimpleItem", "command": 21, "params": [0, 0, 0, None, 47.397, 8.545, 0]},
        ],
    },
    "geoFence": {
        "polygons": [
            {"inclusion": True, "polygon": [[47.39, 8.53], [47.41, 8.53], [47.41, 8.56], [47.39, 8.56]]}
        ],
        "circles": [{"inclusion": False, "circle": {"center": [47.402, 8.545], "radius": 40}}],
    },
    "rallyPoints": {"points": [[47.398, 8.547, 60]]},
}
KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Folder>
<Placemark><name>Agent 7</name><Point><coordinates>8.5456,47.3977,0</coordinates></Point></Placemark>
<Placemark><name>vehicle</name><Point><coordinates>8.5460,47.3977</coordinates></Point></Placemark>
<Placemark><name>A "barn"
# x = 1</name><Point><coordinates> 8.548,47.401,0 </coordinates></Point></Placemark>
<Placemark><name>Fence</name><Polygon><outerBoundaryIs><LinearRing><coordinates>
8.53,47.39,0 8.56,47.39,0 8.56,47.41,0 8.53,47.41,0 8.53,47.39,0</coordinates></LinearRing></outerBoundaryIs>
</Polygon></Placemark>
<Placemark><name>mast</name><Polygon><outerBoundaryIs><LinearRing><coordinates>
8.540,47.400 8.541,47.400 8.541,47.401</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>
<Placemark><name>way</name><LineString><coordinates>8.5,47.4 8.6,47.4</coordinates></LineString></Placemark>
</Folder></Document></kml>"""


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def init(*arguments):
    return CliRunner().invoke(app, ["init", *map(str, arguments)])


def made(tmp_path, name, content, *arguments):
    """The mission that `gcs init` makes of a file's content, once `gcs check` has taken it."""
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    result = init(path, *arguments)
    assert result.exit_code == 0, result.output
    return checked(tmp_path / f"{path.stem}.toml"), result.output


def checked(path):
    result = CliRunner().invoke(app, ["check", str(path)])
    assert result.exit_code == 0, result.output
    return load(str(path))


def places(config, rows):
    frame = config.local_frame
    return [tuple(round(x, 5) for x in frame.to_geodetic(row.east_m, row.north_m)) for row in rows]


def test_a_plan_becomes_a_mission(tmp_path):
    config, output = made(tmp_path, "field day.plan".replace(" ", "-"), json.dumps(PLAN))
    assert places(config, config.agents) == [HOME]
    assert places(config, config.births) == [(47.401, 8.548)]
    assert config.frame.alt_msl_m == 488.0
    assert config.airframe.speed_m_s == 18.0
    assert [area.kind for area in config.fence.areas] == ["inclusion", "exclusion"]
    assert config.fence.areas[1].circle == (47.402, 8.545, 40.0)
    assert [point.alt_rel_m for point in config.rally] == [60]
    assert config.planning.retask == "confirm"
    assert "1 surveys and other patterns" in output


def test_a_kml_becomes_a_mission(tmp_path):
    config, output = made(tmp_path, "map.kml", KML)
    assert [agent.system_id for agent in config.agents] == [7, 1]
    assert places(config, config.births) == [(47.401, 8.548)]
    assert [area.kind for area in config.fence.areas] == ["inclusion", "exclusion"]
    assert "1 paths" in output


POND = "8.540,47.400 8.541,47.400 8.541,47.401"


def polygon(name, corners):
    ring = f"<outerBoundaryIs><LinearRing><coordinates>{corners}</coordinates></LinearRing></outerBoundaryIs>"
    return f"<Placemark><name>{name}</name><Polygon>{ring}</Polygon></Placemark>"


def kml(*parts):
    points = KML.split("<Placemark><name>Fence")[0]
    return f"{points}{''.join(parts)}</Folder></Document></kml>"


FIELD = "8.53,47.39 8.56,47.39 8.56,47.41 8.53,47.41"


@pytest.mark.parametrize("name", ["border", "field 7", ""])
def test_a_polygon_around_the_starts_is_to_stay_in_whatever_its_name(tmp_path, name):
    config, output = made(tmp_path, "map.kml", kml(polygon("pond", POND), polygon(name, FIELD)))
    assert [area.kind for area in config.fence.areas] == ["exclusion", "inclusion"]
    assert "is the boundary (inclusion area)" in output
    assert "polygon 'pond' is an exclusion area" in output


def test_without_starts_the_polygon_around_everything_else_is_to_stay_in(tmp_path):
    text = kml(polygon("pond", POND), polygon("area", FIELD)).replace("Agent 7", "a").replace("vehicle", "b")
    config, _ = made(tmp_path, "map.kml", text)
    assert [area.kind for area in config.fence.areas] == ["exclusion", "inclusion"]


def test_a_polygon_around_a_start_inside_the_boundary_is_left_out(tmp_path):
    pad = "8.5450,47.3970 8.5470,47.3970 8.5470,47.3990 8.5450,47.3990"
    config, output = made(tmp_path, "map.kml", kml(polygon("pad", pad), polygon("border", FIELD)))
    assert [area.kind for area in config.fence.areas] == ["inclusion"]
    assert "polygon 'pad' is left out: a vehicle starts in it" in output


def test_agents_and_births_in_an_obstacle_or_outside_the_fence_are_named(tmp_path):
    made(tmp_path, "map.kml", kml(polygon("border", FIELD)))
    file = tmp_path / "map.toml"
    text = file.read_text().replace('kind = "inclusion"', 'kind = "exclusion"')
    file.write_text(text)
    output = CliRunner().invoke(app, ["check", str(file)]).output
    assert "agent 7 starts in an exclusion area of the fence" in output
    assert "births[0] lies in an exclusion area of the fence" in output
    file.write_text(
        text.replace('kind = "exclusion"', 'kind = "inclusion"').replace("8.5600000", "8.5450000")
    )
    assert (
        "agent 7 starts outside the fence's inclusion area"
        in CliRunner().invoke(app, ["check", str(file)]).output
    )
    east_m, north_m = load(str(file)).agents[0].east_m, load(str(file)).agents[0].north_m
    disc = f"[map]\ndiscs_m = [[{east_m}, {north_m}, 60.0]]"
    file.write_text(text.replace('kind = "exclusion"', 'kind = "inclusion"').replace("[map]", disc))
    assert "agent 7 starts in an obstacle" in CliRunner().invoke(app, ["check", str(file)]).output


@pytest.mark.parametrize("scenario", ["deterministic", "prescribed", "radars", "random-targets", "swarm-50"])
def test_a_shipped_scenario_has_no_warning(scenario):
    assert "warning" not in CliRunner().invoke(app, ["check", scenario]).output


@pytest.mark.parametrize("keep", ["agents", "targets", "areas"])
def test_missing_parts_of_a_map_are_named_in_the_file(tmp_path, keep):
    marks = {"agents": "Agent 7", "targets": "barn", "areas": "mast"}
    parts = [part for part in KML.split("<Placemark>") if marks[keep] in part or "<kml" in part]
    text = "<Placemark>".join(parts)
    text = text if text.endswith("</kml>") else f"{text}</Folder></Document></kml>"
    config, _ = made(tmp_path, "some.kml", text)
    assert len(config.agents) == 1
    file = (tmp_path / "some.toml").read_text()
    assert ("NOT in the source: set the position of the start" in file) == (keep != "agents")
    assert ("The source has no targets" in file) == (keep != "targets")


def frames(system_id, place=HOME, *, component=1, autopilot=3):
    encode = Encoder(system_id, component)
    lat, lon = (round(x * 1e7) for x in place)
    return [
        encode(dialect.MAVLink_heartbeat_message(1, autopilot, 0, 0, 4, 3)),
        encode(dialect.MAVLink_global_position_int_message(0, 1000, -300, 0, 0, 0, 0, 0, 0)),  # no origin yet
        encode(dialect.MAVLink_global_position_int_message(1, lat, lon, 490_000, 2_000, 0, 0, 0, 35_300)),
    ]


def log(*some):
    return b"".join(struct.pack(">Q", 1_700_000_000_000_000 + n) + one for n, one in enumerate(some))


def test_a_log_becomes_a_mission_with_the_vehicles_in_it(tmp_path):
    others = [*frames(255), *frames(51, component=68), *frames(9, autopilot=8)]
    near = (HOME[0] + 0.001, HOME[1])
    content = log(*frames(3, near), *others, *frames(2), frames(4)[0])
    config, output = made(tmp_path, "flight.tlog", content)
    assert [agent.system_id for agent in config.agents] == [2, 3]
    assert places(config, config.agents) == [HOME, (round(near[0], 5), near[1])]
    assert config.agents[0].course_deg == 353.0
    assert config.frame.alt_msl_m == 488.0
    assert "system 4" in output


def test_a_recording_gives_back_its_mission_file(tmp_path):
    text = 'name = "x"\n[frame]\nlat_deg = 33.0\nlon_deg = -87.0\nalt_msl_m = 70.0\n'
    text += "[[agents]]\nsystem_id = 1\neast_m = 100.0\nnorth_m = 100.0\n"
    with Recorder(tmp_path / "run", text, {}, Run("x", 1)) as recorder:
        recorder.record_event(Tick(1))
    assert init(tmp_path / "run", "-o", "again.toml").exit_code == 0
    assert checked(tmp_path / "again.toml") == load_text(text)


def load_text(text):
    from gcs.config import parse

    return parse(text, "x")


@pytest.mark.real_time
def test_vehicles_heard_on_a_link_become_agents_and_hear_no_heartbeat(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    heard, stop = [], threading.Event()

    def fly():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            vehicle.settimeout(0.1)
            beat, _, position = frames(7)
            asked = False
            while not stop.is_set():
                vehicle.sendto(beat + (position if asked else b""), ("127.0.0.1", port))
                try:
                    data = vehicle.recv(2048)
                except OSError:
                    continue
                heard.extend(m.get_type() for m in dialect.MAVLink(None).parse_buffer(bytearray(data)) or [])
                asked = True

    thread = threading.Thread(target=fly)
    thread.start()
    try:
        endpoint = f"udpin:127.0.0.1:{port}"
        result = init("--listen", endpoint, "--wait", "3", "--name", "heard")
    finally:
        stop.set()
        thread.join()
    assert result.exit_code == 0, result.output
    config = checked(tmp_path / "heard.toml")
    assert [agent.system_id for agent in config.agents] == [7]
    assert config.links.mavlink == endpoint
    assert set(heard) == {"COMMAND_LONG"}


def test_a_file_that_is_there_stays_unless_it_is_to_be_replaced(tmp_path):
    made(tmp_path, "p.plan", json.dumps(PLAN))
    (tmp_path / "p.toml").write_text("mine")
    refused = init(tmp_path / "p.plan")
    assert refused.exit_code == 2
    assert "exists already" in refused.output
    assert (tmp_path / "p.toml").read_text() == "mine"
    assert init(tmp_path / "p.plan", "--force").exit_code == 0
    assert checked(tmp_path / "p.toml").agents


LAUGHS = '<!DOCTYPE kml [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]><kml><name>&b;</name></kml>'


def plan(**mission):
    return json.dumps(PLAN | {"mission": PLAN["mission"] | mission})


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.kml", LAUGHS, "document type"),
        ("a.kml", LAUGHS.encode("utf-16"), "UTF-8"),
        ("a.kml", "<kml><Placemark>", "is not XML"),
        ("a.kml", "<gpx/>", "expected KML, got <gpx>"),
        ("a.kml", "<kml/>", "has no position"),
        ("a.kml", b"PK\x03\x04\xff\xff", "KMZ must be unzipped"),
        ("a.kml", "<kml>" + "x" * 5_000_000 + "</kml>", "larger than 4 MB"),
        ("a.kml", "<a>" * 200_000, "nested deeper than 40"),
        ("a.kml", "<a>" * 20, "is not XML"),
        ("a.kml", KML.replace("8.548,47.401,0", "north,47"), "expected longitude,latitude"),
        ("a.kml", KML.replace("8.548,47.401,0", "nan,47"), "expected longitude,latitude"),
        ("a.kml", KML.replace("8.548,47.401,0", "47.401,8.548"), "more than 50 km apart"),
        ("a.kml", KML.replace("Agent 7", "Agent 999"), "a system id of its own"),
        ("a.kml", KML.replace(">mast", ">boundary 2"), "several inclusion areas"),
        ("a.plan", "{", "is not JSON"),
        ("a.plan", "[" * 100_000, "is not JSON"),
        ("a.plan", "{}", "expected \"Plan\""),
        ("a.plan", plan(plannedHomePosition=[0, 0, 0]), "no latitude and longitude"),
        ("a.plan", plan(plannedHomePosition=[1, 2]), "expected 3 numbers"),
        ("a.plan", plan(plannedHomePosition=["x", 2, 3]), "expected 3 numbers"),
        ("a.plan", plan(plannedHomePosition=[10**30, 2, 3]), ""),
        ("a.plan", plan(items=[{"type": "SimpleItem", "command": 16}]), "seven parameters"),
        ("a.plan", plan(plannedHomePosition=[10.0, 10.0, 0]), "more than 50 km apart"),
        ("a.plan", json.dumps(PLAN | {"rallyPoints": {"points": [[47.45, 8.5, 50]]}}), "outside the fence"),
        ("a.tlog", b"nothing of that kind", "no MAVLink frame"),
        ("a.tlog", b"", "is empty"),
        ("a.tlog", log(frames(1)[0]), "has no position of a vehicle"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    result = init(path)
    assert result.exit_code in (1, 2), result.output
    assert "error: " in result.output
    assert words in " ".join(result.output.split())
    assert not (tmp_path / "a.toml").exists()


def test_a_wrong_source_is_refused_with_the_accepted_ones():
    for arguments in ((), ("a.plan", "--listen", "udpin:127.0.0.1:0"), ("nowhere.plan",)):
        result = init(*arguments)
        assert result.exit_code == 2
        assert "error: " in result.output


def test_no_vehicle_heard_is_reported():
    result = init("--listen", "udpin:127.0.0.1:0", "--wait", "1")
    assert result.exit_code in (1, 2)
    assert "no vehicle was heard within 1 s" in result.output
