"""Two vehicles that fly missions of this service meet at one height; before, they were warned of only."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.hills import elevation_of, hill
from helpers.sky import FIELD, LANDING, Sky, fly_on, give, place, with_one_home
from helpers.staging import S

from gcs.config.schema import TerrainTable
from gcs.core.separation.conflicts import Conflict
from gcs.core.separation.landing_order import LandingOrder
from gcs.core.separation.look_ahead import LOOK_AHEAD_S, Encounter
from gcs.core.separation.order_check import OrderCheck
from gcs.core.separation.predicted_flights import PredictedFlights
from gcs.core.separation.separation_state import Approach, Avoidance
from gcs.core.separation.traffic_reports import FIRST_ADSB as AIRCRAFT
from gcs.core.snapshot import decode_state, encode_state
from gcs.model import FlightPhase, NoticeCode, Order, Resumed
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.campaign.virtual_run import START_T_NS

CROSSING = FIELD.replace("layers = 8", "layers = 1").replace(
    "2900.0\nnorth_m = 2900.0", "2600.0\nnorth_m = 1500.0"
)
CROSSING = CROSSING.replace("100.0\nnorth_m = 2900.0", "1500.0\nnorth_m = 2600.0")
WARNING = CROSSING.replace("[planning]", '[planning]\navoidance = "warn"')


def crossing(field=CROSSING, px4=()):
    """Return two that are pinned to targets behind their crossing; with one layer, they meet there."""
    sky = Sky((500.0, 1500.0, 60.0), (1500.0, 500.0, 60.0), courses_deg=[90.0, 0.0], field=field, px4=px4)
    fly_on(sky, 8.0)
    for vehicle in (1, 2):
        labels = sky.run_.engine.stages.trackers.targets.confirmation.tracks
        ends = {label: (track.mean[0], track.mean[1]) for label, track in labels.items()}
        target = max(ends, key=lambda label: ends[label][vehicle - 1])
        sky.run_.order(Order(sky.run_.t_ns, f"pin-{vehicle}", "pin", (vehicle,), target=target))
    return fly_on(sky, 4.0)


def apart_m(sky):
    one, other = sky.planes[1], sky.planes[2]
    return np.hypot(one.east_m - other.east_m, one.north_m - other.north_m)


def least_m(sky, for_s):
    least = np.inf
    for _ in range(round(for_s / 0.4)):
        fly_on(sky, 0.4)
        least = min(least, apart_m(sky))
    return least


def test_one_that_has_arrived_holds_for_another_and_flies_on_to_its_circle():
    """Without a route of a plan neither was ours to hold, and two that had arrived came together."""
    sky = crossing()
    agents = sky.run_.engine.state.agents
    for agent in agents.values():
        status = agent.perception.status
        agent.perception.status = replace(status, status="arrived", target=agent.routes.flown.target)
        agent.routes.flown = None
    assert least_m(sky, 80.0) > 100.0
    ((_, notice),) = sky.told(NoticeCode.AVOIDS)
    assert all(agent.routes.flown is None for agent in agents.values())
    assert [sky.planes[v].autopilot.mode for v in (1, 2)] == [Mode.AUTO, Mode.AUTO]
    assert agents[notice.vehicle].separation.avoidance is None


@pytest.mark.parametrize("is_late", [False, True])
@pytest.mark.parametrize("px4", [(), (1, 2)])
def test_one_of_two_that_come_home_to_land_holds_until_the_other_one_is_down(px4, is_late, monkeypatch):
    """Without a clear circle to wait on, pairs came as near as 11 m and 10 m: neither was ours to hold."""
    monkeypatch.setattr(LandingOrder, "wait", lambda self, route, planned, grid, t_ns: (planned, ""))
    field = LANDING.replace("layers = 8", "layers = 1").replace("= 2900.0\nnorth", "= 1700.0\nnorth")
    field = field.replace("= 100.0\nnorth", "= 1300.0\nnorth")
    sky = Sky((1300.0, 1500.0, 60.0), (1700.0, 1500.0, 60.0), px4=px4, field=field)
    for vehicle, plane in sky.planes.items():  # their return routes cross
        home_m = {1: 1700.0, 2: 1300.0}[vehicle]
        plane.autopilot.home = replace(plane.autopilot.home, east_m=home_m, north_m=300.0)
    landed = {}
    while len(landed) < 2 and sky.run_.t_ns < START_T_NS + 900 * S:
        fly_on(sky, 1.0)
        for number, plane in sky.planes.items():
            if is_late and plane.autopilot.mode is Mode.LOITER and sky.told(NoticeCode.AVOIDS):
                plane.autopilot.seq = len(plane.autopilot.mission) - 2  # as if it held in its descent
            if not plane.autopilot.flying:
                landed.setdefault(number, sky.run_.t_ns / S)
    assert abs(landed[1] - landed[2]) > 60.0
    assert not sky.near_s
    assert sky.told(NoticeCode.AVOIDS)


@pytest.mark.parametrize("in_descent", [False, True])
def test_one_that_was_sent_home_to_land_may_hold_until_its_descent(in_descent, monkeypatch):
    """Behind the last point of its route it was not held."""
    sky = with_one_home(Sky((1500.0, 2000.0, 60.0), field=LANDING), (1500.0, 300.0))
    while sky.planes[1].autopilot.seq < len(sky.planes[1].autopilot.mission) - (2 if in_descent else 3):
        fly_on(sky, 1.0)
    agent = sky.run_.engine.state.agents[1]
    agent.routes.flown, agent.routes.stacked = None, agent.tasking.onboard.route
    agent.perception.status = replace(agent.perception.status, status="active")
    avoidances = sky.run_.engine.stages.avoidances
    monkeypatch.setattr(OrderCheck, "hold_gain", lambda *_: 0.5)
    flights = avoidances._order_check.predict(sky.run_.t_ns)
    encounter = Encounter((1, AIRCRAFT), 9.0, 10.0, 0.0, (1500.0, 1500.0, 130.0))
    assert bool(avoidances.hold(encounter, flights)) is not in_descent


def test_of_two_the_one_holds_whose_circle_keeps_above_the_ground():
    """A hold over a slope went below the least height, while the other vehicle had level ground below."""
    level = crossing()
    least_m(level, 60.0)
    ((_, notice),) = level.told(NoticeCode.AVOIDS)
    chosen = notice.vehicle
    sky = crossing()
    plane = sky.planes[chosen]
    ground = sky.run_.engine.stages.avoidances._order_check._ground
    towards = {1: (1500.0, 1500.0), 2: (1500.0, 1500.0)}[chosen]
    away = np.array((plane.east_m, plane.north_m)) - towards
    middle = towards + away / np.hypot(*away) * 200.0
    ground._elevation = elevation_of(hill(*middle, 40.0, 80.0, 70.0), 3000.0)
    ground._terrain = TerrainTable(file="ground.tif", min_agl_m=50.0, max_agl_m=150.0)
    least_m(sky, 60.0)
    assert [one.vehicle for _, one in sky.told(NoticeCode.AVOIDS)] == [3 - chosen]


def test_a_vehicle_holds_before_its_circle_would_leave_the_flight_band():
    """Ten seconds before they would meet both circles were too near to a hill, and none held."""
    sky = crossing()
    ground = sky.run_.engine.stages.avoidances._order_check._ground
    ground._elevation = elevation_of(hill(1500.0, 1500.0, 50.0, 150.0, 70.0), 3000.0)
    ground._terrain = TerrainTable(file="ground.tif", min_agl_m=45.0, max_agl_m=500.0)
    least_m(sky, 60.0)
    ((_, notice),) = sky.told(NoticeCode.AVOIDS)
    assert notice.parameters["after_s"] > 10.0


SLOW = FIELD.replace("18.0", "15.0").replace("[planning]", "[planning]\nseparation_m = 60.0")
SLOW = SLOW.replace("parameters = { ", "parameters = { WP_LOITER_RAD = 75.0, ")


def test_a_vehicle_holds_before_its_circle_would_touch_that_of_another_one():
    """10 s before they would meet it was too late: on a circle of its own it would have come nearer."""
    sky = Sky((600.0, 600.0, 60.0), (1700.0, 1700.0, 80.0), field=SLOW).fly(36.0)
    flown, held = sky.planes[1], sky.planes[2]
    ahead = np.array((np.sin(flown.course_rad), np.cos(flown.course_rad)))
    side = np.array((ahead[1], -ahead[0]))
    here_m = np.array((flown.east_m, flown.north_m))
    centre_m = here_m + 430.0 * ahead + 100.0 * side
    place(held, *centre_m, flown.alt_rel_m)
    held.autopilot.set_mode(Mode.FBWA)
    held.autopilot.set_mode(Mode.LOITER)
    fly_on(sky, 6.0)
    for agent in sky.run_.engine.state.agents.values():
        agent.separation.radius_m = 75.0
    sky.run_.engine.state.agents[2].separation.hold_m = tuple(centre_m.tolist())
    assert least_m(sky, 30.0) > 60.0  # 46 m before


def test_a_vehicle_that_holds_does_not_fly_on_into_higher_ground_beside_its_route():
    """It had left its route on its circle, flew straight to the next point, and was 28 m too low."""
    sky = crossing()
    while not sky.told(NoticeCode.AVOIDS):
        fly_on(sky, 0.4)
    ((_, notice),) = sky.told(NoticeCode.AVOIDS)
    vehicle = notice.vehicle
    order_check = sky.run_.engine.stages.avoidances._order_check
    while order_check.release_problem(vehicle, order_check.predict(sky.run_.t_ns)):
        fly_on(sky, 0.4)
    t_ns = sky.run_.t_ns
    state = sky.run_.engine.stages.fleet.state(vehicle)
    goal = order_check.intents.flight(state, t_ns, "AUTO").goals[0]
    place_m = np.array((state.east_m, state.north_m))
    place_m += (
        200.0
        / np.hypot(goal.east_m - place_m[0], goal.north_m - place_m[1])
        * (np.array((goal.east_m, goal.north_m)) - place_m)
    )
    order_check._ground._elevation = elevation_of(hill(*place_m, 60.0, 60.0, 70.0), 3000.0)
    order_check._ground._terrain = TerrainTable(file="ground.tif", min_agl_m=50.0, max_agl_m=150.0)
    assert order_check.release_problem(vehicle, order_check.predict(t_ns)).endswith("below the flight band")
    order_check._ground._elevation = elevation_of(hill(*place_m, -60.0, 60.0, 70.0), 3000.0)
    order_check._ground._terrain = TerrainTable(file="ground.tif", min_agl_m=20.0, max_agl_m=70.0)
    assert order_check.release_problem(vehicle, order_check.predict(t_ns)).endswith("above the flight band")


def test_a_vehicle_that_cannot_fly_on_gets_the_mission_that_waits_for_it():
    """The mission waited for the end of the hold, and the hold for the mission: 900 s in a circle."""
    sky = crossing()
    while not sky.told(NoticeCode.AVOIDS):
        fly_on(sky, 0.4)
    ((_, notice),) = sky.told(NoticeCode.AVOIDS)
    stages = sky.run_.engine.stages
    stages.avoidances._order_check.release_problem = lambda *_: "would fly below the flight band"
    agents = sky.run_.engine.state.agents
    own, other = (agents[vehicle].routes.flown.target for vehicle in (notice.vehicle, 3 - notice.vehicle))
    for vehicle, target in ((notice.vehicle, other), (3 - notice.vehicle, own)):
        sky.run_.order(Order(sky.run_.t_ns, f"swap-{vehicle}", "pin", (vehicle,), target=target))
    fly_on(sky, 50.0)
    assert agents[notice.vehicle].separation.avoidance is not None
    assert agents[notice.vehicle].tasking.onboard.route.target != other
    fly_on(sky, 20.0)
    assert agents[notice.vehicle].separation.avoidance is None
    assert agents[notice.vehicle].tasking.onboard.route.target == other


def test_a_vehicle_over_terrain_does_not_fly_on_while_it_may_turn_to_either_side():
    """In wind it turned to the other side than predicted: 100 m beside its route, 35 m above the ground."""
    sky = crossing()
    while not sky.told(NoticeCode.AVOIDS):
        fly_on(sky, 0.4)
    ((_, notice),) = sky.told(NoticeCode.AVOIDS)
    order_check = sky.run_.engine.stages.avoidances._order_check
    order_check._ground._elevation = elevation_of(hill(0.0, 0.0, 0.0, 60.0, 60.0), 3000.0)
    order_check._ground._terrain = TerrainTable(file="ground.tif", min_agl_m=10.0, max_agl_m=500.0)
    turns_rad = []
    while not sky.told(NoticeCode.AVOIDS_NO_LONGER):
        flights = order_check.predict(sky.run_.t_ns)
        turns_rad.append(abs(flights.of(notice.vehicle, "AUTO").turn_rad))
        if turns_rad[-1] > 2.4:
            assert order_check.release_problem(notice.vehicle, flights)
        fly_on(sky, 0.4)
    assert max(turns_rad) > 2.4
    assert turns_rad[-1] < 2.4


@pytest.mark.parametrize("px4", [(), (1, 2)])
def test_one_of_two_that_would_meet_holds_and_flies_on_when_they_are_apart(px4):
    sky = crossing(px4=px4)
    assert least_m(sky, 90.0) > 60.0
    ((begin_s, notice),) = sky.told(NoticeCode.AVOIDS)
    ((end_s, over),) = sky.told(NoticeCode.AVOIDS_NO_LONGER)
    assert notice.key in over.ended
    assert end_s - begin_s < 40.0
    agents = sky.run_.engine.state.agents
    assert [plane.autopilot.mode for plane in sky.planes.values()] == [Mode.AUTO, Mode.AUTO]
    assert all(agent.control.is_ours for agent in agents.values())
    assert not sky.told(NoticeCode.SEPARATION_LOST)
    fly_on(sky, 85.0)
    assert sorted(agent.perception.status.status for agent in agents.values()) == ["arrived", "arrived"]


def test_without_it_they_meet_and_are_told():
    sky = crossing(WARNING)
    assert least_m(sky, 90.0) < 30.0
    assert sky.told(NoticeCode.COMES_NEAR)
    assert not sky.told(NoticeCode.AVOIDS)


def holding():
    """Return two of which one has just begun to hold, and its number."""
    sky = crossing()
    while not sky.told(NoticeCode.AVOIDS):
        fly_on(sky, 0.4)
    vehicle = sky.told(NoticeCode.AVOIDS)[0][1].vehicle
    fly_on(sky, 1.0)
    assert sky.planes[vehicle].autopilot.mode is Mode.LOITER
    return sky, vehicle


def test_a_pilot_who_takes_over_a_vehicle_that_holds_keeps_it():
    sky, vehicle = holding()
    sky.planes[vehicle].autopilot.set_mode(Mode.FBWA)
    fly_on(sky, 40.0)
    assert sky.planes[vehicle].autopilot.mode is Mode.FBWA
    assert sky.told(NoticeCode.AVOIDS_NO_LONGER)


def test_an_order_to_hold_lasts_beyond_the_hold_for_the_other():
    sky, vehicle = holding()
    give(sky, "hold", vehicle)
    fly_on(sky, 40.0)
    assert sky.planes[vehicle].autopilot.mode is Mode.LOITER
    assert sky.run_.engine.state.agents[vehicle].control.suspension == "hold"


def test_a_restarted_service_lets_a_vehicle_that_holds_fly_on():
    sky, vehicle = holding()
    sky.run_.engine.state = decode_state("test", encode_state(sky.run_.engine.state))
    sky.run_.engine.step(Resumed(sky.run_.t_ns, sky.run_.t_ns - S))
    fly_on(sky, 60.0)
    assert sky.planes[vehicle].autopilot.mode is Mode.AUTO
    assert sky.told(NoticeCode.AVOIDS_NO_LONGER)
    assert not sky.near_s


def test_neither_of_two_that_land_or_take_off_is_held():
    """Their flight cannot be interrupted; an alarm names them."""
    sky = crossing()
    while not sky.told(NoticeCode.COMES_NEAR):
        fly_on(sky, 0.4)
    for agent in sky.run_.engine.state.agents.values():
        agent.flight.phase = FlightPhase.LANDING
    avoidances = sky.run_.engine.stages.avoidances
    place_m = (1500.0, 1500.0, 130.0)
    flights = avoidances._order_check.predict(sky.run_.t_ns)
    assert not avoidances.hold(Encounter((1, 2), 9.0, 10.0, 0.0, place_m), flights)


class Holds:
    """Avoidances that always hold one of a pair."""

    def stack(self, encounter, flights):
        return []

    def hold(self, encounter, flights):
        return ["held"]


@pytest.mark.parametrize(("other", "held_s"), [(2, [0, 10, 20]), (AIRCRAFT, [0])])
def test_a_pair_that_still_comes_near_is_kept_apart_again_but_an_aircraft_holds_no_vehicle_twice(
    other, held_s
):
    """Two met 20 s after a hold: they had not been well apart in between."""
    monitor = Sky((500.0, 1500.0, 60.0)).run_.engine.stages.separation
    monitor._avoidances = Holds()
    approach = Approach(2, 0)
    encounter = Encounter((1, other), 9.0, 10.0, 0.0, (0.0, 0.0, 0.0))
    intents = monitor._intents
    told = [
        t_s for t_s in range(25) if monitor._avoid(encounter, approach, 2, PredictedFlights(intents, t_s * S))
    ]
    assert told == held_s


def test_a_vehicle_that_holds_flies_on_when_its_mission_leads_near_no_other():
    """It flew on into another one, since its circle was as near to that at the time."""
    sky = Sky((500.0, 1500.0, 60.0)).fly(8.0)
    check = sky.run_.engine.stages.avoidances._order_check
    flights = check.predict(sky.run_.t_ns)
    conflict = Conflict(0.5, "come near agent 2", 2)
    check._conflicts.met = lambda own, others, is_return, margin: iter([conflict])
    check._nearness = lambda own, others: 0.5
    assert check.release_problem(1, flights) == "would come near agent 2"
    check._nearness = lambda own, others: 0.2  # to hold on is worse
    assert check.release_problem(1, flights) == ""
    check._conflicts.met = lambda own, others, is_return, margin: iter([])
    assert check.release_problem(1, flights) == ""


@pytest.mark.parametrize(("holds_for", "is_held"), [("agent 3", True), ("agent 2", False)])
def test_one_of_a_pair_may_hold_although_the_other_one_holds_for_a_third(holds_for, is_held):
    """Before, nobody did: they met after 14 s of alarms."""
    sky = crossing(WARNING)
    while not sky.told(NoticeCode.COMES_NEAR):
        fly_on(sky, 0.4)
    avoidances = sky.run_.engine.stages.avoidances
    avoidances._is_enabled = True
    sky.run_.engine.state.agents[1].separation.avoidance = Avoidance(holds_for, sky.run_.t_ns)
    flights = avoidances._order_check.predict(sky.run_.t_ns)
    encounter = Encounter((1, 2), 9.0, 10.0, 0.0, (1500.0, 1500.0, 130.0))
    assert bool(avoidances.hold(encounter, flights)) is is_held


@pytest.mark.parametrize(("later", "is_held"), [(False, True), (True, False)])
def test_a_hold_a_little_below_the_band_is_not_put_off_until_it_would_lead_far_below(
    later, is_held, monkeypatch
):
    """Two met at 28 m: 10 s before a hold led 8 m below the band, and 6 s before 34 m."""
    sky = crossing()
    avoidances = sky.run_.engine.stages.avoidances
    monkeypatch.setattr(OrderCheck, "hold_gain", lambda *_: 0.5)

    def in_band(_check, _vehicle, _flights, off_band_m=(5.0, 5.0), after_s=0.0):
        return off_band_m[0] > 5.0 and (later or after_s == 0.0)

    monkeypatch.setattr(OrderCheck, "circles_in_band", in_band)
    flights = avoidances._order_check.predict(sky.run_.t_ns)
    encounter = Encounter((1, 2), 9.0, 10.0, 0.0, (1500.0, 1500.0, 130.0))
    assert bool(avoidances.hold(encounter, flights)) is is_held


@pytest.mark.parametrize(("height_m", "is_held"), [(5.0, True), (9.0, True), (14.0, False)])
def test_a_vehicle_holds_far_above_the_band_only_if_separation_would_be_lost(height_m, is_held, monkeypatch):
    """One held at 134 m above the ground for another that would have passed 14 m below."""
    sky = crossing()
    avoidances = sky.run_.engine.stages.avoidances
    monkeypatch.setattr(OrderCheck, "hold_gain", lambda *_: 0.5)
    monkeypatch.setattr(OrderCheck, "circles_in_band", lambda *args: args[3][1] > 30.0)
    flights = avoidances._order_check.predict(sky.run_.t_ns)
    encounter = Encounter((1, 2), 5.0, 40.0, height_m, (1500.0, 1500.0, 130.0))
    assert bool(avoidances.hold(encounter, flights)) is is_held


@pytest.mark.parametrize("away", [1, 2])
def test_of_two_that_would_be_clear_the_one_holds_whose_circle_is_farther_off(away, monkeypatch):
    """One was led to 49 m from the other, which could have kept 150 m."""
    sky = crossing()
    avoidances = sky.run_.engine.stages.avoidances
    monkeypatch.setattr(OrderCheck, "hold_gain", lambda *_: 0.5)
    monkeypatch.setattr(OrderCheck, "held_apart_m", lambda _, v, *__: 150.0 if v == away else 69.0)
    flights = avoidances._order_check.predict(sky.run_.t_ns)
    notice, *_ = avoidances.hold(Encounter((1, 2), 9.0, 10.0, 0.0, (1500.0, 1500.0, 130.0)), flights)
    assert notice.vehicle == away


@pytest.mark.parametrize("held", [1, 2])
def test_a_vehicle_that_holds_stays_as_far_from_the_other_as_predicted(held):
    sky = crossing(WARNING)
    fly_on(sky, 25.0)
    check = sky.run_.engine.stages.avoidances._order_check
    predicted_m = check.held_apart_m(held, (1, 2), check.predict(sky.run_.t_ns))
    sky.planes[held].autopilot.set_mode(Mode.LOITER)
    flown_m = [apart_m(fly_on(sky, 1.1)) for _ in range(round(LOOK_AHEAD_S))]
    assert min(flown_m) == pytest.approx(predicted_m, abs=40.0)


def test_one_of_two_whose_new_missions_wait_for_traffic_holds_at_last(monkeypatch):
    """Before, none could hold while its mission waited, and their old missions led them together."""
    sky = crossing()
    monkeypatch.setattr(OrderCheck, "mission_problem", lambda *_: "would come near agent 9")
    for vehicle in (1, 2):
        flown = sky.run_.engine.state.agents[vehicle].routes.flown
        bend_m = flown.points_m[-1] + [[20.0, 20.0]]
        sky.run_.engine.stages.tasking.enqueue_upload(
            replace(flown, points_m=np.vstack((flown.points_m, bend_m))), sky.run_.t_ns, None
        )
    assert least_m(sky, 110.0) > 30.0
    _, notice = sky.told(NoticeCode.AVOIDS)[0]
    assert notice.parameters["after_s"] <= 6.0
