"""A vehicle over terrain would fly behind a target that moves, and never reach it."""

import math

import numpy as np
import pytest

from gcs.planning.map.grid import free_grid
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.planner_inputs import AgentState, LoiterSpec, PlanOptions
from gcs.planning.terrain.ground import Terrain
from gcs.planning.terrain.terrain_search import TerrainSearch
from gcs.terrain.elevation_grid import Elevation

SPEED_M_S = 15.0
GRID = free_grid((61, 61), 50.0)
AT = np.arange(-500.0, 3520.0, 20.0)
EAST, NORTH = np.meshgrid(AT, AT)
HILLS = Elevation((-500.0, -500.0), 20.0, 200.0 + 60.0 * np.sin(EAST / 300.0) * np.cos(NORTH / 250.0))
TURNS = TurnAnticipation(40.0, 15.0, 10.0)
START_M = (300.0, 1500.0)


def meeting(place_m, velocity_m_s, horizon_s=120.0):
    """Return the route to a target, where it is met, and the time of the flight there."""
    options = PlanOptions(
        shape="flyable",
        clearance_m=20.0,
        turns=TURNS,
        loiter=LoiterSpec(60.0, 60.0, 1.0, TURNS),
        horizon_s=horizon_s,
        climb_gradient=0.2,
        sink_gradient=0.17,
    )
    height_msl_m = 85.0 + HILLS.height_msl_m(*START_M)
    agent = AgentState(*START_M, 0.5 * math.pi, SPEED_M_S, height_msl_m=height_msl_m)
    terrain = Terrain(HILLS, 50.0, 120.0)
    search = TerrainSearch(terrain, GRID, [agent], [place_m], options, [velocity_m_s])
    route, met_m = search.route(0, 0, 0)
    nearest = int(np.argmin(np.hypot(*(route.points_m - met_m).T)))
    return met_m, float(np.hypot(*np.diff(route.points_m[: nearest + 1], axis=0).T).sum()) / SPEED_M_S


@pytest.mark.parametrize("velocity_m_s", [(0.0, 6.0), (0.0, -9.0), (5.0, 5.0), (-8.0, 0.0)])
def test_a_route_leads_to_where_the_target_will_be(velocity_m_s):
    place_m = (1500.0, 1500.0)
    met_m, flown_s = meeting(place_m, velocity_m_s)
    there_m = np.array(place_m) + flown_s * np.array(velocity_m_s)
    assert math.dist(met_m, there_m) < 60.0
    assert math.dist(met_m, place_m) > 200.0


def test_a_target_that_leaves_the_map_is_met_inside_it():
    met_m, _ = meeting((1500.0, 2800.0), (0.0, 10.0))
    assert 2800.0 < met_m[1] < 2980.0


def test_it_is_not_led_beyond_the_horizon_and_stays_at_a_target_that_stands():
    assert meeting((1500.0, 1500.0), (0.0, 6.0), horizon_s=0.0)[0] == (1500.0, 1500.0)
    assert meeting((1500.0, 1500.0), (0.0, 6.0), horizon_s=20.0)[0] == (1500.0, 1620.0)
    assert meeting((1500.0, 1500.0), (0.0, 0.0))[0] == (1500.0, 1500.0)
