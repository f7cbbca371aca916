"""Results of a campaign: missions, groups of missions with 95 % confidence intervals, and files.

Proportions have Wilson's interval, means Student's, rates of rare events the exact interval of a Poisson
count (Garwood 1936). Missions of one seed fly in the same world, so the time that the trackers cost is a
paired difference to the mission whose planner had the ground truth.
"""

from __future__ import annotations

import csv
import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec
import numpy as np
from scipy import stats

from gcs.errors import RecordingError
from gcs.report.run.evaluation import Summary
from sim_vehicles.campaign.loss_detection import LossWatch

CONFIDENCE = 0.95


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One mission."""

    digest: str
    """Digest of all that was flown: equal digests are the same mission."""
    scenario: str
    value: str
    """Value of the swept key; empty without a sweep."""
    planner: str
    """``own`` or ``truth``: the planner's input is the trackers' picture or the ground truth."""
    seed: int
    outcome: str
    reason: str
    duration_s: float
    agents: int
    arrived: int
    lost: int
    targets_total: int
    targets_reached: int
    losses_detected_after_s: list[float]
    false_losses: int
    revivals: int
    plain_losses_detected_after_s: list[float]
    plain_false_losses: int
    plain_revivals: int
    losses: int
    """Agents that were lost before they arrived."""
    agent_hours: float
    """Total flight time of agents until arrival or loss."""
    ospa_agents_m: float | None
    ospa_targets_m: float | None
    retasks: int
    uploads: int
    upload_failures: int

    @classmethod
    def of(cls, value: str, planner: str, digest: str, summary: Summary, losses: LossWatch) -> Row:
        """Make a row from the summary and the losses of a mission."""
        statuses = [agent.status for agent in summary.agents]
        ours = losses.ours()
        plain = losses.plain()
        return cls(
            digest=digest,
            scenario=summary.scenario,
            value=value,
            planner=planner,
            seed=summary.seed,
            outcome=summary.outcome,
            reason=summary.reason,
            duration_s=summary.duration_s,
            agents=len(statuses),
            arrived=statuses.count("arrived"),
            lost=statuses.count("lost"),
            targets_total=summary.targets_total,
            targets_reached=summary.targets_reached,
            losses_detected_after_s=list(ours.delays_s),
            false_losses=ours.false_losses,
            revivals=ours.revivals,
            plain_losses_detected_after_s=list(plain.delays_s),
            plain_false_losses=plain.false_losses,
            plain_revivals=plain.revivals,
            losses=losses.losses,
            agent_hours=losses.agent_hours,
            ospa_agents_m=_finite(summary.ospa_agents_mean_m),
            ospa_targets_m=_finite(summary.ospa_targets_mean_m),
            retasks=summary.retasks,
            uploads=summary.uploads,
            upload_failures=summary.upload_failures,
        )


class IntervalEstimate(msgspec.Struct, frozen=True):
    """A value with its 95 % confidence interval; NaN if not measured."""

    value: float
    low: float
    high: float


NOTHING = IntervalEstimate(math.nan, math.nan, math.nan)


class Group(msgspec.Struct, frozen=True, kw_only=True):
    """All missions with one scenario, value and planner."""

    scenario: str
    value: str
    planner: str
    missions: int
    success: IntervalEstimate
    """Share of complete missions."""
    duration_s: IntervalEstimate
    extra_time: IntervalEstimate
    """Relative additional time over the planner with ground truth, for seeds with both complete."""
    ospa_agents_m: IntervalEstimate
    ospa_targets_m: IntervalEstimate
    agent_hours: float
    losses: int
    losses_detected: int
    loss_detected_after_s: IntervalEstimate
    loss_detected_after_max_s: float
    false_losses_per_h: IntervalEstimate
    """For each hour of agent flight."""
    revivals: int
    plain_loss_detected_after_s: IntervalEstimate
    plain_false_losses_per_h: IntervalEstimate
    plain_revivals: int
    retasks: IntervalEstimate
    uploads: IntervalEstimate
    upload_failures: int


def proportion(successes: int, n: int) -> IntervalEstimate:
    """Return the share of successes with Wilson's interval."""
    if n == 0:
        return NOTHING
    interval = stats.binomtest(successes, n).proportion_ci(CONFIDENCE, method="wilson")
    return IntervalEstimate(successes / n, float(interval.low), float(interval.high))


