"""Zones from GeoJSON: where they lie, and what is said of a broken file."""

from __future__ import annotations

import json

import numpy as np
import pytest

from gcs.config import load, parse, read_text
from gcs.core.airspace.obstacle_map import mission_grid
from gcs.errors import ConfigError
from gcs.geo import LocalFrame
from gcs.geojson import read_zones
from gcs.model import UNLIMITED, VerticalLimits

FRAME = LocalFrame(33.2, -87.6, 70.0)
MISSION = """
name = "zoned"
[frame]
lat_deg = 33.2
lon_deg = -87.6
alt_msl_m = 70.0
[map]
geojson = "zones.geojson"  # next to it
[[agents]]
system_id = 1
east_m = 100.0
north_m = 100.0
"""


def ring(*corners_m):
    """Corners in local metres as GeoJSON has them."""
    return [[*FRAME.to_geodetic(*corner)[::-1]] for corner in (*corners_m, corners_m[0])]


def square(west, south, side):
    return ring((west, south), (west + side, south), (west + side, south + side), (west, south + side))


def feature(shape, coordinates, **properties):
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": shape, "coordinates": coordinates},
    }


def collection(*features):
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=1)


ZONES = collection(
    feature("Polygon", [square(400, 400, 400), square(520, 520, 160)]),
    feature("MultiPolygon", [[square(1200, 400, 100)], [square(1500, 400, 100)]], kind="no-fly-zone"),
    feature("Point", square(1000, 1400, 1)[0], radius=150.0, name="mast"),
    feature("Polygon", [square(30, 30, 1900)], kind="boundary"),
)


def write(folder, zones=ZONES, mission=MISSION):
    (folder / "zones.geojson").write_text(zones, encoding="utf-8")
    (folder / "mission.toml").write_text(mission, encoding="utf-8")
    return str(folder / "mission.toml")


def test_zones_block_the_cells_they_overlap_and_the_boundary_all_outside_it(tmp_path):
    grid = mission_grid(load(write(tmp_path)), 1)
    at = 40.0 * np.arange(51)
    east, north = np.meshgrid(at, at)

    def is_blocked(*point):
        return bool(grid.blocked[grid.node_of(point)])

    assert is_blocked(440, 440)
    assert not is_blocked(600, 600), "in the hole"
    assert is_blocked(1240, 440)
    assert is_blocked(1560, 440)
    assert not is_blocked(1400, 440)
    assert grid.blocked[np.hypot(east - 1000, north - 1400) < 149].all()
    assert not grid.blocked[(np.hypot(east - 1000, north - 1400) > 180) & (north > 1100) & (east > 80)
                            & (east < 1880) & (north < 1880)].any()  # fmt: skip
    assert grid.blocked[[0, 50], :].all()
    assert grid.blocked[:, [0, 50]].all()
    assert not is_blocked(80, 80)


def test_what_is_recorded_of_a_mission_holds_its_zones(tmp_path):
    text, source = read_text(write(tmp_path))
    (tmp_path / "zones.geojson").unlink()
    config = parse(text, source)
    assert len(config.zones.no_fly) == 4
    assert "# next to it" in text
    with pytest.raises(ConfigError, match=r"map.geojson: no such file: .*zones.geojson"):
        read_text(source)


@pytest.mark.parametrize(
    ("zones", "said"),
    [
        ("{", "zones.geojson: not valid JSON"),
        ("[1]", "expected GeoJSON"),
        (collection(feature("LineString", [[-87.6, 33.2], [-87.5, 33.2]])), r"\[0\].geometry: a no-fly-zone"),
        (collection(feature("Point", [-87.6, 33.2])), r"features\[0\].properties.radius: a Point needs"),
        (collection(feature("Point", [-87.6, 33.2], radius=50, kind="boundary")), "MultiPolygon, not"),
        (collection(feature("Polygon", [[[33.2, -87.6], [33.2, -95.0], [33.3, -87.6]]])), "in this order"),
        (collection(feature("Polygon", [square(0, 0, 9)[:2]])), "three different corners"),
        (collection(feature("Polygon", [[[1, 2], [None, 3], [1, 1]]])), "expected a position"),
        (collection(feature("Polygon", [square(0, 0, 9)], kind="no-fly")), 'expected "no-fly-zone" or'),
        (collection(*[feature("Polygon", [square(0, 0, 9)], kind="boundary")] * 2), "second boundary"),
        (collection(feature("Polygon", [[[33.2, -87.6], [33.2, -87.5], [33.3, -87.6]]])), "far from the"),
        (
            collection(feature("Polygon", [square(0, 0, 9)], floor_m=90, ceiling_m=60, reference="msl")),
            r"features\[0\].properties: ceiling_m: 60 m is not above floor_m, 90 m",
        ),
        (collection(feature("Polygon", [square(0, 0, 9)], ceiling_m=60)), "reference: is missing"),
        (collection(feature("Polygon", [square(0, 0, 9)], ceiling_m=60, reference="AGL")), "not 'AGL'"),
        (collection(feature("Point", square(0, 0, 9)[0], radius=9, height_m="6 ft")), "expected metres"),
        (collection(feature("Polygon", [square(0, 0, 9)], kind="boundary", height_m=9)), "has no heights"),
    ],
)  # fmt: skip
def test_a_broken_file_is_refused_with_its_defect(tmp_path, zones, said):
    with pytest.raises(ConfigError, match=said):
        load(write(tmp_path, zones))


def test_the_name_of_a_file_is_found_on_a_line_of_its_own():
    with pytest.raises(ConfigError, match="on a line of its own"):
        parse(MISSION, "mission.toml")


def test_zones_of_other_places_on_earth_are_left_out():
    """At the antipodes lies what has east and north 0 too."""
    zones = collection(
        feature("Point", [92.4, -33.2], radius=1e5), feature("Point", [-87.6, 33.2], radius=10)
    )
    assert len(read_zones(zones, "f").to_local(FRAME).no_fly) == 1


def test_zones_have_the_heights_of_their_properties(tmp_path):
    zones = collection(
        feature("Polygon", [square(400, 400, 100)], height_m=35),
        feature(
            "MultiPolygon",
            [[square(0, 0, 9)], [square(90, 0, 9)]],
            floor_m=400,
            ceiling_m=None,
            reference="msl",
        ),
        feature("Point", square(800, 800, 9)[0], radius=60, ceiling_m=150, reference="home"),
        feature("Polygon", [square(1200, 400, 100)], height_m=None, reference="of the survey"),
    )
    config = load(write(tmp_path, zones))
    above = VerticalLimits(400.0, None, "msl")
    assert [zone.limits for zone in config.zones.no_fly] == [
        VerticalLimits(None, 35.0), above, above, VerticalLimits(None, 150.0, "home"), UNLIMITED,
    ]  # fmt: skip
    grid = mission_grid(config, 1)
    assert [bool(grid.blocked[grid.node_of(place)]) for place in ((440, 440), (800, 800), (1240, 440))] == [
        False, True, True,
    ]  # fmt: skip
