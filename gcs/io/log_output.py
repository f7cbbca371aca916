"""Consoles whose output is a log: one JSON object a line, or lines with the priority that journald reads.

The levels are those of notices. A message of a command has the level of its style: yellow is a warning, red
an alarm. Source of the priorities: sd-daemon(3); they are those of syslog(3).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from time import time_ns
from typing import TYPE_CHECKING, Any, Final, TextIO

from rich.console import Console
from rich.text import Text

if TYPE_CHECKING:
    from gcs.model import Level, Notice

_PRIORITIES: Final[Mapping[Level, str]] = {"info": "<6>", "warning": "<4>", "alarm": "<1>"}
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_TABLE_COLUMNS: Final = 200


class LogConsole(Console):
    """Console that writes each message as a line of a log.

    Parameters
    ----------
    stderr : bool
        True: on the standard error output.
    as_json : bool
        True: a JSON object with ``time``, ``t_ns``, ``level``, ``code``, ``subject``, ``parameters`` and
        ``text``. ``code`` is null for a message that is no notice.
    has_priorities : bool
        True: journald's prefix of the priority before each line.
    """

    def __init__(self, *, stderr: bool, as_json: bool, has_priorities: bool) -> None:
        super().__init__(stderr=stderr, force_terminal=False, width=_TABLE_COLUMNS)
        self.as_json = as_json
        self._has_priorities = has_priorities

    def print(self, *objects: Any, parameters: Mapping[str, object] | None = None, **options: Any) -> None:
        """Write a message; its parameters are for programs."""
        with self.capture() as captured:
            super().print(*objects, **options)
        text = "\n".join(line.rstrip() for line in captured.get().splitlines()).strip("\n")
        if not text:
            return
        level = _level(objects, options.get("style"))
        if self.as_json:
            nameless: dict[str, Any] = {"code": None, "level": level, "subject": None}
            self._write_object(
                level, {"t_ns": time_ns(), **nameless, "parameters": parameters or {}, "text": text}
            )
        else:
            self._write(level, text.split("\n"))

    def notice(self, notice: Notice) -> None:
        """Write a notice as a JSON object."""
        from gcs.io.record_json import shown_fields

        self._write_object(notice.level, shown_fields(notice))

    def _write_object(self, level: Level, fields: Mapping[str, Any]) -> None:
        from gcs.io.record_json import encode

        moment = _EPOCH + timedelta(microseconds=fields["t_ns"] // 1000)
        time = moment.isoformat(timespec="microseconds").replace("+00:00", "Z")
        self._write(level, [encode({"time": time, **fields}).decode()])

    def _write(self, level: Level, lines: list[str]) -> None:
        prefix = _PRIORITIES[level] if self._has_priorities else ""
        self.file.write("".join(f"{prefix}{line}\n" for line in lines))
        self.file.flush()


def is_journal(stream: TextIO) -> bool:
    """Return True if systemd connects a stream to its journal."""
    try:
        found = os.fstat(stream.fileno())
    except (OSError, ValueError):
        return False
    return os.environ.get("JOURNAL_STREAM") == f"{found.st_dev}:{found.st_ino}"


def _level(objects: tuple[Any, ...], style: object) -> Level:
    """Return the level of a message by its style, or that of its first words."""
    first = objects[0] if objects else None
    if style is None and isinstance(first, Text):
        style = first.style or (first.spans[0].style if first.spans else "")
    if "red" in str(style):
        return "alarm"
    return "warning" if "yellow" in str(style) else "info"
