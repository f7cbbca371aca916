"""Rate limit between zenoh and the event queue for orders.

An order costs up to 60 ms of the one consumer (a new no-fly zone is planned around at once). A flood would
delay vehicles' frames and heartbeats. `BURST` orders pass at once, then `ORDERS_PER_S`; `MAX_WAITING` wait,
more are refused and counted. Senders repeat an order until it is answered.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from gcs.errors import WireError
from gcs.geo import LocalFrame
from gcs.io.zenoh.order_messages import decode_order
from gcs.model import NS_PER_S, BadInput, Order

ORDERS_PER_S: Final = 10
BURST: Final = 5
MAX_WAITING: Final = 50
_MAX_ACCEPTED_IDS: Final = 1000
_MIN_NOTICE_INTERVAL_NS: Final = NS_PER_S


class OrderInbox:
    """Orders until their turn.

    Parameters
    ----------
    frame : LocalFrame
        Frame for areas in degrees.
    """

    def __init__(self, frame: LocalFrame) -> None:
        self.refused = 0
        """Orders beyond the bound."""
        self._frame = frame
        self._waiting: deque[tuple[str, bytes]] = deque()
        self._accepted_ids: dict[str, None] = {}
        """Ids of the last orders."""
        self._allowance_ns, self._t_ns = BURST * NS_PER_S, 0
        """Orders that may pass now times a second, and the time of that."""
        self._reported, self._reported_t_ns = 0, 0

    def put(self, key: str, payload: bytes) -> None:
        """Queue an order; refuse it if too many wait."""
        if len(self._waiting) < MAX_WAITING:
            self._waiting.append((key, payload))
        else:
            self.refused += 1

    def take_due(self, t_ns: int) -> list[Order | BadInput]:
        """Return the orders whose turn it is, and bad input; a repeated order is dropped."""
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
        if order.order_id in self._accepted_ids:
            return None
        self._accepted_ids[order.order_id] = None
        while len(self._accepted_ids) > _MAX_ACCEPTED_IDS:
            del self._accepted_ids[next(iter(self._accepted_ids))]
        return order

    def news(self, t_ns: int, key: str) -> list[BadInput]:
        """Return, once a second at most, the number of refused orders since the last call."""
        new = self.refused - self._reported
        if not new or 0 <= t_ns - self._reported_t_ns < _MIN_NOTICE_INTERVAL_NS:
            return []
        self._reported, self._reported_t_ns = self.refused, t_ns
        problem = (
            f"{new} orders refused: more than {ORDERS_PER_S} a second, {self.refused} so far; find the "
            "program that publishes them"
        )
        return [BadInput(t_ns, key, problem)]
