"""A restart says what it took up, and a vehicle that was called lost before it comes back."""

from __future__ import annotations

from dataclasses import replace

from gcs.model import AgentStatus, Effect, NoFlyZone, Notice, PersistedState, Plan
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import load

SEED, LOST, AT_S = 1, 1, 30.0


def restarted(change=lambda persisted: persisted) -> tuple[VirtualRun, list[Effect]]:
    """Fly, kill the service, start it from changed persisted state, and fly on."""
    effects: list[Effect] = []
    run = VirtualRun(load("prescribed"), SEED, lambda _: None, lambda _, effect: effects.append(effect))
    run.run(AT_S)
    persisted = change(run.command.persisted_state(run.t_ns))
    effects.clear()
    run.restart(4.0, persisted)
    return run, effects


def lost(persisted: PersistedState) -> PersistedState:
    vehicles = tuple(
        replace(one, status=replace(one.status, status="lost"), route=None, items=())
        if one.status.vehicle == LOST
        else one
        for one in persisted.vehicles
    )
    return replace(persisted, vehicles=vehicles, no_fly_zones=(NoFlyZone("fire", (500.0, 900.0, 60.0)),))


def test_the_notice_names_the_restored_state_and_how_to_start_clean():
    run, effects = restarted(lost)
    run.run(AT_S + 4.5)
    (text,) = [e.text for e in effects if isinstance(e, Notice) and "continues from its state" in e.text]
    assert "missions of agents 2, 3, 4" in text
    assert "agent 1 lost" in text
    assert "closed areas fire" in text
    assert "5 targets" in text
    assert "--no-resume" in text


def test_a_vehicle_that_was_lost_before_the_restart_and_is_seen_again_gets_a_mission():
    run, effects = restarted(lost)
    run.run(AT_S + 20.0)
    assert (LOST, "active") in [(e.vehicle, e.status) for e in effects if isinstance(e, AgentStatus)]
    assert any(route.vehicle == LOST for e in effects if isinstance(e, Plan) for route in e.routes)
