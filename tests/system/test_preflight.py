"""The commands that come before a flight, against vehicles in processes of their own."""

from __future__ import annotations

import json
import subprocess
import sys
import time

import pytest
from click.testing import Result
from typer.testing import CliRunner

from gcs.cli import app
from gcs.io.zenoh.discovery import running_services


def gcs(*arguments: str) -> Result:
    return CliRunner(env={"COLUMNS": "200"}).invoke(app, arguments)


def test_a_fence_is_brought_and_a_bad_failsafe_keeps_the_swarm_on_the_ground(field):
    asked = gcs("fence", "upload", str(field))
    assert asked.exit_code == 2
    assert "--yes" in asked.stderr
    done = gcs("fence", "upload", str(field), "--yes", "--wait", "30", "--json")
    assert done.exit_code == 0, done.stdout + done.stderr
    steps = json.loads(done.stdout.splitlines()[-1])["vehicles"][0]["steps"]
    assert [(what, ok) for what, ok, _ in steps] == [("fence", True), ("rally", True)]

    checked = gcs("preflight", str(field), "--no-sensors", "--wait", "30", "--json")
    assert checked.exit_code == 1, checked.stdout + checked.stderr
    result = json.loads(checked.stdout.splitlines()[-1])
    refused = [
        (row["vehicle"], row["code"], row["name"], row["value"])
        for row in result["checks"]
        if row["level"] == "refused"
    ]
    assert refused == [(2, "parameter-wrong", "FS_LONG_ACTN", "2")]
    assert "when the link is lost, 2 glides" in checked.stderr
    rows = {(row["vehicle"], row["name"]): row["level"] for row in result["checks"]}
    assert {rows[1, name] for name in ("link", "GPS", "home", "clock", "fence", "rally", "RTL_ALTITUDE")} == {
        "ok"
    }
    assert rows[None, "routes"] == "ok"


@pytest.mark.real_time
def test_while_the_service_runs_preparations_go_through_it_and_vehicles_keep_its_heartbeats(field, tmp_path):
    arguments = [
        sys.executable,
        "-P",
        "-c",
        "from gcs.cli import main; main()",
        "run",
        str(field),
        "--headless",
        "--out",
        str(tmp_path),
    ]
    arguments += ["--journal", str(tmp_path / "journal")]
    service = subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        while not running_services():
            assert service.poll() is None
            time.sleep(0.1)
        done = gcs("fence", "upload", str(field), "--yes", "--json")
        assert done.exit_code == 0, done.stdout + done.stderr
        assert "through gcs run" in done.stderr
        done = gcs("param", "set", str(field), "FS_LONG_ACTN", "1", "--armed", "--yes", "--json")
        assert done.exit_code == 0, done.stdout + done.stderr
        rows = json.loads(done.stdout.splitlines()[-1])["parameters"]
        assert [(row["vehicle"], row["ok"], row["value"]) for row in rows] == [(1, True, 1.0), (2, True, 1.0)]
        checked = gcs("preflight", str(field), "--wait", "30", "--json")
        assert checked.exit_code == 0, checked.stdout + checked.stderr
    finally:
        service.terminate()
        service.wait(20)
