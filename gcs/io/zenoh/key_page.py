"""The page of zenoh keys in the documentation, made from `KEYS` and from the rights of the roles.

``python -m gcs.io.zenoh.key_page > docs/zenoh.md`` writes it. A test compares both.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator, Mapping
from enum import Enum
from types import NoneType, UnionType
from typing import Any, Final, Literal, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np

from gcs.io.zenoh.access_control import ROLES, Act, may
from gcs.io.zenoh.key_expressions import KEYS, Key

_HEAD: Final = """# Programs on zenoh: keys and messages

Other programs reach central command over [zenoh](https://zenoh.io), in any language with a zenoh
library. Sensors publish, displays subscribe, operators' programs give orders.

| | |
|---|---|
| endpoint | `links.zenoh` of the mission file, default `tcp/127.0.0.1:7447`; elsewhere [TLS](security.md) |
| mode | peer or client; multicast scouting off |
| encoding | JSON (RFC 8259, UTF-8), one object a message, unless the table says otherwise |
| positions | east and north in metres from the mission's origin |
| times | `t_ns`: nanoseconds since 1970, of the service's clock |
| names | a unit ends the name of each quantity: `speed_m_s` |
| versions | readers must ignore fields that they do not know |

## Keys

Each begins with `swarm/<mission>/`. [Roles](security.md#roles) say who may use it; on the machine of
central command every program may. `service` is `gcs run` or `gcs demo`.
"""
_LIVELINESS: Final = """
`command/<node>` and `bridge/<name>` are liveliness tokens: they exist while the node does.

## Records

`[A]` is a list; of a covariance and of points, a list of rows. `vehicle` is the system id, plus 256
times the MAVLink network. A label of a target is a list of two numbers; its [name](orders.md#names) is
`T<first>.<second>`, or `home` where the first one is -1, `hold` where it is -2.
"""
_EXAMPLE: Final = """
## Example in C

[examples/zenoh_sensor.c](../examples/zenoh_sensor.c) is a sensor that publishes a detection each
second, and prints the notices of the service. With
[zenoh-pico](https://github.com/eclipse-zenoh/zenoh-pico):

```
cc zenoh_sensor.c -DZENOH_LINUX -lzenohpico -o zenoh_sensor
./zenoh_sensor tcp/127.0.0.1:7447 prescribed
```

The tests compile and run it against a service where zenoh-pico is installed, and are skipped
elsewhere. [Publish detections](sensors.md#example) has a sensor in Python.
"""
_SIMPLE: Final = {int: "integer", float: "number", str: "text", bool: "true or false", NoneType: "null"}


def key_page() -> str:
    """Return the page as Markdown."""
    rows = [
        f"| `{key.name}` | {_content(key)} | {key.when} | {_writers(key)} | {_readers(key)} |" for key in KEYS
    ]
    keys = [
        "| key | content | when | written or asked by | read or answered by |",
        "|---|---|---|---|---|",
        *rows,
    ]
    records = ["| record | fields |", "|---|---|"]
    records += [f"| `{name}` | {', '.join(fields)} |" for name, fields in _records().items()]
    return "\n".join([_HEAD, *keys, _LIVELINESS, *records, _EXAMPLE.rstrip("\n")]) + "\n"


def _content(key: Key) -> str:
    return key.content if key.record is None else f"`{key.record.__name__}`"


def _roles(act: Act, key: Key) -> list[str]:
    expression = "swarm/m/" + key.name.replace("<name>", "n").replace("<vehicle>", "1")
    return [role for role in ROLES if role != "command" and may(role, "n", act, expression)]


def _writers(key: Key) -> str:
    roles = _roles("query" if key.is_query else "put", key)
    return ", ".join(roles) or {"truth": "simulated world", "snapshot": "standby"}.get(key.name, "service")


def _readers(key: Key) -> str:
    roles = _roles("answer" if key.is_query else "subscribe", key)
    return ", ".join(roles) or {"events": "standby"}.get(key.name, "service")


def _records() -> Mapping[str, list[str]]:
    """Return the fields of the published records, and of those in them, by name."""
    found: dict[str, list[str]] = {}
    waiting = [key.record for key in KEYS if key.record is not None]
    while waiting:
        record = waiting.pop(0)
        if record.__name__ not in found:
            inner: list[type] = []
            found[record.__name__] = [f"`{name}` {text}" for name, text in _fields(record, inner)]
            waiting += inner
    return found


def _fields(record: type, inner: list[type]) -> Iterator[tuple[str, str]]:
    """Yield the fields of a record; collect the records in it."""
    hints = get_type_hints(record)
    for name in getattr(record, "__struct_fields__", None) or [
        one.name for one in dataclasses.fields(record)
    ]:
        yield name, _type(hints[name], inner)


def _type(hint: Any, inner: list[type]) -> str:
    origin = get_origin(hint)
    parts = get_args(hint)
    if hint in _SIMPLE:
        return _SIMPLE[hint]
    if origin is Literal or (isinstance(hint, type) and issubclass(hint, Enum)):
        return "word"
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(_type(part, inner) for part in parts))
    if origin is tuple:
        return f"[{', '.join(_type(part, inner) for part in parts if part is not ...)}]"
    if origin is np.ndarray or hint is np.ndarray:
        return "[number]"
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return "object"
    if dataclasses.is_dataclass(hint) or (isinstance(hint, type) and issubclass(hint, msgspec.Struct)):
        assert isinstance(hint, type)
        inner.append(hint)
        return f"`{hint.__name__}`"
    raise TypeError(f"a JSON type for {hint}")


if __name__ == "__main__":
    sys.stdout.write(key_page())
