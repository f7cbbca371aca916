"""Orders from pages and programs: the same form, checks and limits as orders on zenoh.

An order becomes an event of the service, so it is recorded. Its answers come back as effects.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Sequence
from typing import Any, Final

import msgspec

from gcs.console.view.page_state import World
from gcs.errors import LinkError, WireError
from gcs.geo import LocalFrame
from gcs.io.zenoh.order_messages import OrderMessage, decode_order, encode_order
from gcs.model import OrderAnswer

_SOURCE: Final = "console"
_NOT_SENT: Final = "; the order was NOT sent"


class RefusedOrderError(Exception):
    """The order cannot be passed on; the text says why."""


class OrderDesk:
    """Passes orders on.

    Parameters
    ----------
    world : World
        What is shown: its mission has the frame of areas in degrees.
    submit : callable or None
        Passes the JSON of an order to the service; None: a replay, which takes no orders.
    """

    def __init__(self, world: World, submit: Callable[[bytes], None] | None) -> None:
        self._world = world
        self._submit = submit

    def place(self, body: bytes, sender: str) -> str:
        """Check an order and pass it on; return its id.

        Raises
        ------
        RefusedOrderError
            When the order has a mistake, the service does not answer, the console's certificate allows no
            orders, or in a replay.
        """
        if self._submit is None:
            raise RefusedOrderError("this is a replay: nothing can be ordered")
        if self._world.is_lost:
            raise RefusedOrderError(f"the service does not answer{_NOT_SENT}")
        mission = self._world.mission
        try:
            fields = msgspec.json.decode(body, type=dict[str, Any])
        except (msgspec.DecodeError, RecursionError) as error:
            raise RefusedOrderError(f"not JSON: {error}") from None
        fields.setdefault("order_id", f"{_SOURCE}-{secrets.token_hex(6)}")
        fields["origin"] = f"console at {sender}"
        payload = msgspec.json.encode(fields)
        try:
            order = decode_order(_SOURCE, payload, 0, LocalFrame(*mission.origin_deg, mission.origin_alt_m))
        except WireError as error:
            raise RefusedOrderError(str(error)) from None
        try:
            self._submit(encode_order(msgspec.json.decode(payload, type=OrderMessage)))
        except LinkError as error:
            raise RefusedOrderError(error.problem + _NOT_SENT) from None
        return order.order_id


def is_answered(answers: Sequence[OrderAnswer]) -> bool:
    """Return True if the answers of one order say all that will be said."""
    return bool(answers) and not answers[-1].waiting
