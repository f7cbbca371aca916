"""The page of zenoh keys in the documentation.

It is made from `KEYS` of `gcs.io.zenoh.key_expressions` and from the rights of the roles.

``python tests/helpers/key_page.py > docs/zenoh.md`` writes it. A test compares both.
"""

from __future__ import annotations

import sys
from typing import Final

from gcs.io.zenoh.access_control import ROLES, Act, may
from gcs.io.zenoh.key_expressions import KEYS, Key

_HEAD: Final = """# Keys on zenoh

Other programs reach central command over [zenoh](https://zenoh.io), in any language with a zenoh
library. Sensors publish, displays subscribe, operators' programs give orders.

| | |
|---|---|
| endpoint | `links.zenoh` of the mission file, default `tcp/127.0.0.1:7447`; elsewhere [TLS](security.md) |
| `gcs demo` | listens on a free port of this machine, and prints it |
| mode | peer or client; multicast scouting off |
| encoding | JSON (RFC 8259, UTF-8), one object a [message](messages.md), unless the table says otherwise |
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
"""
_EXAMPLE: Final = """
## Example in C

[examples/zenoh_sensor.c](../examples/zenoh_sensor.c) is a sensor that publishes a detection each
second, and prints the notices of the service. It needs
[zenoh-pico](https://github.com/eclipse-zenoh/zenoh-pico):

```
git clone --depth 1 --branch 1.9.0 https://github.com/eclipse-zenoh/zenoh-pico
cmake -S zenoh-pico -B zenoh-pico/build -DBUILD_SHARED_LIBS=ON -DBUILD_EXAMPLES=OFF -DBUILD_TESTING=OFF
cmake --build zenoh-pico/build && sudo cmake --install zenoh-pico/build && sudo ldconfig
```

In the folder `examples`, with `gcs run prescribed` in another terminal, or with the endpoint that
`gcs demo` prints:

```
cc zenoh_sensor.c -DZENOH_LINUX -lzenohpico -o zenoh_sensor
./zenoh_sensor tcp/127.0.0.1:7447 prescribed
```

`gcs status` lists the sensor `radar-c` then. The tests compile and run it where zenoh-pico is
installed. [Publish detections](sensors.md#example) has a sensor in Python.
"""


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
    return "\n".join([_HEAD, *keys, _LIVELINESS.rstrip("\n"), _EXAMPLE.rstrip("\n")]) + "\n"


def _content(key: Key) -> str:
    if key.record is None:
        return key.content
    name = key.record.__name__
    return f"[{name}](messages.md#{name.lower()})"


def _roles(act: Act, key: Key) -> list[str]:
    expression = "swarm/m/" + key.name.replace("<name>", "n").replace("<vehicle>", "1")
    return [role for role in ROLES if role != "command" and may(role, "n", act, expression)]


def _writers(key: Key) -> str:
    roles = _roles("query" if key.is_query else "put", key)
    return ", ".join(roles) or {"truth": "simulated world", "snapshot": "standby"}.get(key.name, "service")


def _readers(key: Key) -> str:
    roles = _roles("answer" if key.is_query else "subscribe", key)
    return ", ".join(roles) or {"events": "standby"}.get(key.name, "service")


if __name__ == "__main__":
    sys.stdout.write(key_page())
