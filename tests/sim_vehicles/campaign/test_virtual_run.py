"""A user would lose the workhorse: missions on virtual time that fail, differ from run to run, or cheat."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field

import pytest
from helpers.noticed import noticed
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.io.record_json import encode
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Datagram,
    Effect,
    Event,
    MissionEnded,
    NoticeCode,
    Plan,
    Scan,
    Send,
    Tick,
    Truth,
    UploadReport,
)
from gcs.report.run.evaluation import Evaluator, Summary
from sim_vehicles.campaign.virtual_run import START_T_NS, STEP_NS, VirtualRun
from sim_vehicles.vehicle.vehicle import SimVehicle
from sim_vehicles.world.scenario import load, parse_scenario

PAPER = ["deterministic", "prescribed", "random-obstacles", "random-targets"]
FIRST_PLAN_S = 2.0
"""Tracks are confirmed at the third scan."""


@dataclass
class Flown:
    """A mission that was flown: its verdict, its recording, its statuses."""

    summary: Summary
    effects: list[Effect] = field(default_factory=list)
    ground_truth: list[Truth] = field(default_factory=list)
    recording: str = ""

    def statuses(self) -> dict[int, list[tuple[float, str]]]:
        """Seconds and agent status of each change, by vehicle."""
        changes: dict[int, list[tuple[float, str]]] = {}
        for effect in self.effects:
            if isinstance(effect, AgentStatus):
                changes.setdefault(effect.vehicle, []).append(
                    ((effect.t_ns - START_T_NS) / NS_PER_S, effect.status)
                )
        return changes


def fly(
    name: str,
    seed: int,
    *,
    loss: float = 0.0,
    kills: dict[int, float] | None = None,
    until_s: float | None = None,
) -> Flown:
    scenario = load(name)
    config = scenario.config
    evaluator = Evaluator(config.planning.capture_radius_m, [agent.system_id for agent in config.agents])
    effects: list[Effect] = []
    ground_truth: list[Truth] = []
    recording = hashlib.sha256()

    def on_effect(_t_ns: int, effect: Effect) -> None:
        evaluator.add_effect(effect)
        effects.append(effect)
        recording.update(encode(effect))

    def on_truth(truth: Truth) -> None:
        evaluator.add_truth(truth)
        ground_truth.append(truth)
        recording.update(encode(truth))

    def on_event(event: Event) -> None:
        recording.update(encode(event))

    run = VirtualRun(scenario, seed, on_event, on_effect, on_truth, loss, kills or {})
    flown_s = run.run(until_s)
    summary = evaluator.summary(
        scenario=name, seed=seed, duration_s=flown_s, scan_ms_p99=0.0, plan_ms_p99=0.0, recording=""
    )
    return Flown(summary, effects, ground_truth, recording.hexdigest())


def assert_complete(flown: Flown) -> None:
    assert flown.summary.outcome == "complete", flown.summary.reason
    targets = [agent.target for agent in flown.summary.agents if agent.status == "arrived"]
    assert len(set(targets)) == len(targets)
    assert None not in targets
    assert all(agent.status != "active" for agent in flown.summary.agents)


@pytest.mark.parametrize("name", PAPER)
def test_the_papers_missions_complete(name: str) -> None:
    flown = fly(name, 0)
    assert_complete(flown)
    assert flown.summary.false_losses == 0
    assert flown.summary.upload_failures <= flown.summary.losses
    assert sum(isinstance(effect, MissionEnded) for effect in flown.effects) == 1


@pytest.mark.parametrize(
    ("name", "seed", "until_s"),
    [("random-targets", 37, 60.0), ("random-targets", 85, 30.0), ("random-obstacles", 52, 140.0)],
)
def test_at_the_edges_of_the_map_no_mission_leads_outside(name: str, seed: int, until_s: float) -> None:
    """Corners and loiter circles beside obstacles at the edge were once moved off the map."""
    failed = []

    def on_effect(_t_ns: int, effect: Effect) -> None:
        if isinstance(effect, UploadReport) and not effect.ok:
            failed.append(effect.detail)

    VirtualRun(load(name), seed, on_effect=on_effect).run(until_s)
    assert failed == []


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", PAPER)
def test_the_papers_missions_complete_for_a_hundred_seeds(name: str) -> None:
    failed = {}
    for seed in range(100):
        summary = fly(name, seed).summary
        if summary.outcome != "complete":
            failed[seed] = summary.reason
    assert failed == {}


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", PAPER)
def test_missions_complete_over_links_that_lose_a_fifth_for_thirty_seeds(name: str) -> None:
    failed = {}
    for seed in range(30):
        summary = fly(name, seed, loss=0.2).summary
        if summary.outcome != "complete":
            failed[seed] = summary.reason
    assert failed == {}


def test_a_seed_means_one_recording_byte_for_byte_and_another_seed_another() -> None:
    recordings = [fly("random-targets", seed, loss=0.1, until_s=40.0).recording for seed in (2, 2, 3)]
    assert recordings[0] == recordings[1] != recordings[2]


@pytest.mark.parametrize("name", ["prescribed", "random-targets"])
def test_links_that_lose_a_fifth_each_way_still_complete(name: str) -> None:
    assert_complete(fly(name, 1, loss=0.2))


def test_losses_do_not_change_the_world() -> None:
    """Targets move and agents are lost as they would be: only what is heard differs."""
    worlds = []
    for loss in (0.0, 0.3):
        ground_truth = fly("random-obstacles", 3, loss=loss, until_s=99.5).ground_truth
        worlds.append(
            [[(t.kind, t.id, t.alive) for t in truth.objects] for truth in ground_truth]
            + [
                [(t.east_m, t.north_m) for t in truth.objects if t.kind == "targets"]
                for truth in ground_truth
            ]
        )
    assert worlds[0] == worlds[1]


@pytest.mark.parametrize(
    ("name", "vehicle", "at_s"),
    [
        ("deterministic", 3, 1.5),  # seen, but before the first plan
        ("deterministic", 1, FIRST_PLAN_S + 0.1),  # while its first mission is on its way
        pytest.param("prescribed", 1, 5.5, marks=pytest.mark.slow),
        ("prescribed", 3, 60.0),  # in mid-flight, after agent 2
        pytest.param("random-targets", 4, 90.0, marks=pytest.mark.slow),
        ("deterministic", 4, 121.0),  # less than 100 m from its target
    ],
)
def test_a_killed_vehicle_is_called_lost_within_five_seconds_and_the_others_arrive(
    name: str, vehicle: int, at_s: float
) -> None:
    flown = fly(name, 0, kills={vehicle: at_s})
    first, *more = flown.statuses()[vehicle]
    assert more == []
    assert first[1] == "lost"
    assert at_s <= first[0] <= at_s + 5.0
    assert_complete(flown)
    assert flown.summary.false_losses == 0


def test_a_vehicle_killed_before_its_association_is_called_lost_soon_too() -> None:
    flown = fly("prescribed", 0, kills={3: 0.5})
    (change,) = flown.statuses()[3]
    assert change[1] == "lost"
    assert 0.5 < change[0] < 8.0
    assert_complete(flown)


def test_a_vehicle_that_never_shows_up_is_given_up_and_the_others_go() -> None:
    flown = fly("deterministic", 0, kills={2: 0.0})
    (change,) = flown.statuses()[2]
    assert change[1] == "lost"
    assert 20.0 < change[0] < 25.0
    assert_complete(flown)
    first = next(effect for effect in flown.effects if isinstance(effect, Plan))
    assert (first.t_ns - START_T_NS) / NS_PER_S == pytest.approx(5.0, abs=1.0)
    assert [route.vehicle for route in first.routes] == [1, 3, 4]


def test_when_all_are_killed_the_mission_ends_without_agents() -> None:
    flown = fly("deterministic", 0, kills=dict.fromkeys((1, 2, 3, 4), 30.0))
    (ended,) = [effect for effect in flown.effects if isinstance(effect, MissionEnded)]
    assert (ended.arrived, ended.lost) == ((), (1, 2, 3, 4))
    assert flown.summary.duration_s < 36.0


def test_a_killed_vehicle_sends_nothing_more_and_stays_where_it_fell() -> None:
    heard: list[Datagram] = []
    ground_truth: list[Truth] = []

    def on_event(event: Event) -> None:
        if isinstance(event, Datagram):
            heard.append(event)

    VirtualRun(load("prescribed"), 0, on_event, on_truth=ground_truth.append, kills={1: 10.0}).run(20.0)
    last_ns = max(event.t_ns for event in heard if event.peer == "vehicle:1")
    assert 9.0 < (last_ns - START_T_NS) / NS_PER_S < 10.0
    fallen = [truth.objects[0] for truth in ground_truth if truth.t_ns >= START_T_NS + 10 * NS_PER_S]
    assert len(set(fallen)) == 1
    assert (fallen[0].id, fallen[0].alive) == (1, False)
    assert ground_truth[9].objects[0].alive


def test_time_goes_on_in_equal_steps_and_events_are_in_its_order() -> None:
    events: list[Event] = []
    VirtualRun(load("prescribed"), 0, events.append).run(10.0)
    ticks = [event.t_ns for event in events if isinstance(event, Tick)]
    assert ticks == [START_T_NS + i * STEP_NS for i in range(len(ticks))]
    times = [event.t_ns for event in events]
    assert times == sorted(times)
    scans = [event.measured_t_ns for event in events if isinstance(event, Scan)]
    assert scans == [START_T_NS + i * NS_PER_S for i in range(11)]


def test_a_run_that_takes_too_long_ends_at_its_limit() -> None:
    run = VirtualRun(load("deterministic"), 0)
    assert run.run(12.0) == pytest.approx(12.0, abs=0.1)
    assert not run.ended
    assert len(run.timings.scan_ms) == 13
    assert len(run.timings.plan_ms) == 1


@dataclass
class Traffic:
    """What passes over the links of a run, at either end."""

    said: list[tuple[int, str, bytes]] = field(default_factory=list)
    """By vehicles."""
    heard: list[tuple[int, str, bytes]] = field(default_factory=list)
    """By central command."""
    sent: list[tuple[int, str, bytes]] = field(default_factory=list)
    """By central command, with the time at which it is due at the vehicle."""
    got: list[tuple[int, str, bytes]] = field(default_factory=list)
    """By vehicles."""


def traffic(monkeypatch: pytest.MonkeyPatch, seconds: float, loss: float) -> Traffic:
    seen = Traffic()

    def on_event(event: Event) -> None:
        if isinstance(event, Datagram):
            seen.heard.append((event.t_ns, event.peer, event.data))

    def on_effect(t_ns: int, effect: Effect) -> None:
        if isinstance(effect, Send):
            seen.sent.append((t_ns + STEP_NS, effect.peer, effect.data))

    say, take = SimVehicle.datagrams_to_send, SimVehicle.receive_datagram

    def datagrams_to_send(vehicle: SimVehicle, t_ns: int) -> list[bytes]:
        datagrams = say(vehicle, t_ns)
        seen.said.extend((t_ns, f"vehicle:{vehicle.system_id}", data) for data in datagrams)
        return datagrams

    def receive_datagram(vehicle: SimVehicle, data: bytes, t_ns: int) -> None:
        seen.got.append((t_ns, f"vehicle:{vehicle.system_id}", data))
        take(vehicle, data, t_ns)

    monkeypatch.setattr(SimVehicle, "datagrams_to_send", datagrams_to_send)
    monkeypatch.setattr(SimVehicle, "receive_datagram", receive_datagram)
    run = VirtualRun(load("deterministic"), 0, on_event, on_effect, loss=loss)
    run.run(seconds)
    seen.sent = [one for one in seen.sent if one[0] < run.t_ns]
    return seen


def test_bytes_arrive_whole_and_only_at_their_vehicle_a_step_after_they_were_sent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen = traffic(monkeypatch, 6.0, loss=0.0)
    assert len(seen.sent) > 50
    assert sorted(seen.got) == sorted(seen.sent)
    assert seen.heard == seen.said


def test_each_direction_loses_its_share(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = traffic(monkeypatch, 60.0, loss=0.3)
    assert set(seen.heard) <= set(seen.said)
    assert set(seen.got) <= set(seen.sent)
    for arrived, sent in ((seen.heard, seen.said), (seen.got, seen.sent)):
        n = len(sent)
        assert n > 200
        assert len(arrived) == pytest.approx(0.7 * n, abs=5 * math.sqrt(0.21 * n))


def test_a_vehicle_that_another_station_sent_home_gets_no_mission() -> None:
    encoder = mavlink.MAVLink(None, 254, 190)
    rtl = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, 11, 0, 0, 0, 0, 0)
    effects: list[tuple[int, object]] = []
    sent_home_t_ns = START_T_NS + 30 * NS_PER_S

    def on_event(event: object) -> None:
        if isinstance(event, Tick) and event.t_ns == sent_home_t_ns:
            run.vehicles["vehicle:1"].receive_datagram(bytes(rtl.pack(encoder)), event.t_ns)

    run = VirtualRun(load("prescribed"), 1, on_event, lambda t_ns, effect: effects.append((t_ns, effect)))
    run.run(90.0)
    state = run.engine.stages.fleet.state(1)
    assert state is not None
    assert state.mode == "RTL"
    later = [effect for t_ns, effect in effects if t_ns >= sent_home_t_ns + NS_PER_S]
    plans = [effect for effect in later if isinstance(effect, Plan)]
    assert any("agent 1 is in RTL and left alone" in plan.reason for plan in plans)
    assert not any(isinstance(effect, UploadReport) and effect.vehicle == 1 for effect in later)
    assert any(isinstance(effect, UploadReport) and effect.vehicle == 4 for effect in later)


def begun_50_s_ago(text: str) -> str:
    """A scenario whose targets have moved for 50 s when it starts."""
    head, *tables = text.split("[[simulation.targets]]\n")
    moved = []
    for table in tables:
        values = {key: float(value) for key, _, value in (row.partition(" = ") for row in numbers(table))}
        east, north = (values[f"{axis}_m"] + 50.0 * values[f"v_{axis}_m_s"] for axis in ("east", "north"))
        velocity = f"v_east_m_s = {values['v_east_m_s']}\nv_north_m_s = {values['v_north_m_s']}\n"
        moved.append(f"east_m = {east}\nnorth_m = {north}\n{velocity}\n")
    return "[[simulation.targets]]\n".join([head, *moved])


def numbers(table: str) -> list[str]:
    return [row.split("#")[0].strip() for row in table.splitlines() if "=" in row]


@pytest.mark.parametrize("has_adaptive_birth", [True, False])
def test_targets_that_left_their_birth_components_are_found_or_reported(has_adaptive_birth):
    text = begun_50_s_ago(load("prescribed").text)
    if not has_adaptive_birth:
        text = text.replace("per_s = 0.0005", "per_s = 0.0")
    run = VirtualRun(parse_scenario(text, "begun"), seed=1)
    effects: list[Effect] = []
    run.on_effect = lambda _, effect: effects.append(effect)
    run.run(20.0)
    targets = run.engine.stages.trackers.targets.confirmation.tracks
    alarms = noticed(effects, NoticeCode.UNTRACKED_DETECTIONS)
    assert len(targets) == (5 if has_adaptive_birth else 0)
    assert len(alarms) in ([0] if has_adaptive_birth else [1, 2])


def test_the_ground_truth_knows_which_vehicle_came_down():
    scenario = load("deterministic")
    text = scenario.text + '\n[[simulation.faults]]\nsystem_id = 2\nat_s = 10.0\nkind = "crash"\n'
    truths: list[Truth] = []
    VirtualRun(parse_scenario(text, "crash.toml"), 1, on_truth=truths.append).run(30.0)
    agents = {thing.id: thing for thing in truths[-1].objects if thing.kind == "agents"}
    assert {number for number, thing in agents.items() if thing.down} == {2}
    assert agents[2].alive, "sensors still see it, and its radio lives on"
    assert not any(thing.down for thing in truths[9].objects)
