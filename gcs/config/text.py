"""Text of a mission: shipped scenario or file, and the GeoJSON and elevation model that it names."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Final

import msgspec

from gcs.config.schema import FrameTable, MapTable, TerrainTable
from gcs.config.validation import convert
from gcs.errors import ConfigError, TerrainFileError
from gcs.files import read_text as read_file
from gcs.geo import LocalFrame
from gcs.geojson import read_zones
from gcs.mistake_codes import MistakeCode
from gcs.terrain.elevation_text import encode_model, is_model_text

_GEOJSON = re.compile(
    r"""^[ \t]*(?:map\.)?geojson[ \t]*=[ \t]*(?P<value>"(?P<basic>[^"\\\n]*)"|'(?P<literal>[^'\n]*)')""",
    re.MULTILINE,
)
_TERRAIN_FILE = re.compile(
    r"""^[ \t]*(?:terrain\.)?file[ \t]*=[ \t]*(?P<value>"(?P<basic>[^"\\\n]*)"|'(?P<literal>[^'\n]*)')""",
    re.MULTILINE,
)
_MAX_BYTES: Final = 16_000_000
"""Maximum size of a file; a GeoJSON of 100,000 corners has 4 MB."""
_MAX_DEPTH: Final = 50
_KEY_WORD: Final = r"""(?:(?<![\w-])[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_POSITION: Final = re.compile(r"at line (\d+), column \d+\)$")
_MAX_QUOTED: Final = 100
"""Maximum number of characters of a quoted line."""
_DEEP_KEY: Final = re.compile(rf"(?:{_KEY_WORD}\.[ \t]*+){{{_MAX_DEPTH}}}")
"""A dotted key of this many words: parsing takes quadratic time."""


def scenario_names() -> list[str]:
    """Return the names of the shipped scenarios, the simplest first."""
    order = ["deterministic", "prescribed", "random-obstacles", "random-targets", "radars", "swarm-50"]
    found = [
        f.name.removesuffix(".toml")
        for f in (resources.files("gcs") / "scenarios").iterdir()
        if f.name.endswith(".toml")
    ]
    return sorted(found, key=lambda name: (order.index(name) if name in order else len(order), name))


def read_text(scenario: str, settings: Sequence[str] = ()) -> tuple[str, str]:
    """Return (text, source name) of a shipped scenario or of a file.

    The name of a GeoJSON file or of an elevation model is replaced by its content, so that a recording has
    everything.

    Parameters
    ----------
    settings : sequence of str
        Keys to change (`override_keys`).

    Raises
    ------
    ConfigError
        When there is no scenario or readable file of that name, or it names one that cannot be used.
    """
    text, source = _read(scenario)
    path = Path(source)
    if settings:
        from gcs.config.key_overrides import override_keys

        text = override_keys(text, settings, source)
    return _with_elevation(_with_zones(text, path), path), source


def _read(scenario: str) -> tuple[str, str]:
    if re.fullmatch(r"[A-Za-z0-9_-]+", scenario):
        shipped = resources.files("gcs") / "scenarios" / f"{scenario}.toml"
        if shipped.is_file():
            return shipped.read_text(encoding="utf-8"), scenario
    path = Path(scenario)
    if not path.exists():
        raise ConfigError(
            scenario,
            "",
            MistakeCode.NOT_FOUND,
            f"no such file or scenario; shipped scenarios: {', '.join(scenario_names())}",
        )
    return _text_of(path), os.fspath(path)


def _text_of(path: Path) -> str:
    try:
        return read_file(path, _MAX_BYTES)
    except OSError as error:
        raise ConfigError(
            os.fspath(path), "", MistakeCode.NO_ACCESS, f"cannot be read: {error.strerror}"
        ) from None
    except UnicodeDecodeError:
        raise ConfigError(
            os.fspath(path), "", MistakeCode.INVALID_FILE, "is not text: expected a mission file in TOML"
        ) from None


def decode_toml(text: str, source: str) -> dict[str, Any]:
    """Return the plain data of a TOML text.

    Raises
    ------
    ConfigError
        For invalid TOML, or a text that is too long or nested too deeply.
    """
    if len(text) > 3 * _MAX_BYTES:  # of a file and the GeoJSON that it names
        raise ConfigError(
            source, "", MistakeCode.TOO_LARGE, f"expected less than {3 * _MAX_BYTES / 1e6:.0f} MB of TOML"
        )
    if _DEEP_KEY.search(text):
        raise ConfigError(
            source, "", MistakeCode.INVALID_FILE, f"not valid here: a key of more than {_MAX_DEPTH} words"
        )
    try:
        table: dict[str, Any] = msgspec.toml.decode(text)
    except RecursionError:
        raise ConfigError(source, "", MistakeCode.INVALID_FILE, "not valid TOML: nested too deeply") from None
    except (msgspec.DecodeError, ValueError) as error:
        raise ConfigError(
            source, "", MistakeCode.INVALID_FILE, f"not valid TOML: {_with_line(str(error), text)}"
        ) from None
    return table


def _with_line(problem: str, text: str) -> str:
    """Return a parser's error with the line where parsing ended."""
    problem = problem.replace(r"Illegal character '\n'", "expected a closing quote before the line ends")
    problem = problem.replace("Cannot overwrite a value", "the key is there twice")
    lines = text.splitlines() or [""]
    where = _POSITION.search(problem)
    number = min(int(where[1]), len(lines)) if where else len(lines)
    line = lines[number - 1].strip()
    return f"{problem}: `{line[:_MAX_QUOTED]}{'...' if len(line) > _MAX_QUOTED else ''}`"


