"""A user would lose the aircraft to a mission that is not the one planned."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gcs.mavlink.autopilots import ARDUPLANE
from gcs.mavlink.frames.codec import Encoder, decode
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home, item_of
from gcs.model import Mission, Waypoint

HOME = Home(-35.3632621, 149.165237, 584.09)
WAYPOINTS = st.builds(
    Waypoint,
    st.floats(-85, 85),
    st.floats(-180, 180),
    st.floats(0, 5000),
    st.floats(0.1, 500),
)


def mission(*points):
    return Mission(
        1, 1, points or (Waypoint(-35.36, 149.16, 100.0, 10.0), Waypoint(-35.35, 149.17, 120.0, 10.0))
    )


def over_the_wire(items):
    encode = Encoder(1, 1)
    return [item_of(decode(encode(item.message(seq, 255, 190)))[0][0]) for seq, item in enumerate(items)]


def test_home_comes_first_and_the_aircraft_stays_at_the_last_point():
    items = build_items(ARDUPLANE, mission(), HOME)
    assert [i.command for i in items] == [16, 16, 16, 17]
    assert (items[0].x, items[0].y, items[0].frame) == (-353632621, 1491652370, 0)
    assert items[1].param2 == 10.0
    assert items[1].frame == 3
    assert items[2][2:5] == items[3][2:5] == (-353500000, 1491700000, 120.0)


def test_a_mission_without_waypoints_is_no_mission():
    with pytest.raises(ValueError, match="no waypoint"):
        build_items(ARDUPLANE, Mission(1, 1, ()), HOME)


def test_a_tiny_acceptance_radius_does_not_become_the_vehicles_large_default():
    assert build_items(ARDUPLANE, mission(Waypoint(1.0, 1.0, 50.0, 0.3)), HOME)[1].param2 >= 1.0


@given(st.lists(WAYPOINTS, min_size=1, max_size=20))
def test_what_an_autopilot_stores_and_sends_back_counts_as_equal(points):
    items = build_items(ARDUPLANE, mission(*points), HOME)
    stored = [
        ARDUPLANE.normalised(i)._replace(
            frame={0: 5, 3: 6}[i.frame], param4=math.nan, autocontinue=0, z_m=round(i.z_m, 2)
        )
        for i in over_the_wire(items)
    ]
    stored[0] = stored[0]._replace(x=1, y=2, z_m=3.0)
    assert ARDUPLANE.difference(items, stored) == ""


@given(st.lists(WAYPOINTS, min_size=1, max_size=5), st.data())
def test_every_difference_that_would_be_flown_is_named(points, data):
    items = build_items(ARDUPLANE, mission(*points), HOME)
    seq = data.draw(st.integers(1, len(items) - 1))
    change = data.draw(
        st.sampled_from(
            [
                {"x": items[seq].x + 1},
                {"y": items[seq].y - 1},
                {"z_m": items[seq].z_m + 0.1},
                {"frame": 0},
                {"command": 82},
            ]
        )
    )
    changed = [*items]
    changed[seq] = items[seq]._replace(**change)
    difference = ARDUPLANE.difference(items, changed)
    assert difference.startswith(f"item {seq}: {next(iter(change))} ")


def test_missing_items_are_a_difference():
    items = build_items(ARDUPLANE, mission(), HOME)
    assert ARDUPLANE.difference(items, items[:-1]) == "3 items instead of 4"


def test_a_height_that_is_no_number_is_a_difference():
    items = build_items(ARDUPLANE, mission(), HOME)
    assert (
        ARDUPLANE.difference(items, [*items[:2], items[2]._replace(z_m=math.nan), items[3]])
        == "item 2: z_m is nan"
    )


@given(st.integers(1, 254), st.floats(0.0, 1e-6))
@example(2, 1.42e-14)
def test_a_radius_just_below_a_whole_number_reads_back_equal(whole_m, below_m):
    """1.9999999999999858 m arrives as 2.0: the mission counted as different, and was uploaded again."""
    items = build_items(ARDUPLANE, mission(Waypoint(1.0, 1.0, 50.0, whole_m - below_m)), HOME)
    stored = [item._replace(param2=float(int(item.param2))) for item in over_the_wire(items)]
    assert ARDUPLANE.difference(items, stored) == ""
