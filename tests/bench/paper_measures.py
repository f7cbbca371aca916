"""Measures for the claims of the paper, each on one simulated run with ground truth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from helpers.grid_paths import distances_m, nearest_free

from gcs.model import FloatArray, Kind
from gcs.planning.map.grid import Grid, Node
from gcs.report.run.evaluation import Summary
from gcs.report.run.timeline import KINDS, Decision, Estimate, Path, Timeline

NEAR_M = 100.0
"""Distance within which an estimate belongs to an object, or a route's end to a target: the OSPA cut-off."""
_AHEAD_S = 120.0
"""Greatest prediction horizon of a planner."""
_HEADING_S = 2.0
"""Interval over which a target's velocity is measured."""
_STEP_M = 2.0
RE_ROUTED_WITHIN_S = 15.0


@dataclass(frozen=True, slots=True)
class Flown:
    """One simulated run."""

    timeline: Timeline
    summary: Summary
    grid: Grid


@dataclass(frozen=True, slots=True)
class Handover:
    """A survivor that got the target of a lost agent."""

    lost: int
    successor: int
    after_s: float
    """Time from the loss to the plan."""
    new_m: float
    """Straight-line distance of the survivor to the end of its new route."""
    former_m: float
    """Straight-line distance to the end of its former route; NaN without one."""


def metres_in_obstacles(flown: Flown) -> float:
    """Return the metres flown inside blocked cells, along straight lines between scans."""
    total_m = 0.0
    for path in flown.timeline.paths["agents"].values():
        for a, b in zip(path.points_m[:-1], path.points_m[1:], strict=True):
            count = max(1, math.ceil(float(np.hypot(*(b - a))) / _STEP_M))
            for part in (np.arange(count) + 0.5) / count:
                place = a + part * (b - a)
                node = flown.grid.node_of((float(place[0]), float(place[1])))
                if flown.grid.blocked[node]:
                    total_m += float(np.hypot(*(b - a))) / count
    return total_m


def handovers(flown: Flown) -> tuple[Handover, ...]:
    """Return the survivor that got the target of each lost agent, by the first plan after the loss."""
    timeline, found = flown.timeline, []
    for lost, path in timeline.paths["agents"].items():
        if not path.is_lost:
            continue
        lost_s = float(path.t_s[-1])
        before = [decision for decision in timeline.decisions if decision.t_s <= lost_s]
        target = before[-1].targets.get(lost) if before else None
        for decision in timeline.decisions:
            if not lost_s < decision.t_s <= lost_s + RE_ROUTED_WITHIN_S or target is None:
                continue
            successors = [v for v in decision.changed if decision.targets[v] == target and v != lost]
            if successors:
                found.append(_handover(timeline, lost, successors[0], decision, lost_s))
                break
    return tuple(found)


def _handover(timeline: Timeline, lost: int, new: int, decision: Decision, lost_s: float) -> Handover:
    here = _at(timeline.paths["agents"][new], decision.t_s)
    earlier = [d.ends_m[new] for d in timeline.decisions if d.t_s < decision.t_s and new in d.ends_m]
    former_m = float(np.hypot(*(here - np.array(earlier[-1])))) if earlier else math.nan
    new_m = float(np.hypot(*(here - np.array(decision.ends_m[new]))))
    return Handover(lost, new, decision.t_s - lost_s, new_m, former_m)


def spurious(flown: Flown) -> tuple[int, int, int]:
    """Count revivals: (scans, longest run of scans, scans before the first) of estimates of a lost agent.

    An estimate counts if it lies within `NEAR_M` of the position of the loss, and no active agent does. The
    third number is the delay until the loss is detected; the first two count what follows.
    """
    again = longest = waiting = 0
    for path in flown.timeline.paths["agents"].values():
        if not path.is_lost:
            continue
        after = [e for e in flown.timeline.estimates["agents"] if e.t_s > path.t_s[-1]]
        shown = [_is_shown(flown.timeline, path, estimate) for estimate in after]
        until = shown.index(False) if False in shown else len(shown)
        waiting = max(waiting, until)
        run = 0
        for here in shown[until:]:
            run = run + 1 if here else 0
            again += here
            longest = max(longest, run)
    return again, longest, waiting


def _is_shown(timeline: Timeline, path: Path, estimate: Estimate) -> bool:
    near = [point for point in estimate.points_m if np.hypot(*(point - path.points_m[-1])) < NEAR_M]
    living = _living_m(timeline, "agents", estimate.t_s)
    return any(all(np.hypot(*(point - one)) >= NEAR_M / 2.0 for one in living) for point in near)


