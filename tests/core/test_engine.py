"""A user would lose trust: a replay that differs, an unknown system in control, a bad scan that ends it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import pytest
from helpers.noticed import noticed
from helpers.staging import RADAR, S, at, mission, scan
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import Config
from gcs.core.engine import Engine
from gcs.io.record_json import decode, encode
from gcs.mavlink.frames.codec import GCS_COMPONENT_ID, GCS_SYSTEM_ID, Encoder
from gcs.mavlink.frames.codec import decode as decode_frames
from gcs.model import (
    AgentStatus,
    BadInput,
    Datagram,
    Effect,
    Event,
    MissionEnded,
    Notice,
    NoticeCode,
    Picture,
    Plan,
    Scan,
    Send,
    Sensor,
    Tick,
    UploadReport,
    read_only,
)
from gcs.planning.assignment import assign_agents
from sim_vehicles.campaign.virtual_run import LINK, VirtualRun
from sim_vehicles.world.scenario import load

T = TypeVar("T")
SEED = 1
HEARD_S = 50.0
"""Until then every vehicle is heard; the address of one that has fallen silent may change."""
MISSION_MESSAGES = {
    "MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_CLEAR_ALL",
    "MISSION_ACK",
}  # fmt: skip


@dataclass
class Flight:
    """A mission: targets move, agent 2 is lost, the others arrive."""

    config: Config
    events: list[Event]
    effects: list[Effect]

    def until(self, t_s: float) -> list[Event]:
        """Events of the first `t_s` seconds."""
        return [event for event in self.events if event.t_ns < self.events[0].t_ns + round(t_s * S)]

    def contact(self) -> int:
        """Index of the first event by which every vehicle has been heard."""
        engine = Engine(self.config, SEED)
        for index, event in enumerate(self.events):
            engine.step(event)
            if all(one.address for one in engine.stages.fleet.health()):
                return index + 1
        raise AssertionError("never in contact")


@pytest.fixture(scope="module")
def flight() -> Flight:
    scenario, events, effects = load("prescribed"), [], []
    VirtualRun(scenario, SEED, events.append, lambda _t_ns, effect: effects.append(effect)).run()
    assert any(isinstance(e, AgentStatus) and e.status == "lost" for e in effects)
    assert sum(isinstance(e, Plan) for e in effects) >= 3
    return Flight(scenario.config, events, effects)


def play(config: Config, events: Iterable[Event]) -> list[Effect]:
    engine = Engine(config, SEED)
    return [effect for event in events for effect in engine.step(event)]


def written(effects: Iterable[Effect], *, without: tuple[type, ...] = ()) -> list[bytes]:
    return [encode(effect) for effect in effects if not isinstance(effect, without)]


def messages(effects: Iterable[Effect]) -> Iterator[tuple[Send, dialect.MAVLink_message]]:
    for effect in effects:
        if isinstance(effect, Send):
            for message in decode_frames(effect.data)[0]:
                yield effect, message


# ---------------------------------------------------------------- determinism


def test_the_same_events_give_the_same_effects_byte_for_byte(flight: Flight) -> None:
    assert written(play(flight.config, flight.events)) == written(flight.effects)


def test_events_that_went_through_a_recording_give_the_same_effects(flight: Flight) -> None:
    again = [decode("recording", encode(event), type(event)) for event in flight.events]
    assert written(play(flight.config, again)) == written(flight.effects)


def test_two_commands_side_by_side_do_not_disturb_each_other(flight: Flight) -> None:
    events = flight.until(20.0)
    one, two = Engine(flight.config, SEED), Engine(flight.config, SEED + 1)
    effects = []
    for event in events:
        effects += one.step(event)
        two.step(event)
    assert written(effects) == written(play(flight.config, events))


# ---------------------------------------------------------------- missions and their vehicles


def test_a_mission_is_only_ever_begun_for_vehicles_in_changed(flight: Flight) -> None:
    engine, changed = Engine(flight.config, SEED), 0
    for event in flight.events:
        under_way = set(engine.state.tasking.stages)
        effects = engine.step(event)
        plans = [effect for effect in effects if isinstance(effect, Plan)]
        counted = {m.target_system for _, m in messages(effects) if m.get_type() == "MISSION_COUNT"}
        if plans:
            assert counted <= set(plans[0].changed) | under_way
            assert set(plans[0].changed) <= set(engine.state.tasking.stages)
            changed += len(plans[0].changed)
        else:
            assert counted <= under_way
    assert changed > 4


def test_a_lost_vehicle_gets_no_more_missions(flight: Flight) -> None:
    death = next(i for i, e in enumerate(flight.effects) if isinstance(e, AgentStatus) and e.status == "lost")
    lost = flight.effects[death].vehicle
    sent_to = {
        m.target_system for _, m in messages(flight.effects[death:]) if m.get_type() in MISSION_MESSAGES
    }
    assert lost not in sent_to
    before = messages(flight.effects[:death])
    assert lost in {m.target_system for _, m in before if m.get_type() in MISSION_MESSAGES}


def test_everything_for_a_vehicle_goes_to_its_own_address(flight: Flight) -> None:
    for send, message in messages(flight.effects):
        target = getattr(message, "target_system", 0)
        assert send.link == LINK
        assert target == 0 or send.peer == f"vehicle:{target}"


def test_every_scan_is_answered_with_the_picture_of_both_kinds(flight: Flight) -> None:
    scans = [event.measured_t_ns for event in flight.events if isinstance(event, Scan)]
    for kind in ("agents", "targets"):
        shown = [e.scan_t_ns for e in flight.effects if isinstance(e, Picture) and e.kind == kind]
        assert shown == scans


def test_the_pictures_of_a_scan_are_known_before_its_plan_is_made(
    flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A plan for hundreds of vehicles takes longer than a picture may be old."""
    engine = Engine(flight.config, SEED)
    told: list[str] = []
    monkeypatch.setattr("gcs.planning.team_routes.assign_agents", _told_first(told))
    for event in flight.until(10.0):
        for effect in engine.effects(event):
            told += [type(effect).__name__] * isinstance(effect, Picture | Plan)
    made = told.index("planner")
    assert told[made - 2 : made + 2] == ["Picture", "Picture", "planner", "Plan"]


