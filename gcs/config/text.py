"""Where the text of a mission comes from: shipped scenarios, files, and the GeoJSON beside them."""

from __future__ import annotations

import os
import re
from importlib import resources
from pathlib import Path

import msgspec

from gcs.errors import ConfigError
from gcs.geojson import read_zones

_GEOJSON = re.compile(
    r"""^[ \t]*(?:map\.)?geojson[ \t]*=[ \t]*(?P<value>"(?P<basic>[^"\\\n]*)"|'(?P<literal>[^'\n]*)')""",
    re.MULTILINE,
)


def scenario_names() -> list[str]:
    """Names of the shipped scenarios, in the order in which they build on one another."""
    order = ["deterministic", "prescribed", "random-obstacles", "random-targets", "radars", "swarm-50"]
    found = [
        f.name.removesuffix(".toml")
        for f in (resources.files("gcs") / "scenarios").iterdir()
        if f.name.endswith(".toml")
    ]
    return sorted(found, key=lambda name: (order.index(name) if name in order else len(order), name))


def read_text(scenario: str) -> tuple[str, str]:
    """Return (text, source name) of a shipped scenario or of a file.

    A GeoJSON file that the mission file names is read as well, and its content put in place of its name: what
    is recorded of a run holds everything.

    Raises
    ------
    ConfigError
        When there is neither a scenario nor a readable file of that name.
    """
    if re.fullmatch(r"[A-Za-z0-9_-]+", scenario):
        shipped = resources.files("gcs") / "scenarios" / f"{scenario}.toml"
        if shipped.is_file():
            return shipped.read_text(encoding="utf-8"), scenario
    path = Path(scenario)
    if not path.is_file():
        raise ConfigError(
            scenario, "", f"no such file or scenario; shipped scenarios: {', '.join(scenario_names())}"
        )
    return _with_zones(_text_of(path), path), os.fspath(path)


def _text_of(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(os.fspath(path), "", f"cannot be read as text: {error}") from None


def _with_zones(text: str, path: Path) -> str:
    """Return a mission file's text with the content of the GeoJSON file that it names."""
    match = _GEOJSON.search(text)
    if match is None:
        return text
    name = match["basic"] or match["literal"] or ""
    if not name or name.lstrip().startswith("{"):
        return text
    file = path.parent / name
    if not file.is_file():
        raise ConfigError(os.fspath(path), "map.geojson", f"no such file: {file}")
    zones = _text_of(file)
    read_zones(zones, os.fspath(file))
    # A JSON string of one line without control characters is a TOML string too.
    compact = msgspec.json.encode(msgspec.json.decode(zones)).decode()
    quoted = msgspec.json.encode(compact).decode()
    return text[: match.start("value")] + quoted + text[match.end("value") :]
