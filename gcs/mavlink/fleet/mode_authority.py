"""Control authority over one vehicle: ours, or overridden by a pilot, a failsafe or another station.

A mode alone does not show its cause. Each change of mode is classified:

=====================================================  ==============================================
AUTO                                                   ours, also by an operator
LOITER that we commanded, and no other mode since      ours
LOITER before the first AUTO or task                   ours: the vehicle waits for its first mission
LOITER at the mission's end, where that is the mode    ours
LOITER because the navigator rejected its mission      ours (MISSION_CURRENT shows it soon)
RTL out of AUTO because the mission is complete        ours (MISSION_CURRENT shows it soon)
any other change                                       override, until AUTO or a resume order
=====================================================  ==============================================

A LOITER that an operator chooses while we hold the vehicle in LOITER counts as ours.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.mavlink.autopilots.modes import AUTO, LOITER, RTL
from gcs.mavlink.fleet.records import ModeRecord
from gcs.model import Authority, Control, ControlEvent


@dataclass(frozen=True, slots=True)
class ModeAuthority:
    """Classification of the mode changes of one vehicle, as events of its control."""

    record: ModeRecord = field(default_factory=ModeRecord)
    control: Control = field(default_factory=Control)

    @property
    def mode(self) -> str:
        """Mode of the last heartbeat; empty before the first."""
        return self.record.mode

    @property
    def override(self) -> str:
        """Mode that an operator chose; empty without an override."""
        return self.control.detail(Authority.OVERRIDDEN)

    @property
    def override_t_ns(self) -> int:
        """Time at which the override began; 0 without one."""
        claim = self.control.claims.get(Authority.OVERRIDDEN)
        return 0 if claim is None else claim.since_t_ns

    def note_command(self, mode: str) -> None:
        """Note that we command this mode."""
        self.record.commanded = mode
        self.record.tasked |= mode == AUTO

    def observe_mode(self, mode: str, t_ns: int, *, at_end: bool = False) -> None:
        """Process the mode of a heartbeat; `at_end` is True if the mission's end would show as this mode."""
        record = self.record
        if mode == record.mode:
            return
        first, record.previous, record.mode, record.has_ended = not record.mode, record.mode, mode, False
        if mode == AUTO:
            record.tasked = True
            self.control.apply(ControlEvent.AUTO_SEEN, t_ns)
        elif mode == LOITER and (record.commanded == LOITER or not record.tasked or at_end):
            self.control.apply(ControlEvent.WAITING_SEEN, t_ns)
        elif not (first and mode == LOITER):
            record.commanded = ""
            self.control.apply(ControlEvent.MODE_CHOSEN, t_ns, mode)

    def note_rejection(self, t_ns: int) -> None:
        """Note that the vehicle is in LOITER because it has no valid mission."""
        if self.override == LOITER:
            self.control.apply(ControlEvent.MISSION_REJECTED, t_ns)

    @property
    def may_have_ended(self) -> bool:
        """True if the vehicle went from AUTO to RTL: at its mission's end, by a failsafe or an order."""
        return self.override == RTL and self.record.previous == AUTO

    def note_completion(self, t_ns: int) -> None:
        """Note that the vehicle went from AUTO to RTL because its mission is complete."""
        if self.may_have_ended:
            self.record.has_ended = True
            self.control.apply(ControlEvent.MISSION_COMPLETE, t_ns)

    def note_reboot(self, t_ns: int) -> None:
        """Forget the mode: the mode after a boot is no override."""
        self.record.mode = self.record.previous = self.record.commanded = ""
        self.record.has_ended = False
        self.control.apply(ControlEvent.REBOOT, t_ns)

    def release(self, t_ns: int) -> None:
        """Take control back, on an operator's order to resume."""
        self.record.tasked = False
        self.control.apply(ControlEvent.RESUME, t_ns)
