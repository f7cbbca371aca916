"""What keeping targets costs and saves: switches and metres flown against `planning.switch_gain_m`.

``python tests/bench/bench_hysteresis.py [--runs 20]`` prints a table: eight agents and eight targets whose
estimates jitter, planned anew at each check as they fly, in the open and among obstacles. Only the planner is
at work: an agent flies along its route at 15 m/s, a target stands or walks, and each plan sees targets with
noise of 10 m, and velocities to a fifth of their size. A switch is a plan that gives an agent another target
than it had.
"""

import argparse

import msgspec
import numpy as np

from gcs.config import load
from gcs.core.airspace.obstacle_map import mission_grid
from gcs.core.replanning.plan_targets import plan_options
from gcs.model import FloatArray
from gcs.planning.map.grid import Grid
from gcs.planning.map.line_of_sight import line_of_sight
from gcs.planning.planner_inputs import AgentState, PlanOptions, TargetDemand
from gcs.planning.team_routes import plan_routes
from gcs.planning.warm_up import warm_up

GAINS_M = (0.0, 25.0, 50.0, 100.0)
SPEED_M_S, PERIOD_S, NOISE_M, VELOCITY_NOISE = 15.0, 5.0, 10.0, 0.2
AGENTS, CLEARANCE_M = 8, 50.0


def fly(grid: Grid, options: PlanOptions, seed: int, walk_m_s: float) -> tuple[int, float]:
    """Fly until everybody is at a target; return switches and metres flown."""
    rng = np.random.default_rng(seed)
    places = {v: _free_place(grid, rng, 100.0, 500.0) for v in range(1, AGENTS + 1)}
    targets = {(0, j): _free_place(grid, rng, 1400.0, 1900.0) for j in range(AGENTS)}
    velocities = {label: walk_m_s * rng.standard_normal(2) for label in targets}
    current: dict[int, tuple[int, int]] = {}
    courses: dict[int, float] = {}
    switches, flown_m = 0, 0.0
    for _ in range(100):
        seen = {
            label: tuple((place + NOISE_M * rng.standard_normal(2)).tolist())
            for label, place in targets.items()
        }
        starts = {v: AgentState(*place.tolist(), courses.get(v), SPEED_M_S) for v, place in places.items()}
        led = {
            label: TargetDemand(
                tuple((velocities[label] + VELOCITY_NOISE * walk_m_s * rng.standard_normal(2)).tolist())
            )
            for label in targets
        }
        result = plan_routes(grid, starts, seen, current, options, demands=led)
        new = {route.vehicle: route.target for route in result.routes}
        switches += sum(v in current and current[v] != label for v, label in new.items())
        current = new
        for route in result.routes:
            vehicle = route.vehicle
            before = places[vehicle]
            places[vehicle] = _along(np.vstack((before, route.points_m)), SPEED_M_S * PERIOD_S)
            flown_m += min(SPEED_M_S * PERIOD_S, route.length_m)
            if np.hypot(*(places[vehicle] - targets[route.target])) < 40.0:
                del places[vehicle], targets[route.target], current[vehicle]
        for label, velocity in velocities.items():
            if label in targets:
                targets[label] = np.clip(targets[label] + PERIOD_S * velocity, 0.0, 2000.0)
        if not places:
            break
    return switches, flown_m


def _free_place(grid: Grid, rng: np.random.Generator, west_m: float, east_m: float) -> FloatArray:
    """A place that is as far from obstacles as routes should be."""
    while True:
        place = rng.uniform((west_m, 100.0), (east_m, 1900.0))
        if line_of_sight(grid, tuple(place), tuple(place), CLEARANCE_M):
            return place


def _along(points_m: FloatArray, way_m: float) -> FloatArray:
    """The place that far along a way."""
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points_m, axis=0).T))))
    return np.array([np.interp(way_m, along, points_m[:, axis]) for axis in (0, 1)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20)
    runs = parser.parse_args().runs
    warm_up()
    config = load("random-obstacles")
    print("| map | targets | hysteresis, m | switches | of those without | metres flown | more |")
    print("|---|---|---|---|---|---|---|")
    for name, threshold in (("open", 0.0), ("5 % obstacles", 0.05)):
        table = msgspec.structs.replace(config.map, random_threshold=threshold)
        for what, walk_m_s in (("stand", 0.0), ("walk, 2 m/s", 2.0)):
            base: tuple[float, float] | None = None
            for gain_m in GAINS_M:
                found = []
                for seed in range(1, runs + 1):
                    of_seed = msgspec.structs.replace(config, map=table)
                    planning = msgspec.structs.replace(config.planning, switch_gain_m=gain_m, shape="pulled")
                    options = plan_options(msgspec.structs.replace(of_seed, planning=planning))
                    found.append(fly(mission_grid(of_seed, seed), options, seed, walk_m_s))
                switches, metres = (float(sum(column)) for column in zip(*found, strict=True))
                base = base or (switches, metres)
                print(
                    f"| {name} | {what} | {gain_m:g} | {switches:.0f} "
                    f"| {base[0] / max(switches, 1.0):.1f} × fewer "
                    f"| {metres / 1000.0:.1f} km | {100.0 * (metres / base[1] - 1.0):+.2f} % |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
