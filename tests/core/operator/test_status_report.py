"""An operator would task, or wait for, a vehicle that is lost or in other hands."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.hills import elevation_of, hill, terrain_table
from helpers.ordered_flight import flown, load
from helpers.sky import Sky, fly_on, give, with_one_home

from gcs.config import read_text
from gcs.console.engine.captures import capture
from gcs.model import NS_PER_S, AgentRecord, Order, SwarmStatus
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import parse_scenario


def asked(run: VirtualRun, order_id: str = "status-1") -> SwarmStatus:
    (status,) = run.engine.step(Order(run.t_ns, order_id, "status", None))
    assert isinstance(status, SwarmStatus)
    assert (status.t_ns, status.order_id) == (run.t_ns, order_id)
    return status


def agent(status: SwarmStatus, vehicle: int) -> AgentRecord:
    return next(one for one in status.agents if one.vehicle == vehicle)


def test_the_status_lists_routes_and_lost_agents() -> None:
    run = VirtualRun(load("prescribed"), 1)
    before = asked(run)
    assert [one.heard_age_s for one in before.agents] == [None] * 4
    assert not before.targets
    run = flown(load("prescribed"), 60.0).run
    status = asked(run)
    assert [one.vehicle for one in status.agents] == [1, 2, 3, 4]
    assert {one.status for one in status.agents if one.vehicle != 2} == {"active"}
    lost = agent(status, 2)
    assert lost.status == "lost"
    assert lost.heard_age_s is not None
    assert lost.heard_age_s > 5.0
    assert lost.target is None
    assert len(status.targets) == 5
    for one in status.agents:
        if one.vehicle == 2:
            continue
        truth = run.vehicles[f"vehicle:{one.vehicle}"]
        assert one.position_m is not None
        assert abs(one.position_m[0] - truth.east_m) < 20.0
        assert one.authority == "ours"
        assert one.mode == "AUTO"
        assert one.is_verified
        assert one.existence > 0.9
        assert one.to_go_m is not None
        assert one.eta_s is not None
        assert abs(one.eta_s - one.to_go_m / 15.0) < 3.0
        (target,) = [t for t in status.targets if t.label == one.target]
        assert one.vehicle in target.agents
    assert lost.is_late
    assert lost.lost_at_m is not None
    (radar,) = status.sensors
    assert radar.state == ""
    assert radar.scan_age_s is not None
    assert radar.scan_age_s < 1.5
    run.run(80.0)
    assert all(
        (agent(asked(run), v).to_go_m or 0.0) < (agent(status, v).to_go_m or 0.0) - 150.0 for v in (1, 3, 4)
    )


def test_the_status_names_the_control_authority_and_its_reason() -> None:
    run = flown(load("prescribed"), 30.0).run
    for action, vehicle in (("hold", 1), ("return", 3)):
        run.order(Order(run.t_ns, action, action, (vehicle,)))  # type: ignore[arg-type]
    run.run(35.0)
    status = asked(run)
    held, returning, ours = (agent(status, vehicle) for vehicle in (1, 3, 4))
    assert (held.authority, held.reason, held.mode) == ("held", "is held by order", "LOITER")
    assert (returning.authority, returning.mode) == ("returning", "RTL")
    assert (ours.authority, ours.reason) == ("ours", "")


def test_asking_for_the_status_changes_nothing() -> None:
    runs = [VirtualRun(load("prescribed"), 2) for _ in range(2)]
    for second in range(5, 45, 5):
        for run in runs:
            run.run(float(second))
        asked(runs[0], f"status-{second}")
    assert runs[0].snapshot() == runs[1].snapshot()
    times = [run.t_ns for run in runs]
    assert times[0] == times[1] >= 40 * NS_PER_S
    positions = [[(v.east_m, v.north_m) for v in run.vehicles.values()] for run in runs]
    assert positions[0] == positions[1]


def test_a_charge_below_the_limit_of_its_alarm_is_low() -> None:
    run = flown(load("prescribed"), 5.0).run
    stages = run.engine.stages
    health = [replace(stages.fleet.health_of(1), battery_percent=charge) for charge in (29, 30, None)]
    found = [stages.status_report.agent(one, run.t_ns).is_battery_low for one in health]
    assert found == [True, False, False]


def test_a_sensor_that_falls_silent_is_late_at_first() -> None:
    run = VirtualRun(load("prescribed"), 1)
    watchdog = run.engine.state.perception.sensor_watchdog
    for t_s in range(1, 4):
        watchdog.processed("radar", t_s * NS_PER_S)

    def state(t_s: int) -> str:
        watchdog.poll(t_s * NS_PER_S)
        (record,) = watchdog.records(t_s * NS_PER_S)
        return record.state

    assert [state(t_s) for t_s in (4, 6, 9)] == ["", "late", "silent"]


def test_heights_above_the_ground_are_those_over_the_elevation_model() -> None:
    ground = elevation_of(hill(1000.0, 1000.0, 60.0, 300.0, 70.0), 2000.0)
    run = VirtualRun(parse_scenario(read_text("prescribed")[0] + terrain_table(ground), "hills"), 1)
    run.run(20.0)
    heard = [one for one in asked(run).agents if one.agl_m is not None]
    assert len(heard) >= 3
    for one in heard:
        truth = run.vehicles[f"vehicle:{one.vehicle}"]
        true_agl_m = truth.alt_msl_m - ground.height_msl_m(truth.east_m, truth.north_m)
        assert one.agl_m is not None
        assert abs(one.agl_m - true_agl_m) < 8.0
        assert one.alt_msl_m is not None
        assert abs(one.alt_msl_m - truth.alt_msl_m) < 5.0


def test_over_flat_ground_no_height_above_it_is_claimed() -> None:
    run = flown(load("prescribed"), 5.0).run
    assert all(one.agl_m is None and one.alt_msl_m is not None for one in asked(run).agents)


def test_a_return_by_a_mission_is_shown_with_its_way_home() -> None:
    """Before, the map had no line ahead of such a vehicle, and the table no time of its arrival."""
    sky = with_one_home(Sky((600.0, 600.0, 60.0), (2600.0, 2600.0, 80.0)))
    give(sky, "return")
    fly_on(sky, 6.0)
    shown = capture(sky.run_.engine, sky.run_.t_ns)
    (route,) = (one for one in shown.routes if one.vehicle == 2)
    assert np.hypot(*(route.points_m[-1] - 1500.0)) < 300.0
    (record,) = (one for one in shown.status.agents if one.vehicle == 2)
    assert record.target is None
    assert 1300.0 < record.to_go_m < 2000.0  # it turns back first
    assert record.eta_s == pytest.approx(record.to_go_m / 18.0, rel=0.2)
