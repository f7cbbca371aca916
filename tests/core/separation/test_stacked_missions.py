"""Vehicles that are ordered to return at one time would circle at one place and height."""

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from helpers.hills import elevation_of, hill, terrain_table
from helpers.sky import FIELD, LANDING, Sky, fly_on, give, place, with_one_home
from helpers.staging import S

from gcs.core.operator.order_refusals import OrderRefusals
from gcs.core.replanning import stacked_missions
from gcs.core.separation.order_check import OrderCheck
from gcs.model import FlightPhase, NoFlyZone, NoticeCode, Order, Route, VerticalLimits, read_only
from gcs.model.vehicle_ids import home_label
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.vehicle.faults import FaultKind

PLACES = [(600.0, 600.0, 60.0), (2300.0, 2300.0, 80.0), (700.0, 2200.0, 100.0), (2200.0, 700.0, 120.0)]
FOUR = FIELD.replace("ARMING_DELAY_S = 1.0", "ARMING_DELAY_S = 1.0, RTL_RETURN_ALT = 130.0") + "".join(
    f"[[{table}]]\neast_m = {east_m}\nnorth_m = {north_m}\n"
    for table in ("births", "simulation.targets")
    for east_m, north_m in ((2900.0, 1500.0), (100.0, 1500.0))
)


@lru_cache
def two_in_the_air():
    return with_one_home(Sky(*PLACES[:2]))


def two():
    return two_in_the_air().copy()


@pytest.mark.parametrize("px4", [(), (1, 2, 3, 4)])
def test_all_that_return_at_once_begin_at_once_and_circle_in_layers(px4):
    """RTL brings each to 1500, 1500, ArduPlane at 100 m and PX4 at 130 m.

    Before, all but one flew on to their targets.
    """
    sky = with_one_home(Sky(*PLACES, px4=px4, field=FOUR))
    give(sky, "return")
    fly_on(sky, 4.0)
    assert not sky.told(NoticeCode.ORDER_WAITS)
    assert [one.state for one in sky.answers if one.action == "return" and one.vehicle] == ["done"] * 4
    fly_on(sky, 110.0)
    assert not sky.near_s
    heights = sorted(plane.alt_rel_m for plane in sky.planes.values())
    assert all(upper - lower > 15.0 for lower, upper in pairwise(heights))
    assert all(abs(p.east_m - 1500.0) + abs(p.north_m - 1500.0) < 200.0 for p in sky.planes.values())
    assert {agent.control.authority.word for agent in sky.run_.engine.state.agents.values()} == {"returning"}
    modes = [plane.autopilot.mode for plane in sky.planes.values()]
    assert sorted(mode.name for mode in modes) == ["AUTO", "AUTO", "AUTO", "RTL"]


def test_px4_whose_return_heights_are_apart_do_not_descend_to_one_circle():
    """In RTL both descend at home to RTL_DESCEND_ALT."""
    sky = with_one_home(Sky(*PLACES[:2], px4=(1, 2), field=FOUR))
    for vehicle, height_m in ((1, 100.0), (2, 160.0)):
        for name, value in (("RTL_RETURN_ALT", height_m), ("RTL_DESCEND_ALT", 30.0)):
            sky.planes[vehicle].autopilot.parameters.store(name, value)
            sky.run_.engine.state.agents[vehicle].returns.parameters[name] = value
    give(sky, "return")
    fly_on(sky, 150.0)
    assert sorted(plane.autopilot.mode.name for plane in sky.planes.values()) == ["AUTO", "RTL"]
    assert min(plane.alt_rel_m for plane in sky.planes.values()) == pytest.approx(30.0, abs=2.0)
    assert not sky.near_s


def test_where_all_layers_at_home_are_taken_others_circle_beside_it():
    sky = with_one_home(Sky(*PLACES, field=FOUR.replace("layers = 8", "layers = 2")))
    give(sky, "return")
    fly_on(sky, 4.0)
    assert not sky.told(NoticeCode.ORDER_WAITS)
    fly_on(sky, 110.0)
    assert not sky.near_s
    away_m = [np.hypot(p.east_m - 1500.0, p.north_m - 1500.0) for p in sky.planes.values()]
    assert max(away_m) < 320.0
    assert not sky.told(NoticeCode.SEPARATION_LOST)


