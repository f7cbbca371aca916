"""Simulated flight along a terrain route, which is corrected or planned again until it stays in the band.

The vehicle cuts corners, overshoots and follows its legs late (`gcs.planning.mission_flight`). Its height
is that of the leg it flies, linear between the two waypoints, and followed `HEIGHT_LAG_S` late. A route is
planned in a band above all ground within a tracking margin; its flight is checked against the ground below
it. Where it leaves the band by more than is allowed, the route gets other heights (`height_correction`). If
that is not enough, it is planned again with a wider margin.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.planning.forward_simulation import STEP_S, LoiterCircle, Motion, RemainingMission
from gcs.planning.map.grid import Point
from gcs.planning.mission_flight import simulate_mission
from gcs.planning.path.turns import TurnAnticipation
from gcs.planning.terrain.band import NO_BAND_M, FlightBand
from gcs.planning.terrain.height_correction import FlownLegs, correct_heights
from gcs.planning.terrain.route import TerrainRoute, plan_route
from gcs.planning.terrain.terrain_map import BandCircle, BandPose, Goal, TerrainMap

MARGINS_M: Final = (15.0, 40.0)
"""Tracking margins to plan with, the least one first."""
ALLOWED_M: Final = 3.0
"""Distance by which a simulated flight may leave the band."""
HEIGHT_LAG_S: Final = 3.0
"""Delay with which a vehicle follows the height of its leg: in a climb of 2 m/s it is 6 m below (TECS)."""


@dataclass(frozen=True, slots=True)
class FlightModel:
    """How a vehicle flies its waypoints."""

    speed_m_s: float
    turn_lag_s: float
    turns: TurnAnticipation
    wind_m_s: Point = (0.0, 0.0)
    """East and north, as the vehicle reports it."""

    @property
    def turn_radius_m(self) -> float:
        """Least turn radius in still air; without a wind that of turns in the wind of the plan."""
        if self.wind_m_s == (0.0, 0.0):
            return self.turns.radius_m
        return self.turns.radius_m / (1.0 + self.turns.wind_m_s / self.speed_m_s) ** 2


def fly_route(route: TerrainRoute, model: FlightModel, course_rad: float | None = None) -> FlownLegs:
    """Return the simulated flight along a route and round its circle.

    It begins on a course; None: on that of the first leg. A circle to the left is left out.
    """
    points = route.points_m
    radii_m = model.turns.accept_radii_m(points)
    circle = route.circle
    loiter = None
    if circle.is_clockwise:
        loiter = LoiterCircle((circle.east_m, circle.north_m), circle.radius_m)
    waypoints = tuple((float(east), float(north)) for east, north in points[1:])
    first = points[1] - points[0]
    east_m, north_m = points[0].tolist()
    if course_rad is None:
        course_rad = math.atan2(first[0], first[1])
    motion = Motion(east_m, north_m, model.speed_m_s, course_rad)
    ahead = RemainingMission(waypoints, tuple(radii_m.tolist()), circle=loiter)
    flight = simulate_mission(
        motion, None, ahead, model.turn_lag_s, model.turn_radius_m, wind_m_s=model.wind_m_s
    )
    places = flight.places_m
    passed = flight.passed
    if loiter is None:
        places = places[passed < len(waypoints)]
        passed = passed[passed < len(waypoints)]
    leg = np.minimum(passed, len(waypoints) - 1)
    along = np.diff(points, axis=0)[leg]
    share = ((places - points[leg]) * along).sum(axis=1) / np.maximum((along * along).sum(axis=1), 1e-9)
    share = np.where(passed < len(waypoints), np.clip(share, 0.0, 1.0), 1.0)
    late = np.maximum(np.arange(len(places)) - round(HEIGHT_LAG_S / STEP_S), 0)
    return FlownLegs(places, leg[late], share[late])


def worst_departure_m(
    band: FlightBand, route: TerrainRoute, model: FlightModel, course_rad: float | None = None
) -> float:
    """Return how far the flight along a route goes below the floor or above the ceiling; negative inside.

    A start outside the band counts. The course is that of `fly_route`.
    """
    return _departure_m(band, route, fly_route(route, model, course_rad))


def _departure_m(band: FlightBand, route: TerrainRoute, flown: FlownLegs) -> float:
    heights = flown.heights(route.heights_msl_m)
    limits = band.limits_at(flown.places_m)
    return float(np.maximum(limits[:, 0] - heights, heights - limits[:, 1]).max())


def plan_flown_route(
    band: FlightBand,
    tries: Iterable[tuple[TerrainMap, Goal | None]],
    start: BandPose | BandCircle,
    model: FlightModel,
    share: float = 0.5,
    allowed_m: float = 0.0,
    *,
    is_quick: bool = False,
) -> tuple[TerrainRoute, Goal] | None:
    """Return a route whose flight stays in a band, and its goal; the first of some tries that achieves it.

    Parameters
    ----------
    band : FlightBand
        Band without a margin, for the check.
    tries : iterable of (TerrainMap, Goal or None)
        Map and goal with each tracking margin, the least one first; None where the target has none.
    share : float
        Wanted share of the band.
    allowed_m : float
        Distance that the flight may leave the band by.
    is_quick : bool
        As of `plan_route`.

    Returns
    -------
    tuple or None
        Where no flight stays in the band, the route whose flight leaves it least; None without any route.
    """
    course_rad = start.course_rad if isinstance(start, BandPose) else None
    best: tuple[TerrainRoute, Goal] | None = None
    best_m = math.inf
    for terrain, goal in tries:
        for with_all_corners in () if goal is None else (False, True):
            assert goal is not None
            route = plan_route(
                terrain, start, goal, share, with_all_corners=with_all_corners, is_quick=is_quick
            )
            if route is None:
                continue
            flown = fly_route(route, model, course_rad)
            departure_m = _departure_m(band, route, flown)
            if allowed_m < departure_m < NO_BAND_M:
                route = correct_heights(band, route, flown, terrain.vertical)
                departure_m = _departure_m(band, route, flown)
            if departure_m < best_m:
                best = route, goal
                best_m = departure_m
            if departure_m <= allowed_m:
                return best
    return best
