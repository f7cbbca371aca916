"""Whose a vehicle is: ours to task, or in the hands of somebody who chose its mode.

A mode says what a vehicle does, not who wanted it: a LOITER may be a vehicle that waits for its first
mission, one that we told to hold, one at its mission's end, or one that an operator stopped. The last is not
ours to send on. The rule, applied to each change of mode that is heard:

=====================================================  ==========================================
AUTO                                                   ours, whoever chose it
LOITER that we ordered, and nothing else since         ours
LOITER before it was ever in AUTO or tasked by us      ours: it waits for its first mission
LOITER at its mission's end, where that is the mode    ours
LOITER because its navigator rejected its mission      ours (MISSION_CURRENT tells, a moment later)
RTL out of AUTO because its mission is complete        ours (MISSION_CURRENT tells, a moment later)
any other change                                       taken, until AUTO is heard or an order frees it
=====================================================  ==========================================

A LOITER that an operator chooses while we hold the vehicle in LOITER cannot be told from ours.
"""

from __future__ import annotations

from gcs.mavlink.autopilots.modes import AUTO, LOITER, RTL
from gcs.model import PersistedAuthority


class ModeAuthority:
    """The record of one vehicle."""

    def __init__(self, mode: str = "") -> None:
        self.mode = ""
        """The mode last heard, empty before the first."""
        self.override = ""
        """The mode that somebody else chose; empty while the vehicle is ours."""
        self.has_ended = False
        """True if the vehicle is in RTL because its mission is complete."""
        self._previous = ""
        self._commanded = ""
        self._tasked = False
        if mode:
            self.observe_mode(mode)

    def note_command(self, mode: str) -> None:
        """Note that we send an order for this mode."""
        self._commanded = mode
        self._tasked = self._tasked or mode == AUTO

    def observe_mode(self, mode: str, *, at_end: bool = False) -> None:
        """Take the mode of a heartbeat; `at_end` when a mission's end would show as it."""
        if mode == self.mode:
            return
        first, self._previous, self.mode, self.has_ended = not self.mode, self.mode, mode, False
        if mode == AUTO:
            self.override, self._tasked = "", True
        elif mode == LOITER and (self._commanded == LOITER or not self._tasked or at_end):
            self.override = ""
        elif not (first and mode == LOITER):
            self.override, self._commanded = mode, ""

    def note_rejection(self) -> None:
        """Note that the vehicle is in LOITER because it has no valid mission: nobody chose that."""
        if self.override == LOITER:
            self.override = ""

    @property
    def may_have_ended(self) -> bool:
        """True if the vehicle went from AUTO to RTL: at its mission's end, by a failsafe or an order."""
        return self.override == RTL and self._previous == AUTO

    def note_completion(self) -> None:
        """Note that the vehicle went from AUTO to RTL because its mission is complete."""
        if self.may_have_ended:
            self.override, self.has_ended = "", True

    def persisted(self) -> PersistedAuthority:
        """Return what is to be remembered over a restart of the service."""
        taken = self.mode if self.has_ended else self.override
        return PersistedAuthority(self.mode, taken, self._commanded, self._tasked)

    def restore(self, memory: PersistedAuthority) -> None:
        """Take up from what was remembered: the next mode that is heard is held against that one."""
        self.mode, self.override = memory.mode, memory.taken
        self._commanded, self._tasked = memory.ordered, memory.tasked

    def note_reboot(self) -> None:
        """Forget the mode: what it is in now, nobody may have chosen."""
        self.mode = self._previous = self._commanded = ""
        self.has_ended = False

    def release(self) -> None:
        """Take the vehicle back, on an operator's order."""
        self.override, self._tasked = "", False
