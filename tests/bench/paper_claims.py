"""Claims of the paper about its results, and measurements in runs of the same missions.

Hill, Thomas & Larson, "Autonomous Situational Awareness for Robotic Swarms in High-Risk Environments",
sections "Simulation Results" and "Conclusions". All numbers are measured on the runs; each verdict follows
from the rule of its claim.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

import numpy as np
from paper_measures import (
    NEAR_M,
    RE_ROUTED_WITHIN_S,
    Flown,
    astray,
    false_and_missed,
    handovers,
    metres_in_obstacles,
    speeds,
    spurious,
    waviness,
    wrong_kind,
)

from gcs.report.run.evaluation import Summary
from gcs.report.run.timeline import KINDS

Verdict: TypeAlias = Literal["holds", "holds in part", "does not hold", "not seen here", "differs by design"]

FIGURE_3, FIGURES_4_5, FIGURES_6_7, FIGURES_8_9 = (
    "deterministic",
    "prescribed",
    "random-obstacles",
    "random-targets",
)
SCENARIOS: Final = (FIGURE_3, FIGURES_4_5, FIGURES_6_7, FIGURES_8_9)
_CLUTTERED: Final = (FIGURES_4_5, FIGURES_6_7, FIGURES_8_9)
_RANDOM: Final = (FIGURES_6_7, FIGURES_8_9)
_TRACKED_OSPA_M: Final = 10.0
_RIGHT_PERCENT: Final = 95.0


@dataclass(frozen=True, slots=True)
class Claim:
    """One sentence of the paper, and its verdict."""

    where: str
    says: str
    seen: str
    rule: str
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Runs:
    """Runs to check the claims."""

    flown: Mapping[str, Flown]
    """By scenario."""
    faster: Flown | None = None
    """Mission of Figures 4 and 5, planned every second instead of every five seconds."""
    swarm: Summary | None = None
    """Mission of fifty agents and sixty targets."""


def claims(runs: Runs) -> tuple[Claim, ...]:
    """Check every claim."""
    found = [
        _functional(runs.flown[FIGURE_3]),
        _handed_over(runs),
        _tracks(runs),
        _two_filters(runs),
        *([_wavy(runs.flown[FIGURES_4_5], runs.faster)] if runs.faster is not None else []),
        _revived(runs),
        _robust(runs),
        _dense(runs),
        _completes(runs),
        _altered(runs),
        _not_misled(runs),
        _ends(runs),
        _slower_targets(runs),
        *([_burdensome(runs, runs.swarm)] if runs.swarm is not None else []),
        _one_way(runs),
    ]
    return tuple(found)


def _functional(flown: Flown) -> Claim:
    summary, inside_m = flown.summary, metres_in_obstacles(flown)
    good = summary.outcome == "complete" and inside_m == 0.0
    return Claim(
        "Figure 3",
        "With everything known, four agents reach four targets in dense obstacles: dynamics and initial "
        "planning work.",
        f"{summary.targets_reached} of {summary.targets_total} targets reached in "
        f"{summary.duration_s:.0f} s, {summary.retasks} re-tasks, {inside_m:.0f} m flown inside obstacle "
        "cells.",
        "complete, and no agent inside an obstacle",
        "holds" if good else "holds in part" if summary.outcome == "complete" else "does not hold",
    )


def _handed_over(runs: Runs) -> Claim:
    parts, losses, replaced, nearer = [], 0, 0, 0
    for name in _CLUTTERED:
        flown = runs.flown[name]
        losses += flown.summary.losses
        found = {one.lost: one for one in handovers(flown)}
        replaced += len(found)
        for lost, path in flown.timeline.paths["agents"].items():
            one = found.get(lost)
            if one is not None:
                nearer += math.isnan(one.former_m) or one.new_m <= one.former_m
                parts.append(
                    f"{name}: agent {lost} is lost, {one.after_s:.1f} s later agent {one.successor} is sent "
                    f"to its target, {one.new_m:.0f} m away in a straight line (former target: "
                    f"{one.former_m:.0f} m)"
                )
            elif path.is_lost:
                within = f"within {RE_ROUTED_WITHIN_S:.0f} s"
                parts.append(f"{name}: agent {lost} is lost, no agent is sent to its target {within}")
    return Claim(
        "Figures 4, 5",
        "When an agent is disabled, another is re-routed to its target, which is now the closest to it.",
        "; ".join(parts)
        + ". With more targets than agents, the assignment by the least total way around the "
        "obstacles decides which ones are left out.",
        "after every loss a survivor gets the target, nearer than its former one; in part after some",
        "does not hold" if not replaced else "holds" if replaced == nearer == losses else "holds in part",
    )


def _tracks(runs: Runs) -> Claim:
    parts, good = [], True
    for name in _CLUTTERED:
        for kind in KINDS:
            series = runs.flown[name].timeline.ospa[kind]
            right = 100.0 * float(np.mean(np.equal(series.true_count, series.estimated_count)))
            good &= series.mean_m < _TRACKED_OSPA_M and right >= _RIGHT_PERCENT
            parts.append(f"{name}, {kind}: {series.mean_m:.2f} m, number right in {right:.1f} % of scans")
    return Claim(
        "Figures 5, 7, 9",
        "The GLMB filters track the states of agents and targets.",
        "Mean OSPA (c = 100 m, p = 1). " + "; ".join(parts) + ".",
        f"everywhere OSPA below {_TRACKED_OSPA_M:.0f} m, and the number right in {_RIGHT_PERCENT:.0f} % of "
        "scans",
        "holds" if good else "holds in part",
    )


def _two_filters(runs: Runs) -> Claim:
    counts = [wrong_kind(runs.flown[name]) for name in _CLUTTERED]
    mixed = sum(map(sum, counts))
    total = sum(false_and_missed(runs.flown[name])[0] for name in _CLUTTERED)
    return Claim(
        "Technical approach",
        "Two filters need not be told which measurement is of an agent and which of a target: the other kind "
        "is clutter to each.",
        f"{mixed} of {total} estimates were of an object of the other kind.",
        "none",
        "holds" if mixed == 0 else "holds in part",
    )


def _wavy(slow: Flown, fast: Flown) -> Claim:
    (slow_ratio, slow_turn), (fast_ratio, fast_turn) = waviness(slow), waviness(fast)
    return Claim(
        "Figures 4, 5",
        "Agents' paths are wavy because A* runs at 0.2 Hz; a higher rate makes them smoother.",
        f"Way flown over the shortest on the grid, and turning: {slow_ratio:.3f} and {slow_turn:.0f}°/km at "
        f"0.2 Hz, {fast_ratio:.3f} and {fast_turn:.0f}°/km at 1 Hz. Routes are pulled straight between "
        "obstacles and renewed only when a target has moved.",
        "at least a tenth less turning at 1 Hz",
        "holds" if fast_turn < 0.9 * slow_turn else "does not hold",
    )


def _revived(runs: Runs) -> Claim:
    counts = {name: spurious(runs.flown[name]) for name in _CLUTTERED}
    again, longest = sum(c[0] for c in counts.values()), max(c[1] for c in counts.values())
    losses = sum(flown.summary.losses for flown in runs.flown.values())
    waiting = max(c[2] for c in counts.values())
    return Claim(
        "Figures 5, 7",
        "Clutter near a lost agent is now and then taken for it: a single spurious state, for one time step.",
        f"{again} such states after {losses} losses, the longest for {longest} scans. A lost agent stayed in "
        f"the estimate for {waiting} scans at most.",
        "holds if there are some, none longer than a scan; not seen if there are none",
        "not seen here" if again == 0 else "holds" if longest <= 1 else "does not hold",
    )


def _robust(runs: Runs) -> Claim:
    parts, wrong = [], 0
    for name in _CLUTTERED:
        estimates, false, missed = false_and_missed(runs.flown[name])
        scans = runs.flown[name].timeline.ospa["agents"].t_ns
        clutter = len(runs.flown[name].timeline.clutter_m) * runs.flown[name].timeline.every
        wrong += false + missed
        parts.append(
            f"{name}: {clutter / max(1, len(scans)):.0f} false detections a scan, {false} of {estimates} "
            f"estimates false, {missed} objects missed"
        )
    total = sum(false_and_missed(runs.flown[name])[0] for name in _CLUTTERED)
    return Claim(
        "Figures 7, 9",
        "The GLMB is robust to very cluttered measurements and overlapping trajectories.",
        "; ".join(parts) + f" (farther than {NEAR_M:.0f} m from everything).",
        "less than 2 % of all estimates false or missing",
        "holds" if wrong < 0.02 * total else "holds in part",
    )


def _dense(runs: Runs) -> Claim:
    parts, worst_m = [], 0.0
    for name in _RANDOM:
        flown = runs.flown[name]
        share, inside_m = 100.0 * float(flown.grid.blocked.mean()), metres_in_obstacles(flown)
        worst_m = max(worst_m, inside_m)
        parts.append(
            f"{name}: {share:.1f} % of the nodes blocked, {flown.summary.outcome}, "
            f"{inside_m:.0f} m flown inside obstacle cells"
        )
    complete = all(runs.flown[name].summary.outcome == "complete" for name in _RANDOM)
    return Claim(
        "Figures 6, 7",
        "High obstacle density, with targets that move freely, is handled.",
        "; ".join(parts) + ".",
        "complete, and no agent inside an obstacle; in part when an agent cuts a cell",
        "does not hold" if not complete else "holds" if worst_m == 0.0 else "holds in part",
    )


def _completes(runs: Runs) -> Claim:
    parts = [
        f"{name}: {s.outcome}, {s.targets_reached} reached, {s.losses} of {len(s.agents)} agents lost"
        for name, s in ((name, flown.summary) for name, flown in runs.flown.items())
    ]
    complete = [flown.summary.outcome == "complete" for flown in runs.flown.values()]
    return Claim(
        "Figures 6 to 9",
        "Chaotic missions are completed: obstacles, clutter, agent loss, complicated targets.",
        "; ".join(parts) + ".",
        "every run complete, as the truth judges it",
        "holds" if all(complete) else "holds in part" if any(complete) else "does not hold",
    )


def _altered(runs: Runs) -> Claim:
    parts, good = [], True
    for name in _CLUTTERED:
        flown = runs.flown[name]
        counts = Counter(c for d in flown.timeline.decisions if d.changed for c in d.triggers)
        lost, moved = counts["agent lost"], counts["target moved"]
        good &= moved > 0 and (lost > 0) == (flown.summary.losses > 0)
        delays = flown.summary.loss_delays_s
        late = f", seen after {max(delays):.0f} s" if delays else ""
        parts.append(
            f"{name}: {lost} for {flown.summary.losses} losses{late}, {moved} for targets that moved, "
            f"{flown.summary.retasks} re-tasks in all"
        )
    return Claim(
        "Figures 4 to 9",
        "In each simulation the plan was altered to account for agent loss and target motion.",
        "Plans that gave new routes. " + "; ".join(parts) + ".",
        "each mission has some for targets that moved, and some for a loss when there was one",
        "holds" if good else "holds in part",
    )


def _not_misled(runs: Runs) -> Claim:
    counts = [astray(runs.flown[name]) for name in _CLUTTERED]
    routes, lost = sum(c[0] for c in counts), sum(c[1] for c in counts)
    false_losses = sum(flown.summary.false_losses for flown in runs.flown.values())
    return Claim(
        "Figures 4 to 9",
        "Measurement clutter was not allowed to affect the mission.",
        f"{lost} of {routes} new routes ended farther than {NEAR_M:.0f} m from where every living target "
        f"was or was heading; {false_losses} active agents were called lost.",
        "none of both",
        "holds" if lost == false_losses == 0 else "holds in part",
    )


def _ends(runs: Runs) -> Claim:
    flying = sum(a.status == "active" for flown in runs.flown.values() for a in flown.summary.agents)
    agents = sum(len(flown.summary.agents) for flown in runs.flown.values())
    return Claim(
        "Simulation description",
        "A mission ends once every agent has been disabled or has reached a target.",
        f"{flying} of {agents} agents were left flying.",
        "none",
        "holds" if flying == 0 else "does not hold",
    )


def _slower_targets(runs: Runs) -> Claim:
    pairs = {name: speeds(runs.flown[name]) for name in _CLUTTERED}
    parts = [f"{name}: {target:.1f} of {agent:.1f} m/s" for name, (agent, target) in pairs.items()]
    most = max(target / agent for agent, target in pairs.values())
    return Claim(
        "Conclusions",
        "Targets move at about half the agents' speed at most; faster ones could outrun them.",
        f"Fastest target and agents: {'; '.join(parts)}. Faster targets are not part of these missions.",
        "no target faster than 0.6 of the agents' speed",
        "holds" if most <= 0.6 else "holds in part",
    )


def _burdensome(runs: Runs, swarm: Summary) -> Claim:
    small = max(flown.summary.scan_ms_p99 for flown in runs.flown.values())
    return Claim(
        "Conclusions",
        "Any number of agents is possible, but the GLMB and O(n²) A* runs become burdensome on consumer "
        "hardware.",
        f"With 4 agents a scan takes {small:.1f} ms at the 99th percentile. With {len(swarm.agents)} agents "
        f"and {swarm.targets_total} targets: {swarm.scan_ms_p99:.0f} ms, a plan {swarm.plan_ms_p99:.0f} ms, "
        f"of the 1,000 and 5,000 ms there are; OSPA {swarm.ospa_agents_mean_m:.2f} / "
        f"{swarm.ospa_targets_mean_m:.2f} m.",
        "burdensome above half of the time there is, in CPU time",
        "holds" if swarm.scan_ms_p99 > 500.0 or swarm.plan_ms_p99 > 2500.0 else "does not hold",
    )


def _one_way(runs: Runs) -> Claim:
    uploads = sum(flown.summary.uploads for flown in runs.flown.values())
    failed = sum(flown.summary.upload_failures for flown in runs.flown.values())
    return Claim(
        "Introduction",
        "Central command works purely through measurements, without two-way communication.",
        f"Here agents also report over MAVLink, and a mission counts only when it was read back equal: "
        f"{uploads} transfers, {failed} failed.",
        "",
        "differs by design",
    )


def markdown(found: Sequence[Claim]) -> str:
    """Return the claims as a table in Markdown."""
    lines = ["| in the paper | it says | seen here | rule | verdict |", "|---|---|---|---|---|"]
    lines += [f"| {c.where} | {c.says} | {c.seen} | {c.rule} | **{c.verdict}** |" for c in found]
    return "\n".join(lines) + "\n"
