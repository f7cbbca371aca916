"""A user would see vehicles land through an area that he closed after their missions were sent."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from helpers.flown_clearance import landing
from helpers.noticed import noticed

from gcs.core.replanning import return_routes
from gcs.model import (
    UNLIMITED,
    AgentStatus,
    NoFlyZone,
    Notice,
    NoticeCode,
    Order,
    Plan,
    UploadReport,
    VerticalLimits,
)
from gcs.planning.manoeuvres.landing import plan_return_route
from gcs.planning.map.line_of_sight import line_of_sight
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import load


class Flight:
    """A mission that ends at home, on virtual time."""

    def __init__(self) -> None:
        self.effects: list[object] = []
        self.run = VirtualRun(
            landing(load("deterministic")), 1, on_effect=lambda _t_ns, effect: self.effects.append(effect)
        )

    def all(self, kind):
        return [effect for effect in self.effects if isinstance(effect, kind)]

    def ways(self):
        agents = self.run.engine.state.agents
        return {v: one.routes.return_m for v, one in agents.items() if one.routes.return_m is not None}

    def close(self, place_m, limits=UNLIMITED):
        """Close a disc; returns what was blocked by it."""
        before = self.run.engine.grid.blocked.copy()
        self.effects.clear()
        self.run.order(
            Order(
                self.run.t_ns, "1", "no-fly-zone", None, None, NoFlyZone("fire", (*place_m, 50.0), (), limits)
            )
        )
        return before


def before_home(way_m, metres):
    leg = way_m[-2] - way_m[-1]
    return tuple((way_m[-1] + leg / np.hypot(*leg) * metres).tolist())


def test_who_would_land_through_a_closed_area_gets_another_way_home():
    flight = Flight()
    flown_s = flight.run.run(30.0)
    vehicle = min(flight.ways())
    before = flight.close(before_home(flight.ways()[vehicle], 250.0))
    flight.run.run(flown_s + 5.0)
    engine = flight.run.engine
    closed = type(engine.grid)(engine.grid.origin_m, engine.grid.spacing_m, engine.grid.blocked & ~before)
    assert closed.blocked.any()
    assert vehicle in flight.all(Plan)[0].changed
    assert any(report.ok and report.vehicle == vehicle for report in flight.all(UploadReport))
    way = [tuple(point) for point in flight.ways()[vehicle].tolist()]
    assert all(line_of_sight(closed, a, b) for a, b in pairwise(way))


def test_a_low_zone_under_the_approach_gives_another_way_home_and_one_under_the_route_does_not():
    flight = Flight()
    flown_s = flight.run.run(30.0)
    low = VerticalLimits(None, 30.0, "ground")
    vehicle = min(flight.ways())
    before_m = flight.ways()[vehicle].copy()
    flight.close(tuple(flight.run.engine.state.agents[vehicle].routes.latest.points_m[0].tolist()), low)
    flown_s = flight.run.run(flown_s + 5.0)
    assert not any(plan.changed for plan in flight.all(Plan))
    assert not flight.all(UploadReport)
    assert (flight.ways()[vehicle] == before_m).all()
    place_m = before_home(before_m, 250.0)
    flight.close(place_m, low)
    flight.run.run(flown_s + 5.0)
    assert vehicle in flight.all(Plan)[0].changed
    closed = flight.run.engine.stages.no_fly_zones.closed["fire"].grid
    assert not closed.is_free(place_m)
    way = [tuple(point) for point in flight.ways()[vehicle].tolist()]
    assert all(line_of_sight(closed, a, b) for a, b in pairwise(way))


def test_who_is_on_the_way_home_already_is_named():
    flight = Flight()
    flown_s = flight.run.run(20.0)
    while not (statuses := [status for status in flight.all(AgentStatus) if status.status == "arrived"]):
        flown_s = flight.run.run(flown_s + 5.0)
    vehicle = statuses[0].vehicle
    flight.close(before_home(flight.ways()[vehicle], 250.0))
    flight.run.ended = False
    flight.run.run(flown_s + 1.0)
    (notice,) = noticed(flight.all(Notice), NoticeCode.ZONE_ON_RETURN)
    assert (notice.vehicle, notice.parameters["zone"]) == (vehicle, "fire")


def test_a_return_route_is_planned_once_for_each_route(monkeypatch):
    """It was planned at each begin of an upload, by the uploader."""
    planned = []

    def counted(grid, start, points_m, *rest):
        planned.append(points_m)
        return plan_return_route(grid, start, points_m, *rest)

    monkeypatch.setattr(return_routes, "plan_return_route", counted)
    flight = Flight()
    flight.run.run(40.0)
    sent = [
        route.points_m for plan in flight.all(Plan) for route in plan.routes if route.vehicle in plan.changed
    ]
    assert len(sent) > 2
    assert len(planned) == len(sent)
    assert all(any(a is b for b in sent) for a in planned)
