"""Two vehicles over terrain that would meet at one height, since the wind is not that of the first plan."""

import math

from helpers.hills import elevation_of, terrain_table
from helpers.noticed import noticed
from helpers.staging import S

from gcs.model import NoticeCode, Order, Plan
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import parse_scenario

FIELD = """
name = "field"
[frame]
lat_deg = 33.2
lon_deg = -87.6
alt_msl_m = 70.0
[map]
width_m = 3000.0
height_m = 3000.0
nodes_east = 61
nodes_north = 61
[airframe]
speed_m_s = 15.0
bank_deg = 35.0
climb_m_s = 4.0
sink_m_s = 3.0
[planning]
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
KNOWN_S = 10.0
"""Time from which the vehicles have an estimate of the wind."""
PINNED_HALF_S = 6
"""Time at which one gets the farther target, so that their ways cross."""


def label_at(run, east_m, north_m):
    """Return the target that is tracked nearest to a place."""
    tracks = run.engine.stages.trackers.targets.confirmation.tracks
    return min(tracks, key=lambda label: math.dist(tracks[label].mean[:2], (east_m, north_m)))


def test_one_of_two_that_will_meet_over_terrain_is_led_to_another_height_before():
    """Before, each kept its route up to the last seconds, and one had to hold."""
    text = FIELD + terrain_table(elevation_of(lambda east, north: 70.0 + 0.0 * (east + north), 3000.0))
    effects = []
    run = VirtualRun(parse_scenario(text, "field"), 1, on_effect=lambda _t_ns, effect: effects.append(effect))
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
