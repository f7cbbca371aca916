"""A user would lose a vehicle with its radio although its LTE works, or hear alarms of an impostor for it."""

import numpy as np
import pytest
from helpers.missions import upload_manager
from helpers.noticed import noticed
from helpers.plane_double import AUTO, LOITER, Plane, S
from helpers.plane_swarm import FRAME, ROUTE
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Link, parse_endpoint
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import Encoder, decode, scan
from gcs.mavlink.router.router import Router
from gcs.model import Datagram, NoticeCode, Route, Send, UploadReport

RADIO = Link(parse_endpoint("udpin:0.0.0.0:14550"))
LTE = Link(parse_endpoint("udpin:0.0.0.0:14560"), redundant=True)
PLACES = ((RADIO.name, "10.0.0.1:1"), (LTE.name, "20.0.0.1:1"))
ANOTHER_SENDER = (LTE.name, "66.6.6.6:6")
STEP_NS = S // 20


class TwoLinks:
    """A plane on two links. `copies` means that an onboard router copies each frame to both.

    Else each port of the autopilot has its own sequence, and answers where it was asked.
    """

    def __init__(self, seed=0, *, copies=False, duplicates=0.0):
        self.plane = Plane(1, mode=LOITER)
        self.fleet = Fleet([1], FRAME, links=[RADIO, LTE], kernel=False)
        self.tasking = upload_manager(self.fleet, FRAME, [1])
        self.loss = [0.0, 0.0]
        self.t_ns = 0
        self.notices, self.effects, self.late = [], [], []
        self._copies, self._duplicates = copies, duplicates
        self._rng = np.random.default_rng(seed)
        self._encoders = [Encoder(1, 1), Encoder(1, 1)]

    def upload(self):
        self.carry(self.tasking.enqueue_upload(Route(1, (0, 0), ROUTE, 1.0), self.t_ns))

    def carry(self, effects):
        for effect in effects:
            if isinstance(effect, Send):
                link = PLACES.index((effect.link, effect.peer))
                if self._rng.random() >= self.loss[link]:
                    answers = self.plane.receive(effect.data, self.t_ns)
                    self.hear(answers, (0, 1) if self._copies else (link,))
            else:
                self.effects.append(effect)

    def hear(self, frames, links):
        for frame in frames:
            for link in links:
                sent = frame if self._copies else self._encoders[link](decode(frame)[0][0])
                times = 1 + (self._rng.random() < self._duplicates)
                if self._rng.random() >= self.loss[link]:
                    self.late += [(self.t_ns + int(self._rng.integers(3)) * STEP_NS, link, sent)] * times

    def run(self, seconds):
        for _ in range(round(seconds * S / STEP_NS)):
            self.t_ns += STEP_NS
            self.hear(self.plane.poll(self.t_ns), (0, 1))
            due = [one for one in self.late if one[0] <= self.t_ns]
            self.late = [one for one in self.late if one[0] > self.t_ns]
            for _, link, data in due:
                for vehicle, message in self.fleet.receive(Datagram(self.t_ns, *PLACES[link], data)):
                    self.carry(self.tasking.receive(vehicle, message, self.t_ns))
            self.carry([*self.fleet.poll(self.t_ns), *self.tasking.poll(self.t_ns)])
            self.notices += self.fleet.notices()

    def told(self, *codes):
        return [one.code for one in noticed(self.notices, *codes)]

    @property
    def link(self):
        return self.fleet.link(1)


ALARMS = (NoticeCode.ID_CONFLICT, NoticeCode.LINK_DOWN, NoticeCode.LINK_STALE, NoticeCode.REBOOTED)


@pytest.mark.parametrize("copies", [False, True])
def test_a_second_link_is_a_stand_by_without_an_alarm_and_counts_no_frame_twice(copies):
    one, two = TwoLinks(copies=copies), TwoLinks(copies=copies)
    one.loss = [0.0, 1.0]
    for each in (one, two):
        each.run(20.0)
    assert two.fleet.health_of(1).frames == one.fleet.health_of(1).frames
    assert two.fleet.health_of(1).lost == 0
    assert two.told(NoticeCode.STANDBY_LINK) == ["standby-link"]
    assert not two.told(*ALARMS)
    assert two.link == RADIO.name


@pytest.mark.parametrize("copies", [False, True])
def test_a_link_that_dies_is_replaced_within_three_seconds_and_said(copies):
    air = TwoLinks(copies=copies)
    air.run(5.0)
    air.loss = [1.0, 0.0]
    air.run(3.0)
    assert air.link == LTE.name
    air.run(10.0)
    assert air.told(NoticeCode.ADDRESS_CHANGED, NoticeCode.STANDBY_DOWN) == [
        "address-changed",
        "standby-down",
    ]
    assert not air.told(*ALARMS)


