"""Mission items: record, message, and comparison of two lists, with tolerances for heights and parameters.

Source: https://mavlink.io/en/services/mission.html. `item_builder` makes the items of a mission.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import Message

_HEIGHT_TOLERANCE_M = 0.011
_PARAM_TOLERANCE = 1e-3


class Home(NamedTuple):
    """Home position that a vehicle reports."""

    lat_deg: float
    lon_deg: float
    alt_msl_m: float


class Item(NamedTuple):
    """One mission item as stored; `x` and `y` are latitude and longitude in 1e-7 degrees."""

    command: int
    frame: int
    x: int
    y: int
    z_m: float
    param1: float = 0.0
    param2: float = 0.0
    param3: float = 0.0
    param4: float = 0.0
    autocontinue: int = 1

    def message(
        self,
        seq: int,
        target_system: int,
        target_component: int,
        *,
        current: bool = False,
        mission_type: int = dialect.MAV_MISSION_TYPE_MISSION,
    ) -> Message:
        """Return the MISSION_ITEM_INT of this item as number `seq` of a list."""
        head = target_system, target_component, seq, self.frame, self.command, int(current), self.autocontinue
        params = self.param1, self.param2, self.param3, self.param4
        position = self.x, self.y, self.z_m
        return dialect.MAVLink_mission_item_int_message(*head, *params, *position, mission_type)


def item_of(message: Message) -> Item:
    """Return the item of a MISSION_ITEM_INT."""
    m = message
    params = m.param1, m.param2, m.param3, m.param4
    return Item(m.command, m.frame, m.x, m.y, m.z, *params, m.autocontinue)


def first_item_difference(
    sent: Sequence[Item], held: Sequence[Item], normalised: Callable[[Item], Item], skip: int = 0
) -> str:
    """Return the first difference between sent and stored items; empty if equal.

    Parameters
    ----------
    normalised : callable
        From an item to its stored form.
    skip : int
        Items at the beginning that are not compared: the vehicle's home.
    """
    if len(sent) != len(held):
        return f"{len(held)} items instead of {len(sent)}"
    for seq in range(skip, len(sent)):
        want = normalised(sent[seq])
        got = normalised(held[seq])
        if want == got and all(map(math.isfinite, got)):
            continue
        for name, wanted, found in zip(Item._fields, want, got, strict=True):
            if abs(wanted - found) > _tolerance(name):
                return f"item {seq}: {name} is {found:.10g} instead of {wanted:.10g}"
            if not math.isfinite(found):
                return f"item {seq}: {name} is {found}"
    return ""


def _tolerance(name: str) -> float:
    if name == "z_m":
        return _HEIGHT_TOLERANCE_M
    return _PARAM_TOLERANCE if name.startswith("param") else 0.0
