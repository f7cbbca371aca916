"""An operator could not see why a vehicle is left alone, or what it stores."""

from __future__ import annotations

import json

from gcs.console.view.capture import capture
from gcs.console.view.details import detail_row
from gcs.model import NS_PER_S, Order
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import load


def test_a_record_tells_claims_onboard_mission_and_upload() -> None:
    scenario = load("prescribed")
    hold = Order(START_T_NS + 12 * NS_PER_S, "one", "hold", (3,))
    run = VirtualRun(scenario, 1, lambda _: None, lambda *_: None, orders=[hold])
    run.run(20.0)
    details, frame = capture(run.command, START_T_NS + 20 * NS_PER_S).details, scenario.config.local_frame
    ours, held = (detail_row(details[vehicle], frame, 8.0) for vehicle in (1, 3))
    assert ours["claims"] == []
    assert [(one["authority"], one["reason"]) for one in held["claims"]] == [("held", "is held by order")]
    assert 7.0 <= held["claims"][0]["since_s"] <= 8.0
    mission = ours["mission"]
    assert mission["verified_s"] == 8.0
    assert mission["items"][mission["current"]]["command"] == "WAYPOINT"
    east_m, north_m = mission["items"][-1]["at"]
    assert 0.0 <= east_m <= 2000.0
    assert 0.0 <= north_m <= 2000.0
    assert ours["link"]["state"] == "alive"
    assert ours["position"]["doubted"] is False


def test_a_program_gets_the_record_of_a_vehicle(fly, launch) -> None:
    with fly() as flight:
        launch(flight)
        code, body, _ = flight.request("/api/vehicles/1")
        assert (code, json.loads(body)["name"]) == (200, "1")
        assert [flight.request(f"/api/vehicles/{name}")[0] for name in ("9", "x")] == [404, 404]
