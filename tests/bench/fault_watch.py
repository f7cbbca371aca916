"""What the service made of a fault: its notices, plans and frames, against what the vehicle showed.

A `FaultWatch` takes the events and effects of a run in order: those of a flight on virtual time, or of a
recording. Times are from the fault.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from typing import TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.frames.codec import scan
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Datagram,
    Label,
    MissionEnded,
    Notice,
    NoticeCode,
    Order,
    Plan,
    Send,
)

PLANE_AUTO = 10
PX4_AUTO = 4 << 16 | 4 << 24
_SENSOR_BITS = {
    "gps": mavlink.MAV_SYS_STATUS_SENSOR_GPS,
    "airspeed": mavlink.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE,
    "rc": mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER,
    "fence": mavlink.MAV_SYS_STATUS_GEOFENCE,
    "battery": mavlink.MAV_SYS_STATUS_SENSOR_BATTERY,
}
_SAID = {
    "battery": re.compile(r"^(low battery|critical battery|emergency battery|battery 1 is)", re.IGNORECASE),
    "rc": re.compile(r"rc (short|long) failsafe", re.IGNORECASE),
    "fence": re.compile(r"fence breached|geofence", re.IGNORECASE),
    "airspeed": re.compile(r"airspeed .*(fail|invalid|warning)", re.IGNORECASE),
    "glitch": re.compile(r"dcm active", re.IGNORECASE),
}
"""The autopilot's own words."""
_DOWN = {NoticeCode.CAME_DOWN, NoticeCode.SINKS, NoticeCode.PROPULSION_PROBLEM}
_POSITION = {
    NoticeCode.GPS_PROBLEM,
    NoticeCode.GPS_POSITION_PROBLEM,
    NoticeCode.ESTIMATE_PROBLEM,
    NoticeCode.POSITION_JUMP,
    NoticeCode.POSITION_FROZEN,
    NoticeCode.NO_POSITION,
    NoticeCode.NOT_SEEN_THERE,
    NoticeCode.SEEN_ELSEWHERE,
}
TOLD = {
    "crash": _DOWN,
    "engine": _DOWN,
    "gps": _POSITION,
    "glitch": _POSITION,
    "battery": {
        NoticeCode.BATTERY_PROBLEM,
        NoticeCode.BATTERY_LOW,
        NoticeCode.BATTERY_CRITICAL,
        NoticeCode.CAME_DOWN,
    },
    "rc": {NoticeCode.RC_PROBLEM, NoticeCode.FAILSAFE},
    "airspeed": {NoticeCode.AIRSPEED_PROBLEM},
    "fence": {NoticeCode.FENCE_PROBLEM, NoticeCode.FAILSAFE},
    "radio": {NoticeCode.LINK_STALE, NoticeCode.LINK_DOWN},
}
"""Notices that name the right cause."""
_GROUNDING = frozenset({"crash", "engine"})
_DIVE_M_S = 6.0
"""Sink rate that no autopilot commands."""
_SINK_M_S, _FULL_THROTTLE = 1.5, 90
"""Sink rate at full throttle without thrust."""
_SINK_NS = NS_PER_S
_LOW_M, _HIGH_M = 2.0, 10.0
_SILENT_NS = 3 * NS_PER_S
_REASSIGNED_NS = 5 * NS_PER_S
_OBEYED_NS = 3 * NS_PER_S
"""A mode that a vehicle shows this soon after the service commanded it is the service's."""
_STEERING_MESSAGES = frozenset({11, 38, 39, 41, 44, 45, 73, 86})
"""SET_MODE and the messages that change or select a mission."""
_STEERING_COMMANDS = frozenset({16, 20, 21, 22, 176, 192, 224, 252, 300, 400})
_GLITCHING = 0x8000


@dataclass
class Seen:
    """The newest telemetry of one vehicle."""

    mode: int | None = None
    auto: int = PLANE_AUTO
    armed: bool = False
    height_m: float = 0.0
    has_flown_auto: bool = False
    was_low: bool = True
    armed_by_order: bool = True
    sinks_since_ns: int | None = None
    throttle: int = 0
    commanded_ns: dict[int, int] = field(default_factory=dict)
    """Time of the service's last command of each mode."""
    is_ours: bool = True
    """True in AUTO, and in a mode that the service had just commanded."""
    heard_ns: int = 0


