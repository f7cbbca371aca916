"""Page of one run: its figures and tables in order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from gcs.model import NS_PER_S
from gcs.report.html_page import Fact, Page, Section, save_figure, save_page
from gcs.report.plots.maps import Ground, tracker_figure, truth_figure
from gcs.report.plots.run_charts import flight_figure, quality_figure, timeline_figure, times_figure
from gcs.report.run import tables
from gcs.report.run.evaluation import Summary
from gcs.report.run.tables import number
from gcs.report.run.timeline import Timeline
from gcs.report.telemetry.flights import Flight

PAGE_NAME = "index.html"


@dataclass(frozen=True, slots=True)
class Material:
    """Input of a run page."""

    name: str
    kind: str
    """Recording or telemetry log."""
    file: Path
    seed: int | None
    timeline: Timeline
    start_t_ns: int
    duration_s: float
    summary: Summary | None
    """None without a mission."""
    flights: dict[int, Flight]
    traffic: dict[str, Any]
    ground: Ground | None
    work_ms: Mapping[str, Sequence[float]]
    versions: Mapping[str, str]
    terrain: str
    """Elevation model and flight band in words, or "flat"; empty without a mission."""
    remarks: tuple[str, ...] = ()

    @property
    def has_tracks(self) -> bool:
        """True if a tracker ran."""
        return any(self.timeline.estimates.values())


def run_page(material: Material, folder: Path) -> Path:
    """Draw the figures and write the page into `folder`; return the path of the page.

    Raises
    ------
    RecordingError
        If a file cannot be written.
    """
    sections = [
        _map(material, folder),
        *([_trackers(material, folder)] if material.has_tracks else []),
        *([_decisions(material, folder)] if material.summary is not None else []),
        *([_times(material, folder)] if material.timeline.sensors or material.timeline.uploads else []),
        *([_flights(material, folder)] if material.flights else []),
        _link(material),
    ]
    evaluated = _evaluated(material)
    version = material.versions.get("swarm-gcs")
    page = Page(
        title=material.name if material.seed is None else f"{material.name}, seed {material.seed}",
        subtitle=_subtitle(material),
        badge="no ground truth" if evaluated is None else evaluated.outcome,
        good=None if evaluated is None else evaluated.outcome == "complete",
        lead="" if evaluated is None else f"{evaluated.reason[0].upper()}{evaluated.reason[1:]}.",
        remarks=material.remarks,
        facts=tuple(_facts(material)),
        sections=tuple(sections),
        footer=f"Made by gcs report from {material.file}"
        + (f", recorded with swarm-gcs {version}." if version else "."),
    )
    path = folder / PAGE_NAME
    save_page(page, path)
    return path


def _subtitle(material: Material) -> str:
    when = ""
    if material.start_t_ns > 0:
        start = datetime.fromtimestamp(material.start_t_ns // NS_PER_S, tz=UTC)
        when = f", {start:%Y-%m-%d %H:%M:%S} UTC"
    terrain = f", terrain {material.terrain}" if material.terrain else ""
    return f"{material.kind}{when}, {material.file}{terrain}"


def _evaluated(material: Material) -> Summary | None:
    """Return the summary of a run with ground truth."""
    return material.summary if material.timeline.has_truth else None


def _facts(material: Material) -> list[Fact]:
    summary = material.summary
    timeline = material.timeline
    facts = [Fact("run time", number(material.duration_s), "s")]
    evaluated = _evaluated(material)
    if evaluated is not None:
        reached = f"{evaluated.targets_reached} of {evaluated.targets_total}"
        facts += [Fact("targets reached", reached), _losses(evaluated)]
        for kind, mean_m in (
            ("agents", evaluated.ospa_agents_mean_m),
            ("targets", evaluated.ospa_targets_mean_m),
        ):
            facts.append(Fact(f"OSPA of {kind}, mean", number(mean_m, 2), "m", "c = 100 m, p = 1"))
    if summary is not None:
        failed = f"{summary.upload_failures} failed"
        facts += [
            Fact("re-tasks", str(summary.retasks), "", f"plans: {len(timeline.decisions)}"),
            Fact("mission transfers", str(summary.uploads), "", failed),
            Fact("losses of separation", str(len(timeline.losses))),
        ]
    for name, values in material.work_ms.items():
        if len(values):
            worst = number(float(np.percentile(values, 99)), 1)
            facts.append(Fact(f"{name} computing time, 99 %", worst, "ms", "replayed on this machine"))
    if material.flights:
        facts.append(Fact("vehicles in telemetry", str(len(material.flights))))
    lost = [of["lost"] for of in material.traffic["vehicles"] if of["lost"] is not None]
    frames = sum(of["frames"] for of in material.traffic["vehicles"])
    if frames:
        facts.append(
            Fact("frames lost", f"{100.0 * sum(lost) / (sum(lost) + frames):.2f}", "%", f"of {frames}")
        )
    return facts


def _losses(summary: Summary) -> Fact:
    delays = summary.loss_delays_s
    detail = f"after {number(min(delays))} s" if delays else ""
    if len(delays) > 1:
        detail += f" to {number(max(delays))} s"
    if summary.false_losses:
        detail += f"; {summary.false_losses} false"
    return Fact("losses detected", f"{len(delays)} of {summary.losses}", "", detail)


def _map(material: Material, folder: Path) -> Section:
    timeline = material.timeline
    figure = truth_figure(timeline, material.ground, material.flights)
    title = "Ground truth and tracks" if timeline.has_truth else "Telemetry and tracks"
    if not material.has_tracks:
        title = "Telemetry"
    over = " over the obstacles" if material.ground is not None else ""
    if material.ground is not None and material.ground.terrain is not None:
        over += " and the terrain"
    caption = f"{title}{over}, at half time and at the end of the run."
    if material.has_tracks:
        caption += " Only some estimates are drawn."
    picture = save_figure(figure, folder, "truth", caption)
    return Section(f"{title} at half time and at the end", "", (picture,))


def _trackers(material: Material, folder: Path) -> Section:
    timeline = material.timeline
    word = "clutter" if timeline.has_truth else "detections"
    output = save_figure(
        tracker_figure(timeline, material.ground), folder, "tracker",
        f"All estimates of both trackers, and {word} in grey.",
    )  # fmt: skip
    quality = save_figure(
        quality_figure(timeline), folder, "quality",
        "Cardinality over time, and OSPA of both trackers with its localisation and cardinality parts.",
    )  # fmt: skip
    rows = (tables.tracking(timeline),) if timeline.has_truth else ()
    text = "" if timeline.has_truth else "No OSPA: the file has no ground truth."
    text += " tracks.csv has all tracks: k, t in s, kind, label, x, y in m, vx, vy in m/s, existence."
    return Section("Tracker output", text.strip(), (output, quality), rows)


def _decisions(material: Material, folder: Path) -> Section:
    summary = material.summary
    timeline = material.timeline
    assert summary is not None
    picture = save_figure(
        timeline_figure(timeline), folder, "timeline",
        "Plans with their triggers, and the status of each agent over time.",
    )  # fmt: skip
    rows = [tables.agents(timeline, summary, material.flights), tables.plans(timeline)]
    if timeline.losses:
        rows.append(tables.losses(timeline))
    if timeline.notices:
        rows.append(tables.notices(timeline))
    return Section("Plans and agent status", "", (picture,), tuple(rows))


def _times(material: Material, folder: Path) -> Section:
    timeline = material.timeline
    picture = save_figure(
        times_figure(timeline, material.work_ms), folder, "times",
        "Durations of mission transfers, delays of scans, and computing times of scans and plans.",
    )  # fmt: skip
    rows = [tables.uploads(timeline), tables.sensors(timeline)]
    if any(len(values) for values in material.work_ms.values()):
        rows.append(tables.work(material.work_ms))
    return Section("Transfer and scan times", "", (picture,), tuple(rows))


def _flights(material: Material, folder: Path) -> Section:
    terrain = None if material.ground is None else material.ground.terrain
    figure = flight_figure(material.flights, material.duration_s, terrain)
    heights = "Height" if terrain is None else "Height above home and above ground"
    caption = f"{heights}, ground speed and flight mode of each vehicle, from its telemetry."
    picture = save_figure(figure, folder, "flights", caption)
    return Section("Vehicle telemetry", "", (picture,), (tables.flown(material.flights, terrain),))


def _link(material: Material) -> Section:
    rows = [tables.senders(material.traffic)]
    if material.traffic["missions"]:
        rows.append(tables.transfers(material.traffic, material.start_t_ns))
    if material.versions:
        rows.append(tables.versions(material.versions))
    return Section("Link and versions", "", (), tuple(rows), folded=True)
