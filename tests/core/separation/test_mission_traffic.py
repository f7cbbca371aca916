"""A new mission would lead a vehicle in the air from its layer through another vehicle at once."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.hills import elevation_of, hill
from helpers.sky import Sky, fly_on, place

from gcs.config.schema import TerrainTable
from gcs.core.separation import mission_traffic
from gcs.core.separation.forward_flight import Flight, Goal, GoalKind
from gcs.core.tasking.tasking_state import QueuedRoute
from gcs.model import NoticeCode, read_only
from sim_vehicles.autopilots.autopilot_traits import Mode


@pytest.fixture
def sky():
    """Vehicle 1 flies its mission; vehicle 2 is held 200 m ahead, a layer above."""
    sky = Sky((600.0, 600.0, 60.0), (1700.0, 1700.0, 80.0)).fly(20.0)
    first, held = sky.planes[1].airframe, sky.planes[2]
    ahead = np.array((np.sin(first.heading_rad), np.cos(first.heading_rad)))
    held.autopilot.set_mode(Mode.FBWA)
    place(held, *(np.array((first.east_m, first.north_m)) + 290.0 * ahead), first.alt_rel_m + 20.0)
    held.autopilot.set_mode(Mode.LOITER)
    return fly_on(sky, 5.0)  # its new position is used then


def higher(sky, vehicle=1):
    """Return the route of a vehicle, a layer higher and straight ahead."""
    flown, plane = sky.run_.engine.state.agents[vehicle].routes.flown, sky.planes[vehicle].airframe
    here = np.array((plane.east_m, plane.north_m))
    ahead = np.array((np.sin(plane.heading_rad), np.cos(plane.heading_rad)))
    return replace(flown, points_m=read_only([here, here + 600.0 * ahead]), layer=flown.layer + 1)


def test_a_new_mission_waits_while_it_leads_through_a_held_vehicle(sky):
    engine, route = sky.run_.engine, higher(sky)
    engine.stages.tasking.enqueue_upload(route, sky.run_.t_ns)
    fly_on(sky, 3.0)
    assert not route.is_same(engine.state.agents[1].tasking.onboard.route)
    ((_, notice),) = sky.told(NoticeCode.MISSION_WAITS)
    assert notice.vehicle == 1
    assert notice.parameters["reason"].startswith("would come within")
    assert "agent 2" in notice.parameters["reason"]


def test_another_route_is_not_judged_by_the_one_before(sky):
    """A route that is planned again when its upload begins was taken for clear, as the older one was."""
    traffic, t_ns = sky.run_.engine.stages.mission_traffic, sky.run_.t_ns
    assert not traffic.holds_back(sky.run_.engine.state.agents[1].routes.flown, t_ns)
    assert traffic.holds_back(higher(sky), t_ns)


def test_a_mission_that_waits_for_its_next_item_is_not_said_to_wait_for_the_traffic_of_an_older_one(sky):
    engine = sky.run_.engine
    assert engine.stages.mission_traffic.holds_back(higher(sky), sky.run_.t_ns)
    fly_on(sky, 1.0)
    waiting = QueuedRoute(engine.state.agents[1].routes.flown, sky.run_.t_ns, 10**30, False, None)
    engine.state.tasking.queue[1] = waiting
    assert not engine.stages.mission_traffic.check(sky.run_.t_ns)


def test_a_new_mission_does_not_wait_for_a_vehicle_far_away(sky):
    place(sky.planes[2], 100.0, 100.0, 80.0)
    fly_on(sky, 6.0)
    engine, route = sky.run_.engine, higher(sky)
    engine.stages.tasking.enqueue_upload(route, sky.run_.t_ns)
    assert not engine.stages.mission_traffic.holds_back(route, sky.run_.t_ns)


def test_a_new_mission_waits_for_one_that_another_vehicle_is_getting(sky):
    """Two whose uploads ended at one time flew side by side: each had been checked against a circle."""
    here = sky.planes[1].airframe
    ahead = np.array((np.sin(here.heading_rad), np.cos(here.heading_rad)))
    aside = np.array((ahead[1], -ahead[0]))
    beside = np.array((here.east_m, here.north_m)) + 500.0 * ahead + 250.0 * aside
    place(sky.planes[2], *beside, here.alt_rel_m + 20.0)
    sky.planes[2].autopilot.set_mode(Mode.FBWA)
    sky.planes[2].autopilot.set_mode(Mode.LOITER)
    fly_on(sky, 5.0)
    route = higher(sky)
    begin_m, end_m = route.points_m
    towards = replace(route, vehicle=2, points_m=read_only([begin_m + 0.7 * (end_m - begin_m), begin_m]))
    check = sky.run_.engine.stages.mission_traffic._order_check
    assert not check.mission_problem(route, {}, sky.run_.t_ns)
    assert "agent 2" in check.mission_problem(route, {2: towards}, sky.run_.t_ns)


def test_a_new_mission_waits_while_its_begin_leads_over_ground_that_is_too_high(sky):
    """From its circle a vehicle turned over higher ground, 10 m below the band; 5 s later it need not."""
    engine, route = sky.run_.engine, higher(sky)
    place(sky.planes[2], 100.0, 100.0, 80.0)
    fly_on(sky, 6.0)
    check = engine.stages.mission_traffic._order_check
    assert not check.mission_problem(route, {}, sky.run_.t_ns)
    here = sky.planes[1].airframe
    ahead = np.array((np.sin(here.heading_rad), np.cos(here.heading_rad)))
    aside_m = np.array((here.east_m, here.north_m)) + 150.0 * np.array((ahead[1], -ahead[0]))
    check._ground._terrain = TerrainTable(file="ground.tif", min_agl_m=50.0, max_agl_m=150.0)
    check._ground._elevation = elevation_of(hill(*aside_m, 60.0, 40.0, 70.0), 3000.0)
    assert not check.mission_problem(higher(sky), {}, sky.run_.t_ns)
    turns = replace(route, points_m=read_only([aside_m, aside_m + 300.0]))
    assert check.mission_problem(turns, {}, sky.run_.t_ns).endswith("m below the flight band")


def test_a_mission_does_not_follow_a_vehicle_that_the_present_circle_leaves(sky):
    """Near for a moment either way, it was sent: one ArduPlane followed another 52 m behind for 14 s."""
    check = sky.run_.engine.stages.mission_traffic._order_check
    apart_m = 1.1 * check._min_m
    ahead = Goal(GoalKind.WAYPOINT, 0.0, 5000.0, 10.0, 100.0)
    circle = Goal(GoalKind.CIRCLE, 80.0, 0.0, 80.0, 100.0)
    other = Flight(2, 0.0, apart_m, 100.0, 17.0, 0.0, 0.0, 0.0, 0.2, (ahead,))
    present = Flight(1, 0.0, 0.0, 100.0, 20.0, 0.0, 0.0, 0.0, 0.2, (circle,))
    assert "agent 2" in check._goes_along(replace(present, goals=(ahead,)), present, [other])
    assert not check._goes_along(present, present, [other])
    assert not check._goes_along(replace(present, goals=(ahead,)), present, [replace(other, speed_m_s=25.0)])


def test_a_mission_that_is_needed_at_once_does_not_wait(sky):
    """For example to get out of a no-fly zone that was closed."""
    engine, route = sky.run_.engine, higher(sky)
    assert engine.stages.mission_traffic.holds_back(route, sky.run_.t_ns)
    engine.stages.tasking.enqueue_upload(route, sky.run_.t_ns, at_once=True)
    fly_on(sky, 0.2)
    assert engine.state.tasking.is_uploading(1)


def test_a_new_mission_with_many_near_points_is_judged_by_all_that_are_flown_soon(sky):
    """Over terrain waypoints are close together: eight of them were flown in some seconds."""
    plane = sky.planes[1].airframe
    here = np.array((plane.east_m, plane.north_m))
    ahead = np.array((np.sin(plane.heading_rad), np.cos(plane.heading_rad)))
    along_m = np.array([*range(20, 201, 20), 220, 600], dtype=float)
    heights_m = 70.0 + plane.alt_rel_m + np.where(along_m > 200.0, 20.0, 0.0)
    route = replace(
        sky.run_.engine.state.agents[1].routes.flown,
        points_m=read_only(here + along_m[:, None] * ahead),
        wait_m=None,
        heights_msl_m=read_only(heights_m),
    )
    assert "agent 2" in sky.run_.engine.stages.mission_traffic.holds_back(route, sky.run_.t_ns)


def test_hundreds_of_missions_are_checked_a_few_at_a_time(monkeypatch):
    """With 190 new missions one event took 3 s, in which no scan was processed."""
    sky = Sky((600.0, 600.0, 60.0), (1700.0, 1700.0, 80.0)).fly(20.0)
    engine = sky.run_.engine
    traffic = engine.stages.mission_traffic
    checked = []
    monkeypatch.setattr(
        traffic._order_check, "mission_problem", lambda route, *_: checked.append(route.vehicle) or "is near"
    )
    monkeypatch.setattr(mission_traffic, "MAX_CHECKS", 1)
    for vehicle, agent in engine.state.agents.items():
        engine.state.tasking.queue[vehicle] = QueuedRoute(agent.routes.flown, 0, 0, False, None)
    for ahead_ns in (0, 0, 50_000_000, 100_000_000, 1_100_000_000, 1_200_000_000):
        engine.stages.tasking.poll(sky.run_.t_ns + ahead_ns)
    assert checked == [1, 2, 1, 2]
