"""Signing at the edge: the gate of all links, the time that must not go back, and what there is to say.

Frames are checked here, before the queue: what is recorded is what was let in, so a replay needs no keys, and
no key ever gets into a recording.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from gcs.endpoints import Link
from gcs.errors import ConfigError
from gcs.io.clock import unix_ns
from gcs.io.output import Writer
from gcs.io.signing.keystore import TimeFile, read_keys
from gcs.mavlink.frames.signing import TICKS_PER_S, Gate, GateCounters, Keys
from gcs.model import NS_PER_S, Level

_SAVE_EVERY_NS: Final = 10 * NS_PER_S
_SAVE_AGAIN_NS: Final = NS_PER_S // 4
"""Least time between two savings."""
_AHEAD: Final = 30 * TICKS_PER_S
"""How far ahead of the signing time in use the saved one is."""
_DRAIN_S: Final = 2.0
"""How long the end waits for a saving that is under way."""
_TELL_AGAIN_NS: Final = 60 * NS_PER_S


class Signing:
    """The signing of a run's links.

    Parameters
    ----------
    links : sequence of Link
        As the run has them.
    keys : Path, optional
        Of the key file; without it nothing is signed.
    kernel : bool
        Whether to check the fast way (`gcs.mavlink.frames.fast_verify`), for who stays long enough.

    Raises
    ------
    ConfigError
        When the key file or the time beside it cannot be used.
    """

    def __init__(self, links: Sequence[Link], keys: Path | None = None, *, kernel: bool = False) -> None:
        self._time: TimeFile | None = None
        self._writer: Writer | None = None
        self._save_problem = ""
        """Why the times could not be saved the last time; empty when they were, or when it was told."""
        self._saved_t_ns = 0
        self._told: dict[tuple[str, str], tuple[int, int]] = {}
        if keys is None:
            self.gate = Gate(Keys(), links)
            return
        table = read_keys(keys).keys
        self._time, self._writer = TimeFile(keys), Writer("the file of signing times", 2, "alarm")
        self.gate = Gate(table, links, *self._time.read(unix_ns()), kernel=kernel)
        unknown = sorted(table.links.keys() - {link.name for link in links})
        if unknown:
            raise ConfigError(str(keys), f"links.{unknown[0]}", "the mission file has no such endpoint")

    def tick(self, t_ns: int) -> list[tuple[str, Level, str]]:
        """Save the times now and then, and when they run ahead of those saved; return what is to be said."""
        news: list[tuple[str, Level, str]] = []
        wait_ns = _SAVE_AGAIN_NS if self.gate.runs_ahead else _SAVE_EVERY_NS
        link = next(iter(self.gate.links), "")
        if self._writer is not None:
            if not 0 <= t_ns - self._saved_t_ns < wait_ns and self._writer.is_idle:
                self._saved_t_ns = t_ns
                streams = self.gate.times_to_save(t_ns)
                latest = max((self.gate.timestamp, *streams.values()))
                self._writer.put(partial(self._save, latest + _AHEAD, streams, unix_ns()))
            if self._save_problem:
                news.append((link, "alarm", self._save_problem))
                self._save_problem = ""
            if stuck := self._writer.news():
                news.append((link, stuck[0], f"{self._writer.name} {stuck[1]}"))
        for name, counters in self.gate.counters.items():
            news += [(name, "alarm", text) for text in self._rejections(t_ns, name, counters)]
        return news

    def wait_until_saved(self) -> None:
        """Wait until the disk has taken what `tick` gave it, for 2 s at most."""
        if self._writer is not None:
            self._writer.drain(_DRAIN_S)

    def _save(self, timestamp: int, streams: Mapping[str, int], now_ns: int) -> None:
        """Write the times, on the writer's thread."""
        assert self._time is not None  # there is a writer
        try:
            self._time.write(timestamp, streams, now_ns)
        except OSError as error:
            self._save_problem = f"{self._time.path} cannot be written: {error.strerror}"

    def _rejections(self, t_ns: int, name: str, counters: GateCounters) -> list[str]:
        """Say at once what is kept out for a new reason, and once a minute that it goes on."""
        said = []
        for reason, count in counters.rejected.items():
            told_t_ns, told = self._told.get((name, reason), (t_ns - _TELL_AGAIN_NS, 0))
            if count > told and t_ns - told_t_ns >= _TELL_AGAIN_NS:
                self._told[name, reason] = t_ns, count
                who = f", the last from {counters.last[reason]}" if reason in counters.last else ""
                said.append(f"{count - told} frames rejected: {reason}{_ADVICE.get(reason, '')}{who}")
        return said

    def close(self) -> None:
        """Save the time as it is."""
        if self._time is not None and self._writer is not None:
            self.wait_until_saved()
            with contextlib.suppress(OSError):  # told while it ran
                self._time.write(self.gate.timestamp, self.gate.streams)


_ADVICE: Final = {
    "not signed": " (an impostor, or a vehicle without its key: gcs keys install)",
    "signed with another key": " (an impostor, or a vehicle with another key than the key file says)",
}
