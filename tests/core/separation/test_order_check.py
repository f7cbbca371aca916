"""An order would lead a vehicle into another one: a return through its circle, a hold beside it."""

from collections import Counter

import numpy as np
import pytest
from helpers.hills import elevation_of, hill, terrain_table
from helpers.sky import FIELD, LANDING, Sky, fly_on, give, place, with_one_home

from gcs.core.operator.waiting_orders import MAX_CHECKS
from gcs.core.separation.conflicts import Conflict
from gcs.model import NoFlyZone, NoticeCode, Order
from sim_vehicles.autopilots.autopilot_traits import Mode


def with_home_off_the_map():
    """Two that RTL would lead to one circle. No mission leads them home: it is off the map."""
    return with_one_home(Sky((600.0, 600.0, 60.0), (2300.0, 2300.0, 80.0)), (1500.0, -300.0))


def states(sky, action, vehicle):
    """Return the final answers to the orders of an action for a vehicle."""
    return [one.state for one in sky.answers if one.action == action and one.vehicle == vehicle]


def test_of_two_that_would_return_to_one_circle_the_second_waits_until_it_is_ordered_again():
    sky = with_home_off_the_map()
    give(sky, "return")
    fly_on(sky, 2.0)
    ((_, notice),) = sky.told(NoticeCode.ORDER_WAITS)
    assert (notice.vehicle, notice.parameters["action"]) == (2, "return")
    assert notice.parameters["reason"].startswith("would circle within 0 m and 0 m")
    assert [sky.planes[v].autopilot.mode for v in (1, 2)] == [Mode.RTL, Mode.AUTO]
    give(sky, "return", 2)
    fly_on(sky, 2.0)
    assert sky.planes[2].autopilot.mode is Mode.RTL
    assert states(sky, "return", 2) == ["failed", "done"]


def test_a_return_that_waits_begins_when_the_other_has_left():
    sky = with_home_off_the_map()
    give(sky, "return")
    fly_on(sky, 3.0)
    give(sky, "hold", 1)
    fly_on(sky, 4.0)
    assert sky.planes[2].autopilot.mode is Mode.RTL
    assert states(sky, "return", 2) == ["done"]
    ((_, notice),) = sky.told(NoticeCode.ORDER_BEGINS)
    assert (notice.vehicle, notice.parameters["action"]) == (2, "return")


def test_an_order_waits_on_while_its_vehicle_reports_no_position(monkeypatch):
    """Before, it began then, although the vehicle was not known to be clear."""
    sky = with_home_off_the_map()
    give(sky, "return")
    fly_on(sky, 3.0)
    autopilot = sky.planes[2].autopilot
    monkeypatch.setattr(type(autopilot), "is_position_known", lambda self, _: self is not autopilot)
    fly_on(sky, 20.0)
    assert autopilot.mode is Mode.AUTO
    assert not sky.told(NoticeCode.ORDER_BEGINS)
    assert states(sky, "return", 2) == []


def test_many_orders_that_wait_are_checked_a_few_at_a_tick(monkeypatch):
    """The checks of forty at one tick took 0.3 s: scans and heartbeats waited."""
    starts = [(300.0 + 250.0 * k, 600.0 + 500.0 * (k % 4), 60.0 + 20.0 * k) for k in range(10)]
    sky = with_one_home(Sky(*starts), (1500.0, -300.0))
    give(sky, "return")
    fly_on(sky, 1.0)
    order_check = sky.run_.engine.stages.orders._order_check
    problem = order_check.problem
    checks = []

    def noted(vehicle, modes, flights):
        checks.append((flights.t_ns, vehicle))
        return problem(vehicle, modes, flights)

    monkeypatch.setattr(order_check, "problem", noted)
    fly_on(sky, 3.0)
    agents = sky.run_.engine.state.agents
    waiting = [vehicle for vehicle, agent in agents.items() if agent.orders.waiting is not None]
    assert len(waiting) > MAX_CHECKS
    assert max(Counter(t_ns for t_ns, _ in checks).values()) == MAX_CHECKS
    assert min(Counter(v for _, v in checks if v in waiting).values()) >= 2
    assert {v for _, v in checks} >= set(waiting)


@pytest.mark.parametrize("action", ["resume", "hold"])
def test_a_newer_order_ends_one_that_waits(action):
    sky = with_home_off_the_map()
    give(sky, "return")
    fly_on(sky, 2.0)
    give(sky, action, 2)
    fly_on(sky, 2.0)
    give(sky, "hold", 1)
    fly_on(sky, 10.0)
    assert sky.planes[2].autopilot.mode is not Mode.RTL
    assert states(sky, "return", 2) == ["failed"]


