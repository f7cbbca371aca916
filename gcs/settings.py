"""Settings laid over a mission file: ``planning.switch_gain_m=50`` changes one key, comments stay.

The result is the text of a mission file again, so that what is flown, checked and recorded is one and the
same. Validation is `gcs.config`'s, afterwards.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from gcs.errors import ConfigError

_STEP = re.compile(r"([A-Za-z0-9_-]+)((?:\[\d+\])*)")


def with_settings(text: str, settings: Sequence[str], source: str) -> str:
    """Return the text of a mission file with ``key=value`` settings laid over it.

    Parameters
    ----------
    text : str
        TOML.
    settings : sequence of str
        ``dotted.key=value`` with a TOML value; a value that is none is taken as a string. Rows of a list are
        counted from 0: ``agents[0].east_m=150``. A table that is not there is made.
    source : str
        Name of the file, for errors.

    Raises
    ------
    ConfigError
        When a setting is not of that form, or its key leads through something that is no table.
    """
    if not settings:
        return text
    try:
        document = tomlkit.parse(text)
    except TOMLKitError as error:
        raise ConfigError(source, "", f"not valid TOML: {error}") from None
    for setting in settings:
        key, value = split_setting(setting)
        _lay(document, key, value, source)
    return tomlkit.dumps(document)


def split_setting(setting: str) -> tuple[str, str]:
    """Return key and value of ``key=value``.

    Raises
    ------
    ConfigError
        When it is not of that form.
    """
    key, equals, value = setting.partition("=")
    if not equals or not value.strip() or not _steps(key.strip()):
        raise ConfigError("settings", setting, "expected KEY=VALUE, such as planning.switch_gain_m=50")
    return key.strip(), value.strip()


def _steps(key: str) -> list[str | int]:
    """Names and row numbers that lead to a key; empty when it is none."""
    steps: list[str | int] = []
    for part in key.split("."):
        match = _STEP.fullmatch(part)
        if match is None:
            return []
        steps.append(match[1])
        steps += [int(number) for number in re.findall(r"\d+", match[2])]
    return steps


def _lay(document: tomlkit.TOMLDocument, key: str, value: str, source: str) -> None:
    *way, last = _steps(key)
    place: Any = document
    for step in way:
        if isinstance(place, dict) and step not in place:
            place[step] = tomlkit.table()
        place = _inside(place, step, key, source)
    if isinstance(last, int) or not isinstance(place, dict):
        _inside(place, last, key, source)
    place[last] = _value(value)


def _inside(place: Any, step: str | int, key: str, source: str) -> Any:
    try:
        return place[step]
    except (KeyError, IndexError, TypeError, ValueError):
        raise ConfigError(source, key, f"there is no {step!r} here to change") from None


def _value(text: str) -> Any:
    try:
        return tomlkit.value(text)
    except TOMLKitError:
        return text
