"""A verdict can be trusted: a mission counts as complete only when the truth says so too."""

import json
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Kind,
    LaggedPicture,
    MissionEnded,
    Picture,
    Plan,
    Route,
    Track,
    Truth,
    TruthObject,
    UploadReport,
    read_only,
)
from gcs.report.run.evaluation import Evaluator, Summary, summary_json

T0 = 1_767_225_600 * NS_PER_S
RADIUS_M = 40.0
TARGETS = {1: (1000.0, 0.0), 2: (1000.0, 500.0), 3: (1000.0, 1000.0)}


def at(t_s: float) -> int:
    return T0 + round(t_s * NS_PER_S)


def truth(t_s: float, agents: dict[int, tuple[float, float]], dead: Sequence[int] = ()) -> Truth:
    things = [TruthObject("agents", i, *place, i not in dead) for i, place in agents.items()]
    things += [TruthObject("targets", i, *place, True) for i, place in TARGETS.items()]
    return Truth(at(t_s), tuple(things))


def picture(
    t_s: float, kind: Kind, points: Sequence[tuple[float, float]], existence: float = 0.99
) -> Picture:
    tracks = [
        Track((0, n), read_only([*point, 0.0, 0.0]), read_only(np.eye(4)), existence, existence > 0.5)
        for n, point in enumerate(points)
    ]
    return Picture(at(t_s), at(t_s), kind, tuple(tracks), read_only([1.0]))


def plan(t_s: float, vehicles: Sequence[int], changed: Sequence[int], reason: str = "agent 2 lost") -> Plan:
    routes = [Route(v, (0, v), read_only([[1.0, 1.0]]), 1.0) for v in vehicles]
    return Plan(at(t_s), at(t_s), tuple(routes), (), (), reason, tuple(changed))


def summary(evaluator: Evaluator) -> Summary:
    return evaluator.summary(
        scenario="demo", seed=3, duration_s=10.0, scan_ms_p99=1.5, plan_ms_p99=2.5, recording="runs/demo-3"
    )


def a_good_run() -> Evaluator:
    """Agents 1 and 3 reach targets 1 and 3 at about 10 s; agent 2 dies at 4 s and is found out at 6.5 s."""
    evaluator = Evaluator(RADIUS_M, [1, 2, 3])
    for second in range(11):
        east = 100.0 * second
        evaluator.add_truth(
            truth(
                second,
                {1: (east, 10.0), 2: (east, 500.0), 3: (east, 1010.0)},
                dead=[2] if second >= 4 else [],
            )
        )
    evaluator.add_effect(AgentStatus(at(6.5), 2, "lost"))
    evaluator.add_effect(AgentStatus(at(9.7), 1, "arrived", (0, 0)))
    evaluator.add_effect(AgentStatus(at(9.9), 3, "arrived", (0, 7)))
    return evaluator


def ended(evaluator: Evaluator) -> Evaluator:
    evaluator.add_effect(MissionEnded(at(10.0), (1, 3), (2,)))
    return evaluator


def test_a_good_run_is_complete_with_everybody_accounted_for() -> None:
    verdict = summary(ended(a_good_run()))
    assert verdict.outcome == "complete", verdict.reason
    assert verdict.reason == "2 of 3 agents arrived at distinct targets, agent 2 lost"
    assert [(a.system_id, a.status, a.target) for a in verdict.agents] == [
        (1, "arrived", 1),
        (2, "lost", None),
        (3, "arrived", 3),
    ]
    assert (verdict.targets_total, verdict.targets_reached) == (3, 2)
    assert (verdict.losses, verdict.loss_delays_s, verdict.false_losses) == (1, (2.5,), 0)


def test_a_run_that_never_ended_is_incomplete() -> None:
    assert "did not end" in summary(a_good_run()).reason
    evaluator = Evaluator(RADIUS_M, [1, 2])
    evaluator.add_truth(truth(0, {1: (0.0, 0.0), 2: (0.0, 0.0)}))
    verdict = summary(evaluator)
    assert verdict.outcome == "incomplete"
    assert verdict.reason == "the mission did not end: agents 1, 2 still flying"


def test_a_mission_that_ends_with_an_agent_flying_is_incomplete() -> None:
    evaluator = a_good_run()
    evaluator.add_effect(AgentStatus(at(9.95), 2, "active"))
    assert summary(ended(evaluator)).reason == "the mission ended with agent 2 still flying"


