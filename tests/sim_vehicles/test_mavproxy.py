"""MAVProxy, headless, takes the vehicle for a real ArduPlane: parameters, mission list, mode change."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from gcs.geo import LocalFrame
from sim_vehicles.vehicle.vehicle import VehicleSpec

SEARCH_PATH = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
MAVPROXY = shutil.which("mavproxy.py", path=SEARCH_PATH)
FRAME = LocalFrame(33.2, -87.6, 70.0)

pytestmark = pytest.mark.skipif(
    MAVPROXY is None, reason="MAVProxy is not installed: pip install 'swarm-gcs[mavproxy]'"
)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Proxy:
    """A MAVProxy whose console is a pipe."""

    def __init__(self, port: int, home: Path) -> None:
        command = [str(MAVPROXY), f"--master=udpin:127.0.0.1:{port}", f"--state-basedir={home}"]
        command += ["--default-modules=param,wp,mode", "--streamrate=2"]
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=home,
            env={**os.environ, "HOME": str(home), "PATH": SEARCH_PATH},
        )
        self.text = ""
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        while chunk := os.read(self.process.stdout.fileno(), 4096):
            self.text += chunk.decode(errors="replace")

    def say(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(line.encode() + b"\n")
        self.process.stdin.flush()

    def until(self, wanted: str, asking: str = "", seconds: float = 20.0) -> None:
        """Wait until the console shows `wanted`; ask for it every 3 s."""
        deadline, ask_at, seen = time.monotonic() + seconds, 0.0, len(self.text) if asking else 0
        while wanted not in self.text[seen:]:
            assert time.monotonic() < deadline, f"no {wanted!r} in:\n{self.text}"
            assert self.process.poll() is None, self.text
            if asking and time.monotonic() > ask_at:
                self.say(asking)
                ask_at = time.monotonic() + 3.0
            time.sleep(0.02)

    def stop(self) -> None:
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                pipe.close()


@pytest.fixture
def proxy(start_process, tmp_path):
    port = free_port()
    started = Proxy(port, tmp_path)
    start_process(port, VehicleSpec(7, 100.0, 200.0, 0.0, 100.0, 15.0), speed=4.0)
    yield started
    started.stop()


def waypoint_file(path: Path, places) -> None:
    lines = ["QGC WPL 110"]
    for seq, (east_m, north_m) in enumerate([(100.0, 200.0), *places]):
        lat, lon = FRAME.to_geodetic(east_m, north_m)
        lines.append(f"{seq}\t{int(seq == 0)}\t3\t16\t0\t15\t0\t0\t{lat:.8f}\t{lon:.8f}\t100\t1")
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.real_time
def test_connect_parameters_mission_and_modes(proxy, tmp_path):
    proxy.until("Detected vehicle 7:1")
    proxy.until("Received ")
    proxy.until("WP_LOITER_RAD    60.0", asking="param show WP_LOITER_RAD")
    proxy.until("WP_LOITER_RAD    80.0", asking="param set WP_LOITER_RAD 80\nparam show WP_LOITER_RAD")

    waypoint_file(tmp_path / "plan.txt", [(400.0, 200.0), (700.0, 300.0)])
    proxy.until("Loaded 3 waypoints", asking=f"wp load {tmp_path / 'plan.txt'}")
    lat, _ = FRAME.to_geodetic(700.0, 300.0)
    proxy.until(f"16 3 {lat:.5f}", asking="wp list")

    proxy.until("Mode AUTO", asking="mode AUTO")
    proxy.until("Mode RTL", asking="mode RTL")
