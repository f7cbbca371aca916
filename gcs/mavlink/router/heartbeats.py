"""Heartbeats of a bridge: they go on while command is slow or gone, for a limited time.

Command sends its heartbeats to each vehicle's address, four a second (`gcs.mavlink.fleet.heartbeat`). A
bridge passes them on. When the next one is late, the bridge sends it itself, with the sequence numbers that
follow, so that neither a long computation nor a restart of command lets a vehicle's GCS failsafe act. When
nothing has come from command for the time of a failover, the heartbeats end: the vehicles' own failsafes then
decide.

Pure: times and frames in, frames out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from gcs.mavlink.fleet.heartbeat import HEARTBEAT_PERIOD_NS, is_heartbeat
from gcs.mavlink.fleet.peers import Address
from gcs.mavlink.frames.codec import (
    GCS_COMPONENT_ID,
    GCS_SYSTEM_ID,
    OWN_IDS,
    Encoder,
    Frame,
    Message,
    next_sequence,
    scan,
)
from gcs.mavlink.services.retry import ns

_LATE_NS: Final = HEARTBEAT_PERIOD_NS + ns(0.1)
"""Time after a heartbeat of command at which the next one is late."""
_DROPPED_NS: Final = ns(2.0)
"""Command that is heard and sends no heartbeat to an address for so long has dropped the address."""


@dataclass(slots=True)
class _Kept:
    message: Message
    sequence: int
    """Of the last heartbeat."""
    sent_t_ns: int
    command_t_ns: int
    """Time of command's last heartbeat to this address."""


class HeartbeatKeeper:
    """Heartbeats of one bridge.

    Parameters
    ----------
    failover_ns : int
        Time after the last sign of command for which heartbeats go on.
    """

    def __init__(self, failover_ns: int) -> None:
        self._failover_ns = failover_ns
        self._command_t_ns: int | None = None
        self._kept: dict[Address, _Kept] = {}
        self._encode = Encoder()

    def note_command(self, t_ns: int) -> None:
        """Note a sign of command."""
        self._command_t_ns = t_ns

    def note_sent(self, t_ns: int, address: Address, data: bytes) -> None:
        """Note what command sends to an address: a heartbeat of it is kept."""
        if not _may_be_heartbeat(data):
            return
        for frame in scan(data):
            if _is_ours(frame) and (message := frame.message()) is not None:
                self._kept[address] = _Kept(message, frame.sequence, t_ns, t_ns)

    def due(self, t_ns: int) -> list[tuple[Address, bytes]]:
        """Return the heartbeats that are late now."""
        if self.have_ended(t_ns):
            return []
        self._drop_unused()
        late = [(address, kept) for address, kept in self._kept.items() if t_ns - kept.sent_t_ns >= _LATE_NS]
        for _, kept in late:
            kept.sequence = next_sequence(kept.sequence)
            # The next one is due a period after this one, however late this call is.
            kept.sent_t_ns = t_ns - (_LATE_NS - HEARTBEAT_PERIOD_NS)
        return [(address, self._encode.pack(kept.message, kept.sequence)) for address, kept in late]

    def have_ended(self, t_ns: int) -> bool:
        """Return True if command was not heard for the time of a failover, or has ended."""
        return self._command_t_ns is None or t_ns - self._command_t_ns > self._failover_ns

    def _drop_unused(self) -> None:
        command_t_ns = self._command_t_ns or 0
        self._kept = {
            address: kept
            for address, kept in self._kept.items()
            if command_t_ns - kept.command_t_ns <= _DROPPED_NS
        }

    def end(self) -> None:
        """End the heartbeats: command has ended."""
        self._command_t_ns = None
        self._kept.clear()


def _may_be_heartbeat(data: bytes) -> bool:
    """Return True if the first frame has our ids and the number of HEARTBEAT."""
    return data[5:10] == bytes((GCS_SYSTEM_ID, GCS_COMPONENT_ID, 0, 0, 0))


def _is_ours(frame: Frame) -> bool:
    return is_heartbeat(frame) and (frame.system_id, frame.component_id) == OWN_IDS