def test_a_run_on_a_machine_that_is_too_slow_says_so_instead_of_a_failure_alone() -> None:
    evaluator = Evaluator(RADIUS_M, [1, 2])
    evaluator.add_truth(truth(0.0, {1: (0.0, 0.0), 2: (0.0, 500.0)}))
    evaluator.add_truth(replace(truth(1.0, {1: (0.0, 0.0), 2: (0.0, 500.0)}), late=(2,)))
    evaluator.add_effect(AgentStatus(at(2.0), 2, "lost"))
    reason = summary(evaluator).reason
    assert reason.startswith("this machine is too slow for the simulation: agent 2 fell behind the clock")
    assert "agent 2 called lost but alive" in reason


def test_a_mission_whose_agents_are_all_lost_has_failed() -> None:
    evaluator = Evaluator(RADIUS_M, [1, 2])
    evaluator.add_truth(truth(0.0, {1: (0.0, 0.0), 2: (0.0, 500.0)}))
    evaluator.add_truth(truth(1.0, {1: (0.0, 0.0), 2: (0.0, 500.0)}, dead=[1, 2]))
    for vehicle in (1, 2):
        evaluator.add_effect(AgentStatus(at(2.0), vehicle, "lost"))
    evaluator.add_effect(MissionEnded(at(3.0), (), (1, 2)))
    verdict = summary(evaluator)
    assert (verdict.outcome, verdict.reason) == ("incomplete", "failed: all agents were lost")


def test_without_truth_nothing_is_complete() -> None:
    evaluator = Evaluator(RADIUS_M, [1])
    evaluator.add_effect(AgentStatus(at(1), 1, "arrived", (0, 0)))
    evaluator.add_effect(MissionEnded(at(1), (1,), ()))
    verdict = summary(evaluator)
    assert (verdict.outcome, verdict.reason) == ("incomplete", "there is no ground truth")
    assert math.isnan(verdict.ospa_agents_mean_m)
    assert json.loads(summary_json(verdict))["ospa_agents_mean_m"] is None


@pytest.mark.parametrize(("distance_m", "outcome"), [(64.9, "complete"), (65.1, "incomplete")])
def test_arrival_counts_within_the_capture_radius_and_an_allowance(distance_m: float, outcome: str) -> None:
    evaluator = Evaluator(RADIUS_M, [1])
    for second in (0, 1):
        evaluator.add_truth(truth(second, {1: (1000.0, -distance_m)}))
    evaluator.add_effect(AgentStatus(at(1), 1, "arrived", (0, 0)))
    evaluator.add_effect(MissionEnded(at(1), (1,), ()))
    verdict = summary(evaluator)
    assert verdict.outcome == outcome
    if outcome == "incomplete":
        assert verdict.reason == "agent 1 called arrived 65 m from the nearest target"
        assert (verdict.agents[0].status, verdict.agents[0].target) == ("arrived", None)


def test_the_place_of_arrival_is_the_true_one_between_two_scans() -> None:
    evaluator = Evaluator(RADIUS_M, [1])
    evaluator.add_truth(truth(0, {1: (0.0, 0.0)}))
    evaluator.add_truth(truth(1, {1: (2000.0, 0.0)}))
    evaluator.add_effect(AgentStatus(at(0.5), 1, "arrived", (0, 0)))
    evaluator.add_effect(MissionEnded(at(1), (1,), ()))
    assert summary(evaluator).outcome == "complete"


def test_two_agents_at_one_target_are_not_two_targets_reached() -> None:
    evaluator = Evaluator(RADIUS_M, [1, 2])
    evaluator.add_truth(truth(0, {1: (1000.0, 10.0), 2: (1000.0, -20.0)}))
    for vehicle in (1, 2):
        evaluator.add_effect(AgentStatus(at(0), vehicle, "arrived", (0, vehicle)))
    evaluator.add_effect(MissionEnded(at(0), (1, 2), ()))
    verdict = summary(evaluator)
    assert verdict.reason == "agent 2 called arrived at target 1, where agent 1 had arrived"
    assert verdict.targets_reached == 1


def test_two_agents_at_two_near_targets_have_each_one_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TARGETS, 2, (1000.0, 40.0))
    evaluator = Evaluator(RADIUS_M, [1, 2])
    evaluator.add_truth(truth(0, {1: (1000.0, -10.0), 2: (1000.0, 15.0)}))
    for vehicle in (1, 2):
        evaluator.add_effect(AgentStatus(at(0), vehicle, "arrived", (0, vehicle)))
    evaluator.add_effect(MissionEnded(at(0), (1, 2), ()))
    assert [agent.target for agent in summary(evaluator).agents] == [1, 2]


