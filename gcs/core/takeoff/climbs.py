"""Climbs after take-off: where they lead, and whether obstacles block them.

Routes of vehicles on the ground, or in their take-off, are planned from the end of the climb. A mission from
the ground is uploaded only if its climb and its first turn are clear. A climbing vehicle gets no other
mission.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from gcs.config import Config
from gcs.core.airspace.no_fly_zones import NoFlyZones
from gcs.core.replanning.plan_targets import vehicle_options
from gcs.core.state import Agent
from gcs.geo import wrap_pi
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.on_ground import is_on_ground
from gcs.model import FloatArray, Notice, NoticeCode, Parameter
from gcs.planning.manoeuvres.climb import Climb, climb_obstruction, ground_obstruction, turn_obstruction
from gcs.planning.manoeuvres.takeoff_obstruction import Obstruction, ObstructionCode

_MAX_HEADING_ERROR_RAD = math.radians(15.0)
"""Maximum angle between nose and runway."""
_HYSTERESIS_M = 10.0
"""Added clearance that ends a blocked take-off: reported positions and headings are noisy."""


class Climbs:
    """Climbs of vehicles on the ground, or in their take-off."""

    def __init__(self, config: Config, zones: NoFlyZones, fleet: Fleet, agents: Mapping[int, Agent]) -> None:
        self._zones = zones
        self._agents = agents
        self._config = config
        self._options = vehicle_options(config)
        self._fleet = fleet
        self._airframes = config.airframes_of_agents
        self._elevation = config.elevation
        self._least_agl_m = 0.0 if config.terrain is None else 0.5 * config.terrain.min_agl_m

    def climb(self, vehicle: int, layer: int, *, in_takeoff: bool = False) -> Climb | None:
        """Return the climb before a vehicle's route; None in flight.

        Parameters
        ----------
        layer : int
            Altitude layer of its route.
        in_takeoff : bool
            True if the vehicle flies to its mission's take-off item.
        """
        state = self._fleet.state(vehicle)
        home = self._fleet.home(vehicle)
        table = self._config.takeoff
        if state is None:
            return None
        altitude_rel_m = self._config.takeoff_altitude_rel_m(layer)
        airframe = self._airframes[vehicle]
        place_m = (state.east_m, state.north_m)
        course_rad = state.course_rad
        if is_on_ground(state, home):
            heading_rad = course_rad if table.heading_deg is None else math.radians(table.heading_deg)
            run_m = airframe.ground_run_m
            length_m = airframe.climb_length_m(altitude_rel_m)
            speed_m_s = airframe.speed_m_s
            wind_m_s = airframe.wind_m_s
            return Climb(place_m, heading_rad, run_m, length_m, altitude_rel_m, speed_m_s, wind_m_s)
        if not in_takeoff or home is None:
            return None
        left_m = max(altitude_rel_m - (state.alt_msl_m - home.alt_msl_m), 0.0)
        length_m = airframe.climb_length_m(left_m) - airframe.ground_run_m
        return Climb(place_m, course_rad, 0.0, length_m, altitude_rel_m, airframe.speed_m_s)

    def check(self, climbs: Mapping[int, Climb], t_ns: int) -> list[Notice]:
        """Check the climbs of all vehicles that may get a mission; return alarms and all-clears."""
        alarms = []
        all_clears = []
        for vehicle, agent in self._agents.items():
            climb = climbs.get(vehicle)
            was_blocked = bool(agent.takeoff.blocked)
            agent.takeoff.blocked = ""
            if climb is None or not is_on_ground(self._fleet.state(vehicle), self._fleet.home(vehicle)):
                continue
            found = self.obstruction(vehicle, climb, None, _HYSTERESIS_M if was_blocked else 0.0)
            why = agent.takeoff.blocked = "" if found is None else str(found)
            if why and not was_blocked:
                alarms.append(Notice(t_ns, NoticeCode.TAKEOFF_BLOCKED, vehicle, {"reason": why}))
            elif was_blocked and not why:
                all_clears.append(Notice(t_ns, NoticeCode.TAKEOFF_CLEAR, vehicle))
        return alarms + all_clears

    def obstruction(
        self, vehicle: int, climb: Climb, points_m: FloatArray | None, extra_m: float = 0.0
    ) -> Obstruction | None:
        """Return what obstructs a take-off; None if it is clear.

        Parameters
        ----------
        points_m : ndarray, shape (k, 2), or None
            East and north of the route that follows; None: only the climb is checked.
        extra_m : float
            Distance beyond the clearance.
        """
        options = self._options[vehicle]
        state = self._fleet.state(vehicle)
        course_rad = climb.heading_rad if state is None else state.course_rad
        if abs(wrap_pi(course_rad - climb.heading_rad)) > _MAX_HEADING_ERROR_RAD:
            directions: dict[str, Parameter] = {
                "nose_deg": math.degrees(course_rad) % 360.0,
                "heading_deg": math.degrees(climb.heading_rad),
            }
            return Obstruction(ObstructionCode.NOT_ALONG_RUNWAY, directions)
        obstacles = self._zones.obstacles
        found = climb_obstruction(obstacles.near_ground, climb, options.clearance_m + extra_m)
        if found is None and self._elevation is not None and climb.ground_run_m > 0.0:
            found = ground_obstruction(climb, self._elevation, self._least_agl_m)
        if found is not None or points_m is None:
            return found
        points = [(east_m, north_m) for east_m, north_m in points_m.tolist()]
        return turn_obstruction(obstacles.grid, climb, points, options.turn_radius_m, options.clearance_m)
