"""A vehicle would be sent out of the map, or through its fence."""

import numpy as np
import pytest
from helpers.noticed import noticed
from helpers.plane_double import Plane
from helpers.plane_swarm import Swarm
from helpers.staging import mission, state, zones_on
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.core.airspace.mission_bounds import BoundsProblem, MissionBoundsCheck
from gcs.core.airspace.obstacle_map import mission_grid
from gcs.core.replanning.plan_targets import plan_options
from gcs.core.replanning.return_routes import landing_of
from gcs.core.tasking.mission_builder import MissionBuilder
from gcs.mavlink.autopilots import ARDUPLANE, PX4
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.model import Mission, NoticeCode, Waypoint, read_only
from gcs.planning.manoeuvres.landing import plan_return_route
from gcs.planning.planner_inputs import AgentState
from gcs.planning.team_routes import plan_routes

FENCE = """
[fence]
max_alt_rel_m = 200.0
[[fence.areas]]
kind = "inclusion"
corners_deg = [[33.2, -87.6], [33.2, -87.59], [33.209, -87.59], [33.209, -87.6]]
[[fence.areas]]
kind = "exclusion"
circle = [33.2045, -87.595, 100.0]
"""  # about 930 m to the east, 1000 m to the north; the circle is in the middle of it
CONFIG = mission(agents=[(100.0, 200.0)], births=[(500.0, 200.0)], tables=FENCE)
HOME = Home(33.2005, -87.599, 70.0)
ABOUT = state(1, (100.0, 200.0))


def problem(*points_m, end="loiter", home=HOME, wait_m=None, profile=ARDUPLANE, alt_rel_m=100.0, seen=ABOUT):
    check = MissionBoundsCheck(CONFIG, zones_on(mission_grid(CONFIG, 0)))
    places = [CONFIG.local_frame.to_geodetic(*point) for point in points_m]
    centre_deg = None if wait_m is None else CONFIG.local_frame.to_geodetic(*wait_m)
    wait = None if centre_deg is None else Waypoint(*centre_deg, alt_rel_m, 10.0)
    waypoints = tuple(Waypoint(*place, alt_rel_m, 10.0) for place in places)
    items = build_items(profile, Mission(1, 1, waypoints, 30.0, end, wait), home)
    found = check.problem(items[profile.home_items :], seen)
    return "" if found is None else found.text


def test_a_mission_inside_passes():
    assert problem((200.0, 200.0), (400.0, 300.0)) == ""
    assert problem((200.0, 200.0), (400.0, 300.0), end="land", profile=PX4) == ""


@pytest.mark.parametrize(
    ("what", "expected"),
    [
        (problem((200.0, 200.0), (-300.0, 200.0)), "point 2 of 3 (waypoint at 33.2"),
        (problem((200.0, 200.0), (-300.0, 200.0)), "lies outside the map"),
        (problem((200.0, 200.0), (1200.0, 200.0)), "lies outside the fence"),
        (problem((200.0, 200.0), (470.0, 500.0)), "lies outside the fence"),
        (problem((200.0, 200.0), wait_m=(1200.0, 200.0)), "(loiter_unlim at"),
        (problem((200.0, 200.0), end="land", home=Home(33.25, -87.6, 70.0)), "outside the map"),
        (problem((200.0, 200.0), alt_rel_m=250.0), "250 m high, above the fence's ceiling of 200 m"),
        (problem((200.0, 200.0), alt_rel_m=float("nan")), "has no height"),
    ],
)
def test_no_item_outside_the_map_or_the_fence_passes(what, expected):
    assert expected in what


def test_a_vehicle_in_an_area_to_stay_out_of_may_leave_it():
    inside = state(1, (470.0, 500.0))
    assert problem((500.0, 500.0), (470.0, 300.0), seen=inside) == ""
    assert "fence" in problem((500.0, 500.0), (470.0, 300.0), seen=ABOUT)


PLANNED = (
    FENCE
    + """
[planning]
shape = "flyable"
clearance_m = {clearance_m}
[map]
random_threshold = 0.05
[mission]
end = "{end}"
"""
)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(["loiter", "land"]),
    st.sampled_from([0.0, 30.0]),
    st.booleans(),
)
def test_no_planned_mission_is_refused(seed, end, clearance_m, is_fenced):
    """Start and target are on the map, outside it, or beyond the fence."""
    tables = PLANNED.format(end=end, clearance_m=clearance_m)
    config = mission(tables=tables if is_fenced else tables.removeprefix(FENCE))
    grid, rng, far_m = (
        mission_grid(config, seed),
        np.random.default_rng(seed),
        1040.0 if is_fenced else 2060.0,
    )
    start_m, target_m = (tuple(rng.uniform(-60.0, far_m, 2).tolist()) for _ in range(2))
    start = AgentState(*start_m, float(rng.uniform(-3.0, 3.0)), 20.0)
    about, options, landing = state(1, start_m), plan_options(config), landing_of(config.airframe_of(1))
    builder = MissionBuilder(config)
    home_m = config.local_frame.to_local(HOME.lat_deg, HOME.lon_deg)
    for route in plan_routes(grid, {1: start}, {(0, 0): target_m}, {}, options).routes:
        back = landing and plan_return_route(grid, start, route.points_m, home_m, options, landing)
        items = build_items(ARDUPLANE, builder.of(route, 1, about, back), HOME)
        check = MissionBoundsCheck(config, zones_on(grid))
        assert check.problem(items[ARDUPLANE.home_items :], about) is None


def test_a_mission_that_is_refused_leaves_the_vehicle_with_the_one_that_it_flies():
    class Nowhere:
        wrong = None

        def problem(self, _items, _state):
            return self.wrong

        def flight_problem(self, *_flight):
            return None

    swarm = Swarm(1)
    swarm.tasking._bounds = check = Nowhere()
    swarm.task(1)
    swarm.run(10.0)
    plane: Plane = swarm.planes[1]
    held, count = list(plane.store), len(plane.requests)
    text = "point 1 of 2 (waypoint at 0.0, 0.0) lies outside the map"
    check.wrong = BoundsProblem("map", text)
    for _ in range(3):
        swarm.task(1, read_only([[0.0, 700.0]]))
        swarm.run(10.0)
    assert plane.store == held
    assert len(plane.requests) == count
    (alarm,) = noticed(swarm.effects, NoticeCode.MISSION_HELD_BACK)
    assert alarm.parameters["reason"] == f"{text}; the vehicle keeps its onboard mission"
    assert not swarm.reports()[-1].ok
