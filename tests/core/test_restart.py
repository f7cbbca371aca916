"""Central command restarts in flight: no mission is flown twice, and every onboard mission is checked."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import pytest
from helpers.noticed import alarms, noticed
from helpers.ordered_flight import SEED, flight_with_a_restart, flown, load, order, standing
from helpers.other_station import MISSION as STATIONS
from helpers.staging import S, suspensions
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import parse, read_text
from gcs.config.key_overrides import override_keys
from gcs.core.engine import Engine
from gcs.core.snapshot import decode_state, encode_state
from gcs.core.state import State, flown_routes, with_status
from gcs.io.record_json import encode
from gcs.mavlink.frames.codec import Encoder
from gcs.model import (
    AgentStatus,
    Datagram,
    Effect,
    MissionEnded,
    NoFlyZone,
    Notice,
    NoticeCode,
    OrderAnswer,
    Plan,
    Resumed,
    Tick,
    UploadReport,
)
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import Scenario, parse_scenario

MISSION = {"MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_CLEAR_ALL"}


def test_targets_that_stand_still_cost_no_upload_after_a_restart_and_all_arrive() -> None:
    flight = flight_with_a_restart(40.0, 6.0, 400.0, scenario=standing())
    for vehicle in (1, 2, 3, 4):
        assert not {m.get_type() for m in flight.messages_to(vehicle, 46.0, 400.0)} & MISSION
    assert len(noticed(flight.all(Notice), NoticeCode.ONBOARD_VERIFIED)) == 4
    (ended,) = flight.all(MissionEnded)
    assert (ended.arrived, ended.lost) == ((1, 2, 3, 4), ())


@pytest.mark.parametrize(("at_s", "loss"), [(30.0, 0.0), (70.0, 0.3), (125.0, 0.0)])
def test_moving_targets_and_losses_are_taken_up_and_the_survivors_arrive(at_s: float, loss: float) -> None:
    flight = flight_with_a_restart(at_s, 4.0, 300.0, loss=loss)
    (ended,) = flight.all(MissionEnded)
    assert (ended.arrived, ended.lost) == ((1, 3, 4), (2,))
    reached = [status.target for status in flight.all(AgentStatus) if status.status == "arrived"]
    assert len(reached) == 3
    taken_up = [plan for plan in flight.all(Plan) if "taken up again" in plan.reason]
    assert len(taken_up) == 1
    assert "lost" not in taken_up[0].reason
    assert loss or "joined" not in taken_up[0].reason


@lru_cache
def uploading_s(scenario: str, *keys: str) -> tuple[Scenario, float]:
    """Return a scenario with other keys, and the time at which its first uploads begin."""
    text, source = read_text(scenario)
    changed = parse_scenario(override_keys(text, list(keys), source), source)
    run = VirtualRun(changed, SEED)
    while not run.engine.state.tasking.stages:
        run.run((run.t_ns - START_T_NS) / S + 0.05)
    return changed, (run.t_ns - START_T_NS) / S


def test_a_snapshot_and_a_restart_replay() -> None:
    flight = flown(load("prescribed"), 30.0)
    run, events, effects = flight.run, flight.events, flight.effects
    snapshot = run.snapshot()
    events.clear()
    effects.clear()
    run.restart(4.0, snapshot)
    run.run(60.0)
    assert isinstance(events[0], Resumed)
    engine = Engine(run.scenario.config, SEED, decode_state("test", snapshot.data))
    assert [encode(e) for event in events for e in engine.step(event)] == [encode(e) for _, e in effects]


def test_another_mission_than_the_one_it_was_given_is_left_alone_until_resumed() -> None:
    def other_mission(run: VirtualRun) -> None:
        store = run.vehicles["vehicle:3"].autopilot.mission
        items = [store[i] for i in range(len(store))]
        items[1] = replace(items[1], z=items[1].z + 5.0)
        store._items = items

    flight = flight_with_a_restart(30.0, 4.0, 70.0, meanwhile=other_mission)
    (differs,) = noticed(alarms(flight.all(Notice), 3), NoticeCode.MISSION_DIFFERS)
    assert differs.parameters["difference"].startswith("item 1: z_m")
    assert not {m.get_type() for m in flight.messages_to(3, 34.0, 70.0)} & MISSION
    assert flight.mode(3) is Mode.AUTO
    assert suspensions(flight.run.engine) == {3: "found"}


@pytest.mark.parametrize("px4", [[], [1, 2, 3, 4]], ids=["ArduPlane", "PX4"])
@pytest.mark.parametrize("begun_s", [0.05, 0.2, 0.5])
def test_uploads_continue_after_a_restart(px4: list[int], begun_s: float) -> None:
    scenario, first_s = uploading_s("prescribed", f"simulation.px4={px4}")
    flight = flight_with_a_restart(first_s + begun_s, 3.0, 25.0, scenario=scenario)
    (resumed,) = noticed(flight.all(Notice), NoticeCode.RESUMED)
    assert "uploads to agents 1, 2, 3, 4" in resumed.parameters["contents"]
    assert not alarms(flight.all(Notice))
    assert all(flight.mode(vehicle) is Mode.AUTO for vehicle in (1, 2, 3, 4))
    assert {report.vehicle for report in flight.all(UploadReport) if report.ok} == {1, 2, 3, 4}


STEERING = MISSION | {"MISSION_SET_CURRENT", "MISSION_WRITE_PARTIAL_LIST", "SET_MODE"}


@pytest.mark.parametrize("px4", [[], [1, 2, 3, 4]], ids=["ArduPlane", "PX4"])
@pytest.mark.parametrize("begun_s", [0.05, 0.2, 0.35, 0.5, 0.8])
def test_nothing_is_sent_to_a_vehicle_that_turned_home_while_the_service_was_away(
    px4: list[int], begun_s: float
) -> None:
    """A PX4 in RTL flies to the item that is selected: it flew 590 m away from home."""
    scenario, first_s = uploading_s("prescribed", f"simulation.px4={px4}")
    at_s = first_s + begun_s

    def turn_home(run: VirtualRun) -> None:
        assert 3 in run.engine.state.tasking.stages
        run.vehicles["vehicle:3"].autopilot.set_mode(Mode.RTL)

    flight = flight_with_a_restart(at_s, 3.0, 25.0, scenario=scenario, meanwhile=turn_home)
    sent = flight.messages_to(3, at_s + 3.0, 25.0)
    set_mode = dialect.MAV_CMD_DO_SET_MODE
    assert not [m for m in sent if m.get_type() in STEERING or getattr(m, "command", 0) == set_mode]
    assert flight.mode(3) is Mode.RTL
    assert "RTL" in flight.run.engine.untaskable()[3]


@pytest.mark.parametrize("px4", [[], [1, 2, 3, 4]], ids=["ArduPlane", "PX4"])
@pytest.mark.parametrize(("saved_s", "killed_s"), [(0.05, 0.8), (0.05, 1.3), (0.3, 1.3)])
def test_a_mission_that_was_stored_after_the_state_was_saved_is_not_uploaded_again(
    px4: list[int], saved_s: float, killed_s: float
) -> None:
    scenario, begun_s = uploading_s("deterministic", "planning.shape=pulled", f"simulation.px4={px4}")
    restarted_s = begun_s + killed_s + 3.0
    flight = flight_with_a_restart(
        begun_s + saved_s, 3.0, 30.0, scenario=scenario, meanwhile=lambda run: run.run(begun_s + killed_s)
    )
    for vehicle in (1, 2, 3, 4):
        sent = {m.get_type() for m in flight.messages_to(vehicle, restarted_s, 30.0)}
        assert not sent & {"MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_CLEAR_ALL"}
        assert flight.mode(vehicle) is Mode.AUTO
    assert {report.vehicle for report in flight.all(UploadReport) if report.ok} == {1, 2, 3, 4}
    assert not alarms(flight.all(Notice))


def test_an_upload_is_not_given_up_for_the_length_of_an_outage() -> None:
    first = VirtualRun(load("prescribed"), SEED)
    while not first.engine.state.tasking.stages:
        first.run((first.t_ns - START_T_NS) / S + 0.05)
    at_s = (first.t_ns - START_T_NS) / S + 0.05
    first.run(at_s)
    engine = Engine(first.scenario.config, SEED, decode_state("test", first.snapshot().data))
    effects = engine.step(Resumed(first.t_ns + 400 * S, first.t_ns))
    effects += engine.step(Tick(first.t_ns + 400 * S))
    assert set(engine.state.tasking.stages.values()) == {"verify"}
    assert not [e for e in effects if isinstance(e, UploadReport)]


def test_held_vehicles_closed_areas_and_plan_numbers_survive() -> None:
    area = NoFlyZone("fire", (1700.0, 1200.0, 60.0))
    close = replace(order(21.0, "no-fly-zone"), no_fly_zone=area)
    flight = flight_with_a_restart(30.0, 4.0, 60.0, orders=(order(20.0, "hold", 1), close))
    engine = flight.run.engine
    assert suspensions(engine) == {1: "hold"}
    assert engine.state.airspace.zones == {"fire": area}
    assert engine.grid.blocked[30, 42]
    assert not {m.get_type() for m in flight.messages_to(1, 34.0, 60.0)} & MISSION
    assert flight.mode(1) is Mode.LOITER
    assert {a.action for a in flight.all(OrderAnswer)} == {"hold", "no-fly-zone"}


def test_a_second_restart_while_the_first_is_worked_off_loses_nothing() -> None:
    flight = flown(standing(), 40.0)
    flight.run.restart(3.0)
    flight.run.run(44.2)
    flight.effects.clear()
    flight.run.restart(3.0)
    flight.run.run(400.0)
    (ended,) = flight.all(MissionEnded)
    assert ended.arrived == (1, 2, 3, 4)
    assert not any(plan.changed for plan in flight.all(Plan))


def test_the_lost_stay_lost_and_the_arrived_are_not_sent_again() -> None:
    flight = flight_with_a_restart(138.0, 4.0, 400.0)
    before = {f.vehicle: f.status for f in flight.all(AgentStatus) if f.t_ns < START_T_NS + 138 * S}
    assert before[2] == "lost"
    assert "arrived" in before.values()
    plans = [plan for plan in flight.all(Plan) if plan.t_ns > START_T_NS + 142 * S]
    assert plans
    assert not any(route.vehicle in before for plan in plans for route in plan.routes)
    targets = [status.target for status in flight.all(AgentStatus) if status.status == "arrived"]
    assert len(targets) == 3


def test_without_central_command_each_vehicle_flies_its_mission_to_its_safe_end() -> None:
    run = flown(load("deterministic"), 40.0).run
    last = {
        v: len(items.items) - 1 for v in (1, 2, 3, 4) if (items := run.engine.state.agents[v].tasking.onboard)
    }
    run.restart(200.0)
    for vehicle in (1, 2, 3, 4):
        autopilot = run.vehicles[f"vehicle:{vehicle}"].autopilot
        assert (autopilot.mode, autopilot.seq) == (Mode.AUTO, last[vehicle])  # circles at the last item
    run.run(260.0)
    assert run.ended


def test_a_loiter_that_an_operator_chose_before_or_meanwhile_is_still_his_after_a_restart() -> None:
    flight = flown(standing(), 30.0)
    run = flight.run
    run.vehicles["vehicle:2"].autopilot.set_mode(Mode.LOITER)
    run.run(33.0)
    snapshot = run.snapshot()
    run.vehicles["vehicle:3"].autopilot.set_mode(Mode.LOITER)
    run.restart(3.0, snapshot)
    run.run(70.0)
    assert set(run.engine.untaskable()) == {2, 3}
    for vehicle in (2, 3):
        assert flight.mode(vehicle) is Mode.LOITER
        assert "left alone" in run.engine.untaskable()[vehicle]


def test_an_inconsistent_mission_of_an_overridden_vehicle_is_repaired_once_it_is_resumed() -> None:
    run = flown(standing(), 30.0).run
    run.vehicles["vehicle:4"].autopilot.set_mode(Mode.LOITER)  # an override
    run.run(33.0)
    run.engine.state.agents[4].routes.drop()
    run.engine.stages.tasking.forget_onboard(4)
    run.engine.stages.tasking.mark_inconsistent(4)
    run.restart(3.0, run.snapshot())
    run.run(45.0)
    tasking = run.engine.state.agents[4].tasking
    assert tasking.is_inconsistent  # nothing is sent against an override
    run.order(order(45.0, "resume", 4))
    run.run(60.0)
    assert (tasking.is_inconsistent, tasking.onboard is not None) == (False, True)


def test_a_mission_of_another_station_counts_after_a_restart_until_the_vehicle_is_resumed() -> None:
    mission = parse(STATIONS, "x")
    before, t_ns = Engine(mission, 1), 100 * S
    write = Encoder(254, 190)(dialect.MAVLink_mission_count_message(1, 1, 3, 0))
    before.step(Datagram(t_ns, "udpin:0.0.0.0:14551", "10.0.0.5:50", write))
    after = Engine(mission, 1, decode_state("test", encode_state(before.state)))
    effects = after.step(Resumed(t_ns + S, t_ns))
    assert "system 254/190 at 10.0.0.5:50" in after.untaskable()[1]
    assert noticed(effects, NoticeCode.RESUMED)
    broken = (NoticeCode.STATION_UPLOAD_BROKEN, NoticeCode.STATION_UPLOAD_MIXED)
    assert not noticed(after.step(Tick(t_ns + 10 * S)), *broken)
    assert noticed(after.step(Tick(t_ns + 12 * S)), *broken)
    again = Engine(mission, 1, decode_state("test", encode_state(after.state)))
    again.step(Resumed(t_ns + 13 * S, t_ns + 12 * S))
    assert not noticed(again.step(Tick(t_ns + 60 * S)), *broken), "reported once"
    heartbeat = Encoder(1, 1)(dialect.MAVLink_heartbeat_message(1, 3, 217, 10, 4, 3))
    again.step(Datagram(t_ns + 61 * S, "udpin:0.0.0.0:14550", "10.0.0.1:5", heartbeat))
    again.step(order(61.0, "resume", 1))
    assert "system 254" not in str(again.untaskable())


def test_a_held_vehicle_that_is_resumed_before_its_mission_is_taken_up_again_flies_on() -> None:
    orders = (order(11.0, "hold", 2), order(34.5, "resume", 2))
    flight = flight_with_a_restart(30.0, 4.0, 400.0, orders=orders, scenario=standing())
    again = next(plan for plan in flight.all(Plan) if "taken up again" in plan.reason)
    assert again.t_ns > START_T_NS + 34.5 * S
    assert flight.answers("resume-34.5") == [("accepted", None), ("done", 2)]
    (ended,) = flight.all(MissionEnded)
    assert ended.arrived == (1, 2, 3, 4)


@pytest.mark.parametrize(("scenario", "seed", "at_s"), [("random-targets", 5, 28.75), ("radars", 2, 49.74)])
def test_a_restart_by_itself_changes_no_route(scenario: str, seed: int, at_s: float) -> None:
    effects: list[Effect] = []
    run = VirtualRun(load(scenario), seed, on_effect=lambda _, effect: effects.append(effect))
    run.run(at_s)
    assigned = {v: route.target for v, route in flown_routes(run.engine.state.agents).items()}
    effects.clear()
    run.restart(2.0)
    run.run(at_s + 5.0)
    number = next(n for n, e in enumerate(effects) if isinstance(e, Plan) and "taken up again" in e.reason)
    again, before = effects[number], effects[:number]
    assert isinstance(again, Plan)
    assert again.changed == ()
    active = with_status(run.engine.state.agents, "active")
    assert {route.vehicle: route.target for route in again.routes} == {v: assigned[v] for v in active}
    verified = [notice.vehicle for notice in noticed(before, NoticeCode.ONBOARD_VERIFIED)]
    assert sorted(verified) == sorted(active), "no plan before missions are read back"


# ---------------------------------------------------------------- missions of others


def give_another(run: VirtualRun, vehicle: int) -> None:
    """What a ground station with a radio of its own does: one point is somewhere else."""
    store = run.vehicles[f"vehicle:{vehicle}"].autopilot.mission
    items = [store[i] for i in range(len(store))]
    items[-1] = replace(items[-1], x=items[-1].x + 9000)
    store.replace(items)


def test_a_vehicle_that_waits_for_a_task_and_holds_another_mission_is_not_tasked_after_a_restart() -> None:
    flight = flown(standing(), 30.0)
    run = flight.run
    run.engine.state.agents[3].routes.drop()
    snapshot = run.snapshot()
    give_another(run, 3)
    run.restart(3.0, snapshot)
    stored = list(run.vehicles["vehicle:3"].autopilot.mission)
    run.run(60.0)
    assert noticed(alarms(flight.all(Notice), 3), NoticeCode.MISSION_DIFFERS)
    assert list(run.vehicles["vehicle:3"].autopilot.mission) == stored
    assert suspensions(run.engine) == {3: "found"}


@pytest.mark.parametrize("changed", [True, False])
def test_a_vehicle_that_was_not_heard_for_a_while_gets_an_onboard_mission_audit(changed: bool) -> None:
    def away(t_ns: int, peer: str, data: bytes) -> list[tuple[str, bytes]]:
        return [] if peer == "vehicle:2" and t_ns < START_T_NS + 42 * S else [(peer, data)]

    flight = flown(standing(), 30.0)
    run = flight.run
    run.tamper = away
    run.run(35.0)
    if changed:
        give_another(run, 2)
    stored = list(run.vehicles["vehicle:2"].autopilot.mission)
    run.run(60.0)
    assert list(run.vehicles["vehicle:2"].autopilot.mission) == stored
    assert bool(noticed(alarms(flight.all(Notice), 2), NoticeCode.MISSION_DIFFERS)) is changed
    assert suspensions(run.engine) == ({2: "found"} if changed else {})
    assert (run.engine.state.agents[2].routes.flown is not None) is not changed


def test_a_vehicle_without_an_audit_gets_no_mission_until_an_answer_or_an_order() -> None:
    flight = flown(standing(), 30.0)
    run = flight.run
    snapshot = run.snapshot()
    dumb = [run.vehicles[f"vehicle:{n}"] for n in (1, 4)]
    given = [vehicle._link._missions._list for vehicle in dumb]
    for vehicle in dumb:
        vehicle._link._missions._list = lambda *_: None
    run.restart(3.0, snapshot)
    run.run(65.0)
    for number in (1, 4):
        assert "does not answer the download of its onboard mission" in run.engine.untaskable()[number]
        assert noticed(alarms(flight.all(Notice), number), NoticeCode.MISSION_UNREAD)
    run.order(order(65.5, "resume", 1))  # where its circle is clear of obstacles
    dumb[1]._link._missions._list = given[1]
    run.run(75.0)
    assert not {1, 4} & set(run.engine.untaskable())


# ---------------------------------------------------------------- tracks


@pytest.mark.parametrize("at_s", [20.0, 45.0, 75.0])
def test_tracks_keep_their_labels_over_a_restart(at_s: float) -> None:
    run = flown(load("random-targets"), at_s).run
    before = run.engine
    run.restart(3.0)
    run.run(at_s + 5.0)
    targets = before.stages.trackers.targets.confirmation.tracks
    assert len(targets) >= 2
    assert targets.keys() <= run.engine.stages.trackers.targets.confirmation.tracks.keys()
    assert run.engine.stages.association.labels == before.stages.association.labels
    assert with_status(run.engine.state.agents, "active") == with_status(before.state.agents, "active")


@pytest.mark.parametrize("outage_s", [15.0, 60.0])
def test_agents_that_turned_in_a_long_outage_are_not_called_lost(outage_s: float) -> None:
    flight = flight_with_a_restart(30.0, outage_s, 60.0 + outage_s, scenario=standing())
    assert not [one for one in flight.all(AgentStatus) if one.status == "lost"]
    assert set(flight.run.engine.stages.association.labels) == {1, 2, 3, 4}


def test_after_a_long_outage_agents_are_tracked_where_they_report_though_scans_were_waiting() -> None:
    def scans_wait(run: VirtualRun) -> None:
        assert run.engine.state.perception.oosm_buffer.held

    flight = flight_with_a_restart(19.82, 20.0, 42.0, scenario=load("radars"), meanwhile=scans_wait)
    assert set(flight.run.engine.stages.association.labels) == {1, 2, 3, 4}
    tracks = flight.run.engine.stages.trackers.agents.confirmation.tracks
    assert len(tracks) == 4
    assert all(track.existence > 0.99 for track in tracks.values())


@pytest.mark.parametrize("outage_s", [2.0, 20.0])
def test_a_vehicle_lost_in_the_outage_is_called_lost_before_the_others_get_a_plan(outage_s: float) -> None:
    def shot_down(run: VirtualRun) -> None:
        run.kills[3] = 30.0

    flight = flight_with_a_restart(30.0, outage_s, 60.0, scenario=standing(), meanwhile=shot_down)
    (again,) = [plan for plan in flight.all(Plan) if "taken up again" in plan.reason]
    assert again.t_ns <= START_T_NS + round((39.0 + outage_s) * S)
    assert sorted(route.vehicle for route in again.routes) == [1, 2, 4]
    (status,) = flight.all(AgentStatus)
    assert (status.vehicle, status.status) == (3, "lost")
    assert status.t_ns <= again.t_ns


def test_a_damaged_state_is_refused() -> None:
    run = flown(standing(), 30.0).run
    state = decode_state("test", run.snapshot().data)
    posterior = state.perception.trackers.targets.filter.posterior
    posterior.track_label[0] = 10**6
    with pytest.raises(ValueError, match="tracker state: track_label is not valid"):
        Engine(run.scenario.config, SEED, state)


def test_a_state_of_other_vehicles_is_refused() -> None:
    with pytest.raises(ValueError, match="vehicles"):
        Engine(load("prescribed").config, SEED, State.initial([1, 2]))