def _with_zones(text: str, path: Path) -> str:
    """Return a mission file's text with the content of the GeoJSON file that it names."""
    match = _GEOJSON.search(text)
    if match is None:
        return text
    name = match["basic"] or match["literal"] or ""
    if not name or name.lstrip().startswith("{"):
        return text
    file = path.parent / name
    if not file.exists():
        raise ConfigError(os.fspath(path), "map.geojson", MistakeCode.NOT_FOUND, f"no such file: {file}")
    zones = _text_of(file)
    read_zones(zones, os.fspath(file))
    # A JSON string of one line without control characters is a TOML string too.
    compact = msgspec.json.encode(msgspec.json.decode(zones)).decode()
    quoted = msgspec.json.encode(compact).decode()
    return text[: match.start("value")] + quoted + text[match.end("value") :]


def _with_elevation(text: str, path: Path) -> str:
    """Return a mission file's text with the content of the elevation model that it names."""
    if "terrain" not in text:
        return text
    try:
        raw = decode_toml(text, os.fspath(path))
        terrain = convert(raw["terrain"], TerrainTable, "")
        frame = convert(raw["frame"], FrameTable, "")
        area = convert(raw.get("map", {}), MapTable, "")
    except (ConfigError, KeyError):
        return text  # validation refuses this, or there is no such table
    if not terrain.file or is_model_text(terrain.file):
        return text
    local = LocalFrame(frame.lat_deg, frame.lon_deg, frame.alt_msl_m)
    content = _elevation_text(path, terrain, local, (area.width_m, area.height_m))
    quoted = msgspec.json.encode(content).decode()
    for match in _TERRAIN_FILE.finditer(text):
        if (match["basic"] or match["literal"]) == terrain.file:
            replaced = text[: match.start("value")] + quoted + text[match.end("value") :]
            if decode_toml(replaced, os.fspath(path)).get("terrain", {}).get("file") == content:
                return replaced
    return text  # validation refuses this


def _elevation_text(path: Path, terrain: TerrainTable, frame: LocalFrame, size_m: tuple[float, float]) -> str:
    """Return the elevation model of a mission file as text."""
    file = path.parent / terrain.file
    if not file.exists():
        raise ConfigError(os.fspath(path), "terrain.file", MistakeCode.NOT_FOUND, f"no such file: {file}")
    try:
        from gcs.terrain.elevation_file import read_elevation_model
    except ImportError as error:
        raise ConfigError(
            os.fspath(path),
            "terrain.file",
            MistakeCode.NOT_FOUND,
            f"elevation models need {error.name}: pip install 'swarm-gcs[terrain]'",
        ) from None
    try:
        return encode_model(read_elevation_model(file, frame, size_m, terrain.vertical_datum))
    except TerrainFileError as error:
        raise ConfigError(
            os.fspath(path), "terrain.file", MistakeCode.INVALID_FILE, f"{file}: {error}"
        ) from None