def test_an_agent_that_was_lost_when_called_arrived_has_not_arrived() -> None:
    evaluator = Evaluator(RADIUS_M, [1])
    evaluator.add_truth(truth(0, {1: (1000.0, 0.0)}, dead=[1]))
    evaluator.add_effect(AgentStatus(at(0), 1, "arrived", (0, 0)))
    evaluator.add_effect(MissionEnded(at(0), (1,), ()))
    assert "agent 1 called arrived but lost" in summary(evaluator).reason


def test_an_agent_that_is_lost_at_its_target_has_arrived() -> None:
    evaluator = a_good_run()
    evaluator.add_truth(truth(11, {1: (1000.0, 10.0), 2: (0.0, 0.0), 3: (1000.0, 1010.0)}, dead=[1, 2]))
    evaluator.add_effect(AgentStatus(at(10.9), 1, "lost"))
    evaluator.add_effect(MissionEnded(at(11), (1, 3), (2,)))
    verdict = summary(evaluator)
    assert verdict.outcome == "complete", verdict.reason
    assert verdict.agents[0].status == "arrived"
    assert verdict.losses == 1


def test_a_false_loss_is_counted_and_fails_the_run() -> None:
    evaluator = Evaluator(RADIUS_M, [1])
    for second in (0, 1, 2):
        evaluator.add_truth(truth(second, {1: (0.0, 0.0)}))
    evaluator.add_effect(AgentStatus(at(1), 1, "lost"))
    evaluator.add_effect(MissionEnded(at(2), (), (1,)))
    verdict = summary(evaluator)
    assert verdict.reason == "agent 1 called lost but alive"
    assert (verdict.false_losses, verdict.losses, verdict.loss_delays_s) == (1, 0, ())


def test_a_false_loss_that_is_taken_back_is_counted_only() -> None:
    evaluator = Evaluator(RADIUS_M, [1])
    for second in (0, 1, 2):
        evaluator.add_truth(truth(second, {1: (1000.0, 0.0)}))
    for status in (
        AgentStatus(at(0.5), 1, "lost"),
        AgentStatus(at(1), 1, "active"),
        AgentStatus(at(1.5), 1, "arrived", (0, 0)),
    ):
        evaluator.add_effect(status)
    evaluator.add_effect(MissionEnded(at(2), (1,), ()))
    verdict = summary(evaluator)
    assert (verdict.outcome, verdict.false_losses) == ("complete", 1)


def test_an_undetected_loss_is_not_a_detection() -> None:
    evaluator = Evaluator(RADIUS_M, [1])
    evaluator.add_truth(truth(0, {1: (0.0, 0.0)}))
    evaluator.add_truth(truth(1, {1: (0.0, 0.0)}, dead=[1]))
    verdict = summary(evaluator)
    assert (verdict.losses, verdict.loss_delays_s) == (1, ())


def test_ospa_compares_confirmed_tracks_with_the_living_at_the_same_scan() -> None:
    evaluator = Evaluator(RADIUS_M, [1, 2])
    evaluator.add_truth(truth(0, {1: (0.0, 0.0), 2: (500.0, 0.0)}))
    evaluator.add_truth(truth(1, {1: (0.0, 0.0), 2: (500.0, 0.0)}, dead=[2]))
    evaluator.add_truth(truth(2, {1: (0.0, 0.0), 2: (500.0, 0.0)}, dead=[2]))
    evaluator.add_effect(picture(0, "agents", [(3.0, 4.0), (500.0, 7.0)]))
    evaluator.add_effect(picture(1, "agents", [(0.0, 0.0), (500.0, 0.0)]))
    evaluator.add_effect(picture(1, "agents", [(0.0, 1.0)]))  # a later report renews the picture
    evaluator.add_effect(picture(2, "agents", [(0.0, 0.0)], existence=0.4))
    evaluator.add_effect(picture(7, "agents", [(9.0, 9.0)]))  # no truth of that time
    series = evaluator.ospa("agents")
    assert series.t_ns == (at(0), at(1), at(2))
    assert series.total_m.tolist() == pytest.approx([6.0, 1.0, 100.0])
    assert (series.true_count, series.estimated_count) == ((2, 1, 1), (2, 1, 0))
    assert series.mean_m == pytest.approx(107.0 / 3)
    assert evaluator.ospa("targets").t_ns == ()


def test_a_retask_is_a_new_route_for_an_agent_that_had_one() -> None:
    evaluator = Evaluator(RADIUS_M, [1, 2, 3])
    evaluator.add_truth(truth(0, {1: (0.0, 0.0)}))
    evaluator.add_effect(plan(1, [1, 2], [1, 2], "first plan"))
    evaluator.add_effect(plan(2, [1, 2, 3], [3], "agent 3 joined"))
    evaluator.add_effect(plan(3, [1, 3], [], "nothing to change"))
    evaluator.add_effect(plan(6, [1, 3], [1, 3], "agent 2 lost"))
    verdict = summary(evaluator)
    assert verdict.retasks == 1
    assert [(r.t_s, r.vehicles, r.reason) for r in verdict.retask_list] == [(6.0, (1, 3), "agent 2 lost")]


