"""RTL by somebody else in the middle of an upload, with real firmware: is anything sent against it?

``python tests/bench/bench_override.py --sitl arduplane=PATH`` (or ``px4=PATH``) flies four vehicles with
``gcs demo --sitl`` towards targets far away. Missions end with a landing, which PX4 follows in RTL (RTL_TYPE
1). Again and again a vehicle gets another target by a pin, and a second ground station, on a link of its own,
commands RTL some time after the order, so that the RTL meets all stages of the upload. Then the vehicle is
resumed. One row per stage: what was sent last when the heartbeat showed RTL, how often, and how often a
message that steers was sent after it, or the vehicle left RTL before it was resumed.
"""

import argparse
import secrets
import socket
import stat
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from fault_watch import FaultWatch
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.errors import GcsError
from gcs.io.recording.reader import read
from gcs.io.zenoh.discovery import choose_service
from gcs.io.zenoh.order_client import send_order
from gcs.io.zenoh.order_messages import OrderMessage
from gcs.mavlink.frames.codec import scan
from gcs.model import NS_PER_S, Datagram, Notice, Order, Plan, Send

VEHICLES = (1, 2, 3, 4)
FIRST_PORT = 24600
PX4_PORT = 18570
RTL = {"arduplane": (11, 0), "px4": (4, 5)}
"""Mode and submode of DO_SET_MODE."""
RESUMED = "resumed"
RTL_MODE = {"arduplane": 11, "px4": 4 << 16 | 5 << 24}
FIELD = """
name = "override"
[frame]
lat_deg = 33.2
lon_deg = -87.6
alt_msl_m = 70.0
[map]
width_m = 9000.0
height_m = 3000.0
nodes_east = 91
nodes_north = 31
[mission]
altitude_rel_m = 80.0
layer_step_m = 30.0
layers = 4
end = "land"
[airframe]
speed_m_s = 18.0
[simulation]
forward_speed_m_s = 18.0
[simulation.sensor]
clutter_per_scan = 0.0
"""


class Station:
    """A second ground station, with a socket for each vehicle."""

    def __init__(self, firmware: str) -> None:
        self.encoder = mavlink.MAVLink(None, srcSystem=250, srcComponent=190)
        self.mode, self.sockets, self.addresses = RTL[firmware], {}, {}
        for number, vehicle in enumerate(VEHICLES):
            self.sockets[vehicle] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self.sockets[vehicle].setblocking(False)
            if firmware == "px4":
                self.addresses[vehicle] = ("127.0.0.1", PX4_PORT + number)
            else:
                self.sockets[vehicle].bind(("127.0.0.1", FIRST_PORT + number))

    def listen(self) -> None:
        """Read what the vehicles send, for their addresses."""
        for vehicle, one in self.sockets.items():
            while True:
                try:
                    _, self.addresses[vehicle] = one.recvfrom(2048)
                except BlockingIOError:
                    break

    def return_home(self, vehicle: int) -> None:
        """Command RTL, twice: a datagram may be lost."""
        self.listen()
        message = mavlink.MAVLink_command_long_message(
            vehicle, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1.0, *map(float, self.mode), 0.0, 0.0, 0.0, 0.0
        )
        for _ in range(2):
            self.sockets[vehicle].sendto(message.pack(self.encoder), self.addresses[vehicle])


def with_second_link(binary: Path, folder: Path, first_port: int = FIRST_PORT) -> Path:
    """Return a program that starts ArduPlane with a link for the second station on serial 2."""
    script = folder / "arduplane"
    script.write_text(
        "#!/bin/sh\n"
        'while [ $# -gt 0 ]; do case "$1" in --sysid) id="$2";; esac; set_="$set_ $1"; shift; done\n'
        f'set -- $set_; exec {binary} "$@" --serial2 "udpclient:127.0.0.1:$(({first_port} + id - 1))"\n'
    )
    script.chmod(script.stat().st_mode | stat.S_IXUSR)
    return script


def mission_file(firmware: str, folder: Path) -> Path:
    text = FIELD
    if firmware == "px4":
        text = text.replace(
            "[simulation]\n", f"[simulation]\npx4 = {list(VEHICLES)}\nparameters = {{ RTL_TYPE = 1 }}\n"
        )
        text = text.replace("speed_m_s = 18.0", "speed_m_s = 12.0")
    for vehicle in VEHICLES:
        north_m = 500.0 * vehicle
        text += f"[[agents]]\nsystem_id = {vehicle}\neast_m = 200.0\nnorth_m = {north_m}\ncourse_deg = 90.0\n"
        for table in ("births", "simulation.targets"):
            text += f"[[{table}]]\neast_m = 8800.0\nnorth_m = {north_m}\n"
    path = folder / "override.toml"
    path.write_text(text, encoding="utf-8")
    return path


