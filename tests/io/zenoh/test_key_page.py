"""A program in another language would use keys, or read fields, that the service does not have."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import time
from pathlib import Path

import pytest
import zenoh
from helpers.key_page import key_page

from gcs.geo import LocalFrame
from gcs.io.zenoh.access_control import RIGHTS
from gcs.io.zenoh.key_expressions import (
    KEYS,
    answer_key,
    bridge_key,
    console_feed_key,
    console_vehicle_key,
    events_key,
    order_key,
    scan_key,
    snapshot_key,
    status_key,
    status_request_key,
    truth_key,
)
from gcs.io.zenoh.scans import decode_scan
from gcs.io.zenoh.session import ZenohSession, free_endpoint

ROOT = Path(__file__).parents[3]
SENSOR = ROOT / "examples" / "zenoh_sensor.c"
NEWS_S = 20.0


def test_the_page_is_made_from_the_table() -> None:
    page = (ROOT / "docs" / "zenoh.md").read_text(encoding="utf-8")
    assert page == key_page(), "run: python tests/helpers/key_page.py > docs/zenoh.md"


def test_every_key_that_is_used_is_in_the_table() -> None:
    used = {
        scan_key("m", "n"), order_key("m"), answer_key("m"), status_key("m"), status_request_key("m"),
        truth_key("m"), console_feed_key("m"), console_vehicle_key("m", 1),
        events_key("m"), snapshot_key("m"),
        *(bridge_key("m", "n", what) for what in ("up", "down", "status", "lease")),
    }  # fmt: skip
    assert used <= {f"swarm/m/{re.sub('<vehicle>', '1', key.name).replace('<name>', 'n')}" for key in KEYS}


def test_every_right_is_one_to_a_key_of_the_table() -> None:
    keys = [zenoh.KeyExpr(re.sub("<[a-z]+>", "n", key.name)) for key in KEYS]
    for role, rights in RIGHTS.items():
        if role != "command":
            for text in {*rights.put, *rights.subscribe, *rights.query, *rights.answer}:
                right = zenoh.KeyExpr(text.format(name="n"))
                assert any(right.includes(key) for key in keys), f"{role}: {text}"


def test_ci_installs_what_the_sensor_in_c_needs_as_the_page_says() -> None:
    steps = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8").splitlines()
    page = (ROOT / "docs" / "zenoh.md").read_text(encoding="utf-8")
    install = re.findall(r"^(?:git|cmake) .*$", page, re.MULTILINE)
    assert len(install) == 3
    assert set(install) <= {step.strip() for step in steps}


def test_the_sensor_in_c_publishes_scans_and_prints_notices(tmp_path: Path) -> None:
    """Runs with zenoh-pico where a C compiler finds it (CPATH, LIBRARY_PATH, LD_LIBRARY_PATH)."""
    compiler = shutil.which("cc")
    program = tmp_path / "zenoh_sensor"
    flags = ["-Wall", "-Wextra", "-Werror", "-DZENOH_LINUX"]
    probe = ["-x", "c", "-E", "-include", "zenoh-pico.h", "/dev/null"]
    if (
        compiler is None
        or subprocess.run([compiler, *flags, *probe], capture_output=True, check=False).returncode
    ):
        pytest.skip("zenoh-pico is not installed: the sensor in C is neither compiled nor run")
    subprocess.run([compiler, *flags, str(SENSOR), "-lzenohpico", "-o", str(program)], check=True)
    endpoint = free_endpoint()
    scans: list[tuple[str, bytes]] = []
    with ZenohSession(listen=endpoint) as bus:
        bus.subscribe("swarm/m/sensor/*/scan", lambda key, payload: scans.append((key, payload)))
        with subprocess.Popen([program, endpoint, "m"], stdout=subprocess.PIPE, text=True) as sensor:
            try:
                until_s = time.monotonic() + NEWS_S
                while not (scans and bus.is_subscribed("swarm/m/notice")) and time.monotonic() < until_s:
                    time.sleep(0.05)
                bus.publish("swarm/m/notice", b'{"code":"agent-lost"}')
                assert sensor.stdout is not None
                assert json.loads(sensor.stdout.readline()) == {"code": "agent-lost"}
            finally:
                sensor.terminate()
    key, payload = scans[0]
    assert key == "swarm/m/sensor/radar-c/scan"
    frame = LocalFrame(33.2, -87.6, 0.0)
    assert decode_scan(key, payload, time.time_ns(), frame).sensor.name == "radar-c"
