"""Another service with our system and component id on a link: found by heartbeats that are not ours.

Each service has an instance number, from the time of its first tick. Its heartbeats carry the number as their
custom mode, which autopilots do not read from a ground station. So the heartbeats of another service differ
from ours, and from an echo of ours by a radio or a router. Without a number a heartbeat counts for neither.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from gcs.mavlink.fleet.peers import Address
from gcs.mavlink.services.retry import ns

SETTLED_NS: Final = ns(15.0)
"""Time after which no frame is on its way any more: loss, duplicates and delays of seconds are bridged."""
_MIN_HEARTBEATS: Final = 3
_MAX_GAP_NS: Final = ns(5.0)
_INSTANCES: Final = 2**32 - 1


@dataclass(slots=True)
class OwnIds:
    """Our instance, and the heartbeats of another one."""

    instance: int = 0
    """Our instance number; 0 before the first tick."""
    began_t_ns: int = 0
    """Time of that tick."""
    address: Address | None = None
    """Address of the other instance; None if none was heard."""
    heartbeats: int = 0
    """Its heartbeats without a gap of `_MAX_GAP_NS`."""
    heard_t_ns: int = 0
    """Time of the last one."""

    def begin(self, t_ns: int) -> None:
        """Set the instance number, at the first tick."""
        if not self.instance:
            self.instance = 1 + t_ns % _INSTANCES
            self.began_t_ns = t_ns

    def add_heartbeat(self, instance: int, address: Address, t_ns: int) -> None:
        """Note a heartbeat with our ids. Those of the service before a restart may come for a while."""
        is_settled = self.instance and t_ns - self.began_t_ns >= SETTLED_NS
        if not is_settled or instance in (0, self.instance):
            return
        self.heartbeats = self.heartbeats + 1 if t_ns - self.heard_t_ns <= _MAX_GAP_NS else 1
        self.address = address
        self.heard_t_ns = t_ns

    def other(self, t_ns: int) -> Address | None:
        """Return where another instance is heard now; None if there is none."""
        is_heard = self.heartbeats >= _MIN_HEARTBEATS and t_ns - self.heard_t_ns <= _MAX_GAP_NS
        return self.address if is_heard else None
