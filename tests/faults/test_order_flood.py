"""A program that floods the service with orders holds up no heartbeat, and one order among them is heard."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from itertools import pairwise

import pytest

from gcs.config import load
from gcs.core.airspace.incursion_warning import IncursionWarnings
from gcs.core.airspace.records import AirspaceState
from gcs.endpoints import Link, parse_endpoint
from gcs.errors import WireError
from gcs.geo import LocalFrame
from gcs.io.clock import RunClock
from gcs.io.links.manager import Links
from gcs.io.zenoh.key_expressions import order_key
from gcs.io.zenoh.order_inbox import BURST, MAX_WAITING, ORDERS_PER_S, OrderInbox
from gcs.io.zenoh.order_messages import decode_order
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.model import NS_PER_S, BadInput, Notice, Order, OrderAnswer, Tick
from gcs.service.service import Service

FRAME = LocalFrame(33.2, -87.6, 70.0)
KEY = order_key("prescribed")


def order(number: int, action: str = "hold") -> bytes:
    return json.dumps({"order_id": f"o-{number}", "action": action, "vehicles": "all"}).encode()


class Measurements:
    """A sink: times of ticks, answers and notices."""

    def __init__(self) -> None:
        self.worked_s: list[float] = []
        self.answered: set[str] = set()
        self.texts: list[str] = []

    def event(self, event: object) -> None:
        if isinstance(event, Tick):
            self.worked_s.append(time.monotonic())

    def effect(self, _t_ns: int, effect: object) -> None:
        if isinstance(effect, OrderAnswer):
            self.answered.add(effect.order_id)
        if isinstance(effect, Notice):
            self.texts.append(effect.text)


def test_fifteen_thousand_orders_stall_nothing_and_the_operators_own_is_carried_out():
    seen, config = Measurements(), load("prescribed")

    def flood(endpoint: str, ended: threading.Event) -> None:
        with ZenohSession(connect=endpoint) as bus:
            time.sleep(0.3)
            for number in range(15_000):
                bus.publish(KEY, order(number))
            for _ in range(60):  # as `gcs order` does, until it hears an answer
                bus.publish(KEY, order(-1, "return"))
                if ended.wait(0.2):
                    return

    async def serve(bus: ZenohSession, ended: threading.Event) -> None:
        links = Links([Link(parse_endpoint("udpin:127.0.0.1:0"))], [1], config.local_frame)
        service = Service(config, 1, links, bus)
        service.sinks.append(seen)
        stop = asyncio.Event()
        running = asyncio.create_task(service.run(RunClock(), stop))
        for _ in range(400):
            if "o--1" in seen.answered and len(seen.worked_s) > 60:
                break
            await asyncio.sleep(0.05)
        ended.set()
        stop.set()
        await asyncio.wait_for(running, 10.0)

    ended, endpoint = threading.Event(), free_endpoint()
    with ZenohSession(listen=endpoint) as bus:
        sender = threading.Thread(target=flood, args=(endpoint, ended), daemon=True)
        sender.start()
        asyncio.run(serve(bus, ended))
        sender.join(10.0)
    assert max(later - earlier for earlier, later in pairwise(seen.worked_s)) < 1.0
    assert "o--1" in seen.answered
    assert len(seen.answered) < 500
    assert any("orders refused" in text for text in seen.texts)


def test_orders_go_on_at_a_bounded_rate_and_all_others_are_counted():
    inbox = OrderInbox(FRAME)
    for number in range(1000):
        inbox.put(KEY, order(number))
    assert inbox.refused == 1000 - MAX_WAITING
    assert len(inbox.take_due(NS_PER_S)) == BURST
    assert inbox.take_due(NS_PER_S) == []
    assert len(inbox.take_due(NS_PER_S + NS_PER_S // ORDERS_PER_S)) == 1
    (notice,) = inbox.news(NS_PER_S, KEY)
    assert isinstance(notice, BadInput)
    assert notice.problem.startswith(f"{1000 - MAX_WAITING} orders refused")
    assert inbox.news(5 * NS_PER_S, KEY) == []


def test_an_order_that_is_repeated_costs_no_turn():
    inbox = OrderInbox(FRAME)
    for _ in range(40):
        inbox.put(KEY, order(1))
    inbox.put(KEY, order(2))
    found = inbox.take_due(NS_PER_S)
    assert [one.order_id for one in found if isinstance(one, Order)] == ["o-1", "o-2"]


@pytest.mark.parametrize(
    "fields",
    [
        {"action": "hold", "vehicles": list(range(1, 20_000))},
        {"action": "hold", "vehicles": "all", "origin": " " * 100_000},
    ],
)
def test_an_order_has_a_bounded_size(fields):
    with pytest.raises(WireError):
        decode_order(KEY, json.dumps({"order_id": "a", **fields}).encode(), 5, FRAME)


def test_a_vehicle_clear_of_all_areas_is_checked_once(monkeypatch):
    """With a hundred areas and hundreds of vehicles the check would else delay each scan."""
    import numpy as np

    from gcs.model import VehicleState
    from gcs.planning.map.grid import Grid

    class OnboardMissions:
        def points_ahead(self, _vehicle: int) -> tuple[tuple[float, float], ...]:
            return ((900.0, 5.0), (900.0, 900.0))

    blocked = np.zeros((100, 100), dtype=np.bool_)
    areas = {}
    for number in range(100):
        one = blocked.copy()
        one[60 + number % 5, 10] = True
        areas[f"a{number}"] = Grid((0.0, 0.0), 10.0, one)
    warnings = IncursionWarnings(AirspaceState(), OnboardMissions())  # type: ignore[arg-type]
    checks = []
    entry = warnings._entry
    monkeypatch.setattr(warnings, "_entry", lambda *a: checks.append(a) or entry(*a))
    fields = dict.fromkeys(VehicleState.__dataclass_fields__, 0) | {"east_m": 5.0, "north_m": 5.0}
    warnings.entries([VehicleState(**fields)], areas)
    assert len(checks) == 1
