"""A run in other programs: what they show is where vehicles flew, where targets are, and what was lost."""

import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from typer.testing import CliRunner

from gcs.cli import app
from gcs.config import parse
from gcs.io.recording.reader import read, read_info
from gcs.mavlink.frames.codec import scan
from gcs.model import Datagram, Picture, Truth

RECORDINGS = Path(__file__).parents[2] / "recordings"
DEATH = RECORDINGS / "death.mcap"
"""Four vehicles; vehicle 2 is lost after 11 s."""
GPX = {"g": "http://www.topografix.com/GPX/1/1"}
KML = {"k": "http://www.opengis.net/kml/2.2"}


def export(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["export", *map(str, arguments)], catch_exceptions=False)
    return result.exit_code, " ".join(result.output.split())


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export")
    for ending in ("kml", "geojson", "gpx"):
        code, text = export(DEATH, "-o", folder / f"run.{ending}")
        assert (code, text.partition(": ")[2]) == (0, "4 flown paths, 5 planned routes, 5 targets, 1 losses")
    return folder


def features(files: Path, kind: str) -> list[dict[str, Any]]:
    found = json.loads((files / "run.geojson").read_text())["features"]
    return [one for one in found if one["properties"]["kind"] == kind]


def reported() -> dict[int, list[tuple[float, float, float]]]:
    """Every position of each vehicle, as it came over the link."""
    found: dict[int, list[tuple[float, float, float]]] = {}
    for record in read(DEATH, only=[Datagram]):
        for frame in scan(record.value.data).frames:
            if frame.message_id == 33:
                m = frame.message()
                found.setdefault(frame.system_id, []).append((m.lon * 1e-7, m.lat * 1e-7, m.alt * 1e-3))
    return found


def test_flown_paths_are_the_reported_positions_above_mean_sea_level(files: Path) -> None:
    everywhere = reported()
    for path in features(files, "flown path"):
        positions = np.array(path["geometry"]["coordinates"])
        known = np.array(everywhere[int(path["properties"]["vehicle"])])
        gaps = np.abs(known[:, None] - positions[None]).min(axis=0)
        assert (gaps < (1e-7, 1e-7, 0.006)).all()
        assert len(path["properties"]["coordTimes"]) == len(positions)


def test_three_formats_have_the_same_path(files: Path) -> None:
    expected = features(files, "flown path")[0]["geometry"]["coordinates"]
    points = ET.parse(files / "run.gpx").findall("g:trk", GPX)[0].findall("g:trkseg/g:trkpt", GPX)
    gpx = [(float(p.get("lon")), float(p.get("lat")), float(p.find("g:ele", GPX).text)) for p in points]
    line = ET.parse(files / "run.kml").find(".//k:Folder/k:Placemark//k:coordinates", KML).text
    kml = [tuple(map(float, words.split(","))) for words in line.split()]
    assert gpx == kml == [tuple(one) for one in expected]


def test_a_route_is_as_high_as_its_layer_and_says_when_it_was_replaced(files: Path) -> None:
    config = parse(read_info(DEATH).config_text, "recorded")
    paths = features(files, "flown path")
    where = {p["properties"]["vehicle"]: set(map(tuple, p["geometry"]["coordinates"])) for p in paths}
    lowest_m = config.frame.alt_msl_m + config.mission.altitude_rel_m
    for route in features(files, "planned route"):
        begin, *planned = route["geometry"]["coordinates"]
        assert tuple(begin) in where[route["properties"]["vehicle"]]
        heights = {position[2] for position in planned}
        assert len(heights) == 1
        assert (heights.pop() - lowest_m) % config.mission.layer_step_m == pytest.approx(0.0, abs=1e-6)
    lost = [one for one in features(files, "planned route") if one["properties"]["vehicle"] == "2"]
    assert all("replaced" in one["properties"] for one in lost)


