"""The page of alarms in the documentation, made from the table of notices (`gcs.model.notice_codes`).

``python -m gcs.report.alarms_page`` writes it to the standard output. A test compares it with
`docs/alarms.md`.
"""

from __future__ import annotations

import re
import string
import sys
import textwrap
from collections.abc import Iterator
from typing import Final, NamedTuple

from gcs.model import NoticeCode

_INTRO: Final = """# Alarms: what each one means, and what to do

An alarm is red: act now. A warning is yellow: look. Each has a code, which never changes, in the
console, in recordings (`/effect/notice`) and on zenoh; programs use it, not the text. `…` stands
for the parts that vary. A condition is raised once, with hysteresis, and ends by the notice that is
named here. What repeats more than five times in ten seconds is summed up: `(… more such notices in
… s)`. [Names](orders.md#names) of vehicles and targets.
"""


class Section(NamedTuple):
    """A section of the page, from its first code to that of the next section."""

    title: str
    first: NoticeCode
    text: str = ""


SECTIONS: Final = (
    Section("Is a vehicle heard?", NoticeCode.NOT_HEARD_YET),
    Section(
        "Does it fly?",
        NoticeCode.CAME_DOWN,
        "The flight phase of each vehicle (on the ground, taking off, en route, at its target, "
        "returning, landing, landed, down) comes from its own telemetry: mode, armed, height, speeds, "
        "EXTENDED_SYS_STATE, and the item of its verified mission. Health is watched in flight. An "
        "**unfit** vehicle gets no other target, and its own goes to another vehicle if there is one. "
        "Its onboard mission stays.",
    ),
    Section("Is it the vehicle?", NoticeCode.ID_CONFLICT),
    Section(
        "Is it where it says?",
        NoticeCode.POSITION_JUMP,
        "Impossible position reports are refused and counted by reason: `range` (not on Earth), `null` "
        "(near latitude and longitude 0), `far` (100 km from the mission's origin), `no fix` (without a "
        "GPS fix), `late` (overtaken by a later report, or from another boot), `jump` and `speed` (out "
        "of reach at, or faster than, three times the airspeed plus wind), `frozen` (unchanged while "
        "the vehicle moves). An offset of 20 to 30 m goes unnoticed. Disarmed vehicles and uncovered "
        "places are not checked. A spoofed vehicle is tasked until `gcs order hold`.",
    ),
    Section("Is it apart from others?", NoticeCode.TAKEOFF_BLOCKED),
    Section("Its mission", NoticeCode.MISSION_VERIFIED),
    Section(
        "Who controls it?",
        NoticeCode.STATION_WRITES,
        "Messages of autopilots (STATUSTEXT) are passed on, by their severity.",
    ),
    Section("Sensors", NoticeCode.NO_SENSOR),
    Section("Links and the service", NoticeCode.UNREADABLE_BYTES),
    Section("The run", NoticeCode.PLAN_MADE),
)

_WIDTH: Final = 100


def sections() -> Iterator[tuple[Section, tuple[NoticeCode, ...]]]:
    """Yield the sections, each with its codes."""
    codes = list(NoticeCode)
    begins = [codes.index(section.first) for section in SECTIONS]
    ends = [*begins[1:], len(codes)]
    for section, begin, end in zip(SECTIONS, begins, ends, strict=True):
        yield section, tuple(codes[begin:end])


def shown_text(code: NoticeCode) -> str:
    """Return the text of a code with `…` for its parameters; optional parts are in square brackets."""
    parts = string.Formatter().parse(code.text)
    text = "".join(literal + ("" if name is None else "…") for literal, name, _, _ in parts)
    return re.sub("…(, …)+", "…", text.replace("`", ""))


def meaning(code: NoticeCode) -> str:
    """Return what a notice means, with the conditions that it ends."""
    ended = ", ".join(f"`{one}`" for one in code.ends)
    return "; ".join(one for one in (code.meaning, f"ends {ended}" if ended else "") if one)


def alarms_page() -> str:
    """Return the page as Markdown."""
    parts = [_INTRO]
    for section, codes in sections():
        text = "\n".join(textwrap.wrap(section.text, _WIDTH, break_long_words=False))
        rows = [
            f"| {code.level} `{code}` | `{shown_text(code)}` | {meaning(code)} | {code.action} |"
            for code in codes
        ]
        parts.append(f"## {section.title}\n")
        if text:
            parts.append(f"{text}\n")
        parts.append("\n".join(["| notice | text | meaning | action |", "|---|---|---|---|", *rows]) + "\n")
    return "\n".join(parts)


if __name__ == "__main__":
    sys.stdout.write(alarms_page())