def test_the_next_frame_of_the_stand_by_takes_over_whatever_it_is():
    fleet, encoders = Fleet([1], FRAME, links=[RADIO, LTE]), (Encoder(1, 1), Encoder(1, 1))
    for place, encode in zip(PLACES, encoders, strict=True):
        fleet.receive(Datagram(0, *place, encode(BEAT)))
    current = dialect.MAVLink_mission_current_message(1)
    links = []
    for t_s in (1.4, 1.6):
        fleet.receive(Datagram(round(t_s * S), *PLACES[1], encoders[1](current)))
        links.append(fleet.link(1))
    assert links == [RADIO.name, LTE.name]


def test_a_link_that_loses_a_third_stays_in_use_beside_an_unsigned_sender_that_loses_nothing():
    fleet, radio, other = Fleet([1], FRAME, links=[RADIO, LTE]), Encoder(1, 1), Encoder(1, 1)
    for tenth in range(400):
        t_ns = tenth * S // 10
        frame = radio(BEAT if tenth % 10 == 0 else dialect.MAVLink_mission_current_message(1))
        if tenth % 3 != 2:
            fleet.receive(Datagram(t_ns, *PLACES[0], frame))
        if tenth > 20 and tenth % 5 == 0:
            fleet.receive(Datagram(t_ns, *ANOTHER_SENDER, other(BEAT)))
        fleet.poll(t_ns)
    assert fleet.link(1) == RADIO.name


def test_sequence_numbers_of_former_stand_by_addresses_are_forgotten():
    fleet, radio, lte = Fleet([1], FRAME, links=[RADIO, LTE]), Encoder(1, 1), Encoder(1, 1)
    for t_s in range(600):
        fleet.receive(Datagram(t_s * S, *PLACES[0], radio(BEAT)))
        if t_s % 6 == 0:
            fleet.receive(Datagram(t_s * S, LTE.name, f"66.6.6.6:{1000 + t_s}", lte(BEAT)))
        fleet.poll(t_s * S + S // 2)
    assert len(fleet._state.sequences) <= 2


def beat(mode):
    return dialect.MAVLink_heartbeat_message(1, 3, 1 | 128, mode, 4, 3)


def position(boot_s):
    lat, lon = FRAME.to_geodetic(0.0, 0.0)
    return dialect.MAVLink_global_position_int_message(
        round(boot_s * 1000), round(lat * 1e7), round(lon * 1e7), 684_000, 100_000, 0, 0, 0, 9000
    )


@pytest.mark.parametrize(
    ("last_position_s", "silence_s", "is_held"),
    [
        (None, 2, False),  # nothing to compare with
        (0, 2, True),
        (10, 2, True),
        (0, 29, True),
        (0, 31, False),  # no link is so late
    ],
)
def test_a_heartbeat_on_a_new_link_counts_once_it_must_be_newer(last_position_s, silence_s, is_held):
    fleet, radio, lte = Fleet([1], FRAME, links=[RADIO, LTE]), Encoder(1, 1), Encoder(1, 1)
    for t_s in range(11):
        fleet.receive(Datagram(t_s * S, *PLACES[0], radio(beat(LOITER))))
        if last_position_s is not None and t_s <= last_position_s:
            fleet.receive(Datagram(t_s * S, *PLACES[0], radio(position(100 + t_s))))
    heard = fleet.receive(Datagram((10 + silence_s) * S, *PLACES[1], lte(beat(AUTO))))
    assert fleet.link(1) == LTE.name
    assert bool(heard) is not is_held
    if last_position_s is not None:
        assert fleet.state(1).mode == ("LOITER" if is_held else "AUTO")
    fleet.receive(Datagram((11 + silence_s) * S, *PLACES[1], lte(position(111 + silence_s))))
    assert fleet.receive(Datagram((12 + silence_s) * S, *PLACES[1], lte(beat(AUTO)))) or not is_held
    assert fleet.state(1).mode == "AUTO"


def test_heartbeats_go_to_both_links():
    air = TwoLinks()
    air.run(5.0)
    sent = [send for step in range(20) for send in air.fleet.poll(air.t_ns + step * STEP_NS)]
    for place in PLACES:
        here = [decode(s.data)[0][0].get_type() for s in sent if (s.link, s.peer) == place]
        assert here.count("HEARTBEAT") in (3, 4)


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 1000),
    copies=st.booleans(),
    loss=st.tuples(st.sampled_from([0.0, 0.1, 0.3]), st.sampled_from([0.0, 0.1, 0.3])),
    dies=st.sampled_from([None, 0, 1]),
    after_s=st.sampled_from([0.1, 0.4, 1.0, 2.5]),
)
def test_an_upload_survives_losses_duplicates_reordering_and_the_death_of_a_link(
    seed, copies, loss, dies, after_s
):
    air = TwoLinks(seed, copies=copies, duplicates=0.2)
    air.run(4.0)
    air.loss = list(loss)
    air.upload()
    air.run(after_s)
    if dies is not None:
        air.loss[dies] = 1.0
    for _ in range(60):
        air.run(2.0)
        reports = [effect for effect in air.effects if isinstance(effect, UploadReport)]
        if reports and reports[-1].ok:
            break
        if reports and not air.tasking.state.is_uploading(1):
            air.upload()
    assert reports[-1].ok
    assert air.plane.holds(air.tasking._agents[1].tasking.onboard.items)
    assert not air.told(NoticeCode.ID_CONFLICT, NoticeCode.REBOOTED, NoticeCode.DUPLICATE_ID)


