"""The page of alarms in the docs (`docs/alarms.md`), shown by the console without internet.

Each row of its tables quotes the texts of one alarm, with `…` for what varies. So the row of an alarm is
found by its text, and each row has an anchor.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from functools import cache
from html import escape
from importlib.resources import files
from itertools import groupby
from typing import Final, NamedTuple

PATH: Final = "/alarms"
"""Path of the page on the console."""
_STATUSTEXT: Final = "statustext"
_MAX_ANCHOR: Final = 80
_SHORT: Final = 10
_MAX_TEXT: Final = 500
_WORD: Final = re.compile(r"\w")
_AGENT: Final = re.compile(r"^agent [\d:]+: ")
_ALARM_ROW: Final = re.compile(r"\| (alarm|warning|info|answer) ")
_CODE: Final = re.compile(r"`([^`]+)`")
_LINK: Final = re.compile(r"\[([^\]]+)\]\(([^)]+)\)")
_HEAD: Final = """<!doctype html>
<html lang="en">
  <head>
    <meta charset="utf-8">
    <meta name="viewport" content="width=device-width, initial-scale=1">
    <title>Alarms – swarm-gcs</title>
    <link rel="icon" href="/icon.svg" type="image/svg+xml">
    <link rel="stylesheet" href="/base.css">
    <link rel="stylesheet" href="/guide.css">
    <script type="module" src="/guide.js"></script>
  </head>
  <body class="guide">
    <main>
"""
_TAIL: Final = """    </main>
  </body>
</html>
"""


class _Quote(NamedTuple):
    """A text of an alarm: the parts that do not vary, in their order."""

    parts: tuple[str, ...]

    @property
    def weight(self) -> int:
        """Number of characters that do not vary."""
        return sum(map(len, self.parts))

    def is_in(self, text: str) -> bool:
        """Return True if a text has all parts.

        A short quote is a word that other texts may have, too: it counts only as the whole words that a text
        begins with.
        """
        is_short = self.weight < _SHORT
        if is_short and not text.startswith(self.parts[0]):
            return False
        end = 0
        for part in self.parts:
            at = text.find(part, end)
            if at < 0:
                return False
            end = at + len(part)
        return not is_short or _WORD.match(text, end) is None


class _Entry(NamedTuple):
    anchor: str
    quotes: frozenset[_Quote]

    def score(self, text: str) -> int:
        """Return how much of the entry a text has."""
        return sum(quote.weight for quote in self.quotes if quote.is_in(text))


def link_of(text: str) -> str:
    """Return path and anchor of the entry about an alarm; the path alone if no entry quotes it.

    Anybody may ask about any text: only its begin is looked at, and each part of a quote is looked for once.
    """
    text = text[:_MAX_TEXT]
    short = _AGENT.sub("", text)
    score, anchor = max((entry.score(short), entry.anchor) for entry in _entries())
    if score:
        return f"{PATH}#{anchor}"
    return PATH if short == text else f"{PATH}#{_STATUSTEXT}"


@cache
def page() -> str:
    """Return the page as HTML."""
    return _HEAD + "".join(_blocks(_text().splitlines())) + _TAIL


@cache
def _text() -> str:
    return (files("gcs.console") / "alarms.md").read_text(encoding="utf-8")


@cache
def _entries() -> tuple[_Entry, ...]:
    heads = [line[2:].split(" | ")[0] for line in _text().splitlines() if _ALARM_ROW.match(line)]
    return tuple(_Entry(_anchor(head), frozenset(map(_quote, _CODE.findall(head)))) for head in heads)


def _quote(text: str) -> _Quote:
    return _Quote(tuple(text.split("…")))


def _anchor(text: str) -> str:
    """Return the anchor of a heading, or of the head of a table row."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:_MAX_ANCHOR]


def _blocks(lines: Iterable[str]) -> Iterator[str]:
    for kind, group in groupby(lines, _kind):
        content = list(group)
        if kind == "heading":
            for line in content:
                level = len(line) - len(line.lstrip("#"))
                text = line.lstrip("# ")
                yield f'<h{level} id="{_anchor(text)}">{_inline(text)}</h{level}>\n'
        elif kind == "table":
            yield from _table(content)
        elif kind == "text":
            text = " ".join(content)
            mark = f' id="{_STATUSTEXT}"' if "STATUSTEXT" in text else ""
            yield f"<p{mark}>{_inline(text)}</p>\n"


def _kind(line: str) -> str:
    if line.startswith("#"):
        return "heading"
    if line.startswith("|"):
        return "table"
    return "text" if line.strip() else ""


def _table(rows: list[str]) -> Iterator[str]:
    head, _, *body = rows
    names = _cells(head)
    yield "<table><thead><tr>" + "".join(f'<th scope="col">{_inline(one)}</th>' for one in names)
    yield "</tr></thead><tbody>\n"
    for row in body:
        cells = _cells(row)
        content = "".join(f"<td>{_inline(one)}</td>" for one in cells)
        yield f'<tr id="{_anchor(cells[0])}">{content}</tr>\n'
    yield "</tbody></table>\n"


def _cells(row: str) -> list[str]:
    return [cell.strip() for cell in row.strip().strip("|").split(" | ")]


def _inline(text: str) -> str:
    """Return text with code and links; a link to another page of the docs, which is not here, is its text."""
    text = _CODE.sub(r"<code>\1</code>", escape(text, quote=False))
    return _LINK.sub(lambda m: f'<a href="{m[2]}">{m[1]}</a>' if m[2].startswith("#") else m[1], text)
