"""Mission files: TOML in, validated settings out.

One file describes a mission: where it lies on Earth, the map, the agents, where targets may appear, how to
track, plan and link. The same file may carry a `[simulation]` table, which only the simulated world reads:
central command keeps it unread, since it holds the truth.

Every mistake raises `ConfigError` with the file, the dotted key and what was expected. The shipped
scenarios are in `gcs/scenarios`; `config/reference.toml` shows every key with its unit, range and default.
"""

from __future__ import annotations

from typing import Any

from gcs.config import contradictions
from gcs.config.mission import Config
from gcs.config.places import local_places, with_local_places
from gcs.config.text import decode_toml, read_text, scenario_names
from gcs.config.validation import Table, convert
from gcs.errors import ConfigError
from gcs.safe_text import printable

__all__ = [
    "Config",
    "Table",
    "convert",
    "decode_toml",
    "load",
    "local_places",
    "parse",
    "read_text",
    "scenario_names",
]


def parse(text: str, source: str) -> Config:
    """Validate the text of a mission file.

    Raises
    ------
    ConfigError
        For broken TOML, unknown or missing keys, values out of range, and contradictions between keys.
    """
    try:
        raw = _shown(decode_toml(text, source))
    except RecursionError:
        raise ConfigError(source, "", "is nested too deeply") from None
    local, mistakes = with_local_places(raw, source)
    try:
        config = convert(local, Config, source)
    except ConfigError as error:
        raise ConfigError.of_all([*mistakes, error]) from None
    if mistakes:
        raise ConfigError.of_all(mistakes)
    contradictions.check(config, source)
    return config


def _shown(value: Any) -> Any:
    """Return plain data whose texts hold no control characters: TOML's escapes would reach terminals."""
    match value:
        case str():
            return printable(value, keep="\n\t")
        case dict():
            return {printable(key): _shown(item) for key, item in value.items()}
        case list():
            return [_shown(item) for item in value]
    return value


def load(scenario: str) -> Config:
    """Read and validate a shipped scenario or a file."""
    return parse(*read_text(scenario))
