"""Report page of a campaign: figures, curves over the swept key, and failed missions.

Every value has its 95 % confidence interval (see `sim_vehicles.campaign.results`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from gcs.report.html_page import Fact, Page, Picture, Section, save_figure, save_page
from gcs.report.plots.style import AGENTS, heading, legend, new_figure, say, tidy
from gcs.report.run.tables import NONE, Table, number
from sim_vehicles.campaign.results import Group, IntervalEstimate, Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class Metric:
    """One value of a group."""

    field: str
    title: str
    """With its unit."""
    scale: float = 1.0
    digits: int = 1


METRICS: Final = (
    Metric("success", "complete, %", 100.0),
    Metric("duration_s", "mission, s"),
    Metric("extra_time", "extra time, %", 100.0),
    Metric("ospa_agents_m", "OSPA of agents, m", digits=2),
    Metric("ospa_targets_m", "OSPA of targets, m", digits=2),
    Metric("loss_detected_after_s", "losses detected after, s", digits=2),
    Metric("false_losses_per_h", "false losses per agent-hour", digits=2),
    Metric("retasks", "re-tasks"),
)
_PLAIN: Final = (
    ("central command", "loss_detected_after_s", "false_losses_per_h", "revivals"),
    ("plain threshold", "plain_loss_detected_after_s", "plain_false_losses_per_h", "plain_revivals"),
)


def metric_of(group: Group, metric: Metric) -> IntervalEstimate:
    """Return a value of a group in the unit of its title."""
    estimate: IntervalEstimate = getattr(group, metric.field)
    return IntervalEstimate(*(metric.scale * part for part in (estimate.value, estimate.low, estimate.high)))


def with_interval(estimate: IntervalEstimate, digits: int) -> str:
    """Return a value with its interval, such as ``2.0 (1.8–2.3)``."""
    if not math.isfinite(estimate.value):
        return NONE
    middle = number(estimate.value, digits)
    if not math.isfinite(estimate.low):
        return middle
    return f"{middle} ({number(estimate.low, digits)}–{number(estimate.high, digits)})"


def overviews(groups: Sequence[Group], key: str) -> list[Table]:
    """Return tables of all values: scenarios, or values of the swept key, side by side."""
    own = [group for group in groups if group.planner == "own"]
    best = {(group.scenario, group.value): group for group in groups if group.planner == "truth"}
    if not key:
        return [_overview("Figures", "", [(group.scenario, group) for group in own], best)]
    return [
        _overview(scenario, key, [(g.value, g) for g in own if g.scenario == scenario], best)
        for scenario in dict.fromkeys(group.scenario for group in own)
    ]


def _overview(
    title: str, key: str, named: Sequence[tuple[str, Group]], best: Mapping[tuple[str, str], Group]
) -> Table:
    rows: list[tuple[str, ...]] = [("missions", *(str(group.missions) for _, group in named))]
    rows += [(m.title, *(with_interval(metric_of(g, m), m.digits) for _, g in named)) for m in METRICS]
    if best:
        times = [best[g.scenario, g.value].duration_s for _, g in named]
        rows.insert(4, ("mission with ground truth, s", *(with_interval(time, 1) for time in times)))
    columns = (key, *(name for name, _ in named))
    return Table(title, columns, tuple(rows), frozenset({key}), "with 95 % confidence intervals")


def losses(groups: Sequence[Group], key: str) -> Table:
    """Return the detection of losses by central command's rule and by a plain threshold."""
    rows = []
    for group in groups:
        if group.planner != "own" or not group.losses:
            continue
        for rule, delay, false_losses, revivals in _PLAIN:
            rows.append((
                group.scenario, *([group.value] if key else []), rule, str(group.losses),
                with_interval(getattr(group, delay), 2), with_interval(getattr(group, false_losses), 2),
                str(getattr(group, revivals)),
            ))  # fmt: skip
    columns = (
        "scenario", *([key] if key else []), "rule", "losses", "detected after, s",
        "false losses per agent-hour", "lost agents active again",
    )  # fmt: skip
    note = "plain threshold: lost while the existence probability of the agent's track is below 0.5"
    return Table("Detection of losses", columns, tuple(rows), frozenset({"scenario", "rule"}), note)


def failures(rows: Sequence[Row], key: str) -> Table:
    """Return incomplete missions, and how to repeat them."""
    found = tuple(
        (row.scenario, *([row.value] if key else []), _planner(row.planner), str(row.seed), row.reason)
        for row in rows
        if row.outcome != "complete"
    )
    columns = ("scenario", *([key] if key else []), "input of the planner", "seed", "reason")
    return Table("Missions that were not complete", columns, found, frozenset({*columns} - {"seed"}))


def write_report(
    groups: Sequence[Group], rows: Sequence[Row], key: str, settings: Sequence[str], folder: Path
) -> Path:
    """Write ``report.html`` with its figures; return its path.

    Raises
    ------
    RecordingError
        If a file cannot be written.
    """
    own = [group for group in groups if group.planner == "own"]
    complete = sum(row.outcome == "complete" for row in rows if row.planner == "own")
    flown = sum(row.planner == "own" for row in rows)
    pictures = [_curves(groups, key, folder)] if key else []
    pictures.append(_times(rows, folder))
    page = Page(
        title="Campaign: " + ", ".join(dict.fromkeys(group.scenario for group in groups)),
        subtitle=f"{len(rows)} missions on virtual time" + (f", {key} varied" if key else ""),
        badge=f"{complete} of {flown} complete",
        good=complete == flown,
        lead="" if not settings else "Flown with " + ", ".join(settings) + ".",
        facts=_facts(own),
        sections=(
            Section("Figures", pictures=tuple(pictures), tables=tuple(overviews(groups, key))),
            Section("Losses", tables=(losses(groups, key),)),
            Section("Failures", tables=(failures(rows, key),)),
        ),
    )
    path = folder / "report.html"
    save_page(page, path)
    return path


