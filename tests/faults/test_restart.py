"""A restart says what it took up, and a vehicle that was called lost before it comes back."""

from __future__ import annotations

from dataclasses import replace

from helpers.noticed import noticed

from gcs.core.snapshot import decode_state, encode_state
from gcs.core.state import State
from gcs.model import AgentStatus, Effect, NoFlyZone, NoticeCode, Plan, Snapshot
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import load

SEED, LOST, AT_S = 1, 1, 30.0


def restarted(change) -> tuple[VirtualRun, list[Effect]]:
    """Fly, kill the service, start it from a changed state, and fly on."""
    effects: list[Effect] = []
    run = VirtualRun(load("prescribed"), SEED, lambda _: None, lambda _, effect: effects.append(effect))
    run.run(AT_S)
    state = decode_state("test", run.snapshot().data)
    change(state)
    effects.clear()
    run.restart(4.0, Snapshot(run.t_ns, encode_state(state)))
    return run, effects


def lost(state: State) -> None:
    agent = state.agents[LOST]
    agent.perception.status = replace(agent.perception.status, status="lost")
    agent.routes.flown = agent.tasking.onboard = None
    state.airspace.zones["fire"] = NoFlyZone("fire", (500.0, 900.0, 60.0))


def test_the_notice_names_the_restored_state():
    run, effects = restarted(lost)
    run.run(AT_S + 4.5)
    (notice,) = noticed(effects, NoticeCode.RESUMED)
    contents = notice.parameters["contents"]
    assert "missions of agents 2, 3, 4" in contents
    assert "agent 1 lost" in contents
    assert "closed areas fire" in contents
    assert "5 targets" in contents


def test_a_vehicle_that_was_lost_before_the_restart_and_is_seen_again_gets_a_mission():
    run, effects = restarted(lost)
    run.run(AT_S + 20.0)
    assert (LOST, "active") in [(e.vehicle, e.status) for e in effects if isinstance(e, AgentStatus)]
    assert any(route.vehicle == LOST for e in effects if isinstance(e, Plan) for route in e.routes)
