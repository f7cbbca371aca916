"""A program that floods the service with orders holds up no heartbeat, and one order among them is heard."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import threading
import time

import pytest
from helpers.noticed import noticed

from gcs.config import Config, load
from gcs.core.airspace.airspace_state import AirspaceState
from gcs.core.airspace.incursion_warning import IncursionWarnings
from gcs.core.airspace.no_fly_zones import ClosedZone
from gcs.endpoints import Link, parse_endpoint
from gcs.errors import LinkError, WireError
from gcs.geo import LocalFrame
from gcs.io.clock import RunClock
from gcs.io.links.manager import Links
from gcs.io.zenoh import order_inbox
from gcs.io.zenoh.discovery import ServiceAddress
from gcs.io.zenoh.key_expressions import order_key
from gcs.io.zenoh.order_client import request_status, send_order
from gcs.io.zenoh.order_inbox import BURST, MAX_SENDERS, MAX_WAITING, ORDERS_PER_S, OrderInbox
from gcs.io.zenoh.order_messages import OrderMessage, decode_order
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.model import NS_PER_S, BadInput, Notice, NoticeCode, Order, OrderAnswer, Tick
from gcs.service.service import Service
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

FRAME = LocalFrame(33.2, -87.6, 70.0)
KEY = order_key("prescribed")


def order(number: int, action: str = "resume", origin: str = "flood") -> bytes:
    fields = {"order_id": f"o-{number}", "action": action, "vehicles": "all", "origin": origin}
    return json.dumps(fields).encode()


class Measurements:
    """A sink: ticks and the orders between them, answers and notices."""

    def __init__(self) -> None:
        self.orders_before_tick = [0]
        self.answered: set[str] = set()
        self.notices: list[Notice] = []

    def event(self, event: object) -> None:
        if isinstance(event, Tick):
            self.orders_before_tick.append(0)
        elif isinstance(event, Order):
            self.orders_before_tick[-1] += 1

    def effect(self, _t_ns: int, effect: object) -> None:
        if isinstance(effect, OrderAnswer):
            self.answered.add(effect.order_id)
        if isinstance(effect, Notice):
            self.notices.append(effect)


@pytest.mark.real_time
def test_fifteen_thousand_orders_stall_nothing_and_the_operators_own_is_carried_out():
    seen, config = Measurements(), load("prescribed")

    def flood(endpoint: str, ended: threading.Event) -> None:
        with ZenohSession(connect=endpoint) as bus:
            time.sleep(0.3)
            for number in range(15_000):
                bus.publish(KEY, order(number))
            for _ in range(300):  # as `gcs order` does, until it hears an answer
                bus.publish(KEY, order(-1, "return"))
                if ended.wait(0.2):
                    return

    async def serve(bus: ZenohSession, ended: threading.Event) -> None:
        links = Links([Link(parse_endpoint("udpin:127.0.0.1:0"))], [1], config.local_frame)
        service = Service(config, 1, links, bus)
        service.sinks.append(seen)
        stop = asyncio.Event()
        running = asyncio.create_task(service.run(RunClock(), stop))
        for _ in range(1200):
            if "o--1" in seen.answered and len(seen.orders_before_tick) > 60:
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
    assert max(seen.orders_before_tick) <= 2 * BURST  # of which few are safety orders
    assert "o--1" in seen.answered
    assert len(seen.answered) < 500
    bad_input = noticed(seen.notices, NoticeCode.BAD_INPUT, NoticeCode.BAD_INPUT_MORE)
    assert any("orders refused" in notice.parameters["problem"] for notice in bad_input)


def test_orders_go_on_at_a_bounded_rate_and_all_others_are_counted():
    inbox = OrderInbox(FRAME, "prescribed")
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


def test_senders_take_turns_and_safety_orders_go_first():
    inbox = OrderInbox(FRAME, "prescribed")
    for number in range(1000):
        inbox.put(KEY, order(number))
    inbox.put(KEY, order(2001, origin="operator"))
    inbox.put(KEY, order(2000, "hold", "operator"))
    due = [one.order_id for one in inbox.take_due(NS_PER_S) if isinstance(one, Order)]
    assert due[:3] == ["o-2000", "o-0", "o-2001"]
    later = NS_PER_S
    for action in ("return", "disarm", "hold"):
        later += NS_PER_S // 5
        inbox.put(KEY, order(later, action, "operator"))
        first = inbox.take_due(later)[0]
        assert isinstance(first, Order)
        assert first.action == action


def test_a_sender_of_holds_does_not_keep_others_from_holding():
    inbox = OrderInbox(FRAME, "prescribed")
    for number in range(1000):
        inbox.put(KEY, order(number, "hold"))
    assert inbox.put(KEY, order(2000, "hold", "operator"))
    due = [one.order_id for one in inbox.take_due(NS_PER_S) if isinstance(one, Order)]
    assert due[:2] == ["o-0", "o-2000"]


def test_each_sender_whose_orders_find_a_full_queue_is_told_so():
    inbox = OrderInbox(FRAME, "prescribed")
    for number in range(1000):
        inbox.put(KEY, order(number))
    inbox.put(KEY, b"[" * 10_000)
    inbox.put(KEY, b"x" * 100_000)
    (answer,) = inbox.take_refusals(NS_PER_S)
    assert (answer.order_id, answer.state, answer.waiting) == ("o-999", "refused", ())
    assert answer.detail.startswith(
        "the order queue of prescribed is full: 50 orders of the sender flood wait"
    )
    assert inbox.take_refusals(NS_PER_S) == []
    for number in range(MAX_SENDERS):
        inbox.put(KEY, order(number, origin=f"s-{number}"))
    assert f"orders of {MAX_SENDERS} senders wait" in inbox.take_refusals(NS_PER_S)[-1].detail


def test_the_command_names_a_full_queue(monkeypatch):
    """It said that no service answers."""
    monkeypatch.setattr(order_inbox._Queues, "put", lambda *_: "orders of 64 senders wait")
    config, endpoint = load("prescribed"), free_endpoint()
    found: list[str] = []

    async def serve(bus: ZenohSession) -> None:
        links = Links([Link(parse_endpoint("udpin:127.0.0.1:0"))], [1], config.local_frame)
        stop = asyncio.Event()
        running = asyncio.create_task(Service(config, 1, links, bus).run(RunClock(), stop))
        message = OrderMessage(order_id="a", action="hold", vehicles="all", origin="operator")

        def ask() -> None:
            address = ServiceAddress("prescribed", endpoint, None)
            found.extend(one.detail for one in send_order(address, message, 5.0, 5.0))
            with pytest.raises(LinkError) as error:
                request_status(address, 2.0)
            found.append(str(error.value))

        await asyncio.to_thread(ask)
        stop.set()
        await asyncio.wait_for(running, 10.0)

    with ZenohSession(listen=endpoint) as bus:
        asyncio.run(serve(bus))
    assert len(found) == 2
    assert all("the order queue of prescribed is full: " in text for text in found)


class Vehicles:
    """Four simulated vehicles that fly in real time, and which of them loiter."""

    def __init__(self, port: int, config: Config) -> None:
        self.loitered: set[int] = set()
        self._port, self._frame, self._ends = port, config.local_frame, threading.Event()
        self._thread = threading.Thread(target=self._fly, daemon=True)
        self._thread.start()

    def _fly(self) -> None:
        specs = [VehicleSpec(one, 300.0, 300.0 * one, 1.57, 100.0, 15.0) for one in (1, 2, 3, 4)]
        flown = [(SimVehicle(one, self._frame, time.time_ns()), _link()) for one in specs]
        for vehicle, _ in flown:
            vehicle.autopilot.set_mode(Mode.RTL)
        while not self._ends.wait(0.02):
            for vehicle, link in flown:
                for datagram in vehicle.datagrams_to_send(time.time_ns()):
                    link.sendto(datagram, ("127.0.0.1", self._port))
                with contextlib.suppress(BlockingIOError):
                    while True:
                        vehicle.receive_datagram(link.recv(2048), time.time_ns())
                if vehicle.autopilot.mode == Mode.LOITER:
                    self.loitered.add(vehicle.system_id)
        for _, link in flown:
            link.close()

    def end(self) -> None:
        self._ends.set()
        self._thread.join(5.0)


class Taken:
    """A sink that keeps the ids of the orders as they are taken."""

    def __init__(self) -> None:
        self.order_ids: list[str] = []

    def event(self, event: object) -> None:
        if isinstance(event, Order):
            self.order_ids.append(event.order_id)

    def effect(self, _t_ns: int, _effect: object) -> None:
        pass


def _link() -> socket.socket:
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.setblocking(False)
    link.bind(("127.0.0.1", 0))
    return link


@pytest.mark.real_time
def test_hold_all_goes_before_the_orders_of_a_program_that_sends_a_thousand_a_second(monkeypatch):
    config, endpoint = load("prescribed"), free_endpoint()
    ends, answers, taken = threading.Event(), list[str](), Taken()
    taken_before, put = list[int](), OrderInbox.put

    def noted_put(inbox: OrderInbox, key: str, payload: bytes) -> bool:
        if b'"operator"' in payload:
            taken_before.append(len(taken.order_ids))
        return put(inbox, key, payload)

    def flood() -> None:
        with ZenohSession(connect=endpoint) as bus:
            for number in range(100_000):
                bus.publish(KEY, order(number, ("unpin", "plan")[number % 2]))
                if number % 50 == 49 and ends.wait(0.05):
                    return

    def hold() -> None:
        message = OrderMessage(order_id="hold", action="hold", vehicles="all", origin="operator")
        time.sleep(2.0)  # with the flood under way
        address = ServiceAddress("prescribed", endpoint, None)
        answers.extend(answer.state for answer in send_order(address, message, 30.0, 60.0))

    async def serve(bus: ZenohSession) -> None:
        links = Links([Link(parse_endpoint("udpin:127.0.0.1:0"))], [1, 2, 3, 4], config.local_frame)
        stop = asyncio.Event()
        service = Service(config, 1, links, bus)
        service.sinks.append(taken)
        running = asyncio.create_task(service.run(RunClock(), stop))
        await asyncio.sleep(0.2)
        vehicles = Vehicles(links.port, config)
        sender = threading.Thread(target=flood, daemon=True)
        sender.start()
        await asyncio.to_thread(hold)
        ends.set()
        vehicles.end()
        sender.join(5.0)
        stop.set()
        await asyncio.wait_for(running, 10.0)
        assert vehicles.loitered == {1, 2, 3, 4}

    monkeypatch.setattr(OrderInbox, "put", noted_put)
    with ZenohSession(listen=endpoint) as bus:
        asyncio.run(serve(bus))
    assert answers == ["accepted", *["done"] * 4]
    assert len(taken.order_ids) > BURST
    assert taken.order_ids.index("hold") - taken_before[0] <= BURST


def test_an_order_that_is_repeated_costs_no_turn():
    inbox = OrderInbox(FRAME, "prescribed")
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

    from gcs.core.airspace.obstacle_map import ObstacleMap
    from gcs.model import UNLIMITED, LayerHeights, VehicleState
    from gcs.planning.map.grid import Grid

    class OnboardMissions:
        def points_ahead(self, _vehicle: int) -> tuple[tuple[float, float], ...]:
            return ((900.0, 5.0), (900.0, 900.0))

        def return_items_ahead(self, _vehicle: int) -> tuple[()]:
            return ()

    blocked = np.zeros((100, 100), dtype=np.bool_)
    on_map = ObstacleMap(Grid((0.0, 0.0), 10.0, blocked), (), LayerHeights(100.0, 180.0, 70.0, 20.0))
    areas = {}
    for number in range(100):
        one = blocked.copy()
        one[60 + number % 5, 10] = True
        areas[f"a{number}"] = ClosedZone(Grid((0.0, 0.0), 10.0, one), UNLIMITED, on_map)
    frame = LocalFrame(33.2, -87.6, 70.0)
    warnings = IncursionWarnings(AirspaceState(), OnboardMissions(), frame)  # type: ignore[arg-type]
    checks = []
    entry = warnings._entry
    monkeypatch.setattr(warnings, "_entry", lambda *a: checks.append(a) or entry(*a))
    fields = dict.fromkeys(VehicleState.__dataclass_fields__, 0) | {"east_m": 5.0, "north_m": 5.0}
    warnings.entries([VehicleState(**fields)], areas)
    assert len(checks) == 1
