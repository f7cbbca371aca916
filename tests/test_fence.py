"""A user would draw a fence that means something else to the vehicle than to the planner."""

import numpy as np
import pytest

from gcs.config import parse, read_text
from gcs.core.airspace.obstacle_map import mission_grid
from gcs.errors import ConfigError
from gcs.fence import fence_of, rally_of

HEAD = """
name = "field"
[frame]
lat_deg = 33.2
lon_deg = -87.6
alt_msl_m = 70.0
[map]
nodes_east = 51
nodes_north = 51
[[agents]]
system_id = 1
east_m = 200.0
north_m = 200.0
"""
SQUARE = "corners_deg = [[33.2, -87.6], [33.215, -87.6], [33.215, -87.582], [33.2, -87.582], [33.2, -87.6]]"
INCLUSION = f'[[fence.areas]]\nkind = "inclusion"\n{SQUARE}\n'


def fenced(text):
    return parse(HEAD + text, "field.toml")


def test_the_length_of_a_route_beyond_the_fence_is_reported():
    config = fenced(f'[[fence.areas]]\nkind = "inclusion"\n{SQUARE}\n')
    fence, frame = fence_of(config), config.local_frame
    assert len(fence.areas[0].corners_deg) == 4
    assert fence.beyond([(100.0, 100.0), (1500.0, 1500.0)], frame) == 0.0
    assert fence.beyond([(100.0, 100.0), (100.0, 2000.0)], frame) == pytest.approx(336.0, abs=6.0)
    assert fence.beyond([(-5.0, 100.0)], frame) > 0.0


def test_circles_are_kept_out_of_and_planned_around():
    config = fenced('[[fence.areas]]\nkind = "exclusion"\ncircle = [33.209, -87.59, 100.0]\n')
    fence, frame = fence_of(config), config.local_frame
    centre = frame.to_local(33.209, -87.59)
    assert fence.beyond([centre], frame)
    assert not fence.beyond([(centre[0] + 101.0, centre[1])], frame)
    grid = mission_grid(config, 1)
    assert grid.blocked[grid.node_of(centre)]
    assert 0 < grid.blocked.sum() < 60


def test_routes_are_planned_inside_the_area_to_stay_in():
    grid = mission_grid(fenced(f'[[fence.areas]]\nkind = "inclusion"\n{SQUARE}\n'), 1)
    assert not grid.blocked[grid.node_of((800.0, 800.0))]
    assert grid.blocked[grid.node_of((800.0, 1900.0))]
    assert np.mean(grid.blocked) == pytest.approx(1.0 - 1663 * 1678 / 2000**2, abs=0.06)


@pytest.mark.parametrize(
    ("text", "key", "said"),
    [
        ('[[fence.areas]]\nkind = "inclusion"\n', "fence.areas[0]", "either corners_deg or circle"),
        (
            '[[fence.areas]]\nkind = "exclusion"\ncorners_deg = [[33.2, -87.6], [33.21, -87.6]]\n',
            "fence.areas[0].corners_deg",
            "three different corners",
        ),
        (
            INCLUSION + '[[fence.areas]]\nkind = "inclusion"\ncircle = [33.2, -87.6, 900.0]\n',
            "fence",
            "draw a single one",
        ),
        (
            "[fence]\nmax_alt_rel_m = 80.0\n",
            "fence.max_alt_rel_m",
            "more than the highest altitude layer, 180 m",
        ),
        (
            INCLUSION + "[[rally]]\nlat_deg = 33.3\nlon_deg = -87.6\nalt_rel_m = 90\n",
            "rally[0]",
            "outside the fence",
        ),
    ],
)
def test_a_fence_that_makes_no_sense_is_named(text, key, said):
    with pytest.raises(ConfigError) as caught:
        fence_of(fenced(text), "field.toml")
    assert caught.value.key == key
    assert said in str(caught.value)


def test_zones_of_the_map_are_the_fence_by_default(tmp_path):
    zones = """{"type": "FeatureCollection", "features": [
      {"type": "Feature", "properties": {"kind": "boundary"}, "geometry": {"type": "Polygon", "coordinates":
        [[[-87.6, 33.2], [-87.58, 33.2], [-87.58, 33.217], [-87.6, 33.217], [-87.6, 33.2]]]}},
      {"type": "Feature", "properties": {"radius": 50}, "geometry":
        {"type": "Point", "coordinates": [-87.59, 33.21]}}]}"""
    (tmp_path / "zones.geojson").write_text(zones)
    path = tmp_path / "field.toml"
    text = HEAD.replace("[map]", '[map]\ngeojson = "zones.geojson"')
    path.write_text(text)
    areas = fence_of(parse(*read_text(str(path)))).areas
    assert [(area.stay_in, area.radius_m) for area in areas] == [(True, 0.0), (False, 50.0)]
    path.write_text(text + "[fence]\nfrom_map = false\n")
    assert fence_of(parse(*read_text(str(path)))).areas == ()


