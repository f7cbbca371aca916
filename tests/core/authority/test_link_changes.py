"""A pilot would lose the override of an aircraft because another link tells what it did seconds ago."""

from __future__ import annotations

from dataclasses import dataclass, field

import msgspec
import pytest
from helpers.noticed import noticed
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import Config, parse, read_text
from gcs.config.schema import EndpointTable
from gcs.core.engine import Engine
from gcs.core.state import Agent
from gcs.core.state_check import check_state
from gcs.mavlink.fleet.telemetry_table import POSITION_NS
from gcs.mavlink.frames.codec import Encoder, Message, decode
from gcs.model import NS_PER_S as S
from gcs.model import Authority, Datagram, Effect, NoticeCode, Send, Tick

RADIO, LTE = "udpin:0.0.0.0:14550", "udpin:0.0.0.0:14560"
CONFIG = parse(*read_text("deterministic"))
TWO_LINKS = msgspec.structs.replace(
    CONFIG,
    links=msgspec.structs.replace(CONFIG.links, mavlink=[RADIO, EndpointTable(endpoint=LTE, redundant=True)]),
)
ARDUPLANE, PX4 = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, dialect.MAV_AUTOPILOT_PX4
MANUAL, FBWA, AUTO, RTL, LOITER = 0, 5, 10, 11, 12
STEPS_PER_S = 10
SPEED_M_S = 15.0


def beat(mode: int) -> Message:
    return dialect.MAVLink_heartbeat_message(1, ARDUPLANE, 1 | 128, mode, 4, 3)


def position(boot_s: float, east_m: float) -> Message:
    lat, lon = CONFIG.local_frame.to_geodetic(east_m, 0.0)
    return dialect.MAVLink_global_position_int_message(
        round(boot_s * 1000), round(lat * 1e7), round(lon * 1e7), 684_000, 100_000, 0, 1500, 0, 9000
    )


def report(boot_s: float, east_m: float, autopilot: int, mode: int, base_mode: int) -> Message:
    lat, lon = CONFIG.local_frame.to_geodetic(east_m, 0.0)
    return dialect.MAVLink_high_latency2_message(
        round(boot_s * 1000), 1, autopilot, mode, round(lat * 1e7), round(lon * 1e7), 684, 684, 45, 45, 10,
        55, 75, 75, 75, 0, 0, 0, 0, 20, 0, 70, 3, 0, base_mode, 0, 0,
    )  # fmt: skip


class Air:
    """One vehicle, and the engine that hears it."""

    def __init__(self, config: Config = CONFIG) -> None:
        self.engine = Engine(config, 1)
        self.effects: list[Effect] = []
        self._encoders: dict[str, Encoder] = {}

    def hear(self, t_s: float, *messages: Message, link: str = RADIO) -> None:
        encode = self._encoders.setdefault(link, Encoder(1, 1))
        for message in messages:
            self.carry(t_s, link, encode(message))

    def carry(self, t_s: float, link: str, data: bytes) -> None:
        self.effects += self.engine.step(Datagram(round(t_s * S), link, f"10.0.0.{len(link)}:1", data))

    def tick(self, t_s: float) -> None:
        self.effects += self.engine.step(Tick(round(t_s * S)))

    @property
    def agent(self) -> Agent:
        return self.engine.state.agents[1]

    @property
    def link(self) -> str:
        address = self.agent.link.address
        return "" if address is None else address[0]

    @property
    def is_overridden(self) -> bool:
        return Authority.OVERRIDDEN in self.agent.claims


@dataclass
class Change:
    """A vehicle on a radio, which ends at `ends_s`, and on LTE, which is `late_s` late."""

    late_s: float
    modes: dict[float, int]
    """By the time at which they begin."""
    ends_s: float = 9.0
    booted_s: float = -5.0
    reboots_s: float = 1e9
    air: Air = field(default_factory=lambda: Air(TWO_LINKS))
    ages_s: list[float] = field(default_factory=list)
    """Of the newest position, at each step."""
    overridden: list[float] = field(default_factory=list)
    """Times with an override."""

    def fly(self, until_s: float) -> None:
        radio, lte = Encoder(1, 1), Encoder(1, 1)
        late: list[bytes] = []
        for step in range(round(until_s * STEPS_PER_S)):
            t_s = step / STEPS_PER_S
            message = self.message(step, t_s)
            late.append(lte(message))
            if t_s < self.ends_s:
                self.air.carry(1000 + t_s, RADIO, radio(message))
            sent = step - round(self.late_s * STEPS_PER_S)
            if sent >= 0:
                self.air.carry(1000 + t_s, LTE, late[sent])
            self.air.tick(1000 + t_s)
            position_t_ns = self.air.engine.state.fleet.table[0, POSITION_NS]
            self.ages_s.append(1000 + t_s - position_t_ns / S if step else 0.0)
            if self.air.is_overridden:
                self.overridden.append(t_s)

    def message(self, step: int, t_s: float) -> Message:
        mode = next(mode for begin, mode in reversed(self.modes.items()) if begin <= t_s)
        booted_s = self.reboots_s if t_s >= self.reboots_s else self.booted_s
        return beat(mode) if step % 5 == 0 else position(t_s - booted_s, SPEED_M_S * t_s)

    def is_overridden_from(self, begin_s: float, end_s: float) -> bool:
        steps = round((end_s - begin_s) * STEPS_PER_S)
        return sum(begin_s <= t_s < end_s for t_s in self.overridden) == steps


