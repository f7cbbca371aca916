"""Simulated failsafes of ArduPlane and PX4: ground station lost, radio control lost, low battery.

ArduPlane acts at once. Ground station (FS_GCS_ENABL 1): after FS_LONG_TIMEOUT without a heartbeat of
SYSID_MYGCS the mode decides. AUTO, GUIDED and AVOID continue with FS_LONG_ACTN 0 and return with 1. RTL
stays. Every other mode changes to RTL, on the ground and disarmed too. A landing is finished. Radio
control (THR_FAILSAFE 1): the short failsafe circles if FS_SHORT_ACTN is above 0, and in manual modes; the
long one is that of the ground station. Battery: BATT_LOW_TIMER seconds below BATT_LOW_VOLT,
BATT_CRT_VOLT.

PX4 holds its position for 5 s before it acts, and acts even if the cause has gone. A change of the mode
ends the failsafe. Ground station (NAV_DLL_ACT) and radio control (NAV_RCL_ACT): 1 Hold, 2 return, 3 land.
Battery (COM_LOW_BAT_ACT): 2 lands, 3 returns, and lands when there is next to nothing left.

Times and texts are those of recorded flights (`tests/sim_vehicles/test_recorded_faults.py`) or of the
sources.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.model import NS_PER_S
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.vehicle.faults import FaultKind

if TYPE_CHECKING:
    from sim_vehicles.autopilots.arduplane import Autopilot

_INFO: Final = mavlink.MAV_SEVERITY_INFO
_WARNING: Final = mavlink.MAV_SEVERITY_WARNING
_CRITICAL: Final = mavlink.MAV_SEVERITY_CRITICAL
_CONTINUES: Final = frozenset({Mode.AUTO, Mode.GUIDED})
_UNTOUCHED: Final = frozenset({Mode.CIRCLE, Mode.TAKEOFF, Mode.RTL})
_STEERED: Final = frozenset({Mode.AUTO, Mode.GUIDED, Mode.LOITER})
"""Modes that the short failsafe leaves alone with FS_SHORT_ACTN 0."""
_RTL_ACTION = 1
_LAND_ACTION = 2
_THROTTLE_NOTICED_S: Final = 1.2

_NOTICED_NS: Final = 2_400_000_000
_HOLD_NS: Final = 5_100_000_000
_PX4_ACTIONS: Final = {1: Mode.LOITER, 2: Mode.RTL, 3: Mode.LAND}
_RC_LOST_S: Final = 0.5
_LOW = 1
_CRITICAL_LEVEL = 2
_EMERGENCY = 3
_BATTERY_LEVELS: Final = ((5.0, _EMERGENCY), (7.0, _CRITICAL_LEVEL), (15.0, _LOW))
"""BAT_EMERGEN_THR, BAT_CRIT_THR and BAT_LOW_THR in percent."""
_BATTERY_TEXTS: Final = {
    _LOW: (_CRITICAL, "Low battery"),
    _CRITICAL_LEVEL: (_CRITICAL, "Critical battery"),
    _EMERGENCY: (mavlink.MAV_SEVERITY_EMERGENCY, "Emergency battery level"),
}
_LANDS = 2
_RETURNS_THEN_LANDS = 3


class Failsafe(ABC):
    """The failsafes of one vehicle."""

    over_text = ""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._heard_ns: int | None = None
        self.is_on = False
        """True from the loss of the ground station until it is heard again."""
        self.is_rc_lost = False
        """True from the loss of the radio control until its signal is back."""
        self.battery_level = 0
        """0 good, 1 low, 2 critical, 3 emergency (PX4 only)."""

    @property
    @abstractmethod
    def is_critical(self) -> bool:
        """True if HEARTBEAT shows MAV_STATE_CRITICAL."""

    def note_heartbeat(self, t_ns: int) -> None:
        """Note a heartbeat of the ground station."""
        self._heard_ns = t_ns
        if self.is_on:
            self.is_on = False
            self._autopilot.notify(_WARNING, self.over_text)

    def check(self, t_ns: int) -> None:
        """Change the mode where a failsafe asks for it."""
        self._check_link(t_ns)
        self._check_rc(t_ns)
        self._check_battery(t_ns)

    @abstractmethod
    def _check_link(self, t_ns: int) -> None: ...

    @abstractmethod
    def _check_rc(self, t_ns: int) -> None: ...

    @abstractmethod
    def _check_battery(self, t_ns: int) -> None: ...

    @abstractmethod
    def breach(self, reaction: Mode, t_ns: int) -> None:
        """React to a breach of the fence."""


class PlaneFailsafe(Failsafe):
    """ArduPlane's failsafes."""

    over_text = "GCS Failsafe Off"

    def __init__(self, autopilot: Autopilot) -> None:
        super().__init__(autopilot)
        self._is_rc_long = False
        self._before_short: Mode | None = None
        self._low_since_ns: dict[int, int] = {}

    @property
    def is_critical(self) -> bool:
        """True if any failsafe is on."""
        return self.is_on or self.is_rc_lost or bool(self.battery_level)

    def _check_link(self, t_ns: int) -> None:
        autopilot = self._autopilot
        heard_ns = self._heard_ns
        parameters = autopilot.parameters
        if self.is_on or heard_ns is None or not parameters["FS_GCS_ENABL"] or autopilot.is_landing:
            return
        if t_ns - heard_ns <= parameters["FS_LONG_TIMEOUT"] * NS_PER_S:
            return
        self.is_on = True
        self._act_long()
        autopilot.notify(_WARNING, f"GCS Failsafe On: {autopilot.mode.name}")

    def _act_long(self) -> None:
        autopilot = self._autopilot
        if autopilot.mode not in _CONTINUES or int(autopilot.parameters["FS_LONG_ACTN"]) == _RTL_ACTION:
            autopilot.set_mode(Mode.RTL)

    def _check_rc(self, t_ns: int) -> None:
        autopilot = self._autopilot
        faults = autopilot.faults
        parameters = autopilot.parameters
        if FaultKind.RC not in faults:
            if self.is_rc_lost:
                self._end_rc()
        elif not self.is_rc_lost and parameters["THR_FAILSAFE"]:
            if faults.has_lasted(FaultKind.RC, _THROTTLE_NOTICED_S, t_ns):
                self.is_rc_lost = True
                autopilot.notify(_WARNING, "Throttle failsafe on")
                self._act_short()
        elif self.is_rc_lost and not self._is_rc_long and not autopilot.is_landing:
            timeout_s = parameters["FS_SHORT_TIMEOUT"] + parameters["FS_LONG_TIMEOUT"]
            if faults.has_lasted(FaultKind.RC, timeout_s, t_ns):
                self._is_rc_long = True
                self._act_long()
                autopilot.notify(_WARNING, f"RC Long Failsafe On: {autopilot.mode.name}")

    def _act_short(self) -> None:
        autopilot = self._autopilot
        mode = autopilot.mode
        is_left = mode in _STEERED and not autopilot.parameters["FS_SHORT_ACTN"]
        if mode in _UNTOUCHED or is_left or autopilot.is_landing:
            autopilot.notify(_WARNING, "RC Short Failsafe On")
            return
        self._before_short = mode
        autopilot.set_mode(Mode.CIRCLE)
        autopilot.notify(_WARNING, f"RC Short Failsafe: switched to {autopilot.mode.name}")

    def _end_rc(self) -> None:
        autopilot = self._autopilot
        autopilot.notify(_WARNING, "Throttle failsafe off")
        if self._is_rc_long:
            autopilot.notify(_WARNING, "RC Long Failsafe Cleared")
        else:
            autopilot.notify(_WARNING, "RC Short Failsafe Cleared")
            if self._before_short is not None and autopilot.mode is Mode.CIRCLE:
                autopilot.set_mode(self._before_short)
                autopilot.notify(_INFO, f"Flight mode {autopilot.mode.name} restored")
        self.is_rc_lost = self._is_rc_long = False
        self._before_short = None

    def _check_battery(self, t_ns: int) -> None:
        for level, name, word in ((1, "LOW", "low"), (2, "CRT", "critical")):
            self._check_voltage(level, name, word, t_ns)

    def _check_voltage(self, level: int, name: str, word: str, t_ns: int) -> None:
        autopilot = self._autopilot
        parameters = autopilot.parameters
        volts = autopilot.battery.voltage_mv(t_ns) / 1000.0
        if volts >= parameters[f"BATT_{name}_VOLT"]:
            self._low_since_ns.pop(level, None)
            return
        since_ns = self._low_since_ns.setdefault(level, t_ns)
        is_over = t_ns - since_ns >= parameters["BATT_LOW_TIMER"] * NS_PER_S
        if self.battery_level >= level or not is_over or not autopilot.armed:
            return
        self.battery_level = level
        used_mah = parameters["BATT_CAPACITY"] * (1.0 - autopilot.battery.percent(t_ns) / 100.0)
        autopilot.notify(_WARNING, f"Battery 1 is {word} {volts:.2f}V used {used_mah:.0f} mAh")
        action = int(parameters[f"BATT_FS_{name}_ACT"])
        if autopilot.is_landing:
            return
        if action == _LAND_ACTION and autopilot.fly_landing():
            return
        if action in (_RTL_ACTION, _LAND_ACTION):
            autopilot.set_mode(Mode.RTL)

    def breach(self, reaction: Mode, t_ns: int) -> None:
        """React to a breach of the fence, at once."""
        del t_ns
        self._autopilot.set_mode(reaction)


