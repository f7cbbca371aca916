"""Check of a whole state: values that no service can have written.

A decoded state has the right types (`gcs.core.snapshot`). Its values may still be wrong: a file on a disk can
be changed, also with a right checksum. A wrong value would end the service in flight, later. So a state is
checked before an engine continues from it:

* numbers: finite, within the range of their use, times within `_MAX_T_NS`;
* arrays: finite, and of the shape that `_SHAPES` names;
* messages and sequence numbers: they can be packed into a frame;
* routes, missions and uploads: of the vehicle under whose number they are.

The posteriors of the trackers have a check of their own (`gcs.tracking.glmb.filter_state`).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Collection, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.replanning.replanning_state import AgentRoutes
from gcs.core.state import Agent, State
from gcs.core.tasking.tasking_state import OnboardMission
from gcs.mavlink.autopilots import profile_of
from gcs.mavlink.frames.codec import Encoder
from gcs.model import NS_PER_S, Route
from gcs.tracking.glmb.filter_state import GlmbState

_MAX_T_NS: Final = 4_102_444_800 * NS_PER_S
"""The year 2100."""
_MAX_NUMBER: Final = 1e15
_MAX_INTEGER: Final = 2**63
_MAX_NAME: Final = 4096
_BYTE: Final = range(256)
_BYTES: Final = frozenset({"sequence", "sequences", "mission_type", "to"})
"""Fields that go into one byte of a frame; in `authority` a sequence number of -1 is none."""
_ANY_FLOAT: Final = frozenset(
    {"param1", "param2", "param3", "param4", "min_round_trip_s", "values", "value", "before", "answer"}
)
"""Fields that may be no finite number: parameters of items and of vehicles, and the least of no values."""
_RECEIVED: Final = ".received."
"""Part of the path to mission items as a vehicle sent them, before they are compared."""
_POINTS: Final = ("k", 2)
_SHAPES: Final[Mapping[str, tuple[int | str, ...]]] = {
    "points_m": _POINTS,
    "return_m": ("n", 2),
    "z_m": ("n", 2),
    "noise_cov_m2": (2, 2),
}
"""By field: k is at least 1, n at least 0."""
_encoder: Final = Encoder()


def check_state(state: State) -> None:
    """Check the values of a state.

    Raises
    ------
    ValueError
        With the field that is not valid.
    """
    _check_value(state, "state", "")
    for vehicle, agent in state.agents.items():
        _check_agent(vehicle, agent)
    trackers = state.perception.trackers
    _require((trackers.targets.filter.t_ns or 0) <= max(0, trackers.measured_t_ns), "trackers.targets.t_ns")
    tasking = state.tasking
    for vehicle, queued in tasking.queue.items():
        _require(vehicle in state.agents, "tasking.queue")
        _check_route(vehicle, queued.route, "tasking.queue")
    for vehicle, upload in tasking.uploads.items():
        _require(vehicle in state.agents and upload.state.vehicle == vehicle, "tasking.uploads")
        _check_mission(vehicle, upload.onboard, "tasking.uploads")
        _require(profile_of(upload.state.autopilot) is not None, "tasking.uploads.autopilot")
    for link, window in tasking.windows.items():
        active = sum(upload.link == link for upload in tasking.uploads.values())
        _require(window.active == active and window.max_window >= 1, "tasking.windows")
        _require(1 <= window.window <= window.max_window, "tasking.windows")
    links = {upload.link for upload in tasking.uploads.values()}
    _require(links <= tasking.windows.keys(), "tasking.uploads.link")
    _require(set(tasking.first_legs) <= state.agents.keys(), "tasking.first_legs")


def _check_agent(vehicle: int, agent: Agent) -> None:
    tasking = agent.tasking
    audit = agent.authority.audit
    _check_mission(vehicle, tasking.onboard, "tasking.onboard")
    _check_mission(vehicle, tasking.before_boot, "tasking.before_boot")
    if audit is not None:
        _check_mission(vehicle, audit.mission, "authority.audit.mission")
    _check_routes(vehicle, agent.routes)
    _require(agent.perception.status.vehicle == vehicle, "perception.status.vehicle")


def _check_routes(vehicle: int, routes: AgentRoutes) -> None:
    for one in fields(routes):
        route = getattr(routes, one.name)
        if isinstance(route, Route):
            _check_route(vehicle, route, f"routes.{one.name}")


def _check_mission(vehicle: int, mission: OnboardMission | None, name: str) -> None:
    if mission is not None:
        _check_route(vehicle, mission.route, name)
        _require(len(mission.items) > 0, f"{name}.items")
        _require(0 <= mission.first_point <= len(mission.items), f"{name}.first_point")


def _check_route(vehicle: int, route: Route, name: str) -> None:
    _require(route.vehicle == vehicle, f"{name}.route.vehicle")


# ---------------------------------------------------------------- values


def _check_value(value: Any, path: str, name: str) -> None:
    """Check a value and all that it contains; `name` is the field that it is in."""
    if value is None or isinstance(value, bool | bytes | Enum | GlmbState):
        return
    if isinstance(value, float):
        is_any = name in _ANY_FLOAT or _RECEIVED in path
        _require(is_any or (math.isfinite(value) and abs(value) <= _MAX_NUMBER), path)
    elif isinstance(value, int):
        _check_integer(value, path, name)
    elif isinstance(value, str):
        _require(len(value) <= _MAX_NAME, path)
    elif isinstance(value, np.ndarray):
        _check_array(value, path, name)
    elif isinstance(value, dialect.MAVLink_message):
        _check_message(value, path)
    elif is_dataclass(value):
        for one in fields(value):
            _check_value(getattr(value, one.name), f"{path}.{one.name}", one.name)
    elif isinstance(value, Mapping):
        for key, one in value.items():
            _check_value(key, path, "")
            _check_value(one, path, name)
    elif hasattr(value, "_fields"):  # a named tuple
        for key, one in zip(value._fields, value, strict=True):
            _check_value(one, f"{path}.{key}", key)
    elif isinstance(value, Collection):
        for one in value:
            _check_value(one, path, name)


def _check_integer(value: int, path: str, name: str) -> None:
    if name in _BYTES:
        _require(value in _BYTE or (value == -1 and "authority" in path), path)
    elif name.endswith("t_ns"):
        _require(-1 <= value <= _MAX_T_NS, path)
    else:
        _require(-_MAX_INTEGER <= value < _MAX_INTEGER, path)


def _check_array(value: np.ndarray[Any, Any], path: str, name: str) -> None:
    wanted = _SHAPES.get(name)
    if wanted is not None:
        _require(value.ndim == len(wanted), path)
        for size, one in zip(value.shape, wanted, strict=True):
            _require(size == one if isinstance(one, int) else size >= int(one == "k"), path)
    if value.dtype.kind == "f":
        _require(bool(np.isfinite(value).all() and (np.abs(value) <= _MAX_NUMBER).all()), path)


def _check_message(value: dialect.MAVLink_message, path: str) -> None:
    try:
        _encoder.pack(value, 0)
    except (struct.error, TypeError, ValueError, OverflowError, AttributeError):
        raise ValueError(f"{path} is not valid") from None


def _require(condition: bool, path: str) -> None:
    if not condition:
        raise ValueError(f"{path} is not valid")
