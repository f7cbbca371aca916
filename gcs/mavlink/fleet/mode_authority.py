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
        self.taken = ""
        """The mode that somebody else chose; empty while the vehicle is ours."""
        self.has_ended = False
        """True if the vehicle is in RTL because its mission is complete."""
        self._before = ""
        self._ordered = ""
        self._tasked = False
        if mode:
            self.heard(mode)

    def ordered(self, mode: str) -> None:
        """Note that we send an order for this mode."""
        self._ordered = mode
        self._tasked = self._tasked or mode == AUTO

    def heard(self, mode: str, *, at_end: bool = False) -> None:
        """Take the mode of a heartbeat; `at_end` when a mission's end would show as it."""
        if mode == self.mode:
            return
        first, self._before, self.mode, self.has_ended = not self.mode, self.mode, mode, False
        if mode == AUTO:
            self.taken, self._tasked = "", True
        elif mode == LOITER and (self._ordered == LOITER or not self._tasked or at_end):
            self.taken = ""
        elif not (first and mode == LOITER):
            self.taken, self._ordered = mode, ""

    def rejected(self) -> None:
        """Note that the vehicle is in LOITER because it has no valid mission: nobody chose that."""
        if self.taken == LOITER:
            self.taken = ""

    @property
    def may_have_ended(self) -> bool:
        """True if the vehicle went from AUTO to RTL: at its mission's end, by a failsafe or an order."""
        return self.taken == RTL and self._before == AUTO

    def completed(self) -> None:
        """Note that the vehicle went from AUTO to RTL because its mission is complete."""
        if self.may_have_ended:
            self.taken, self.has_ended = "", True

    def memory(self) -> PersistedAuthority:
        """Return what is to be remembered over a restart of the service."""
        taken = self.mode if self.has_ended else self.taken
        return PersistedAuthority(self.mode, taken, self._ordered, self._tasked)

    def remember(self, memory: PersistedAuthority) -> None:
        """Take up from what was remembered: the next mode that is heard is held against that one."""
        self.mode, self.taken = memory.mode, memory.taken
        self._ordered, self._tasked = memory.ordered, memory.tasked

    def rebooted(self) -> None:
        """Forget the mode: what it is in now, nobody may have chosen."""
        self.mode = self._before = self._ordered = ""
        self.has_ended = False

    def release(self) -> None:
        """Take the vehicle back, on an operator's order."""
        self.taken, self._tasked = "", False