def _told_first(told: list[str]) -> Callable[..., dict[int, int]]:
    """Return the assignment with a list in which its calls are told."""

    def assign(*inputs: Any) -> dict[int, int]:
        told.append("planner")
        return assign_agents(*inputs)

    return assign


# ---------------------------------------------------------------- hostile datagrams

OTHER_PEER = "10.6.6.6:666"
FOREIGN_MESSAGES = [
    dialect.MAVLink_heartbeat_message(1, 3, 217, 10, 4, 3),
    dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
    dialect.MAVLink_global_position_int_message(
        99_000, 332_000_000, -876_000_000, 170_000, 100_000, 0, 0, 0, 0
    ),
    dialect.MAVLink_mission_ack_message(GCS_SYSTEM_ID, GCS_COMPONENT_ID, 0, 0),
    dialect.MAVLink_mission_ack_message(GCS_SYSTEM_ID, GCS_COMPONENT_ID, 15, 0),
    dialect.MAVLink_mission_request_int_message(GCS_SYSTEM_ID, GCS_COMPONENT_ID, 0, 0),
    dialect.MAVLink_mission_count_message(GCS_SYSTEM_ID, GCS_COMPONENT_ID, 0, 0),
    dialect.MAVLink_mission_current_message(3),
    dialect.MAVLink_command_ack_message(176, 0),
    dialect.MAVLink_statustext_message(0, b"all is lost"),
]


def frame(message: dialect.MAVLink_message, system_id: int, component_id: int = 1) -> bytes:
    return Encoder(system_id, component_id)(message)


FOREIGN = st.builds(
    frame, st.sampled_from(FOREIGN_MESSAGES), st.integers(1, 255), st.sampled_from([1, 1, 190, 154])
)
TRUNCATED = st.builds(lambda data, at: data[: at % len(data)], FOREIGN, st.integers(0, 300))
DAMAGED = st.builds(
    lambda data, at, bits: bytes(b ^ bits if i == at % len(data) else b for i, b in enumerate(data)),
    FOREIGN,
    st.integers(0, 300),
    st.integers(1, 255),
)
HOSTILE = st.one_of(
    FOREIGN,
    TRUNCATED,
    DAMAGED,
    st.binary(max_size=300),
    st.lists(FOREIGN, max_size=6).map(b"".join),
    st.builds(lambda junk, data: junk + data, st.binary(max_size=40).map(lambda b: b"\xfd" + b), FOREIGN),
)


@pytest.fixture(scope="module")
def unharmed(flight: Flight) -> tuple[list[Event], int, list[bytes]]:
    """Events of 20 s, the first after contact, and the effects without hostile input."""
    events = flight.until(20.0)
    return events, flight.contact(), written(play(flight.config, events), without=(Notice,))


