"""Real firmware in place of simulated autopilots: command lines, the launch, a mission with the binary."""

import json
import os
import socket
import subprocess
import sys
import tempfile
import threading
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.errors import SimulationError
from gcs.geo import LocalFrame
from gcs.io.clock import RunClock
from gcs.io.zenoh.session import free_endpoint
from gcs.model import NS_PER_S
from sim_vehicles.autopilots.firmware import (
    Launch,
    Ports,
    Stage,
    arduplane_command,
    parse_sitl,
    px4_command,
    true_place,
)
from sim_vehicles.autopilots.firmware_process import fly
from sim_vehicles.supervisor import SimulationPlan, Supervisor
from sim_vehicles.vehicle.frames import FrameReader, Outbox
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec
from sim_vehicles.world.scenario import load

GCS = [sys.executable, "-P", "-c", "from gcs.cli import main; main()"]
FRAME = LocalFrame(33.2, -87.6, 50.0)
SPEC = VehicleSpec(3, 120.0, 720.0, 1.5707963, 100.0, 15.0, airborne=False, wind_east_m_s=6.0)


@pytest.mark.parametrize("text", ["arduplane", "arduplane=", "copter=/bin/true", "arduplane=/no/such/file"])
def test_a_wrong_sitl_option_is_named(text: str) -> None:
    with pytest.raises(SimulationError, match="--sitl"):
        parse_sitl(text)


def test_a_program_is_found() -> None:
    assert parse_sitl(f"px4={sys.executable}") == ("px4", Path(sys.executable).resolve())


def test_arduplane_starts_at_the_scenarios_place_with_its_speed_and_wind(tmp_path: Path) -> None:
    command = arduplane_command(Path("/x/arduplane"), SPEC, FRAME, Ports(7001, 7002), 2, tmp_path)
    option = dict(pairwise(command))
    lat_deg, lon_deg, alt_m, heading_deg = map(float, option["--home"].split(","))
    assert FRAME.to_local(lat_deg, lon_deg) == pytest.approx((120.0, 720.0), abs=0.1)
    assert (alt_m, heading_deg) == (50.0, 90.0)
    assert option["--serial0"] == "udpclient:127.0.0.1:7001"
    assert (option["--sysid"], option["--instance"]) == ("3", "2")
    parameters = dict(line.split() for line in (tmp_path / "scenario.parm").read_text().splitlines())
    assert parameters["AIRSPEED_CRUISE"] == "15"
    assert (parameters["SIM_WIND_SPD"], parameters["SIM_WIND_DIR"]) == ("6", "270")  # from the west


def test_px4_takes_place_and_parameters_from_its_environment(tmp_path: Path) -> None:
    command, environment = px4_command(Path("/build/bin/px4"), SPEC, FRAME, 2, 3.0, tmp_path)
    assert command == ["/build/bin/px4", "-i", "2", "-d", "/build/etc"]
    assert environment["PX4_PARAM_MAV_SYS_ID"] == "3"
    assert environment["PX4_SIM_SPEED_FACTOR"] == "3"


def test_a_px4_starts_higher_than_the_end_of_its_return_by_default(tmp_path: Path) -> None:
    """It flies to its start in RTL, which ends 100 m above home unless told. Before, the launch failed."""
    _, environment = px4_command(
        Path("/build/bin/px4"), replace(SPEC, alt_rel_m=140.0), FRAME, 0, 1.0, tmp_path
    )
    assert environment["PX4_PARAM_RTL_RETURN_ALT"] == environment["PX4_PARAM_RTL_DESCEND_ALT"] == "140"


def test_px4_has_one_link_to_its_host_and_none_to_a_ground_station(tmp_path: Path) -> None:
    """Its start script sources the links as here; a second link to port 14550 is a second sender there."""
    _, environment = px4_command(Path("/build/bin/px4"), SPEC, FRAME, 2, 3.0, tmp_path)
    script = "alias mavlink='echo'; px4_instance=2\n. px4-rc.mavlink"
    done = subprocess.run(
        ["/bin/sh", "-c", script], env=environment, capture_output=True, text=True, check=True
    )
    (link,) = done.stdout.splitlines()
    assert "-u 14582 " in link
    assert link.endswith("-o 14542")