def _facts(own: Sequence[Group]) -> tuple[Fact, ...]:
    """Return the worst value of all groups."""
    worst = {
        metric.field: max((metric_of(group, metric).value for group in own), default=math.nan)
        for metric in METRICS
    }
    least = min((100.0 * group.success.value for group in own), default=math.nan)
    return (
        Fact("complete, at least", number(least), "%"),
        Fact("extra time, at most", number(worst["extra_time"]), "%", "mean of a scenario"),
        Fact(
            "losses detected after, at most",
            number(worst["loss_detected_after_s"], 2),
            "s",
            "mean of a scenario",
        ),
        Fact("false losses", str(round(sum(_count(group) for group in own))), "", "in all missions"),
    )


def _count(group: Group) -> float:
    rate = group.false_losses_per_h
    return rate.value * group.agent_hours if math.isfinite(rate.value) else 0.0


def _curves(groups: Sequence[Group], key: str, folder: Path) -> Picture:
    """Draw every metric over the swept key, one line per scenario."""
    figure = new_figure(12, 6)
    panels: list[Axes] = list(figure.subplots(2, 4).flat)
    own = [group for group in groups if group.planner == "own"]
    values = list(dict.fromkeys(group.value for group in own))
    places = _places(values)
    for metric, axes in zip(METRICS, panels, strict=True):
        heading(axes, metric.title)
        for colour, scenario in zip(AGENTS, dict.fromkeys(g.scenario for g in own), strict=False):
            line = [(places[g.value], metric_of(g, metric)) for g in own if g.scenario == scenario]
            _line(axes, line, colour, scenario)
        if places != {value: float(index) for index, value in enumerate(values)}:
            axes.set_xlabel(key)
        else:
            axes.set_xticks(range(len(values)), values)
            axes.set_xlabel(key)
        tidy(axes)
        if not axes.containers:
            say(axes, "none in these missions")
    if len({group.scenario for group in own}) > 1:
        legend(panels[0])
    caption = f"Every figure over {key}, with its 95 % confidence interval."
    return save_figure(figure, folder, "curves", caption)


def _line(axes: Axes, line: Sequence[tuple[float, IntervalEstimate]], colour: str, scenario: str) -> None:
    known = [(x, e) for x, e in line if math.isfinite(e.value)]
    if not known:
        return
    x = np.array([place for place, _ in known])
    y = np.array([estimate.value for _, estimate in known])
    low = np.array([e.low if math.isfinite(e.low) else e.value for _, e in known])
    high = np.array([e.high if math.isfinite(e.high) else e.value for _, e in known])
    axes.errorbar(x, y, yerr=[np.maximum(y - low, 0.0), np.maximum(high - y, 0.0)], color=colour, marker="o",
                  ms=4, lw=1.5, capsize=3, label=scenario)  # fmt: skip


def _places(values: Sequence[str]) -> dict[str, float]:
    """Return positions on an axis: numbers at their value, texts in order."""
    try:
        return {value: float(value) for value in values}
    except ValueError:
        return {value: float(index) for index, value in enumerate(values)}


def _times(rows: Sequence[Row], folder: Path) -> Picture:
    """Draw mission times against those with ground truth for each seed, or their spread."""
    scenarios = list(dict.fromkeys(row.scenario for row in rows))
    figure = new_figure(12, 3.6)
    panels = np.atleast_1d(figure.subplots(1, max(3, len(scenarios))))
    for axes in panels[len(scenarios) :]:
        axes.set_axis_off()
    paired = False
    for scenario, axes in zip(scenarios, panels, strict=False):
        heading(axes, scenario)
        some = [row for row in rows if row.scenario == scenario and row.outcome == "complete"]
        with_truth = {(row.value, row.seed): row.duration_s for row in some if row.planner == "truth"}
        own = [row for row in some if row.planner == "own"]
        pairs = np.array([
            (with_truth[row.value, row.seed], row.duration_s)
            for row in own
            if (row.value, row.seed) in with_truth
        ])  # fmt: skip
        if len(pairs):
            paired = True
            ends = (pairs.min(), pairs.max())
            axes.plot(ends, ends, color="#a0aec0", lw=1.0, zorder=1)
            axes.scatter(pairs[:, 0], pairs[:, 1], s=12, color=AGENTS[0], alpha=0.6, lw=0)
            axes.set_xlabel("with ground truth, s")
            axes.set_ylabel("with tracks, s")
        elif not own:
            say(axes, "no mission was complete")
        else:
            axes.hist([row.duration_s for row in own], bins=20, color=AGENTS[0])
            axes.set_xlabel("mission, s")
            axes.set_ylabel("missions")
        tidy(axes)
    caption = "Durations of complete missions"
    caption += ", and with a planner that has the ground truth; equal on the line." if paired else "."
    return save_figure(figure, folder, "times", caption)


def _planner(planner: str) -> str:
    return "ground truth" if planner == "truth" else "tracks"