@settings(max_examples=15)
@given(attack=st.lists(st.tuples(st.integers(0, 10**6), HOSTILE), min_size=1, max_size=60))
def test_hostile_datagrams_change_nothing_but_notices(
    flight: Flight, unharmed: tuple[list[Event], int, list[bytes]], attack: list[tuple[int, bytes]]
) -> None:
    """Also frames with a vehicle's own id, as long as the vehicle is heard at its own address."""
    events, first, quiet = unharmed
    bombarded = list(events)
    places = sorted((first + place % (len(events) - first), data) for place, data in attack)
    for place, data in reversed(places):
        bombarded.insert(place, Datagram(events[place].t_ns, LINK, OTHER_PEER, data))
    effects = play(flight.config, bombarded)
    assert all(effect.peer != OTHER_PEER for effect in effects if isinstance(effect, Send))
    assert written(effects, without=(Notice,)) == quiet


def test_a_bombardment_all_the_way_changes_nothing(flight: Flight) -> None:
    rng, events, first = np.random.default_rng(0), flight.until(HEARD_S), flight.contact()
    bombarded: list[Event] = []
    for index, event in enumerate(events):
        bombarded.append(event)
        if index >= first and isinstance(event, Tick):
            spoof = frame(FOREIGN_MESSAGES[index % len(FOREIGN_MESSAGES)], int(rng.integers(1, 6)))
            attack = (rng.bytes(80), spoof, spoof[: int(rng.integers(1, len(spoof)))])
            bombarded += [Datagram(event.t_ns, LINK, OTHER_PEER, data) for data in attack]
    effects = play(flight.config, bombarded)
    assert written(effects, without=(Notice,)) == written(play(flight.config, events), without=(Notice,))
    assert sum(isinstance(effect, Notice) for effect in effects) < 100


def test_an_unknown_system_heard_first_is_not_flown(flight: Flight) -> None:
    engine = Engine(flight.config, SEED)
    effects = []
    for t_s in np.arange(0.0, 10.0, 0.25):
        data = b"".join(frame(message, 77) for message in FOREIGN_MESSAGES)
        effects += engine.step(Datagram(at(t_s), LINK, OTHER_PEER, data))
        effects += engine.step(Tick(at(t_s)))
    assert {type(effect) for effect in effects} == {Notice}


# ---------------------------------------------------------------- bad scans and bad input

METRES = st.one_of(st.floats(-200.0, 2200.0), st.sampled_from([-1e7, 1e7, 0.0, np.nan, np.inf]))
SENSORS = st.builds(
    Sensor,
    st.sampled_from(["radar", "lidar"]),
    st.sampled_from([0.0, 0.5, 1.0]),
    st.sampled_from([0.0, 1e-9, 4e-6, 1.0]),
    st.sampled_from([np.zeros((2, 2)), np.eye(2) * 10.0, np.full((2, 2), 9.0), np.eye(2) * 1e10]).map(
        read_only
    ),
    st.sampled_from([RADAR.field_of_view_m, (-1.0, -1.0, 1.0, 1.0), (-1e7, -1e7, 1e7, 1e7)]),
)
BAD_SCANS = st.builds(
    lambda sensor, z, measured_s: (sensor, z, measured_s),
    SENSORS,
    st.lists(st.tuples(METRES, METRES), max_size=30),
    st.sampled_from([-4000.0, -5.0, -1.0, -1e-9, 0.0, 0.5, 0.9, 3600.0, 8e9]),
)


@settings(max_examples=20)
@given(bad=st.lists(st.tuples(st.integers(0, 10**6), BAD_SCANS), min_size=1, max_size=25))
def test_no_scan_stops_the_engine(flight: Flight, bad: list) -> None:
    events = flight.until(15.0)
    for place, (sensor, z, measured_s) in sorted(bad, key=lambda one: -one[0] % len(events)):
        here = events[place % len(events)].t_ns
        measured_t_ns = max(0, min(here + round(measured_s * S), 2**63 - 1))
        events.insert(
            place % len(events), Scan(here, measured_t_ns, sensor, read_only(np.reshape(z, (-1, 2))))
        )
    for effect in play(flight.config, events):
        if isinstance(effect, Picture):
            for one in effect.tracks:
                assert np.isfinite(one.mean).all()
                assert np.isfinite(one.cov).all()


