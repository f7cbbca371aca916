"""The page of one run: which figures and tables there are of it, in which order, and what they say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from gcs.model import NS_PER_S
from gcs.report.html_page import Fact, Page, Section, save_figure, save_page
from gcs.report.plots.charts import flight_figure, quality_figure, timeline_figure, times_figure
from gcs.report.plots.maps import Ground, tracker_figure, truth_figure
from gcs.report.run import tables
from gcs.report.run.evaluation import Summary
from gcs.report.run.tables import number
from gcs.report.run.timeline import Timeline
from gcs.report.telemetry.flights import Flight

PAGE_NAME = "index.html"


@dataclass(frozen=True, slots=True)
class Material:
    """Everything that is known of a run."""

    name: str
    kind: str
    """Recording, telemetry log or raw MAVLink."""
    file: Path
    seed: int | None
    course: Timeline
    start_t_ns: int
    duration_s: float
    summary: Summary | None
    """None without a mission."""
    flights: dict[int, Flight]
    traffic: dict[str, Any]
    ground: Ground | None
    work_ms: Mapping[str, Sequence[float]]
    versions: Mapping[str, str]
    remarks: tuple[str, ...] = ()

    @property
    def has_tracks(self) -> bool:
        """Whether a tracker ran."""
        return any(self.course.estimates.values())


def run_page(material: Material, folder: Path) -> Path:
    """Draw the figures and write the page into `folder`; return the page's file.

    Raises
    ------
    RecordingError
        When something cannot be written.
    """
    sections = [
        _map(material, folder),
        *([_trackers(material, folder)] if material.has_tracks else []),
        *([_decisions(material, folder)] if material.summary is not None else []),
        *([_times(material, folder)] if material.course.sensors or material.course.uploads else []),
        *([_flights(material, folder)] if material.flights else []),
        _link(material),
    ]
    page = Page(
        title=_title(material),
        subtitle=_subtitle(material),
        badge=_badge(material),
        good=_good(material),
        lead=_lead(material),
        remarks=material.remarks,
        facts=tuple(_facts(material)),
        sections=tuple(sections),
        footer=_footer(material),
    )
    path = folder / PAGE_NAME
    save_page(page, path)
    return path


def _title(material: Material) -> str:
    return material.name if material.seed is None else f"{material.name}, seed {material.seed}"


def _subtitle(material: Material) -> str:
    when = ""
    if material.start_t_ns > 0:
        start = datetime.fromtimestamp(material.start_t_ns // NS_PER_S, tz=UTC)
        when = f", {start:%Y-%m-%d %H:%M:%S} UTC"
    return f"{material.kind}{when}, {material.file}"


def _judged(material: Material) -> Summary | None:
    return material.summary if material.course.has_truth else None


def _badge(material: Material) -> str:
    summary = _judged(material)
    return "no truth" if summary is None else summary.outcome


def _good(material: Material) -> bool | None:
    summary = _judged(material)
    return None if summary is None else summary.outcome == "complete"


def _lead(material: Material) -> str:
    summary = _judged(material)
    return "" if summary is None else f"{summary.reason[0].upper()}{summary.reason[1:]}."


def _facts(material: Material) -> list[Fact]:
    summary, course = material.summary, material.course
    facts = [Fact("run time", number(material.duration_s), "s")]
    judged = _judged(material)
    if judged is not None:
        reached = f"{judged.targets_reached} of {judged.targets_total}"
        facts += [Fact("targets reached", reached), _deaths(judged)]
        for kind, mean_m in (("agents", judged.ospa_agents_mean_m), ("targets", judged.ospa_targets_mean_m)):
            facts.append(Fact(f"OSPA of {kind}, mean", number(mean_m, 2), "m", "c = 100 m, p = 1"))
    if summary is not None:
        failed = f"{summary.upload_failures} failed"
        facts += [
            Fact("re-tasks", str(summary.retasks), "", f"plans: {len(course.decisions)}"),
            Fact("mission transfers", str(summary.uploads), "", failed),
        ]
    for name, values in material.work_ms.items():
        if len(values):
            worst = number(float(np.percentile(values, 99)), 1)
            facts.append(Fact(f"a {name}'s work, 99 %", worst, "ms", "measured again on this machine"))
    if material.flights:
        facts.append(Fact("vehicles heard", str(len(material.flights))))
    lost = [of["lost"] for of in material.traffic["vehicles"] if of["lost"] is not None]
    frames = sum(of["frames"] for of in material.traffic["vehicles"])
    if frames:
        facts.append(
            Fact("frames lost", f"{100.0 * sum(lost) / (sum(lost) + frames):.2f}", "%", f"of {frames}")
        )
    return facts


def _deaths(summary: Summary) -> Fact:
    delays = summary.death_delays_s
    detail = f"after {number(min(delays))} s" if delays else ""
    if len(delays) > 1:
        detail += f" to {number(max(delays))} s"
    if summary.false_deaths:
        detail += f"; {summary.false_deaths} false"
    return Fact("deaths seen", f"{len(delays)} of {summary.deaths}", "", detail)


def _map(material: Material, folder: Path) -> Section:
    course = material.course
    figure = truth_figure(course, material.ground, material.flights)
    what = "Truth and tracks" if course.has_truth else "Reports of the vehicles and tracks"
    if not material.has_tracks:
        what = "Reports of the vehicles"
    over = " over the obstacles" if material.ground is not None else ""
    caption = f"{what}{over}, at half time and at the end."
    if material.has_tracks:
        caption += " Of the estimates, some are drawn."
    return Section(f"{what}, mid and end", "", (save_figure(figure, folder, "truth", caption),))


def _trackers(material: Material, folder: Path) -> Section:
    course = material.course
    word = "clutter" if course.has_truth else "detections"
    output = save_figure(
        tracker_figure(course, material.ground), folder, "tracker",
        f"Every estimate of both trackers at every scan, and the {word} in grey.",
    )  # fmt: skip
    quality = save_figure(
        quality_figure(course), folder, "quality",
        "Numbers of objects over time, and OSPA of both trackers with the parts that it is made of.",
    )  # fmt: skip
    rows = (tables.tracking(course),) if course.has_truth else ()
    text = "" if course.has_truth else "OSPA needs the truth, which nobody recorded here."
    text += " All tracks are in tracks.csv: k, t in s, kind, label, x, y in m, vx, vy in m/s, existence."
    return Section("Tracker output", text.strip(), (output, quality), rows)


def _decisions(material: Material, folder: Path) -> Section:
    summary, course = material.summary, material.course
    assert summary is not None
    picture = save_figure(
        timeline_figure(course), folder, "timeline",
        "When plans were made and why, and what each agent went through.",
    )  # fmt: skip
    rows = [tables.agents(course, summary, material.flights), tables.plans(course)]
    if course.notices:
        rows.append(tables.notices(course))
    return Section("Plans and fates", "", (picture,), tuple(rows))


def _times(material: Material, folder: Path) -> Section:
    course = material.course
    picture = save_figure(
        times_figure(course, material.work_ms), folder, "times",
        "How long mission transfers took, how late scans came, and how long scans and plans take.",
    )  # fmt: skip
    rows = [tables.uploads(course), tables.sensors(course)]
    if any(len(values) for values in material.work_ms.values()):
        rows.append(tables.work(material.work_ms))
    return Section("Transfer and scan times", "", (picture,), tuple(rows))


def _flights(material: Material, folder: Path) -> Section:
    figure = flight_figure(material.flights, material.duration_s)
    caption = "Height, ground speed and mode of each vehicle, as it reported them."
    picture = save_figure(figure, folder, "flights", caption)
    return Section("What the vehicles reported", "", (picture,), (tables.flown(material.flights),))


def _link(material: Material) -> Section:
    rows = [tables.senders(material.traffic)]
    if material.traffic["missions"]:
        rows.append(tables.transfers(material.traffic, material.start_t_ns))
    if material.versions:
        rows.append(tables.versions(material.versions))
    return Section("Link and versions", "", (), tuple(rows), folded=True)


def _footer(material: Material) -> str:
    made = material.versions.get("swarm-gcs")
    return f"Made by gcs report from {material.file}" + (
        f", recorded with swarm-gcs {made}." if made else "."
    )
