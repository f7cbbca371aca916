"""An operator confirms a plan that holds still, and has it flown from where the vehicles are by then."""

from __future__ import annotations

import math
import random
import re
from itertools import pairwise

import numpy as np
import pytest
from helpers.approved_flight import Flight, after, silent
from helpers.staging import S, at, mission, track, zones

from gcs.core.operator.plan_approval import MIN_READING_S, PlanApproval
from gcs.core.replanning.inputs import PlanningInputs
from gcs.core.replanning.replanner import Replanner
from gcs.core.state import State, flown_routes
from gcs.model import Action, Effect, Label, MissionEnded, Order, OrderAnswer, Plan, Proposal, Route
from sim_vehicles.campaign.virtual_run import START_T_NS

A, B = (0, 0), (0, 1)
CONFIRM = '[planning]\nretask = "confirm"\n'
Place = tuple[float, float]


class Stage:
    """Two agents in the west, two targets in the east, and an operator's desk."""

    def __init__(self, tables: str = CONFIRM, agents: dict[int, Place] | None = None) -> None:
        self.agents = agents or {1: (100.0, 200.0), 2: (100.0, 800.0)}
        self.targets: dict[Label, Place] = {A: (1500.0, 200.0), B: (1500.0, 800.0)}
        config = mission(list(self.agents.values()), list(self.targets.values()), tables)
        airspace = zones(config)
        self.state = State.initial(self.agents)
        agents = self.state.agents
        self.replanner = Replanner(config, airspace, agents, self.state.replanning)
        self.approval = PlanApproval(config, airspace, self.replanner, agents, self.state.operator)
        self.shown: list[Proposal] = []

    def inputs(self, t_s: float) -> PlanningInputs:
        agents = {v: track((0, v), place, (15.0, 0.0)) for v, place in sorted(self.agents.items())}
        targets = {label: track(label, place) for label, place in sorted(self.targets.items())}
        return PlanningInputs(at(t_s), at(t_s), agents, targets, frozenset())

    def check(self, t_s: float) -> Proposal | None:
        """Check as at a scan; return the pending plan."""
        if self.replanner.is_due(at(t_s)):
            self._keep(self.approval.check(self.inputs(t_s)))
        return self.pending

    @property
    def pending(self) -> Proposal | None:
        return self.state.operator.approval.pending

    def confirm(self, t_s: float, plan_id: int) -> tuple[OrderAnswer, list[Route]]:
        order = Order(at(t_s), f"confirm-{t_s}", "confirm", None, plan_id)
        effects, routes = self.approval.decide(order, self.inputs(t_s))
        self._keep(effects)
        answers = [e for e in effects if isinstance(e, OrderAnswer) and e.order_id == order.order_id]
        return answers[0], routes

    def _keep(self, effects: list[Effect]) -> None:
        self.shown += [e for e in effects if isinstance(e, Proposal)]

    @property
    def numbers(self) -> dict[int, float]:
        """Every number, and when it was first shown, in seconds."""
        return {p.plan_id: (p.shown_t_ns - at(0.0)) / S for p in self.shown}


# ---------------------------------------------------------------- flown from where the vehicle is


def test_a_mission_confirmed_13_s_late_is_flown_from_where_the_vehicles_are() -> None:
    places: dict[int, dict[int, Place]] = {}

    class Watched(Flight):
        def _effect(self, t_ns: int, effect: Effect) -> None:
            if isinstance(effect, Plan):
                places[t_ns] = {v.system_id: (v.east_m, v.north_m) for v in self.run.vehicles.values()}
            super()._effect(t_ns, effect)

    flight = Watched(after(13.0)).fly(300.0)
    plans = flight.all(Plan)
    assert len(plans) > 3
    for plan in plans:
        for route in plan.routes:
            if route.vehicle in plan.changed:
                way_m = [places[plan.t_ns][route.vehicle], *route.points_m.tolist()]
                # Planned from where the vehicle is when the mission arrives, a second later.
                assert sum(math.dist(a, b) for a, b in pairwise(way_m)) < route.length_m + 45.0
                assert route.length_m < sum(math.dist(a, b) for a, b in pairwise(way_m)) + 45.0
    assert not any("would hit an obstacle" in plan.reason for plan in plans)
    (ended,) = flight.all(MissionEnded)
    assert ended.arrived == (1, 3, 4)
    assert ended.t_ns - START_T_NS < 200 * S  # with every detour flown it took 242 s


def test_an_agent_that_flew_on_before_its_plan_was_confirmed_does_not_turn_back() -> None:
    stage = Stage(CONFIRM + 'shape = "flyable"\n')
    first = stage.check(0.0)
    assert first is not None
    stage.agents = {1: (295.0, 200.0), 2: (295.0, 800.0)}  # 13 s on
    answer, routes = stage.confirm(13.0, first.plan_id)
    assert answer.state == "accepted"
    for route in routes:
        assert (np.diff([295.0, *route.points_m[:, 0]]) > 0.0).all()
        assert route.length_m == pytest.approx(1205.0, abs=40.0)
    assert {r.vehicle: r.target for r in routes} == {r.vehicle: r.target for r in first.routes}


