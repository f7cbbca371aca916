"""A user would lose vehicles that have two links when the first one ends in flight."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import msgspec
import pytest
from helpers.noticed import noticed

from gcs.config.schema import EndpointTable
from gcs.model import NS_PER_S, Datagram, Effect, Event, MissionEnded, NoticeCode, Send, UploadReport
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import load

RADIO, LTE = "udpin:0.0.0.0:14550", "udpin:0.0.0.0:14560"


def flown(until_s: float, dies_s: float, dead: str) -> list[Effect]:
    """Fly a mission whose vehicles send every frame on two links, of which one ends; return its effects."""
    scenario = load("prescribed")
    links = msgspec.structs.replace(
        scenario.config.links, mavlink=[RADIO, EndpointTable(endpoint=LTE, redundant=True)]
    )
    config = msgspec.structs.replace(scenario.config, links=links)
    run, effects = VirtualRun(replace(scenario, config=config), 3), list[Effect]()
    step = run.engine.step

    def on_two_links(event: Event, *arguments: Any) -> list[Effect]:
        alive = {RADIO, LTE}
        if event.t_ns >= START_T_NS + dies_s * NS_PER_S:
            alive -= {dead}
        events = [event]
        if isinstance(event, Datagram):
            events = [replace(event, link=link) for link in (RADIO, LTE) if link in alive]
        found = [effect for one in events for effect in step(one, *arguments)]
        effects.extend(found)
        return [effect for effect in found if not isinstance(effect, Send) or effect.link in alive]

    run.engine.step = on_two_links  # type: ignore[method-assign]
    run.run(until_s)
    return effects


@pytest.mark.parametrize("dead", [RADIO, LTE])
def test_a_mission_goes_on_when_one_of_two_links_ends_in_flight(dead: str) -> None:
    effects = flown(200.0, 12.0, dead)
    wrong = (NoticeCode.ID_CONFLICT, NoticeCode.LINK_DOWN, NoticeCode.LINK_STALE, NoticeCode.REBOOTED)
    assert {notice.vehicle for notice in noticed(effects, *wrong)} <= {2}, "agent 2 crashes at 50 s"
    standby = noticed(effects, NoticeCode.STANDBY_LINK, NoticeCode.STANDBY_DOWN)
    assert {notice.vehicle for notice in standby} == {1, 2, 3, 4}
    late = [e for e in effects if isinstance(e, UploadReport) and e.t_ns > START_T_NS + 20 * NS_PER_S]
    assert late, "another agent takes the target of agent 2"
    assert all(report.ok for report in late)
    assert any(isinstance(effect, MissionEnded) for effect in effects)
    moved = noticed(effects, NoticeCode.ADDRESS_CHANGED)
    assert len(moved) == (4 if dead == RADIO else 0)
    assert all(notice.t_ns < START_T_NS + 15 * NS_PER_S for notice in moved)
