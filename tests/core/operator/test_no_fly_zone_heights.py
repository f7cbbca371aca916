"""A vehicle over terrain would fly through a no-fly zone that was closed at its height, without an alarm."""

from functools import lru_cache

import numpy as np
import pytest
from helpers.flight_copies import copy_of
from helpers.hills import elevation_of, terrain_table
from helpers.noticed import noticed
from helpers.staging import S

from gcs.core.snapshot import decode_state, encode_state
from gcs.model import NoFlyZone, NoticeCode, Order, OrderAnswer, VerticalLimits
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import parse_scenario

BASE_MSL_M = 70.0
SLOPE = 0.1
"""The ground rises to the east: at the zone it is higher than the vehicle at its start."""
AIRFRAME = "bank_deg = 35.0\nclimb_m_s = 4.0\nsink_m_s = 3.0\n"
AT_S = 30.0
ZONE_M = (1200.0, 1500.0)


def field_over_slope() -> str:
    slope = elevation_of(lambda east, north: BASE_MSL_M + SLOPE * east + 0.0 * north, 3000.0)
    text = f"""
name = "slope"
[frame]
lat_deg = 33.2
lon_deg = -87.6
alt_msl_m = {BASE_MSL_M}
[map]
width_m = 3000.0
height_m = 3000.0
nodes_east = 61
nodes_north = 61
[airframe]
speed_m_s = 15.0
{AIRFRAME}
[planning]
shape = "flyable"
clearance_m = 20.0
vertical_clearance_m = 15.0
[mission]
altitude_rel_m = 70.0
[simulation]
forward_speed_m_s = 15.0
airframe = "banked"
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
    return text + terrain_table(slope)


@lru_cache
def under_way(until_s: float) -> VirtualRun:
    """Return the flight without a zone."""
    if until_s > AT_S:
        run = copy_of(under_way(AT_S))
    else:
        run = VirtualRun(parse_scenario(field_over_slope(), "slope"), 1)
    run.run(until_s)
    return run


class Flight:
    """A vehicle on its way east, and a zone of 100 m radius that is closed across its route."""

    def __init__(self, limits: VerticalLimits, place_m=ZONE_M) -> None:
        self.effects = []
        self.run = copy_of(under_way(AT_S))
        self.run.on_effect = lambda _t_ns, effect: self.effects.append(effect)
        self.zone = NoFlyZone("fire", (*place_m, 100.0), (), limits)
        self.run.order(Order(START_T_NS + round(AT_S * S), "1", "no-fly-zone", None, None, self.zone))
        self.run.run(AT_S + 0.1)

    @property
    def answer(self) -> OrderAnswer:
        (found,) = [effect for effect in self.effects if isinstance(effect, OrderAnswer)]
        return found

    def flown(self) -> list[tuple[float, float]]:
        """Return the heights above sea level and above ground at which the vehicle is over the zone.

        It flies until it has passed the zone.
        """
        found = []
        for second in range(int(AT_S), int(AT_S) + 110):
            self.run.run(float(second))
            (state,) = self.run.engine.stages.fleet.states()
            if state.east_m > ZONE_M[0] + 150.0:
                return found
            if np.hypot(state.east_m - ZONE_M[0], state.north_m - ZONE_M[1]) < 100.0:
                ground_m = BASE_MSL_M + SLOPE * state.east_m
                found.append((state.alt_msl_m, state.alt_msl_m - ground_m))
        pytest.fail("it has not passed the zone")


@pytest.mark.parametrize(
    "limits",
    [
        VerticalLimits(None, 500.0, "msl"),
        VerticalLimits(None, 300.0, "msl"),  # above the band at its western edge, inside it at its eastern
        VerticalLimits(None, 200.0, "ground"),
        VerticalLimits(20.0, 160.0, "ground"),
        VerticalLimits(100.0, 350.0, "home"),
    ],
)
def test_over_terrain_a_vehicle_is_led_around_a_zone_at_all_heights_of_its_band(limits) -> None:
    flight = Flight(limits)
    assert flight.answer.detail.endswith("agent 1 led around it")
    assert flight.flown() == []


@pytest.mark.parametrize(
    ("limits", "above", "below"),
    [(VerticalLimits(None, 80.0, "ground"), 80.0, 1e9), (VerticalLimits(90.0, None, "ground"), 0.0, 90.0)],
)
def test_over_terrain_a_vehicle_passes_over_or_under_a_zone_in_a_part_of_its_band(limits, above, below):
    flight = Flight(limits)
    heights_agl_m = [agl_m for _, agl_m in flight.flown()]
    assert heights_agl_m, "it flew around"
    assert above < min(heights_agl_m)
    assert max(heights_agl_m) < below


def test_a_zone_above_or_below_its_band_changes_no_route_over_terrain() -> None:
    for limits in (VerticalLimits(None, 20.0, "ground"), VerticalLimits(400.0, None, "msl")):
        flight = Flight(limits)
        assert "led around" not in flight.answer.detail
        assert not noticed(flight.effects, NoticeCode.ZONE_AHEAD)


@pytest.mark.parametrize(
    ("limits", "is_inside"),
    [(VerticalLimits(None, 200.0, "ground"), True), (VerticalLimits(None, 20.0, "ground"), False)],
)
def test_a_vehicle_is_inside_a_zone_by_the_ground_below_it(limits, is_inside) -> None:
    """At 2,000 m east the ground is 200 m above home."""
    effects = []
    run = copy_of(under_way(AT_S + 80.0))
    run.on_effect = lambda _t_ns, effect: effects.append(effect)
    (state,) = run.engine.stages.fleet.states()
    assert state.alt_msl_m - BASE_MSL_M > 150.0
    here = NoFlyZone("here", (state.east_m, state.north_m, 60.0), (), limits)
    run.order(Order(run.t_ns, "1", "no-fly-zone", None, None, here))
    run.run(AT_S + 82.0)
    assert bool(noticed(effects, NoticeCode.ZONE_ENTERED)) is is_inside


def test_a_zone_that_ends_below_the_ground_is_refused() -> None:
    """A ceiling above sea level that was meant above home would keep nothing clear."""
    flight = Flight(VerticalLimits(None, 120.0, "msl"))
    assert flight.answer.state == "refused"
    assert "it ends below the ground, which is at 180 m MSL there" in flight.answer.detail
    assert flight.run.engine.state.airspace.zones == {}


def test_heights_of_a_zone_survive_a_restart() -> None:
    flight = Flight(VerticalLimits(None, 200.0, "ground"))
    state = decode_state("test", encode_state(flight.run.engine.state))
    assert state.airspace.zones == {"fire": flight.zone}
