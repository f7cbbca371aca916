"""Traffic in the climb of a vehicle on the ground: finds what its take-off would come near to.

A climb crosses the layers below its own. A take-off waits while another vehicle is, or will be, near the
climb at its height, at about the time at which the vehicle would be there. That time is uncertain: from an
order to the begin of the take-off run it takes up to `_DELAY_S`, and climbs are steeper or flatter than
expected.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from gcs.config import Config
from gcs.core.replanning.planned_flights import AltitudeLayers
from gcs.core.separation.forward_flight import Flight, FlightPaths, Goal, GoalKind, simulate_flights
from gcs.core.separation.intents import Intents
from gcs.core.separation.minima import PREDICTED_SHARE, layer_step_m, min_distance_m
from gcs.core.state import Agent
from gcs.core.takeoff.climbs import Climbs
from gcs.model import FloatArray

_DELAY_S: Final = 12.0
_EARLY_S: Final = 3.0
_LATE_SHARE: Final = 0.3
"""Relative uncertainty of the time to a point of the climb."""
_OVERSHOOT_M: Final = 10.0
"""Height above its altitude that a vehicle reaches at the end of a climb."""
_STEP_S: Final = 1.0
_MAX_S: Final = 90.0
_MAX_POINTS: Final = 4


class ClimbTraffic:
    """Finds the vehicles in the air that a take-off would meet."""

    def __init__(
        self,
        config: Config,
        intents: Intents,
        climbs: Climbs,
        layers: AltitudeLayers,
        agents: Mapping[int, Agent],
    ) -> None:
        self._config = config
        self._intents = intents
        self._climbs = climbs
        self._layers = layers
        self._agents = agents
        self._min_m = min_distance_m(config)
        self._min_height_m = PREDICTED_SHARE * layer_step_m(config)

    def crossing(self, vehicle: int, t_ns: int) -> tuple[int, float, float] | None:
        """Return a vehicle that a take-off now would meet, its height and its distance from the start.

        None if the climb is free, or the vehicle is not on the ground.
        """
        layer = self._layers.of(vehicle)
        climb = self._climbs.climb(vehicle, layer)
        others = [one for one in self._intents.flying(t_ns) if one.system_id != vehicle]
        if climb is None or not others:
            return None
        mission = self._config.mission
        ground_m = self._intents.ground_m(vehicle)
        top_m = ground_m + mission.altitude_rel_m + layer * mission.layer_step_m
        route = self._agents[vehicle].routes.newest
        points_m = [] if route is None else route.flown_m[:_MAX_POINTS].tolist()
        legs = [Goal(GoalKind.WAYPOINT, east_m, north_m, 20.0, top_m) for east_m, north_m in points_m]
        first = Goal(GoalKind.CLIMB, height_m=ground_m + climb.altitude_rel_m)
        run_s = 2.0 * climb.ground_run_m / climb.speed_m_s
        starting = Flight(
            vehicle,
            *climb.at(climb.ground_run_m),
            ground_m,
            climb.speed_m_s,
            climb.heading_rad,
            0.0,
            0.0,
            self._intents.turn_rate_rad_s(vehicle, climb.speed_m_s),
            (first, *legs, Goal(GoalKind.KEEP)),
            climb_gradient=self._intents.climb_gradient(vehicle),
        )
        for_s = min(2.0 * climb.in_air_m / climb.speed_m_s + (10.0 if legs else 0.0), _MAX_S)
        own = simulate_flights([starting], for_s, _STEP_S)
        traffic = simulate_flights(
            [self._intents.flight(one, t_ns) for one in others],
            min(run_s + (1.0 + _LATE_SHARE) * for_s + _DELAY_S, _MAX_S),
            _STEP_S,
        )
        met = self._met(own, traffic, run_s, top_m)
        for one, is_met in zip(others, met, strict=True):
            if is_met:
                away_m = math.dist((one.east_m, one.north_m), climb.start_m)
                return one.system_id, one.alt_msl_m - ground_m, away_m
        return None

    def _met(self, own: FlightPaths, traffic: FlightPaths, run_s: float, top_m: float) -> list[bool]:
        """Return for each vehicle of the traffic whether it meets the climb."""
        low_m = own.low_m[:, 0]
        high_m = np.minimum(own.high_m[:, 0], top_m) + _OVERSHOOT_M
        in_layer = np.flatnonzero(low_m >= top_m - 1.0)
        points = int(in_layer[0]) + 1 if len(in_layer) else len(low_m)
        there_s = run_s + _STEP_S * np.arange(points)
        t_s = _STEP_S * np.arange(len(traffic.east_m))
        first_s = there_s - _EARLY_S
        last_s = (1.0 + _LATE_SHARE) * there_s + _DELAY_S
        in_time = (t_s[:, None] >= first_s) & (t_s[:, None] <= last_s)  # (k, points)
        met = []
        for i in range(len(traffic.vehicles)):
            apart_m = np.hypot(
                _differences(traffic.east_m[:, i], own.east_m[:points, 0]),
                _differences(traffic.north_m[:, i], own.north_m[:points, 0]),
            )
            gap_m = np.maximum(
                _differences(traffic.low_m[:, i], high_m[:points]),
                -_differences(traffic.high_m[:, i], low_m[:points]),
            )
            met.append(bool((in_time & (apart_m < self._min_m) & (gap_m < self._min_height_m)).any()))
        return met


def _differences(theirs: FloatArray, ours: FloatArray) -> FloatArray:
    return theirs[:, None] - ours