def test_all_that_return_at_once_land_one_after_the_other_where_missions_end_so():
    sky = with_one_home(Sky(*PLACES[:3], field=LANDING))
    give(sky, "return")
    fly_on(sky, 4.0)
    assert [one.state for one in sky.answers if one.action == "return" and one.vehicle] == ["done"] * 3
    sent_home = [v for v, plane in sky.planes.items() if plane.autopilot.mode is Mode.AUTO]
    assert sent_home == [1, 2, 3]
    for _ in range(60):
        fly_on(sky, 10.0)
        if len(sky.told(NoticeCode.LANDED)) == 3:
            break
    assert not sky.near_s
    landed_s = [t_s for t_s, notice in sky.told(NoticeCode.LANDED)]
    assert len(landed_s) == 3
    assert np.diff(landed_s).min() >= 50.0


def test_a_vehicle_that_returns_by_a_mission_is_resumed_like_any_other():
    sky = two()
    give(sky, "return")
    fly_on(sky, 10.0)
    assert sky.planes[2].autopilot.mode is Mode.AUTO
    give(sky, "return", 2)
    fly_on(sky, 1.0)
    assert sky.answers[-1].detail == "returns by order: nothing was changed"
    give(sky, "resume", 2)
    fly_on(sky, 10.0)
    agent = sky.run_.engine.state.agents[2]
    assert agent.control.is_ours
    assert agent.routes.flown is not None
    assert agent.tasking.onboard.route.is_same(agent.routes.flown)
    give(sky, "hold", 2)
    fly_on(sky, 3.0)
    assert sky.planes[2].autopilot.mode is Mode.LOITER


@pytest.mark.parametrize("mode", [Mode.FBWA, Mode.LOITER])
def test_a_pilot_who_takes_over_in_the_upload_of_a_return_keeps_the_vehicle(mode):
    """Before, a vehicle that somebody had set to LOITER was sent to RTL as soon as it was clear of others."""
    sky = two()
    give(sky, "return")
    fly_on(sky, 0.3)
    assert sky.run_.engine.state.tasking.is_uploading(2)
    sky.planes[2].autopilot.set_mode(mode)
    fly_on(sky, 5.0)
    assert [one.state for one in sky.answers if one.vehicle == 2] == ["failed"]
    assert not sky.told(NoticeCode.ORDER_WAITS)
    place(sky.planes[2], 2900.0, 100.0, 200.0)  # clear of the other
    fly_on(sky, 10.0)
    assert sky.planes[2].autopilot.mode is mode


def test_a_return_whose_upload_is_not_answered_waits_with_an_alarm_and_is_carried_out_when_ordered_again():
    sky = two()
    sky.planes[2]._link._missions.handle = lambda *_: None
    give(sky, "return")
    fly_on(sky, 20.0)
    ((_, notice),) = sky.told(NoticeCode.ORDER_WAITS)
    assert (notice.vehicle, notice.parameters["action"]) == (2, "return")
    give(sky, "return", 2)
    fly_on(sky, 3.0)
    assert sky.planes[2].autopilot.mode is Mode.RTL


@pytest.mark.parametrize("silence_s", [20.0, 60.0])
def test_a_vehicle_whose_link_breaks_in_the_upload_of_its_return_flies_home_when_it_is_heard_again(silence_s):
    """Before, it flew on to its target, or waited where it was without a mission, until somebody acted."""
    sky = two()
    give(sky, "return")
    fly_on(sky, 0.3)
    assert sky.run_.engine.state.tasking.is_uploading(2)
    faults = sky.planes[2].autopilot.faults
    faults.begin(FaultKind.RADIO, sky.run_.t_ns)
    fly_on(sky, silence_s)
    faults.end(FaultKind.RADIO)
    fly_on(sky, 6.0)
    answers = [one.detail for one in sky.answers if one.vehicle == 2]
    assert len(answers) == 1
    assert answers[0].startswith("AUTO, armed: flies home in its altitude layer")
    assert not sky.told(NoticeCode.ORDER_WAITS)


