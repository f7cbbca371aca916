"""`gcs info`: summarise a recording, a log or a table of detections."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

from gcs.cli.analyse.info_recording import print_contents
from gcs.cli.arguments import JsonOption, command_app
from gcs.cli.errors import exit_on_error
from gcs.errors import RecordingError
from gcs.io.detections.table_files import ENDINGS
from gcs.io.onboard_logs import log_kind, open_telemetry
from gcs.io.recording.mcap_file import mcap_paths, recording_bytes
from gcs.io.recording.reader import Damage, is_recording, read, read_info
from gcs.io.recording.timestamps import LogClock
from gcs.io.recording.tlog import LogFrame, UnreadableBytes, read_log
from gcs.io.recording.topics import topic_of
from gcs.io.terminal import console_for
from gcs.mavlink.frames.codec import scan
from gcs.model import NS_PER_S, AgentStatus, Datagram, MissionEnded, Scan, Send
from gcs.report.telemetry.message_statistics import Traffic, rate_hz

app = command_app()

_MAX_DAMAGE_LISTED: Final = 100
_MAX_NAMES: Final = 10_000
"""Sensors and vehicles that are counted; later ones are ignored."""
_MIN_PROGRESS_BYTES: Final = 4_000_000
"""File size from which on a progress bar is shown."""
PROGRESS_PERIOD: Final = 4096
"""Parts of a log between updates of the progress bar."""


@app.command()
def info(
    file: Annotated[
        Path,
        typer.Argument(
            help="A recording, a log (.tlog, .bin of ArduPilot, .ulg of PX4), or detections (NPZ, CSV)."
        ),
    ],
    as_json: JsonOption = False,
) -> None:
    """Summarise a recording, a log or a table of detections.

    Prints vehicles, messages and their rates, gaps, losses, mission transfers and damage.
    """
    with exit_on_error(as_json=as_json):
        print_info(file, console_for(stderr=as_json), as_json=as_json)


def print_info(path: Path, console: Console, *, as_json: bool) -> None:
    """Read a file to its end and print its contents.

    Raises
    ------
    RecordingError
        When the file cannot be read or has an unknown format.
    """
    if path.suffix.lower() in ENDINGS and not path.is_dir():
        # Not at the top: it loads the sensors' kernels, one second and 60 MB.
        from gcs.cli.analyse.info_detections import detections_contents, print_detections

        contents = detections_contents(path)
        print_detections(contents, console)
    else:
        contents = _recording(path, console) if is_recording(path) else _log(path, console)
        print_contents(contents, console)
    if as_json:
        print(json.dumps(contents), flush=True)  # noqa: T201  the output of --json


@dataclass(slots=True)
class _Span:
    """Number of times, the first and the last one."""

    count: int = 0
    first_t_ns: int = 0
    last_t_ns: int = 0

    def add(self, t_ns: int) -> None:
        """Add a time."""
        if self.count == 0:
            self.first_t_ns = self.last_t_ns = t_ns
        self.count += 1
        self.first_t_ns = min(self.first_t_ns, t_ns)
        self.last_t_ns = max(self.last_t_ns, t_ns)

    def times(self) -> dict[str, Any]:
        """Return first time, last time and duration."""
        seconds = (self.last_t_ns - self.first_t_ns) / NS_PER_S
        return {"first_t_ns": self.first_t_ns, "last_t_ns": self.last_t_ns, "seconds": seconds}


def _recording(path: Path, console: Console) -> dict[str, Any]:
    size = recording_bytes(path)
    header = read_info(path)
    traffic = Traffic()
    span = _Span()
    topics: dict[str, _Span] = {}
    sensors: dict[str, Counter[str]] = {}
    statuses: dict[int, str] = {}
    damage = None
    ended = False
    with reading_progress(console, path, size) as advance:
        for record in read(path, advance):
            value = record.value
            if isinstance(value, Damage):
                damage = asdict(value)
                break
            span.add(record.t_ns)
            topics.setdefault(topic_of(value), _Span()).add(record.t_ns)
            if isinstance(value, Datagram | Send):
                for frame in scan(value.data).frames:
                    traffic.add_frame(record.t_ns, frame)
            elif isinstance(value, Scan):
                name = value.sensor.name
                if name in sensors or len(sensors) < _MAX_NAMES:
                    counts = sensors.setdefault(name, Counter())
                    counts["scans"] += 1
                    counts["detections"] += len(value.z_m)
            elif isinstance(value, AgentStatus) and (value.vehicle in statuses or len(statuses) < _MAX_NAMES):
                statuses[value.vehicle] = value.status
            elif isinstance(value, MissionEnded):
                ended = True
    return {
        "kind": "recording",
        "file": str(path),
        "bytes": size,
        "parts": len(mcap_paths(path)),
        "scenario": None if header.run is None else header.run.scenario,
        "seed": None if header.run is None else header.run.seed,
        "versions": header.versions,
        **span.times(),
        "records": {
            topic: {"count": one.count, "rate_hz": rate_hz(one.count, one.first_t_ns, one.last_t_ns)}
            for topic, one in sorted(topics.items())
        },
        "sensors": {name: dict(counts) for name, counts in sorted(sensors.items())},
        "statuses": {str(vehicle): status for vehicle, status in sorted(statuses.items())},
        "mission_ended": ended,
        "damage": [] if damage is None else [damage],
        **traffic.summary(),
    }


def _log(path: Path, console: Console) -> dict[str, Any]:
    # Not at the top: it imports filterpy, half a second.
    from gcs.report.telemetry.flights import Flights, jump_lines

    size = _size(path)
    traffic = Traffic()
    flights = Flights()
    span = _Span()
    damage: list[UnreadableBytes] = []
    stretches = bad_bytes = 0
    with open_telemetry(path) as file, reading_progress(console, path, size) as advance:
        clock = LogClock()
        for number, part in enumerate(read_log(file)):
            if number % PROGRESS_PERIOD == 0:
                advance(part.offset)
            if isinstance(part, UnreadableBytes):
                stretches += 1
                bad_bytes += part.length
                if len(damage) < _MAX_DAMAGE_LISTED:
                    damage.append(part)
            else:
                t_ns = clock.time_of(part.t_ns)
                span.add(t_ns)
                _count(traffic, part, t_ns)
                if part.validity == "good":
                    flights.add_frame(t_ns, part.frame)
    flown = flights.flights(span.first_t_ns)
    return {
        "kind": log_kind(path),
        "file": str(path),
        "bytes": size,
        **span.times(),
        "clock_jumps": clock.jumps,
        "position_jumps": {
            str(system): [jump._asdict() for jump in flight.jumps]
            for system, flight in flown.items()
            if flight.jumps
        },
        "remarks": jump_lines(flown),
        "damage": [{"offset": part.offset, "bytes": part.length} for part in damage],
        "damaged_stretches": stretches,
        "damaged_bytes": bad_bytes,
        **traffic.summary(),
    }


def _count(traffic: Traffic, part: LogFrame, t_ns: int) -> None:
    if part.validity == "good":
        traffic.add_frame(t_ns, part.frame)
    elif part.validity == "unknown id":
        traffic.add_unknown_frame(part.frame)
    else:
        traffic.add_bad_frame(part.frame)


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError as error:
        raise RecordingError(str(path), f"cannot be read: {error.strerror}") from None


@contextmanager
def reading_progress(console: Console, path: Path, size: int) -> Iterator[Callable[[int], None]]:
    """Show a progress bar for a long file; yield the function that sets the position in bytes."""
    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=size < _MIN_PROGRESS_BYTES) as progress:
        task = progress.add_task(path.name, total=size)
        yield lambda offset: progress.update(task, completed=offset)