class Px4Failsafe(Failsafe):
    """PX4's failsafes: Hold, then the action."""

    over_text = "GCS connection regained"

    def __init__(self, autopilot: Autopilot) -> None:
        super().__init__(autopilot)
        self._action: Mode | None = None
        """Mode that the failsafe chose; None without one."""
        self._acts_ns: int | None = None
        """End of the 5 s in Hold; None when it has acted."""
        self.intended = Mode.AUTO
        """Mode before the failsafe, shown again after the vehicle has landed and disarmed."""

    @property
    def is_critical(self) -> bool:
        """True while a failsafe has chosen the mode."""
        return self._action is not None

    def check(self, t_ns: int) -> None:
        """Change the mode where a failsafe asks for it."""
        autopilot = self._autopilot
        action = self._action
        waits = self._acts_ns is not None
        if action is not None and (autopilot.mode is not (Mode.LOITER if waits else action)):
            self._action = self._acts_ns = None  # Somebody chose another mode.
        elif action is not None and not autopilot.armed:
            self._action = self._acts_ns = None
        elif action is not None and self._acts_ns is not None and t_ns >= self._acts_ns:
            self._acts_ns = None
            self._act(action)
        super().check(t_ns)

    def _begin(self, action: Mode | None, t_ns: int) -> None:
        """Hold for 5 s, then act; a worse failsafe acts at once when the first has acted."""
        autopilot = self._autopilot
        if action is None or not autopilot.flying or autopilot.is_landing or autopilot.mode is action:
            return
        if self._action is None:
            autopilot.notify(_CRITICAL, "Failsafe activated: entering Hold for 5 seconds")
            self.intended = autopilot.mode
            autopilot.set_mode(Mode.LOITER)
            self._action = action
            self._acts_ns = t_ns + _HOLD_NS
        elif self._acts_ns is not None:
            self._action = action
        else:
            self._action = action
            self._act(action)

    def _act(self, action: Mode) -> None:
        self._autopilot.notify(_CRITICAL, "Failsafe activated")
        self._autopilot.set_mode(action)

    def _check_link(self, t_ns: int) -> None:
        autopilot = self._autopilot
        parameters = autopilot.parameters
        if self.is_on or self._heard_ns is None:
            return
        if t_ns - self._heard_ns < parameters["COM_DL_LOSS_T"] * NS_PER_S + _NOTICED_NS:
            return
        self.is_on = True
        autopilot.notify(_WARNING, "Connection to ground station lost")
        if autopilot.mode is not Mode.RTL:
            self._begin(_PX4_ACTIONS.get(int(parameters["NAV_DLL_ACT"])), t_ns)

    def _check_rc(self, t_ns: int) -> None:
        autopilot = self._autopilot
        faults = autopilot.faults
        if FaultKind.RC not in faults:
            self.is_rc_lost = False
            return
        if self.is_rc_lost or not faults.has_lasted(FaultKind.RC, _RC_LOST_S, t_ns):
            return
        self.is_rc_lost = True  # Without a text: only the failsafe that follows is announced.
        excepted = {Mode.AUTO: 1, Mode.LOITER: 2, Mode.RTL: 2, Mode.TAKEOFF: 2}.get(autopilot.mode, 0)
        if not int(autopilot.parameters["COM_RCL_EXCEPT"]) & excepted:
            self._begin(_PX4_ACTIONS.get(int(autopilot.parameters["NAV_RCL_ACT"])), t_ns)

    def _check_battery(self, t_ns: int) -> None:
        autopilot = self._autopilot
        percent = autopilot.battery.percent(t_ns)
        level = next((level for bound, level in _BATTERY_LEVELS if percent <= bound), 0)
        is_worse = level > self.battery_level
        self.battery_level = level
        if not is_worse:
            return
        autopilot.notify(*_BATTERY_TEXTS[level])
        wanted = int(autopilot.parameters["COM_LOW_BAT_ACT"])
        if level == _LOW or wanted not in (_LANDS, _RETURNS_THEN_LANDS):
            return
        does_return = wanted == _RETURNS_THEN_LANDS and level == _CRITICAL_LEVEL
        self._begin(Mode.RTL if does_return else Mode.LAND, t_ns)

    def breach(self, reaction: Mode, t_ns: int) -> None:
        """React to a breach of the fence: Hold, then the reaction."""
        self._begin(reaction, t_ns)