def order(action: str, vehicle: int, target: str | None = None) -> str:
    """Give an order; return the last answer."""
    address = choose_service(None, None, None)
    message = OrderMessage(
        order_id=f"{action}-{secrets.token_hex(6)}", action=action, vehicles=[vehicle], target=target
    )
    try:
        for answer in send_order(address, message, 5.0, 5.0):
            if action == "pin":  # the upload begins at the next tick
                return f"{answer.state} {answer.detail}"
    except GcsError as error:
        return str(error)
    return f"{answer.state} {answer.detail}"


def fly(sitl: str, trials: int, loss: float, folder: Path) -> Path:
    """Fly, and interrupt uploads; return the recording."""
    firmware, _, path = sitl.partition("=")
    binary = Path(path).resolve()
    if firmware == "arduplane":
        binary = with_second_link(binary, folder)
    command = [sys.executable, "-P", "-c", "from gcs.cli import main; main()", "demo"]
    command += [str(mission_file(firmware, folder)), "--headless", "--out", str(folder / "run")]
    command += ["--sitl", f"{firmware}={binary}", "--loss", str(loss), "--duration", "590"]
    station = Station(firmware)
    with (folder / "log").open("w") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log)
        while process.poll() is None and "first plan" not in (folder / "log").read_text():
            time.sleep(0.2)
        time.sleep(10.0)
        for trial in range(trials):
            if process.poll() is not None:
                break
            vehicle = VEHICLES[trial % len(VEHICLES)]
            target = f"T0.{(trial + 1 + trial // len(VEHICLES)) % len(VEHICLES)}"
            said = order("pin", vehicle, target)
            time.sleep(0.1 * (trial % 16))
            station.return_home(vehicle)
            print(f"vehicle {vehicle}, pin to {target}: {said}", file=sys.stderr, flush=True)
            time.sleep(6.0)
            order("unpin", vehicle)
            print(f"resume {vehicle}: {order('resume', vehicle)}", file=sys.stderr, flush=True)
            time.sleep(3.0)
        process.terminate()
        process.wait(30.0)
    return folder / "run"


def print_rows(recording: Path, firmware: str) -> None:
    """Print one row per stage: RTL seen, steering messages after it, RTL left."""
    watches = {vehicle: FaultWatch("rc", vehicle) for vehicle in VEHICLES}
    last_sent, in_rtl = dict.fromkeys(VEHICLES, (0, "nothing")), dict.fromkeys(VEHICLES, "")
    seen, left, steered = Counter(), Counter(), Counter()
    for record in read(recording, only=(Datagram, Order, Notice, Plan, Send)):
        value = record.value
        if isinstance(value, Order) and value.action == "resume":
            in_rtl |= dict.fromkeys(value.vehicles or VEHICLES, RESUMED)
        if isinstance(value, Send):
            for frame in scan(value.data).frames:
                message = frame.message()
                vehicle = getattr(message, "target_system", 0)
                if message.get_type().startswith("MISSION_") and vehicle in VEHICLES:
                    last_sent[vehicle] = (record.t_ns, message.get_type())
        if isinstance(value, Datagram):
            for frame in scan(value.data).frames:
                vehicle = frame.system_id
                if frame.message_id != 0 or frame.component_id != 1 or vehicle not in VEHICLES:
                    continue
                mode = frame.message().custom_mode
                if mode == RTL_MODE[firmware] and not in_rtl[vehicle]:
                    sent_ns, kind = last_sent[vehicle]
                    in_rtl[vehicle] = kind if record.t_ns - sent_ns < 1.5 * NS_PER_S else "no upload"
                    seen[in_rtl[vehicle]] += 1
                elif mode != RTL_MODE[firmware]:
                    left[in_rtl[vehicle]] += in_rtl[vehicle] not in ("", RESUMED)
                    in_rtl[vehicle] = ""
        for vehicle, watch in watches.items():
            before = len(watch.steered)
            if isinstance(value, (Datagram, Order)):
                watch.event(value)
            else:
                watch.effect(record.t_ns, value)
            for text in watch.steered[before:]:
                if text.startswith(f"{vehicle}:"):
                    steered[in_rtl[vehicle] or "unknown"] += 1
                    print(text, file=sys.stderr)
    print("| last sent when RTL was seen | times | steering messages after | RTL left |\n|---|---|---|---|")
    for kind in sorted(seen):
        print(f"| {kind} | {seen[kind]} | {steered[kind]} | {left[kind]} |")
    print(f"| all | {seen.total()} | {steered.total()} | {left.total()} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sitl", required=True, help="arduplane=PATH or px4=PATH")
    parser.add_argument("--trials", type=int, default=24)
    parser.add_argument("--loss", type=float, default=0.3, help="on our link; default 0.3")
    parser.add_argument("--keep", type=Path, help="folder for the recording; it is not kept without it")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        recording = fly(options.sitl, options.trials, options.loss, folder)
        print_rows(recording, options.sitl.partition("=")[0])


if __name__ == "__main__":
    main()
