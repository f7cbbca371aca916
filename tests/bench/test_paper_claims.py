"""The paper's claims are evaluated on flown runs: each verdict changes with the run."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from paper_claims import SCENARIOS, Claim, Runs, claims, markdown
from paper_measures import (
    Flown,
    astray,
    false_and_missed,
    handovers,
    metres_in_obstacles,
    spurious,
    waviness,
    wrong_kind,
)

from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Kind,
    MissionEnded,
    Picture,
    Plan,
    Route,
    Scan,
    Sensor,
    Tick,
    Track,
    Truth,
    TruthObject,
    read_only,
)
from gcs.planning.map.grid import Grid, free_grid
from gcs.report.run.evaluation import Evaluator
from gcs.report.run.timeline import TimelineBuilder

SENSOR = Sensor("radar", 0.98, 5e-6, read_only(np.eye(2) * 10), (0.0, 0.0, 1000.0, 1000.0))
TARGETS = {0: (900.0, 100.0), 1: (900.0, 300.0)}


def at(t_s: float) -> int:
    return NS_PER_S * 1_000_000 + round(t_s * NS_PER_S)


def picture(t_s: float, kind: Kind, points: Sequence[tuple[float, float]]) -> Picture:
    tracks = tuple(
        Track((0, n), read_only([*point, 0.0, 0.0]), read_only(np.eye(4)), 0.99, True)
        for n, point in enumerate(points)
    )
    return Picture(at(t_s), at(t_s), kind, tracks, read_only([0.0, 1.0]))


def plan(t_s: float, targets: dict[int, int], changed: tuple[int, ...], reason: str) -> Plan:
    routes = tuple(Route(v, (0, t), read_only([TARGETS[t]]), 900.0) for v, t in targets.items())
    return Plan(at(t_s), at(t_s), routes, (), (), reason, changed)


def a_run(
    *,
    revived_s: Sequence[int] = (),
    handed_over: bool = True,
    blocked: bool = False,
    last_end_m: tuple[float, float] | None = None,
    drift_m_s: float = 0.0,
) -> Flown:
    """Two agents fly east at 10 m/s to a target each; the second dies at 30 s; the first takes its target.

    The targets drift north.
    """
    evaluator = Evaluator(60.0, (1, 2))
    builder = TimelineBuilder(evaluator)
    for second in range(91):
        east, alive = 10.0 * second, second <= 30
        things = [TruthObject("agents", 1, east, 100.0, True), TruthObject("agents", 2, east, 300.0, alive)]
        things += [
            TruthObject("targets", n, x, y + drift_m_s * second, True) for n, (x, y) in TARGETS.items()
        ]
        agents = [(east, 100.0), *([(east, 300.0)] if alive or second == 31 else [])]
        agents += [(300.0, 320.0)] if second in revived_s else []
        builder.add(Tick(at(second)))
        builder.add(Truth(at(second), tuple(things)))
        builder.add(Scan(at(second), at(second), SENSOR, read_only([[500.0, 700.0], *agents])))
        builder.add(picture(second, "agents", agents))
        builder.add(picture(second, "targets", list(TARGETS.values())))
        if second == 2:
            builder.add(plan(second, {1: 0, 2: 1}, (1, 2), "first plan"))
        if second == 35:
            builder.add(plan(second, {1: 1 if handed_over else 0}, (1,), "agent 2 lost"))
        if second == 40:
            moved = plan(second, {1: 0}, (1,), "target 0.0 moved 51 m")
            if last_end_m is not None:
                moved = replace(moved, routes=(Route(1, (0, 0), read_only([last_end_m]), 1.0),))
            builder.add(moved)
    builder.add(AgentStatus(at(33), 2, "lost"))
    builder.add(AgentStatus(at(90), 1, "arrived", (0, 0)))
    builder.add(MissionEnded(at(90), (1,), (2,)))
    grid = free_grid((51, 51), 20.0)
    if blocked:
        wall = np.array(grid.blocked)
        wall[5, 20] = True  # 390 ... 410 m east, 90 ... 110 m north
        grid = Grid(grid.origin_m, grid.spacing_m, wall)
    summary = evaluator.summary(
        scenario="x", seed=1, duration_s=90.0, scan_ms_p99=2.0, plan_ms_p99=3.0, recording=""
    )
    return Flown(builder.build(), summary, grid)


def found(runs: Runs, words: str) -> Claim:
    (claim,) = [claim for claim in claims(runs) if words in claim.says]
    return claim


def all_of(flown: Flown) -> Runs:
    return Runs(dict.fromkeys(SCENARIOS, flown), flown, flown.summary)


def test_a_way_through_an_obstacle_is_measured_in_metres() -> None:
    assert metres_in_obstacles(a_run()) == 0.0
    assert metres_in_obstacles(a_run(blocked=True)) == pytest.approx(20.0)


def test_who_takes_a_lost_agents_target_is_found() -> None:
    (one,) = handovers(a_run())
    assert (one.lost, one.successor, one.after_s) == (2, 1, 5.0)
    assert one.former_m == pytest.approx(550.0)
    assert one.new_m == pytest.approx(np.hypot(550.0, 200.0))
    assert handovers(a_run(handed_over=False)) == ()


def test_a_revival_is_no_slow_detection() -> None:
    assert spurious(a_run()) == (0, 0, 1)
    assert spurious(a_run(revived_s=(50, 60, 61))) == (3, 2, 1)


def test_estimates_are_sorted_by_object() -> None:
    estimates, false, missed = false_and_missed(a_run(revived_s=(50,)))
    assert (estimates, false, missed) == (91 + 31 + 1 + 1 + 2 * 91, 2, 0)
    assert wrong_kind(a_run()) == (0, 0)


def test_a_route_to_nothing_is_counted() -> None:
    assert astray(a_run()) == (4, 0)
    assert astray(a_run(last_end_m=(500.0, 700.0))) == (4, 1)


def test_a_route_to_where_a_target_is_heading_is_none_to_nothing() -> None:
    assert astray(a_run(last_end_m=(900.0, 640.0), drift_m_s=0.0)) == (4, 1)
    assert astray(a_run(last_end_m=(900.0, 640.0), drift_m_s=4.0))[1] == 0
    assert astray(a_run(last_end_m=(900.0, 100.0), drift_m_s=4.0))[1] == 1


def test_a_straight_flight_is_not_wavy() -> None:
    ratio, turning = waviness(a_run())
    assert ratio == pytest.approx(1.0, abs=0.02)
    assert turning == pytest.approx(0.0, abs=1e-6)


def test_verdicts_turn_with_the_run() -> None:
    good, bad = all_of(a_run()), all_of(a_run(handed_over=False, last_end_m=(500.0, 700.0), blocked=True))
    assert found(good, "clutter was not allowed").verdict == "holds"
    assert found(bad, "clutter was not allowed").verdict == "holds in part"
    assert found(good, "dynamics and initial").verdict == "holds"
    assert found(bad, "dynamics and initial").verdict == "holds in part"
    assert found(good, "another is re-routed").verdict == "holds in part"  # its former target was nearer
    assert found(bad, "another is re-routed").verdict == "does not hold"
    assert found(good, "taken for it").verdict == "not seen here"
    assert found(all_of(a_run(revived_s=(50,))), "taken for it").verdict == "holds"
    assert found(all_of(a_run(revived_s=(50, 51))), "taken for it").verdict == "does not hold"
    slow = replace(good.flown[SCENARIOS[0]].summary, scan_ms_p99=800.0)
    assert found(good, "burdensome").verdict == "does not hold"
    assert found(replace(good, swarm=slow), "burdensome").verdict == "holds"


def test_the_table_in_markdown_has_every_claim() -> None:
    runs = all_of(a_run())
    lines = markdown(claims(runs)).splitlines()
    assert len(lines) == 2 + len(claims(runs)) >= 15
    assert all(line.count("|") == 6 for line in lines)


def test_many_detections_are_thinned_evenly_with_a_remark() -> None:
    builder = TimelineBuilder()
    for second in range(120):
        z_m = np.column_stack([np.arange(1000.0), np.full(1000, float(second))])
        builder.add(Scan(at(second), at(second), SENSOR, read_only(z_m)))
    timeline = builder.build()
    assert timeline.every > 1
    assert len(timeline.clutter_m) * timeline.every == pytest.approx(120_000, rel=0.01)
    assert set(timeline.clutter_m[:, 1]) == set(range(120))


def test_docs_name_every_claim() -> None:
    text = (Path(__file__).parents[2] / "docs" / "paper.md").read_text(encoding="utf-8")
    for claim in claims(all_of(a_run())):
        assert claim.says in text
