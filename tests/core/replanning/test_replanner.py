"""Vehicles would wait for their first plan, fly to where a target was, or turn back on the last metres."""

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.hills import elevation_of, terrain_table
from helpers.planning_desk import PERIOD_S, A, B, C, Desk, pair, replanner
from helpers.staging import at, mission, track
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.core.replanning.inputs import PlanningInputs
from gcs.core.tasking.upload_latency import DELIVERY_S
from gcs.model import NoticeCode
from gcs.planning.forward_simulation import Motion, RemainingMission


def test_the_first_plan_is_made_as_soon_as_everybody_expected_is_there():
    desk = Desk({1: (100.0, 200.0), 2: (100.0, 800.0)}, {A: (1500.0, 200.0)}, expected_targets=2)
    assert [desk.check(t_s) for t_s in (0.0, 1.0, 2.0)] == [None] * 3
    desk.targets[B] = (1500.0, 800.0)
    plan = desk.check(3.0)
    assert plan.reason == "first plan"
    assert plan.changed == (1, 2)
    assert (plan.t_ns, plan.picture_t_ns) == (at(3), at(3))


def test_the_first_plan_waits_five_seconds_for_missing_agents():
    desk = Desk({1: (100.0, 200.0), 2: (100.0, 800.0)}, {A: (1500.0, 200.0)}, expected_targets=2)
    assert [desk.check(t_s) for t_s in (10.0, 12.0, 14.9)] == [None] * 3
    assert desk.check(15.0).unassigned_vehicles == (2,)


@pytest.mark.parametrize("missing", ["agents", "targets"])
def test_there_is_no_first_plan_without_anybody_to_send_or_anywhere_to_go(missing):
    desk = Desk({1: (100.0, 200.0)}, {A: (1500.0, 200.0)})
    absent = getattr(desk, missing).copy()
    getattr(desk, missing).clear()
    assert [desk.check(float(t_s)) for t_s in range(30)] == [None] * 30
    getattr(desk, missing).update(absent)
    assert desk.check(30.0).changed == (1,)


def test_the_operator_is_warned_of_vehicles_without_a_layer_of_their_own():
    agents = {1: (100.0, 200.0), 2: (100.0, 220.0)}
    desk = Desk(agents, {A: (1500.0, 200.0), B: (1500.0, 220.0)}, tables="[mission]\nlayers = 1\n")
    desk.check(0.0)
    (note,) = desk.state.new_notes
    assert (note.code, note.parameters) == (NoticeCode.NO_LAYER_LEFT, {"vehicles": (1, 2)})


def test_a_warning_of_a_plan_ends_with_the_plan_in_which_it_no_longer_holds():
    agents = {1: (100.0, 200.0), 2: (100.0, 220.0)}
    desk = Desk(agents, {A: (1500.0, 200.0), B: (1500.0, 220.0)}, tables="[mission]\nlayers = 1\n")
    desk.check(0.0)
    (begin,) = desk.replanner.take_notes()
    desk.lose(2)
    desk.check(5.0)
    (end,) = desk.replanner.take_notes()
    assert end.at(at(5)).ended == (begin.key,)


def test_a_warning_of_a_vehicle_that_circles_in_the_way_goes_on_while_the_route_is_kept(monkeypatch):
    """Flown: "no longer come near" was told 20 s before separation was lost: another vehicle was led away."""
    monkeypatch.setattr("gcs.planning.routes_over_terrain._MAX_DETOURS", 0)  # as in a narrow valley
    agents = {1: (900.0, 200.0), 2: (100.0, 200.0), 3: (100.0, 1800.0)}
    targets = {A: (1000.0, 200.0), B: (1800.0, 200.0), C: (1500.0, 1800.0)}
    level = elevation_of(lambda east, north: 600.0 + 0.0 * (east + north), 2000.0)
    desk = Desk(agents, targets, tables="[mission]\nlayers = 1\n" + terrain_table(level))
    desk.check(0.0)
    desk.arrive(1)
    desk.targets[B] = (1800.0, 300.0)
    assert desk.check(5.0).changed == (2,)
    (noted,) = desk.state.noted
    assert (noted.code, noted.parameters) == (NoticeCode.NO_LAYER_LEFT, {"vehicles": (1, 2)})
    desk.replanner.take_notes()
    desk.targets[C] = (600.0, 1500.0)
    assert desk.check(10.0).changed == (3,)
    assert desk.replanner.take_notes() == ()


