"""An operator would lose trust: an order that is not carried out, or reported done when it is not."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers.hills import elevation_of, terrain_table
from helpers.noticed import noticed
from helpers.ordered_flight import SEED, Flight, flown, fly, load, order, ordered
from helpers.staging import S, suspensions
from msgspec.structs import replace as changed
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import read_text
from gcs.config.key_overrides import override_keys
from gcs.io.record_json import decode, encode
from gcs.mavlink.frames.codec import Encoder
from gcs.model import Effect, MissionEnded, Notice, NoticeCode, Order, OrderAnswer, Plan
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import parse_scenario

MISSION = {"MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_CLEAR_ALL"}


def test_a_held_vehicle_loiters_and_is_not_tasked_and_goes_on_when_resumed() -> None:
    flight = fly([order(20.0, "hold", 1), order(45.0, "resume", 1)], 400.0)
    assert flight.answers("hold-20.0") == [("accepted", None), ("done", 1)]
    assert flight.answers("resume-45.0") == [("accepted", None), ("done", 1)]
    assert not {m.get_type() for m in flight.messages_to(1, 20.0, 45.0)} & MISSION
    held = [p for p in flight.all(Plan) if 20 * S < p.t_ns - START_T_NS < 45 * S]
    assert any("agent 1 is held by order" in p.reason and "agent set aside" in p.causes for p in held)
    assert not any(1 in plan.changed for plan in held)
    (ended,) = flight.all(MissionEnded)
    assert 1 in ended.arrived


def test_a_short_hold_ends_with_the_mission_that_the_vehicle_has_and_no_upload() -> None:
    flight = fly([order(23.1, "hold", 4), order(23.7, "resume", 4)], 36.0)
    assert flight.answers("resume-23.7") == [("accepted", None), ("done", 4)]
    assert not {m.get_type() for m in flight.messages_to(4, 23.0, 36.0)} & MISSION
    assert flight.mode(4) is Mode.AUTO


@pytest.mark.parametrize("px4", [(), (1,)])
def test_over_terrain_a_resumed_vehicle_gets_a_mission_from_where_it_is(px4: tuple[int, ...]) -> None:
    slope = elevation_of(lambda east, north: 70.0 + 0.05 * east + 0.0 * north, 2000.0)
    text = read_text("deterministic")[0] + terrain_table(slope)
    text = override_keys(text, [f"simulation.px4={list(px4)}", "map.obstacles=[]"], "slope")
    orders = [order(20.0, "return", 1), order(35.0, "resume", 1)]
    flight = Flight(VirtualRun(parse_scenario(text, "slope"), SEED, orders=orders))
    flight.run.run(60.0)
    assert flight.answers("resume-35.0") == [("accepted", None), ("done", 1)]
    sent = [m for m in flight.messages_to(1, 35.0, 60.0) if m.get_type() == "MISSION_ITEM_INT"]
    assert sent, "its old mission begins where it was before it returned"
    assert flight.mode(1) is Mode.AUTO
    if px4:
        height_m = flight.run.vehicles["vehicle:1"].alt_msl_m
        first = next(m for m in sent if m.seq == 0)
        assert first.z < height_m + 15.0


def test_return_brings_all_home_over_a_lossy_link_and_no_agent_is_tasked_again() -> None:
    flight = fly([order(30.0, "return")], 75.0, loss=0.3)
    assert flight.answers("return-30.0")[0] == ("accepted", None)
    assert {("done", v) for v in (1, 3, 4)} <= set(flight.answers("return-30.0"))
    assert [flight.mode(v) for v in (1, 3, 4)] == [Mode.RTL] * 3
    assert not any(plan.changed for plan in flight.all(Plan) if plan.t_ns > START_T_NS + 30 * S)


def test_an_order_to_a_lost_vehicle_says_that_it_is_not_heard_and_promises_no_mission() -> None:
    flight = fly([order(30.0, "return"), order(60.0, "resume")], 90.0)
    answers = [a for a in flight.all(OrderAnswer) if a.order_id == "resume-60.0"]
    (accepted,) = [a for a in answers if a.state == "accepted"]
    assert accepted.detail.endswith("agent 2 not heard at present")
    (failed,) = [a for a in answers if a.state == "failed"]
    assert failed.vehicle == 2
    assert failed.detail == "no answer to 10 commands; is lost; it gets a mission when it is tracked again"


def test_a_hold_in_the_middle_of_a_upload_leaves_no_inconsistent_mission_to_be_flown() -> None:
    first = fly([], 20.0, loss=0.4)
    (plan,) = first.all(Plan)[:1]
    at_s = (plan.t_ns - START_T_NS) / S + 0.6
    flight = fly([order(at_s, "hold")], at_s + 40.0, loss=0.4)
    for vehicle in (1, 2, 3, 4):
        assert flight.mode(vehicle) is Mode.LOITER
        assert not any(
            m.get_type() == "COMMAND_LONG" and m.command == 176 and m.param2 == Mode.AUTO
            for m in flight.messages_to(vehicle, at_s, at_s + 40.0)
        )


def test_disarming_in_the_air_is_refused_and_nothing_is_sent() -> None:
    flight = fly([order(20.0, "disarm")], 24.0)
    answers = [a for a in flight.all(OrderAnswer) if a.order_id == "disarm-20.0"]
    assert [a.state for a in answers] == ["refused"] * 4
    assert all("in the air" in a.detail for a in answers)
    assert answers[-1].waiting == ()
    sent = [message for vehicle in (1, 2, 3, 4) for message in flight.messages_to(vehicle, 20.0, 24.0)]
    assert not [message for message in sent if getattr(message, "command", 0) == 400]


def test_nothing_is_armed_without_an_order_to_arm() -> None:
    flight = fly([order(20.0, "hold"), order(26.0, "resume"), order(34.0, "return")], 60.0)
    for vehicle in (1, 2, 3, 4):
        for message in flight.messages_to(vehicle, 0.0, 60.0):
            assert getattr(message, "command", 0) != 400


def test_an_order_for_an_unknown_vehicle_is_refused_with_the_known_ones() -> None:
    flight = fly([order(10.0, "hold", 9)], 12.0)
    (answer,) = flight.all(OrderAnswer)
    assert (answer.state, answer.vehicle, answer.waiting) == ("refused", 9, ())
    assert "1, 2, 3, 4" in answer.detail


def test_the_newest_order_counts() -> None:
    flight = fly([order(20.0, "return", 1), order(20.05, "hold", 1)], 30.0)
    assert flight.answers("return-20.0") == [("accepted", None), ("failed", 1)]
    assert flight.answers("hold-20.05") == [("accepted", None), ("done", 1)]
    assert flight.mode(1) is Mode.LOITER


def test_a_recorded_order_gives_the_same_effects_again() -> None:
    from gcs.core.engine import Engine

    flight = fly([order(20.0, "hold", 1), order(26.0, "resume", 1), order(30.0, "return", 3)], 40.0)
    events = [decode("recording", encode(event), type(event)) for event in flight.events]
    engine = Engine(flight.run.scenario.config, SEED)
    again = [encode(effect) for event in events for effect in engine.step(event)]
    assert again == [encode(effect) for _, effect in flight.effects]
    assert any(isinstance(event, Order) for event in events)


@pytest.mark.parametrize("action", ["hold", "return"])
def test_a_vehicle_that_does_not_answer_stays_set_aside(action: str) -> None:
    flight = flown(load("prescribed"), 20.0)
    flight.run.kills[1] = 20.9
    flight.run.order(order(21.0, action, 1))
    flight.run.run(65.0)
    assert flight.answers(f"{action}-21.0") == [("accepted", None), ("failed", 1)]
    assert suspensions(flight.run.engine) == {1: action}


def test_an_order_for_the_plan_names_vehicles_without_a_plan_and_the_remedy() -> None:
    flight = ordered(load("prescribed"), [order(20.0, "hold", 3), order(30.0, "plan")], 24.0)
    vehicles = flight.run.vehicles
    vehicles["vehicle:1"].autopilot.set_mode(Mode.RTL)
    vehicles["vehicle:3"].autopilot.set_mode(Mode.FBWA)  # its pilot takes it from our hold
    flight.run.run(31.0)
    answers = [a for a in flight.all(OrderAnswer) if a.order_id == "plan-30.0"]
    assert [(a.state, a.detail) for a in answers] == [
        ("accepted", "not ours: 1 in RTL: gcs order resume 1; 3 in FBWA: the pilot gives it back"),
        ("refused", "no plan waits"),
    ]
    assert [bool(a.waiting) for a in answers] == [True, False]
    warned = {notice.vehicle for notice in noticed(flight.all(Notice), NoticeCode.OVERRIDDEN)}
    assert warned == {1, 3}


def returned(step_m: float = 20.0, **altitudes_m: float) -> tuple[str, list[Notice]]:
    """Return agents 1 and 3, with these return heights; give the answer and the warnings.

    Those of the others are a layer apart from all.
    """
    scenario = load("prescribed")
    table = changed(scenario.config.mission, layer_step_m=step_m)
    scenario = replace(scenario, config=changed(scenario.config, mission=table))
    effects: list[tuple[int, Effect]] = []
    run = VirtualRun(
        scenario, SEED, None, lambda t, e: effects.append((t, e)), orders=[order(20.0, "return", 1, 3)]
    )
    for vehicle in run.vehicles.values():
        height_m = altitudes_m.get(f"of_{vehicle.system_id}", 200.0 + 30.0 * vehicle.system_id)
        vehicle.autopilot.parameters.store("RTL_ALTITUDE", height_m)
    run.run(21.0)
    flight = Flight(run, [], effects)
    accepted = next(a.detail for a in flight.all(OrderAnswer) if a.state == "accepted")
    return accepted, noticed(flight.all(Notice), NoticeCode.RETURN_ORDER_NEAR, NoticeCode.RETURNS_NEAR)


def test_vehicles_that_are_sent_home_together_at_one_height_are_named() -> None:
    detail, warnings = returned(of_1=100.0, of_3=110.0)
    remark = (
        "agents 1 at 100 m (RTL_ALTITUDE), 3 at 110 m (RTL_ALTITUDE) return less than 20 m apart in height: "
        "hold one until the other is down, or watch them"
    )
    assert detail == f"agents 1, 3; {remark}"
    assert remark in [
        notice.parameters["warning"] for notice in noticed(warnings, NoticeCode.RETURN_ORDER_NEAR)
    ]


def test_vehicles_that_a_failsafe_would_bring_to_one_height_are_named_without_a_preflight() -> None:
    _, (in_flight, *_) = returned(of_1=100.0, of_3=110.0)
    assert in_flight.code is NoticeCode.RETURNS_NEAR
    heights = (
        "agents 1 at 100 m (RTL_ALTITUDE), 3 at 110 m (RTL_ALTITUDE) return less than 20 m apart in height"
    )
    assert in_flight.parameters["heights"] == heights


@pytest.mark.parametrize(
    "known",
    [{}, {"of_1": 100.0}, {"of_1": 100.0, "of_3": 120.0}, {"step_m": 0.0, "of_1": 100.0, "of_3": 100.0}],
)
def test_return_heights_that_are_apart_get_no_notice(known: dict[str, float]) -> None:
    assert returned(**known) == ("agents 1, 3", [])


def test_a_parameter_that_passes_the_service_is_heard() -> None:
    """`gcs preflight` asks through the service that flies the mission."""
    run = flown(load("prescribed"), 5.0).run
    plane = run.vehicles["vehicle:1"]
    asked = dialect.MAVLink_param_request_read_message(1, 1, b"RTL_ALTITUDE", -1)
    plane.receive_datagram(Encoder(254, 190)(asked), run.t_ns)
    run.run(6.0)
    assert run.engine.state.agents[1].returns.parameters["RTL_ALTITUDE"] == 100.0


def test_a_vehicle_that_is_resumed_from_its_return_gets_the_layer_of_its_new_plan() -> None:
    flight = fly([order(20.0, "return", 1), order(40.0, "resume", 1)], 60.0)
    (*_, route) = [
        route
        for plan in flight.all(Plan)
        for route in plan.routes
        if route.vehicle == 1 and plan.t_ns > START_T_NS + 40 * S
    ]
    mission = flight.run.scenario.config.mission
    sent = flight.messages_to(1, 40.0, 60.0)
    heights_m = {m.z for m in sent if m.get_type() == "MISSION_ITEM_INT" and m.seq > 0}
    assert heights_m == {mission.altitude_rel_m + route.layer * mission.layer_step_m}