def test_a_vehicle_that_waits_to_return_does_not_fly_on_with_half_a_mission():
    """The upload stops after the items were announced. Before, it flew on in AUTO over what was left."""
    sky = two()
    plane = sky.planes[2]
    give(sky, "return")
    fly_on(sky, 0.3)
    assert sky.run_.engine.state.tasking.is_uploading(2)
    plane._link._missions.handle = lambda *_: None
    fly_on(sky, 20.0)
    assert [notice.vehicle for _, notice in sky.told(NoticeCode.ORDER_WAITS)] == [2]
    fly_on(sky, 60.0)
    assert plane.autopilot.mode is Mode.LOITER


def test_a_return_whose_upload_takes_long_is_told_and_goes_on():
    """Before, the upload was given up after 15 s, in the middle of the mission."""
    sky = two()
    missions = sky.planes[2]._link._missions
    handle = missions.handle
    give(sky, "return")
    fly_on(sky, 0.3)
    missions.handle = lambda *_: None
    fly_on(sky, 18.0)
    assert [notice.vehicle for _, notice in sky.told(NoticeCode.ORDER_WAITS)] == [2]
    missions.handle = handle
    fly_on(sky, 6.0)
    assert [one.state for one in sky.answers if one.vehicle == 2] == ["done"]
    assert sky.planes[2].autopilot.mode is Mode.AUTO


def test_a_return_whose_uploads_failed_is_flown_when_the_vehicle_answers_again_and_is_told_once():
    """Before, the order waited until the vehicle was clear of all others, or it was given again."""
    sky = two()
    missions = sky.planes[2]._link._missions
    handle = missions.handle
    missions.handle = lambda *_: None
    give(sky, "return")
    fly_on(sky, 50.0)
    assert [notice.vehicle for _, notice in sky.told(NoticeCode.ORDER_WAITS)] == [2]
    missions.handle = handle
    fly_on(sky, 20.0)
    assert [one.state for one in sky.answers if one.vehicle == 2] == ["done"]
    assert sky.planes[2].autopilot.mode is Mode.AUTO
    assert len(sky.told(NoticeCode.ORDER_WAITS)) == 1


def close_zone(sky, *disc_m):
    """Close a zone; open it without a disc."""
    number = len([one for one in sky.answers if one.action == "no-fly-zone"])
    zone = NoFlyZone("fire", *disc_m)
    sky.run_.order(Order(sky.run_.t_ns, f"zone-{number}", "no-fly-zone", None, no_fly_zone=zone))
    return fly_on(sky, 1.0)


def test_a_return_that_had_no_route_is_flown_when_the_zone_round_home_is_opened():
    """Before, no mission was planned again: the vehicle flew on to its target, and circled there."""
    sky = close_zone(two(), (1500.0, 1500.0, 400.0))
    give(sky, "return")
    fly_on(sky, 12.0)
    assert [notice.vehicle for _, notice in sky.told(NoticeCode.ORDER_WAITS)] == [1, 2]
    assert not [one for one in sky.answers if one.vehicle is not None]
    close_zone(sky)
    fly_on(sky, 10.0)
    answers = {one.vehicle: one for one in sky.answers if one.vehicle is not None}
    assert [one.state for one in answers.values()] == ["done", "done"]
    by_mission = [v for v, one in answers.items() if "flies home in its altitude layer" in one.detail]
    assert len(by_mission) == 1
    assert len(sky.told(NoticeCode.ORDER_WAITS)) == 2
    fly_on(sky, 90.0)
    for plane in sky.planes.values():
        assert np.hypot(plane.east_m - 1500.0, plane.north_m - 1500.0) < 200.0
    assert not sky.near_s


def test_a_vehicle_that_is_resumed_in_the_upload_of_its_return_flies_to_its_target():
    """Before, the upload went on: the vehicle flew home, and was shown on the way to its target."""
    sky = two()
    give(sky, "return")
    fly_on(sky, 0.3)
    assert sky.run_.engine.state.tasking.is_uploading(2)
    give(sky, "resume", 2)
    fly_on(sky, 15.0)
    agent = sky.run_.engine.state.agents[2]
    assert agent.control.is_ours
    assert agent.routes.flown is not None
    assert agent.tasking.onboard.route.is_same(agent.routes.flown)
    assert sky.planes[2].autopilot.mode is Mode.AUTO


