"""Signing of all links of a run: the gate, the saved signing time, and notices.

Frames are checked before the event queue. A recording holds accepted frames only, so a replay needs no keys.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from gcs.endpoints import Link
from gcs.errors import ConfigError
from gcs.io.background_writer import BackgroundWriter
from gcs.io.clock import unix_ns
from gcs.io.signing.keystore import TimeFile, read_keys
from gcs.mavlink.frames.signing import TICKS_PER_S, Keys, SigningCounters, SigningGate, timestamp_of
from gcs.mistake_codes import MistakeCode
from gcs.model import NS_PER_S, NoticeCode, NoticeContent, Parameter

_SAVE_EVERY_NS: Final = 10 * NS_PER_S
_SAVE_AGAIN_NS: Final = NS_PER_S // 4
"""Minimum time between two saves."""
_SAVE_AHEAD_TICKS: Final = 30 * TICKS_PER_S
"""Saved signing time less the one in use."""
_DRAIN_S: Final = 2.0
"""Wait at the end for a save in progress."""
_MIN_NOTICE_INTERVAL_NS: Final = 60 * NS_PER_S


class LinkSigning:
    """Signing of a run's links.

    Parameters
    ----------
    links : sequence of Link
        Links of the run.
    keys : Path, optional
        Key file; without it nothing is signed.

    Raises
    ------
    ConfigError
        The key file or its time file cannot be used.
    """

    def __init__(self, links: Sequence[Link], keys: Path | None = None) -> None:
        self._time: TimeFile | None = None
        self._writer: BackgroundWriter | None = None
        self._saved: str | None = None
        """Why the last save failed, empty if it did not; None after it was looked at."""
        self._is_unwritten = False
        self._saved_t_ns = 0
        self._reported: dict[tuple[str, str], tuple[int, int]] = {}
        if keys is None:
            self.gate = SigningGate(Keys(), links)
            return
        table = read_keys(keys).keys
        self._time = TimeFile(keys)
        self._writer = BackgroundWriter("the file of signing times", 2, NoticeCode.DISK_BLOCKED)
        self.gate = SigningGate(table, links, *self._time.read(unix_ns()))
        unknown = sorted(table.links.keys() - {link.name for link in links})
        if unknown:
            raise ConfigError(
                str(keys),
                f"links.{unknown[0]}",
                MistakeCode.UNKNOWN_NAME,
                "the mission file has no such endpoint",
            )

    def tick(self, t_ns: int) -> list[tuple[str, NoticeContent]]:
        """Save the times at intervals, and when they run ahead of the saved ones; return notices by link."""
        news: list[tuple[str, NoticeContent]] = []
        wait_ns = _SAVE_AGAIN_NS if self.gate.times.runs_ahead else _SAVE_EVERY_NS
        link = next(iter(self.gate.links), "")
        if self._writer is not None and self._time is not None:
            if not 0 <= t_ns - self._saved_t_ns < wait_ns and self._writer.is_idle:
                self._saved_t_ns = t_ns
                streams = self.gate.times.to_save(timestamp_of(t_ns))
                latest = max((self.gate.timestamp, *streams.values()))
                self._writer.put(partial(self._save, latest + _SAVE_AHEAD_TICKS, streams, unix_ns()))
            cause = self._saved
            self._saved = None
            if cause:
                about = {"path": str(self._time.path), "cause": cause}
                news.append((link, (NoticeCode.SIGNING_TIME_UNWRITTEN, about)))
            elif cause == "" and self._is_unwritten:
                news.append((link, (NoticeCode.SIGNING_TIME_WRITTEN, {"path": str(self._time.path)})))
            self._is_unwritten = bool(cause) or (self._is_unwritten and cause is None)
            if stuck := self._writer.notice():
                news.append((self._writer.name, stuck))
        for name, counters in self.gate.counters.items():
            news += [(name, content) for content in self._rejections(t_ns, name, counters)]
        return news

    def wait_until_saved(self) -> None:
        """Wait for the disk, 2 s at most."""
        if self._writer is not None:
            self._writer.drain(_DRAIN_S)

    def _save(self, timestamp: int, streams: Mapping[str, int], now_ns: int) -> None:
        """Write the times, on the writer's thread."""
        assert self._time is not None  # there is a writer
        try:
            self._time.write(timestamp, streams, now_ns)
        except OSError as error:
            self._saved = str(error.strerror)
        else:
            self._saved = ""

    def _rejections(self, t_ns: int, name: str, counters: SigningCounters) -> list[NoticeContent]:
        """Return a notice for each new reason of rejections at once, then once a minute."""
        found: list[NoticeContent] = []
        for reason, count in counters.rejected.items():
            reported_t_ns, reported = self._reported.get((name, reason), (t_ns - _MIN_NOTICE_INTERVAL_NS, 0))
            if count > reported and t_ns - reported_t_ns >= _MIN_NOTICE_INTERVAL_NS:
                self._reported[name, reason] = t_ns, count
                about: dict[str, Parameter] = {
                    "count": count - reported,
                    "reason": reason,
                    "advice": _ADVICE.get(reason, ""),
                    "sender": counters.last.get(reason, ""),
                }
                found.append((NoticeCode.FRAMES_REJECTED, about))
        return found

    def close(self) -> None:
        """Save the final times."""
        if self._time is not None and self._writer is not None:
            self.wait_until_saved()
            with contextlib.suppress(OSError):  # reported while it ran
                self._time.write(self.gate.timestamp, self.gate.times.latest())


_ADVICE: Final = {
    "not signed": " (an impostor, or a vehicle without its key: gcs keys install)",
    "signed with another key": " (an impostor, or a vehicle with another key than the key file says)",
}
