"""The page of alarms, made from the table of notices and shown by the console without internet.

The row of each notice has its code as an anchor.
"""

from __future__ import annotations

import re
from functools import cache
from html import escape
from typing import Final

from gcs.model import NoticeCode
from gcs.report.alarms_page import meaning, sections, shown_text

PATH: Final = "/alarms"
"""Path of the page on the console."""
_CODE: Final = re.compile(r"`([^`]+)`")
_BOLD: Final = re.compile(r"\*\*([^*]+)\*\*")
_LINK: Final = re.compile(r"\[([^\]]+)\]\([^)]+\)")
_HEAD: Final = """<!doctype html>
<html lang="en">
  <head>
    <meta charset="utf-8">
    <meta name="viewport" content="width=device-width, initial-scale=1">
    <title>Alarms – swarm-gcs</title>
    <link rel="icon" href="/icon.svg" type="image/svg+xml">
    <link rel="stylesheet" href="/base.css">
    <link rel="stylesheet" href="/guide.css">
    <script type="module" src="/guide_theme.js"></script>
  </head>
  <body class="guide">
    <main>
      <h1>Alarms: what each one means, and what to do</h1>
"""
_TABLE: Final = """<table><thead><tr><th scope="col">notice</th><th scope="col">text</th>
<th scope="col">meaning</th><th scope="col">action</th></tr></thead><tbody>
"""
_TAIL: Final = """    </main>
  </body>
</html>
"""


@cache
def page() -> str:
    """Return the page as HTML."""
    parts = [_HEAD]
    for section, codes in sections():
        parts.append(f"<h2>{escape(section.title)}</h2>\n")
        if section.text:
            parts.append(f"<p>{_inline(section.text)}</p>\n")
        parts += [_TABLE, *map(_row, codes), "</tbody></table>\n"]
    parts.append(_TAIL)
    return "".join(parts)


def _row(code: NoticeCode) -> str:
    cells = (f"{code.level} `{code}`", f"`{shown_text(code)}`", meaning(code), code.action)
    content = "".join(f"<td>{_inline(one)}</td>" for one in cells)
    return f'<tr id="{code}">{content}</tr>\n'


def _inline(text: str) -> str:
    """Return Markdown in a line as HTML; a link to a page of the documentation is its text."""
    text = _CODE.sub(r"<code>\1</code>", escape(text, quote=False))
    return _LINK.sub(r"\1", _BOLD.sub(r"<strong>\1</strong>", text))
