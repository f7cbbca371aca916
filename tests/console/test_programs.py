"""A program that watches the swarm would get other data than the documentation says."""

import json
import re
from pathlib import Path

import msgspec
import pytest
from starlette.routing import Route

from gcs.console.web.console_access import Access
from gcs.console.web.openapi import description
from gcs.console.web.static_files import StaticFiles
from gcs.console.web.token_attempts import Attempts
from gcs.console.web.web_routes import described_routes
from gcs.core.preflight.check_codes import CheckCode
from gcs.model import NoticeCode


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


@pytest.mark.parametrize(
    ("record", "codes"),
    [("LogEntry", ["", *NoticeCode]), ("Mark", ["", *NoticeCode]), ("CheckRow", [*CheckCode])],
)
def test_the_description_lists_the_codes_of_notices_and_checks(record, codes):
    schema = json.loads(msgspec.json.encode(description()))["components"]["schemas"][record]
    assert schema["properties"]["code"]["enum"] == [str(code) for code in codes]


def test_the_program_in_the_documentation_holds_a_vehicle(fly, capsys):
    page = (Path(__file__).parents[2] / "docs" / "console.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    with fly() as flight:
        assert "http://127.0.0.1:8480" in program
        exec(program.replace("http://127.0.0.1:8480", flight.url), {})
    assert capsys.readouterr().out.startswith("3 ")


def test_every_route_is_described_with_its_methods():
    served = {}
    for route in described_routes(None, Attempts(Access()), StaticFiles()):
        methods = route.methods - {"HEAD"} if isinstance(route, Route) else {"GET"}
        served[route.path.replace(":int", "")] = {method.lower() for method in methods}
    assert {path: set(one) for path, one in description()["paths"].items()} == served