def false_and_missed(flown: Flown) -> tuple[int, int, int]:
    """Count (estimates, false estimates, living objects without an estimate) over all scans."""
    estimates = false = missed = 0
    for kind in KINDS:
        for estimate in flown.timeline.estimates[kind]:
            places = _living_m(flown.timeline, kind, estimate.t_s)
            gaps = np.hypot(*np.moveaxis(estimate.points_m[:, None] - places[None], -1, 0))
            near = gaps < NEAR_M
            estimates += len(estimate.points_m)
            false += int((~near.any(axis=1)).sum()) if len(places) else len(estimate.points_m)
            missed += int((~near.any(axis=0)).sum()) if len(estimate.points_m) else len(places)
    return estimates, false, missed


def wrong_kind(flown: Flown) -> tuple[int, int]:
    """Count estimates of objects of the other kind: (agent tracker, target tracker).

    Only estimates with nothing of their own kind within `NEAR_M` count.
    """
    found = []
    for kind, other in (KINDS, tuple(reversed(KINDS))):
        count = 0
        for estimate in flown.timeline.estimates[kind]:
            own, their = (_living_m(flown.timeline, of, estimate.t_s) for of in (kind, other))
            for point in estimate.points_m:
                near_own = len(own) and np.hypot(*(own - point).T).min() < NEAR_M
                near_other = len(their) and np.hypot(*(their - point).T).min() < NEAR_M
                count += bool(near_other and not near_own)
        found.append(count)
    return found[0], found[1]


def astray(flown: Flown) -> tuple[int, int]:
    """Count (new routes, those that end farther than `NEAR_M` from the path of every living target).

    Predictions start from the true position and velocity of the target, over the planner's horizon.
    """
    routes = lost = 0
    for decision in flown.timeline.decisions:
        paths = flown.timeline.paths["targets"].values()
        living = [path for path in paths if _lives(path, decision.t_s)]
        for end in decision.ends_m.values():
            routes += 1
            lost += all(_distance_from_path_m(path, decision.t_s, np.array(end)) > NEAR_M for path in living)
    return routes, lost


def _distance_from_path_m(path: Path, t_s: float, point_m: FloatArray) -> float:
    """Return the distance of a point from the straight path of an object at constant velocity."""
    place = _at(path, t_s)
    ahead = (place - _at(path, t_s - _HEADING_S)) * (_AHEAD_S / _HEADING_S)
    length2 = float(ahead @ ahead)
    share = min(max(float((point_m - place) @ ahead) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
    return float(np.hypot(*(point_m - place - share * ahead)))


def speeds(flown: Flown) -> tuple[float, float]:
    """Return the median speed of agents and the highest speed of a target, in m/s, from the ground truth."""

    def of(path: Path) -> FloatArray:
        steps = np.hypot(*np.diff(path.points_m, axis=0).T)
        return np.asarray(steps / np.diff(path.t_s)) if len(path.t_s) > 1 else np.empty(0)

    agents = np.concatenate([np.empty(0), *(of(path) for path in flown.timeline.paths["agents"].values())])
    targets = np.concatenate([np.empty(0), *(of(path) for path in flown.timeline.paths["targets"].values())])
    return float(np.median(agents)), float(targets.max(initial=0.0))


def waviness(flown: Flown) -> tuple[float, float]:
    """Return (flown length over the shortest grid path, turning in degrees per km) of arrived agents.

    The grid path leads from the start to the position at arrival.
    """
    flown_m = shortest_m = turned_deg = 0.0
    for vehicle, t_s, status in flown.timeline.statuses:
        path = flown.timeline.paths["agents"].get(vehicle)
        if status != "arrived" or path is None:
            continue
        points = path.until(t_s).points_m
        steps = np.diff(points, axis=0)
        flown_m += float(np.hypot(*steps.T).sum())
        heading = np.unwrap(np.arctan2(steps[:, 0], steps[:, 1]))
        turned_deg += float(np.degrees(np.abs(np.diff(heading)).sum()))
        start, end = (_free_node(flown.grid, point) for point in (points[0], points[-1]))
        shortest_m += float(distances_m(flown.grid, start)[end])
    return (flown_m / shortest_m, turned_deg / flown_m * 1e3) if flown_m else (math.nan, math.nan)


def _living_m(timeline: Timeline, kind: Kind, t_s: float) -> FloatArray:
    """Return the (n, 2) true positions of living objects at a time."""
    paths = timeline.paths[kind].values()
    return np.reshape([_at(path, t_s) for path in paths if _lives(path, t_s)], (-1, 2))


def _free_node(grid: Grid, point_m: FloatArray) -> Node:
    node = grid.node_of((float(point_m[0]), float(point_m[1])))
    return nearest_free(grid, node) or node if grid.blocked[node] else node


def _lives(path: Path, t_s: float) -> bool:
    return bool(path.t_s[0] <= t_s <= path.t_s[-1])


def _at(path: Path, t_s: float) -> FloatArray:
    return np.array([np.interp(t_s, path.t_s, path.points_m[:, axis]) for axis in (0, 1)])
