"""An operator would confirm a plan by times and distances that are not flown."""

import math

import numpy as np
import pytest
from helpers.runway import FIELD, Flight
from helpers.staging import S

from gcs.model import Order, Proposal
from sim_vehicles.campaign.virtual_run import START_T_NS

CONFIRM = FIELD.replace('shape = "flyable"', 'shape = "flyable"\nretask = "confirm"').replace(
    "[simulation]", '[simulation]\nairframe = "banked"'
)
START_M = (1788.0, 1000.0)
ASTRIDE = "boxes_m = [[1890.0, 1000.0, 2300.0, 1250.0]]"
"""The straight line from where the vehicle stands to its route crosses it; the flight goes round it."""
GAP = "boxes_m = [[0.0, 2000.0, 1610.0, 2080.0], [1710.0, 2000.0, 3000.0, 2080.0]]"
"""A gap of 80 m straight ahead of the runway, before the target."""


def clearance_m(grid, place_m):
    """Return the distance of a place from the nearest blocked cell."""
    rows, cols = np.nonzero(grid.blocked)
    col, row = (np.array(place_m) - grid.origin_m) / grid.spacing_m
    apart = np.hypot(np.maximum(abs(cols - col) - 0.5, 0.0), np.maximum(abs(rows - row) - 0.5, 0.0))
    return grid.spacing_m * float(apart.min())


def shown_and_flown(target_m, boxes, *, px4):
    """Return figures and status of a vehicle with a confirmed plan, and what it flies from the ground on."""
    field = CONFIRM.replace("2600.0", f"{target_m[0]}").replace("2500.0", f"{target_m[1]}")
    flight = Flight(
        orders=((3.0, "hold"), (6.0, "resume")), px4=px4, place_m=START_M, boxes=boxes, field=field
    )
    flight.run(9.0)
    proposal, run = flight.all(Proposal)[-1], flight.run_
    run.order(Order(run.t_ns, "confirm", "confirm", None, proposal.plan_id))
    run.order(Order(run.t_ns + 10 * S, "arm", "arm", None))
    flight.run(18.0)
    (status,) = run.engine.stages.status_report.build(run.t_ns).agents
    (figures,), begin_s, nearest_m = proposal.figures, None, math.inf
    while begin_s is None or math.dist(flight.way[-1][:2], target_m) > 30.0:
        t_s = (run.t_ns - START_T_NS) / S
        assert t_s < 150.0
        flight.run(t_s + 0.2)
        begin_s = t_s if begin_s is None and flight.plane.autopilot.armed else begin_s
        if flight.way[-1][2] > 1.0:
            nearest_m = min(nearest_m, clearance_m(run.engine.grid, flight.way[-1][:2]))
    return figures, status, (run.t_ns - START_T_NS) / S - begin_s, nearest_m


@pytest.mark.parametrize("px4", [False, True])
@pytest.mark.parametrize(("target_m", "boxes"), [((2600.0, 2500.0), ASTRIDE), ((1592.0, 2600.0), GAP)])
def test_figures_of_a_plan_from_the_ground_are_those_of_the_flight(target_m, boxes, px4):
    figures, status, arrival_s, nearest_m = shown_and_flown(target_m, boxes, px4=px4)
    assert figures.arrival_s == pytest.approx(arrival_s, rel=0.1)
    assert figures.arrival_s == pytest.approx(arrival_s, abs=3.0)
    assert figures.clearance_m == pytest.approx(min(nearest_m, 60.0), abs=5.0)
    assert status.eta_s == pytest.approx(arrival_s, abs=3.0)
    assert figures.length_m > math.dist(START_M, target_m) - 20.0
