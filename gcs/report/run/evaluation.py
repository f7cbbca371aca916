"""Evaluation of a run against ground truth: arrivals, losses, OSPA, with their tolerances.

Central command decides from measurements. The evaluator alone knows the ground truth. It gets all effects of
a run and returns a `Summary`:

- OSPA (Schuhmacher, Vo & Vo 2008; c = 100 m, p = 1) of both trackers at each scan: estimated tracks against
  living objects at the time of the scan.
- The status of each agent as central command saw it. "arrived" is final, even if the agent is lost later.
- ``complete`` if the mission ended and the ground truth agrees:

  1. no agent is left flying;
  2. each arrived agent was alive and within the capture radius plus 25 m of a living target at the time of
     the status, or up to two seconds before. The distance allows for the errors of tracks and sensors, the
     time for an arrival that needs two scans in a row;
  3. arrivals are at distinct targets: agents and targets are paired within that distance for the least sum
     of distances;
  4. agents with the status "lost" are lost, or came down.

Times are those of the records. Ground truth is interpolated between scans.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal

import msgspec
import numpy as np
from scipy.optimize import linear_sum_assignment

from gcs.config import Config
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Cause,
    Effect,
    FloatArray,
    Kind,
    LaggedPicture,
    MissionEnded,
    Picture,
    Plan,
    Truth,
    TruthObject,
    UploadReport,
    read_only,
)
from gcs.report.run.truth import GroundTruth
from gcs.tracking.metrics import ospa

OSPA_CUTOFF_M = 100.0
OSPA_ORDER = 1.0
CAPTURE_ALLOWANCE_M = 25.0
ARRIVAL_DELAY_S = 2
"""An arrival needs two scans in a row; the agent may have been lost since the first."""


@dataclass(frozen=True, slots=True)
class AgentOutcome:
    """Outcome of one agent."""

    system_id: int
    status: Literal["active", "arrived", "lost", "down"]
    target: int | None
    """True target that the agent reached; None without one."""


@dataclass(frozen=True, slots=True)
class Retask:
    """A plan that changed the routes of vehicles in flight."""

    t_s: float
    """Since the start of the run."""
    vehicles: tuple[int, ...]
    """Vehicles with a new route that had one before."""
    reason: str
    triggers: tuple[Cause, ...]


@dataclass(frozen=True, slots=True)
class OspaSeries:
    """OSPA of one tracker at each scan."""

    t_ns: tuple[int, ...]
    total_m: FloatArray
    """(n,)."""
    localisation_m: FloatArray
    """(n,) localisation part. With the order 1 the two parts add up to the total."""
    cardinality_m: FloatArray
    """(n,) cardinality part."""
    true_count: tuple[int, ...]
    estimated_count: tuple[int, ...]

    @property
    def mean_m(self) -> float:
        """Mean over all scans; NaN without scans."""
        return float(self.total_m.mean()) if self.total_m.size else math.nan


@dataclass(frozen=True, slots=True)
class Summary:
    """Result of a run."""

    scenario: str
    seed: int
    outcome: Literal["complete", "incomplete"]
    reason: str
    duration_s: float
    agents: tuple[AgentOutcome, ...]
    targets_total: int
    targets_reached: int
    retasks: int
    retask_list: tuple[Retask, ...]
    uploads: int
    """Mission transfers that ended, verified or failed."""
    upload_failures: int
    ospa_agents_mean_m: float
    ospa_targets_mean_m: float
    loss_delays_s: tuple[float, ...]
    """Delay from each true loss to its detection; undetected losses are missing."""
    losses: int
    """Agents that were lost before they arrived."""
    false_losses: int
    """Number of times an agent got the status "lost" while it was alive."""
    scan_ms_p99: float
    plan_ms_p99: float
    recording: str
    links: tuple[dict[str, Any], ...] = ()
    """Counters of the MAVLink links, if any."""


_NOT_IN_JSON = frozenset({"retask_list", "loss_delays_s", "losses", "false_losses"})


def summary_json(summary: Summary) -> str:
    """Return a summary as one line of JSON; null for values that were not measured."""
    shown = {f.name: getattr(summary, f.name) for f in fields(summary) if f.name not in _NOT_IN_JSON}
    return msgspec.json.encode(shown).decode()


def evaluator_of(config: Config) -> Evaluator:
    """Return the evaluator of a mission."""
    agents = [agent.vehicle for agent in config.agents]
    return Evaluator(config.planning.capture_radius_m, agents, config.agents_per_target)


def _estimated_m(picture: Picture | LaggedPicture) -> FloatArray:
    """Return the estimated positions, (n, 2)."""
    estimated = [track.mean[:2] for track in picture.tracks if track.estimated]
    return read_only(np.reshape(estimated, (-1, 2)))


class Evaluator:
    """Collects a run and evaluates it.

    Parameters
    ----------
    capture_radius_m : float
        Distance at which an agent counts as arrived.
    agents : sequence of int
        System ids of all agents of the mission.
    agents_per_target : int
        Number of agents that may end at one target.
    """

    def __init__(self, capture_radius_m: float, agents: Sequence[int], agents_per_target: int = 1) -> None:
        self._per_target = agents_per_target
        self._reach_m = capture_radius_m + CAPTURE_ALLOWANCE_M
        self._agents = tuple(agents)
        self._ground_truth = GroundTruth()
        self._estimates: dict[tuple[Kind, int], FloatArray] = {}
        self._late_estimates: dict[tuple[Kind, int], FloatArray] = {}
        self._statuses: list[AgentStatus] = []
        self._plans: list[Plan] = []
        self._uploads: list[UploadReport] = []
        self._ended: MissionEnded | None = None
        self._late: set[int] = set()

    def add_truth(self, truth: Truth) -> None:
        """Add the ground truth at one scan, in any order."""
        self._ground_truth.add(truth)
        self._late.update(truth.late)

    def add_effect(self, effect: Effect) -> None:
        """Add an effect of the engine, in order; others than those evaluated are ignored."""
        match effect:
            case Picture():
                self._estimates[effect.kind, effect.scan_t_ns] = _estimated_m(effect)
            case LaggedPicture():
                self._late_estimates[effect.kind, effect.scan_t_ns] = _estimated_m(effect)
            case AgentStatus():
                self._statuses.append(effect)
            case Plan():
                self._plans.append(effect)
            case UploadReport():
                self._uploads.append(effect)
            case MissionEnded():
                self._ended = effect

    def ospa(self, kind: Kind) -> OspaSeries:
        """Return the OSPA at each scan with both a picture and ground truth."""
        return self._ospa(kind, self._estimates)

    def late_ospa(self, kind: Kind) -> OspaSeries:
        """Return the OSPA of the estimates some scans late (`tracking.lag_scans`)."""
        return self._ospa(kind, self._late_estimates)

    def _ospa(self, kind: Kind, found: Mapping[tuple[Kind, int], FloatArray]) -> OspaSeries:
        times = [t_ns for t_ns in self._ground_truth.times_ns if (kind, t_ns) in found]
        scores = []
        true_counts = []
        estimated_counts = []
        for t_ns in times:
            estimates = found[kind, t_ns]
            truth = self._ground_truth.positions(t_ns, kind)
            scores.append(ospa(truth, estimates, OSPA_CUTOFF_M, OSPA_ORDER))
            true_counts.append(len(truth))
            estimated_counts.append(len(estimates))
        return OspaSeries(
            tuple(times),
            read_only([score.total_m for score in scores]),
            read_only([score.localisation_m for score in scores]),
            read_only([score.cardinality_m for score in scores]),
            tuple(true_counts),
            tuple(estimated_counts),
        )

    def retasks(self) -> tuple[Retask, ...]:
        """Return the plans that changed the route of a vehicle which had one."""
        found = []
        tasked = set[int]()
        start_t_ns = self._start_t_ns()
        for plan in self._plans:
            vehicles = tuple(vehicle for vehicle in plan.changed if vehicle in tasked)
            if vehicles:
                found.append(Retask((plan.t_ns - start_t_ns) / NS_PER_S, vehicles, plan.reason, plan.causes))
            tasked.update(route.vehicle for route in plan.routes)
        return tuple(found)

    def final_statuses(self) -> dict[int, AgentStatus]:
        """Return the last status of each agent; "arrived" is final."""
        final = {vehicle: AgentStatus(0, vehicle, "active") for vehicle in self._agents}
        for change in self._statuses:
            if change.vehicle in final and final[change.vehicle].status != "arrived":
                final[change.vehicle] = change
        return final

    def summary(
        self,
        *,
        scenario: str,
        seed: int,
        duration_s: float,
        scan_ms_p99: float,
        plan_ms_p99: float,
        recording: str,
    ) -> Summary:
        """Evaluate the run so far."""
        statuses = self.final_statuses()
        reached = self._reached_targets(statuses)
        problems = self._problems(statuses, reached)
        if problems and self._late:
            problems.insert(0, too_slow_text(self._late))
        retasks = self.retasks()
        delays, losses = self._loss_delays(statuses)
        return Summary(
            scenario=scenario,
            seed=seed,
            outcome="incomplete" if problems else "complete",
            reason="; ".join(problems) or _success(statuses, reached),
            duration_s=duration_s,
            agents=tuple(AgentOutcome(v, f.status, reached.get(v)) for v, f in statuses.items()),
            targets_total=len(self._ground_truth.targets()),
            targets_reached=len(set(reached.values())),
            retasks=len(retasks),
            retask_list=retasks,
            uploads=len(self._uploads),
            upload_failures=sum(not upload.ok for upload in self._uploads),
            ospa_agents_mean_m=self.ospa("agents").mean_m,
            ospa_targets_mean_m=self.ospa("targets").mean_m,
            loss_delays_s=delays,
            losses=losses,
            false_losses=self._false_losses(),
            scan_ms_p99=scan_ms_p99,
            plan_ms_p99=plan_ms_p99,
            recording=recording,
        )

    def _problems(self, statuses: dict[int, AgentStatus], reached: dict[int, int]) -> list[str]:
        """Return what contradicts "complete", as texts."""
        spare = () if self._ended is None else self._ended.surplus
        flying = [v for v, change in statuses.items() if change.status == "active" and v not in spare]
        problems = []
        if self._ended is None:
            problems.append(
                "the mission did not end" + (f": {_names(flying)} still flying" if flying else "")
            )
        elif flying:
            problems.append(f"the mission ended with {_names(flying)} still flying")
        if not self._ground_truth.times_ns:
            return [*problems, "there is no ground truth"]
        for vehicle, change in statuses.items():
            if change.status == "arrived" and vehicle not in reached:
                problems.append(self._why_not_arrived(vehicle, change, reached))
        agents = [thing for thing in self._last_truth() if thing.kind == "agents"]
        alive = {thing.id for thing in agents if thing.alive and not thing.down}
        lost = [v for v, change in statuses.items() if change.status == "lost" and v in alive]
        if lost:
            problems.append(f"{_names(lost)} called lost but alive")
        gone = [change for change in statuses.values() if change.status in ("lost", "down")]
        if statuses and not problems and len(gone) == len(statuses):
            problems.append("failed: all agents were lost")
        return problems

    def _reached_targets(self, statuses: dict[int, AgentStatus]) -> dict[int, int]:
        """Return the true target of each agent whose arrival the ground truth confirms."""
        arrived = [vehicle for vehicle, change in statuses.items() if change.status == "arrived"]
        targets = [target for target in sorted(self._ground_truth.targets()) for _ in range(self._per_target)]
        if not arrived or not targets:
            return {}
        distances = np.full((len(arrived), len(targets)), math.inf)
        for row, vehicle in enumerate(arrived):
            for target, distance_m in self._target_distances(vehicle, statuses[vehicle].t_ns).items():
                first = targets.index(target)
                distances[row, first : first + self._per_target] = distance_m
        possible = distances <= self._reach_m
        impossible_m = self._reach_m * (len(arrived) + 1)
        rows, columns = linear_sum_assignment(np.where(possible, distances, impossible_m))
        return {arrived[r]: targets[c] for r, c in zip(rows, columns, strict=True) if possible[r, c]}

    def _target_distances(self, vehicle: int, t_ns: int) -> dict[int, float]:
        """Return the distance of an agent to each living target when last alive; empty if lost too long."""
        for back_s in range(ARRIVAL_DELAY_S + 1):
            things = self._ground_truth.at(t_ns - back_s * NS_PER_S)
            agent = next((t for t in things if t.kind == "agents" and t.id == vehicle and t.alive), None)
            if agent is not None:
                return {
                    t.id: math.hypot(t.east_m - agent.east_m, t.north_m - agent.north_m)
                    for t in things
                    if t.kind == "targets" and t.alive
                }
        return {}

    def _why_not_arrived(self, vehicle: int, change: AgentStatus, reached: dict[int, int]) -> str:
        distances = self._target_distances(vehicle, change.t_ns)
        if not distances:
            return f"agent {vehicle} called arrived but lost, or without any target"
        target = min(distances, key=lambda one: distances[one])
        if distances[target] > self._reach_m:
            return f"agent {vehicle} called arrived {distances[target]:.0f} m from the nearest target"
        other = next((v for v, t in reached.items() if t == target), None)
        return f"agent {vehicle} called arrived at target {target}, where agent {other} had arrived"

    def _loss_delays(self, statuses: dict[int, AgentStatus]) -> tuple[tuple[float, ...], int]:
        """Return the delay of each detected loss, and the number of losses before arrival."""
        delays = []
        losses = 0
        for vehicle, lost_t_ns in self._ground_truth.losses(self._agents).items():
            final = statuses[vehicle]
            if final.status == "arrived" and final.t_ns <= lost_t_ns:
                continue
            losses += 1
            of_vehicle = (change for change in self._statuses if change.vehicle == vehicle)
            detected_t_ns = [c.t_ns for c in of_vehicle if c.status == "lost" and c.t_ns >= lost_t_ns]
            if detected_t_ns:
                delays.append((detected_t_ns[0] - lost_t_ns) / NS_PER_S)
            elif final.status == "lost":
                delays.append(0.0)  # Detected shortly before the loss.
        return tuple(delays), losses

    def _false_losses(self) -> int:
        count = 0
        for change in self._statuses:
            agents = (t for t in self._ground_truth.at(change.t_ns) if t.kind == "agents")
            alive = {agent.id for agent in agents if agent.alive and not agent.down}
            count += change.status == "lost" and change.vehicle in alive
        return count

    def _last_truth(self) -> tuple[TruthObject, ...]:
        """Return the ground truth at the end of the mission, or the last one."""
        return self._ground_truth.at(
            self._ended.t_ns if self._ended is not None else self._ground_truth.times_ns[-1]
        )

    def _start_t_ns(self) -> int:
        times = [
            *self._ground_truth.times_ns,
            *(t_ns for _, t_ns in self._estimates),
            *(plan.t_ns for plan in self._plans),
        ]
        return min(times, default=0)


def too_slow_text(vehicles: Iterable[int]) -> str:
    """Return a warning about simulated vehicles that fell behind the clock."""
    behind = f"{_names(sorted(vehicles))} fell behind the clock"
    return f"this machine is too slow for the simulation: {behind}; a lower --speed would help"


def _names(vehicles: Sequence[int]) -> str:
    word = "agent" if len(vehicles) == 1 else "agents"
    return f"{word} {', '.join(str(vehicle) for vehicle in vehicles)}"


def _success(statuses: dict[int, AgentStatus], reached: dict[int, int]) -> str:
    lost = [vehicle for vehicle, change in statuses.items() if change.status == "lost"]
    distinct = " distinct" if len(set(reached.values())) == len(reached) else ""
    text = f"{len(reached)} of {len(statuses)} agents arrived at{distinct} targets"
    return f"{text}, {_names(lost)} lost" if lost else text