def test_a_return_that_waits_goes_on_after_an_order_to_resume_that_is_refused(monkeypatch):
    """Before, the refused order ended the return."""
    sky = close_zone(two(), (1500.0, 1500.0, 400.0))
    give(sky, "return")
    fly_on(sky, 3.0)
    assert [notice.vehicle for _, notice in sky.told(NoticeCode.ORDER_WAITS)] == [1, 2]
    monkeypatch.setattr(OrderRefusals, "unchanged", lambda *_, **__: "")
    monkeypatch.setattr(OrderRefusals, "_leads_near", lambda *_: "would come near agent 1")
    give(sky, "resume", 2)
    fly_on(sky, 0.3)
    close_zone(sky)
    fly_on(sky, 10.0)
    answers = [(answer.action, answer.state) for answer in sky.answers if answer.vehicle == 2]
    assert answers == [("resume", "refused"), ("return", "done")]


def test_a_vehicle_on_a_return_by_a_mission_is_led_round_a_zone_that_is_closed_on_its_way():
    """Before, it flew through the zone: the answer did not name it, and a repeated order changed nothing."""
    sky = two()
    give(sky, "return")
    fly_on(sky, 6.0)
    plane = sky.planes[2]
    close_zone(sky, (0.5 * (plane.east_m + 1500.0), 0.5 * (plane.north_m + 1500.0), 60.0))
    assert sky.answers[-1].detail == "fire closed; agent 2 led around it"
    fly_on(sky, 90.0)
    assert not sky.told(NoticeCode.ZONE_ENTERED)
    assert np.hypot(plane.east_m - 1500.0, plane.north_m - 1500.0) < 200.0
    assert sky.run_.engine.state.agents[2].control.authority.word == "returning"


def test_a_zone_round_home_that_a_return_by_a_mission_cannot_avoid_is_told_at_once():
    sky = two()
    give(sky, "return")
    fly_on(sky, 6.0)
    close_zone(sky, (1500.0, 1500.0, 500.0))
    codes = {notice.code for _, notice in sky.notices if notice.vehicle == 2}
    assert codes & {NoticeCode.ZONE_AHEAD, NoticeCode.ZONE_UNAVOIDABLE}
    assert least_away_m(sky, 2, 60.0) > 500.0
    assert [notice.vehicle for _, notice in sky.told(NoticeCode.HOLDS_BEFORE_ZONE)] == [2]
    alarms = [
        notice for _, notice in sky.notices if notice.level == "alarm" and "remedy" in notice.parameters
    ]
    remedies = [notice.parameters["remedy"] for notice in alarms]
    assert any(remedies)
    assert not any("return" in remedy for remedy in remedies)
    close_zone(sky)
    assert sky.answers[-1].detail == "fire opened; agent 2 planned again"
    assert not [
        notice for _, notice in sky.told(NoticeCode.ZONE_UNAVOIDABLE) if notice.t_ns > sky.run_.t_ns - S
    ]
    assert least_away_m(sky, 2, 90.0) < 200.0


def least_away_m(sky, vehicle, for_s):
    """Fly on; return the least distance of a vehicle from home."""
    plane = sky.planes[vehicle]
    away_m = []
    for _ in range(round(for_s)):
        fly_on(sky, 1.0)
        away_m.append(np.hypot(plane.east_m - 1500.0, plane.north_m - 1500.0))
    return min(away_m)


def test_a_return_over_terrain_waits_where_a_zone_with_a_ceiling_was_closed_round_home_in_flight():
    """The zone reaches above the flight band. Before, the mission led into it."""
    ground = elevation_of(hill(700.0, 2300.0, 60.0, 200.0, 70.0), 3000.0)
    sky = with_one_home(Sky(*PLACES[:2], field=FIELD + terrain_table(ground)))
    zone = NoFlyZone("fire", (1500.0, 1500.0, 400.0), limits=VerticalLimits(ceiling_m=300.0))
    sky.run_.order(Order(sky.run_.t_ns, "fire", "no-fly-zone", None, no_fly_zone=zone))
    fly_on(sky, 1.0)
    give(sky, "return")
    fly_on(sky, 4.0)
    told = [notice for _, notice in sky.told(NoticeCode.ORDER_WAITS)]
    assert [(one.vehicle, one.parameters["action"]) for one in told] == [(1, "return"), (2, "return")]