def test_huge_and_empty_scans_are_worked_and_the_mission_goes_on(flight: Flight) -> None:
    rng, events, scans = np.random.default_rng(0), [], 0
    for event in flight.until(HEARD_S):
        events.append(event)
        if isinstance(event, Scan):
            scans += 1
            if scans == 12:
                crowd = rng.uniform(-100.0, 2100.0, (5000, 2))
                events[-1] = replace(event, z_m=read_only(np.vstack([event.z_m, crowd])))
            elif scans == 16:
                events[-1] = replace(event, z_m=read_only(np.empty((0, 2))))
    effects = play(flight.config, events)
    assert not [effect for effect in effects if isinstance(effect, AgentStatus)]


@pytest.mark.parametrize("measured_s", [-30.0, -1.5, 0.0, 3600.0])
def test_scans_that_come_late_or_twice_or_from_the_future_change_nothing(
    flight: Flight, measured_s: float
) -> None:
    events = []
    for event in flight.until(HEARD_S):
        events.append(event)
        if isinstance(event, Scan):
            stray = replace(event, measured_t_ns=event.measured_t_ns + round(measured_s * S))
            events += [stray, stray, stray]
    effects = play(flight.config, events)
    undisturbed = play(flight.config, flight.until(HEARD_S))
    assert written(effects, without=(Notice,)) == written(undisturbed, without=(Notice,))
    problems = [notice.parameters["problem"] for notice in noticed(effects, NoticeCode.BAD_INPUT)]
    assert 0 < sum(problem.startswith("scan of radar") for problem in problems) <= 20


def test_bad_input_is_counted_all_and_summarised(flight: Flight) -> None:
    engine, notices = Engine(flight.config, SEED), list[Effect]()
    for t_s in range(500):
        notices += engine.step(BadInput(at(t_s), "zenoh", f"not JSON: {t_s}"))
        notices += noticed(engine.step(Tick(at(t_s))), NoticeCode.BAD_INPUT, NoticeCode.BAD_INPUT_MORE)
    assert engine.stages.input_errors.count == 500
    assert (notices[0].code, notices[0].parameters["problem"]) == (NoticeCode.BAD_INPUT, "not JSON: 0")
    assert len(notices) == 3 + 49


# ---------------------------------------------------------------- vehicles of our own making


class Plane:
    """Stands in the sky and says so twice a second; answers nothing that has to do with missions."""

    def __init__(self, system_id: int, place: tuple[float, float], config: Config) -> None:
        self.place, self.peer = place, f"vehicle:{system_id}"
        self._encode, self._frame = Encoder(system_id, 1), config.local_frame

    def speak(self, t_s: float) -> Datagram:
        lat, lon = self._frame.to_geodetic(*self.place)
        fields = (round(lat * 1e7), round(lon * 1e7), 170_000, 100_000, 0, 0, 0, 0)
        beat = dialect.MAVLink_heartbeat_message(1, 3, 217, 12, 4, 3)
        here = dialect.MAVLink_global_position_int_message(round(t_s * 1000), *fields)
        return Datagram(at(t_s), LINK, self.peer, self._encode(beat) + self._encode(here))


TARGET = (1500.0, 200.0)
DELAY_S = 0.2
"""From a scan's measurement to its arrival."""


class Scene:
    """Central command, one deaf plane and one target."""

    def __init__(self) -> None:
        self.config = mission(agents=[(100.0, 200.0)], births=[TARGET])
        self.engine = Engine(self.config, 0)
        self.plane: Plane | None = Plane(1, (100.0, 200.0), self.config)
        self.effects: list[Effect] = []
        self.t_s = 0.0

    def fly(self, seconds: float) -> list[Effect]:
        """Let time pass; return what came out."""
        before, end_s = len(self.effects), self.t_s + seconds
        while self.t_s < end_s - 0.01:
            step = round(self.t_s * 10)
            if self.plane is not None and step % 5 == 0:
                self.effects += self.engine.step(self.plane.speak(self.t_s))
            if step % 10 == 2:
                things = [TARGET] if self.plane is None else [TARGET, self.plane.place]
                radar_scan = scan(self.t_s - DELAY_S, *things, arrives_s=self.t_s)
                self.effects += self.engine.step(radar_scan)
            self.effects += self.engine.step(Tick(at(self.t_s)))
            self.t_s = (step + 1) / 10
        return self.effects[before:]

    def all(self, kind: type[T]) -> list[T]:
        return [effect for effect in self.effects if isinstance(effect, kind)]