def test_an_order_that_waits_ends_with_a_pilot():
    sky = with_home_off_the_map()
    give(sky, "return")
    fly_on(sky, 2.0)
    sky.planes[2].autopilot.set_mode(Mode.FBWA)
    fly_on(sky, 3.0)
    give(sky, "hold", 1)
    fly_on(sky, 10.0)
    assert sky.planes[2].autopilot.mode is Mode.FBWA
    assert states(sky, "return", 2) == ["failed"]


def test_an_order_that_waits_is_not_sent_to_a_vehicle_that_has_landed():
    """It would take off again."""
    sky = with_home_off_the_map()
    give(sky, "return")
    fly_on(sky, 2.0)
    place(sky.planes[2], 2300.0, 2300.0, 0.0)
    sky.planes[2].airframe.speed_m_s = 0.0
    sky.planes[2].autopilot.flying = False
    fly_on(sky, 12.0)
    assert sky.planes[2].autopilot.mode is Mode.AUTO
    ((state, detail),) = [(a.state, a.detail) for a in sky.answers if a.vehicle == 2]
    assert (state, detail) == ("failed", "it has landed meanwhile")


def test_an_order_goes_on_waiting_while_its_vehicle_is_not_heard():
    sky = with_home_off_the_map()
    give(sky, "return")
    fly_on(sky, 2.0)
    unheard = sky.run_.vehicles.pop("vehicle:2")
    fly_on(sky, 20.0)
    sky.run_.vehicles["vehicle:2"] = unheard
    fly_on(sky, 4.0)
    assert unheard.autopilot.mode is Mode.AUTO
    assert states(sky, "return", 2) == []


def test_a_hold_beside_a_held_vehicle_waits_until_it_has_passed():
    sky = Sky((600.0, 600.0, 60.0), (1700.0, 1700.0, 80.0)).fly(20.0)
    give(sky, "hold", 2)
    fly_on(sky, 8.0)
    first, held = sky.planes[1].airframe, sky.planes[2]
    assert sky.planes[1].autopilot.mode is Mode.AUTO
    side, ahead_m = first.heading_rad + 0.5 * np.pi, 4.0 * first.speed_m_s
    east_m = first.east_m + ahead_m * np.sin(first.heading_rad) + 130.0 * np.sin(side)
    north_m = first.north_m + ahead_m * np.cos(first.heading_rad) + 130.0 * np.cos(side)
    place(held, east_m, north_m, first.alt_rel_m)
    held.autopilot.set_mode(Mode.FBWA)
    held.autopilot.set_mode(Mode.LOITER)
    fly_on(sky, 4.0)  # its new position is used then
    give(sky, "hold", 1)
    fly_on(sky, 0.6)
    assert sky.planes[1].autopilot.mode is Mode.AUTO
    ((_, notice),) = sky.told(NoticeCode.ORDER_WAITS)
    assert (notice.vehicle, notice.parameters["action"]) == (1, "hold")
    while sky.planes[1].autopilot.mode is not Mode.LOITER:
        fly_on(sky, 0.4)
    fly_on(sky, 2.0)
    assert states(sky, "hold", 1) == ["done"]
    assert not sky.near_s


def test_a_hold_of_all_that_fly_apart_reaches_them_at_once():
    sky = Sky((600.0, 600.0, 60.0), (1700.0, 1700.0, 80.0)).fly(20.0)
    give(sky, "hold")
    fly_on(sky, 1.0)
    assert all(plane.autopilot.mode is Mode.LOITER for plane in sky.planes.values())


def test_two_that_hold_17_m_apart_are_told_and_resumed_one_after_the_other():
    sky = Sky((600.0, 600.0, 60.0), (1700.0, 1700.0, 80.0)).fly(20.0)
    give(sky, "hold")
    fly_on(sky, 2.0)
    one, other = sky.planes[1], sky.planes[2]
    place(other, one.airframe.east_m + 17.0, one.airframe.north_m, one.airframe.alt_rel_m)
    other.airframe.heading_rad = one.airframe.heading_rad
    other.autopilot.set_mode(Mode.FBWA)
    other.autopilot.set_mode(Mode.LOITER)
    fly_on(sky, 5.0)
    (_, alarm), *_ = sky.told(NoticeCode.SEPARATION_LOST)
    assert (alarm.vehicle, alarm.parameters["other"]) == (1, 2)
    before = sky.run_.t_ns
    give(sky, "resume")
    fly_on(sky, 60.0)
    apart_m = np.hypot(
        one.airframe.east_m - other.airframe.east_m, one.airframe.north_m - other.airframe.north_m
    )
    assert alarm.key in [key for _, over in sky.told(NoticeCode.APART_AGAIN) for key in over.ended]
    assert apart_m > 60.0
    assert before < sky.run_.t_ns


