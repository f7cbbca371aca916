"""Inbox of orders from zenoh: queues for each sender, rate limits, safety orders first.

An order costs up to 60 ms of the one consumer (a new no-fly zone is planned around at once). A flood would
delay vehicles' frames and heartbeats. `BURST` orders pass at once, then `ORDERS_PER_S`, senders in turn: one
that sends many waits for itself. `SAFETY` orders go before all others and have a rate of their own. So do
requests for the status: viewers may send them, and must not delay orders. Of each sender `MAX_WAITING` wait;
more are refused, answered as such, and counted. Senders repeat an order until it is answered.
"""

from __future__ import annotations

import threading
from collections import deque
from typing import Final, NamedTuple, get_args

import msgspec

from gcs.errors import WireError
from gcs.geo import LocalFrame
from gcs.io.zenoh.key_expressions import status_request_key
from gcs.io.zenoh.order_messages import MAX_ORDER_BYTES, decode_order
from gcs.model import NS_PER_S, Action, BadInput, Order, OrderAnswer

SAFETY: Final = frozenset({"hold", "return", "disarm"})
"""Orders that nothing may delay."""
ORDERS_PER_S: Final = 10
SAFETY_PER_S: Final = 20
BURST: Final = 5
MAX_WAITING: Final = 50
MAX_SENDERS: Final = 64
_MAX_SENDER: Final = 200
_MAX_ACCEPTED_IDS: Final = 1000
_MIN_NOTICE_INTERVAL_NS: Final = NS_PER_S
_ACTIONS: Final = frozenset(get_args(Action))


class _Head(msgspec.Struct):
    """What says whose an order is, and which."""

    order_id: str = ""
    action: str = ""
    origin: str = ""


_decode_head = msgspec.json.Decoder(_Head).decode


class _Waiting(NamedTuple):
    head: _Head
    key: str
    payload: bytes


class _Queues:
    """Orders of one kind until their turn; the senders take turns."""

    def __init__(self, per_s: int) -> None:
        self._per_s = per_s
        self._senders: deque[str] = deque()
        """Those with waiting orders; the first one is next."""
        self._waiting: dict[str, deque[_Waiting]] = {}
        self._allowance_ns = BURST * NS_PER_S
        self._t_ns = 0
        """Orders that may pass now times a second, and the time of that."""

    def put(self, order: _Waiting) -> str:
        """Queue an order; return why not, or an empty text."""
        sender = order.head.origin
        queue = self._waiting.get(sender)
        if queue is None:
            if len(self._senders) >= MAX_SENDERS:
                return f"orders of {MAX_SENDERS} senders wait"
            self._senders.append(sender)
            queue = self._waiting[sender] = deque()
        elif order.head.order_id and any(one.head.order_id == order.head.order_id for one in queue):
            return ""  # repeated
        if len(queue) >= MAX_WAITING:
            return f"{MAX_WAITING} orders of the sender {sender or 'without a name'} wait"
        queue.append(order)
        return ""

    def refill(self, t_ns: int) -> None:
        """Add the turns of the time that has passed."""
        passed_ns = max(0, t_ns - self._t_ns)
        self._allowance_ns = min(BURST * NS_PER_S, self._allowance_ns + self._per_s * passed_ns)
        self._t_ns = t_ns

    def spend(self) -> None:
        """Take a turn."""
        self._allowance_ns -= NS_PER_S

    def pop(self) -> _Waiting | None:
        """Return the next order; None if none waits, or none may pass now."""
        if not self._senders or self._allowance_ns < NS_PER_S:
            return None
        sender = self._senders.popleft()
        queue = self._waiting[sender]
        order = queue.popleft()
        if queue:
            self._senders.append(sender)
        else:
            del self._waiting[sender]
        return order