def test_a_px4_over_terrain_can_climb_as_steep_as_its_routes(tmp_path: Path) -> None:
    _, flat = px4_command(Path("/build/bin/px4"), SPEC, FRAME, 0, 1.0, tmp_path)
    _, hilly = px4_command(Path("/build/bin/px4"), replace(SPEC, climb_m_s=4.0), FRAME, 0, 1.0, tmp_path)
    assert hilly["PX4_PARAM_FW_T_CLMB_R_SP"] == "4"
    assert {"PX4_PARAM_FW_T_HRATE_FF", "PX4_PARAM_SIH_T_MAX"} <= hilly.keys() - flat.keys()
    assert float(hilly["PX4_PARAM_SIH_F_T_MAX"]) > float(flat["PX4_PARAM_SIH_F_T_MAX"]) > 2.0


def test_a_launch_ends_in_loiter_above_the_start() -> None:
    spec = replace(SPEC, parameters={"TKOFF_ALT": 100.0})
    vehicle, launch = SimVehicle(spec, FRAME, 0), Launch(spec, FRAME)
    reader, commands = FrameReader(), Outbox(250)
    t_ns = 0
    while launch.stage is not Stage.DONE:
        t_ns += NS_PER_S // 10
        assert t_ns < 200 * NS_PER_S, (launch.stage, launch.last_status)
        for data in vehicle.datagrams_to_send(t_ns):
            for message in reader.messages(data):
                launch.receive(message)
        for command in launch.poll(t_ns):
            commands.send(command)
        for data in commands.pop_datagrams():
            vehicle.receive_datagram(data, t_ns)
    assert vehicle.alt_rel_m == pytest.approx(100.0, abs=11.0)
    assert (vehicle.east_m - 120.0) ** 2 + (vehicle.north_m - 720.0) ** 2 < 300.0**2
    assert vehicle.autopilot.mode.name == "LOITER"


def test_a_status_text_in_chunks_is_whole_in_the_error_of_a_launch() -> None:
    """Before, the error had the last chunk alone."""
    launch = Launch(replace(SPEC, autopilot="px4"), FRAME)
    text = b"Preflight Fail: the compass is not calibrated and the gyro neither"
    for number, chunk in enumerate((text[:50], text[50:])):
        launch.receive(mavlink.MAVLink_statustext_message(3, chunk, 7, number))
    assert launch.last_status == text.decode()


@pytest.mark.parametrize(("autopilot", "asked"), [("ardupilot", 164), ("px4", 115)])
def test_only_the_true_state_that_a_firmware_has_is_asked_for(autopilot: str, asked: int) -> None:
    launch = Launch(replace(SPEC, autopilot=autopilot), FRAME)
    numbers = {int(command.param1) for command in launch.poll(0) if command.get_type() == "COMMAND_LONG"}
    assert numbers & {115, 164} == {asked}


def test_px4_is_in_manual_before_its_take_off_so_that_it_climbs_above_high_ground() -> None:
    launch = Launch(replace(SPEC, autopilot="px4"), FRAME)
    launch.receive(mavlink.MAVLink_sys_status_message(0, 0, mavlink.MAV_SYS_STATUS_PREARM_CHECK, *[0] * 10))
    modes = []
    for k in range(6):
        asked = [one for one in launch.poll(k * NS_PER_S) if getattr(one, "command", 0) == 176]
        modes += [(int(one.param2), int(one.param3)) for one in asked]
        main, sub = modes[-1]
        heartbeat = mavlink.MAVLink_heartbeat_message(1, 12, 1, main << 16 | sub << 24, 3, 3)
        heartbeat._header = mavlink.MAVLink_header(0, srcSystem=3, srcComponent=1)
        launch.receive(heartbeat)
    assert modes == [(1, 0)] * 3 + [(4, 2)] * 3


FIRMWARE = """#!%s
import signal, socket, sys, time
port = int(sys.argv[sys.argv.index("--serial1") + 1].rpartition(":")[2])
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
    link.settimeout(20.0)
    link.sendto(b"hello", ("127.0.0.1", port))
    heartbeats = 0
    while heartbeats < 3:
        data = link.recv(4096)
        heartbeats += data[0] == 0xFD and data[5] == 255 and data[7:10] == bytes(3)
print("three heartbeats of a ground station")
sys.exit(7)
"""


