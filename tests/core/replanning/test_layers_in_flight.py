"""Routes of vehicles in flight over terrain: to other heights before two meet, and none below the band."""

import math
from dataclasses import replace

import pytest
from helpers.banked_field import BANKED_FIELD
from helpers.hills import elevation_of, terrain_table
from helpers.noticed import noticed
from helpers.staging import S

from gcs.core.replanning.reasons import of_agent
from gcs.core.replanning.route_starts import begin_height_msl_m
from gcs.core.replanning.triggers import Triggers
from gcs.model import NoticeCode, Order, Plan, Route, read_only
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import parse_scenario

FIELD = (
    BANKED_FIELD
    + """[planning]
shape = "flyable"
separation_m = 60.0
[mission]
altitude_rel_m = 70.0
layers = 2
[simulation]
forward_speed_m_s = 15.0
airframe = "banked"
[simulation.wind]
east_m_s = 8.0
[simulation.sensor]
clutter_per_scan = 0.0
[[agents]]
system_id = 1
east_m = 120.0
north_m = 1500.0
course_deg = 90.0
[[agents]]
system_id = 2
east_m = 200.0
north_m = 200.0
course_deg = 90.0
[[agents]]
system_id = 3
east_m = 1500.0
north_m = 740.0
course_deg = 0.0
[[births]]
east_m = 2800.0
north_m = 1500.0
[[births]]
east_m = 1500.0
north_m = 2800.0
[[births]]
east_m = 800.0
north_m = 200.0
[[simulation.targets]]
east_m = 2800.0
north_m = 1500.0
[[simulation.targets]]
east_m = 1500.0
north_m = 2800.0
[[simulation.targets]]
east_m = 800.0
north_m = 200.0
"""
)
TEXT = FIELD + terrain_table(elevation_of(lambda east, north: 70.0 + 0.0 * (east + north), 3000.0))
KNOWN_S = 10.0
"""Time from which the vehicles have an estimate of the wind."""
PINNED_HALF_S = 6
"""Time at which one gets the farther target, so that their ways cross."""


def label_at(run, east_m, north_m):
    """Return the target that is tracked nearest to a place."""
    tracks = run.engine.stages.trackers.targets.confirmation.tracks
    return min(tracks, key=lambda label: math.dist(tracks[label].mean[:2], (east_m, north_m)))


@pytest.mark.parametrize("plans_always", [False, True])
def test_one_of_two_that_will_meet_over_terrain_is_led_to_another_height_before(plans_always, monkeypatch):
    """Before, each kept its route up to the last seconds, and one had to hold.

    So it was later where another vehicle wanted a new route at every check.
    """
    if plans_always:
        why = [of_agent("agent in danger", 2, "would hit an obstacle")]
        monkeypatch.setattr(Triggers, "improvements", lambda *_, **__: why)
    effects = []
    run = VirtualRun(parse_scenario(TEXT, "field"), 1, on_effect=lambda _t_ns, effect: effects.append(effect))
    one, other = (run.vehicles[f"vehicle:{number}"] for number in (1, 3))
    nearest_m = math.inf
    height_m = 0.0
    for half_s in range(1, 200):
        run.run(0.5 * half_s)
        if half_s == PINNED_HALF_S:
            target = label_at(run, 2800.0, 1500.0)
            run.order(Order(run.t_ns, "pin", "pin", (1,), target=target))
        if run.t_ns - START_T_NS < KNOWN_S * S:
            for agent in run.engine.state.agents.values():
                agent.link.wind_m_s = None
        away_m = math.dist((one.east_m, one.north_m), (other.east_m, other.north_m))
        if away_m < nearest_m:
            nearest_m = away_m
            height_m = abs(one.alt_msl_m - other.alt_msl_m)
    assert nearest_m < 60.0
    assert height_m > 12.0
    changes = [one for one in effects if isinstance(one, Plan) and "layer occupied" in one.causes]
    assert len(changes) == 1
    assert len(changes[0].changed) == 1
    assert not noticed(effects, NoticeCode.AVOIDS)
    assert not noticed(effects, NoticeCode.SEPARATION_LOST)


@pytest.mark.parametrize(("least_agl_m", "is_low"), [(40.0, True), (46.0, False), (60.0, False)])
def test_a_new_route_below_the_flight_band_is_no_reason_to_leave_the_flown_one(least_agl_m, is_low):
    """Before, a vehicle got one that led down to 38 m above the ground, for a target that had moved 27 m."""
    run = VirtualRun(parse_scenario(TEXT, "field"), 1)
    run.run(12.0)
    replanner = run.engine.stages.replanner
    flown = run.engine.state.agents[3].routes.flown
    heights_m = read_only([150.0, 70.0 + least_agl_m, 150.0])
    points_m = read_only([(1500.0, 900.0), (1500.0, 1000.0), (1500.0, 2800.0)])
    new = Route(3, flown.target, points_m, 0.0, heights_msl_m=heights_m)
    assert replanner._kept.is_low(new) is is_low


@pytest.mark.parametrize(
    ("climb_m_s", "delivery_s", "rise_m"),
    [(0.0, 1.0, 0.0), (3.0, 1.0, 7.5), (-2.0, 1.0, -5.0), (3.0, 20.0, 12.0), (-300.0, 1.0, -25.0)],
)
def test_a_route_begins_at_the_height_that_the_vehicle_has_when_it_gets_its_mission(
    climb_m_s, delivery_s, rise_m
):
    """Return missions that were ordered in a climb began up to 28 m below their vehicles (ArduPlane SITL)."""
    run = VirtualRun(parse_scenario(TEXT, "field"), 1)
    run.run(12.0)
    state = replace(run.engine.stages.fleet.state(3), alt_msl_m=200.0, climb_m_s=climb_m_s)
    assert begin_height_msl_m(state, delivery_s) == pytest.approx(200.0 + rise_m)
    run.engine.state.agents[3].perception.motion.state = state
    stages = run.engine.stages
    inputs = stages.planning_inputs.build(run.t_ns, run.t_ns)
    inputs = replace(inputs, late_s={3: delivery_s - 1.0}, climbs={}, grounded=frozenset())
    agents = stages.replanner.starts.mission_inputs([3], (), {}, inputs).agents
    assert agents[3].height_msl_m == pytest.approx(200.0 + rise_m)
