"""Was the mission a success? A run's effects held against the truth of a simulated world.

Central command decides from measurements; the judge alone knows the truth. It is fed with everything that
came out of a run and gives a `Summary`:

- OSPA (Schuhmacher, Vo & Vo 2008; c = 100 m, p = 1) of both trackers at each scan: tracks in the
  MAP-cardinality estimate against what is alive in truth at the scan's time.
- Each agent's fate as command saw it. Arrived is final: an agent that dies at its target has done its work.
- ``complete`` when the mission ended and the truth agrees:

  1. no agent is left flying;
  2. each agent that command calls arrived was alive, and within the capture radius plus 25 m of a living
     target, when it was called so or at most two seconds before (the allowance covers the errors of tracks
     and sensor; the time, that an arrival is called at the second scan in a row);
  3. arrivals are at distinct targets: agents and targets are paired within that distance so that the sum of
     distances is least, which is each agent's nearest target unless two agents share it;
  4. agents that command calls dead are dead.

Times are those of the records; between two scans the truth is interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal

import msgspec
import numpy as np
from scipy.optimize import linear_sum_assignment

from gcs.config import Config
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Effect,
    FloatArray,
    Kind,
    MissionEnded,
    Picture,
    Plan,
    Truth,
    TruthObject,
    UploadReport,
    read_only,
)
from gcs.report.run.triggers import causes_of
from gcs.report.run.truth import GroundTruth
from gcs.tracking.metrics import ospa

OSPA_CUTOFF_M = 100.0
OSPA_ORDER = 1.0
CAPTURE_ALLOWANCE_M = 25.0
ARRIVAL_DELAY_S = 2
"""An arrival is called at the second scan in a row: the agent may have died since the first."""


@dataclass(frozen=True, slots=True)
class AgentOutcome:
    """What became of one agent."""

    system_id: int
    fate: Literal["arrived", "dead", "flying"]
    target: int | None
    """The true target that it reached; None when it reached none."""


@dataclass(frozen=True, slots=True)
class Retask:
    """One plan that changed what vehicles were flying."""

    t_s: float
    """Since the start of the run."""
    vehicles: tuple[int, ...]
    """Those with a new route that had one before."""
    reason: str
    causes: tuple[str, ...]
    """Kinds of the reasons (`gcs.report.run.triggers`)."""


@dataclass(frozen=True, slots=True)
class OspaSeries:
    """OSPA of one tracker at each scan."""

    t_ns: tuple[int, ...]
    total_m: FloatArray
    """(n,)."""
    localisation_m: FloatArray
    """(n,) its part that comes of places; with the order 1 the two parts add up to the whole."""
    cardinality_m: FloatArray
    """(n,) its part that comes of the number."""
    true_count: tuple[int, ...]
    estimated_count: tuple[int, ...]

    @property
    def mean_m(self) -> float:
        """Mean over all scans; NaN when there were none."""
        return float(self.total_m.mean()) if self.total_m.size else math.nan


@dataclass(frozen=True, slots=True)
class Summary:
    """How a run went."""

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
    """Mission transfers that ended, well or not."""
    upload_failures: int
    ospa_agents_mean_m: float
    ospa_targets_mean_m: float
    death_delays_s: tuple[float, ...]
    """From each death in truth to its detection; deaths that were never detected are missing."""
    deaths: int
    """Agents that died in truth before they had arrived."""
    false_deaths: int
    """How often an agent was called dead while it was alive."""
    scan_ms_p99: float
    plan_ms_p99: float
    recording: str
    links: tuple[dict[str, Any], ...] = ()
    """Counters of the MAVLink links, where there were any."""


_NOT_IN_JSON = frozenset({"retask_list", "death_delays_s", "deaths", "false_deaths"})


def summary_json(summary: Summary) -> str:
    """Return a summary as one line of JSON; what could not be measured is null."""
    shown = {f.name: getattr(summary, f.name) for f in fields(summary) if f.name not in _NOT_IN_JSON}
    return msgspec.json.encode(shown).decode()


def judge_of(config: Config) -> Evaluator:
    """Return the judge of a mission."""
    agents = [agent.vehicle for agent in config.agents]
    return Evaluator(config.planning.capture_radius_m, agents, config.agents_per_target)


class Evaluator:
    """Keeps what a verdict needs.

    Parameters
    ----------
    capture_radius_m : float
        Distance at which command calls an agent arrived.
    agents : sequence of int
        System ids of all agents of the mission.
    agents_per_target : int
        How many of them may end at one target.
    """

    def __init__(self, capture_radius_m: float, agents: Sequence[int], agents_per_target: int = 1) -> None:
        self._per_target = agents_per_target
        self._reach_m = capture_radius_m + CAPTURE_ALLOWANCE_M
        self._agents = tuple(agents)
        self._truths = GroundTruth()
        self._estimates: dict[tuple[Kind, int], FloatArray] = {}
        self._fates: list[AgentStatus] = []
        self._plans: list[Plan] = []
        self._uploads: list[UploadReport] = []
        self._ended: MissionEnded | None = None

    def truth(self, truth: Truth) -> None:
        """Take the truth at one scan; in any order."""
        self._truths.add(truth)

    def effect(self, effect: Effect) -> None:
        """Take what came out of the fold, in its order; what says nothing about success is passed over."""
        match effect:
            case Picture():
                confirmed = [track.mean[:2] for track in effect.tracks if track.estimated]
                self._estimates[effect.kind, effect.scan_t_ns] = read_only(np.reshape(confirmed, (-1, 2)))
            case AgentStatus():
                self._fates.append(effect)
            case Plan():
                self._plans.append(effect)
            case UploadReport():
                self._uploads.append(effect)
            case MissionEnded():
                self._ended = effect

    def ospa(self, kind: Kind) -> OspaSeries:
        """OSPA at each scan for which both a picture and the truth are known."""
        times = [t_ns for t_ns in self._truths.times_ns if (kind, t_ns) in self._estimates]
        scores, true_counts, estimated_counts = [], [], []
        for t_ns in times:
            estimates, truth = self._estimates[kind, t_ns], self._truths.positions(t_ns, kind)
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
        """Plans that changed the route of a vehicle which had one."""
        found, tasked = [], set[int]()
        start_t_ns = self._start_t_ns()
        for plan in self._plans:
            vehicles = tuple(vehicle for vehicle in plan.changed if vehicle in tasked)
            if vehicles:
                found.append(
                    Retask((plan.t_ns - start_t_ns) / NS_PER_S, vehicles, plan.reason, causes_of(plan))
                )
            tasked.update(route.vehicle for route in plan.routes)
        return tuple(found)

    def final_fates(self) -> dict[int, AgentStatus]:
        """The last fate of each agent, where arrived is final."""
        final = {vehicle: AgentStatus(0, vehicle, "flying") for vehicle in self._agents}
        for fate in self._fates:
            if fate.vehicle in final and final[fate.vehicle].fate != "arrived":
                final[fate.vehicle] = fate
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
        """Judge what was taken so far."""
        fates = self.final_fates()
        reached = self._reached_targets(fates)
        problems = self._problems(fates, reached)
        retasks = self.retasks()
        delays, deaths = self._death_delays(fates)
        return Summary(
            scenario=scenario,
            seed=seed,
            outcome="incomplete" if problems else "complete",
            reason="; ".join(problems) or _success(fates, reached),
            duration_s=duration_s,
            agents=tuple(AgentOutcome(v, f.fate, reached.get(v)) for v, f in fates.items()),
            targets_total=len(self._truths.targets()),
            targets_reached=len(set(reached.values())),
            retasks=len(retasks),
            retask_list=retasks,
            uploads=len(self._uploads),
            upload_failures=sum(not upload.ok for upload in self._uploads),
            ospa_agents_mean_m=self.ospa("agents").mean_m,
            ospa_targets_mean_m=self.ospa("targets").mean_m,
            death_delays_s=delays,
            deaths=deaths,
            false_deaths=self._false_deaths(),
            scan_ms_p99=scan_ms_p99,
            plan_ms_p99=plan_ms_p99,
            recording=recording,
        )

    def _problems(self, fates: dict[int, AgentStatus], reached: dict[int, int]) -> list[str]:
        """Everything that speaks against "complete", in words."""
        spare = () if self._ended is None else self._ended.spare
        flying = [v for v, fate in fates.items() if fate.fate == "flying" and v not in spare]
        problems = []
        if self._ended is None:
            problems.append(
                "the mission did not end" + (f": {_names(flying)} still flying" if flying else "")
            )
        elif flying:
            problems.append(f"the mission ended with {_names(flying)} still flying")
        if not self._truths.times_ns:
            return [*problems, "there is no truth to judge by"]
        for vehicle, fate in fates.items():
            if fate.fate == "arrived" and vehicle not in reached:
                problems.append(self._why_not_arrived(vehicle, fate, reached))
        alive = {thing.id for thing in self._last_truth() if thing.kind == "agents" and thing.alive}
        lost = [vehicle for vehicle, fate in fates.items() if fate.fate == "dead" and vehicle in alive]
        if lost:
            problems.append(f"{_names(lost)} called dead but alive")
        if fates and not problems and all(fate.fate == "dead" for fate in fates.values()):
            problems.append("failed: all agents were lost")
        return problems

    def _reached_targets(self, fates: dict[int, AgentStatus]) -> dict[int, int]:
        """True target of each agent whose arrival the truth confirms."""
        arrived = [vehicle for vehicle, fate in fates.items() if fate.fate == "arrived"]
        targets = [target for target in sorted(self._truths.targets()) for _ in range(self._per_target)]
        if not arrived or not targets:
            return {}
        distances = np.full((len(arrived), len(targets)), math.inf)
        for row, vehicle in enumerate(arrived):
            for target, distance_m in self._target_distances(vehicle, fates[vehicle].t_ns).items():
                first = targets.index(target)
                distances[row, first : first + self._per_target] = distance_m
        possible = distances <= self._reach_m
        impossible_m = self._reach_m * (len(arrived) + 1)
        rows, columns = linear_sum_assignment(np.where(possible, distances, impossible_m))
        return {arrived[r]: targets[c] for r, c in zip(rows, columns, strict=True) if possible[r, c]}

    def _target_distances(self, vehicle: int, t_ns: int) -> dict[int, float]:
        """Distance of an agent to each living target when it last lived; empty when it was dead too long."""
        for back_s in range(ARRIVAL_DELAY_S + 1):
            things = self._truths.at(t_ns - back_s * NS_PER_S)
            agent = next((t for t in things if t.kind == "agents" and t.id == vehicle and t.alive), None)
            if agent is not None:
                return {
                    t.id: math.hypot(t.east_m - agent.east_m, t.north_m - agent.north_m)
                    for t in things
                    if t.kind == "targets" and t.alive
                }
        return {}

    def _why_not_arrived(self, vehicle: int, fate: AgentStatus, reached: dict[int, int]) -> str:
        distances = self._target_distances(vehicle, fate.t_ns)
        if not distances:
            return f"agent {vehicle} called arrived but dead, or without any target"
        target = min(distances, key=lambda one: distances[one])
        if distances[target] > self._reach_m:
            return f"agent {vehicle} called arrived {distances[target]:.0f} m from the nearest target"
        other = next((v for v, t in reached.items() if t == target), None)
        return f"agent {vehicle} called arrived at target {target}, where agent {other} had arrived"

    def _death_delays(self, fates: dict[int, AgentStatus]) -> tuple[tuple[float, ...], int]:
        """Delay of each detected death, and the number of deaths of agents that had not arrived."""
        delays, deaths = [], 0
        for vehicle, died_t_ns in self._truths.deaths(self._agents).items():
            final = fates[vehicle]
            if final.fate == "arrived" and final.t_ns <= died_t_ns:
                continue
            deaths += 1
            called = [fate.t_ns for fate in self._fates if fate.vehicle == vehicle and fate.fate == "dead"]
            later = [t_ns for t_ns in called if t_ns >= died_t_ns]
            if later:
                delays.append((later[0] - died_t_ns) / NS_PER_S)
            elif final.fate == "dead":
                delays.append(0.0)  # called dead just before it was
        return tuple(delays), deaths

    def _false_deaths(self) -> int:
        count = 0
        for fate in self._fates:
            alive = {t.id for t in self._truths.at(fate.t_ns) if t.kind == "agents" and t.alive}
            count += fate.fate == "dead" and fate.vehicle in alive
        return count

    def _last_truth(self) -> tuple[TruthObject, ...]:
        """Return the truth when the mission ended, or the last one known."""
        return self._truths.at(self._ended.t_ns if self._ended is not None else self._truths.times_ns[-1])

    def _start_t_ns(self) -> int:
        times = [
            *self._truths.times_ns,
            *(t_ns for _, t_ns in self._estimates),
            *(plan.t_ns for plan in self._plans),
        ]
        return min(times, default=0)


def _names(vehicles: Sequence[int]) -> str:
    word = "agent" if len(vehicles) == 1 else "agents"
    return f"{word} {', '.join(str(vehicle) for vehicle in vehicles)}"


def _success(fates: dict[int, AgentStatus], reached: dict[int, int]) -> str:
    dead = [vehicle for vehicle, fate in fates.items() if fate.fate == "dead"]
    distinct = " distinct" if len(set(reached.values())) == len(reached) else ""
    text = f"{len(reached)} of {len(fates)} agents arrived at{distinct} targets"
    return f"{text}, {_names(dead)} lost" if dead else text