def test_a_warning_of_a_route_ends_alone():
    """The same route may have others that go on."""
    wall = "[map]\nboxes_m = [[1380.0, 80.0, 1620.0, 320.0]]\n"
    desk = pair(tables=wall)
    (begin,) = (one for one in desk.replanner.take_notes() if one.code is NoticeCode.TARGET_OVER_OBSTACLE)
    desk.targets[A] = (1000.0, 200.0)
    desk.check(5.0)
    (end,) = (one for one in desk.replanner.take_notes() if one.code is NoticeCode.ROUTE_REMARK_OVER)
    assert end.at(at(5)).ended == (begin.key,)


def test_what_holds_of_a_plan_ends_with_the_mission():
    agents = {1: (100.0, 200.0), 2: (100.0, 220.0)}
    desk = Desk(agents, {A: (1500.0, 200.0), B: (1500.0, 220.0)}, tables="[mission]\nlayers = 1\n")
    desk.check(0.0)
    begun = {note.key for note in desk.replanner.take_notes()}
    desk.replanner.end_notes()
    assert {key for note in desk.replanner.take_notes() for key in note.at(at(5)).ended} == begun != set()
    assert desk.replanner.take_notes() == ()


def test_checks_come_every_period_and_not_at_every_scan():
    desk = pair()
    assert [t_s for t_s in range(1, 21) if desk.replanner.is_due(at(t_s)) and desk.check(t_s) is None] == [
        5, 10, 15, 20,
    ]  # fmt: skip


def test_checks_missed_without_scans_are_not_repeated_one_after_another():
    desk = pair()
    desk.check(62.0)
    assert [t_s for t_s in range(62, 76) if desk.replanner.is_due(at(t_s)) and desk.check(t_s) is None] == [
        65, 70, 75,
    ]  # fmt: skip


def test_nothing_new_is_no_new_plan():
    desk = pair()
    for t_s in range(5, 100, 5):
        desk.agents[1] = (100.0 + 10.0 * t_s, 200.0)
        assert desk.check(t_s) is None


def test_a_mission_that_could_not_be_delivered_is_planned_again_at_the_next_check():
    desk = pair()
    desk.vehicles[2].routes.drop()
    plan = desk.check(5.0)
    assert (plan.reason, plan.changed) == ("agent 2 has no route", (2,))
    assert desk.assigned == {1: A, 2: B}
    assert desk.check(10.0) is None


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["lose agent", "arrive", "move", "appear", "lose", "drop", "nothing"]),
            st.integers(0, 9),
        ),
        max_size=12,
    )
)
def test_an_agent_that_is_not_in_changed_keeps_its_last_route(history):
    """Replaying only the missions to `changed` gives what the planner believes is flown."""
    agents = {v: (100.0, 350.0 * v) for v in range(1, 5)}
    desk = Desk(agents, {(0, i): (1800.0, 300.0 + 350.0 * i) for i in range(5)})
    sent, t_s = {}, 0.0
    for action, number in [("nothing", 0), *history]:
        tasked, labels = sorted(desk.assigned), sorted(desk.targets)
        if action == "lose agent" and len(desk.agents) > 1:
            desk.lose(sorted(desk.agents)[number % len(desk.agents)])
        elif action == "arrive" and tasked and len(desk.agents) > 1:
            vehicle = tasked[number % len(tasked)]
            if desk.assigned[vehicle] in desk.targets:
                desk.arrive(vehicle)
        elif action == "move" and labels:
            east_m, north_m = desk.targets[labels[number % len(labels)]]
            desk.targets[labels[number % len(labels)]] = (east_m - 30.0, north_m + 12.0 * number)
        elif action == "appear":
            desk.targets[(7, number)] = (1000.0 + 90.0 * number, 1000.0)
        elif action == "lose" and len(labels) > 1:
            del desk.targets[labels[number % len(labels)]]
        elif action == "drop" and tasked:
            sent.pop(tasked[number % len(tasked)], None)
            desk.vehicles[tasked[number % len(tasked)]].routes.drop()
        plan = desk.check(t_s)
        t_s += PERIOD_S
        if plan is None:
            continue
        assert plan.reason
        assert [r.vehicle for r in plan.routes] == sorted(r.vehicle for r in plan.routes)
        assert len({r.target for r in plan.routes}) == len(plan.routes)
        for route in plan.routes:
            assert route.vehicle in desk.agents
            assert route.target in desk.targets
            if route.vehicle in plan.changed:
                sent[route.vehicle] = route
            else:
                assert sent[route.vehicle] is route
        idle = set(plan.unassigned_vehicles)
        assert idle | {r.vehicle for r in plan.routes} == set(desk.agents)