def test_the_targets_confirmed_are_kept_though_others_would_be_nearer_by_now() -> None:
    stage = Stage(agents={1: (100.0, 450.0), 2: (100.0, 550.0)})
    first = stage.check(0.0)
    assert first is not None
    assert {r.vehicle: r.target for r in first.routes} == {1: A, 2: B}
    stage.agents = {1: (200.0, 520.0), 2: (200.0, 480.0)}
    answer, routes = stage.confirm(13.0, 1)
    assert answer.state == "accepted"
    assert {r.vehicle: r.target for r in routes} == {1: A, 2: B}


# ---------------------------------------------------------------- control changes while a plan waits


def held_and_resumed() -> Flight:
    """Return a flight in which 3 is held, and is resumed while a plan without it waits."""
    orders = {"first": 0, "held": 0, "resumed": 0}

    def order(t_ns: int, action: Action, plan_id: int | None = None) -> Order:
        vehicles = (3,) if plan_id is None else None
        return Order(t_ns, f"{action}-{t_ns}", action, vehicles, plan_id)

    def operator(t_ns: int, effect: Effect) -> Order | None:
        if isinstance(effect, Proposal) and effect.routes and not orders["first"]:
            orders["first"] = t_ns
            return order(t_ns + S, "confirm", effect.plan_id)
        if orders["first"] and not orders["held"] and t_ns > orders["first"] + 10 * S:
            orders["held"] = t_ns
            return order(t_ns, "hold")
        if orders["held"] and not orders["resumed"] and isinstance(effect, Proposal):
            vehicles = {route.vehicle for route in effect.routes}
            if effect.t_ns > orders["held"] and vehicles and 3 not in vehicles:
                orders["resumed"] = t_ns
                flight.run.order(order(t_ns + 2 * S, "resume"))
                return order(t_ns + 2 * S + round(0.05 * S), "confirm", effect.plan_id)
        return None

    flight = Flight(operator)
    return flight.fly(45.0)


def test_a_plan_made_without_a_vehicle_cannot_be_confirmed_once_it_is_resumed() -> None:
    flight = held_and_resumed()
    stale = [a for a in flight.all(OrderAnswer) if a.action == "confirm"][-1]
    assert stale.state == "refused"
    (resumed,) = [a for a in flight.all(OrderAnswer) if (a.action, a.state) == ("resume", "accepted")]
    after_resume = [p for p in flight.all(Proposal) if p.t_ns >= resumed.t_ns]
    assert after_resume[0].t_ns == resumed.t_ns  # at once, not at the next check
    targets = [route.target for route in flown_routes(flight.run.engine.state.agents).values()]
    assert len(targets) == len(set(targets))
    assert 3 in flown_routes(flight.run.engine.state.agents)  # it does not fly to nothing


def test_a_vehicle_held_while_a_plan_waits_leaves_it_and_the_others_are_planned_again_at_once() -> None:
    def operator(_t_ns: int, effect: Effect) -> Order | None:
        is_first = isinstance(effect, Proposal) and effect.plan_id == 1 and effect.t_ns == effect.shown_t_ns
        return Order(effect.t_ns + S, "hold", "hold", (3,)) if is_first else None

    flight = Flight(operator).fly(4.0)
    (held,) = [a for a in flight.all(OrderAnswer) if a.state == "accepted"]
    renewed = next(p for p in flight.all(Proposal) if p.plan_id == 2)
    assert renewed.t_ns == held.t_ns
    assert 3 not in {route.vehicle for route in renewed.routes}
    assert "agent 3 is held by order" in renewed.reason


# ---------------------------------------------------------------- refused when it became another plan


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda s: s.agents.update({1: (100.0, 1800.0)}),
            r"the route of agent 1 is 7\d\d m longer than shown",
        ),
        (lambda s: s.targets.pop(A), r"target T0\.0 is not there any more"),
        (lambda s: s.agents.pop(2), "agent 2 is not seen by any sensor now"),
    ],
)
def test_a_plan_that_became_another_one_is_refused_and_proposed_again(change, words: str) -> None:
    stage = Stage()
    assert stage.check(0.0) is not None
    change(stage)
    answer, routes = stage.confirm(4.0, 1)
    assert (answer.state, routes) == ("refused", [])
    assert re.search(words, answer.detail)
    assert answer.detail.endswith("plan 2 waits instead")
    pending = stage.pending
    assert pending is not None
    assert pending.plan_id == 2
    assert re.search(words, pending.reason)
    assert flown_routes(stage.state.agents) == {}
    again, flown = stage.confirm(8.0, 2)
    assert again.state == "accepted"
    assert flown