@pytest.mark.parametrize("mode", [LOITER, RTL, FBWA])
def test_a_late_link_ends_no_override_and_is_no_reboot(mode: int) -> None:
    change = Change(6.5, {0.0: AUTO, 6.0: mode})
    change.fly(40.0)
    assert change.air.link == LTE
    assert change.is_overridden_from(7.0, 40.0)
    assert change.air.agent.link.boots == 0
    wrong = NoticeCode.REBOOTED, NoticeCode.DUPLICATE_ID, NoticeCode.POSITION_JUMP, NoticeCode.LINK_DOWN
    assert not noticed(change.air.effects, *wrong)
    assert max(change.ages_s) < 6.5 + 0.3, "the time by which the link is late"
    assert change.air.agent.perception.status.status == "active"


@pytest.mark.parametrize("late_s", [0.0, 3.0, 6.5])
def test_a_failsafe_after_the_change_of_link_counts_as_soon_as_the_new_link_tells_it(late_s: float) -> None:
    change = Change(late_s, {0.0: AUTO, 9.5: RTL})
    change.fly(30.0)
    assert change.air.agent.link.mode == "RTL"
    assert change.overridden[0] <= max(9.0 + 1.5, 9.5 + late_s) + 1.0


@pytest.mark.parametrize(("booted_s", "known_s"), [(-100.0, 14.5), (-5.0, 24.0)])
def test_a_reboot_at_the_change_of_link_shows_its_mode(booted_s: float, known_s: float) -> None:
    """Its clock is 110 s or 14 s behind. 14 s may be a late link: the mode counts when it has caught up."""
    change = Change(0.0, {0.0: AUTO, 9.2: MANUAL}, booted_s=booted_s, reboots_s=9.2)
    change.fly(known_s)
    assert change.air.agent.link.mode == "MANUAL"
    assert change.air.agent.link.boots == (1 if booted_s == -100.0 else 0)


def test_the_state_is_valid_right_after_a_change_of_link() -> None:
    change = Change(0.0, {0.0: AUTO}, ends_s=5.0)
    change.fly(4.9)
    check_state(change.air.engine.state)
    change = Change(0.0, {0.0: AUTO}, ends_s=5.0)
    change.fly(6.7)
    assert change.air.link == LTE
    check_state(change.air.engine.state)


def test_a_late_satellite_report_beside_telemetry_ends_no_override() -> None:
    air = Air()
    air.hear(1000, beat(AUTO), position(5, 0))
    air.tick(1000.1)
    air.hear(1001, beat(FBWA), position(6, 15))
    assert air.is_overridden
    air.hear(1001.2, report(3, 10, ARDUPLANE, AUTO, 129 - 256))  # of 3 s ago
    for k in range(1, 40):
        air.hear(1001.2 + 0.25 * k, beat(FBWA), position(6.2 + 0.25 * k, 18 + 3.75 * k))
        air.tick(1001.2 + 0.25 * k)
    assert air.agent.link.mode == "FBWA"
    assert air.is_overridden


def test_px4_in_flight_that_is_heard_by_satellite_alone_gets_no_mode_and_no_requests() -> None:
    air = Air()
    for k in range(4):
        air.hear(1000 + 5 * k, report(500 + 5 * k, 55 * k, PX4, 4 | 4 << 8, -128))
        for tenth in range(50):
            air.tick(1000 + 5 * k + 0.1 * tenth)
    sent = [message for one in air.effects if isinstance(one, Send) for message in decode(one.data)[0]]
    assert not [message.get_type() for message in sent]