def test_a_vehicle_that_refuses_its_mission_is_reported_and_gets_a_new_one() -> None:
    scene = Scene()
    scene.fly(120.0)
    first, second = scene.all(Plan)[:2]
    failed = scene.all(UploadReport)[0]
    assert (first.reason, first.changed) == ("first plan", (1,))
    assert (failed.vehicle, failed.mission_id, failed.ok) == (1, 1, False)
    assert (second.reason, second.changed) == ("agent 1 has no route", (1,))
    assert 0 < second.t_ns - failed.t_ns <= 6 * S
    later = scene.effects[scene.effects.index(second) :]
    assert any(m.get_type() == "MISSION_COUNT" for _, m in messages(later))


def test_a_upload_to_a_vehicle_that_is_lost_is_given_up_without_a_word_more() -> None:
    scene = Scene()
    scene.fly(8.0)
    assert scene.engine.state.tasking.stages == {1: "upload"}
    scene.plane = None
    effects = scene.fly(40.0)
    death = next(i for i, e in enumerate(effects) if isinstance(e, AgentStatus))
    assert (effects[death].vehicle, effects[death].status) == (1, "lost")
    assert not [m for _, m in messages(effects[death:]) if m.get_type() in MISSION_MESSAGES]
    assert not any(isinstance(effect, Plan) for effect in effects[death:])
    assert scene.engine.state.tasking.stages == {}
    assert (scene.all(UploadReport), dict(scene.engine.stages.association.labels)) == ([], {})


def test_a_plan_has_the_epoch_of_its_tracks() -> None:
    scene = Scene()
    scene.fly(8.0)
    (plan,) = scene.all(Plan)
    assert plan.t_ns - plan.picture_t_ns == round(DELAY_S * S)


def test_an_agent_at_its_target_has_arrived_and_the_mission_ends_once_for_good() -> None:
    scene = Scene()
    scene.fly(8.0)
    assert scene.plane is not None
    for step in range(94):
        scene.plane.place = (100.0 + 15.0 * step, 200.0)
        scene.fly(1.0)
    scene.fly(20.0)
    (status,) = scene.all(AgentStatus)
    (ended,) = scene.all(MissionEnded)
    assert (status.vehicle, status.status, status.target) == (1, "arrived", (0, 0))
    assert (ended.arrived, ended.lost) == ((1,), ())
    assert all(plan.t_ns <= ended.t_ns for plan in scene.all(Plan))


def test_an_agent_that_is_found_again_flies_again() -> None:
    scene = Scene()
    scene.fly(8.0)
    plane, scene.plane = scene.plane, None
    scene.fly(8.0)
    scene.plane = plane
    scene.fly(12.0)
    assert [status.status for status in scene.all(AgentStatus)] == ["lost", "active"]
    assert scene.engine.stages.association.labels.keys() == {1}


def test_a_mission_that_ended_without_agents_goes_on_with_the_first_that_is_heard_again() -> None:
    """Before, an outage of all radios ended a mission for good: nobody was tasked again."""
    scene = Scene()
    scene.fly(8.0)
    plane, scene.plane = scene.plane, None
    scene.fly(8.0)
    (ended,) = scene.all(MissionEnded)
    assert (ended.arrived, ended.lost) == ((), (1,))
    scene.plane = plane
    (notice,) = noticed(scene.fly(12.0), NoticeCode.MISSION_GOES_ON)
    assert notice.parameters == {"vehicles": (1,)}
    assert [plan.changed for plan in scene.all(Plan) if plan.t_ns > ended.t_ns] == [(1,)]
    assert scene.all(MissionEnded) == [ended]


# ---------------------------------------------------------------- a whole mission


def test_a_target_that_was_reached_gets_no_other_agent(flight: Flight) -> None:
    reached: set[tuple[int, int]] = set()
    for effect in flight.effects:
        if isinstance(effect, AgentStatus) and effect.target is not None:
            reached.add(effect.target)
        elif isinstance(effect, Plan):
            assert not reached & {route.target for route in effect.routes}
            assert not reached & set(effect.unassigned_targets)
            assert not any(f"target {birth}.{i} lost" in effect.reason for birth, i in reached)
    assert len(reached) == 3


def test_an_agent_that_arrived_or_was_lost_is_in_no_later_plan(flight: Flight) -> None:
    out: set[int] = set()
    for effect in flight.effects:
        if isinstance(effect, AgentStatus):
            out.add(effect.vehicle)
        elif isinstance(effect, Plan):
            assert not out & {route.vehicle for route in effect.routes}
            assert not out & set(effect.unassigned_vehicles)
    assert out == {1, 2, 3, 4}


def test_the_seed_makes_the_map() -> None:
    config = mission(tables="[map]\nrandom_threshold = 0.1\n")
    one, same, other = (Engine(config, seed).grid.blocked for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)
