"""Somebody who follows a guide beside a running service, word for word, would be stopped."""

from __future__ import annotations

import re
import urllib.request
from pathlib import Path

import pytest
from helpers.desk import DOCS, Desk, await_text
from helpers.pages import blocks, shown_commands
from helpers.processes import free_port

from gcs.config import read_text
from gcs.io.zenoh.session import free_endpoint

pytestmark = [pytest.mark.real_time, pytest.mark.timeout(300)]

VEHICLES = "sim-vehicles run mission.toml"
FIELD = re.sub(r"^\[links\]\n(?:[^\[\n].*\n)*", "", read_text("prescribed")[0], flags=re.MULTILINE)


def command_of(page: str, start: str) -> str:
    return next(line for line in shown_commands(DOCS / page) if line.startswith(start))


def test_orders_metrics_tak_and_foxglove_work_beside_a_running_service(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    desk.save("mission.toml", FIELD + desk.links)
    with (
        desk.started(desk.words("gcs run mission.toml"), "Ctrl-C ends it") as service,
        desk.started(desk.words(VEHICLES), "flying at speed 1"),
    ):
        for vehicle in (1, 3):
            await_text(service, f"agent {vehicle}: mode LOITER -> AUTO")
        held = desk.run(command_of("orders.md", "gcs order hold -v 1 -v 3"))
        for line in (
            "order hold accepted: agents 1, 3",
            "agent 1: order hold done",
            "agent 3: order hold done",
        ):
            assert line in held
        address = f"127.0.0.1:{free_port()}"
        metrics = [*desk.words(command_of("operations.md", "gcs metrics")), "--listen", address]
        url = f"http://{address}/metrics"
        with desk.started(metrics, url), urllib.request.urlopen(url, timeout=10.0) as answer:
            assert b"\nswarm_" in answer.read()
        tak = command_of("integrations.md", "gcs tak udp")
        with desk.started(desk.words(tak), f"prescribed: sending to {tak.split()[-1]}"):
            pass
        foxglove = [*desk.words(command_of("integrations.md", "gcs foxglove")), "--port", "0"]
        with desk.started(foxglove, "prescribed: in Foxglove open the connection ws://localhost:"):
            pass


def test_a_standby_started_by_the_guide_takes_over(tmp_path: Path) -> None:
    desk = Desk(tmp_path)
    run, standby = shown_commands(DOCS / "failover.md")[:2]
    links = blocks(DOCS / "failover.md", "toml")[0]
    for shown in ("tcp/127.0.0.1:7447", "tcp/127.0.0.1:7448"):
        assert shown in links
        links = links.replace(shown, desk.zenoh if shown.endswith("7") else free_endpoint())
    links += f'mavlink = "udpin:127.0.0.1:{desk.port}"\n'
    desk.save("mission.toml", f"{FIELD}\n{links}")
    with (
        desk.started(desk.words(run), "Ctrl-C ends it") as service,
        desk.started(desk.words(standby), "follows") as other,
        desk.started(desk.words(VEHICLES), "flying at speed 1"),
    ):
        await_text(service, "agent 1: mode LOITER -> AUTO")
        desk.processes[0].kill()
        await_text(other, "agent 1: its onboard mission is verified")
        assert "agents 4 active" in desk.run("gcs status")
