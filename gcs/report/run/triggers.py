"""Kinds of triggers of plans, for figures, tables and counts.

A plan carries its triggers (`gcs.model.Cause`). Older recordings have a text only, which these patterns read.
They are final.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from typing import Final

from gcs.model import Cause, Plan
from gcs.report.plots.style import RED

COLOURS: Final[dict[str, str]] = {
    "first plan": "#7a5cc0",
    "agent lost": RED,
    "agent not tracked": "#f4a582",
    "agent set aside": "#cc3377",
    "agent in danger": "#e69f00",
    "agent passed its target": "#cc79a7",
    "agent joined": "#009e73",
    "agent idle": "#56b4e9",
    "target appeared": "#0072b2",
    "target lost": "#d55e00",
    "target moved": "#8c6d31",
    "map changed": "#2f855a",
    "taken up again": "#4a5568",
    "approved plan changed": "#b7950b",
    "other": "#718096",
}
"""Colour of each trigger, in the order of rows. "other" is a text that matches no pattern."""

_OTHER: Final = ("other",)
_WORDS: Final[tuple[tuple[Cause, re.Pattern[str]], ...]] = (
    ("first plan", re.compile(r"\bfirst plan\b")),
    ("taken up again", re.compile(r"\btaken up again\b")),
    ("map changed", re.compile(r"\b(?:keep-out|no-fly zone) .* (closed|opened)\b")),
    ("target appeared", re.compile(r"\btarget \S+ appeared")),
    ("target lost", re.compile(r"\btarget \S+ lost")),
    ("target moved", re.compile(r"\btarget \S+ moved")),
    ("agent joined", re.compile(r"\bagent \d+ joined")),
    ("agent idle", re.compile(r"\bagent \d+ has no route")),
    ("agent in danger", re.compile(r"\bagent \d+ (would hit|cannot get back)")),
    ("agent passed its target", re.compile(r"\bagent \d+ passed")),
    ("agent lost", re.compile(r"\bagent \d+ lost")),
    ("agent set aside", re.compile(r"\bagent \d+ ")),
)
"""The first pattern that matches a part of a reason counts."""


def triggers_of(plan: Plan) -> tuple[str, ...]:
    """Return the kinds of triggers of a plan, each once."""
    return plan.causes or _triggers_in(plan.reason)


def _triggers_in(reason: str) -> tuple[str, ...]:
    found = (next((c for c, words in _WORDS if words.search(part)), None) for part in reason.split("; "))
    return tuple(dict.fromkeys(trigger for trigger in found if trigger is not None)) or _OTHER


def count_by_trigger(plans: Iterable[Iterable[str]]) -> str:
    """Return as text how many plans had each trigger, the most frequent first."""
    counts = Counter(trigger for triggers in plans for trigger in triggers)
    return ", ".join(f"{number} {trigger}" for trigger, number in counts.most_common())
