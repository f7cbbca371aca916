"""Key expressions on zenoh; those of a mission begin with ``swarm/<mission>``.

=============================================  ==================================================
``swarm/<mission>/sensor/<name>/scan``         a sensor's scan (``docs/sensors.md``), for the service
``swarm/<mission>/picture/agents``, ``targets``  `Picture`, after each scan
``swarm/<mission>/picture/<kind>_lagged``      `LaggedPicture`, with ``tracking.lag_scans`` above 0
``swarm/<mission>/plan``                       `Plan`
``swarm/<mission>/upload``                     `UploadReport`
``swarm/<mission>/agent_status``               `AgentStatus`
``swarm/<mission>/notice``                     `Notice`, with its level and text
``swarm/<mission>/ended``                      `MissionEnded`
``swarm/<mission>/order``                      an operator's order (``docs/orders.md``), for the service
``swarm/<mission>/answer``                     `OrderAnswer`
``swarm/<mission>/status_request``             the order ``status``, from viewers too
``swarm/<mission>/status``                     `SwarmStatus`, the answer to the order ``status``
``swarm/<mission>/proposal``                   `Proposal`, a plan that waits for confirmation
``swarm/<mission>/truth``                      `Truth`, from a simulated world only
``swarm/<mission>/console/feed``               query of a console: what is new (`gcs.console.remote`)
``swarm/<mission>/console/vehicle/<vehicle>``  query of a console: details of a vehicle
``swarm/<mission>/events``, ``snapshot``       from command to a standby (`gcs.io.cluster.event_log`)
``swarm/<mission>/bridge/<name>/up``, ...      between command and a bridge (`gcs.io.cluster.bridge_messages`)
=============================================  ==================================================

Payloads are the JSON of `gcs.io.records`; scans and orders have own forms (`gcs.io.zenoh.scans`,
`gcs.io.zenoh.order_messages`), consoles theirs (`gcs.console.remote.messages`). Who may use which key:
`gcs.io.zenoh.access_control`.
"""

from __future__ import annotations

import re
from typing import Final

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
    UploadReport,
)

SENSOR_NAME: Final = r"^[A-Za-z0-9_-]{1,64}$"
_EFFECT_KEYS: Final[dict[type, str]] = {
    Plan: "plan",
    UploadReport: "upload",
    AgentStatus: "agent_status",
    Notice: "notice",
    MissionEnded: "ended",
    OrderAnswer: "answer",
    SwarmStatus: "status",
    Proposal: "proposal",
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
