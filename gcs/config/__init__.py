"""Mission files: TOML in, validated settings out.

One file describes a mission: where it lies on Earth, the map, the agents, where targets may appear, how to
track, plan and link. The same file may carry a `[simulation]` table, which only the simulated world reads:
central command keeps it unread, since it holds the truth.

Every mistake raises `ConfigError` with the file, the dotted key and what was expected. The shipped
scenarios in `gcs/scenarios/` show every key with its unit, range and default.
"""

from __future__ import annotations

import msgspec

from gcs.config import contradictions
from gcs.config.mission import Config
from gcs.config.places import local_places, with_local_places
from gcs.config.text import read_text, scenario_names
from gcs.config.validation import Table, convert
from gcs.errors import ConfigError

__all__ = ["Config", "Table", "convert", "load", "local_places", "parse", "read_text", "scenario_names"]


def parse(text: str, source: str) -> Config:
    """Validate the text of a mission file.

    Raises
    ------
    ConfigError
        For broken TOML, unknown or missing keys, values out of range, and contradictions between keys.
    """
    try:
        raw = msgspec.toml.decode(text)
    except (msgspec.DecodeError, ValueError) as error:
        raise ConfigError(source, "", f"not valid TOML: {error}") from None
    config = convert(with_local_places(raw, source), Config, source)
    contradictions.check(config, source)
    return config


def load(scenario: str) -> Config:
    """Read and validate a shipped scenario or a file."""
    return parse(*read_text(scenario))
