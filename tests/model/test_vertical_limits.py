"""A user would give an area heights that mean something else than he thinks."""

import math

import pytest

from gcs.model import UNLIMITED, LayerHeights, VerticalLimits, limits_text, vertical_limits


def test_an_area_without_heights_reaches_from_the_ground_to_the_sky():
    assert vertical_limits() == UNLIMITED
    assert UNLIMITED.bounds_m == (-math.inf, math.inf)
    assert limits_text(UNLIMITED) == ""


def test_a_height_is_above_the_ground_and_other_limits_name_their_reference():
    assert vertical_limits(height_m=35) == VerticalLimits(None, 35.0, "ground")
    assert vertical_limits(None, 400, 900.5, "msl") == VerticalLimits(400.0, 900.5, "msl")
    assert vertical_limits(floor_m=-10, reference="home") == VerticalLimits(-10.0, None, "home")
    assert limits_text(vertical_limits(None, 400, 900.5, "msl")) == "400 to 900.5 m MSL"
    assert limits_text(vertical_limits(height_m=35)) == "up to 35 m above ground"
    assert limits_text(vertical_limits(floor_m=-10, reference="home")) == "from -10 m above home"


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"floor_m": 90, "ceiling_m": 60, "reference": "home"}, "ceiling_m: 60 m is not above floor_m, 90 m"),
        ({"floor_m": 60, "ceiling_m": 60, "reference": "home"}, "ceiling_m: 60 m is not above floor_m"),
        ({"ceiling_m": -5, "reference": "ground"}, "ceiling_m: -5 m is not above the ground"),
        ({"floor_m": -5, "reference": "ground"}, "floor_m: -5 m is below the ground; leave it out"),
        (
            {"ceiling_m": 60},
            'reference: is missing; floor_m and ceiling_m are above "home", "msl" or "ground"',
        ),
        ({"ceiling_m": 60, "reference": "agl"}, 'reference: expected "home", "msl" or "ground", not \'agl\''),
        ({"ceiling_m": 60, "reference": ["msl"]}, "reference: expected"),
        ({"reference": "msl"}, "reference: there is no floor_m or ceiling_m"),
        ({"height_m": 20, "ceiling_m": 60, "reference": "msl"}, "height_m: expected either height_m, or"),
        (
            {"height_m": 20, "reference": "msl"},
            'height_m: is above the ground; reference = "msl" contradicts',
        ),
        ({"height_m": 0}, "height_m: expected metres above the ground, above 0, not 0"),
        ({"height_m": math.nan}, "height_m: expected metres, not nan"),
        ({"floor_m": math.inf, "reference": "msl"}, "floor_m: expected metres, not inf"),
        ({"floor_m": "120 ft", "reference": "msl"}, "floor_m: expected metres, not '120 ft'"),
        ({"floor_m": True, "reference": "msl"}, "floor_m: expected metres, not True"),
        ({"floor_m": 10**400, "reference": "msl"}, "floor_m: expected metres, not 1000"),
    ],
)
def test_heights_that_contradict_each_other_are_refused(keys, said):
    with pytest.raises(ValueError, match="^" + said.replace('"', ".")):
        vertical_limits(**keys)


LAYERS = LayerHeights(100.0, 180.0, 70.0, 20.0)


@pytest.mark.parametrize(
    ("keys", "is_met", "is_below"),
    [
        ({}, True, False),
        ({"height_m": 80}, False, True),
        ({"height_m": 80.1}, True, False),
        ({"ceiling_m": 150, "reference": "msl"}, False, True),
        ({"ceiling_m": 150.1, "reference": "msl"}, True, False),
        ({"floor_m": 200, "reference": "home"}, False, False),
        ({"floor_m": 199.9, "reference": "home"}, True, False),
        ({"floor_m": 270, "reference": "msl"}, False, False),
        ({"floor_m": 110, "ceiling_m": 120, "reference": "ground"}, True, False),
        ({"floor_m": 40, "ceiling_m": 80, "reference": "ground"}, False, True),
        ({"ceiling_m": 20, "reference": "msl"}, False, False),  # 50 m below level ground
    ],
)
def test_the_vertical_clearance_decides_which_layers_an_area_blocks(keys, is_met, is_below):
    limits = vertical_limits(**keys)
    assert LAYERS.meet(limits) is is_met
    assert LAYERS.lie_above(limits) is is_below


OVER_TERRAIN = LayerHeights(120.0, -math.inf, 70.0, 20.0)


def test_over_terrain_the_flight_band_passes_areas_and_climbs_avoid_those_up_to_it():
    for keys in (
        {"height_m": 80},
        {"floor_m": 100, "reference": "ground"},
        {"ceiling_m": 500, "reference": "msl"},
    ):
        assert not OVER_TERRAIN.meet(vertical_limits(**keys))
        assert OVER_TERRAIN.lie_above(vertical_limits(**keys))
    assert not OVER_TERRAIN.lie_above(vertical_limits(floor_m=210.0, reference="msl"))