def test_rally_points_are_read():
    (point,) = rally_of(fenced("[[rally]]\nlat_deg = 33.205\nlon_deg = -87.59\nalt_rel_m = 90\n"))
    assert (point.lat_deg, point.lon_deg, point.alt_rel_m) == (33.205, -87.59, 90)


def test_a_height_above_sea_level_counts_from_the_origin_of_the_frame():
    config = fenced(
        "[fence]\nmax_alt_msl_m = 270.0\n[[rally]]\nlat_deg = 33.205\nlon_deg = -87.59\nalt_msl_m = 165.4\n"
    )
    assert fence_of(config).max_alt_rel_m == 200.0
    assert [point.alt_rel_m for point in rally_of(config)] == [95]
    level = fenced("[[rally]]\nlat_deg = 33.205\nlon_deg = -87.59\nalt_agl_m = 80.4\n")
    assert [point.alt_rel_m for point in rally_of(level)] == [80]


CIRCLE = '[[fence.areas]]\nkind = "exclusion"\ncircle = [33.209, -87.59, 100.0]\n'
RALLY = "[[rally]]\nlat_deg = 33.205\nlon_deg = -87.59\n"


@pytest.mark.parametrize(
    ("limits", "is_held"),
    [
        ("", True),
        ("height_m = 60.0", False),
        ("height_m = 90.0", True),
        ('floor_m = 260.0\nreference = "msl"', True),
        ('floor_m = 400.0\nreference = "msl"', False),
    ],
)
def test_an_area_that_all_layers_pass_above_or_below_is_not_sent_and_not_forgotten(limits, is_held):
    """Autopilots hold an area at all heights: the mission would breach it."""
    config = fenced(CIRCLE + limits)
    fence = fence_of(config)
    assert (len(fence.areas), len(fence.passed)) == ((1, 0) if is_held else (0, 1))
    grid = mission_grid(config, 1)
    assert bool(grid.blocked.any()) is is_held


@pytest.mark.parametrize(
    ("text", "key", "said"),
    [
        (
            "[fence]\nmax_alt_rel_m = 200.0\nmax_alt_msl_m = 270.0\n",
            "fence",
            "either max_alt_rel_m or max_alt_msl_m",
        ),
        (
            "[fence]\nmax_alt_msl_m = 60.0\n",
            "fence.max_alt_msl_m",
            "expected more than frame.alt_msl_m, 70 m",
        ),
        ("[fence]\nmax_alt_msl_m = nan\n", "fence.max_alt_msl_m", "expected"),
        (RALLY, "rally[0]", "one of alt_rel_m, alt_msl_m and alt_agl_m"),
        (RALLY + "alt_rel_m = 90\nalt_msl_m = 160.0\n", "rally[0]", "one of alt_rel_m, alt_msl_m"),
        (
            RALLY + "alt_msl_m = 75.0\n",
            "rally[0]",
            "is 5 m above home (frame.alt_msl_m); expected 10 m or more",
        ),
        (CIRCLE + "ceiling_m = 60.0\n", "fence.areas[0].reference", "is missing"),
        (
            CIRCLE + 'ceiling_m = nan\nreference = "msl"\n',
            "fence.areas[0].ceiling_m",
            "expected metres, not nan",
        ),
        (CIRCLE + 'ceiling_m = 60.0\nreference = "agl"\n', "fence.areas[0].reference", "expected one of"),
        (INCLUSION + "height_m = 60.0\n", "fence.areas[0]", "an area to stay in has no heights"),
        ("[[map.obstacles]]\nheight_m = 60.0\n", "map.obstacles[0]", "one of disc_m, box_m and polygon_m"),
        (
            "[[map.obstacles]]\ndisc_m = [1.0, 1.0, 1.0]\nbox_m = [1.0, 1.0, 2.0, 2.0]\n",
            "map.obstacles[0]",
            "one of disc_m, box_m and polygon_m",
        ),
        (
            "[[map.obstacles]]\npolygon_m = [[1.0, 1.0], [1.0, 1.0], [2.0, 2.0]]\n",
            "map.obstacles[0].polygon_m",
            "three different corners",
        ),
        (
            "[[map.obstacles]]\ndisc_m = [1.0, 1.0, 1.0]\nheight_m = -3.0\n",
            "map.obstacles[0].height_m",
            "above the ground, above 0, not -3",
        ),
        ("[planning]\nvertical_clearance_m = -1.0\n", "planning.vertical_clearance_m", "expected"),
    ],
)
def test_heights_of_a_mission_file_that_make_no_sense_are_named(text, key, said):
    with pytest.raises(ConfigError) as caught:
        fence_of(fenced(text), "field.toml")
    assert caught.value.key == key
    assert said in str(caught.value)
