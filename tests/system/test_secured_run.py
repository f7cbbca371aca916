"""`gcs run` with certificates: viewers and operators do what their roles allow, and are told what they may
not. No key gets into a log or a recording."""

from __future__ import annotations

import base64
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gcs.cli import app
from gcs.config import read_text
from gcs.io.recording.reader import read
from gcs.io.zenoh.certificate_authority import make_certificate_authority, make_node
from gcs.io.zenoh.key_expressions import order_key, scan_key
from gcs.io.zenoh.order_messages import OrderMessage, encode_order
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.model import Notice, NoticeCode, Order, Scan
from sim_vehicles.cli import app as sim_vehicles

GCS = [sys.executable, "-P", "-c", "from gcs.cli import main; main()"]
MISSION = "prescribed"
TIMEOUT_S = 60.0


class Swarm:
    """A running service with a CA, and its nodes."""

    def __init__(self, folder: Path, runtime: Path) -> None:
        self.folder = folder
        ca = folder / "ca"
        make_certificate_authority(ca, 30)
        nodes = {"vic": "viewer", "anna": "operator", "radar": "sensor", "hub": "command"}
        self.tls = {name: make_node(ca, name, role, [], 30) for name, role in nodes.items()}
        nodes_of_hub = (self.tls["hub"] / "nodes.toml").read_text()
        self.tls["late"] = make_node(ca, "late", "operator", [], 30)
        (self.tls["hub"] / "nodes.toml").write_text(nodes_of_hub)
        self.endpoint = free_endpoint("tls")
        text, _ = read_text(MISSION)
        text = text.replace('mavlink = "udpin:0.0.0.0:14550"', 'mavlink = "udpin:127.0.0.1:0"', 1)
        text = text.replace(
            'zenoh = "tcp/127.0.0.1:7447"', f'zenoh = "{self.endpoint}"\nzenoh_tls = "ca/command.hub"', 1
        )
        assert self.endpoint in text
        (folder / "mission.toml").write_text(text)
        command = [*GCS, "run", str(folder / "mission.toml"), "--headless", "--console", "off"]
        command += ["--out", str(folder / "run"), "--journal", str(folder / "journal")]
        with (folder / "log").open("wb") as log:
            environment = {"XDG_RUNTIME_DIR": str(runtime), "PATH": "", "PYTHONPATH": ":".join(sys.path)}
            self.process = subprocess.Popen(command, stdout=log, stderr=log, env=environment, cwd=folder)

    def gcs(self, *arguments: str, node: str | None = None, tls: Path | None = None):
        tls = tls or (self.tls[node] if node else None)
        where = ["--mission", MISSION, "--zenoh", self.endpoint]
        more = [*where, *(["--zenoh-tls", str(tls)] if tls else [])] if node or tls else []
        return CliRunner(env={"COLUMNS": "200"}).invoke(app, [*arguments, *more])

    def until_ready(self) -> None:
        give_up = time.monotonic() + TIMEOUT_S
        while "Ctrl-C ends it" not in self.log():
            assert self.process.poll() is None, self.log()
            assert time.monotonic() < give_up, self.log()
            time.sleep(0.1)

    def log(self) -> str:
        return (self.folder / "log").read_text()

    def end(self) -> None:
        self.process.terminate()
        self.process.wait(TIMEOUT_S)


@pytest.fixture(scope="module")
def swarm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Swarm]:
    folder = tmp_path_factory.mktemp("swarm")
    runtime = tmp_path_factory.mktemp("runtime")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(runtime))
        one = Swarm(folder, runtime)
        one.until_ready()
        yield one
        one.end()


def test_a_viewer_sees_and_an_operator_orders(swarm: Swarm) -> None:
    for node in ("vic", "anna"):
        seen = swarm.gcs("status", "--json", node=node)
        assert seen.exit_code == 0, seen.output
        assert len(json.loads(seen.stdout.splitlines()[-1])["agents"]) == 4
    ordered = swarm.gcs("order", "no-fly-zone", "fire", "--circle", "700,500,60", node="anna")
    assert ordered.exit_code == 0, ordered.output


def test_the_user_of_the_service_needs_no_options_on_its_machine(swarm: Swarm) -> None:
    seen = swarm.gcs("status")
    assert seen.exit_code == 0, seen.output


