"""A user would set a key that the reference of the mission file does not show, or shows otherwise."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, get_args, get_origin

import msgspec
import pytest

from gcs.config import Config, Table, load
from sim_vehicles.world import scenario
from sim_vehicles.world.scenario import Simulation

FILE = Path(__file__).parent.parent / "config" / "reference.toml"
ENTRY = re.compile(r"^(# )?(\[\[?(?P<table>[\w.]+)\]\]?|(?P<key>\w+) = (?P<value>.*?))(  # (?P<note>.*))?$")


def tables(struct: type[Table], path: str) -> dict[str, type[Table]]:
    """Map the path of each table of a mission file to its struct."""
    found = {path: struct}
    for field in msgspec.structs.fields(struct):
        outer = [field.type, *get_args(field.type)]
        for part in [*outer, *(inner for kind in outer for inner in get_args(kind))]:
            if isinstance(part, type) and issubclass(part, Table):
                name = f"{field.encode_name}.NAME" if get_origin(field.type) is dict else field.encode_name
                found |= tables(part, f"{path}.{name}".lstrip("."))
    return found


def shown() -> dict[str, dict[str, tuple[str, str]]]:
    """Map each table of the file to its keys: the value as text, and its comment."""
    entries: dict[str, dict[str, tuple[str, str]]] = {"": {}}
    table = ""
    for line in FILE.read_text(encoding="utf-8").splitlines():
        match = ENTRY.match(line)
        if match is None:
            continue
        if match["table"]:
            table = match["table"]
            entries[table] = {}
        else:
            entries[table][match["key"]] = (match["value"], match["note"] or "")
    return entries


# Tables that are written as one value, and lists that repeat a table.
INLINE = {"simulation.death.prescribed", "simulation.more_sensors", "links.mavlink"}
ALL = {**tables(Config, ""), **tables(Simulation, "simulation")}


@pytest.mark.parametrize("path", [path for path in ALL if path not in INLINE])
def test_every_key_is_in_the_reference_with_its_default(path: str) -> None:
    keys = shown()[path]
    for field in msgspec.structs.fields(ALL[path]):
        name = field.encode_name
        if {f"{path}.{name}".lstrip("."), f"{path}.{name}.NAME".lstrip(".")} & shown().keys():
            continue
        if f"{path}.{name}" in INLINE and name not in keys:
            continue
        assert name in keys, f"{path}.{name} is missing"
        value, note = keys[name]
        if field.required:
            assert note.startswith("required"), f"{path}.{name} is required"
        elif field.default is not msgspec.NODEFAULT and field.default is not None:
            expected: Any = field.default
            if path != "fence.areas" or name != "corners_deg":
                assert toml_value(value) == expected, f"{path}.{name}"


def toml_value(text: str) -> Any:
    return msgspec.toml.decode(f"value = {text}")["value"]


def test_the_reference_names_no_key_that_does_not_exist() -> None:
    for path, keys in shown().items():
        known = {field.encode_name for field in msgspec.structs.fields(ALL[path])}
        assert set(keys) - known == set()


def test_the_reference_is_a_mission_file() -> None:
    config = load(str(FILE))
    assert config.name == "reference"
    assert scenario.load(str(FILE)).simulation.forward_speed_m_s == 15.0


def test_the_reference_explains_every_key() -> None:
    notes: dict[str, str] = {}
    for keys in shown().values():
        for key, (_, note) in keys.items():
            notes.setdefault(key, note)
    assert [key for key, note in notes.items() if not note] == []
