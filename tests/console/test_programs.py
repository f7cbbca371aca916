"""A program that watches the swarm would get other data than the documentation says."""

import json


def test_status_plan_metrics_and_their_description(fly):
    with fly() as flight:
        code, body, _ = flight.request("/api/status")
        assert code == 200
        assert [one["vehicle"] for one in json.loads(body)["agents"]] == [1, 2, 3, 4]
        assert json.loads(flight.request("/api/plan")[1]) == {"routes": [], "proposal": None}
        lines = flight.request("/metrics")[1].decode().splitlines()
        assert 'swarm_gcs_vehicle_armed{vehicle="3"} 0' in lines
        api = json.loads(flight.request("/api/openapi.json")[1])
        assert {"/api/status", "/api/plan", "/api/orders", "/metrics"} <= api["paths"].keys()
        fields = api["components"]["schemas"]["AgentRecord"]["properties"]
        assert fields.keys() == json.loads(body)["agents"][0].keys()
