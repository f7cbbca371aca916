"""Orders between zenoh and the queue: a bounded number waits, and a bounded number a second goes on.

An order costs up to 60 ms of the one consumer (an area that is closed is planned around at once). So many
of them at a time would hold up vehicles' frames and heartbeats. `BURST` orders go on at once, then
`ORDERS_PER_S`; `MAX_WAITING` wait, and what comes then is refused and counted. Senders repeat an order until
they hear an answer, so one that was refused in a flood is heard after it.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from gcs.errors import WireError
from gcs.geo import LocalFrame
from gcs.io.zenoh.orders import decode_order
from gcs.model import NS_PER_S, BadInput, Order

ORDERS_PER_S: Final = 10
BURST: Final = 5
MAX_WAITING: Final = 50
_MAX_REMEMBERED: Final = 1000
_TELL_EVERY_NS: Final = NS_PER_S


class OrderInbox:
    """Orders as they came, until their turn.

    Parameters
    ----------
    frame : LocalFrame
        Where areas in degrees are put.
    """

    def __init__(self, frame: LocalFrame) -> None:
        self.refused = 0
        """Orders that found no room."""
        self._frame = frame
        self._waiting: deque[tuple[str, bytes]] = deque()
        self._taken: dict[str, None] = {}
        """Ids of the orders taken last."""
        self._allowance_ns, self._t_ns = BURST * NS_PER_S, 0
        """Orders that may go on now times a second, and when that was so."""
        self._told, self._told_t_ns = 0, 0

    def put(self, key: str, payload: bytes) -> None:
        """Keep an order until its turn; refuse it when too many wait."""
        if len(self._waiting) < MAX_WAITING:
            self._waiting.append((key, payload))
        else:
            self.refused += 1

    def due(self, t_ns: int) -> list[Order | BadInput]:
        """Return the orders whose turn it is, and what was not one; an order that comes twice is one."""
        passed_ns = max(0, t_ns - self._t_ns)
        self._allowance_ns = min(BURST * NS_PER_S, self._allowance_ns + ORDERS_PER_S * passed_ns)
        self._t_ns = t_ns
        due: list[Order | BadInput] = []
        while self._waiting and self._allowance_ns >= NS_PER_S:
            found = self._read(t_ns, *self._waiting.popleft())
            if found is not None:
                self._allowance_ns -= NS_PER_S
                due.append(found)
        return due

    def _read(self, t_ns: int, key: str, payload: bytes) -> Order | BadInput | None:
        try:
            order = decode_order(key, payload, t_ns, self._frame)
        except WireError as error:
            return BadInput(t_ns, key, str(error))
        if order.order_id in self._taken:
            return None
        self._taken[order.order_id] = None
        while len(self._taken) > _MAX_REMEMBERED:
            del self._taken[next(iter(self._taken))]
        return order

    def news(self, t_ns: int, key: str) -> list[BadInput]:
        """Return, once a second at most, how many orders on a key were refused since the last call."""
        new = self.refused - self._told
        if not new or 0 <= t_ns - self._told_t_ns < _TELL_EVERY_NS:
            return []
        self._told, self._told_t_ns = self.refused, t_ns
        problem = (
            f"{new} orders refused: more than {ORDERS_PER_S} a second, {self.refused} so far; find the "
            "program that publishes them"
        )
        return [BadInput(t_ns, key, problem)]
