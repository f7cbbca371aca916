"""Findings of the review: each of these fails."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import parse, read_text
from gcs.config.schema import EndpointTable
from gcs.core.engine import Engine
from gcs.core.state_check import check_state
from gcs.geo import LocalFrame
from gcs.mavlink.frames.codec import Encoder, decode
from gcs.model import NS_PER_S as S
from gcs.model import Authority, Datagram, Send, Tick

RADIO, LTE = "udpin:0.0.0.0:14550", "udpin:0.0.0.0:14560"
CONFIG = parse(*read_text("deterministic"))
TWO = msgspec.structs.replace(
    CONFIG,
    links=msgspec.structs.replace(CONFIG.links, mavlink=[RADIO, EndpointTable(endpoint=LTE, redundant=True)]),
)
FRAME = CONFIG.local_frame
AP, PX4 = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, dialect.MAV_AUTOPILOT_PX4
AUTO_AP, FBWA, LOITER_AP = 10, 5, 12


def beat(mode, armed=True):
    return dialect.MAVLink_heartbeat_message(1, AP, 1 | (128 if armed else 0), mode, 4, 3)


def position(boot_s, east_m=0.0):
    lat, lon = FRAME.to_geodetic(east_m, 0.0)
    return dialect.MAVLink_global_position_int_message(
        round(boot_s * 1000), round(lat * 1e7), round(lon * 1e7), 684_000, 100_000, 0, 1500, 0, 9000
    )


def report(boot_s, east_m=0.0, *, autopilot=AP, mode=10, base=129 - 256):
    lat, lon = FRAME.to_geodetic(east_m, 0.0)
    return dialect.MAVLink_high_latency2_message(
        round(boot_s * 1000), 1, autopilot, mode, round(lat * 1e7), round(lon * 1e7), 684, 684, 45, 45, 10,
        55, 75, 75, 75, 0, 0, 0, 0, 20, 0, 70, 3, 0, base, 0, 0,
    )  # fmt: skip


class Air:
    def __init__(self, config=CONFIG):
        self.engine = Engine(config, 1)
        self.encoders = {}
        self.effects = []

    def hear(self, t_s, *messages, link=RADIO, peer="10.0.0.1:1"):
        encode = self.encoders.setdefault((link, peer), Encoder(1, 1))
        for message in messages:
            self.effects += self.engine.step(Datagram(round(t_s * S), link, peer, encode(message)))

    def tick(self, t_s):
        found = self.engine.step(Tick(round(t_s * S)))
        self.effects += found
        return found

    @property
    def agent(self):
        return self.engine.state.agents[1]


def test_state_is_valid_right_after_a_link_was_replaced():
    """StandbyLink.sequence is -1 until the old link is heard again; state_check takes -1 in `authority` only."""
    air = Air(TWO)
    for k in range(30):
        t = 1000 + 0.1 * k
        air.hear(t, beat(AUTO_AP), position(5 + 0.1 * k, 1.5 * k))
        air.hear(t, beat(AUTO_AP), link=LTE, peer="20.0.0.1:1")
    check_state(air.engine.state)
    for k in range(30, 60):  # the radio ends
        air.hear(1000 + 0.1 * k, beat(AUTO_AP), position(5 + 0.1 * k, 1.5 * k), link=LTE, peer="20.0.0.1:1")
    assert air.agent.link.address[0] == LTE
    check_state(air.engine.state)


@pytest.mark.parametrize("peer", ["10.0.0.1:1"])
def test_a_late_high_latency_report_beside_telemetry_does_not_end_a_pilots_override(peer):
    air = Air()
    air.hear(1000, beat(AUTO_AP), position(5))
    air.tick(1000.1)
    air.hear(1001, beat(FBWA), position(6, 15))
    assert Authority.OVERRIDDEN in air.agent.claims
    air.hear(1001.2, report(3, 10, mode=AUTO_AP), peer=peer)  # of 3 s ago, by the satellite
    for k in range(1, 40):
        air.hear(1001.2 + 0.25 * k, beat(FBWA), position(6.2 + 0.25 * k, 18 + 3.75 * k))
        air.tick(1001.2 + 0.25 * k)
    assert air.agent.link.mode == "FBWA"
    assert Authority.OVERRIDDEN in air.agent.claims


def test_px4_in_flight_that_is_heard_by_satellite_alone_gets_no_loiter():
    air = Air()
    for k in range(4):
        air.hear(1000 + 5 * k, report(500 + 5 * k, 55 * k, autopilot=PX4, mode=4 | 4 << 8, base=-128))
        for j in range(50):
            air.tick(1000 + 5 * k + 0.1 * j)
    sent = [m for e in air.effects if isinstance(e, Send) for m in decode(e.data)[0]]
    modes = [m for m in sent if m.get_type() == "COMMAND_LONG" and m.command == 176]
    print([m.get_type() for m in sent])
    assert not modes


def test_addresses_of_stand_by_links_are_forgotten():
    air = Air(TWO)
    t = 1000.0
    for k in range(300):
        for j in range(6):
            t += 1
            air.hear(t, beat(AUTO_AP), position(t - 900, 15 * (t - 1000) % 2000 if False else 0))
            if j == 0:
                air.hear(t, beat(AUTO_AP), link=LTE, peer=f"66.6.6.6:{1000 + k}")
            air.tick(t + 0.5)
    assert len(air.engine.state.fleet.sequences) < 50


def test_a_stranger_on_the_redundant_endpoint_does_not_get_a_vehicle_that_is_heard():
    air = Air(TWO)
    radio = Encoder(1, 1)
    stranger = Encoder(1, 1)
    for k in range(0, 260):
        t = 1000 + 0.1 * k
        frame = radio(beat(AUTO_AP) if k % 10 == 0 else position(5 + 0.1 * k, 1.5 * k))
        if k % 3 != 2:  # a third is lost
            air.effects += air.engine.step(Datagram(round(t * S), RADIO, "10.0.0.1:1", frame))
        if k > 20 and k % 5 == 0:
            air.effects += air.engine.step(Datagram(round(t * S), LTE, "66.6.6.6:6", stranger(beat(AUTO_AP))))
        air.tick(t)
    assert air.agent.link.address == (RADIO, "10.0.0.1:1")


def test_a_link_without_loss_and_late_is_no_reboot():
    air = Air(TWO)
    radio, lte = Encoder(1, 1), Encoder(1, 1)
    late = []
    held = None
    for k in range(0, 400):
        t = 1000 + 0.1 * k
        mode = AUTO_AP if k < 60 else LOITER_AP  # a pilot chooses LOITER
        message = beat(mode) if k % 10 == 0 else position(5 + 0.1 * k, 1.5 * k if k < 60 else 90)
        data = radio(message)
        late.append((k + 65, lte(message)))
        if k % 3 != 2:
            air.effects += air.engine.step(Datagram(round(t * S), RADIO, "10.0.0.1:1", data))
        if late[0][0] <= k:
            air.effects += air.engine.step(Datagram(round(t * S), LTE, "20.0.0.1:1", late.pop(0)[1]))
        air.tick(t)
        if k == 90:
            held = Authority.OVERRIDDEN in air.agent.claims
    assert held
    assert air.agent.link.address[0] == LTE
    assert Authority.OVERRIDDEN in air.agent.claims
    assert air.agent.link.boots == 0


def test_a_late_heartbeat_of_the_new_link_does_not_end_a_failsafes_return():
    """The link in use loses a third, the other nothing, and is 3 s late."""
    air = Air(TWO)
    radio, lte = Encoder(1, 1), Encoder(1, 1)
    late, seen = [], []
    for k in range(0, 200):
        t = 1000 + 0.1 * k
        mode = AUTO_AP if k < 118 else 11  # RTL
        message = beat(mode) if k % 10 in (0, 3, 6) else position(5 + 0.1 * k, 1.5 * k)
        late.append((k + 30, lte(message)))
        data = radio(message)
        if k % 3 != 2:
            air.effects += air.engine.step(Datagram(round(t * S), RADIO, "10.0.0.1:1", data))
        if late[0][0] <= k:
            air.effects += air.engine.step(Datagram(round(t * S), LTE, "20.0.0.1:1", late.pop(0)[1]))
        air.tick(t)
        seen.append((k, air.agent.link.address[0] == LTE, air.agent.link.mode, Authority.OVERRIDDEN in air.agent.claims))
    assert not [one for one in seen if one[0] > 125 and not one[3]]


def test_a_command_that_crashes_leaves_the_bridge_to_its_heartbeats():
    """A program error ends command: it tells the bridge that it ends in order, and all heartbeats stop."""
    import asyncio

    from gcs.core.lease.bridge_lease import answer_ask, start_lease
    from gcs.core.lease.records import Ask
    from gcs.io.clock import RunClock, steady_ns
    from gcs.io.cluster.all_bridges import AllBridges
    from gcs.io.cluster.bridge_links import BridgeLinks
    from gcs.io.cluster.bridge_messages import Down, decode as read, encode
    from gcs.io.cluster.command_lease import CommandLease
    from gcs.service.service import Service

    class Bus:
        def __init__(self):
            self.lease = start_lease(1, steady_ns(), is_only_bridge=True)
            self.down = []

        def subscribe(self, *_):
            pass

        def watch_nodes(self, *_):
            pass

        def ask(self, key, payload, _within_s, answered, _ended):
            self.lease, answer = answer_ask(self.lease, read(key, payload, Ask), steady_ns())
            answered(key, encode(answer))

        def publish(self, key, payload):
            if key.endswith("down"):
                self.down.append(read(key, payload, Down))

    async def fly(bus):
        lease = CommandLease("command", ("main",), 0, is_only_node=False)
        links = AllBridges([BridgeLinks(CONFIG.mavlink_links, (1,), "m", "main", bus, lease)], lease)
        service = Service(CONFIG, 1, links, bus)
        step = service.engine.step
        ticks = []

        def crash(event, *rest):
            ticks.append(event)
            if len(ticks) == 20:
                raise RuntimeError("program error")
            return step(event, *rest)

        service.engine.step = crash
        await service.run(RunClock(), asyncio.Event())

    bus = Bus()
    with pytest.raises(BaseException, match="unhandled errors|program error"):
        asyncio.run(fly(bus))
    assert bus.down
    assert not [one for one in bus.down if one.ends]


def test_heartbeats_with_our_ids_alone_do_not_stop_vehicles_and_clear_their_missions():
    import sys

    sys.path.insert(0, "tests/core/authority")
    from test_second_commander import ITEMS, PEER, VEHICLE, Flight

    from gcs.mavlink.frames.codec import GCS_COMPONENT_ID, GCS_SYSTEM_ID
    from gcs.mavlink.mission.upload_stages import Stage

    flight = Flight()
    flight.upload_until(Stage.UPLOAD, ITEMS)
    forged = Encoder(GCS_SYSTEM_ID, GCS_COMPONENT_ID)
    before = flight.run.t_ns
    said = []
    own = flight.tamper

    def tamper(t_ns, peer, data):
        yield from own(t_ns, peer, data)
        if len(said) < 3:
            said.append(1)
            yield "66.6.6.6:6", forged(dialect.MAVLink_heartbeat_message(6, 8, 0, 7, 4, 3))

    flight.ignored = ()
    flight.run.tamper = tamper
    flight.wait(15.0)
    assert said
    sent = [m.get_type() for m in flight.sent(before)]
    assert "MISSION_CLEAR_ALL" not in sent