def test_less_separation_than_shown_is_another_plan() -> None:
    tables = CONFIRM + "[mission]\nlayers = 1\n"
    stage = Stage(tables, {1: (100.0, 200.0), 2: (100.0, 800.0)})
    first = stage.check(0.0)
    assert first is not None
    assert [one.separation_m for one in first.figures] == pytest.approx([600.0, 600.0], abs=1.0)
    stage.agents = {1: (300.0, 790.0), 2: (300.0, 800.0)}
    answer, _ = stage.confirm(13.0, 1)
    assert answer.state == "refused"
    assert "would come within 10 m of another at its altitude" in answer.detail


def test_an_agent_about_to_reach_its_target_is_left_alone_though_a_plan_for_it_is_confirmed() -> None:
    stage = Stage()
    stage.check(0.0)
    stage.confirm(1.0, 1)
    flown = flown_routes(stage.state.agents)
    stage.targets[A], stage.targets[B] = (1500.0, 290.0), (1500.0, 890.0)
    stage.agents = {1: (900.0, 200.0), 2: (900.0, 800.0)}
    pending = stage.check(25.0)
    assert pending is not None
    assert [route.vehicle for route in pending.routes] == [1, 2]
    stage.targets[A], stage.agents[1] = (1500.0, 200.0), (1465.0, 200.0)
    answer, routes = stage.confirm(40.0, pending.plan_id)
    assert answer.state == "accepted"
    assert [route.vehicle for route in routes] == [2]
    assert stage.state.agents[1].routes.flown is flown[1]


# ---------------------------------------------------------------- stable


def test_a_plan_keeps_its_number_while_targets_jitter_and_routes_are_kept_up_to_date() -> None:
    stage, rng = Stage(), random.Random(1)
    for t_s in range(261):
        stage.targets = {
            A: (1500.0 + rng.gauss(0.0, 40.0), 200.0 + rng.gauss(0.0, 40.0)),
            B: (1500.0 + rng.gauss(0.0, 40.0), 800.0 + rng.gauss(0.0, 40.0)),
        }
        stage.agents = {1: (100.0 + 4.0 * t_s, 200.0), 2: (100.0 + 4.0 * t_s, 800.0)}
        stage.check(float(t_s))
    assert stage.numbers == {1: 0.0}
    pending = stage.pending
    assert pending is not None
    assert pending.age_s >= 255.0
    for figures in pending.figures:
        assert figures.length_m == pytest.approx(380.0, abs=120.0)
        assert figures.shown_length_m == pytest.approx(1400.0, abs=120.0)
        assert figures.arrival_s == pytest.approx(figures.length_m / 15.0, rel=0.5)


def test_no_number_comes_before_the_last_one_could_be_read_whatever_comes_and_goes() -> None:
    stage, rng = Stage('[planning]\nretask = "confirm"\nwhen = "events"\n'), random.Random(2)
    for t_s in range(261):
        everything: dict[Label, Place] = {
            (t_s // 7, k): (1500.0 + rng.gauss(0.0, 60.0), 200.0 + 300.0 * k) for k in range(3)
        }
        stage.targets = {label: place for label, place in everything.items() if rng.random() > 0.2}
        stage.check(float(t_s))
    shown_s = sorted(stage.numbers.values())
    assert 3 < len(shown_s) <= 260 / MIN_READING_S + 1
    assert min(b - a for a, b in pairwise(shown_s)) >= MIN_READING_S


def test_what_cannot_wait_gets_a_number_at_once() -> None:
    stage = Stage(agents={1: (100.0, 200.0), 2: (100.0, 800.0), 3: (100.0, 500.0)})
    first = stage.check(0.0)
    assert first is not None
    flown = {route.vehicle for route in first.routes}
    lost = min(flown)
    del stage.agents[lost]
    stage.state.agents[lost].routes.drop()
    stage.approval.hurry()
    stage.check(5.0)
    assert stage.numbers == {1: 0.0, 2: 5.0}


def test_in_a_flight_without_confirmations_proposals_are_few_and_far_between() -> None:
    flight = Flight(silent).fly(260.0)
    shown = {p.plan_id: p.shown_t_ns for p in flight.all(Proposal)}
    assert len(shown) <= 4
    times = [t_ns for _, t_ns in sorted(shown.items())]
    assert all(b - a >= MIN_READING_S * S for a, b in pairwise(times))


def test_who_asks_gets_the_plan_that_waits_with_its_age() -> None:
    stage = Stage()
    stage.check(0.0)
    (answer,) = stage.approval.answer(Order(at(3.0), "plan-1", "plan", None))
    assert isinstance(answer, OrderAnswer)
    assert answer.proposal is not None
    assert (answer.state, answer.proposal.plan_id, answer.proposal.age_s) == ("done", 1, 3.0)
    stage.confirm(4.0, 1)
    (none,) = stage.approval.answer(Order(at(5.0), "plan-2", "plan", None))
    assert isinstance(none, OrderAnswer)
    assert (none.state, none.detail, none.proposal) == ("refused", "no plan waits", None)
