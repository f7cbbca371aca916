"""The terms of a mission task: what it waits for, and what it reports.

Defaults follow https://mavlink.io/en/services/mission.html (1.5 s for an answer) and what ArduPlane does;
radios that are slow get other numbers, not other code.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from gcs.mavlink.asking import Patience

Stage: TypeAlias = Literal["new", "upload", "verify", "select", "mode", "hold", "clear", "done"]
Holds: TypeAlias = Literal["equal", "old", "cleared", "unknown"]


@dataclass(frozen=True, slots=True)
class Timing:
    """Time-outs and bounds, per step: the only bound on the whole is `give_up_s`."""

    answer: Patience = field(default_factory=lambda: Patience(wait_s=1.5, wait_max_s=3.0))
    """MISSION_COUNT, MISSION_REQUEST_LIST, MISSION_CLEAR_ALL and commands."""
    item: Patience = field(default_factory=lambda: Patience(wait_s=0.4, wait_max_s=1.5, tries=20))
    """One item of a read-back."""
    silence_s: float = 8.5
    """Upload without a request; ArduPlane asks each second and gives up after 8 s."""
    last_ack_s: float = 2.5
    """After the last item; then the read-back decides."""
    settle_s: float = 1.2
    """Before a failure ACK or a late request is believed: longer than ArduPlane takes to ask again."""
    uploads: int = 8
    """Times that the upload is started before the task is abandoned."""
    refusals: int = 4
    """Times that a command may be refused."""
    current_silence_s: float = 5.0
    """In AUTO over a mixed store without MISSION_CURRENT: hold."""
    give_up_s: float = 300.0
    """Upload and read-back together: generous, against a stall that no step sees."""


@dataclass(frozen=True, slots=True)
class TaskResult:
    """How a task ended."""

    t_ns: int
    ok: bool
    holds: Holds
    """What it stores: this mission ("equal"), what it had before ("old"), none ("cleared"), or "unknown"."""
    detail: str
    duration_s: float
    retries: int
    held: bool
    """Whether it was told to LOITER, and so does not fly its mission unless `ok`."""
