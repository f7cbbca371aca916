"""What stands against a flight of the mission itself: its map, its routes, its fence, its sensors. Pure."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcs.command.aims import plan_options
from gcs.command.apart import lane_count, own_lanes
from gcs.command.area import mission_grid
from gcs.command.checks import Check, Level
from gcs.config import Config
from gcs.fence import fence_of
from gcs.model import NS_PER_S, FloatArray, Label, Scan, vehicle_name
from gcs.planning.routes import PlanResult, plan_routes
from gcs.planning.separation import Flight, separate
from gcs.planning.task import AgentStart

_MAX_CLOCK_S = 1.0


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """Routes as they would be planned now, to the places where targets may appear."""

    plan: PlanResult
    ways_m: Mapping[int, tuple[FloatArray, ...]]
    """(n, 2) east/north of each vehicle's route, from where it is."""


def rehearse(config: Config, seed: int, places_m: Mapping[int, tuple[float, float]]) -> Rehearsal:
    """Plan from where vehicles are; who has not told begins where the mission file says."""
    starts = {
        agent.vehicle: places_m.get(agent.vehicle, (agent.east_m, agent.north_m)) for agent in config.agents
    }
    targets: dict[Label, tuple[float, float]] = {
        (0, index): (birth.east_m, birth.north_m) for index, birth in enumerate(config.births)
    }
    if not targets:  # they may appear anywhere: to the middle, then
        area = config.map
        targets = {(0, n): (0.5 * area.width_m, 0.5 * area.height_m) for n in range(len(starts))}
    agents = {v: AgentStart(*place, None, config.speed_m_s(v)) for v, place in starts.items()}
    plan = plan_routes(mission_grid(config, seed), agents, targets, {}, plan_options(config))
    ways = {
        route.vehicle: (np.concatenate(([starts[route.vehicle]], route.flown_m)),) for route in plan.routes
    }
    return Rehearsal(plan, ways)


def mission_checks(config: Config, rehearsal: Rehearsal) -> list[Check]:
    """Judge the mission file, with routes from where the vehicles are.

    Raises
    ------
    ConfigError
        When the fence makes no sense.
    """
    return [_routes(rehearsal.plan), _separation(config, rehearsal), _fence(config, rehearsal)]


def _routes(plan: PlanResult) -> Check:
    stuck = plan.unassigned_vehicles if plan.unassigned_targets else ()
    longest_m = max((route.length_m for route in plan.routes), default=0.0)
    value = f"{len(plan.routes)} routes, the longest {longest_m:.0f} m"
    if stuck or not plan.routes:
        names = ", ".join(map(vehicle_name, stuck)) or "any vehicle"
        return Check(None, "routes", "refused", f"no way for {names}", "a way for all", "; ".join(plan.notes))
    level: Level = "warning" if plan.notes else "ok"
    return Check(None, "routes", level, value, "", "; ".join(plan.notes))


def _separation(config: Config, rehearsal: Rehearsal) -> Check:
    """Say which lanes the first plan would use, and who would come near whom at one altitude."""
    mission, own = config.mission, own_lanes(config)
    flights = [
        Flight(vehicle, way, config.speed_m_s(vehicle), own[vehicle])
        for vehicle, (way,) in sorted(rehearsal.ways_m.items())
    ]
    count = lane_count(config)
    lanes, conflicts = separate(flights, count, config.planning.separation_m)
    heights_m = [mission.altitude_rel_m + lane * mission.lane_step_m for lane in sorted(set(lanes.values()))]
    value = f"{len(heights_m)} of {count} lanes, at {', '.join(f'{height_m:g}' for height_m in heights_m)} m"
    if not conflicts:
        return Check(None, "separation", "ok", value)
    near = ", ".join(" and ".join(map(vehicle_name, conflict.vehicles)) for conflict in conflicts)
    text = f"{value}; {near} come near each other"
    return Check(None, "separation", "warning", text, "a lane each", "more mission.lanes, or watch them")


def _fence(config: Config, rehearsal: Rehearsal) -> Check:
    fence, frame = fence_of(config, config.name), config.local_frame
    if not fence.areas:
        level: Level = "ok" if fence.max_alt_rel_m else "warning"
        return Check(None, "fence", level, "no areas in the mission file", "[fence]", "docs/preflight.md")
    beyond_m = {v: max(fence.beyond(way, frame) for way in ways) for v, ways in rehearsal.ways_m.items()}
    leaving = [f"{vehicle_name(v)}: {metres:.0f} m" for v, metres in sorted(beyond_m.items()) if metres]
    if leaving:
        text = f"beyond the fence: {', '.join(leaving)}"
        return Check(None, "fence", "refused", text, "within", "move the starts, or draw it wider")
    return Check(None, "fence", "ok", f"{len(fence.areas)} areas, routes within")


def sensor_checks(scans: Sequence[Scan], problems: Iterable[str], waited_s: float) -> list[Check]:
    """Judge the scans that came in `waited_s` seconds: central command is blind without."""
    rows = [Check(None, "scans", "refused", problem, "", "docs/sensors.md") for problem in problems]
    if not scans and not rows:
        text = f"none in {waited_s:.0f} s"
        return [Check(None, "scans", "refused", text, "scans", "do sensors publish to links.zenoh?")]
    for name, some in itertools.groupby(sorted(scans, key=_name), key=_name):
        of_one = list(some)
        late_s = [(scan.t_ns - scan.measured_t_ns) / NS_PER_S for scan in of_one]
        worst_s = max(late_s, key=abs)
        detections = sum(len(scan.z_m) for scan in of_one) / len(of_one)
        level: Level = "ok" if abs(worst_s) <= _MAX_CLOCK_S else "refused"
        value = f"{len(of_one)} of {name}, {detections:.0f} detections each, {worst_s:+.2f} s old"
        rows.append(
            Check(
                None,
                "scans",
                level,
                value,
                f"within {_MAX_CLOCK_S:.0f} s",
                "" if level == "ok" else "clocks?",
            )
        )
    return rows


def _name(scan: Scan) -> str:
    return scan.sensor.name
