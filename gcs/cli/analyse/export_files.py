"""Files of `gcs export`: a run is read once, and written in the format of the file's ending."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from rich.console import Console

from gcs.cli.analyse.foxglove_file import write_mcap
from gcs.cli.analyse.info import PROGRESS_PERIOD, reading_progress
from gcs.config import Config, load, parse
from gcs.errors import ConfigError, RecordingError
from gcs.fence import areas_of
from gcs.io.onboard_logs import open_telemetry
from gcs.io.recording.mcap_file import recording_bytes
from gcs.io.recording.reader import Damage, is_recording, read, read_info
from gcs.io.recording.timestamps import LogClock
from gcs.io.recording.tlog import LogFrame, read_log
from gcs.mavlink.frames.codec import Frame, scan
from gcs.mistake_codes import MistakeCode
from gcs.model import AgentStatus, Datagram, Notice, Picture, Plan, limits_text
from gcs.report.export.features import geojson_text
from gcs.report.export.foxglove import FoxgloveMessages, Message, Outline
from gcs.report.export.gpx import gpx_text
from gcs.report.export.kml import kml_text
from gcs.report.export.mission_frame import MissionFrame
from gcs.report.export.run_map import RunMap, RunMapBuilder, flown_paths
from gcs.report.telemetry.flights import Flights
from gcs.service.foreign_logs import refuse_detections

_FORMATS: Final[dict[str, Callable[[RunMap], str]]] = {
    ".kml": kml_text,
    ".geojson": geojson_text,
    ".json": geojson_text,
    ".gpx": gpx_text,
}
_READ: Final = (Datagram, Plan, Picture, AgentStatus, Notice)


def write_export(path: Path, out: Path, console: Console, *, config: str | None, force: bool) -> None:
    """Read a run, and write its map.

    Raises
    ------
    GcsError
        When the run cannot be read or has nothing to show, or the file cannot be written.
    """
    formatted = _FORMATS.get(out.suffix.lower())
    if formatted is None and out.suffix.lower() != ".mcap":
        raise ConfigError(
            str(out), "", MistakeCode.WRONG_TYPE, "expected a name that ends in .kml, .geojson, .gpx or .mcap"
        )
    if out.exists() and not force:
        raise ConfigError(
            str(out), "", MistakeCode.EXISTS, "exists already; choose another name, or add --force"
        )
    if out.exists() and out.samefile(path):
        raise ConfigError(str(out), "", MistakeCode.EXISTS, "is the run itself; choose another name")
    if formatted is None:
        count = write_mcap(out, _messages(path, config, console))
        console.print(f"{out}: {count} messages", highlight=False, markup=False, soft_wrap=True)
        return
    run = read_run_map(path, config, console)
    if run.is_empty:
        raise RecordingError(str(path), "has no positions, routes or targets: there is nothing to export")
    try:
        out.write_text(formatted(run), encoding="utf-8")
    except OSError as error:
        raise RecordingError(str(out), f"cannot be written: {error.strerror}") from None
    counts = (len(run.paths), len(run.routes), len(run.targets), len(run.losses))
    parts = zip(counts, ("flown paths", "planned routes", "targets", "losses"), strict=True)
    text = ", ".join(f"{count} {name}" for count, name in parts)
    console.print(f"{out}: {text}", highlight=False, markup=False, soft_wrap=True)


def read_run_map(path: Path, config: str | None, console: Console) -> RunMap:
    """Read a recording or a log to its end, or to its damage, and return its map."""
    if is_recording(path):
        return _recording(path, config, console)
    refuse_detections(path)
    return _log(path, console)


def mission_of(path: Path, config: str | None) -> Config:
    """Return the mission file of a recording, or the one named instead.

    Raises
    ------
    ConfigError
        When there is none, or it cannot be used.
    """
    if config is not None:
        return load(config)
    text = read_info(path).config_text
    if not text:
        raise ConfigError(
            str(path), "", MistakeCode.MISSING_KEY, "has no mission file; name one with --config"
        )
    return parse(text, f"{path}: its mission file")


def _recording(path: Path, config: str | None, console: Console) -> RunMap:
    mission = mission_of(path, config)
    builder = RunMapBuilder(mission)
    flights = Flights(mission.local_frame)
    for t_ns, value in _recorded(path, console):
        if isinstance(value, Frame):
            flights.add_frame(t_ns, value)
        else:
            builder.add(value)
    return builder.build(mission.name, flights.reports())


def _log(path: Path, console: Console) -> RunMap:
    flights = Flights()
    for t_ns, frame in _logged(path, console):
        flights.add_frame(t_ns, frame)
    return RunMap(path.name, flown_paths(flights.reports()))


def _messages(path: Path, config: str | None, console: Console) -> Iterator[Message]:
    """Yield the messages for Foxglove of a recording or a log."""
    is_ours = is_recording(path)
    if not is_ours:
        refuse_detections(path)
    mission = mission_of(path, config) if is_ours else None
    messages = FoxgloveMessages(None if mission is None else MissionFrame.of(mission))
    outlines: list[Outline] = []
    if mission is not None:
        frame = mission.local_frame
        outlines = [
            Outline(area.stay_in, area.outline_m(frame), limits_text(area.limits))
            for area in areas_of(mission)
        ]
    records = _recorded(path, console) if is_ours else _logged(path, console)
    for number, (t_ns, value) in enumerate(records):
        if number == 0:
            yield from messages.areas(t_ns, outlines)
        yield from messages.frame(t_ns, value) if isinstance(value, Frame) else messages.effect(t_ns, value)


def _recorded(path: Path, console: Console) -> Iterator[tuple[int, object]]:
    """Yield frames from vehicles, and effects, with their times."""
    with reading_progress(console, path, recording_bytes(path)) as advance:
        for record in read(path, advance, _READ):
            value = record.value
            if isinstance(value, Damage):
                _warn(console, f"the recording ends early: {value.problem}")
            elif isinstance(value, Datagram):
                for frame in scan(value.data).frames:
                    yield record.t_ns, frame
            else:
                yield record.t_ns, value


def _logged(path: Path, console: Console) -> Iterator[tuple[int, Frame]]:
    """Yield the valid frames of a log, with their times."""
    bad_bytes = 0
    with open_telemetry(path) as file, reading_progress(console, path, path.stat().st_size) as advance:
        clock = LogClock()
        for number, part in enumerate(read_log(file)):
            if number % PROGRESS_PERIOD == 0:
                advance(part.offset)
            if not isinstance(part, LogFrame):
                bad_bytes += part.length
            elif part.validity == "good":
                yield clock.time_of(part.t_ns), part.frame
    if bad_bytes:
        _warn(console, f"{bad_bytes} damaged bytes were skipped")


def _warn(console: Console, text: str) -> None:
    console.print(text, style="yellow", highlight=False, markup=False, soft_wrap=True)
