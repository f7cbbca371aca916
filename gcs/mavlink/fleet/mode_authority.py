"""Mode changes of one vehicle: each is ours, or an override by a pilot, a failsafe or another station.

A mode alone does not show its cause. Each change of mode is classified:

=====================================================  ==============================================
AUTO                                                   ours, also by an operator
LOITER that we commanded, and no other mode since      ours
LOITER before the first AUTO or task                   ours: the vehicle waits for its first mission
LOITER out of AUTO at the mission's end (PX4)          ours
LOITER because the navigator rejected its mission      ours (MISSION_CURRENT shows it soon)
LOITER by a failsafe (PX4: MAV_STATE_CRITICAL)         override, whatever else it could be
RTL out of AUTO because the mission is complete        ours (MISSION_CURRENT shows it soon)
any other change                                       override, until AUTO or a resume order
=====================================================  ==============================================

A LOITER that an operator chooses while we hold the vehicle in LOITER counts as ours, unless the command was
heard. From the command of another ground station on, the vehicle is overridden until a heartbeat well after
it shows which mode it is in.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import AutopilotProfile
from gcs.mavlink.autopilots.modes import AUTO, LOITER, RTL
from gcs.mavlink.fleet.fleet_state import ModeRecord
from gcs.mavlink.frames.codec import Message
from gcs.model import NS_PER_S, Authority, Claims, ControlEvent

_COMMAND_SHOWS_NS: Final = 2 * NS_PER_S
"""Time after which a heartbeat shows whether a vehicle has obeyed another station's command."""
_COMPLETION_NS: Final = 3 * NS_PER_S
"""After a change to RTL, MISSION_CURRENT (1 Hz) shows within this time whether the mission is complete."""
_BOOT_NS: Final = 10 * NS_PER_S
"""A mode seen this soon after a boot is the one that the vehicle started in."""


