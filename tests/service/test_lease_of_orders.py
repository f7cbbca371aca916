"""Two nodes would answer one order, one of them with nothing done."""

from __future__ import annotations

import asyncio
from typing import Any, cast

import pytest
from helpers.noticed import noticed

from gcs.config import load
from gcs.io.clock import RunClock
from gcs.io.links.vehicle_links import VehicleLinks
from gcs.io.zenoh.key_expressions import order_key
from gcs.io.zenoh.order_messages import OrderMessage, encode_order
from gcs.io.zenoh.session import ZenohSession
from gcs.model import Event, LinkNews, NoticeCode, Order
from gcs.service.service import Service


class LinksWithLease:
    """Links, and a bus, without anything; a lease that comes late."""

    links = ()
    has_lease = False

    def __getattr__(self, name: str) -> Any:
        return lambda *_, **__: {"may_command": self.has_lease, "commander": ""}.get(name)


async def events_of(action: str) -> tuple[list[Event], list[Event]]:
    """Return the events after an order to a node without the lease, and after its repetition with it."""
    links = LinksWithLease()
    service = Service(load("deterministic"), 1, cast(VehicleLinks, links), cast(ZenohSession, links))
    order = OrderMessage(order_id="one", action=action, vehicles=[1], origin="test")
    events: list[Event] = []

    class Sink:
        def event(self, event: Event) -> None:
            events.append(event)

        def effect(self, *_: object) -> None:
            pass

    service.sinks.append(cast(Any, Sink()))
    stop = asyncio.Event()
    run = asyncio.create_task(service.run(RunClock(), stop))
    found = []
    for has_lease in (False, True):
        links.has_lease = has_lease
        assert service._orders.put(order_key("deterministic"), encode_order(order))
        await asyncio.sleep(0.3)
        found.append(events.copy())
        events.clear()
    stop.set()
    await run
    return found[0], found[1]


@pytest.mark.parametrize("action", ["hold", "plan"])
def test_a_node_without_the_lease_takes_an_order_only_when_it_is_repeated_with_the_lease(action: str) -> None:
    without, with_lease = asyncio.run(events_of(action))
    assert not any(isinstance(event, Order) for event in without)
    notices = [event.notice for event in without if isinstance(event, LinkNews)]
    (told,) = noticed(notices, NoticeCode.ORDER_NOT_TAKEN)
    assert told.parameters == {"action": action}
    assert [event.order_id for event in with_lease if isinstance(event, Order)] == ["one"]