class OrderInbox:
    """Orders until their turn. `put` may be called by any thread.

    Parameters
    ----------
    frame : LocalFrame
        Frame for areas in degrees.
    name : str
        Name of the mission, for answers.
    """

    def __init__(self, frame: LocalFrame, name: str) -> None:
        self.refused = 0
        """Orders beyond the bounds."""
        self._frame = frame
        self._name = name
        self._lock = threading.Lock()
        self._status_key = status_request_key(name)
        self._safety = _Queues(SAFETY_PER_S)
        self._others = _Queues(ORDERS_PER_S)
        self._requests = _Queues(ORDERS_PER_S)
        """Requests for the status."""
        self._accepted_ids: dict[str, None] = {}
        """Ids of the last orders."""
        self._unanswered: dict[str, tuple[_Head, str]] = {}
        """The last refused order of each sender, and why."""
        self._reported = 0
        self._reported_t_ns = 0

    def put(self, key: str, payload: bytes) -> bool:
        """Queue an order; return False if its sender, or too many senders, have too many that wait."""
        order = _Waiting(_head(payload), key, payload[: MAX_ORDER_BYTES + 1])
        with self._lock:
            if key == self._status_key:
                queues = self._requests
            else:
                queues = self._safety if order.head.action in SAFETY else self._others
            problem = queues.put(order)
            if not problem:
                return True
            self.refused += 1
            if order.head.origin in self._unanswered or len(self._unanswered) < MAX_SENDERS:
                self._unanswered[order.head.origin] = (order.head, problem)
            return False

    def take_due(self, t_ns: int) -> list[Order | BadInput]:
        """Return the orders whose turn it is, safety orders first, and bad input; drop repeated orders."""
        due: list[Order | BadInput] = []
        with self._lock:
            for queues in (self._safety, self._others, self._requests):
                queues.refill(t_ns)
                while (waiting := queues.pop()) is not None:
                    found = self._read(t_ns, waiting)
                    if found is not None:
                        queues.spend()
                        due.append(found)
        return due

    def _read(self, t_ns: int, waiting: _Waiting) -> Order | BadInput | None:
        try:
            order = decode_order(waiting.key, waiting.payload, t_ns, self._frame)
        except WireError as error:
            return BadInput(t_ns, waiting.key, str(error))
        if waiting.key == self._status_key and order.action != "status":
            return BadInput(t_ns, waiting.key, f"only status can be asked for here, not {order.action}")
        if order.order_id in self._accepted_ids:
            return None
        self._accepted_ids[order.order_id] = None
        while len(self._accepted_ids) > _MAX_ACCEPTED_IDS:
            del self._accepted_ids[next(iter(self._accepted_ids))]
        return order

    def forget(self, order_id: str) -> None:
        """Take an order again that was not carried out, when its sender repeats it."""
        with self._lock:
            self._accepted_ids.pop(order_id, None)

    def take_refusals(self, t_ns: int) -> list[OrderAnswer]:
        """Return an answer to the last refused order of each sender."""
        with self._lock:
            refused = list(self._unanswered.values())
            self._unanswered.clear()
        return [
            OrderAnswer(
                t_ns,
                head.order_id,
                head.action,  # type: ignore[arg-type]
                "refused",
                f"the order queue of {self._name} is full: {problem}; end the program that sends so many, "
                "then send the order again",
            )
            for head, problem in refused
            if head.order_id and head.action in _ACTIONS
        ]

    def news(self, t_ns: int, key: str) -> list[BadInput]:
        """Return, once a second at most, the number of refused orders since the last call."""
        new = self.refused - self._reported
        if not new or 0 <= t_ns - self._reported_t_ns < _MIN_NOTICE_INTERVAL_NS:
            return []
        self._reported = self.refused
        self._reported_t_ns = t_ns
        problem = (
            f"{new} orders refused: more than {ORDERS_PER_S} a second, {self.refused} so far; find the "
            "program that publishes them"
        )
        return [BadInput(t_ns, key, problem)]


def _head(payload: bytes) -> _Head:
    """Return the head of an order; an empty one if it cannot be read."""
    if len(payload) > MAX_ORDER_BYTES:
        return _Head()
    try:
        head = _decode_head(payload)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError):
        return _Head()
    return _Head(head.order_id[:_MAX_SENDER], head.action, head.origin[:_MAX_SENDER])