def held_together(field=FIELD):
    """Two that a failsafe brought to one height, and that were ordered to hold there."""
    sky = Sky((600.0, 600.0, 60.0), (1700.0, 1700.0, 80.0), field=field).fly(20.0)
    one, other = sky.planes[1], sky.planes[2]
    place(other, one.airframe.east_m + 80.0, one.airframe.north_m, one.airframe.alt_rel_m)
    for plane in (one, other):
        plane.autopilot.set_mode(Mode.RTL)
    fly_on(sky, 0.6)
    give(sky, "hold")
    return sky


@pytest.mark.parametrize("field", [FIELD, LANDING])
def test_of_two_that_hold_on_circles_that_overlap_one_gets_another_layer(field):
    """LOITER keeps the height. Before, they circled through each other until somebody acted."""
    sky = fly_on(held_together(field), 15.0)
    (_, notice), *_ = sky.told(NoticeCode.CHANGES_LAYER)
    agent, plane = sky.run_.engine.state.agents[notice.vehicle], sky.planes[notice.vehicle]
    assert agent.control.authority.word == "held"
    assert plane.autopilot.mode is Mode.AUTO
    place_m = agent.routes.stacked.points_m[-1]
    sky.near_s.clear()
    fly_on(sky, 60.0)
    assert not sky.near_s
    assert abs(sky.planes[1].alt_rel_m - sky.planes[2].alt_rel_m) > 15.0
    assert np.hypot(plane.east_m - place_m[0], plane.north_m - place_m[1]) < 200.0
    give(sky, "hold", notice.vehicle)
    fly_on(sky, 1.0)
    assert sky.answers[-1].detail == "is held by order: nothing was changed"
    give(sky, "resume")
    fly_on(sky, 20.0)
    assert all(one.control.is_ours for one in sky.run_.engine.state.agents.values())


@pytest.mark.parametrize(("above_m", "home_m"), [(4.0, 0.0), (-4.0, 0.0), (4.0, -30.0), (8.0, -30.0)])
def test_of_two_on_one_circle_one_goes_up_or_down_and_not_through_the_other(above_m, home_m):
    """They stay as near as they are. Before, no layer was clear for either: they were near now.

    Layers count from their homes, which may be lower than the map's origin.
    """
    sky = Sky((600.0, 600.0, 80.0), (1700.0, 1700.0, 80.0))
    for plane in sky.planes.values():
        plane.autopilot.home = replace(plane.autopilot.home, alt_m=home_m)
    sky.fly(20.0)
    give(sky, "hold")
    fly_on(sky, 20.0)
    one, other = sky.planes[1], sky.planes[2]
    behind = np.array((one.airframe.east_m, one.airframe.north_m))
    fly_on(sky, 1.2)
    place(other, *behind, one.alt_rel_m + above_m, np.rad2deg(one.airframe.heading_rad) - 20.0)
    other.autopilot._fly(one.autopilot.goal, one.alt_rel_m + above_m)
    fly_on(sky, 25.0)
    assert len(sky.told(NoticeCode.CHANGES_LAYER)) == 1
    assert (other.alt_rel_m - one.alt_rel_m) * above_m > 15.0 * abs(above_m)


def test_of_two_that_circle_at_one_height_one_that_somebody_else_set_to_loiter_is_not_moved():
    """It was held by order before. Before, that hid who had chosen its LOITER since."""
    sky = Sky((600.0, 600.0, 60.0), (1700.0, 1700.0, 60.0)).fly(20.0)
    give(sky, "hold", 1)
    fly_on(sky, 3.0)
    one, other = sky.planes[1], sky.planes[2]
    for mode in (Mode.FBWA, Mode.LOITER):  # by its pilot
        one.autopilot.set_mode(mode)
        fly_on(sky, 2.0)
    place(other, one.airframe.east_m + 80.0, one.airframe.north_m, one.airframe.alt_rel_m)
    give(sky, "hold", 2)
    fly_on(sky, 15.0)
    assert [notice.vehicle for _, notice in sky.told(NoticeCode.CHANGES_LAYER)] == [2]
    assert one.autopilot.mode is Mode.LOITER


def at_target(px4=(), terrain="", begin_m=(200.0, 200.0)):
    """One that circles at its target, and one that begins at a place, high above it."""
    field = FIELD.replace("= 2900.0\nnorth_m = 2900.0", "= 1500.0\nnorth_m = 1500.0")
    field = field.replace(
        "S = 1.0", "S = 1.0, RTL_ALTITUDE = 60.0, RTL_RETURN_ALT = 60.0, RTL_DESCEND_ALT = 60.0"
    )
    sky = Sky((1500.0, 1150.0, 60.0), (*begin_m, 200.0), field=field + terrain, px4=px4)
    agent = sky.run_.engine.state.agents[1]
    while agent.flight.phase is not FlightPhase.AT_TARGET or agent.perception.status.status != "arrived":
        fly_on(sky, 1.0)
    return fly_on(sky, 10.0)