def test_a_px4_that_would_land_by_its_mission_through_a_held_vehicle_returns_by_another():
    """It comes down from its layer at once, and not at its return height."""
    sky = Sky((900.0, 600.0, 60.0), (1500.0, 600.0, 80.0), px4=(1, 2), field=LANDING).fly(24.0)
    give(sky, "hold", 2)
    fly_on(sky, 6.0)
    one, held = sky.planes[1], sky.planes[2]
    home = one.autopilot.home
    place(one, home.east_m, home.north_m + 900.0, 100.0, 180.0)
    place(held, home.east_m, home.north_m + 500.0, 55.0)
    held.autopilot.set_mode(Mode.FBWA)
    held.autopilot.set_mode(Mode.LOITER)
    fly_on(sky, 4.0)
    give(sky, "return", 1)
    fly_on(sky, 60.0)
    assert one.autopilot.mode is Mode.AUTO
    assert states(sky, "return", 1) == ["done"]
    assert not sky.near_s


def test_one_that_is_near_another_now_does_not_return_to_circle_with_a_third():
    """Flown with PX4: agent 3 left 4, which it was near, by RTL, and circled at home with agent 1."""
    check = Sky((500.0, 1500.0, 60.0)).run_.engine.stages.avoidances._order_check
    check._conflicts.met = lambda own, others, is_return, margin: iter(
        [] if own == "RTL" else [Conflict(0.1, "meet 4", 4)]
    )
    check._conflicts.overlapping = lambda own, others: iter(
        [Conflict(0.0, "circle with 1", 1)] if own == "RTL" else []
    )
    assert check._worse("RTL", "now", ["others"], (True, False)) == "would circle with 1"
    assert check._worse("RTL", "now", ["others"], (False, False)) == ""


TARGET_AHEAD = (
    FIELD.replace("nodes_east = 31", "nodes_east = 121")
    .replace("nodes_north = 31", "nodes_north = 121")
    .replace("[planning]", "[planning]\nclearance_m = 20.0")
    .replace("= 2900.0\nnorth_m = 2900.0", "= 2900.0\nnorth_m = 1500.0")
    .replace("= 100.0\nnorth_m = 2900.0", "= 2900.0\nnorth_m = 1300.0")
)
"""A fine map, with targets in the east."""


def test_a_return_that_begins_with_a_turn_is_checked_up_to_home():
    """Before, the check ended short of home, by the time of the turn: RTL led through the zone."""
    sky = with_one_home(Sky((1000.0, 1500.0, 80.0), courses_deg=[90.0], field=TARGET_AHEAD))
    plane = sky.planes[1]
    place(plane, 2100.0, 1500.0, 80.0, 90.0)
    fly_on(sky, 5.0)
    zone = NoFlyZone("fire", (1630.0, 1500.0, 25.0), ())
    sky.run_.order(Order(sky.run_.t_ns, "zone", "no-fly-zone", None, no_fly_zone=zone))
    fly_on(sky, 0.6)
    give(sky, "return")
    for _ in range(70):
        fly_on(sky, 1.0)
        assert np.hypot(plane.east_m - 1630.0, plane.north_m - 1500.0) > 25.0
    assert not sky.told(NoticeCode.ZONE_ENTERED)
    assert plane.east_m < 1800.0


def test_a_return_from_far_away_is_checked_for_the_ground_up_to_home():
    """Before, the first two minutes were: RTL led into a hill behind them."""
    ground = elevation_of(hill(600.0, 1500.0, 150.0, 100.0, 70.0), 3000.0)
    start_m = 2150.0, 1500.0, 80.0
    sky = Sky(start_m, courses_deg=[90.0], field=TARGET_AHEAD + terrain_table(ground))
    sky = with_one_home(sky, (300.0, 1500.0))
    plane = sky.planes[1]
    place(plane, 2750.0, 1500.0, 80.0, 90.0)
    fly_on(sky, 4.0)
    give(sky, "return")
    for _ in range(170):
        fly_on(sky, 1.0)
        assert plane.alt_msl_m - ground.height_msl_m(plane.east_m, plane.north_m) > 30.0
    assert plane.east_m < 600.0
