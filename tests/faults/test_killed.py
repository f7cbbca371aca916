"""Central command is killed in mid-flight and started again: real processes, real sockets, a real SIGKILL."""

from __future__ import annotations

import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.processes import GCS, Run
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.snapshot import decode_state
from gcs.model import AgentStatus, MissionEnded, NoticeCode, Plan, Resumed, UploadReport


class GroundStation:
    """Another ground station at the forward endpoint, by pymavlink."""

    def __init__(self, port: int) -> None:
        self.link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=254)

    def talk(self, vehicle: int, first: Any, kinds: list[str], until: Callable[[Any], bool]) -> None:
        """Send, and send again each second, until a vehicle's answer is the one that was waited for."""
        deadline = time.monotonic() + 30.0
        while time.monotonic() < deadline:
            self.link.mav.heartbeat_send(6, 8, 0, 0, 4)
            self.link.mav.send(first)
            while answer := self.link.recv_match(type=kinds, blocking=True, timeout=1.0):
                if answer.get_srcSystem() == vehicle and until(answer):
                    return
        raise AssertionError(f"vehicle {vehicle} did not answer {first}")

    def write(self, vehicle: int, items: int) -> None:
        def answer(message: Any) -> bool:
            if message.get_type() == "MISSION_ACK":
                return bool(message.type == 0)
            place = (message.seq, 3, 16, message.seq == 0, 1, 0, 10, 0, 0, 332_010_000, -875_990_000, 120.0)
            self.link.mav.mission_item_int_send(vehicle, 1, *place)
            return False

        count = dialect.MAVLink_mission_count_message(vehicle, 1, items)
        self.talk(vehicle, count, ["MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"], answer)

    def count(self, vehicle: int) -> int:
        counts: list[int] = []
        ask = dialect.MAVLink_mission_request_list_message(vehicle, 1)
        self.talk(vehicle, ask, ["MISSION_COUNT"], lambda m: counts.append(m.count) or True)  # type: ignore[func-returns-value]
        return counts[0]


def has_external_mission(journal: Path, vehicle: int) -> bool:
    state = decode_state("journal", journal.read_bytes().partition(b"\n")[2])
    upload = state.agents[vehicle].authority.external_upload
    return upload is not None and upload.has_ended


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Run]:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    running = Run(tmp_path, speed=4.0)
    yield running
    running.end()


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_killed_and_started_again_it_uploads_nothing_twice_and_all_arrive(run: Run) -> None:
    first = run.serve("first")
    run.until("first", lambda said: said.count("verified by read-back") == 4)
    order = [*GCS, "order", "hold", "-v", "2", "--json"]
    held = subprocess.run(order, capture_output=True, text=True, check=False, timeout=60)
    assert held.returncode == 0, held.stderr
    first.send_signal(signal.SIGKILL)
    first.wait()
    run.serve("second")
    run.until_told("second", NoticeCode.ONBOARD_VERIFIED, 4)
    order = [*GCS, "order", "resume", "-v", "2"]
    resumed = subprocess.run(order, capture_output=True, text=True, check=False, timeout=60)
    assert resumed.returncode == 0, resumed.stderr
    run.until("second", lambda _: bool(run.all("second", MissionEnded)), 150.0)
    run.services[-1].send_signal(signal.SIGINT)
    assert run.services[-1].wait(20.0) == 0
    assert len(run.all("first", UploadReport)) == 4
    assert len(run.all("second", Resumed)) == 1
    assert [(one.arrived, one.lost) for one in run.all("second", MissionEnded)] == [((1, 2, 3, 4), ())]
    assert [report.vehicle for report in run.all("second", UploadReport)] in ([], [2])
    assert {f.vehicle for f in run.all("second", AgentStatus) if f.status == "arrived"} == {1, 2, 3, 4}
    assert "taken up again" in run.all("second", Plan)[0].reason
    replay = [*GCS, "replay", run.folder / "second", "--verify"]
    verified = subprocess.run(replay, capture_output=True, text=True, check=False, timeout=120)
    assert verified.returncode == 0, verified.stdout
    run.serve("third")
    run.until_told("third", NoticeCode.IN_CONTACT)
    assert not run.all("third", Resumed)  # the mission had ended


@pytest.mark.slow
def test_a_vehicle_under_another_ground_station_stays_so_when_the_service_is_killed(run: Run) -> None:
    first = run.serve("first")
    run.until("first", lambda said: said.count("verified by read-back") == 4)
    GroundStation(run.seat).write(3, 7)
    (wrote, *_) = run.until_told("first", NoticeCode.STATION_WROTE)
    assert wrote.parameters["station"].startswith("system 254")
    deadline = time.monotonic() + 10.0
    while not has_external_mission(run.folder / "journal", 3) and time.monotonic() < deadline:
        time.sleep(0.05)
    first.send_signal(signal.SIGKILL)
    first.wait()
    run.serve("second")
    run.until_told("second", NoticeCode.ONBOARD_VERIFIED, 3)
    (resumed,) = run.until_told("second", NoticeCode.RESUMED)
    assert "agent 3 under other control" in resumed.parameters["contents"]
    run.until("second", lambda said: "taken up again" in said)
    assert GroundStation(run.seat).count(3) == 7
    run.services[-1].send_signal(signal.SIGINT)
    assert run.services[-1].wait(20.0) == 0
    assert 3 not in [report.vehicle for report in run.all("second", UploadReport)]
    assert all(route.vehicle != 3 for plan in run.all("second", Plan) for route in plan.routes)