def mean(values: Iterable[float | None], least: float = 0.0) -> IntervalEstimate:
    """Return the mean of values not below `least`, with Student's interval; no interval for one value."""
    known = np.array([value for value in values if value is not None and math.isfinite(value)])
    if known.size == 0:
        return NOTHING
    middle = float(known.mean())
    if known.size == 1:
        return IntervalEstimate(middle, math.nan, math.nan)
    half = stats.t.ppf(0.5 + CONFIDENCE / 2, known.size - 1) * known.std(ddof=1) / math.sqrt(known.size)
    return IntervalEstimate(middle, max(middle - float(half), least), middle + float(half))


def rate(count: int, exposure: float) -> IntervalEstimate:
    """Return events per unit of exposure, with the exact interval of a Poisson count."""
    if exposure <= 0.0:
        return NOTHING
    tail = (1.0 - CONFIDENCE) / 2
    low = stats.chi2.ppf(tail, 2 * count) / 2 if count else 0.0
    high = stats.chi2.ppf(1.0 - tail, 2 * count + 2) / 2
    return IntervalEstimate(count / exposure, float(low) / exposure, float(high) / exposure)


def groups(rows: Iterable[Row]) -> list[Group]:
    """Return the groups of a campaign, in order of first appearance."""
    found: dict[tuple[str, str, str], list[Row]] = defaultdict(list)
    for row in rows:
        found[row.scenario, row.value, row.planner].append(row)
    with_truth = {
        (scenario, value): {row.seed: row for row in some if row.outcome == "complete"}
        for (scenario, value, planner), some in found.items()
        if planner == "truth"
    }
    return [_group(some, with_truth.get(key[:2], {})) for key, some in found.items()]


def _group(rows: Sequence[Row], with_truth: dict[int, Row]) -> Group:
    first = rows[0]
    hours = sum(row.agent_hours for row in rows)
    delays = [delay for row in rows for delay in row.losses_detected_after_s]
    pairs = [
        (row.duration_s, with_truth[row.seed].duration_s)
        for row in rows
        if row.outcome == "complete" and row.seed in with_truth
    ]
    return Group(
        scenario=first.scenario,
        value=first.value,
        planner=first.planner,
        missions=len(rows),
        success=proportion(sum(row.outcome == "complete" for row in rows), len(rows)),
        duration_s=mean(row.duration_s for row in rows),
        extra_time=mean((own / best - 1.0 for own, best in pairs), least=-1.0),
        ospa_agents_m=mean(row.ospa_agents_m for row in rows),
        ospa_targets_m=mean(row.ospa_targets_m for row in rows),
        agent_hours=hours,
        losses=sum(row.losses for row in rows),
        losses_detected=len(delays),
        loss_detected_after_s=mean(delays),
        loss_detected_after_max_s=max(delays, default=math.nan),
        false_losses_per_h=rate(sum(row.false_losses for row in rows), hours),
        revivals=sum(row.revivals for row in rows),
        plain_loss_detected_after_s=mean(
            delay for row in rows for delay in row.plain_losses_detected_after_s
        ),
        plain_false_losses_per_h=rate(sum(row.plain_false_losses for row in rows), hours),
        plain_revivals=sum(row.plain_revivals for row in rows),
        retasks=mean(float(row.retasks) for row in rows),
        uploads=mean(float(row.uploads) for row in rows),
        upload_failures=sum(row.upload_failures for row in rows),
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def write_csv(rows: Sequence[Row], path: Path) -> None:
    """Write one row per mission; lists are joined by spaces.

    Raises
    ------
    RecordingError
        If the file cannot be written.
    """
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(Row.__struct_fields__)
            for row in rows:
                values = msgspec.to_builtins(row).values()
                writer.writerow([" ".join(map(str, v)) if isinstance(v, list) else v for v in values])
    except OSError as error:
        raise RecordingError(str(path), f"cannot be written: {error.strerror}") from None