@pytest.mark.parametrize("node", ["vic", "radar"])
def test_who_may_not_order_is_told_at_once(swarm: Swarm, node: str) -> None:
    """A command that waited would meet the time limit of the test first."""
    refused = swarm.gcs("order", "hold", "--all", "--timeout", "600", node=node)
    assert refused.exit_code == 2
    assert f".{node} may not" in refused.output
    assert "its role is" in refused.output


def test_a_node_that_is_not_admitted_is_told_so_and_shown_to_the_operators(swarm: Swarm) -> None:
    refused = swarm.gcs("order", "hold", "--all", "--timeout", "2", node="late")
    assert refused.exit_code == 1
    assert "is operator.late in its nodes.toml?" in refused.output
    assert "operator.late connected and may do nothing here" in swarm.log()


def test_without_a_certificate_the_option_is_named(swarm: Swarm) -> None:
    arguments = ["order", "hold", "--all", "--mission", MISSION, "--zenoh", swarm.endpoint]
    refused = CliRunner(env={"COLUMNS": "200"}).invoke(app, arguments)
    assert refused.exit_code == 2
    assert "--zenoh-tls FOLDER" in refused.output


def test_a_certificate_of_another_authority_is_told_so(swarm: Swarm, tmp_path: Path) -> None:
    make_certificate_authority(tmp_path / "ca", 30)
    folder = make_node(tmp_path / "ca", "anna", "operator", [], 30)
    refused = swarm.gcs("order", "hold", "--all", "--timeout", "1", tls=folder)
    assert refused.exit_code == 1
    assert "the certificate there is not valid" in refused.output


def test_a_simulated_world_that_would_be_refused_says_why_and_starts_nothing(
    swarm: Swarm, tmp_path: Path
) -> None:
    make_certificate_authority(tmp_path / "ca", 30)
    foreign = make_node(tmp_path / "ca", "sim", "command", [], 30)
    for tls, words in ((swarm.tls["radar"], "a certificate of the role command"), (foreign, "is not valid")):
        arguments = ["run", MISSION, "--zenoh", swarm.endpoint, "--zenoh-tls", str(tls)]
        refused = CliRunner(env={"COLUMNS": "200"}).invoke(sim_vehicles, arguments)
        assert refused.exit_code == 2
        assert words in refused.output


@pytest.mark.real_time
def test_nothing_secret_is_in_logs_and_recordings_and_nothing_refused_was_taken(tmp_path: Path) -> None:
    swarm = Swarm(tmp_path, tmp_path)
    swarm.until_ready()
    assert swarm.gcs("order", "no-fly-zone", "fire", "--circle", "700,500,60", node="anna").exit_code == 0
    assert swarm.gcs("order", "hold", "--all", "--timeout", "2", node="late").exit_code == 1
    with ZenohSession(connect=swarm.endpoint, tls=swarm.tls["vic"]) as viewer:
        viewer.node = None  # a program that does not check its own rights
        message = OrderMessage(order_id="rogue", action="hold", vehicles="all")
        for _ in range(20):
            viewer.publish(order_key(MISSION), encode_order(message))
            viewer.publish(scan_key(MISSION, "radar"), b"{}")
            viewer.publish(f"swarm/{MISSION}/status_request", encode_order(message))
            time.sleep(0.1)
    swarm.end()
    records = [record.value for record in read(swarm.folder / "run")]
    assert [one.action for one in records if isinstance(one, Order) and one.action != "status"] == [
        "no-fly-zone"
    ]
    assert not any(isinstance(one, Scan) for one in records)
    codes = {one.code for one in records if isinstance(one, Notice)}
    assert NoticeCode.NODE_WITHOUT_RIGHTS in codes
    files = [file for name in ("run", "log", "journal") for file in files_in(swarm.folder / name)]
    content = b"".join(file.read_bytes() for file in files)
    assert content
    for folder in (*swarm.tls.values(), swarm.folder / "ca"):
        for file in folder.glob("*.key"):
            lines = [line for line in file.read_text().splitlines() if "-----" not in line]
            assert not any(line.encode() in content for line in lines)
            assert base64.b64decode("".join(lines))[-100:] not in content


def files_in(path: Path) -> list[Path]:
    return [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