def test_uploads_and_their_failures_are_counted() -> None:
    evaluator = Evaluator(RADIUS_M, [1])
    for ok in (True, False, True):
        evaluator.add_effect(UploadReport(at(1), 1, 1, 5, ok, "", 0.2, 0))
    verdict = summary(evaluator)
    assert (verdict.uploads, verdict.upload_failures) == (3, 1)


def test_a_target_that_never_appears_is_none_to_be_reached() -> None:
    evaluator = Evaluator(RADIUS_M, [1])
    evaluator.add_truth(
        Truth(at(0), (TruthObject("targets", 1, 0, 0, True), TruthObject("targets", 2, 0, 0, False)))
    )
    assert summary(evaluator).targets_total == 1


def test_the_json_has_exactly_the_promised_keys() -> None:
    text = summary_json(summary(ended(a_good_run())))
    assert "\n" not in text
    found = json.loads(text)
    assert list(found) == [
        "scenario", "seed", "outcome", "reason", "duration_s", "agents", "targets_total", "targets_reached",
        "retasks", "uploads", "upload_failures", "ospa_agents_mean_m", "ospa_targets_mean_m", "scan_ms_p99",
        "plan_ms_p99", "recording", "links",
    ]  # fmt: skip
    assert found["agents"][0] == {"system_id": 1, "status": "arrived", "target": 1}
    assert (found["scenario"], found["seed"], found["recording"]) == ("demo", 3, "runs/demo-3")


@given(st.permutations(range(11)))
def test_truth_may_arrive_in_any_order(order: list[int]) -> None:
    evaluator, reference = Evaluator(RADIUS_M, [1, 2, 3]), a_good_run()
    ground_truth = [
        Truth(t_ns, reference._ground_truth.at(t_ns)) for t_ns in reference._ground_truth.times_ns
    ]
    for index in order:
        evaluator.add_truth(ground_truth[index])
    for status in reference._statuses:
        evaluator.add_effect(status)
    assert summary(ended(evaluator)) == summary(ended(reference)) or both_nan(evaluator, reference)


def both_nan(first: Evaluator, second: Evaluator) -> bool:
    """Equal but for means that are NaN, which never equal themselves."""
    return summary_json(summary(first)) == summary_json(summary(second))


places = st.lists(st.tuples(st.floats(0, 300), st.floats(0, 300)), min_size=1, max_size=6)


@given(places, places)
def test_every_reached_target_is_near_and_reached_once_and_no_arrival_is_denied_a_free_one(
    agents: list[tuple[float, float]], targets: list[tuple[float, float]]
) -> None:
    evaluator = Evaluator(RADIUS_M, range(len(agents)))
    things = [TruthObject("agents", n, *place, True) for n, place in enumerate(agents)]
    things += [TruthObject("targets", n, *place, True) for n, place in enumerate(targets)]
    evaluator.add_truth(Truth(at(0), tuple(things)))
    for n in range(len(agents)):
        evaluator.add_effect(AgentStatus(at(0), n, "arrived", (0, n)))
    reached = [agent.target for agent in summary(evaluator).agents]
    taken = [target for target in reached if target is not None]
    assert len(set(taken)) == len(taken)
    for place, target in zip(agents, reached, strict=True):
        if target is not None:
            assert math.dist(place, targets[target]) <= RADIUS_M + 25.0
        else:
            free = [targets[n] for n in range(len(targets)) if n not in taken]
            assert all(math.dist(place, other) > RADIUS_M + 25.0 for other in free)


def test_estimates_some_scans_late_have_an_ospa_of_their_own() -> None:
    evaluator = Evaluator(RADIUS_M, [1])
    for second in range(3):
        evaluator.add_truth(truth(second, {1: (10.0 * second, 0.0)}))
        evaluator.add_effect(picture(second, "agents", [(10.0 * second, 6.0)]))
    assert evaluator.late_ospa("agents").t_ns == ()
    (now,) = picture(0, "agents", [(0.0, 2.0)]).tracks
    evaluator.add_effect(LaggedPicture(at(2), at(0), "agents", (now,)))
    late = evaluator.late_ospa("agents")
    assert (late.t_ns, late.mean_m) == ((at(0),), pytest.approx(2.0))
    assert evaluator.ospa("agents").mean_m == pytest.approx(6.0)
