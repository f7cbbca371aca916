"""A vehicle flies into a no-fly zone that was closed across its way, since no route leads round it."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from helpers.banked_field import BANKED_FIELD
from helpers.flight_copies import copy_of
from helpers.hills import elevation_of, terrain_table
from helpers.noticed import noticed
from helpers.sky import LANDING, Sky, fly_on
from helpers.staging import S

from gcs.core.separation.forward_flight import Goal, GoalKind
from gcs.model import NoFlyZone, NoticeCode, Order, OrderAnswer, Scan, VerticalLimits
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import parse_scenario

BASE_MSL_M = 70.0
FIELD = (
    BANKED_FIELD
    + """[planning]
shape = "flyable"
clearance_m = 20.0
vertical_clearance_m = 15.0
avoidance = "{avoidance}"
[mission]
altitude_rel_m = 70.0
[simulation]
forward_speed_m_s = 15.0
airframe = "banked"
px4 = {px4}
[simulation.sensor]
clutter_per_scan = 0.0
[[agents]]
system_id = 1
east_m = 300.0
north_m = 1500.0
course_deg = 90.0
[[births]]
east_m = 2300.0
north_m = 1500.0
[[simulation.targets]]
east_m = 2300.0
north_m = 1500.0
"""
)
WALL_M = ((1200.0, -100.0), (1400.0, -100.0), (1400.0, 3100.0), (1200.0, 3100.0))
"""From south to north across the map."""
CLOSED_S = 40.0


@lru_cache
def under_way(avoidance, px4, obstacles, *, over_terrain) -> VirtualRun:
    """Return the flight before a zone is closed."""
    text = FIELD.format(avoidance=avoidance, px4=list(px4)) + obstacles
    if over_terrain:
        text += terrain_table(elevation_of(lambda east, north: 70.0 + 0.02 * east + 0.0 * north, 3000.0))
    run = VirtualRun(parse_scenario(text, "field"), 1)
    run.run(CLOSED_S)
    return run


class Flight:
    """A vehicle on its way east, and a zone across the whole map that is closed before it."""

    def __init__(
        self, *, over_terrain=False, limits=None, avoidance="act", px4=(), zone_m=WALL_M, obstacles=""
    ) -> None:
        self.effects = []
        self.run = copy_of(under_way(avoidance, px4, obstacles, over_terrain=over_terrain))
        self.run.on_effect = lambda _t_ns, effect: self.effects.append(effect)
        self.plane = self.run.vehicles["vehicle:1"]
        if zone_m:
            self.close(NoFlyZone("fire", None, zone_m, limits or VerticalLimits(None, None)))

    def close(self, zone: NoFlyZone) -> None:
        t_ns = self.run.t_ns
        self.run.order(Order(t_ns, f"{zone.name}-{t_ns}", "no-fly-zone", None, None, zone))

    def order(self, action: str) -> None:
        self.run.order(Order(self.run.t_ns, f"{action}-{self.run.t_ns}", action, (1,)))

    def answers(self) -> list[tuple[str, str]]:
        return [(one.state, one.detail) for one in self.effects if isinstance(one, OrderAnswer)]

    def fly(self, until_s: float) -> float:
        """Fly on; return the greatest distance to the east."""
        east_m = 0.0
        for t_s in np.arange((self.run.t_ns - START_T_NS) / S + 0.5, until_s + 0.1, 0.5).tolist():
            self.run.run(t_s)
            self.run.ended = False
            east_m = max(east_m, self.plane.east_m)
        return east_m

    def told(self, code: NoticeCode) -> list:
        return noticed(self.effects, code)


SIDE_M = ((900.0, 1300.0), (1150.0, 1300.0), (1150.0, 1460.0), (900.0, 1460.0))
"""Beside the way, where a circle to the right leads."""
KINDS = [
    {},
    {"px4": (1,)},
    {"over_terrain": True},
    {"over_terrain": True, "limits": VerticalLimits(None, 400.0, "msl")},
    {"limits": VerticalLimits(20.0, 200.0, "home")},
]


@pytest.mark.parametrize("kind", KINDS)
def test_a_vehicle_holds_before_a_zone_without_a_way_round_until_it_is_opened(kind):
    flight = Flight(**kind)
    assert flight.fly(120.0) < 1200.0
    (notice,) = flight.told(NoticeCode.HOLDS_BEFORE_ZONE)
    assert (notice.vehicle, notice.parameters["other"], notice.level) == (1, "no-fly zone fire", "alarm")
    assert flight.plane.autopilot.mode is Mode.LOITER
    assert not flight.told(NoticeCode.ZONE_ENTERED)
    assert not flight.told(NoticeCode.AVOIDS_NO_LONGER)
    flight.close(NoFlyZone("fire"))
    assert flight.fly(225.0) > 2100.0
    (over,) = flight.told(NoticeCode.AVOIDS_NO_LONGER)
    assert notice.key in over.ended
    assert flight.run.engine.state.agents[1].perception.status.status == "arrived"


def test_with_warnings_only_it_flies_through_and_alarms_tell():
    flight = Flight(avoidance="warn")
    assert flight.fly(120.0) > 1400.0
    assert not flight.told(NoticeCode.HOLDS_BEFORE_ZONE)
    assert flight.told(NoticeCode.ZONE_ENTERED)


def test_an_alarm_of_a_zone_comes_without_a_sensor_and_ends_when_the_last_zone_is_opened():
    flight = Flight(avoidance="warn")
    step = flight.run.engine.step
    flight.run.engine.step = lambda event: [] if isinstance(event, Scan) else step(event)
    flight.effects.clear()
    flight.fly(80.0)
    _, notice = flight.told(NoticeCode.ZONE_AHEAD)  # the first when it was closed
    flight.close(NoFlyZone("fire"))
    flight.fly(82.0)
    assert notice.key in flight.told(NoticeCode.ZONE_CLEAR)[0].ended


def test_it_does_not_hold_where_its_circle_would_lead_into_another_zone():
    flight = Flight()
    sides = [((100.0, 1540.0), (1190.0, 1540.0), (1190.0, 1600.0), (100.0, 1600.0))]
    sides += [((100.0, 1400.0), (1190.0, 1400.0), (1190.0, 1460.0), (100.0, 1460.0))]
    for number, side in enumerate(sides):
        flight.close(NoFlyZone(f"side-{number}", None, side))
    flight.fly(70.0)
    assert not flight.told(NoticeCode.HOLDS_BEFORE_ZONE)
    assert flight.plane.autopilot.mode is Mode.AUTO
    assert [one.parameters["zone"] for one in flight.told(NoticeCode.ZONE_AHEAD)].count("fire") >= 1


def test_a_pilot_and_an_order_are_stronger_than_the_hold():
    flight = Flight()
    flight.fly(75.0)
    assert flight.told(NoticeCode.HOLDS_BEFORE_ZONE)
    flight.plane.autopilot.set_mode(Mode.FBWA)
    flight.fly(90.0)
    assert flight.plane.autopilot.mode is Mode.FBWA
    assert flight.told(NoticeCode.AVOIDS_NO_LONGER)
    flight = Flight()
    flight.fly(75.0)
    flight.order("return")
    flight.fly(160.0)
    assert flight.answers()[-1][0] == "done"
    assert flight.plane.autopilot.mode is Mode.RTL


def test_a_vehicle_with_a_way_round_does_not_hold():
    flight = Flight()
    flight.close(NoFlyZone("fire"))
    flight.close(NoFlyZone("small", (1300.0, 1500.0, 100.0)))
    assert flight.fly(170.0) > 2100.0
    assert not flight.told(NoticeCode.HOLDS_BEFORE_ZONE)
    assert not flight.told(NoticeCode.ZONE_ENTERED)


OBSTACLE = "[[map.obstacles]]\nbox_m = [900.0, 1300.0, 1150.0, 1460.0]\n"


@pytest.mark.parametrize("kind", [{"zone_m": SIDE_M}, {"zone_m": (), "obstacles": OBSTACLE}])
def test_a_hold_beside_a_zone_or_an_obstacle_waits_until_its_circle_is_clear(kind):
    """Before, one circled inside it."""
    flight = Flight(**kind)
    while flight.plane.east_m < 880.0:
        flight.fly((flight.run.t_ns - START_T_NS) / S + 0.5)
    flight.order("hold")
    flight.fly((flight.run.t_ns - START_T_NS) / S + 5.0)
    (notice,) = flight.told(NoticeCode.ORDER_WAITS)
    (accepted,) = [detail for state, detail in flight.answers() if state == "accepted"]
    assert f"(agent 1 {notice.parameters['reason']}); the same order again is carried out" in accepted
    assert ("zone fire" if kind["zone_m"] else "obstacle") in notice.parameters["reason"]
    assert flight.plane.autopilot.mode is Mode.AUTO
    lowest_m = 1500.0
    for until_s in range(round((flight.run.t_ns - START_T_NS) / S) + 1, 140):
        flight.fly(until_s)
        lowest_m = min(lowest_m, flight.plane.north_m) if flight.plane.east_m < 1175.0 else lowest_m
    assert flight.answers()[-1][0] == "done"
    assert flight.plane.autopilot.mode is Mode.LOITER
    assert lowest_m > 1475.0
    assert not flight.told(NoticeCode.ZONE_ENTERED)


def test_a_hold_that_is_ordered_again_beside_a_zone_begins_at_once():
    flight = Flight(zone_m=SIDE_M)
    while flight.plane.east_m < 880.0:
        flight.fly((flight.run.t_ns - START_T_NS) / S + 0.5)
    for _ in range(2):
        flight.order("hold")
        flight.fly((flight.run.t_ns - START_T_NS) / S + 3.0)
    assert flight.plane.autopilot.mode is Mode.LOITER


def test_a_mission_into_a_zone_is_not_resumed_and_gives_way_to_a_new_one():
    """Before, one that was resumed flew its old mission until the new one came."""
    flight = Flight(zone_m=())
    flight.order("hold")
    flight.fly(60.0)
    flight.close(NoFlyZone("fire", (flight.plane.east_m + 350.0, 1500.0, 80.0)))
    flight.fly(62.0)
    flight.effects.clear()
    flight.order("resume")
    flight.fly(64.0)
    assert flight.answers()[-1] == ("done", "LOITER, armed: waits for its next mission")
    flight.fly(220.0)
    assert flight.plane.east_m > 2100.0
    assert not flight.told(NoticeCode.ZONE_ENTERED)


def test_a_vehicle_is_not_resumed_where_it_would_wait_in_a_zone():
    flight = Flight(zone_m=())
    flight.fly(90.0)
    flight.order("return")
    flight.fly(105.0)
    plane = flight.plane
    flight.close(NoFlyZone("fire", (plane.east_m, plane.north_m - 100.0, 40.0)))
    flight.order("resume")
    flight.fly(106.0)
    state, detail = flight.answers()[-1]
    assert state == "refused"
    assert "no-fly zone fire" in detail
    assert plane.autopilot.mode is Mode.RTL


def test_a_vehicle_that_held_flies_on_when_its_way_back_is_clear_of_obstacles():
    """It was led back to its route through one: it turns later and wider than predicted."""
    flight = Flight(zone_m=None, obstacles="[[map.obstacles]]\ndisc_m = [1000.0, 1535.0, 10.0]\n")
    check = flight.run.engine.stages.avoidances._order_check
    flights = check.predict(flight.run.t_ns)
    hold, mission = (flights.of(1, mode) for mode in ("LOITER", "AUTO"))
    straight = replace(mission, goals=(replace(mission.goals[0], east_m=1200.0, north_m=1540.0),))
    for way_back, present, problem in (
        (straight, hold, "would come near an obstacle"),
        (straight, replace(straight, goals=(replace(straight.goals[0], east_m=1000.0),)), ""),
        (replace(straight, goals=(replace(straight.goals[0], north_m=1200.0),)), hold, ""),
        (replace(straight, goals=(replace(mission.goals[-1], east_m=1200.0, north_m=1540.0),)), hold, ""),
    ):
        led_or_held = {"AUTO": way_back, None: present}
        flights.of = lambda _vehicle, mode=None, chosen=led_or_held: chosen[mode]
        assert check.release_problem(1, flights) == problem


@pytest.mark.parametrize("climb_s", [2.0, 10.0, 40.0])
def test_a_vehicle_that_first_climbs_in_a_circle_holds_on_before_a_zone(climb_s):
    """A PX4 flew on for five seconds, and held again: what was looked at ended in that circle."""
    flight = Flight()
    flight.fly(55.0)
    check = flight.run.engine.stages.avoidances._order_check
    mission = check.predict(flight.run.t_ns).of(1, "AUTO")
    circle = Goal(GoalKind.CIRCLE, mission.east_m, mission.north_m, 60.0, mission.height_m + 20.0, climb_s)
    assert check._zones.first(mission) == "fire"
    assert check._zones.first(replace(mission, goals=(circle, *mission.goals))) == "fire"


@pytest.mark.parametrize("px4", [(), (1,)])
def test_a_vehicle_on_its_return_route_holds_before_a_zone_until_it_is_opened(px4):
    """Before, one alarm came when the zone was closed, and the vehicle flew through it."""
    sky = Sky((1500.0, 500.0, 80.0), field=LANDING, px4=px4)
    plane = sky.planes[1]
    agent = sky.run_.engine.state.agents[1]
    while agent.perception.status.status != "arrived":
        fly_on(sky, 1.0)
    fly_on(sky, 25.0)
    begin_m, end_m = agent.routes.return_m[:2]
    centre_m = begin_m + 0.7 * (end_m - begin_m)
    zone = NoFlyZone("fire", (*centre_m.tolist(), 60.0), ())
    sky.run_.order(Order(sky.run_.t_ns, "close", "no-fly-zone", None, no_fly_zone=zone))
    for _ in range(90):
        fly_on(sky, 1.0)
        assert np.hypot(*(np.array((plane.east_m, plane.north_m)) - centre_m)) > 60.0
    assert plane.autopilot.mode is Mode.LOITER
    ((ahead_s, _),) = sky.told(NoticeCode.ZONE_AHEAD)
    ((held_s, notice),) = sky.told(NoticeCode.HOLDS_BEFORE_ZONE)
    assert ahead_s <= held_s < ahead_s + 1.0
    assert notice.parameters["remedy"] == "open the zone"
    sky.run_.order(Order(sky.run_.t_ns, "open", "no-fly-zone", None, no_fly_zone=NoFlyZone("fire", None, ())))
    fly_on(sky, 150.0)
    assert not plane.autopilot.armed
