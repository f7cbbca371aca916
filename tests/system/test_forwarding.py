"""MAVSDK and MAVProxy at one forward endpoint work with all vehicles while these are being re-tasked."""

from __future__ import annotations

import asyncio
import json
import os
import queue
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from mavsdk import asyncio as mavsdk
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync

from gcs.config import read_text
from gcs.io.recording.reader import read
from gcs.model import UploadReport

SEARCH_PATH = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
MAVPROXY = shutil.which("mavproxy.py", path=SEARCH_PATH)
pytestmark = pytest.mark.skipif(
    MAVPROXY is None, reason="MAVProxy is not installed: pip install 'swarm-gcs[mavproxy]'"
)
VEHICLES = (1, 2, 3, 4)


class Program:
    """A program whose output is read as it comes, and whose input is a pipe."""

    def __init__(self, *command: str, home: Path) -> None:
        self.text = ""
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=home,
            env={**os.environ, "HOME": str(home), "PATH": SEARCH_PATH},
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        while chunk := os.read(self.process.stdout.fileno(), 4096):
            self.text += chunk.decode(errors="replace")

    def until(self, pattern: str, asking: str = "", seconds: float = 60.0) -> None:
        """Wait until the output holds a pattern; type `asking` every 2 s."""
        deadline, ask_at, seen = time.monotonic() + seconds, 0.0, len(self.text) if asking else 0
        while not re.search(pattern, self.text[seen:]):
            assert time.monotonic() < deadline, f"no {pattern!r} in:\n{self.text}"
            assert self.process.poll() is None, self.text
            if asking and time.monotonic() > ask_at:
                assert self.process.stdin is not None
                self.process.stdin.write(asking.encode() + b"\n")
                self.process.stdin.flush()
                ask_at = time.monotonic() + 2.0
            time.sleep(0.02)

    def interrupted(self) -> str:
        """Interrupt it; return all that it said."""
        self.process.send_signal(signal.SIGINT)
        self.process.wait(30.0)
        self._reader.join(5.0)
        return self.text

    def stop(self) -> None:
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                pipe.close()


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def restless(text: str, port: int) -> str:
    """The mission with targets so near to their limits that some agent is re-tasked all the time."""
    restless_keys = 'target_moved_m = 4.0\nperiod_s = 1.0\naim = "position"\n'
    assert "[planning]\n" in text
    text = text.replace("[planning]\n", f"[planning]\n{restless_keys}", 1)
    return text + f'\n[[links.forward]]\nendpoint = "udpin:127.0.0.1:{port}"\naccess = "full"\n'


async def work_with_all(port: int, found: queue.Queue[dict[int, int]], ends: threading.Event) -> None:
    """Find every vehicle, hear where it is and download its mission: `found` gets the items of each."""
    configuration = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
    async with mavsdk.Mavsdk(configuration) as client:
        await client.add_any_connection(f"udpout://127.0.0.1:{port}")
        systems: dict[int, object] = {}
        while set(systems) != set(VEHICLES):
            systems = {await system.get_system_id(): system for system in await client.get_systems()}
            await asyncio.sleep(0.05)
        items = {}
        for number, system in sorted(systems.items()):
            async for position in TelemetryAsync(system).subscribe_position():
                assert position.relative_altitude_m > 50.0
                break
            items[number] = len(await MissionRawAsync(system).download_mission())
        found.put(items)
        while not ends.is_set():  # it stays connected
            await asyncio.sleep(0.05)


def reports(recording: Path) -> list[UploadReport]:
    """Return how uploads ended. One may be under way to agent 4 when MAVProxy chooses LOITER for it."""
    values = (record.value for record in read(recording, only={UploadReport}))
    return [value for value in values if isinstance(value, UploadReport)]


@pytest.mark.real_time
def test_mavsdk_and_mavproxy_work_with_all_vehicles_while_missions_change(tmp_path: Path) -> None:
    port, mission = free_port(), tmp_path / "mission.toml"
    mission.write_text(restless(read_text("prescribed")[0], port))
    gcs = str(Path(sys.executable).parent / "gcs")
    executor = ThreadPoolExecutor(1)
    found: queue.Queue[dict[int, int]] = queue.Queue()
    ends = threading.Event()
    programs = [Program(gcs, "demo", str(mission), "--headless", "--json", "--pack", "4", home=tmp_path)]
    try:
        programs[0].until("first plan")
        proxy = Program(
            str(MAVPROXY),
            f"--master=udpout:127.0.0.1:{port}",
            f"--state-basedir={tmp_path}",
            "--default-modules=param,wp,mode,adsb",
            "--streamrate=-1",
            home=tmp_path,
        )
        programs.append(proxy)
        mavsdk_program = work_with_all(port, found, ends)
        working = executor.submit(lambda: asyncio.run(asyncio.wait_for(mavsdk_program, 90.0)))
        for number in VEHICLES:
            proxy.until(f"Detected vehicle {number}:1")
        for number in VEHICLES:
            proxy.until(f"vehicle {number}", asking=f"vehicle {number}\nwp list")
            proxy.until(r"Saved \d+ waypoints|Requesting \d+ waypoints", asking="wp list")
        proxy.until("Mode LOITER", asking="mode LOITER")
        programs[0].until("agent 4: .*MAV_CMD_DO_SET_MODE.*system 255")
        items = found.get(timeout=60.0)
        assert sorted(items) == list(VEHICLES)
        assert all(count >= 2 for count in items.values()), items
        programs[0].until(r"(?s)(re-tasked: \d.*){3}")  # the first plan, and two that change missions
        said = programs[0].interrupted()
        ends.set()
        working.result()
    finally:
        ends.set()
        for program in programs:
            program.stop()
        executor.shutdown()
    result = json.loads(said.strip().splitlines()[-1])
    failures = [one.detail for one in reports(tmp_path / result["recording"]) if not one.ok]
    assert all("LOITER was chosen meanwhile" in detail for detail in failures), failures
    assert result["retasks"] >= 2
    stations = result["links"][1]
    assert stations["role"] == "full"
    assert len(stations["other_ground_stations"]) == 2
    assert stations["passed"] > 20
    assert set(stations["refused"]) <= {"mission transfer under way", "for a vehicle that is not heard"}