@dataclass
class FaultWatch:
    """One vehicle's fault in one run."""

    kind: str
    vehicle: int
    fault_ns: int | None = None
    """Time of the fault; None before."""
    end_ns: int | None = None
    """Time when the fault ended; None if it lasts."""
    shown_ns: int | None = None
    left_ns: int | None = None
    """Time since when the vehicle cannot or does not fly on to its target: without thrust, or in a failsafe's
    mode; None as long as it flies its mission."""
    told_ns: int | None = None
    misattributed: str = ""
    """Notice that takes a failsafe's mode for somebody's choice; empty if there is none."""
    target: Label | None = None
    """Target of the vehicle when the fault began."""
    spare: bool = False
    """True if another vehicle was in the air without a target, in a mode of ours and without a fault, until
    5 s after this one left its mission."""
    reassigned_ns: int | None = None
    steered: list[str] = field(default_factory=list)
    """Steering messages that were sent while a mode that is not ours was shown."""
    unasked: list[int] = field(default_factory=list)
    """Vehicles that took off without an order."""
    ended: MissionEnded | None = None
    statuses: dict[int, str] = field(default_factory=dict)
    targets: dict[int, Label] = field(default_factory=dict)
    texts: list[tuple[float, str]] = field(default_factory=list)
    _seen: dict[int, Seen] = field(default_factory=dict)
    _enabled: dict[int, int] = field(default_factory=dict)
    _ordered: set[int] = field(default_factory=set)
    _broken: Collection[int] = ()

    def begin(self, t_ns: int, broken: Collection[int] = ()) -> None:
        """Note that the fault begins now; `broken` vehicles have one already."""
        self.fault_ns, self.target, self._broken = t_ns, self.targets.get(self.vehicle), broken
        self.spare = self._has_spare()

    def _has_spare(self) -> bool:
        return any(
            (seen.is_ours or not seen.has_flown_auto)
            and seen.height_m > _HIGH_M
            and self.statuses.get(v, "active") == "active"
            for v, seen in self._seen.items()
            if v not in (self.vehicle, *self._broken) and v not in self.targets
        )

    def event(self, event: object, messages: Messages | None = None) -> None:
        """Take an event of the engine; `messages` are those of a datagram, if they are known already."""
        if isinstance(event, Datagram):
            for vehicle, number, message in decoded(event) if messages is None else messages:
                self._see(vehicle, number, message, event.t_ns)
        elif isinstance(event, Order):
            self._take_order(event)
        if self.kind == "radio" and self.fault_ns is not None and self.shown_ns is None:
            t_ns = getattr(event, "t_ns", 0)
            heard_ns = self._of(self.vehicle).heard_ns
            if t_ns - max(heard_ns, self.fault_ns) > _SILENT_NS:
                self.shown_ns = t_ns

    def _of(self, vehicle: int) -> Seen:
        return self._seen.setdefault(vehicle, Seen())

    def _take_order(self, order: Order) -> None:
        vehicles = order.vehicles or tuple(self._seen)
        if order.action == "arm":
            for vehicle in vehicles:
                self._of(vehicle).armed_by_order = True
        if order.action in ("resume", "hold", "return", "arm"):
            self._ordered |= set(vehicles)

    def _see(self, vehicle: int, number: int, message: object, t_ns: int) -> None:
        seen = self._of(vehicle)
        seen.heard_ns = t_ns
        if message is None:
            return
        _READERS[number](self, seen, vehicle, message, t_ns)

    def _show(self, vehicle: int, t_ns: int) -> None:
        if vehicle == self.vehicle and self.fault_ns is not None and self.shown_ns is None:
            self.shown_ns = t_ns
            if self.kind in _GROUNDING:
                self.left_ns = t_ns

    def _heartbeat(self, seen: Seen, vehicle: int, message: object, t_ns: int) -> None:
        seen.auto = PX4_AUTO if message.autopilot == mavlink.MAV_AUTOPILOT_PX4 else PLANE_AUTO
        if message.custom_mode != seen.mode:
            commanded_ns = seen.commanded_ns.get(message.custom_mode, -_OBEYED_NS)
            seen.is_ours = message.custom_mode == seen.auto or t_ns - commanded_ns < _OBEYED_NS
        seen.mode = message.custom_mode
        has_left = seen.has_flown_auto and not seen.is_ours
        if vehicle == self.vehicle and self.fault_ns is not None and has_left:
            self.left_ns = self.left_ns or t_ns
        seen.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        if seen.mode == seen.auto and seen.armed:
            seen.has_flown_auto = True
            self._ordered.discard(vehicle)
        if not seen.armed:
            seen.armed_by_order = False

    def _position(self, seen: Seen, vehicle: int, message: object, t_ns: int) -> None:
        seen.height_m = message.relative_alt / 1e3
        if seen.height_m < _LOW_M:
            seen.was_low = True
        elif seen.height_m > _HIGH_M:
            if seen.was_low and seen.has_flown_auto and not seen.armed_by_order:
                self.unasked.append(vehicle)
            seen.was_low = False
        if self.kind not in _GROUNDING:
            return
        least_m_s = _SINK_M_S if seen.throttle >= _FULL_THROTTLE else _DIVE_M_S
        sinks = message.vz / 100.0 > least_m_s or (seen.height_m < _LOW_M and self.fault_ns is not None)
        if not sinks:
            seen.sinks_since_ns = None
        elif seen.sinks_since_ns is None:
            seen.sinks_since_ns = t_ns
        elif t_ns - seen.sinks_since_ns >= _SINK_NS:
            self._show(vehicle, t_ns)

    def _hud(self, seen: Seen, vehicle: int, message: object, t_ns: int) -> None:
        del vehicle, t_ns
        seen.throttle = message.throttle

    def _sys_status(self, seen: Seen, vehicle: int, message: object, t_ns: int) -> None:
        del seen
        bit = _SENSOR_BITS.get(self.kind, 0)
        enabled, healthy = message.onboard_control_sensors_enabled, message.onboard_control_sensors_health
        was_enabled, self._enabled[vehicle] = self._enabled.get(vehicle, 0), enabled
        if bit & enabled & ~healthy or bit & was_enabled & ~enabled:
            self._show(vehicle, t_ns)

    def _gps(self, seen: Seen, vehicle: int, message: object, t_ns: int) -> None:
        del seen
        if self.kind == "gps" and message.fix_type < mavlink.GPS_FIX_TYPE_3D_FIX:
            self._show(vehicle, t_ns)

    def _estimate(self, seen: Seen, vehicle: int, message: object, t_ns: int) -> None:
        del seen
        is_px4 = message.get_type() == "ESTIMATOR_STATUS"
        if self.kind == "glitch" and message.flags & (mavlink.ESTIMATOR_GPS_GLITCH if is_px4 else _GLITCHING):
            self._show(vehicle, t_ns)

    def _text(self, seen: Seen, vehicle: int, message: object, t_ns: int) -> None:
        del seen
        said = _SAID.get(self.kind)
        if said is not None and said.search(message.text):
            self._show(vehicle, t_ns)

    def _charge(self, seen: Seen, vehicle: int, message: object, t_ns: int) -> None:
        del seen
        if self.kind == "battery" and message.charge_state >= mavlink.MAV_BATTERY_CHARGE_STATE_LOW:
            self._show(vehicle, t_ns)

    def effect(self, t_ns: int, effect: object) -> None:
        """Take an effect of the engine."""
        match effect:
            case Notice():
                self._take_notice(effect)
            case Plan():
                self._take_plan(effect)
            case AgentStatus():
                self.statuses[effect.vehicle] = effect.status
                if effect.status in ("lost", "down", "arrived"):
                    self.targets.pop(effect.vehicle, None)
                if effect.vehicle == self.vehicle and effect.status == "arrived":
                    self.target = None  # It has served its target.
            case Send():
                self._take_send(effect.data, t_ns)
            case MissionEnded():
                self.ended = effect

    def _take_notice(self, notice: Notice) -> None:
        if notice.vehicle != self.vehicle or self.fault_ns is None:
            return
        self.texts.append(((notice.t_ns - self.fault_ns) / NS_PER_S, f"{notice.level}: {notice.text}"))
        if notice.code is NoticeCode.OVERRIDDEN and self.kind != "radio":  # its telemetry is not heard
            self.misattributed = notice.text
        if self.told_ns is None and notice.code in TOLD[self.kind]:
            self.told_ns = notice.t_ns

    def _take_plan(self, plan: Plan) -> None:
        self.targets = {route.vehicle: route.target for route in plan.routes}
        if self.fault_ns is None or self.reassigned_ns is not None or self.target is None:
            return
        if any(v != self.vehicle and target == self.target for v, target in self.targets.items()):
            self.reassigned_ns = plan.t_ns
        elif self.left_ns is None or plan.t_ns - self.left_ns <= _REASSIGNED_NS:
            self.spare = self.spare and self._has_spare()  # another target may have needed it

    def _take_send(self, data: bytes, t_ns: int) -> None:
        for frame in scan(data).frames:
            if frame.message_id not in _STEERING_MESSAGES | {75, 76}:
                continue
            message = frame.message()
            vehicle = getattr(message, "target_system", 0)
            seen = self._seen.get(vehicle)
            if seen is None or (frame.message_id in (75, 76) and message.command not in _STEERING_COMMANDS):
                continue
            if frame.message_id in (75, 76) and message.command == mavlink.MAV_CMD_DO_SET_MODE:
                seen.commanded_ns[_custom_mode(seen.auto, message)] = t_ns
            if seen.is_ours or not seen.has_flown_auto or vehicle in self._ordered:
                continue
            if getattr(message, "mission_type", 0):
                continue
            since_s = (t_ns - (self.fault_ns or t_ns)) / NS_PER_S
            self.steered.append(f"{vehicle}: {message.get_type()} at {since_s:.1f} s, mode {seen.mode}")

    def heights_m(self) -> dict[int, float]:
        """Return the last reported height of each vehicle above its home."""
        return {vehicle: seen.height_m for vehicle, seen in self._seen.items()}

    def modes(self) -> dict[int, bool]:
        """Return True for each vehicle that flies in a mode that is not ours."""
        return {vehicle: seen.mode != seen.auto for vehicle, seen in self._seen.items()}

    def delay_s(self, t_ns: int | None, since_ns: int | None) -> float | None:
        """Return the seconds between two times, of which either may be missing."""
        return None if t_ns is None or since_ns is None else (t_ns - since_ns) / NS_PER_S


