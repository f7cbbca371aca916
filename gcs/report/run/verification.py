"""Verification of a replay against its recording: the same effects, byte for byte, in the same order.

The engine is deterministic: the same events give the same effects on the same machine and library set. All
effects recorded between one event and the next must equal those of the replayed event. Each event is compared
separately, so one different effect is one difference.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, NamedTuple

NOTHING: Final = "nothing"
_BEFORE = 40
_BEHIND = 80


class Output(NamedTuple):
    """One effect as recorded."""

    topic: str
    payload: bytes


@dataclass(frozen=True, slots=True)
class Difference:
    """First difference between a replay and its recording."""

    number: int
    """Number of the different record, or of the next event if the recording has too few effects."""
    t_ns: int
    topic: str
    recorded: str
    """Text around the first different byte; "nothing" without such a record."""
    replayed: str


class Verification:
    """Compares event by event; memory does not grow with the recording."""

    def __init__(self) -> None:
        self.equal: Counter[str] = Counter()
        """Effects that are equal, by topic."""
        self.different = 0
        self.first: Difference | None = None
        self._pending: deque[Output] | None = None

    def event(self, number: int, t_ns: int, outputs: Iterable[Output] | None) -> None:
        """Start with the replayed effects of the next event; None if they are not to be compared."""
        self._close(number, t_ns)
        self._pending = None if outputs is None else deque(outputs)

    def recorded(self, number: int, t_ns: int, output: Output) -> None:
        """Compare the next recorded effect."""
        if self._pending is None:
            return
        replayed = self._pending.popleft() if self._pending else None
        if replayed == output:
            self.equal[output.topic] += 1
        else:
            self._differs(number, t_ns, output, replayed)

    def end(self, number: int, t_ns: int, *, broken_off: bool) -> None:
        """Compare the last event, unless a truncated recording may have cut it short."""
        if not broken_off:
            self._close(number, t_ns)
        self._pending = None

    def _close(self, number: int, t_ns: int) -> None:
        for output in self._pending or ():
            self._differs(number, t_ns, None, output)

    def _differs(self, number: int, t_ns: int, recorded: Output | None, replayed: Output | None) -> None:
        self.different += 1
        if self.first is None:
            known = recorded or replayed
            assert known is not None
            texts = _around_difference(_text(recorded, known.topic), _text(replayed, known.topic))
            self.first = Difference(number, t_ns, known.topic, *texts)


def _text(output: Output | None, topic: str) -> str:
    if output is None:
        return NOTHING
    text = output.payload.decode("utf-8", errors="backslashreplace")
    return text if output.topic == topic else f"{output.topic} {text}"


def _around_difference(one: str, other: str) -> tuple[str, str]:
    """Cut two texts to the same range around the first different character."""
    at = next(
        (index for index, (a, b) in enumerate(zip(one, other, strict=False)) if a != b),
        min(len(one), len(other)),
    )
    start = max(0, at - _BEFORE)

    def cut(text: str) -> str:
        behind = "…" if len(text) > at + _BEHIND else ""
        return ("…" if start else "") + text[start : at + _BEHIND] + behind

    return (
        one if one == NOTHING else cut(one),
        other if other == NOTHING else cut(other),
    )
