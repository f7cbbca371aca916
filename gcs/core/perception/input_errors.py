"""Notices of bad input: the first errors of each source one by one, then a summary every ten seconds."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.model import NS_PER_S, BadInput, Effect, Notice, NoticeCode, Parameter

MAX_SINGLE_NOTICES = 3
"""Errors of one source that get a notice each."""
SUMMARY_NS = 10 * NS_PER_S
_MAX_SOURCES = 64
_OTHERS = "other sources"


@dataclass(slots=True)
class ErrorSource:
    """Errors of one source."""

    count: int = 0
    unreported: int = 0
    reported_t_ns: int = 0
    problem: str = ""


@dataclass(slots=True)
class InputErrors:
    """Counts input errors."""

    count: int = 0
    """Number of errors so far."""
    sources: dict[str, ErrorSource] = field(default_factory=dict)

    def add(self, event: BadInput) -> list[Effect]:
        """Count an error; return a notice while its source has had few."""
        self.count += 1
        name = event.source
        if name not in self.sources and len(self.sources) >= _MAX_SOURCES:
            name = _OTHERS  # the number of sources is bounded
        source = self.sources.setdefault(name, ErrorSource())
        source.count += 1
        if source.count > MAX_SINGLE_NOTICES:
            source.unreported += 1
            source.problem = event.problem
            return []
        source.reported_t_ns = event.t_ns
        parameters: dict[str, Parameter] = {"source": name, "problem": event.problem}
        return [Notice(event.t_ns, NoticeCode.BAD_INPUT, None, parameters)]

    def poll(self, t_ns: int) -> list[Effect]:
        """Return the summaries that are due."""
        effects: list[Effect] = []
        for name, source in self.sources.items():
            if source.unreported and t_ns - source.reported_t_ns >= SUMMARY_NS:
                since_s = (t_ns - source.reported_t_ns) / NS_PER_S
                parameters: dict[str, Parameter] = {
                    "count": source.unreported,
                    "source": name,
                    "seconds": since_s,
                    "problem": source.problem,
                }
                effects.append(Notice(t_ns, NoticeCode.BAD_INPUT_MORE, None, parameters))
                source.unreported = 0
                source.reported_t_ns = t_ns
        return effects