def _custom_mode(auto: int, message: object) -> int:
    """Return the mode that DO_SET_MODE commands."""
    main, sub = int(message.param2), int(message.param3)
    return main << 16 | sub << 24 if auto == PX4_AUTO else main


_READERS = {
    0: FaultWatch._heartbeat,
    1: FaultWatch._sys_status,
    24: FaultWatch._gps,
    33: FaultWatch._position,
    74: FaultWatch._hud,
    147: FaultWatch._charge,
    193: FaultWatch._estimate,
    230: FaultWatch._estimate,
    253: FaultWatch._text,
}


Messages: TypeAlias = list[tuple[int, int, object]]
"""System id, number and message of each frame of an autopilot; None for a message that nobody reads."""


def decoded(event: object) -> Messages:
    """Return the messages of a datagram; none of another event."""
    if not isinstance(event, Datagram):
        return []
    frames = [frame for frame in scan(event.data).frames if frame.component_id == 1]
    return [
        (frame.system_id, frame.message_id, frame.message() if frame.message_id in _READERS else None)
        for frame in frames
    ]


def quantile(values: Iterable[float | None], part: float) -> str:
    """Return a quantile of the values that are there, in words."""
    known = sorted(value for value in values if value is not None)
    return f"{known[min(int(part * len(known)), len(known) - 1)]:.1f}" if known else "-"
