"""JSON Schema of the mission file, for editors that complete and check TOML.

Types, ranges and defaults are those that the file is validated by; descriptions are the comments of
`config/reference.toml`. The `[simulation]` table is left open: central command does not read it.

Standard: https://json-schema.org/draft/2020-12/schema.
"""

from __future__ import annotations

import re
from importlib import resources
from typing import Any, Final

import msgspec

from gcs.config.mission_file import Config
from gcs.config.schema import Latitude, Longitude

_ENTRY: Final = re.compile(
    r"^(?:# )?(?:\[\[?(?P<table>[\w.]+)\]\]?|(?P<key>\w+) = (?P<value>.*?))(?:  # (?P<comment>.*))?$"
)
_PLACED: Final = ("AgentTable", "BirthTable")
"""Tables that have a position in metres or in degrees."""


def reference_text() -> str:
    """Return the reference of the mission file: TOML with every key, its default and a comment."""
    return (resources.files("gcs.config") / "reference.toml").read_text(encoding="utf-8")


def mission_file_schema() -> dict[str, Any]:
    """Return the JSON Schema of the mission file."""
    schema: dict[str, Any] = msgspec.json.schema(Config)
    tables = schema["$defs"]
    for name in _PLACED:
        _allow_degrees(tables[name])
    for path, comment in _comments(reference_text()):
        described = _property(tables, path)
        if described is not None and comment:
            described["description"] = comment
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Mission file of swarm-gcs",
        **schema,
    }


def _allow_degrees(table: dict[str, Any]) -> None:
    """Allow `lat_deg` and `lon_deg` in place of `east_m` and `north_m` (`gcs.config.places`)."""
    metres = ["east_m", "north_m"]
    degrees = {"lat_deg": Latitude, "lon_deg": Longitude}
    table["properties"] |= {name: msgspec.json.schema(kind) for name, kind in degrees.items()}
    table["required"] = [name for name in table["required"] if name not in metres]
    table["oneOf"] = [{"required": metres}, {"required": list(degrees)}]


def _comments(reference: str) -> list[tuple[list[str], str]]:
    """Return the path of each key and table of the reference, with its comment."""
    table: list[str] = []
    found = []
    for entry in filter(None, map(_ENTRY.match, reference.splitlines())):
        if entry["table"]:
            table = entry["table"].split(".")
        path = [*table, entry["key"]] if entry["key"] else table
        found.append((path, entry["comment"] or ""))
    return found


def _property(tables: dict[str, Any], path: list[str]) -> dict[str, Any] | None:
    """Return the schema of a key; None if the schema does not have it."""
    here: dict[str, Any] = tables["Config"]
    found: dict[str, Any] | None = None
    for name in path:
        found = here.get("properties", {}).get(name) or here.get("additionalProperties") or None
        if not isinstance(found, dict):
            return None
        here = _table(tables, found)
    return found


def _table(tables: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    """Return the table that a schema refers to, directly, in a list or as one of several kinds."""
    inner = [schema, schema.get("items", {}), *schema.get("anyOf", [])]
    names = [part["$ref"].rpartition("/")[2] for part in inner if "$ref" in part]
    return tables[names[0]] if names else schema
