"""A telemetry log as events: what the vehicles of a mission said, and the time that passed between.

A tlog holds traffic of both directions and does not say which frame came from where. The system id does:
frames of the mission's vehicles came in; all others (ground stations, radios, strangers) are left out.
Nothing in a tlog is a scan. Trackers look at position reports when a scan comes, so a blind sensor is laid
beside it: one empty scan a second with detection probability 0, which says nothing and lets reports speak.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Final

import numpy as np

from gcs.app import TICK_NS
from gcs.edge.reader import Record
from gcs.edge.tlog import LogClock, Logged, is_stamped, read_log
from gcs.errors import RecordingError
from gcs.model import NS_PER_S, Datagram, Event, Scan, Sensor, Tick, read_only

LINK: Final = "tlog"
_SCAN_NS: Final = NS_PER_S
_LONGEST_GAP_NS: Final = 60 * NS_PER_S
"""Over a longer silence time jumps: nobody waits for a log that was paused for a night."""
_BLIND: Final = Sensor("blind", 0.0, 1e-9, read_only(np.eye(2) * 100.0), (0.0, 0.0, 1.0, 1.0))
_EMPTY: Final = read_only(np.empty((0, 2)))


def telemetry_records(path: Path, system_ids: Collection[int]) -> Iterator[Record]:
    """Read the events of a tlog, ticks and blind scans in between; damage is passed over.

    Raises
    ------
    RecordingError
        When it is no tlog, or none of the vehicles is in it.
    """
    for number, event in enumerate(_events(path, system_ids)):
        yield Record(number, event.t_ns, event)


def _events(path: Path, system_ids: Collection[int]) -> Iterator[Event]:
    tick_t_ns = scan_t_ns = 0
    for t_ns, system_id, data in _datagrams(path, system_ids):
        if tick_t_ns == 0 or t_ns - tick_t_ns > _LONGEST_GAP_NS:
            tick_t_ns = scan_t_ns = t_ns
        while tick_t_ns + TICK_NS <= t_ns:
            tick_t_ns += TICK_NS
            yield Tick(tick_t_ns)
            if tick_t_ns - scan_t_ns >= _SCAN_NS:
                scan_t_ns = tick_t_ns
                yield Scan(tick_t_ns, tick_t_ns, _BLIND, _EMPTY)
        yield Datagram(max(t_ns, tick_t_ns), LINK, f"system {system_id}", data)


def _datagrams(path: Path, system_ids: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
    seen: set[int] = set()
    found = False
    try:
        with path.open("rb") as file:
            if not is_stamped(file):
                raise RecordingError(str(path), "is no tlog, and only a tlog says when something was heard")
            file.seek(0)
            clock = LogClock()
            for part in read_log(file):
                if not isinstance(part, Logged):
                    continue
                t_ns = clock(part.t_ns)
                seen.add(part.frame.system_id)
                if part.frame.system_id in system_ids:
                    found = True
                    yield t_ns, part.frame.system_id, part.frame.data
    except OSError as error:
        raise RecordingError(str(path), f"cannot be read: {error.strerror}") from None
    if not found:
        raise RecordingError(
            str(path),
            f"none of the mission's vehicles is in it: it holds systems {', '.join(map(str, sorted(seen)))}; "
            f"the mission file names {', '.join(map(str, sorted(system_ids)))}",
        )
