"""Telemetry logs of other programs as events: frames of the vehicles, with ticks between them.

A tlog has the traffic of both directions. Frames with the system ids of the mission's vehicles are received
frames; all others (ground stations, radios, unknown systems) are ignored.

A log has no scans: agents are tracked by their reports. Detections from another file can be merged by time,
as if their sensor had published them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, cast

from gcs.errors import RecordingError
from gcs.io.detections.table_files import ENDINGS
from gcs.io.detections.track_input import Detections, load
from gcs.io.onboard_logs import open_telemetry
from gcs.io.recording.reader import Record
from gcs.io.recording.timestamps import LogClock
from gcs.io.recording.tlog import LogFrame, read_log
from gcs.mavlink.frames.codec import Frame
from gcs.model import NS_PER_S, Datagram, Event, Scan, Sensor, Tick
from gcs.service.service import TICK_NS

LINK: Final = "tlog"
_LONGEST_GAP_NS: Final = 60 * NS_PER_S
"""A longer gap in a log is skipped."""


@dataclass(frozen=True, slots=True)
class DetectionFile:
    """Detections to merge with a log."""

    name: str
    """Name of the file, for errors."""
    detections: Detections
    offset_s: float
    """Offset added to their times. Times that are not Unix times count from the start of the log."""

    def scans(self, start_t_ns: int) -> list[Scan]:
        """Return the scans in the order of time, for a log that starts at `start_t_ns`."""
        shift_ns = round(self.offset_s * NS_PER_S) + (0 if self.detections.is_unix_time else start_t_ns)
        scans = sorted(self.detections.scans, key=lambda scan: scan.t_ns)
        return [
            Scan(scan.t_ns + shift_ns, scan.t_ns + shift_ns, cast(Sensor, scan.sensor), scan.z_m)
            for scan in scans
        ]


def load_detections(path: Path, model: Path | None, offset_s: float) -> DetectionFile:
    """Read detections to merge with a log; `model` is a file with their sensor model, if theirs has none.

    Raises
    ------
    GcsError
        When the file cannot be read or has no sensor model.
    """
    return DetectionFile(str(path), load(path, model, None), offset_s)


def refuse_detections(path: Path) -> None:
    """Refuse a file of detections where a recording or a log is expected.

    Raises
    ------
    RecordingError
        When the file name is that of detections; the text says what to do.
    """
    if path.suffix.lower() in ENDINGS and path.is_file():
        raise RecordingError(
            str(path),
            "has detections only: use `gcs track`, or add them to a telemetry log with `gcs replay LOG "
            "--config MISSION --detections FILE`",
        )


def telemetry_records(
    path: Path, system_ids: Collection[int], detections: DetectionFile | None = None
) -> Iterator[Record]:
    """Read the events of a log, with ticks and scans; damaged parts are skipped.

    Raises
    ------
    RecordingError
        When the file is no log, when it has none of the vehicles, or when all detections are
        of another time.
    """
    for number, event in enumerate(_events(path, system_ids, detections)):
        yield Record(number, event.t_ns, event)


def _events(path: Path, system_ids: Collection[int], detections: DetectionFile | None) -> Iterator[Event]:
    """Yield datagrams and scans, with ticks between them; long gaps are skipped."""
    tick_t_ns: int | None = None
    for event in _merged(path, system_ids, detections):
        if tick_t_ns is None or event.t_ns - tick_t_ns > _LONGEST_GAP_NS:
            tick_t_ns = event.t_ns
        while tick_t_ns + TICK_NS <= event.t_ns:
            tick_t_ns += TICK_NS
            yield Tick(tick_t_ns)
        yield event


def _merged(
    path: Path, system_ids: Collection[int], detections: DetectionFile | None
) -> Iterator[Datagram | Scan]:
    """Yield datagrams and scans with times that never decrease; scans before or after the log are ignored."""
    scans: list[Scan] = []
    start_t_ns: int | None = None
    at = found = t_ns = 0
    seen: set[int] = set()
    for heard_t_ns, frame in _frames(path):
        t_ns = max(t_ns, heard_t_ns)
        if start_t_ns is None:
            start_t_ns = t_ns
            scans = [] if detections is None else detections.scans(t_ns)
            at = first = sum(scan.t_ns < t_ns for scan in scans)
        while at < len(scans) and scans[at].t_ns <= t_ns:
            yield scans[at]
            at += 1
        seen.add(frame.system_id)
        if frame.system_id in system_ids:
            found += 1
            yield Datagram(t_ns, LINK, f"system {frame.system_id}", frame.data)
    if not found:
        raise RecordingError(
            str(path),
            f"has none of the mission's vehicles: its systems are {', '.join(map(str, sorted(seen)))}; "
            f"the mission file has {', '.join(map(str, sorted(system_ids)))}",
        )
    if detections is not None and at == first:
        raise RecordingError(detections.name, _other_time(scans, start_t_ns or 0, t_ns))


def _other_time(scans: list[Scan], start_t_ns: int, end_t_ns: int) -> str:
    if not scans:
        return "has no scans"
    first_s, last_s = ((scan.t_ns - start_t_ns) / NS_PER_S for scan in (scans[0], scans[-1]))
    return (
        f"none of its {len(scans)} scans is within the {(end_t_ns - start_t_ns) / NS_PER_S:.1f} s of the "
        f"log: they are from {first_s:.1f} s to {last_s:.1f} s after its start; shift them with --offset"
    )


def _frames(path: Path) -> Iterator[tuple[int, Frame]]:
    """Yield the frames of a log with their times."""
    try:
        with open_telemetry(path) as file:
            clock = LogClock()
            for part in read_log(file):
                if isinstance(part, LogFrame):
                    yield clock.time_of(part.t_ns), part.frame
    except OSError as error:
        raise RecordingError(str(path), f"cannot be read: {error.strerror}") from None