def test_agent_and_target_are_both_taken_to_the_time_at_which_the_route_is_taken_up():
    """The agent flies towards the target, which flies across: what is flown meets it, not where it was."""
    config = mission(
        agents=[(100.0, 200.0)],
        births=[(1500.0, 200.0)],
        tables='[planning]\naim = "intercept"\nshape = "pulled"\n',
    )
    speed_m_s, velocity_m_s, delay_s = 15.0, np.array([0.0, 6.0]), 0.4
    sure = {"cov": np.diag([9.0, 9.0, 0.01, 0.01])}
    agent = replace(track((0, 1), (100.0, 200.0), (speed_m_s, 0.0)), **sure)
    target = replace(track(A, (1500.0, 200.0), tuple(velocity_m_s)), **sure)
    inputs = PlanningInputs(at(delay_s), at(0.0), {1: agent}, {A: target}, frozenset())
    (route,) = replanner(config).check(inputs).routes
    taken_up_s = delay_s + DELIVERY_S + 0.5 * config.airframe.turn_lag_s
    start_m = np.array([100.0 + speed_m_s * taken_up_s, 200.0])
    assert route.length_m == pytest.approx(np.hypot(*(route.points_m[-1] - start_m)))
    met_m = np.array([1500.0, 200.0]) + velocity_m_s * (taken_up_s + route.length_m / speed_m_s)
    assert np.hypot(*(met_m - route.points_m[-1])) < 5.0


def test_a_mission_that_takes_long_to_its_vehicle_is_planned_to_meet_the_target_later() -> None:
    config = mission(
        agents=[(100.0, 200.0)],
        births=[(1500.0, 200.0)],
        tables='[planning]\naim = "intercept"\nshape = "pulled"\n',
    )
    speed_m_s, velocity_m_s, late_s = 15.0, np.array([0.0, 4.0]), 20.0
    sure = {"cov": np.diag([9.0, 9.0, 0.01, 0.01])}
    agent = replace(track((0, 1), (100.0, 200.0), (speed_m_s, 0.0)), **sure)
    target = replace(track(A, (1500.0, 200.0), tuple(velocity_m_s)), **sure)
    bad = PlanningInputs(at(0.0), at(0.0), {1: agent}, {A: target}, frozenset(), late_s={1: late_s})
    planner = replanner(config)
    (route,) = planner.check(bad).routes
    meeting_s = DELIVERY_S + 0.5 * config.airframe.turn_lag_s + late_s + route.length_m / speed_m_s
    assert math.dist([1500.0, 200.0] + velocity_m_s * meeting_s, route.points_m[-1]) < 5.0
    # Its target walks on meanwhile, and that is no news.
    walked = replace(target, mean=np.array([*(target.mean[:2] + 15.0 * velocity_m_s), *velocity_m_s]))
    then = replace(bad, t_ns=at(15.0), picture_t_ns=at(15.0), left_s={1: 5.0}, targets={A: walked})
    assert planner.check(then) is None


