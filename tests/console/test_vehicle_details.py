"""An operator could not see why a vehicle is left alone, or what it stores."""

from __future__ import annotations

import json

import pytest

from gcs.config import parse, read_text
from gcs.console.engine.vehicle_details import vehicle_detail
from gcs.console.source import UnknownVehicleError
from gcs.model import NS_PER_S, Order
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import load


def test_a_record_tells_claims_onboard_mission_and_upload() -> None:
    scenario = load("prescribed")
    hold = Order(START_T_NS + 12 * NS_PER_S, "one", "hold", (3,))
    run = VirtualRun(scenario, 1, lambda _: None, lambda *_: None, orders=[hold])
    run.run(20.0)
    onboard = run.engine.state.agents[1].tasking.onboard
    assert onboard is not None
    t_ns, verified = START_T_NS + 20 * NS_PER_S, (onboard.mission_id, START_T_NS + 12 * NS_PER_S)
    ours, held = (vehicle_detail(run.engine, vehicle, t_ns, verified) for vehicle in (1, 3))
    assert ours.claims == ()
    ((claim),) = held.claims
    assert (claim.authority, claim.reason) == ("held", "is held by order")
    assert claim.since_s is not None
    assert 7.0 <= claim.since_s <= 8.0
    mission = ours.mission
    assert mission is not None
    assert mission.verified_s == 8.0
    assert mission.current is not None
    assert mission.items[mission.current].command == "WAYPOINT"
    place = mission.items[-1].at
    assert place is not None
    assert all(0.0 <= value <= 2000.0 for value in place)
    home, first, *_ = [(item.alt_m, item.reference) for item in mission.items]
    assert (home, first) == ((70.0, "msl"), (100.0, "home"))
    assert ours.link.state == "alive"
    assert ours.agent == run.engine.stages.status_report.build(t_ns).agents[0]
    with pytest.raises(UnknownVehicleError):
        vehicle_detail(run.engine, 9, t_ns, verified)


def test_a_program_gets_the_record_of_a_vehicle(fly, launch) -> None:
    with fly() as flight:
        launch(flight)
        code, body, _ = flight.request("/api/vehicles/1")
        assert (code, json.loads(body)["agent"]["vehicle"]) == (200, 1)
        assert [flight.request(f"/api/vehicles/{name}")[0] for name in ("9", "x")] == [404, 404]


def test_a_vehicle_of_another_network_is_found_by_its_number_and_by_its_name(fly) -> None:
    """`GET /api/status` has the number, the page the name."""
    text = read_text("prescribed")[0].replace("system_id = 4\n", "system_id = 4\nnetwork = 1\n", 1)
    endpoints = '["udpin:127.0.0.1:0", { endpoint = "tcp:127.0.0.1:5760", network = 1 }]'
    text = text.replace('mavlink = "udpin:0.0.0.0:14550"', f"mavlink = {endpoints}")
    with fly(config=parse(text, "networks")) as flight:
        status = json.loads(flight.request("/api/status")[1])
        number = status["agents"][-1]["vehicle"]
        assert number == 260
        for name in (number, "1:4"):
            code, body, _ = flight.request(f"/api/vehicles/{name}")
            assert (code, json.loads(body)["agent"]["vehicle"]) == (200, number)
        assert flight.request("/api/vehicles/4")[0] == 404
