"""An operator who confirms plans himself would lose trust if anything flew that he has not seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import pytest
from helpers.approved_flight import SEED, Flight, after, scenario, silent, word
from helpers.staging import S, suspensions
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.core.engine import Engine
from gcs.core.snapshot import decode_state, encode_state
from gcs.core.state import flown_routes
from gcs.io.record_json import decode, encode
from gcs.mavlink.frames.codec import decode as decode_frames
from gcs.model import (
    AgentStatus,
    Effect,
    Event,
    MissionEnded,
    NoFlyZone,
    Notice,
    NoticeCode,
    Order,
    OrderAnswer,
    Plan,
    Proposal,
    Send,
    Tick,
    UploadReport,
)
from gcs.planning.map.line_of_sight import line_of_sight
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun


def test_without_a_word_nothing_is_ever_uploaded_the_first_plan_included() -> None:
    flight = Flight(silent).fly(55.0)  # at 57 s a route comes nearer to an obstacle than the one shown
    assert flight.counted() == []
    assert flight.all(Plan) == []
    proposals = flight.all(Proposal)
    assert {route.vehicle for route in proposals[0].routes} == {1, 2, 3, 4}
    ids = [proposal.plan_id for proposal in proposals]
    assert set(ids) == {1}  # who flies where is still good: the number stays, the routes are kept up to date
    assert proposals[-1].figures[0].length_m != proposals[0].figures[0].length_m


def test_a_mission_with_every_plan_confirmed_ends_as_it_should() -> None:
    flight = Flight(after(2.0)).fly(400.0)
    (ended,) = flight.all(MissionEnded)
    assert (ended.arrived, ended.lost) == ((1, 3, 4), (2,))
    assert all("confirmed" in plan.reason and plan.causes for plan in flight.all(Plan))
    done = [a for a in flight.all(OrderAnswer) if a.state == "done"]
    assert len(done) == sum(report.ok for report in flight.all(UploadReport))


def test_vehicles_are_confirmed_one_by_one_and_only_they_are_tasked() -> None:
    def operator(t_ns: int, effect: Effect) -> Order | None:
        first = isinstance(effect, Proposal) and effect.plan_id == 1 and len(effect.routes) == 4
        return word(t_ns + S, "confirm", 1, 2, 3) if first else None

    flight = Flight(operator).fly(12.0)
    assert {vehicle for _, vehicle in flight.counted()} == {2, 3}
    (plan,) = flight.all(Plan)
    assert plan.changed == (2, 3)
    assert [route.vehicle for route in flight.all(Proposal)[1].routes] == [1, 4]


def test_a_plan_that_is_no_longer_shown_cannot_be_confirmed() -> None:
    def operator(t_ns: int, effect: Effect) -> Order | None:
        is_new = isinstance(effect, Proposal) and effect.t_ns == effect.shown_t_ns
        return word(t_ns, "confirm", 1) if is_new else None

    flight = Flight(operator).fly(60.0)
    second = next(p for p in flight.all(Proposal) if p.plan_id == 2)
    (answer,) = [a for a in flight.all(OrderAnswer) if a.t_ns == second.t_ns]
    assert answer.state == "refused"
    assert answer.detail == f"that plan is no longer the one shown: plan 2 is ({second.reason})"
    assert not [t_ns for t_ns, _ in flight.counted() if t_ns >= second.t_ns]


def test_what_was_rejected_is_not_proposed_again_before_something_changes() -> None:
    flight = Flight(after(1.0, "reject")).fly(16.0)
    first, none = flight.all(Proposal)
    assert (len(first.routes), none.routes) == (4, ())
    assert flight.counted() == []
    later = Flight(after(1.0, "reject")).fly(60.0).all(Proposal)
    assert len(later) > 2
    assert all(p.reason for p in later[2:] if p.routes)


def test_a_confirm_with_nothing_to_confirm_is_refused() -> None:
    for retask in ("auto", "confirm"):
        run = VirtualRun(scenario(retask), SEED)
        effects = run.engine.step(word(START_T_NS, "confirm", 1))
        assert [(e.state, e.detail) for e in effects] == [("refused", "no plan waits")]


ACTIONS = st.tuples(
    st.sampled_from(["hold", "resume", "return", "confirm", "confirm", "reject", "no-fly-zone"]),
    st.sets(st.integers(1, 5)),
    st.integers(1, 6),
    st.floats(1.0, 40.0),
)


@settings(max_examples=4)
@given(given_orders=st.lists(ACTIONS, max_size=10))
def test_under_any_orders_only_confirmed_routes_are_uploaded_and_no_held_agent_is_tasked(
    given_orders,
) -> None:
    orders = []
    for index, (action, vehicles, plan_id, at_s) in enumerate(sorted(given_orders, key=lambda one: one[3])):
        area = NoFlyZone(f"a{plan_id}", (900.0, 150.0 * plan_id, 60.0)) if action == "no-fly-zone" else None
        t_ns = START_T_NS + round(at_s * S)
        orders.append(Order(t_ns, str(index), action, tuple(sorted(vehicles)) or None, plan_id, area))
    events: list[Event] = []
    effects: list[tuple[int, Effect]] = []
    run = VirtualRun(scenario(), SEED, events.append, lambda t, e: effects.append((t, e)), orders=orders)
    run.run(45.0)
    engine, allowed, again = Engine(run.scenario.config, SEED), set(), []
    for number, event in enumerate(events):
        if number % 97 == 0:
            engine = Engine(run.scenario.config, SEED, decode_state("test", encode_state(engine.state)))
        aside = set(suspensions(engine))
        step = engine.step(decode("recording", encode(event), type(event)))
        again += [encode(effect) for effect in step]
        for effect in step:
            if isinstance(effect, Plan):
                allowed |= set(effect.changed)
            if isinstance(effect, Send):
                for message in decode_frames(effect.data)[0]:
                    if message.get_type() == "MISSION_COUNT":
                        assert message.target_system in allowed
                        assert message.target_system not in aside
    assert again == [encode(effect) for _, effect in effects]  # replayed, also from snapshots


# ---------------------------------------------------------------- keep-outs


def closing(at_s: float, area: NoFlyZone) -> Callable[[int, Effect], Order | None]:
    given_once: list[Order] = []

    def operator(t_ns: int, effect: Effect) -> Order | None:
        if not given_once and t_ns >= START_T_NS + at_s * S:
            given_once.append(Order(t_ns, "close", "no-fly-zone", None, None, area))
            return given_once[0]
        return None

    return operator


CORRIDOR = NoFlyZone("fire", None, ((650.0, 420.0), (760.0, 420.0), (700.0, 660.0)))


def test_a_no_fly_zone_changes_the_plan_at_once_and_no_route_crosses_it() -> None:
    free = Flight(silent, "auto").fly(30.0).run.engine
    flight = Flight(closing(20.0, CORRIDOR), "auto").fly(30.0)
    engine = flight.run.engine
    closed = engine.grid.blocked & ~free.grid.blocked
    assert closed.sum() > 10
    plan = next(p for p in flight.all(Plan) if "no-fly zone fire closed" in p.reason)
    assert plan.t_ns - START_T_NS < 20.2 * S
    (answer,) = flight.all(OrderAnswer)
    assert answer.state == "done"
    for route in plan.routes:
        if route.vehicle in plan.changed:
            points = [tuple(map(float, point)) for point in route.points_m]
            only = replace(engine.grid, blocked=closed)
            assert all(line_of_sight(only, a, b) for a, b in pairwise(points))
    through = [r for r in flown_routes(free.state.agents).values() if r.vehicle in plan.changed]
    assert through


def test_a_no_fly_zone_is_opened_by_its_name_and_an_unknown_one_is_refused() -> None:
    run = VirtualRun(scenario("auto"), SEED)
    before = run.engine.grid.blocked
    order = Order(START_T_NS, "1", "no-fly-zone", None, None, CORRIDOR)
    run.engine.step(order)
    assert (run.engine.grid.blocked & ~before).any()
    run.engine.step(replace(order, no_fly_zone=NoFlyZone("fire")))
    assert (run.engine.grid.blocked == before).all()
    (answer,) = run.engine.step(replace(order, no_fly_zone=NoFlyZone("fire")))
    assert (answer.state, answer.detail) == ("refused", "no no-fly zone is called fire; there are: none")
    (answer,) = run.engine.step(replace(order, no_fly_zone=NoFlyZone("far", (9e5, 0.0, 10.0))))
    assert (answer.state, answer.detail) == ("refused", "it lies outside the map")


def test_a_no_fly_zone_without_a_route_around_is_reported_and_no_mission_changes() -> None:
    wall = NoFlyZone("wall", None, ((800.0, -50.0), (860.0, -50.0), (860.0, 2050.0), (800.0, 2050.0)))
    flight = Flight(closing(20.0, wall), "auto").fly(60.0)
    alarms = [n for n in flight.all(Notice) if n.level == "alarm"]
    first = [n for n in alarms if n.t_ns <= START_T_NS + 21 * S]
    (answer,) = [a for a in flight.all(OrderAnswer) if a.action == "no-fly-zone"]
    for notice in first:
        assert notice.code is NoticeCode.ZONE_AHEAD
        assert notice.parameters["zone"] == "wall"
        assert f"agent {notice.vehicle} " in answer.detail
        assert notice.parameters["remedy"] in answer.detail
    vehicles = {n.vehicle for n in first}
    assert vehicles
    soon = {n.vehicle: n for n in alarms if n not in first and n.code is NoticeCode.ZONE_AHEAD}
    inside = {n.vehicle: n for n in alarms if n.code is NoticeCode.ZONE_ENTERED}
    assert inside
    for vehicle, notice in inside.items():
        warning = soon.get(vehicle) or next(n for n in first if n.vehicle == vehicle)
        assert (notice.t_ns - warning.t_ns) / S == pytest.approx(warning.parameters["after_s"], abs=4.0)
        assert sum(n.vehicle == vehicle for n in alarms if n.code is NoticeCode.ZONE_ENTERED) == 1
        later = [plan for plan in flight.all(Plan) if warning.t_ns < plan.t_ns < notice.t_ns]
        assert not any(vehicle in plan.changed for plan in later)


@pytest.mark.parametrize("loss_of", [2])
def test_who_is_lost_is_taken_out_of_the_plan_that_waits(loss_of: int) -> None:
    flight = Flight(silent).fly(70.0)
    (death,) = [status for status in flight.all(AgentStatus) if status.status == "lost"]
    assert death.vehicle == loss_of
    last = [proposal for proposal in flight.all(Proposal) if proposal.t_ns >= death.t_ns]
    assert last
    assert all(route.vehicle != loss_of for proposal in last for route in proposal.routes)


def test_time_alone_brings_no_new_plan() -> None:
    flight = Flight(silent).fly(12.0)
    assert [p.plan_id for p in flight.all(Proposal)] == [1, 1, 1]
    assert sum(isinstance(event, Tick) for event in flight.events) > 200