@pytest.mark.parametrize(
    ("place", "ahead", "is_astray"),
    [
        ((900.0, 200.0), [(1500.0, 200.0)], False),  # north of the box, along it
        ((900.0, 130.0), [(1500.0, 130.0)], True),  # into it
        ((960.0, 160.0), [(1500.0, 100.0)], True),  # past its corner, much nearer than the clearance
        ((900.0, 130.0), [(950.0, 130.0)], False),  # its mission ends before
        ((900.0, 130.0), [], False),  # its waypoint is unknown
    ],
)
def test_a_vehicle_whose_onboard_mission_meets_an_obstacle_gets_another_route(place, ahead, is_astray):
    box = "[map]\nboxes_m = [[1000.0, 60.0, 1100.0, 140.0]]\n"
    tables = f'{box}[planning]\nshape = "flyable"\nclearance_m = 40.0\n'
    desk = Desk({1: (100.0, 200.0)}, {A: (1500.0, 200.0)}, tables=tables)
    desk.check(0.0)
    motion = Motion(*place, 15.0, math.pi / 2.0, ahead=RemainingMission(tuple(ahead), (10.0,) * len(ahead)))
    agent, target = track((0, 1), place, (15.0, 0.0)), track(A, desk.targets[A])
    inputs = PlanningInputs(at(5.0), at(5.0), {1: agent}, {A: target}, frozenset(), motions={1: motion})
    plan = desk.replanner.check(inputs)
    assert (plan is not None) == is_astray
    assert plan is None or plan.reason == "agent 1 would hit an obstacle"


def close_to_a_corner(target, *, passed=()):
    """What is decided for an agent near its target, when the target has moved into a corner of walls."""
    walls = "[map]\nboxes_m = [[1400.0, 60.0, 1900.0, 140.0], [1820.0, 140.0, 1900.0, 700.0]]\n"
    desk = Desk(
        {1: (100.0, 300.0)},
        {A: (1500.0, 300.0)},
        tables=f'{walls}[planning]\nshape = "flyable"\nclearance_m = 60.0\n',
    )
    (flown,) = desk.check(0.0).routes
    motion = Motion(1400.0, 300.0, 15.0, math.pi / 2.0, ahead=RemainingMission(((1500.0, 300.0),), (10.0,)))
    agent = track((0, 1), (1400.0, 300.0), (15.0, 0.0))
    inputs = PlanningInputs(
        at(60.0), at(60.0), {1: agent}, {A: track(A, target)}, frozenset(), motions={1: motion},
        passed=frozenset(passed),
    )  # fmt: skip
    return desk.replanner.check(inputs), flown, desk.vehicles[1].routes.flown


def test_a_route_that_does_not_reach_its_target_replaces_none_that_is_good():
    plan, flown, now = close_to_a_corner((1850.0, 200.0))
    assert plan is None
    assert now is flown
    plan, flown, now = close_to_a_corner((1560.0, 380.0))
    assert plan.changed == (1,)
    assert now is not flown


def test_who_passed_its_target_and_was_not_seen_to_reach_it_tries_again():
    assert close_to_a_corner((1510.0, 300.0))[0] is None
    plan, flown, now = close_to_a_corner((1510.0, 300.0), passed=[1])
    assert (plan.reason, plan.changed) == ("agent 1 passed target T0.0", (1,))
    assert now is not flown


def arriving(metres=40.0, velocity=(15.0, 0.0), **changes):
    """Agent 1 so far before its target, agent 2 on its way."""
    desk = pair(**changes)
    desk.agents |= {1: (1500.0 - metres, 200.0), 2: (1000.0, 800.0)}
    desk.velocities = {1: velocity, 2: (15.0, 0.0)}
    return desk


def test_an_agent_on_its_last_metres_is_not_led_to_where_its_target_jitters():
    desk = arriving()
    desk.targets[A] = (1500.0, 224.0)
    assert desk.check(60.0) is None
    further = arriving(metres=120.0)
    further.targets[A] = (1500.0, 260.0)
    assert further.check(60.0).changed == (1,)


def test_an_agent_on_its_last_metres_is_not_sent_elsewhere_for_a_better_whole():
    desk = arriving(tables="[planning]\nswitch_gain_m = 0.0\n")
    desk.agents[2] = (1650.0, 200.0)  # beyond 1's target; what appears lies behind 1
    desk.targets = {A: (1500.0, 200.0), C: (1200.0, 200.0)}
    plan = desk.check(60.0)
    assert 1 not in plan.changed
    assert desk.assigned == {1: A, 2: C}
    assert [route.vehicle for route in plan.routes] == [1, 2]
    assert plan.unassigned_targets == ()


