"""Checks of many orders share predictions; their answers are those of each check alone."""

import numpy as np
import pytest
from helpers.sky import FIELD, Sky, fly_on, place, with_one_home

from gcs.mavlink.autopilots.modes import AUTO, LOITER, RTL
from sim_vehicles.autopilots.autopilot_traits import Mode

COUNT = 10


def crowded(rng):
    """A random fleet in AUTO, LOITER and RTL, all in a square of 900 m, with one home."""
    targets = "".join(
        f"[[{table}]]\neast_m = {east_m:.0f}\nnorth_m = {north_m:.0f}\n"
        for east_m, north_m in rng.uniform(100.0, 2900.0, (COUNT - 2, 2))
        for table in ("births", "simulation.targets")
    )
    starts = np.column_stack((rng.uniform(600.0, 2400.0, (COUNT, 2)), 60.0 + 20.0 * np.arange(COUNT)))
    px4 = rng.choice(COUNT, 3, replace=False) + 1
    sky = with_one_home(Sky(*map(tuple, starts.tolist()), px4=px4.tolist(), field=FIELD + targets))
    for plane in sky.planes.values():
        mode = (Mode.AUTO, Mode.AUTO, Mode.LOITER, Mode.RTL)[rng.integers(4)]
        place(plane, *rng.uniform(1050.0, 1950.0, 2), rng.uniform(50.0, 140.0), rng.uniform(0.0, 360.0))
        if mode is not Mode.AUTO:
            plane.autopilot.set_mode(mode)
    return fly_on(sky, 3.0)


def answer_alone(order_check, vehicle, modes, t_ns):
    """Return the answer with each vehicle predicted for this check."""
    intents = order_check.intents
    states = {state.system_id: state for state in intents.flying(t_ns)}
    if vehicle not in states:
        return ""
    others = [intents.flight(one, t_ns, modes.get(v)) for v, one in states.items() if v != vehicle]
    own = intents.flight(states[vehicle], t_ns, modes[vehicle])
    if modes[vehicle] != AUTO and (problem := order_check._ground_problem(own)):
        return problem
    present = intents.flight(states[vehicle], t_ns)
    returns = modes[vehicle] == RTL, states[vehicle].mode == RTL
    return order_check._worse(own, present, others, returns)


@pytest.mark.parametrize("seed", [0, 2])
def test_checks_that_share_predictions_answer_as_each_alone(seed):
    """A return circles at home, however far away its vehicle and the others are."""
    rng = np.random.default_rng(seed)
    sky = crowded(rng)
    order_check = sky.run_.engine.stages.orders._order_check
    t_ns = sky.run_.t_ns
    flights = order_check.predict(t_ns)
    assert len(flights.states) == COUNT
    answers = []
    for _ in range(3):
        ordered = {v: (AUTO, LOITER, RTL)[rng.integers(3)] for v in flights.states if rng.random() < 0.4}
        for vehicle in flights.states:
            for mode in (AUTO, LOITER, RTL):
                modes = ordered | {vehicle: mode}
                answer = order_check.problem(vehicle, modes, flights)
                assert answer == answer_alone(order_check, vehicle, modes, t_ns)
                answers.append(answer)
    assert "" in answers
    assert any("come within" in one for one in answers)
    assert any("circle within" in one for one in answers)


def test_a_changed_mission_counts_after_a_renewal():
    sky = crowded(np.random.default_rng(0))
    order_check = sky.run_.engine.stages.orders._order_check
    flights = order_check.predict(sky.run_.t_ns)
    agents = sky.run_.engine.state.agents
    vehicle = next(v for v, one in flights.states.items() if one.mode == AUTO and agents[v].tasking.onboard)
    before = flights.of(vehicle)
    agents[vehicle].tasking.onboard = None
    flights.renew()
    assert flights.of(vehicle).goals != before.goals
