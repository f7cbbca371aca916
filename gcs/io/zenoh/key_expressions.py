"""Key expressions on zenoh. `KEYS` is the table of all; those of a mission begin with ``swarm/<mission>``.

`tests/helpers/key_page.py` makes the page in the documentation from it. Payloads are the JSON of
`gcs.io.record_json`; scans and orders have own forms (`gcs.io.zenoh.scans`, `gcs.io.zenoh.order_messages`),
consoles theirs (`gcs.console.remote.messages`). Who may use which key: `gcs.io.zenoh.access_control`.
"""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from gcs.model import (
    AgentStatus,
    Effect,
    LaggedPicture,
    MissionEnded,
    Notice,
    OrderAnswer,
    Picture,
    Plan,
    Proposal,
    SwarmStatus,
    Truth,
    UploadReport,
)

SENSOR_NAME: Final = r"^[A-Za-z0-9_-]{1,64}$"


class Key(NamedTuple):
    """A key of a mission."""

    name: str
    """What follows ``swarm/<mission>/``; angle brackets stand for one part."""
    content: str
    """What is published there, or asked, with its form; empty for the JSON of `record`."""
    when: str
    """When it is published, or what it is for."""
    record: type | None = None
    """Record of `gcs.model` whose JSON is published."""
    is_query: bool = False
    """True if it is asked, False if it is published."""


_INTERNAL: Final = "MessagePack; may change with each version"
KEYS: Final = (
    Key("sensor/<name>/scan", "JSON: a [scan](sensors.md#payload)", "each scan of a sensor"),
    Key("order", "JSON: an [order](orders.md#on-the-wire)", "an operator's order"),
    Key("answer", "", "acceptance and result of an order", OrderAnswer),
    Key("status_request", "JSON: the order `status`", "a request, from viewers too"),
    Key("status", "", "the answer to the order `status`", SwarmStatus),
    Key("picture/agents", "", "tracks of agents after each scan", Picture),
    Key("picture/targets", "", "tracks of targets after each scan", Picture),
    Key(
        "picture/agents_lagged",
        "",
        "estimates of agents some scans late, with `tracking.lag_scans`",
        LaggedPicture,
    ),
    Key(
        "picture/targets_lagged",
        "",
        "estimates of targets some scans late, with `tracking.lag_scans`",
        LaggedPicture,
    ),
    Key("plan", "", "each plan; `changed` names the vehicles that get a new mission", Plan),
    Key("proposal", "", "a plan that waits for confirmation; without routes: none waits", Proposal),
    Key("upload", "", "end of a mission upload", UploadReport),
    Key("agent_status", "", "change of an agent's status", AgentStatus),
    Key("notice", "", "each notice; `level` and `text` are added to the record", Notice),
    Key("ended", "", "end of the mission", MissionEnded),
    Key("truth", "", "true states, from a simulated world only", Truth),
    Key("console/feed", _INTERNAL, "what is new, for a console", is_query=True),
    Key("console/vehicle/<vehicle>", _INTERNAL, "details of a vehicle, for a console", is_query=True),
    Key("events", _INTERNAL, "events of command, for a standby"),
    Key("snapshot", _INTERNAL, "state of command, for a standby", is_query=True),
    Key("bridge/<name>/up", _INTERNAL, "frames from vehicles"),
    Key("bridge/<name>/down", _INTERNAL, "frames to vehicles"),
    Key("bridge/<name>/status", _INTERNAL, "state of the bridge's links"),
    Key("bridge/<name>/lease", _INTERNAL, "permit to send, for command", is_query=True),
)
_EFFECT_KEYS: Final[dict[type, str]] = {
    key.record: key.name for key in KEYS if key.record not in (None, Picture, LaggedPicture, Truth)
}


def scan_key(mission: str, sensor: str) -> str:
    """Return the key on which a sensor publishes its scans."""
    return f"swarm/{mission}/sensor/{sensor}/scan"


def sensor_of(key: str) -> str:
    """Return the name of the sensor that publishes on a scan's key; empty if there is none."""
    parts = key.split("/")
    is_scan = len(parts) == 5 and parts[4] == "scan" and re.match(SENSOR_NAME, parts[3])
    return parts[3] if is_scan else ""


def sensor_scan_keys(mission: str) -> str:
    """Return the key expression of the scans of every sensor of a mission."""
    return scan_key(mission, "*")


def truth_key(mission: str) -> str:
    """Return the key on which a simulated world publishes the truth."""
    return f"swarm/{mission}/truth"


def bridge_key(mission: str, bridge: str, what: str) -> str:
    """Return a key between command and a bridge; `what` is "up", "down", "status" or "lease"."""
    return f"swarm/{mission}/bridge/{bridge}/{what}"


def events_key(mission: str) -> str:
    """Return the key of the events of a command, for a standby."""
    return f"swarm/{mission}/events"


def snapshot_key(mission: str) -> str:
    """Return the key on which a standby asks for the state."""
    return f"swarm/{mission}/snapshot"


def order_key(mission: str) -> str:
    """Return the key of orders."""
    return f"swarm/{mission}/order"


def answer_key(mission: str) -> str:
    """Return the key of answers to orders."""
    return f"swarm/{mission}/answer"


def status_request_key(mission: str) -> str:
    """Return the key of requests for the status: who may see, and not order, uses it."""
    return f"swarm/{mission}/status_request"


def status_key(mission: str) -> str:
    """Return the key of answers to the order ``status``."""
    return f"swarm/{mission}/status"


def console_feed_key(mission: str) -> str:
    """Return the key on which consoles ask a service for what is new."""
    return f"swarm/{mission}/console/feed"


def console_vehicle_key(mission: str, vehicle: int | str) -> str:
    """Return the key on which consoles ask for the details of a vehicle; "*" for those of any."""
    return f"swarm/{mission}/console/vehicle/{vehicle}"


def mission_of(key: str) -> str:
    """Return the mission of a key."""
    return key.split("/")[1]


def effect_key(mission: str, effect: Effect) -> str:
    """Return the key on which the service publishes an effect.

    Raises
    ------
    TypeError
        For a `Send`: its bytes go to a vehicle, not to zenoh.
    """
    if isinstance(effect, Picture):
        return f"swarm/{mission}/picture/{effect.kind}"
    if isinstance(effect, LaggedPicture):
        return f"swarm/{mission}/picture/{effect.kind}_lagged"
    name = _EFFECT_KEYS.get(type(effect))
    if name is None:
        raise TypeError(f"{type(effect).__name__} is not published")
    return f"swarm/{mission}/{name}"
