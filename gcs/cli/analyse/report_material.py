"""Material of `gcs report`: timeline, evaluation and tracks of a run, read from its file in one pass.

The file is read once, whatever its kind: a recording or a telemetry log. The page names
what the file does not have (ground truth, tracks, times) and shows the rest.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.console import Console

from gcs.cli.analyse.info import PROGRESS_PERIOD, reading_progress
from gcs.cli.analyse.run_file import RunFile
from gcs.cli.run_setup import warm_up
from gcs.cli.warm_up_progress import flying
from gcs.config import Config, load, parse
from gcs.core.airspace.obstacle_map import mission_grid
from gcs.core.engine import Engine
from gcs.core.replanning.mission_inputs import terrain_of
from gcs.errors import ConfigError, GcsError, RecordingError
from gcs.io.onboard_logs import open_telemetry
from gcs.io.recording.mcap_file import recording_bytes
from gcs.io.recording.reader import Damage, read, read_info
from gcs.io.recording.timestamps import LogClock
from gcs.io.recording.tlog import LogFrame, read_log
from gcs.mavlink.frames.codec import scan
from gcs.model import Datagram, Effect, Event, Picture, Plan, Scan, Send
from gcs.report.plots.maps import Ground
from gcs.report.run.evaluation import Evaluator, Summary, evaluator_of
from gcs.report.run.run_page import Material, run_page
from gcs.report.run.timeline import Timeline, TimelineBuilder
from gcs.report.run.tracks_csv import TracksCsv
from gcs.report.telemetry.flights import Flights, jump_lines
from gcs.report.telemetry.message_statistics import Traffic
from gcs.service.foreign_logs import DetectionFile

CSV_NAME: Final = "tracks.csv"


@dataclass(frozen=True, slots=True)
class ReportOptions:
    """The options of a report about one run."""

    file: RunFile
    out: Path | None
    timing: bool
    """True to process every event again, to measure the time of scans and plans."""
    as_json: bool


def run_report(options: ReportOptions, console: Console) -> None:
    """Read a file to its end and write its page.

    Raises
    ------
    GcsError
        When the file cannot be read or has an unknown format, or the page cannot be written.
    """
    folder = options.out if options.out is not None else default_folder(options.file.path)
    with _new_folder(folder):
        material = read_material(options.file, folder / CSV_NAME, console, timing=options.timing)
    with console.status("drawing the figures"):
        page = run_page(material, folder)
    console.print(str(page), highlight=False, markup=False, soft_wrap=True)
    for remark in material.remarks:
        console.print(remark, style="yellow", highlight=False, markup=False, soft_wrap=True)
    if options.as_json:
        print(json.dumps(_as_dict(material, page, folder)), flush=True)  # noqa: T201  the output of --json


@contextmanager
def _new_folder(folder: Path) -> Iterator[None]:
    """Create a folder before the long work; remove it again on an error."""
    is_new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(
            str(folder), f"cannot be created: {error.strerror}; choose another with -o"
        ) from None
    try:
        yield
    except GcsError:
        if is_new:
            with suppress(OSError):
                folder.rmdir()
        raise


def default_folder(path: Path) -> Path:
    """Return the default folder of a report: in the folder of a recording, else NAME-report."""
    return path / "report" if path.is_dir() else Path(f"{path.stem}-report")


def read_material(file: RunFile, csv: Path | None, console: Console, *, timing: bool) -> Material:
    """Read a file to its end, or to its damage, and return the content of the page."""
    reading = _Reading(file, csv, console, timing)
    return reading.recording() if file.is_recording() else reading.log()


@dataclass(slots=True)
class _Reading:
    """One pass over a file."""

    file: RunFile
    csv: Path | None
    console: Console
    timing: bool
    config: Config | None = None
    seed: int = 0
    remarks: list[str] = field(default_factory=list)
    traffic: Traffic = field(default_factory=Traffic)
    work_ms: dict[str, list[float]] = field(default_factory=lambda: {"scan": [], "plan": []})

    def recording(self) -> Material:
        """Read a recording."""
        path = self.file.path
        header = read_info(path)
        self._find_mission(header.config_text)
        seed = self.file.seed
        if seed is None and header.run:
            seed = header.run.seed
        self.seed = seed or 0
        ground = self._ground(known=seed is not None)
        engine = self._engine(can_repeat=ground is not None)
        evaluator = evaluator_of(self.config) if self.config is not None else Evaluator(0.0, ())
        flights = self._flights()
        builder = TimelineBuilder(evaluator)
        records = 0
        with (
            reading_progress(self.console, path, recording_bytes(path)) as advance,
            TracksCsv(self.csv) as csv,
        ):
            for record in read(path, advance):
                value = record.value
                if isinstance(value, Damage):
                    self.remarks.append(f"The recording ends early: {value.problem}.")
                    break
                records += 1
                if isinstance(value, Event) and engine is not None:
                    self._timed_step(engine, value)
                if isinstance(value, Datagram | Send):
                    self._add_frames(record.t_ns, value.data, flights)
                builder.add(value)
                if isinstance(value, Picture):
                    csv.add_picture(value, builder.start_t_ns)
        if records == 0:
            raise RecordingError(str(path), "has no records" + _because(self.remarks))
        name = self.config.name if self.config else path.name
        if header.run:
            name = header.run.scenario
        timeline = builder.build()
        if not timeline.has_truth:
            self.remarks.append(
                "This recording has no ground truth, like any real flight: OSPA, losses and arrivals cannot "
                "be evaluated, and the maps show reports and tracks."
            )
        return self._material(name, "recording", timeline, flights, evaluator, ground, header.versions)

    def log(self) -> Material:
        """Read a telemetry log; run the trackers if a mission is given."""
        file = self.file
        builder = TimelineBuilder()
        evaluator = None
        ground = None
        added = file.load_detections()
        if added is not None:
            self.remarks += added.detections.remarks
        if file.config is not None:
            self.config = load(file.config)
            self.seed = file.seed or 0
            evaluator = evaluator_of(self.config)
            ground = self._ground(known=True)
            builder = TimelineBuilder(evaluator)
        flights = self._flights()
        span = self._read_log(flights)
        timeline = builder.build()
        with TracksCsv(self.csv) as csv:
            if self.config is not None:
                for value in self._replay_log(self.config, added):
                    builder.add(value)
                    if isinstance(value, Picture):
                        csv.add_picture(value, builder.start_t_ns)
        if self.config is not None:
            timeline = builder.build()
        else:
            self.remarks.append(
                "A telemetry log has no scans and no mission: the page shows the reports of the vehicles. "
                "With --config and a mission of these vehicles, the agents' tracker runs on it."
            )
        return self._material(file.path.name, "telemetry log", timeline, flights, evaluator, ground, {}, span)

    def _read_log(self, flights: Flights) -> tuple[int, int]:
        """Read every frame; return the first and the last time."""
        path = self.file.path
        size = path.stat().st_size
        times = [0, 0]
        bad_bytes = 0
        stretches = 0
        with open_telemetry(path) as file, reading_progress(self.console, path, size) as advance:
            clock = LogClock()
            for number, part in enumerate(read_log(file)):
                if number % PROGRESS_PERIOD == 0:
                    advance(part.offset)
                if not isinstance(part, LogFrame):
                    stretches += 1
                    bad_bytes += part.length
                elif part.validity == "good":
                    t_ns = clock.time_of(part.t_ns)
                    times = [times[0] or t_ns, max(times[1], t_ns)]
                    self.traffic.add_frame(t_ns, part.frame)
                    flights.add_frame(t_ns, part.frame)
        if bad_bytes:
            places = _times(stretches, "stretch", "stretches")
            self.remarks.append(f"{bad_bytes} damaged bytes, in {places}, were skipped.")
        if clock.jumps:
            often = _times(clock.jumps, "time", "times")
            self.remarks.append(f"Its clock was set {often} while it was written; the time line continues.")
        return times[0], times[1]

    def _find_mission(self, text: str) -> None:
        if self.file.config is not None:
            self.config = load(self.file.config)
            return
        try:
            if text:
                self.config = parse(text, f"{self.file.path}: its mission file")
        except ConfigError as error:
            self.remarks.append(f"Its mission file cannot be used ({error}); name one with --config.")
        if not text:
            self.remarks.append("It has no mission file: obstacles and evaluation are missing; see --config.")

    def _ground(self, *, known: bool) -> Ground | None:
        config = self.config
        if config is None:
            return None
        if not known and config.map.random_threshold > 0.0:
            self.remarks.append("It has no seed, and its obstacles are random; give --seed.")
            return None
        return Ground.of(mission_grid(config, self.seed), terrain_of(config))

    def _flights(self) -> Flights:
        return Flights(None if self.config is None else self.config.local_frame)

    def _engine(self, *, can_repeat: bool) -> Engine | None:
        if self.config is None or not (can_repeat and self.timing):
            return None
        warm_up(self.console, *flying(self.config))
        return Engine(self.config, self.seed)

    def _replay_log(self, config: Config, added: DetectionFile | None) -> Iterator[object]:
        """Yield the events of a telemetry log, each followed by its effects."""
        engine = self._engine(can_repeat=True) or Engine(config, self.seed)
        for record in self.file.log_records(config, added):
            assert isinstance(record.value, Event)
            yield record.value
            yield from self._timed_step(engine, record.value)

    def _timed_step(self, engine: Engine, event: Event) -> list[Effect]:
        """Process an event and record its CPU time; the time of a plan includes its scan."""
        started = time.process_time()
        effects = engine.step(event)
        took_ms = 1e3 * (time.process_time() - started)
        if any(isinstance(effect, Plan) for effect in effects):
            self.work_ms["plan"].append(took_ms)
        elif isinstance(event, Scan):
            self.work_ms["scan"].append(took_ms)
        return effects

    def _add_frames(self, t_ns: int, data: bytes, flights: Flights) -> None:
        for frame in scan(data).frames:
            self.traffic.add_frame(t_ns, frame)
            flights.add_frame(t_ns, frame)

    def _material(
        self,
        name: str,
        kind: str,
        timeline: Timeline,
        flights: Flights,
        evaluator: Evaluator | None,
        ground: Ground | None,
        versions: dict[str, str],
        span_t_ns: tuple[int, int] | None = None,
    ) -> Material:
        start_t_ns = timeline.start_t_ns
        duration_s = timeline.duration_s
        if span_t_ns is not None:
            start_t_ns = span_t_ns[0]
            duration_s = (span_t_ns[1] - start_t_ns) / 1e9
            timeline = replace(timeline, start_t_ns=start_t_ns, duration_s=duration_s)
        flown = flights.flights(start_t_ns)
        self.remarks += jump_lines(flown)
        return Material(
            name=name,
            kind=kind,
            file=self.file.path,
            seed=self.seed if self.config is not None else None,
            timeline=timeline,
            start_t_ns=start_t_ns,
            duration_s=duration_s,
            summary=self._summary(evaluator, timeline),
            flights=flown,
            traffic=self.traffic.summary(),
            ground=ground,
            work_ms=self.work_ms,
            versions=versions,
            terrain="" if self.config is None else self.config.ground,
            remarks=tuple(self.remarks),
        )

    def _summary(self, evaluator: Evaluator | None, timeline: Timeline) -> Summary | None:
        if evaluator is None or self.config is None:
            return None
        return evaluator.summary(
            scenario=self.config.name,
            seed=self.seed,
            duration_s=timeline.duration_s,
            scan_ms_p99=_p99(self.work_ms["scan"]),
            plan_ms_p99=_p99(self.work_ms["plan"]),
            recording=str(self.file.path),
        )


def _p99(values_ms: list[float]) -> float:
    return float(np.percentile(values_ms, 99)) if values_ms else float("nan")


def _times(count: int, one: str, many: str) -> str:
    return f"{count} {one if count == 1 else many}"


def _because(remarks: list[str]) -> str:
    return f": {remarks[-1]}" if remarks else ""


def _as_dict(material: Material, page: Path, folder: Path) -> dict[str, Any]:
    from gcs.report.run.evaluation import summary_json

    return {
        "file": str(material.file),
        "kind": material.kind,
        "page": str(page),
        "figures": sorted(str(path) for path in (folder / "figures").iterdir()),
        "tracks": str(folder / CSV_NAME),
        "has_truth": material.timeline.has_truth,
        "seconds": material.duration_s,
        "remarks": list(material.remarks),
        "summary": None if material.summary is None else json.loads(summary_json(material.summary)),
    }
