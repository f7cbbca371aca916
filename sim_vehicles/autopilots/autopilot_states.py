"""States and notices of an autopilot, and its names for mission items."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from pymavlink.dialects.v20 import ardupilotmega as mavlink

ITEM_NAMES = {
    mavlink.MAV_CMD_NAV_WAYPOINT: "WP",
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: "LoitUnlim",
    mavlink.MAV_CMD_NAV_LOITER_TIME: "LoitTime",
    mavlink.MAV_CMD_NAV_TAKEOFF: "Takeoff",
    mavlink.MAV_CMD_NAV_LAND: "Land",
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: "RTL",
}


class MissionState(IntEnum):
    """MISSION_STATE."""

    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


@dataclass(frozen=True, slots=True)
class StatusText:
    """Text for the ground station; `severity` is a MAV_SEVERITY."""

    severity: int
    text: str


@dataclass(frozen=True, slots=True)
class ItemReached:
    """A mission item was completed."""

    seq: int


@dataclass(frozen=True, slots=True)
class Home:
    """Destination of RTL."""

    east_m: float
    north_m: float
    alt_m: float
    """Above the local frame's origin."""
