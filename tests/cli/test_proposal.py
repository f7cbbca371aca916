"""An operator would miss an alarm behind plans that wait, or confirm one without knowing how old it is."""

from __future__ import annotations

import io
import math
from dataclasses import replace

from rich.console import Console

from gcs.cli.live_view import LiveView, PlainLines
from gcs.config import load
from gcs.core.engine import Engine
from gcs.core.replanning.reasons import of_agent, of_target
from gcs.mavlink.services.adsb_out import callsign
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Notice,
    NoticeCode,
    Plan,
    Proposal,
    Route,
    RouteFigures,
    Tick,
    read_only,
    target_name,
)
from gcs.planning.map.grid import free_grid
from gcs.planning.planner_inputs import PlanOptions
from gcs.planning.team_routes import plan_routes
from gcs.report.operator_lines import effect_notice

S = NS_PER_S
ROUTES = tuple(Route(v, (0, v), read_only([[900.0, 100.0 * v]]), 1000.0 + v) for v in range(1, 9))
FIGURES = tuple(RouteFigures(v, 1000.0 + v, 900.0, 67.0, None, None) for v in range(1, 9))


def proposal(plan_id: int, t_s: float, shown_s: float) -> Proposal:
    reason = "target T0.1 moved 66 m"
    return Proposal(round(t_s * S), plan_id, ROUTES, reason, round(shown_s * S), FIGURES)


def console(height: int = 40) -> Console:
    return Console(file=io.StringIO(), width=150, height=height, color_system=None)


def text_of(console: Console) -> str:
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_plans_that_wait_push_no_alarm_out_of_the_live_view() -> None:
    config, screen = load("prescribed"), console()
    engine = Engine(config, 1)
    view = LiveView(config, engine, 1.0)
    view.event(Tick(1 * S))
    view.effect(1 * S, Notice(1 * S, NoticeCode.AUTOPILOT_ALARM, 3, {"said": "not heard at all"}))
    for number in range(1, 31):
        engine.state.operator.approval.pending = proposal(number, 1.0 + number, 1.0 + number)
        view.effect((1 + number) * S, engine.state.operator.approval.pending)
    view.event(Tick(44 * S))
    screen.print(view)
    shown = text_of(screen)
    assert "agent 3: " in shown
    assert "not heard at all" in shown
    assert "plan 30 waits to be confirmed, shown 13 s ago: target T0.1 moved 66 m" in shown
    assert "gcs order confirm 30" in shown
    assert "agent 6 → T0.6: 1006 m (was 900 m), arrives in 67 s, alone at its altitude" in shown
    assert "agent 7" not in shown
    assert "and 2 more (gcs order plan)" in shown


def test_a_log_has_a_plan_once_and_again_when_it_is_another_or_a_minute_has_passed() -> None:
    screen = console()
    lines = PlainLines(screen)
    lines.event(Tick(1 * S))
    for t_s in range(1, 75):
        lines.effect(t_s * S, proposal(1, float(t_s), 1.0))
    assert len(text_of(screen).splitlines()) == 2
    lines.effect(75 * S, proposal(2, 75.0, 75.0))
    fewer = proposal(2, 76.0, 75.0)
    lines.effect(76 * S, replace(fewer, routes=fewer.routes[1:], figures=fewer.figures[1:]))
    lines.effect(77 * S, replace(fewer, routes=(), figures=()))
    first, again, second, left = text_of(screen).splitlines()
    assert "plan 1 waits to be confirmed, shown 0 s ago" in first
    assert "plan 1 waits to be confirmed, shown 60 s ago" in again
    assert "plan 2 waits" in second
    assert "agent 1 →" not in left


def test_a_target_has_one_name_and_only_agents_are_lost() -> None:
    label = (0, 2)
    route = Route(3, label, read_only([[900.0, 100.0]]), 800.0)
    moved = of_target("target moved", label, "moved 60 m")
    gone = of_target("target lost", label, "is not tracked any more")
    passed = of_agent("agent passed its target", 3, f"passed target {target_name(label)}")
    proposal_lines = [
        effect_notice(Plan(0, 0, (route,), (), (), f"{moved.text}; {gone.text}", (3,))),
        effect_notice(AgentStatus(0, 3, "arrived", label)),
        effect_notice(replace(proposal(1, 1.0, 1.0), routes=(route,), reason=passed.text)),
    ]
    nowhere = plan_routes(free_grid((5, 5), 10.0), {}, {label: (math.inf, 0.0)}, {}, PlanOptions())
    parameters = [value for line in proposal_lines if line is not None for value in line.parameters.values()]
    parameters += [value for note in nowhere.notes for value in note.parameters.values()]
    words = " ".join([*map(str, parameters), callsign(label)])
    assert words.count("T0.2") == words.count("0.2") == 8
    assert "(0, 2)" not in words
    assert "lost" not in words
    assert effect_notice(AgentStatus(0, 3, "lost")) == Notice(0, NoticeCode.AGENT_LOST, 3, {"target": "–"})