@pytest.fixture
def ended_firmware(tmp_path: Path) -> Path:
    """A firmware that ends with code 7 after three heartbeats of a ground station."""
    binary = tmp_path / "firmware"
    binary.write_text(FIRMWARE % sys.executable)
    binary.chmod(0o755)
    return binary


def started(binary: Path, folder: Path | None) -> Supervisor:
    plan = SimulationPlan(
        load("prescribed"), 1, 1.0, ("127.0.0.1", 9), free_endpoint(), "listen",
        sitl={"arduplane": binary}, folder=folder,
    )  # fmt: skip
    supervisor = Supervisor(plan, lambda _event: None)
    with pytest.raises(SimulationError, match="did not start"):
        supervisor.start()
    return supervisor


def test_a_failed_launch_leaves_its_log_in_a_relative_folder_and_heartbeats_came(
    ended_firmware: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    started(ended_firmware, Path("logs"))
    log = tmp_path / "logs" / "arduplane-1" / "firmware.log"
    assert log.read_text() == "three heartbeats of a ground station\n"


def test_the_log_of_a_failed_launch_is_kept_and_its_folder_is_named(
    ended_firmware: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    started(ended_firmware, None)
    (log,) = tmp_path.glob("sim-vehicles-*/arduplane-1/firmware.log")
    assert log.stat().st_size > 0
    told = capfd.readouterr().err
    assert f"are kept in {log.parent.parent}" in told
    assert "vehicle 1 waits until it can be armed" in told, "a launch takes minutes"


@pytest.mark.real_time
def test_a_demo_leaves_the_logs_of_the_firmware_beside_the_recording(
    ended_firmware: Path, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    for folder in ("firmware", "firmware-2"):  # The second run replaces an empty recording, but no log.
        done = subprocess.run(
            [*GCS, "demo", "--headless", "--out", str(run), "--sitl", f"arduplane={ended_firmware}"],
            capture_output=True, text=True, timeout=100, check=False,
        )  # fmt: skip
        assert done.returncode == 2, done.stderr
        log = run / folder / "arduplane-1" / "firmware.log"
        assert log.read_text() == "three heartbeats of a ground station\n"
        assert f"see {log}" in done.stderr


class LostHost:
    """Host of a vehicle that was lost, to which datagrams still come."""

    def __init__(self, sockets: list[socket.socket]) -> None:
        self.sockets = sockets
        self.asked = 0

    @property
    def has_ended(self) -> bool:
        self.asked += 1
        return True


def test_what_is_still_sent_to_a_lost_vehicle_costs_no_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its process took a whole core until the flight ended, and the others fell behind the clock."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    stdin, writer = os.pipe()
    monkeypatch.setattr(sys, "stdin", os.fdopen(stdin))
    theirs.send(b"heartbeat")
    threading.Timer(0.5, os.close, [writer]).start()
    host = LostHost([ours])
    fly(host, RunClock())
    assert host.asked < 30  # each 50 ms
    ours.close()
    theirs.close()


def test_only_the_simulations_own_messages_are_the_truth() -> None:
    vehicle = SimVehicle(SPEC, FRAME, 0)
    assert true_place(vehicle.truth_messages(0)[0]) is None


@pytest.mark.parametrize("name", ["arduplane", "px4"])
@pytest.mark.timeout(600)
def test_real_firmware_flies_a_mission(tmp_path: Path, name: str) -> None:
    binary = os.environ.get(name.upper())
    if not binary:
        pytest.skip(f"{name.upper()} names no firmware binary")
    done = subprocess.run(
        [*GCS, "demo", "prescribed", "--headless",
         "--speed", "4" if name == "arduplane" else "1.5", "--json", "--out", str(tmp_path / "run"),
         "--sitl", f"{name}={binary}"],
        capture_output=True, text=True, timeout=550, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    result = json.loads(done.stdout.strip().splitlines()[-1])
    assert result["outcome"] == "complete"
    assert result["upload_failures"] == 0
    logs = {"arduplane": "logs/*.BIN", "px4": "log/*/*.ulg"}[name]
    for vehicle in range(1, 5):
        folder = tmp_path / "run" / "firmware" / f"{name}-{vehicle}"
        assert list(folder.glob(logs)), vehicle
        assert "unknown param" not in (folder / "firmware.log").read_text(errors="replace"), vehicle
