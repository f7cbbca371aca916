"""After the end of a mission an operator could not fly on without a restart of the service."""

from __future__ import annotations

import math

import pytest
from helpers.noticed import noticed
from helpers.ordered_flight import Flight, fly, order
from helpers.staging import S

from gcs.core.state import at_targets
from gcs.model import AgentStatus, MissionEnded, NoFlyZone, Notice, NoticeCode, OrderAnswer, Plan
from gcs.report.operator_lines import effect_notice
from sim_vehicles.campaign.virtual_run import START_T_NS


@pytest.fixture
def ended() -> Flight:
    """A mission that has ended: 1, 3 and 4 arrived, 2 is lost, and two targets have no agent."""
    flight = fly([], 400.0)
    assert flight.run.ended
    flight.effects.clear()
    flight.run.ended = False
    return flight


def now_s(flight: Flight) -> float:
    return (flight.run.t_ns - START_T_NS) / S


def test_targets_without_an_agent_at_the_end_are_named_with_the_order_that_sends_one(ended: Flight) -> None:
    ended.run.run(now_s(ended) + 3.0)
    (notice,) = noticed(ended.all(Notice), NoticeCode.TARGETS_UNATTENDED)
    assert notice.parameters["targets"] == "targets T0.0, T0.3"


def test_a_mission_that_has_ended_goes_on_by_order_until_the_other_targets_are_reached(
    ended: Flight,
) -> None:
    before = set(at_targets(ended.run.engine.state.agents))
    ended.run.order(order(now_s(ended) + 2.0, "continue"))
    ended.run.run(now_s(ended) + 60.0)
    (answer,) = ended.all(OrderAnswer)
    assert answer.state == "done"
    assert answer.detail == "the mission continues with targets T0.0, T0.3; agents 1, 3, 4 free for them"
    (begin,) = noticed(ended.all(Notice), NoticeCode.TARGETS_UNATTENDED)
    (end,) = noticed(ended.all(Notice), NoticeCode.TARGETS_ATTENDED)
    assert (begin.t_ns < end.t_ns, end.ended) == (True, (begin.key,))
    reached = {status.target for status in ended.all(AgentStatus) if status.status == "arrived"}
    assert reached == {(0, 0), (0, 3)}
    assert set(at_targets(ended.run.engine.state.agents)) == before | reached
    (second,) = ended.all(MissionEnded)
    assert len(second.arrived) == 2
    assert not noticed(ended.all(Notice), NoticeCode.ROUTE_ENDED_SHORT), "it had reached its target"
    left = [one for effect in ended.all(AgentStatus) if (one := effect_notice(effect)) is not None]
    assert (NoticeCode.TARGET_LEFT, 1, "T0.2") in [(n.code, n.vehicle, n.parameters["target"]) for n in left]


def test_only_the_agents_that_the_order_names_leave_their_targets(ended: Flight) -> None:
    ended.run.order(order(now_s(ended) + 2.0, "continue", 4))
    ended.run.run(now_s(ended) + 4.0)
    assert {vehicle for plan in ended.all(Plan) for vehicle in plan.changed} == {4}


def test_an_order_that_frees_no_agent_is_refused(ended: Flight) -> None:
    ended.run.order(order(now_s(ended) + 2.0, "continue", 2))
    ended.run.run(now_s(ended) + 3.0)
    (answer,) = ended.all(OrderAnswer)
    assert (answer.state, answer.detail) == ("refused", "agent 2 not at a target, and no agent is active")


def test_a_mission_that_goes_on_is_not_continued() -> None:
    (answer,) = fly([order(20.0, "continue")], 21.0).all(OrderAnswer)
    assert (answer.state, answer.detail) == ("refused", "the mission has not ended")


def test_an_agent_that_circles_at_its_target_is_led_out_of_a_new_zone(ended: Flight) -> None:
    vehicle = ended.run.vehicles["vehicle:3"]
    centre_m, radius_m = (vehicle.east_m, vehicle.north_m), 150.0
    zone = NoFlyZone("fire", (*centre_m, radius_m))
    ended.run.order(order(now_s(ended) + 2.0, "no-fly-zone", no_fly_zone=zone))
    ended.run.run(now_s(ended) + 15.0)
    (answer,) = ended.all(OrderAnswer)
    assert answer.detail == "fire closed; agent 3 led around it; the mission continues"
    for _ in range(20):
        assert math.dist((vehicle.east_m, vehicle.north_m), centre_m) > radius_m
        ended.run.run(now_s(ended) + 1.0)
