"""`gcs order` against a service over real zenoh: answered, or a clear error without a service."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gcs.cli import app
from gcs.config import load
from gcs.core.engine import Engine
from gcs.endpoints import Link, parse_endpoint
from gcs.errors import LinkError
from gcs.io.clock import RunClock
from gcs.io.links.manager import Links
from gcs.io.zenoh.discovery import ServiceInfo, announced, find_service, running_services
from gcs.io.zenoh.session import ZenohSession, free_endpoint, service_bus
from gcs.model import Order, Proposal, Route, RouteFigures, read_only
from gcs.service.service import Service


def loopback(port: int = 0) -> Links:
    link = Link(parse_endpoint(f"udpin:127.0.0.1:{port}"))
    return Links([link], [1, 2, 3, 4], load("prescribed").local_frame)


class Events:
    """Keeps the orders that the engine received."""

    def __init__(self) -> None:
        self.orders: list[Order] = []
        self.engine: Engine | None = None

    def event(self, event) -> None:
        if isinstance(event, Order):
            self.orders.append(event)

    def effect(self, t_ns, effect) -> None:
        pass


@pytest.fixture
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path


@pytest.fixture(params=["listen", "connect"])
def serving(runtime: Path, request: pytest.FixtureRequest) -> Iterator[Events]:
    """A service that runs and listens, or connects to a sensor that does, and the orders that it took."""
    events, endpoint = Events(), free_endpoint()
    ready = threading.Event()
    ending: list[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = []

    async def serve(bus: ZenohSession) -> None:
        service, stop = Service(load("prescribed"), 1, loopback(), bus), asyncio.Event()
        service.sinks.append(events)
        events.engine = service.engine
        ending.append((asyncio.get_running_loop(), stop))
        asyncio.get_running_loop().call_soon(ready.set)
        await service.run(RunClock(), stop)

    with contextlib.ExitStack() as stack:
        if request.param == "connect":
            stack.enter_context(ZenohSession(listen=endpoint))
        bus, door = stack.enter_context(service_bus(request.param, endpoint))
        stack.enter_context(announced("prescribed", door))
        thread = threading.Thread(target=lambda: asyncio.run(serve(bus)))
        thread.start()
        assert ready.wait(10.0)
        yield events
        loop, stop = ending[0]
        loop.call_soon_threadsafe(stop.set)
        thread.join(10.0)


@pytest.fixture
def taken(serving: Events) -> list[Order]:
    """The orders that it took."""
    return serving.orders


def test_an_order_reaches_the_service_once_and_its_answer_comes_back(taken: list[Order]) -> None:
    done = CliRunner().invoke(app, ["order", "no-fly-zone", "fire", "--circle", "900,640,120", "--json"])
    result = json.loads(done.stdout.strip().splitlines()[-1])
    assert (done.exit_code, result["ok"]) == (0, True)
    assert result["answers"] == [{"vehicle": None, "state": "done", "detail": "fire closed"}]
    refused = CliRunner().invoke(app, ["order", "hold", "1", "-v", "7"])
    assert refused.exit_code == 1
    assert "agent 1: order hold refused: never heard" in refused.output
    assert "agent 7: order hold refused: no vehicle of this mission" in refused.output
    assert [order.action for order in taken] == ["no-fly-zone", "hold"]


def test_the_status_of_a_service_is_printed(serving: Events) -> None:
    done = CliRunner().invoke(app, ["status"], env={"COLUMNS": "160"})
    assert done.exit_code == 0
    assert "prescribed: agents 4 active, 0 arrived, 0 lost; 0 targets" in done.output
    assert done.output.count("never") == 4
    found = json.loads(CliRunner().invoke(app, ["status", "--json"]).stdout)
    assert [agent["vehicle"] for agent in found["agents"]] == [1, 2, 3, 4]
    assert {agent["authority"] for agent in found["agents"]} == {"ours"}
    assert [order.action for order in serving.orders] == ["status", "status"]


def test_confirm_without_a_number_prints_the_plan_and_confirms_that_one(serving: Events) -> None:
    none = CliRunner().invoke(app, ["order", "confirm"])
    assert (none.exit_code, "no plan waits" in none.output) == (1, True)
    route = Route(3, (0, 1), read_only([[900.0, 500.0]]), 1480.0)
    figures = RouteFigures(3, 1480.0, 1350.0, 98.7, 212.0, 40.0)
    assert serving.engine is not None
    state = serving.engine.state
    state.agents[3].routes.proposed = route
    state.operator.approval.count = 7
    state.operator.approval.pending = Proposal(1, 7, (route,), "target T0.1 moved 66 m", 1, (figures,))
    printed = CliRunner().invoke(app, ["order", "plan", "--json"])
    shown = json.loads(printed.stdout.strip().splitlines()[-1])["proposal"]
    assert (shown["plan_id"], shown["figures"][0]["shown_length_m"]) == (7, 1350.0)
    done = CliRunner().invoke(app, ["order", "confirm"])
    assert (
        "agent 3 → T0.1: 1480 m (was 1350 m), arrives in 99 s, separation 212 m, clearance 40 m"
        in done.output
    )
    assert "plan 7 waits to be confirmed, shown" in done.output
    assert "target T0.1 moved 66 m" in done.output
    assert [(o.action, o.plan_id) for o in serving.orders][-2:] == [("plan", None), ("confirm", 7)]
    assert "agent 3 is not seen by any sensor now" in done.output  # no vehicle flies here
    assert done.exit_code == 1


def test_a_missing_service_is_a_clear_error(runtime: Path) -> None:
    none = CliRunner().invoke(app, ["order", "return", "--all"])
    assert none.exit_code == 1
    assert "no service runs on this machine" in none.output
    arguments = ["order", "hold", "--all", "--mission", "m", "--zenoh", free_endpoint(), "--timeout", "1"]
    silent = CliRunner().invoke(app, arguments)
    assert silent.exit_code == 1
    assert "no service of the mission m answers here" in silent.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["hold"], "name the vehicles"),
        (["hold", "-v", "1", "--all"], "name the vehicles"),
        (["hold", "1", "--all"], "name the vehicles"),
        (["arm", "-v", "1"], "--yes"),
        (["no-fly-zone", "fire"], "expected one of"),
        (["no-fly-zone", "fire", "--circle", "1,2"], "3 numbers"),
        (["reject"], "Missing argument"),
    ],
)
def test_mistakes_in_the_arguments_are_named(runtime: Path, arguments: list[str], words: str) -> None:
    done = CliRunner().invoke(app, ["order", *arguments], env={"COLUMNS": "200", "TERM": "dumb"})
    assert done.exit_code == 2
    assert words in done.output


def test_a_service_that_was_killed_is_not_found(runtime: Path) -> None:
    with announced("prescribed", "tcp/127.0.0.1:1"):
        assert find_service(None) == ServiceInfo(
            mission="prescribed", zenoh="tcp/127.0.0.1:1", pid=os.getpid()
        )
        (folder,) = runtime.iterdir()
        (folder / "dead-1.json").write_text('{"mission": "dead", "zenoh": "tcp/127.0.0.1:2", "pid": 4194305}')
        (folder / "broken.json").write_text("{")
        assert [one.mission for one in running_services()] == ["prescribed"]
        with announced("other", "tcp/127.0.0.1:3"):
            with pytest.raises(LinkError, match=r"several services.*choose one by --mission NAME$"):
                find_service(None)
            assert find_service("other").zenoh == "tcp/127.0.0.1:3"
    assert running_services() == []


def test_a_folder_that_others_may_write_to_is_not_trusted(runtime: Path) -> None:
    with announced("prescribed", "tcp/127.0.0.1:1"):
        (folder,) = runtime.iterdir()
        folder.chmod(0o777)
        assert running_services() == []


def test_an_order_loads_no_compiler_no_planner_and_no_dialect() -> None:
    code = """
import sys
import gcs.cli, gcs.report.operator_lines
import gcs.io.zenoh.order_messages, gcs.io.zenoh.order_client, gcs.io.zenoh.discovery
heavy = ("numba", "llvmlite", "scipy", "pymavlink", "matplotlib", "gcs.core", "gcs.tracking")
print([name for name in heavy if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
