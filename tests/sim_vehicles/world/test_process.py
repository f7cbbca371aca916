"""On a busy machine a run would call vehicles lost that only were late."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from gcs.model import TruthObject
from sim_vehicles.world.scenario import load
from sim_vehicles.world.world_process import TruthReceiver

S = 1_000_000_000


@pytest.fixture
def receiver() -> Iterator[TruthReceiver]:
    """All agents of a scenario fly east at 10 m/s; their states of the first second have come."""
    found = TruthReceiver(load("prescribed"))
    for agent in found.agents.values():
        for tenth in range(1, 11):
            agent.add(tenth * S // 10, float(tenth), 50.0, 200.0, tenth / 10)
    yield found
    found.close()


def agent(receiver: TruthReceiver, system_id: int, t_s: float, now_s: float) -> TruthObject:
    found = receiver.agents_at(round(t_s * S), now_s)
    assert found is not None
    return next(one for one in found if one.id == system_id)


def fly_others(receiver: TruthReceiver, late: int, t_s: float) -> None:
    for system_id, one in receiver.agents.items():
        if system_id != late:
            one.add(round(t_s * S), 10.0 * t_s, 50.0, 200.0, t_s)


def test_a_late_vehicle_lives_on_where_it_would_be_and_is_named_once_it_has_caught_up(receiver) -> None:
    fly_others(receiver, 3, 2.0)
    assert receiver.agents_at(2 * S, 2.0) is None, "the scan waits"
    receiver.give_up(2 * S, 2.0)
    late = agent(receiver, 3, 2.0, 2.0)
    assert (late.alive, late.east_m, late.north_m) == (True, pytest.approx(20.0), 50.0)
    assert receiver.caught_up() == ()
    receiver.agents[3].add(round(2.1 * S), 21.0, 50.0, 200.0, 2.4)
    assert receiver.caught_up() == (3,)
    assert receiver.caught_up() == ()


def test_scans_do_not_wait_again_for_a_vehicle_that_stays_behind(receiver) -> None:
    fly_others(receiver, 3, 2.0)
    receiver.give_up(2 * S, 2.0)
    receiver.agents[3].add(round(1.5 * S), 15.0, 50.0, 200.0, 2.0)
    fly_others(receiver, 3, 3.0)
    assert agent(receiver, 3, 3.0, 3.0).alive


def test_a_vehicle_whose_process_ended_is_lost_without_a_wait(receiver) -> None:
    fly_others(receiver, 3, 2.0)
    assert receiver.add_input(b"[1, ")
    assert receiver.add_input(b"3]\n")
    assert not agent(receiver, 3, 2.0, 2.0).alive
    assert agent(receiver, 3, 0.9, 2.0).alive
    assert receiver.caught_up() == ()
    assert not receiver.add_input(b"")


def test_a_vehicle_that_stays_silent_is_lost(receiver) -> None:
    fly_others(receiver, 3, 7.0)
    receiver.give_up(7 * S, 7.0)
    assert not agent(receiver, 3, 7.0, 7.0).alive