@pytest.mark.parametrize(("px4", "begin_m"), [((), 1155.0), ((1, 2), 1170.0)])
def test_one_that_circles_at_its_target_makes_way_for_one_that_a_failsafe_returns(px4, begin_m):
    """A hold helps neither. Before, it circled on, and the other one came within 30 m at its height."""
    sky = at_target(px4)
    one, other = sky.planes[1], sky.planes[2]
    other.autopilot.home = replace(other.autopilot.home, east_m=1500.0, north_m=2600.0)
    place(other, 1500.0, begin_m, one.alt_rel_m)
    other.autopilot.set_mode(Mode.RTL)
    fly_on(sky, 60.0)
    ((_, notice),) = sky.told(NoticeCode.CHANGES_LAYER)
    assert notice.vehicle == 1
    assert not sky.near_s
    assert one.autopilot.mode is Mode.AUTO
    agent = sky.run_.engine.state.agents[1]
    assert agent.perception.status.status == "arrived"
    east_m, north_m = agent.routes.stacked.points_m[-1]
    place(other, east_m, north_m - 350.0, one.alt_rel_m)  # it comes through the new circle, too
    other.autopilot.home = replace(other.autopilot.home, east_m=east_m, north_m=north_m + 1100.0)
    other.autopilot.set_mode(Mode.MANUAL)
    fly_on(sky, 0.4)
    other.autopilot.set_mode(Mode.RTL)
    fly_on(sky, 60.0)
    assert len(sky.told(NoticeCode.CHANGES_LAYER)) > 1
    assert not sky.near_s


def test_one_that_made_way_is_led_out_of_a_zone_that_is_closed_there():
    """Before, no way round the zone was found: it circled on through it."""
    sky = at_target()
    one, other = sky.planes[1], sky.planes[2]
    other.autopilot.home = replace(other.autopilot.home, east_m=1500.0, north_m=2600.0)
    place(other, 1500.0, 1155.0, one.alt_rel_m)
    other.autopilot.set_mode(Mode.RTL)
    fly_on(sky, 60.0)
    east_m, north_m = sky.run_.engine.state.agents[1].tasking.onboard.circle.centre_m
    zone = NoFlyZone("fire", (east_m, north_m, 80.0), ())
    sky.run_.order(Order(sky.run_.t_ns, "zone", "no-fly-zone", None, no_fly_zone=zone))
    fly_on(sky, 20.0)
    for _ in range(30):
        fly_on(sky, 1.0)
        assert np.hypot(one.east_m - east_m, one.north_m - north_m) > 80.0
    assert one.autopilot.mode is Mode.AUTO


@pytest.mark.parametrize(
    ("px4", "begin_m"), [((), 930.0), ((), 975.0), ((), 1020.0), ((1, 2), 930.0), ((1, 2), 1050.0)]
)
def test_a_radio_that_fails_in_the_upload_for_a_vehicle_that_makes_way_leaves_it_on_one_whole_mission(
    px4, begin_m
):
    """Before, from 8 of 28 places to begin they came near: the mission was sent only 10 s before."""
    sky = at_target(px4, begin_m=(1500.0, 2600.0))
    one, other = sky.planes[1], sky.planes[2]
    place(other, 1500.0, begin_m, one.alt_rel_m)
    other.autopilot.set_mode(Mode.RTL)
    for _ in range(100):
        fly_on(sky, 0.4)
        if sky.told(NoticeCode.CHANGES_LAYER):
            break
    tasking = sky.run_.engine.state.tasking
    assert tasking.is_uploading(1)
    one.autopilot.faults.begin(FaultKind.RADIO, sky.run_.t_ns)
    fly_on(sky, 3.0)
    assert tasking.is_uploading(1)
    one.autopilot.faults.end(FaultKind.RADIO)
    fly_on(sky, 40.0)
    assert not sky.near_s
    agent = sky.run_.engine.state.agents[1]
    assert agent.tasking.onboard.route.is_same(agent.routes.stacked)
    assert one.autopilot.mode is Mode.AUTO
    assert agent.perception.status.status == "arrived"


