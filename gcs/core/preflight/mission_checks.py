"""Preflight checks of a mission: map, routes, fence, altitude layers and sensors."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

from gcs.config import Config
from gcs.core.airspace.airspace_state import AirspaceState
from gcs.core.airspace.no_fly_zones import NoFlyZones
from gcs.core.airspace.obstacle_map import ObstacleMap, mission_map
from gcs.core.preflight.check_codes import CheckCode
from gcs.core.preflight.result import Check
from gcs.core.replanning.mission_inputs import mission_inputs
from gcs.core.replanning.return_routes import return_over_terrain
from gcs.core.takeoff.climbs import Climbs
from gcs.fence import fence_of
from gcs.mavlink.fleet.fleet import Fleet
from gcs.model import NS_PER_S, Parameter, Scan, vehicle_name
from gcs.planning.manoeuvres.climb import Climb
from gcs.planning.manoeuvres.takeoff_obstruction import Obstruction
from gcs.planning.map.grid import Point
from gcs.planning.plan_result import PlanResult
from gcs.planning.planner import plan_mission
from gcs.planning.planner_inputs import MissionInputs

_MAX_CLOCK_ERROR_S = 1.0
MIN_LANDING_M = 30.0
"""Least distance between landing points: vehicles came to rest up to 15 m from theirs."""


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """Routes that would be planned now, to the birth components of targets."""

    mission: MissionInputs
    plan: PlanResult
    climbs: Mapping[int, Climb]
    """Climbs of vehicles on the ground."""
    obstructions: Mapping[int, Obstruction]
    """Of take-offs that are not clear."""
    obstacles: ObstacleMap


def rehearse(
    config: Config, seed: int, positions_m: Mapping[int, Point], fleet: Fleet | None = None
) -> Rehearsal:
    """Plan from the positions of vehicles, or from the ends of their climbs.

    A vehicle without a reported position begins at its start in the mission file.

    Parameters
    ----------
    seed : int
        Seed of the random obstacles of its map.
    positions_m : mapping of int to (float, float)
        Positions of vehicles, east and north.
    fleet : Fleet or None
        States of vehicles; None: none is on the ground.
    """
    obstacles = mission_map(config, seed)
    mission = mission_inputs(config, obstacles)
    zones = NoFlyZones(AirspaceState(), obstacles)
    takeoffs = None if fleet is None else Climbs(config, zones, fleet, {})
    climbs = {
        vehicle: climb
        for vehicle, layer in mission.preferred_layers.items()
        if takeoffs is not None and (climb := takeoffs.climb(vehicle, layer)) is not None
    }
    begins_m = {v: [positions_m.get(v, (one.east_m, one.north_m))] for v, one in mission.agents.items()}
    for vehicle, climb in climbs.items():
        begins_m[vehicle].append(climb.latest_end_m)
    motions = {vehicle: climb.motion for vehicle, climb in climbs.items()}
    agents = {
        vehicle: replace(
            agent,
            east_m=begins_m[vehicle][-1][0],
            north_m=begins_m[vehicle][-1][1],
            course_rad=motions[vehicle].course_rad if vehicle in motions else None,
            motion=motions.get(vehicle),
        )
        for vehicle, agent in mission.agents.items()
    }
    # Without birth components, targets may appear anywhere: plan to the middle.
    middle_m = (0.5 * config.map.width_m, 0.5 * config.map.height_m)
    targets = mission.targets or {(0, number): middle_m for number in range(len(agents))}
    mission = replace(mission, agents=agents, targets=targets, begins_m=begins_m)
    plan = plan_mission(mission)
    points = {route.vehicle: route.points_m for route in plan.routes}
    found = {v: takeoffs.obstruction(v, one, points.get(v)) for v, one in climbs.items() if takeoffs}
    obstructions = {vehicle: obstruction for vehicle, obstruction in found.items() if obstruction is not None}
    return Rehearsal(mission, plan, climbs, obstructions, obstacles)


def mission_checks(config: Config, rehearsal: Rehearsal) -> list[Check]:
    """Check the mission with rehearsed routes.

    Raises
    ------
    ConfigError
        When the fence is invalid.
    """
    return [
        *(_takeoff(vehicle, rehearsal) for vehicle in sorted(rehearsal.climbs)),
        *_standing(config, rehearsal),
        *_landing(config, rehearsal),
        *_landing_over_terrain(config, rehearsal),
        _routes(rehearsal.plan),
        _separation(config, rehearsal),
        *_fence(config, rehearsal),
    ]


def _takeoff(vehicle: int, rehearsal: Rehearsal) -> Check:
    """Check the climb of a vehicle and its first turn."""
    climb = rehearsal.climbs[vehicle]
    obstruction = rehearsal.obstructions.get(vehicle)
    parameters: dict[str, Parameter] = {
        "length_m": climb.length_m,
        "heading_deg": math.degrees(climb.heading_rad) % 360.0,
        "altitude_m": climb.altitude_rel_m,
        "east_m": climb.end_m[0],
        "north_m": climb.end_m[1],
    }
    if obstruction is None:
        return Check(vehicle, CheckCode.TAKEOFF, parameters)
    parameters |= {
        "obstruction": obstruction.code.value,
        "problem": obstruction.problem,
        "remedy": obstruction.code.remedy,
    }
    return Check(vehicle, CheckCode.TAKEOFF_OBSTRUCTED, parameters)


def _standing(config: Config, rehearsal: Rehearsal) -> Iterator[Check]:
    """Warn of vehicles too near each other to take off together."""
    near_m = {
        (one, other): math.dist(rehearsal.climbs[one].start_m, rehearsal.climbs[other].start_m)
        for one, other in itertools.combinations(sorted(rehearsal.climbs), 2)
    }
    min_m = config.planning.separation_m
    near_m = {pair: away_m for pair, away_m in near_m.items() if away_m < min_m}
    if not near_m:
        return
    first, second, *_ = together = sorted({vehicle for pair in near_m for vehicle in pair})
    parameters: dict[str, Parameter] = {
        "vehicles": tuple(together),
        "distance_m": min(near_m.values()),
        "min_distance_m": min_m,
        "first": first,
        "second": second,
    }
    yield Check(None, CheckCode.STANDING_NEAR, parameters)


def _landing(config: Config, rehearsal: Rehearsal) -> Iterator[Check]:
    """Warn of vehicles that land, and stay, near each other: each lands where it starts."""
    places_m = {
        vehicle: rehearsal.mission.begins_m[vehicle][0]
        for vehicle, airframe in config.airframes_of_agents.items()
        if airframe.end == "land"
    }
    near_m = {
        pair: math.dist(places_m[pair[0]], places_m[pair[1]])
        for pair in itertools.combinations(sorted(places_m), 2)
    }
    near_m = {pair: away_m for pair, away_m in near_m.items() if away_m < MIN_LANDING_M}
    if not near_m:
        return
    parameters: dict[str, Parameter] = {
        "vehicles": tuple(sorted({vehicle for pair in near_m for vehicle in pair})),
        "distance_m": min(near_m.values()),
        "min_distance_m": MIN_LANDING_M,
    }
    yield Check(None, CheckCode.LANDINGS_NEAR, parameters)


def _landing_over_terrain(config: Config, rehearsal: Rehearsal) -> Iterator[Check]:
    """Refuse landings that no approach above the ground leads to."""
    mission = rehearsal.mission
    lands = [v for v, airframe in config.airframes_of_agents.items() if airframe.end == "land"]
    stuck = tuple(
        route.vehicle
        for route in rehearsal.plan.routes
        if mission.terrain is not None
        and route.vehicle in lands
        and return_over_terrain(mission, route, mission.begins_m[route.vehicle][0]) is None
    )
    if stuck:
        yield Check(None, CheckCode.LANDING_INTO_GROUND, {"vehicles": stuck})


def _routes(plan: PlanResult) -> Check:
    stuck = plan.unassigned_vehicles if plan.unassigned_targets else ()
    notes = "; ".join(note.line for note in plan.notes)
    if stuck:
        return Check(None, CheckCode.NO_ROUTE, {"vehicles": tuple(stuck), "notes": notes})
    if not plan.routes:
        return Check(None, CheckCode.NO_ROUTES, {"notes": notes})
    longest_m = max(route.length_m for route in plan.routes)
    code = CheckCode.ROUTES_WITH_NOTES if plan.notes else CheckCode.ROUTES
    return Check(None, code, {"count": len(plan.routes), "longest_m": longest_m, "notes": notes})


def _separation(config: Config, rehearsal: Rehearsal) -> Check:
    """Check the separation of the rehearsed routes in their altitude layers."""
    mission = config.mission
    conflicts = rehearsal.plan.conflicts
    heights_m = [
        mission.altitude_rel_m + layer * mission.layer_step_m
        for layer in sorted({route.layer for route in rehearsal.plan.routes})
    ]
    parameters: dict[str, Parameter] = {
        "used": len(heights_m),
        "layers": rehearsal.mission.layers,
        "heights": ", ".join(f"{height_m:g}" for height_m in heights_m),
    }
    if not conflicts:
        return Check(None, CheckCode.ROUTES_APART, parameters)
    parameters["pairs"] = ", ".join(
        " and ".join(map(vehicle_name, conflict.vehicles)) for conflict in conflicts
    )
    return Check(None, CheckCode.ROUTES_NEAR, parameters)


def _fence(config: Config, rehearsal: Rehearsal) -> Iterator[Check]:
    fence = fence_of(config, config.name)
    frame = config.local_frame
    if fence.passed:
        yield Check(None, CheckCode.AREAS_NOT_HELD, {"count": len(fence.passed)})
    if not fence.areas:
        yield Check(None, CheckCode.CEILING_ONLY if fence.max_alt_rel_m else CheckCode.NO_AREAS)
        return
    beyond_m = {v: fence.beyond(route_m, frame) for v, route_m in rehearsal.plan.paths_m.items()}
    leaving = [f"{vehicle_name(v)}: {metres:.0f} m" for v, metres in sorted(beyond_m.items()) if metres]
    if leaving:
        yield Check(None, CheckCode.ROUTES_BEYOND_FENCE, {"distances": ", ".join(leaving)})
    else:
        yield Check(None, CheckCode.ROUTES_IN_FENCE, {"count": len(fence.areas)})


def sensor_checks(scans: Sequence[Scan], problems: Iterable[str], waited_s: float) -> list[Check]:
    """Check the scans that arrived within `waited_s` seconds."""
    found = [Check(None, CheckCode.BAD_SCANS, {"problem": problem}) for problem in problems]
    if not scans and not found:
        return [Check(None, CheckCode.NO_SCANS, {"waited_s": waited_s})]
    by_name = attrgetter("sensor.name")
    for name, some in itertools.groupby(sorted(scans, key=by_name), key=by_name):
        of_one = list(some)
        age_s = max(((scan.t_ns - scan.measured_t_ns) / NS_PER_S for scan in of_one), key=abs)
        parameters: dict[str, Parameter] = {
            "count": len(of_one),
            "sensor": name,
            "detections": sum(len(scan.z_m) for scan in of_one) / len(of_one),
            "age_s": age_s,
            "max_off_s": _MAX_CLOCK_ERROR_S,
        }
        code = CheckCode.SCANS if abs(age_s) <= _MAX_CLOCK_ERROR_S else CheckCode.SCANS_OFF
        found.append(Check(None, code, parameters))
    return found
