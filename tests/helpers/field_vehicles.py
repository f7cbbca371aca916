"""Two vehicles in a process of their own, for tests of the commands that come before a flight."""

from __future__ import annotations

import math
import selectors
import socket
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from gcs.config import parse, read_text
from gcs.config.key_overrides import override_keys
from gcs.geo import LocalFrame
from gcs.io.zenoh.session import free_endpoint
from sim_vehicles.process_start import Start, VehicleArguments, process_command
from sim_vehicles.vehicle.vehicle import VehicleSpec

FENCE = 'fence.areas=[{kind="exclusion", circle=[33.2, -87.57, 50.0]}]'
RALLY = "rally=[{lat_deg=33.202, lon_deg=-87.598, alt_rel_m=80}]"
READY = {"FS_GCS_ENABL": 1.0, "FENCE_ENABLE": 1.0}


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@pytest.fixture
def field(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A mission file of two vehicles, one of them with a failsafe that would glide it into the ground."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # no service of others is found
    port = free_port()
    links = [f'links.mavlink="udpin:127.0.0.1:{port}"', 'name="field"', FENCE, RALLY]
    links.append(f'links.forward=[{{endpoint="udpin:127.0.0.1:{free_port()}", access="full"}}]')
    links += [f'links.zenoh="{free_endpoint()}"', 'planning.retask="confirm"']
    text = override_keys(read_text("prescribed")[0], links, "prescribed")
    for system_id in (3, 4):
        start = text.index(f"[[agents]]\nsystem_id = {system_id}")
        ends = [at for at in (text.find("[[", start + 2), text.find("\n[", start + 2)) if at > 0]
        text = text[:start] + text[min(ends) :]
    text = text[: text.index("[simulation]")]
    path = tmp_path / "field.toml"
    path.write_text(text)
    specs = []
    for system_id, north_m, more in ((1, 200.0, {}), (2, 720.0, {"FS_LONG_ACTN": 2.0})):
        spec = VehicleSpec(system_id, 120.0, north_m, math.pi / 2, 100.0, 15.0, parameters=READY | more)
        specs.append(spec)
    with vehicle_process(specs, parse(text, "field").local_frame, port):
        yield path


@contextmanager
def vehicle_process(specs: Sequence[VehicleSpec], frame: LocalFrame, port: int) -> Iterator[None]:
    """Fly vehicles in a process of their own, which send to a UDP port of this machine."""
    arguments = VehicleArguments(frame, list(specs))
    command = process_command("vehicle.vehicle_process", arguments)
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdin is not None
    assert process.stdout is not None
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        assert selector.select(30), "the vehicles did not come up"
    process.stdout.readline()
    now_ns = time.time_ns()
    process.stdin.write(Start(now_ns, now_ns, 1.0, ("127.0.0.1", port)).line())
    process.stdin.flush()
    try:
        yield
    finally:
        process.kill()
        process.communicate()