@dataclass(frozen=True, slots=True)
class ModeAuthority:
    """Classification of the mode changes of one vehicle, as events of its control."""

    record: ModeRecord = field(default_factory=ModeRecord)
    claims: Claims = field(default_factory=Claims)

    @property
    def mode(self) -> str:
        """Mode of the last heartbeat; empty before the first."""
        return self.record.mode

    @property
    def override(self) -> str:
        """Mode that an operator chose; empty without an override."""
        return self.claims.detail(Authority.OVERRIDDEN)

    @property
    def override_t_ns(self) -> int:
        """Time at which the override began; 0 without one."""
        return self.claims.since_t_ns(Authority.OVERRIDDEN) or 0

    @property
    def taken_by(self) -> str:
        """Mode that was chosen, or the station that commands one; empty if the vehicle is ours."""
        return self.override or self.claims.detail(Authority.COMMANDED)

    @property
    def takeover(self) -> str:
        """How the vehicle was taken, in words."""
        station = self.claims.detail(Authority.COMMANDED)
        return f"{self.override} was chosen meanwhile" if self.override else f"{station} commands a mode"

    def note_command(self, mode: str) -> None:
        """Note that we command this mode."""
        self.record.commanded = mode
        self.record.tasked |= mode == AUTO

    def note_foreign_command(self, station: str, t_ns: int) -> None:
        """Note that another ground station commands a mode; LOITER is not ours from then on."""
        self.record.commanded = ""
        self.claims.begun.pop(Authority.COMMANDED, None)  # each command begins anew
        self.claims.apply(ControlEvent.STATION_COMMANDS, t_ns, station)

    def observe_heartbeat(
        self, heartbeat: Message, profile: AutopilotProfile, t_ns: int, *, at_end: bool
    ) -> None:
        """Process a heartbeat; `at_end` is True if the mission's end would show as LOITER."""
        record = self.record
        mode = profile.mode_name(heartbeat.custom_mode)
        was_in_failsafe = record.in_failsafe
        record.in_failsafe = heartbeat.system_status >= dialect.MAV_STATE_CRITICAL
        if record.in_failsafe and not was_in_failsafe:
            record.failsafe_t_ns = t_ns
        if profile.atomic and mode == LOITER and record.in_failsafe and not was_in_failsafe:
            record.mode = record.commanded = ""  # PX4 holds before each failsafe
            record.tasked = True
            at_end = False
            self.claims.apply(ControlEvent.MODE_CHOSEN, t_ns, mode)
        if profile.atomic and mode == RTL and record.mode in (AUTO, LOITER):
            record.tasked = True  # PX4 goes from RTL to Hold by itself: it does not wait for a mission then
        self._settle_foreign_command(mode, t_ns)
        self.observe_mode(mode, t_ns, at_end=at_end)

    def _settle_foreign_command(self, mode: str, t_ns: int) -> None:
        """End the wait for the effect of another station's command, once a heartbeat shows it."""
        since_t_ns = self.claims.since_t_ns(Authority.COMMANDED)
        if since_t_ns is None or t_ns - since_t_ns < _COMMAND_SHOWS_NS:
            return
        self.claims.apply(ControlEvent.COMMAND_SETTLED, t_ns)
        if mode == self.mode == LOITER:  # as it was before, but not for us any more
            self.claims.apply(ControlEvent.MODE_CHOSEN, t_ns, mode)

    def observe_mode(self, mode: str, t_ns: int, *, at_end: bool = False) -> None:
        """Process the mode of a heartbeat; `at_end` is True if the mission's end would show as this mode."""
        record = self.record
        if mode == record.mode:
            return
        first = not record.mode
        record.previous = record.mode
        record.mode = mode
        record.has_ended = False
        if mode == AUTO:
            record.tasked = True
            self.claims.apply(ControlEvent.AUTO_SEEN, t_ns)
        elif mode == LOITER and (
            record.commanded == LOITER or not record.tasked or (at_end and record.previous == AUTO)
        ):
            self.claims.apply(ControlEvent.WAITING_SEEN, t_ns)
        elif not (first and mode == LOITER):
            record.commanded = ""
            self.claims.apply(ControlEvent.MODE_CHOSEN, t_ns, mode)

    def note_rejection(self, t_ns: int) -> None:
        """Note that the vehicle is in LOITER because it has no valid mission, and not by a failsafe."""
        if self.override == LOITER and not self.record.in_failsafe:
            self.claims.apply(ControlEvent.NO_MISSION_SEEN, t_ns)

    def note_mission_lost(self, booted_t_ns: int, t_ns: int) -> None:
        """Note that the vehicle lost its mission at a boot: a LOITER that it started in is no override."""
        if -NS_PER_S < self.override_t_ns - booted_t_ns < _BOOT_NS:
            self.note_rejection(t_ns)

    @property
    def may_have_ended(self) -> bool:
        """True if the vehicle went from AUTO to RTL: at its mission's end, by a failsafe or an order."""
        return self.override == RTL and self.record.previous == AUTO

    def awaits_completion(self, t_ns: int) -> bool:
        """Return True if that was a moment ago: MISSION_CURRENT has not shown the reason yet."""
        return self.may_have_ended and t_ns - self.override_t_ns < _COMPLETION_NS

    def note_completion(self, t_ns: int) -> None:
        """Note that the vehicle went from AUTO to RTL because its mission is complete."""
        if self.may_have_ended:
            self.record.has_ended = True
            self.claims.apply(ControlEvent.MISSION_COMPLETE, t_ns)

    def note_reboot(self, t_ns: int) -> None:
        """Forget the mode: the mode after a boot is no override."""
        self.record.mode = self.record.previous = self.record.commanded = ""
        self.record.has_ended = False
        self.claims.apply(ControlEvent.REBOOT, t_ns)

    def release(self, t_ns: int) -> None:
        """Take control back, on an operator's order to resume."""
        self.record.tasked = False
        self.claims.apply(ControlEvent.RESUME, t_ns)