@lru_cache
def at_target_over_terrain():
    """One that circles at its target, and one that a failsafe returns through that circle."""
    ground = elevation_of(hill(2300.0, 700.0, 60.0, 200.0, 70.0), 3000.0)
    sky = at_target(terrain=terrain_table(ground), begin_m=(1520.0, 2600.0))
    place(sky.planes[2], 1520.0, 1080.0, sky.planes[1].alt_rel_m)
    sky.planes[2].autopilot.set_mode(Mode.RTL)
    return sky


def test_one_that_circles_at_its_target_makes_way_over_terrain():
    """Before, there it stayed "en route", and never made way."""
    sky = fly_on(at_target_over_terrain().copy(), 60.0)
    assert [notice.vehicle for _, notice in sky.told(NoticeCode.CHANGES_LAYER)] == [1]
    assert not sky.told(NoticeCode.SEPARATION_LOST)
    agent = sky.run_.engine.state.agents[1]
    assert agent.perception.status.status == "arrived"
    assert agent.flight.phase is FlightPhase.AT_TARGET


def test_a_search_for_a_clear_circle_over_terrain_looks_at_one_place_a_second(monkeypatch):
    """Before, at up to four places in one step: 1.4 s on two slow cores."""
    sky = at_target_over_terrain().copy()
    plan, looks = stacked_missions.plan_routes, []

    def note(grid, starts, targets, *args, **options):
        looks.append((sky.run_.t_ns, next(iter(targets.values()))))
        return plan(grid, starts, targets, *args, **options)

    monkeypatch.setattr(stacked_missions, "plan_routes", note)
    monkeypatch.setattr(OrderCheck, "stacking_problem", lambda *_, **__: "would come near agent 2")
    fly_on(sky, 8.0)
    times = sorted({t_ns for t_ns, _ in looks})
    assert len(times) > 2
    assert np.diff(times).min() >= S
    places = [{place_m for t_ns, place_m in looks if t_ns == at_ns} for at_ns in times]
    assert all(len(one_look) == 1 for one_look in places)
    assert len(set.union(*places)) == len(times)


def test_with_warnings_only_no_vehicle_that_holds_is_moved():
    sky = fly_on(held_together(FIELD.replace("[planning]", '[planning]\navoidance = "warn"')), 15.0)
    assert not sky.told(NoticeCode.CHANGES_LAYER)
    assert [plane.autopilot.mode for plane in sky.planes.values()] == [Mode.LOITER, Mode.LOITER]


@pytest.mark.parametrize(("clear_layers", "expected"), [({3, 5}, 3), (set(), 0)])
def test_a_return_rather_keeps_clear_of_one_that_its_vehicle_would_meet_anyway(clear_layers, expected):
    """In its own layer it is no worse than flying on: with twenty vehicles two came within 22 m and 3 m."""
    sky = two()
    stacked = sky.run_.engine.stages.avoidances._stacked

    def problem(route, *_, circles_only=False, is_strict=False):
        meets = is_strict and route.layer not in clear_layers
        return "would come near agent 2" if meets else ""

    stacked._order_check.stacking_problem = problem
    assert stacked.plan_returns([1], {}, sky.run_.t_ns)[1].layer == expected


def test_a_return_does_not_circle_where_a_mission_home_of_another_vehicle_will_end():
    """That is known for 40 s of flight only: two circled at home for 50 s, within 16 m and 4 m."""
    sky = two()
    check = sky.run_.engine.stages.avoidances._order_check
    flights = check.predict(sky.run_.t_ns)
    assert not check.problem(2, {2: "RTL"}, flights)
    ends_m = read_only([(1500.0, 1500.0)])
    above, at_its_height = (Route(1, home_label(1), ends_m, 0.0, layer=layer) for layer in (3, 2))
    routes = sky.run_.engine.state.agents[1].routes
    routes.stack(above)
    assert not check.problem(2, {2: "RTL"}, flights)
    routes.stack(at_its_height)
    assert "circle of agent 1" in check.problem(2, {2: "RTL"}, flights)
    own = replace(at_its_height, vehicle=2)
    assert "circle of agent 1" in check.stacking_problem(own, {}, {}, flights)
