"""Mission files: TOML in, validated settings out.

One file describes a mission: frame, map, agents, birth components, tracking, planning and links. Its
`[simulation]` table is for the simulated world only; central command does not read it.

Each mistake raises `ConfigError` with the file, the dotted key and the expected value. Shipped scenarios are
in `gcs/scenarios`. `config/reference.toml` lists every key with its unit, range and default.

- `schema`: the tables with their keys, ranges and defaults; `airframe`: how vehicles fly.
- `mission_file`: the whole file. `text`, `validation`: TOML and error messages.
- `places`: positions in degrees; `contradictions`: checks across keys; `key_overrides`: changed keys.
"""

from __future__ import annotations

from typing import Any

from gcs.config import contradictions
from gcs.config.heights import with_altitude_above_home
from gcs.config.mission_file import Config
from gcs.config.places import local_places, with_local_places
from gcs.config.text import decode_toml, read_text, scenario_names
from gcs.config.validation import Table, convert
from gcs.errors import ConfigError
from gcs.mistake_codes import MistakeCode
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
        For invalid TOML, unknown or missing keys, values out of range, and contradictions between keys.
    """
    if not text.strip():
        raise ConfigError(
            source, "", MistakeCode.INVALID_FILE, "is empty: `gcs init` writes a first mission file"
        )
    try:
        raw = _printable(decode_toml(text, source))
    except RecursionError:
        raise ConfigError(source, "", MistakeCode.INVALID_FILE, "is nested too deeply") from None
    local, mistakes = with_local_places(raw, source)
    local, more_mistakes = with_altitude_above_home(local, source)
    mistakes += more_mistakes
    try:
        config = convert(local, Config, source)
    except ConfigError as error:
        raise ConfigError.of_all([*mistakes, error]) from None
    if mistakes:
        raise ConfigError.of_all(mistakes)
    contradictions.check(config, source)
    return config


def _printable(value: Any) -> Any:
    """Return plain data without control characters in texts, which would reach terminals."""
    match value:
        case str():
            return printable(value, keep="\n\t")
        case dict():
            return {printable(key): _printable(item) for key, item in value.items()}
        case list():
            return [_printable(item) for item in value]
    return value


def load(scenario: str) -> Config:
    """Read and validate a shipped scenario or a file."""
    return parse(*read_text(scenario))