BESIDE_A_BOX = """
[planning]
shape = "flyable"
clearance_m = 40.0
[airframe]
speed_m_s = 22.0
bank_deg = 35.0
[map]
width_m = 2000.0
height_m = 2000.0
nodes_east = 101
nodes_north = 101
boxes_m = [[1409.0, 286.0, 1597.0, 333.0]]
"""


def near_its_target():
    """An agent 83 m before the end of its route; its target is 48 m from there: only a loop leads to it."""
    desk = Desk({1: (900.0, 200.0)}, {A: (1500.0, 200.0)}, tables=BESIDE_A_BOX)
    desk.velocities[1] = (22.0, 0.0)
    assert desk.check(0.0).changed == (1,)
    desk.agents[1], desk.targets[A] = (1417.0, 200.0), (1468.0, 236.0)
    return desk


def test_near_its_target_an_agent_is_not_led_round_a_full_turn():
    desk = near_its_target()
    assert desk.check(30.0) is None
    assert desk.vehicles[1].routes.flown.points_m[-1] == pytest.approx((1500.0, 200.0))


SLALOM = BESIDE_A_BOX.replace(
    "[[1409.0, 286.0, 1597.0, 333.0]]",
    "[[400.0, 600.0, 2000.0, 640.0], [0.0, 1000.0, 1600.0, 1040.0], [400.0, 1400.0, 2000.0, 1440.0]]",
)


def test_the_turns_of_a_far_leg_are_no_full_turn_near_the_end_of_a_route():
    """The vehicle was left to where its target had been: the way round three walls counted as a loop."""
    desk = Desk({1: (900.0, 200.0)}, {A: (1500.0, 200.0)}, tables=SLALOM)
    desk.velocities[1] = (22.0, 0.0)
    assert desk.check(0.0).changed == (1,)
    desk.agents[1], desk.targets[A] = (1417.0, 200.0), (1500.0, 1800.0)
    assert desk.check(30.0).changed == (1,)


def test_near_its_target_an_agent_turns_fully_to_another_target():
    desk = near_its_target()
    desk.targets[B] = desk.targets.pop(A)
    assert desk.check(30.0).changed == (1,)


def test_an_agent_that_has_its_target_behind_it_is_not_left_to_it():
    desk = arriving(velocity=(-15.0, 0.0))
    desk.targets[A] = (1500.0, 245.0)
    assert desk.check(60.0).changed == (1,)


@pytest.mark.parametrize("seed", range(6))
def test_vehicles_that_keep_their_routes_keep_them_without_new_ones(monkeypatch, seed):
    """With hundreds of vehicles, to shape a route for each took longer than a scan."""
    rng = np.random.default_rng(seed)
    labels = (A, B, C)
    starts = {v: tuple(rng.uniform(100.0, 1900.0, 2).tolist()) for v in (1, 2, 3)}
    targets = {label: tuple(rng.uniform(100.0, 1900.0, 2).tolist()) for label in labels}
    desk = Desk(dict(starts), dict(targets))
    plain = Desk(dict(starts), dict(targets))
    monkeypatch.setattr(plain.replanner._kept, "settled", lambda *_: {})
    shaped = []
    for t_s in range(0, 60, 5):
        for label in labels:
            if rng.random() < 0.3:
                east_m, north_m = rng.uniform(-120.0, 120.0, 2).tolist()
                targets[label] = (targets[label][0] + east_m, targets[label][1] + north_m)
        gone = labels[rng.integers(3)] if rng.random() < 0.2 else None
        for one in (desk, plain):
            one.targets.clear()
            one.targets.update({label: place for label, place in targets.items() if label != gone})
        made, wanted = desk.check(t_s), plain.check(t_s)
        assert (made is None) is (wanted is None)
        if made is not None and wanted is not None:
            assert made.changed == wanted.changed
            assert made.unassigned_vehicles == wanted.unassigned_vehicles
            assert made.unassigned_targets == wanted.unassigned_targets
            assert all(a.is_same(b) for a, b in zip(made.routes, wanted.routes, strict=True))
            shaped.append(len(made.routes) - len(made.changed))
    assert any(shaped)