def test_targets_lie_in_their_ellipses_and_near_the_truth(files: Path) -> None:
    config = parse(read_info(DEATH).config_text, "recorded")
    truth = [one.value for one in read(DEATH, only=[Truth])][-1]
    true_m = [(t.east_m, t.north_m) for t in truth.objects if t.kind == "targets"]
    picture = [r.value for r in read(DEATH, only=[Picture]) if r.value.kind == "targets"][-1]
    tracks = {f"T{t.label[0]}.{t.label[1]}": t for t in picture.tracks}
    outlines = {e["properties"]["target"]: e for e in features(files, "target ellipse")}
    for target in features(files, "target"):
        name = target["properties"]["target"]
        lon, lat, _ = target["geometry"]["coordinates"]
        here = np.array(config.local_frame.to_local(lat, lon))
        assert np.linalg.norm(true_m - here, axis=1).min() < 15.0
        ring = outlines[name]["geometry"]["coordinates"][0]
        ring_m = np.array([config.local_frame.to_local(lat, lon) for lon, lat, _ in ring])
        offset = ring_m - here
        distance2 = np.einsum("ni,ij,nj->n", offset, np.linalg.inv(tracks[name].cov[:2, :2]), offset)
        assert distance2 == pytest.approx(np.full(len(ring), 5.991), rel=0.02)
        x, y = ring_m.T
        assert (x[:-1] * y[1:] - x[1:] * y[:-1]).sum() > 0.0, "RFC 7946: an outline is anticlockwise"
        assert ring[0] == ring[-1]


def test_a_lost_vehicle_is_marked_in_every_format(files: Path) -> None:
    (loss,) = features(files, "loss")
    assert (loss["properties"]["vehicle"], loss["properties"]["status"]) == ("2", "lost")
    assert loss["properties"]["time"] == "2026-01-01T00:00:11.000Z"
    names = {
        mark.findtext("k:name", "", KML)
        for mark in ET.parse(files / "run.kml").iter(f"{{{KML['k']}}}Placemark")
    }
    assert "vehicle 2 lost" in names
    points = ET.parse(files / "run.gpx").findall("g:wpt", GPX)
    assert "vehicle 2 lost" in {point.findtext("g:name", "", GPX) for point in points}


def test_a_log_has_its_flown_paths(flight: Path, tmp_path: Path) -> None:
    code, text = export(flight / "link.tlog", "-o", tmp_path / "log.GPX")
    assert code == 0
    assert "0 planned routes" in text
    assert (
        len(ET.parse(tmp_path / "log.GPX").findall("g:trk", GPX)) == int(text.split(": ")[1].split()[0]) > 0
    )


def test_the_kml_can_begin_a_mission_file(files: Path, tmp_path: Path) -> None:
    """An ellipse of a target would be a no-fly zone around its birth, and a loss the start of a vehicle."""
    made = tmp_path / "m.toml"
    result = CliRunner().invoke(app, ["init", str(files / "run.kml"), "-o", str(made)])
    assert result.exit_code == 0, result.output
    config = parse(made.read_text(), "m.toml")
    assert len(config.births) == 5
    assert not config.fence.areas
    assert "'vehicle 2 lost' is left out" in result.output
    assert "# vehicle 2 lost" not in made.read_text()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((DEATH, "-o", "run.shp"), "expected a name that ends in .kml, .geojson"),
        (("missing.mcap", "-o", "run.kml"), "cannot be read"),
        ((DEATH, "-o", "no/folder/run.kml"), "cannot be written"),
        ((__file__, "-o", "run.kml"), "no MAVLink frame"),
    ],
)
def test_mistakes_are_named(
    arguments: tuple[object, ...], said: str, tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    code, text = export(*arguments)
    assert code == 2
    assert said in text


def test_a_file_is_not_replaced_without_force(files: Path) -> None:
    code, text = export(DEATH, "-o", files / "run.gpx")
    assert (code, "--force" in text) == (2, True)
    assert export(DEATH, "-o", files / "run.gpx", "--force")[0] == 0
