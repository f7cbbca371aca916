"""Two services with our ids would task the same vehicles, and an operator would not know."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterable
from itertools import count

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.engine import Engine
from gcs.mavlink.frames.codec import Encoder
from gcs.model import (
    NS_PER_S,
    Authority,
    Datagram,
    Effect,
    Event,
    Notice,
    NoticeCode,
    Order,
    Send,
    Tick,
    UploadReport,
)
from sim_vehicles.campaign.virtual_run import LINK, START_T_NS, VirtualRun
from sim_vehicles.world.scenario import load

SIGN = NoticeCode.SECOND_COMMANDER


class Flown:
    """Notices and completed uploads of one service, with the second of each."""

    def __init__(self) -> None:
        self.notices: list[tuple[float, Notice]] = []
        self.uploads_s: list[float] = []

    def add(self, t_ns: int, effect: Effect) -> None:
        t_s = (t_ns - START_T_NS) / NS_PER_S
        if isinstance(effect, Notice):
            self.notices.append((t_s, effect))
        elif isinstance(effect, UploadReport) and effect.ok:
            self.uploads_s.append(t_s)

    def said(self, code: NoticeCode) -> list[tuple[float, int | None]]:
        """Return time and vehicle of each such notice."""
        return [(t_s, one.vehicle) for t_s, one in self.notices if one.code is code]


class TwoServices:
    """Two services on mirrored links: each hears all vehicles and all scans, and sends to all vehicles."""

    def __init__(self, name: str, seed: int, second_s: float, orders: Iterable[Order] = ()) -> None:
        scenario = load(name)
        self.first, self.second = Flown(), Flown()
        self.other = Engine(scenario.config, seed)
        self.second_t_ns = START_T_NS + round(second_s * NS_PER_S)
        self.end_t_ns = START_T_NS + 10**15
        self.run = VirtualRun(scenario, seed, self._mirror, self.first.add, orders=tuple(orders))

    def _mirror(self, event: Event) -> None:
        if not self.second_t_ns <= event.t_ns < self.end_t_ns or isinstance(event, Order):
            return
        for effect in self.other.step(event):
            self.second.add(event.t_ns, effect)
            if isinstance(effect, Send):
                self.run._to_vehicles.append(effect)


@pytest.mark.parametrize("name", ["prescribed", "random-targets"])
def test_a_second_service_is_named_within_a_second_and_nothing_more_is_uploaded_by_the_first(
    name: str,
) -> None:
    both = TwoServices(name, 2, 20.0)
    both.run.run(60.0)
    alarms = both.first.said(SIGN)
    assert sorted(vehicle or 0 for _, vehicle in alarms) == [1, 2, 3, 4]
    assert max(t_s for t_s, _ in alarms) < 21.0
    assert all(t_s < 21.0 for t_s in both.first.uploads_s)
    (sign, *_) = [one.parameters["sign"] for _, one in both.first.notices if one.code is SIGN]
    assert "MAV_CMD_" in sign
    assert "vehicle:" in sign
    assert LINK in sign
    for agent in both.run.engine.state.agents.values():
        assert Authority.SECOND_COMMANDER in agent.control.claims


@pytest.mark.parametrize(("name", "second_s"), [("prescribed", 0.05), ("random-targets", 5.0)])
def test_two_services_that_start_together_are_named_within_two_minutes(name: str, second_s: float) -> None:
    """Their uploads overlap: most answers could be to either."""
    both = TwoServices(name, 2, second_s)
    both.run.run(60.0)
    assert both.first.said(SIGN) + both.second.said(SIGN)


def test_an_operator_takes_the_vehicles_back_when_the_other_service_has_ended() -> None:
    """One that would wait beside an obstacle is refused, and ordered again."""
    orders = [Order(START_T_NS + t_s * NS_PER_S, f"o{t_s}", "resume", None, None) for t_s in (40, 50, 60)]
    both = TwoServices("prescribed", 2, 20.0, orders)
    both.end_t_ns = START_T_NS + 30 * NS_PER_S
    both.run.run(75.0)
    assert len(both.first.said(SIGN)) == 4
    assert both.first.said(NoticeCode.SECOND_COMMANDER_TOLERATED) == []
    assert [t_s for t_s in both.first.uploads_s if t_s > 40.0]
    for agent in both.run.engine.state.agents.values():
        assert Authority.SECOND_COMMANDER not in agent.control.claims


def test_an_operator_who_decides_against_the_alarm_is_obeyed_and_reminded() -> None:
    order = Order(START_T_NS + 25 * NS_PER_S, "o1", "resume", None, None)
    both = TwoServices("prescribed", 2, 20.0, [order])
    both.run.run(75.0)
    alarms = Counter(vehicle for _, vehicle in both.first.said(SIGN))
    assert alarms == {1: 1, 2: 1, 3: 1, 4: 1}
    assert [t_s for t_s in both.first.uploads_s if t_s > 25.0]
    assert both.first.said(NoticeCode.SECOND_COMMANDER_TOLERATED)


def test_the_reminder_ends_a_minute_after_the_other_service() -> None:
    order = Order(START_T_NS + 25 * NS_PER_S, "o1", "resume", None, None)
    both = TwoServices("prescribed", 2, 20.0, [order])
    both.end_t_ns = START_T_NS + 35 * NS_PER_S
    both.run.run(120.0)
    begun = {vehicle for _, vehicle in both.first.said(NoticeCode.SECOND_COMMANDER_TOLERATED)}
    over = both.first.said(NoticeCode.SECOND_COMMANDER_GONE)
    assert {vehicle for _, vehicle in over} == begun != set()
    assert len(over) == len(begun)
    assert all(80.0 < t_s < 110.0 for t_s, _ in over)


class Delayed:
    """Datagrams of a link with loss, duplicates and delays."""

    def __init__(self, rng: np.random.Generator, loss: float = 0.3, twice: float = 0.2) -> None:
        self.rng, self.loss, self.twice = rng, loss, twice
        self.waiting: list[tuple[int, int, object]] = []
        self.numbers = count()

    def put(self, t_ns: int, item: object) -> None:
        copies = 0 if self.rng.random() < self.loss else 1 + (self.rng.random() < self.twice)
        for _ in range(copies):
            wait_s = self.rng.choice([0.05, 0.3, 2.0], p=[0.6, 0.3, 0.1])
            heapq.heappush(self.waiting, (t_ns + round(wait_s * NS_PER_S), next(self.numbers), item))

    def due(self, t_ns: int) -> list[object]:
        found = []
        while self.waiting and self.waiting[0][0] <= t_ns:
            found.append(heapq.heappop(self.waiting)[2])
        return found


class Downlink:
    """What `VirtualRun` uses of a queue, over a bad link. Frames under way survive a restart."""

    def __init__(self, run: VirtualRun, link: Delayed) -> None:
        self.run, self.link, self.now = run, link, list[object]()

    def append(self, send: Send) -> None:
        self.link.put(self.run.t_ns, send)

    def __len__(self) -> int:
        self.now += self.link.due(self.run.t_ns)
        return len(self.now)

    def popleft(self) -> object:
        return self.now.pop(0)

    def clear(self) -> None:
        """A restart recalls nothing from the link."""


def bad_link(name: str, seed: int) -> tuple[VirtualRun, Flown]:
    """Return a mission over links with 30 % loss, duplicates and delays of up to 2 s, each way."""
    flown, rng = Flown(), np.random.default_rng(seed)
    up, down = Delayed(rng), Delayed(rng)

    def tamper(t_ns: int, peer: str, data: bytes) -> Iterable[tuple[str, bytes]]:
        up.put(t_ns, (peer, data))
        return up.due(t_ns)  # type: ignore[return-value]

    run = VirtualRun(load(name), seed, on_effect=flown.add, tamper=tamper)
    run._to_vehicles = Downlink(run, down)  # type: ignore[assignment]
    return run, flown


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
@pytest.mark.parametrize("name", ["prescribed", "random-targets"])
def test_late_and_repeated_answers_to_our_own_requests_never_stop_the_tasking(name: str, seed: int) -> None:
    """Also those to the service before a restart, with its journal, an older one, or none."""
    run, flown = bad_link(name, seed)
    run.run(25.0)
    older = run.snapshot()
    run.run(40.0)
    run.restart(1.0)
    run.run(60.0)
    run.restart(0.5, older)
    run.run(75.0)
    run.engine = Engine(run.scenario.config, run.seed)
    run.run(95.0)
    assert [one for _, one in flown.notices if one.code is SIGN] == []
    different = flown.said(NoticeCode.MISSION_DIFFERS)
    assert [t_s for t_s, _ in different if t_s < 60.0] == []  # the older journal knows older missions
    assert flown.said(NoticeCode.MISSION_CHANGED) == flown.said(NoticeCode.MISSION_COUNT_CHANGED) == []
    assert flown.uploads_s


def test_answers_to_other_ground_stations_never_stop_the_tasking() -> None:
    """QGroundControl (190), MAVProxy (230), `gcs param` beside a service (254), all (0)."""
    stations = [(255, 190), (255, 230), (254, 195), (254, 190), (255, 0), (0, 0)]
    flown, encode = Flown(), Encoder(1, 1)

    def tamper(t_ns: int, peer: str, data: bytes) -> Iterable[tuple[str, bytes]]:
        yield peer, data
        if peer == "vehicle:1" and t_ns % NS_PER_S == 0:
            for to in stations:
                yield peer, encode(dialect.MAVLink_command_ack_message(511, 0, 0, 0, *to))
                yield peer, encode(dialect.MAVLink_mission_count_message(*to, 3, 0))
                yield peer, encode(dialect.MAVLink_mission_request_message(*to, 1, 0))
                yield peer, encode(dialect.MAVLink_mission_ack_message(*to, 0, 0))

    VirtualRun(load("prescribed"), 1, on_effect=flown.add, tamper=tamper).run(45.0)
    assert flown.said(SIGN) == []


def test_heartbeats_of_another_service_stop_the_tasking_of_all_vehicles_there() -> None:
    """A router between service and vehicles gives each service the heartbeats of the other."""
    flown = Flown()
    engine = Engine(load("prescribed").config, 1)
    other = Engine(load("prescribed").config, 1)
    link = "udpin:0.0.0.0:14550"

    def heartbeat_of(source: Engine) -> bytes:
        return source.stages.fleet.encoder(1)(source.stages.fleet._heartbeat())

    for step in range(400):
        t_ns = START_T_NS + step * NS_PER_S // 10
        for effect in engine.step(Tick(t_ns)):
            flown.add(t_ns, effect)
        if step % 10 == 0:
            other.step(Tick(t_ns + 7))
            if step < 200:
                engine.step(Datagram(t_ns, link, "10.0.0.9:14550", heartbeat_of(engine)))  # an echo
            else:
                engine.step(Datagram(t_ns, link, "10.0.0.8:14550", heartbeat_of(other)))
    alarms = flown.said(SIGN)
    assert [vehicle for _, vehicle in alarms] == [1, 2, 3, 4]
    assert 20.0 < alarms[0][0] < 24.0
    sign = next(one.parameters["sign"] for _, one in flown.notices if one.code is SIGN)
    assert "10.0.0.8:14550" in sign
