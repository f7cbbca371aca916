"""Failsafes of ArduPlane and PX4 after the loss of the ground station.

ArduPlane (FS_GCS_ENABL 1): after FS_LONG_TIMEOUT without a heartbeat of SYSID_MYGCS the mode decides. AUTO,
GUIDED and AVOID continue with FS_LONG_ACTN 0 and return with 1. RTL stays. Every other mode changes to RTL,
on the ground and disarmed too. A landing is finished.

PX4 (NAV_DLL_ACT above 0): shortly after COM_DL_LOSS_T without a heartbeat it holds its position; with
NAV_DLL_ACT 2 it returns 5 s later, even if the link is back.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.model import NS_PER_S
from sim_vehicles.autopilots.base import Mode

if TYPE_CHECKING:
    from sim_vehicles.autopilots.arduplane import Autopilot

_CONTINUES: Final = frozenset({Mode.AUTO, Mode.GUIDED})
_RTL_ACTION = 1
_NOTICED_NS: Final = 2_400_000_000
_HOLD_NS: Final = 5_100_000_000
_PX4_RETURNS = 2


class Failsafe(ABC):
    """Action after the loss of the ground station."""

    over_text = ""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._heard_ns: int | None = None
        self.is_on = False
        """True from the loss of the ground station until it is heard again."""

    def note_heartbeat(self, t_ns: int) -> None:
        """Note a heartbeat of the ground station."""
        self._heard_ns = t_ns
        if self.is_on:
            self.is_on = False
            self._autopilot.notify(mavlink.MAV_SEVERITY_WARNING, self.over_text)

    @abstractmethod
    def check(self, t_ns: int) -> None:
        """Change the mode after the timeout."""


class PlaneFailsafe(Failsafe):
    """ArduPlane's failsafe."""

    over_text = "GCS Failsafe Off"

    def check(self, t_ns: int) -> None:
        """Change the mode after the timeout."""
        autopilot, heard_ns = self._autopilot, self._heard_ns
        parameters = autopilot.parameters
        if self.is_on or heard_ns is None or not parameters["FS_GCS_ENABL"] or autopilot.is_landing:
            return
        if t_ns - heard_ns <= parameters["FS_LONG_TIMEOUT"] * NS_PER_S:
            return
        self.is_on = True
        if autopilot.mode not in _CONTINUES or int(parameters["FS_LONG_ACTN"]) == _RTL_ACTION:
            autopilot.set_mode(Mode.RTL)
        autopilot.notify(mavlink.MAV_SEVERITY_WARNING, f"GCS Failsafe On: {autopilot.mode.name}")


class Px4Failsafe(Failsafe):
    """PX4's failsafe."""

    over_text = "GCS connection regained"
    _returns_ns: int | None = None

    def check(self, t_ns: int) -> None:
        """Change the mode after the timeout."""
        autopilot, parameters = self._autopilot, self._autopilot.parameters
        if self._returns_ns is not None and t_ns >= self._returns_ns:
            self._returns_ns = None
            if autopilot.mode is Mode.LOITER and int(parameters["NAV_DLL_ACT"]) == _PX4_RETURNS:
                autopilot.set_mode(Mode.RTL)
        if self.is_on or self._heard_ns is None:
            return
        if t_ns - self._heard_ns < parameters["COM_DL_LOSS_T"] * NS_PER_S + _NOTICED_NS:
            return
        self.is_on = True
        autopilot.notify(mavlink.MAV_SEVERITY_WARNING, "Connection to ground station lost")
        if not parameters["NAV_DLL_ACT"] or not autopilot.flying or autopilot.mode is Mode.RTL:
            return
        if not autopilot.is_landing:
            autopilot.set_mode(Mode.LOITER)
            self._returns_ns = t_ns + _HOLD_NS