BEAT = dialect.MAVLink_heartbeat_message(1, 3, 1 | 128, 10, 4, 3)


def test_a_third_address_and_one_on_the_same_link_are_impostors():
    air = TwoLinks()
    air.run(3.0)
    encode = Encoder(1, 1)
    air.fleet.receive(Datagram(air.t_ns, *ANOTHER_SENDER, encode(BEAT)))
    air.fleet.receive(Datagram(air.t_ns, RADIO.name, "66.6.6.6:6", encode(BEAT)))
    assert [one.code for one in noticed(air.fleet.notices(), NoticeCode.ID_CONFLICT)] == ["id-conflict"]
    assert air.fleet.health_of(1).conflicts == 2


def test_a_satellite_link_beside_the_radio_is_no_conflict_and_takes_over_when_the_radio_ends():
    fleet, encode, satellite = Fleet([1], FRAME, links=[RADIO, LTE]), Encoder(1, 1), Encoder(1, 1)
    report = dialect.MAVLink_high_latency2_message(
        5000, 1, 3, 10, -353632621, 1491652370, 684, *[0] * 14, 80, 0, 0, 0, 0, 0
    )
    for t_s, place, frame in (
        (0, PLACES[0], encode(BEAT)),
        (1, PLACES[1], satellite(report)),
        (4, PLACES[1], satellite(report)),
    ):
        fleet.receive(Datagram(t_s * S, *place, frame))
    assert fleet.link(1) == RADIO.name
    fleet.receive(Datagram(9 * S, *PLACES[1], satellite(report)))
    assert fleet.link(1) == LTE.name
    fleet.receive(Datagram(10 * S, *PLACES[0], encode(BEAT)))
    assert fleet.link(1) == RADIO.name
    assert not noticed(fleet.notices(), NoticeCode.ID_CONFLICT, NoticeCode.STANDBY_LINK)


def test_without_the_key_in_the_mission_file_a_second_link_is_an_impostor():
    fleet, encode = Fleet([1], FRAME, links=[RADIO, Link(LTE.endpoint)]), Encoder(1, 1)
    for place in PLACES:
        fleet.receive(Datagram(S, *place, encode(BEAT)))
    assert [one.code for one in noticed(fleet.notices(), NoticeCode.ID_CONFLICT)] == ["id-conflict"]


def signed_beat():
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    link.signing.secret_key, link.signing.sign_outgoing = bytes(32), True
    link.signing.timestamp = 1
    return bytes(BEAT.pack(link))


@pytest.mark.parametrize("is_signed", [False, True])
def test_an_unsigned_stand_by_does_not_take_over_from_a_signed_link(is_signed):
    fleet, unsigned = Fleet([1], FRAME, links=[RADIO, LTE]), Encoder(1, 1)
    router = Router([RADIO, LTE], [1])
    for t_s, place, frame in (
        (0.0, PLACES[0], signed_beat()),
        (2.0, PLACES[1], signed_beat() if is_signed else unsigned(BEAT)),
    ):
        t_ns = round(t_s * S)
        fleet.receive(Datagram(t_ns, *place, frame))
        routed = router.route_frame(t_ns, place, scan(frame).frame(0))
    assert fleet.link(1) == (LTE.name if is_signed else RADIO.name)
    assert (routed.refusal == "") is is_signed
    assert bool(noticed(fleet.notices(), NoticeCode.ID_CONFLICT)) is not is_signed
