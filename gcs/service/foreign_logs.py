"""A telemetry log as events: what the vehicles of a mission said, and the time that passed between.

A tlog holds traffic of both directions and does not say which frame came from where. The system id does:
frames of the mission's vehicles came in; all others (ground stations, radios, strangers) are left out. A raw
stream is the same; its times are those of the vehicles' own clocks (`gcs.io.recording.timestamps`).

Nothing in a log is a scan. Detections that were recorded elsewhere can be laid beside it: they enter in the
order of their times, as if their sensor had published them then. Trackers look at position reports when a
scan comes, so where there are none a blind sensor stands in: an empty scan each second with detection
probability 0, which says nothing and lets reports speak.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from gcs.errors import RecordingError
from gcs.files import open_regular
from gcs.io.detections.readers import Detections, load
from gcs.io.detections.tables import ENDINGS
from gcs.io.recording.reader import Record
from gcs.io.recording.timestamps import FrameTimes
from gcs.io.recording.tlog import LogFrame, is_stamped, read_log
from gcs.mavlink.frames.codec import Frame
from gcs.model import NS_PER_S, Datagram, Event, Scan, Sensor, Tick, read_only
from gcs.service.service import TICK_NS

LINK: Final = "tlog"
_SCAN_NS: Final = NS_PER_S
_LONGEST_GAP_NS: Final = 60 * NS_PER_S
"""Over a longer silence time jumps: nobody waits for a log that was paused for a night."""
_BLIND: Final = Sensor("blind", 0.0, 1e-9, read_only(np.eye(2) * 100.0), (0.0, 0.0, 1.0, 1.0))
_EMPTY: Final = read_only(np.empty((0, 2)))


@dataclass(frozen=True, slots=True)
class Beside:
    """Detections to lay beside a log."""

    name: str
    """Of their file, for errors."""
    detections: Detections
    offset_s: float
    """Added to their times: Unix times as they are, others from the beginning of the log."""

    def scans(self, start_t_ns: int) -> list[Scan]:
        """Return them as scans in the order of time, beside a log that begins then."""
        shift_ns = round(self.offset_s * NS_PER_S) + (0 if self.detections.absolute else start_t_ns)
        looks = sorted(self.detections.looks, key=lambda look: look.t_ns)
        return [Scan(look.t_ns + shift_ns, look.t_ns + shift_ns, look.sensor, look.z_m) for look in looks]


def load_beside(path: Path, model: Path | None, offset_s: float) -> Beside:
    """Read detections to lay beside a log; `model` says what their sensor is where their file does not.

    Raises
    ------
    GcsError
        When the file cannot be read or its sensor is not known.
    """
    return Beside(str(path), load(path, model, None), offset_s)


def refuse_detections(path: Path) -> None:
    """Say what to do with detections where a recording or a log was expected.

    Raises
    ------
    RecordingError
        When the name is one of detections.
    """
    if path.suffix.lower() in ENDINGS and path.is_file():
        raise RecordingError(
            str(path),
            "holds detections alone: `gcs track` tracks them; `gcs replay LOG --config MISSION --detections "
            "FILE` lays them beside a telemetry log",
        )


def telemetry_records(
    path: Path, system_ids: Collection[int], beside: Beside | None = None
) -> Iterator[Record]:
    """Read the events of a log, ticks and scans in between; damage is passed over.

    Raises
    ------
    RecordingError
        When it is no log or says no times, none of the vehicles is in it, or no scan lies beside it.
    """
    for number, event in enumerate(_events(path, system_ids, beside)):
        yield Record(number, event.t_ns, event)


def _events(path: Path, system_ids: Collection[int], beside: Beside | None) -> Iterator[Event]:
    """Ticks between all that has a time; a silence that nothing interrupts is jumped."""
    tick_t_ns: int | None = None
    scan_t_ns, patience_ns = 0, _SCAN_NS
    for event in _merged(path, system_ids, beside):
        if tick_t_ns is None or event.t_ns - tick_t_ns > _LONGEST_GAP_NS:
            tick_t_ns = scan_t_ns = event.t_ns
        while tick_t_ns + TICK_NS <= event.t_ns:
            tick_t_ns += TICK_NS
            yield Tick(tick_t_ns)
            if tick_t_ns - scan_t_ns >= patience_ns:
                scan_t_ns, patience_ns = tick_t_ns, _SCAN_NS
                yield Scan(tick_t_ns, tick_t_ns, _BLIND, _EMPTY)
        if isinstance(event, Scan):
            scan_t_ns, patience_ns = event.t_ns, 2 * _SCAN_NS
        yield event


def _merged(path: Path, system_ids: Collection[int], beside: Beside | None) -> Iterator[Datagram | Scan]:
    """Datagrams and scans in the order of time, which never runs back; scans outside the log are left out."""
    scans: list[Scan] = []
    start_t_ns: int | None = None
    at = found = t_ns = 0
    seen: set[int] = set()
    for heard_t_ns, frame in _frames(path):
        t_ns = max(t_ns, heard_t_ns)
        if start_t_ns is None:
            start_t_ns = t_ns
            scans = [] if beside is None else beside.scans(t_ns)
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
            f"none of the mission's vehicles is in it: it holds systems {', '.join(map(str, sorted(seen)))}; "
            f"the mission file names {', '.join(map(str, sorted(system_ids)))}",
        )
    if beside is not None and at == first:
        raise RecordingError(beside.name, _elsewhere(scans, start_t_ns or 0, t_ns))


def _elsewhere(scans: list[Scan], start_t_ns: int, end_t_ns: int) -> str:
    if not scans:
        return "holds no scans"
    first_s, last_s = ((scan.t_ns - start_t_ns) / NS_PER_S for scan in (scans[0], scans[-1]))
    return (
        f"none of its {len(scans)} scans lies beside the log, which lasts "
        f"{(end_t_ns - start_t_ns) / NS_PER_S:.1f} s: they are from {first_s:.1f} s to {last_s:.1f} s after "
        "its beginning; shift them with --offset"
    )


def _frames(path: Path) -> Iterator[tuple[int, Frame]]:
    """Frames of a log with their times."""
    try:
        with open_regular(path) as file:
            stamped = is_stamped(file, str(path))
            line = FrameTimes(stamped=stamped)
            for part in read_log(file, stamped=stamped):
                if isinstance(part, LogFrame):
                    yield line(part), part.frame
    except OSError as error:
        raise RecordingError(str(path), f"cannot be read: {error.strerror}") from None
    if line.timed_by is None:
        raise RecordingError(
            str(path),
            "says not when anything was heard: it has no stamps, and no vehicle says its boot time",
        )
