"""Overrides of a mission file's keys (`--set planning.switch_gain_m=50`); comments stay.

The result is the text of a mission file, which `gcs.config` validates afterwards.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from gcs.errors import ConfigError
from gcs.mistake_codes import MistakeCode

_STEP = re.compile(r"([A-Za-z0-9_-]+)((?:\[\d+\])*)")


def override_keys(text: str, settings: Sequence[str], source: str) -> str:
    """Return the text of a mission file with some keys changed.

    Parameters
    ----------
    text : str
        Mission file, as TOML.
    settings : sequence of str
        ``dotted.key=value`` with a TOML value; any other value counts as text. List indices start at 0:
        ``agents[0].east_m=150``. Missing tables are created.
    source : str
        Name of the file, for errors.

    Raises
    ------
    ConfigError
        When a setting has another form, or its key leads through something that is no table.
    """
    if not settings:
        return text
    try:
        document = tomlkit.parse(text)
    except TOMLKitError as error:
        raise ConfigError(source, "", MistakeCode.INVALID_FILE, f"not valid TOML: {error}") from None
    for setting in settings:
        key, equals, value = (part.strip() for part in setting.partition("="))
        steps = _steps(key)
        if not equals or not value or not steps:
            raise ConfigError(
                "--set or --sweep",
                setting,
                MistakeCode.WRONG_TYPE,
                "expected KEY=VALUE, such as planning.switch_gain_m=50",
            )
        _set(
            document,
            steps,
            value,
            ConfigError(source, key, MistakeCode.UNKNOWN_KEY, "there is no such table or row to change"),
        )
    return tomlkit.dumps(document)


def _steps(key: str) -> list[str | int]:
    """Return the table names and list indices of a dotted key; empty for a malformed key."""
    steps: list[str | int] = []
    for part in key.split("."):
        match = _STEP.fullmatch(part)
        if match is None:
            return []
        steps.append(match[1])
        steps += [int(number) for number in re.findall(r"\d+", match[2])]
    return steps


def _set(document: tomlkit.TOMLDocument, steps: list[str | int], value: str, error: ConfigError) -> None:
    *parents, last = steps
    table: Any = document
    try:
        new = tomlkit.value(value)
    except TOMLKitError:
        new = tomlkit.string(value)
    try:
        for step in parents:
            if isinstance(table, dict) and step not in table:
                table[step] = tomlkit.table()
            table = table[step]
        if isinstance(last, int) and isinstance(table, dict):
            raise error
        table[last] = new
    except (KeyError, IndexError, TypeError, ValueError):
        raise error from None
