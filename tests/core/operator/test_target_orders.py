"""An operator who knows better than the tracker or the planner could not say so."""

from __future__ import annotations

import pytest
from helpers.ordered_flight import Flight, fly, order
from helpers.staging import S

from gcs.model import Label, OrderAnswer, Plan, SwarmStatus
from sim_vehicles.campaign.virtual_run import START_T_NS


def plan_after(flight: Flight, at_s: float) -> dict[int, Label]:
    """Return the targets of vehicles by the first plan from a time on."""
    plans = [plan for plan in flight.all(Plan) if plan.t_ns >= START_T_NS + at_s * S]
    return {route.vehicle: route.target for route in plans[0].routes}


def test_an_ignored_target_gets_no_agent_until_it_is_attended_to() -> None:
    before = plan_after(fly([], 12.0), 0.0)
    label = before[3]
    orders = [order(12.0, "ignore", target=label), order(30.0, "attend", target=label)]
    flight = fly(orders, 40.0)
    ignoring = [plan for plan in flight.all(Plan) if 12 * S <= plan.t_ns - START_T_NS < 30 * S]
    assert ignoring[0].causes[0] == "operator order"
    assert "target lost" not in ignoring[0].causes
    assert all(route.target != label for plan in ignoring for route in plan.routes)
    assert 3 in plan_after(flight, 12.0), "the vehicle gets another target at once"
    assert label in plan_after(flight, 30.0).values() or label in plan_after(fly(orders, 90.0), 31.0).values()
    answers = [a.detail for a in flight.all(OrderAnswer)]
    assert answers == [f"target T0.{label[1]} is ignored", f"target T0.{label[1]} is a target again"]


def test_a_pinned_vehicle_flies_to_its_target_until_it_is_unpinned() -> None:
    before = plan_after(fly([], 12.0), 0.0)
    (left,) = {(0, k) for k in range(5)} - set(before.values())
    farthest = before[1]
    orders = [order(12.0, "pin", 4, target=farthest), order(40.0, "unpin", 4)]
    flight = fly(orders, 60.0)
    pinned = [plan for plan in flight.all(Plan) if 12 * S <= plan.t_ns - START_T_NS < 40 * S]
    assert pinned
    for plan in pinned:
        targets = {route.vehicle: route.target for route in plan.routes}
        assert targets[4] == farthest
        assert len(set(targets.values())) == len(targets)
    assert plan_after(flight, 12.0)[1] != farthest
    assert [a.state for a in flight.all(OrderAnswer)] == ["done", "done"]
    assert left is not None


def test_targets_of_higher_priority_get_their_agents_first() -> None:
    before = plan_after(fly([], 12.0), 0.0)
    (left,) = {(0, k) for k in range(5)} - set(before.values())
    flight = fly([order(12.0, "priority", target=left, priority=5)], 20.0)
    assert left in plan_after(flight, 12.0).values()
    flight.run.order(order(20.5, "pin", 3, target=left))
    flight.run.order(order(21.0, "status"))
    flight.run.run(22.0)
    (status,) = flight.all(SwarmStatus)
    assert [(one.priority, one.pinned) for one in status.targets if one.label == left] == [(5, (3,))]


def test_an_order_about_a_target_that_is_not_there_is_refused() -> None:
    flight = fly([order(12.0, "ignore", target=(7, 7)), order(13.0, "pin", 2, target=(7, 7))], 15.0)
    for answer in flight.all(OrderAnswer):
        assert answer.state == "refused"
        assert answer.detail.startswith("there is no target T7.7; there are: T0.0, T0.1")


@pytest.mark.parametrize("action", ["pin", "unpin"])
def test_an_order_to_a_vehicle_that_is_not_there_is_refused(action: str) -> None:
    """Before, it ended the service."""
    target = (0, 0) if action == "pin" else None
    (answer,) = fly([order(12.0, action, 99, target=target)], 13.0).all(OrderAnswer)
    assert (answer.state, answer.detail) == (
        "refused",
        "agent 99: no vehicle of this mission; it has 1, 2, 3, 4",
    )


def test_wishes_survive_a_restart() -> None:
    before = plan_after(fly([], 12.0), 0.0)
    flight = fly([order(12.0, "ignore", target=before[3]), order(12.5, "pin", 1, target=before[4])], 20.0)
    flight.run.restart(2.0)
    flight.run.run(30.0)
    assert flight.run.engine.state.operator.is_ignored(before[3])
    assert flight.run.engine.state.agents[1].orders.pinned == before[4]
