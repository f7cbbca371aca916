"""Without a sensor a user would lose sight of the agents, and of all of them when it comes back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from helpers.noticed import noticed

from gcs.model import NS_PER_S, AgentStatus, Datagram, Effect, Event, NoticeCode, Picture, Scan, Tick
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import load


def flown(
    until_s: float,
    is_scanned: Callable[[float], bool],
    is_heard: Callable[[float, str], bool] = lambda _t_s, _peer: True,
    latency_s: float = 0.0,
) -> tuple[VirtualRun, list[Effect]]:
    """Fly a mission whose scans and reports arrive at some times only, the scans late; return its effects."""
    run, effects, late = VirtualRun(load("prescribed"), 3), list[Effect](), list[Scan]()
    step = run.engine.step

    def filtered(event: Event, *arguments: Any) -> list[Effect]:
        t_s, found = (event.t_ns - START_T_NS) / NS_PER_S, list[Effect]()
        if isinstance(event, Scan):
            late.extend([event] if is_scanned(t_s) else [])
            return []
        if isinstance(event, Datagram) and not is_heard(t_s, event.peer):
            return []
        while isinstance(event, Tick) and late and event.t_ns >= late[0].t_ns + latency_s * NS_PER_S:
            found += step(replace(late.pop(0), t_ns=event.t_ns))
        found += step(event, *arguments)
        effects.extend(found)
        return found

    run.engine.step = filtered  # type: ignore[method-assign]
    run.run(until_s)
    return run, effects


def pictures(effects: list[Effect], after_s: float) -> list[Picture]:
    agents = [effect for effect in effects if isinstance(effect, Picture) and effect.kind == "agents"]
    return [picture for picture in agents if picture.t_ns > START_T_NS + after_s * NS_PER_S]


def refused(effects: list[Effect]) -> list[str]:
    problems = [str(notice.parameters["problem"]) for notice in noticed(effects, NoticeCode.BAD_INPUT)]
    return [problem for problem in problems if "position reports used" in problem]


def test_agents_are_tracked_by_their_reports_when_no_sensor_ever_comes() -> None:
    run, effects = flown(20.0, lambda _t_s: False)
    found = pictures(effects, 8.0)
    assert len(found) > 40
    assert {sum(track.estimated for track in picture.tracks) for picture in found} == {4}
    labels = {picture.tracks[0].label for picture in found}
    assert len(labels) == 1
    assert run.engine.stages.association.labels.keys() == {1, 2, 3, 4}
    positions = {state.system_id: (state.east_m, state.north_m) for state in run.engine.stages.fleet.states()}
    for vehicle, label in run.engine.stages.association.labels.items():
        track = run.engine.stages.trackers.agents.confirmation.tracks[label]
        assert tuple(track.mean[:2]) == pytest.approx(positions[vehicle], abs=15.0)
    assert not [effect for effect in effects if isinstance(effect, Picture) and effect.kind == "targets"]


def test_a_vehicle_silent_without_a_sensor_keeps_its_track_and_its_status() -> None:
    silent = "vehicle:3"
    run, effects = flown(30.0, lambda _t_s: False, lambda t_s, peer: t_s < 15.0 or peer != silent)
    assert not [effect for effect in effects if isinstance(effect, AgentStatus)]
    assert run.engine.stages.association.labels.keys() == {1, 2, 3, 4}


def test_no_epoch_follows_when_no_vehicle_reports() -> None:
    _, effects = flown(30.0, lambda _t_s: False, lambda t_s, _peer: t_s < 15.0)
    assert pictures(effects, 10.0)
    assert not pictures(effects, 16.5)


@pytest.mark.parametrize("latency_s", [0.0, 1.5])
def test_a_sensor_that_comes_back_finds_the_agents_it_knew(latency_s: float) -> None:
    run, effects = flown(70.0, lambda t_s: not 15.0 < t_s < 55.0, latency_s=latency_s)
    assert pictures(effects, 30.0)[0].t_ns < START_T_NS + 31 * NS_PER_S
    lost = [one.vehicle for one in effects if isinstance(one, AgentStatus) and one.status == "lost"]
    assert lost == [2], "this one crashes meanwhile"
    assert refused(effects) == []
    labels = run.engine.stages.association.labels
    assert [labels[vehicle] for vehicle in (1, 3, 4)] == [(0, 0), (0, 2), (0, 3)]


def test_a_late_first_scan_costs_one_scan_at_most() -> None:
    _, effects = flown(40.0, lambda t_s: t_s > 15.0 and round(t_s) % 12 == 0, latency_s=1.5)
    assert len(refused(effects)) <= 1
    assert [effect for effect in effects if isinstance(effect, Picture) and effect.kind == "targets"]
