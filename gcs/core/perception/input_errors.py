"""Input that could not be read or used: told at first, then summarised, never silenced.

Noise on a link or a misconfigured sensor makes an error with each datagram or scan. The first few of a
source are told one by one. From then on a summary every `SUMMARY_NS` says how many more there were, and the
last reason.
"""

from __future__ import annotations

from dataclasses import dataclass

from gcs.model import NS_PER_S, BadInput, Effect, Notice

TOLD_AT_FIRST = 3
"""Errors of one source that are told one by one."""
SUMMARY_NS = 10 * NS_PER_S
_MAX_SOURCES = 64
_OTHERS = "other sources"


@dataclass(slots=True)
class _Source:
    """Errors of one source."""

    count: int = 0
    untold: int = 0
    told_t_ns: int = 0
    problem: str = ""


class InputErrors:
    """Counts errors of input and tells of them."""

    def __init__(self) -> None:
        self.count = 0
        """Errors so far."""
        self._sources: dict[str, _Source] = {}

    def take(self, event: BadInput) -> list[Effect]:
        """Count an error; return a notice while its source has had few."""
        self.count += 1
        name = event.source
        if name not in self._sources and len(self._sources) >= _MAX_SOURCES:
            name = _OTHERS  # invented names do not fill the memory
        source = self._sources.setdefault(name, _Source())
        source.count += 1
        if source.count > TOLD_AT_FIRST:
            source.untold += 1
            source.problem = event.problem
            return []
        source.told_t_ns = event.t_ns
        return [Notice(event.t_ns, "warning", f"bad input: {event.problem}")]

    def poll(self, t_ns: int) -> list[Effect]:
        """Let time pass; return the summaries that are due."""
        effects: list[Effect] = []
        for name, source in self._sources.items():
            if source.untold and t_ns - source.told_t_ns >= SUMMARY_NS:
                since_s = (t_ns - source.told_t_ns) / NS_PER_S
                text = f"bad input: {source.untold} more of {name} in {since_s:.0f} s"
                effects.append(Notice(t_ns, "warning", f"{text}, the last: {source.problem}"))
                source.untold, source.told_t_ns = 0, t_ns
        return effects
