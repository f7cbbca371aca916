"""Returns of all by missions, and holds, flown by real firmware with a fault in the middle of each.

``python tests/bench/bench_returns.py --sitl arduplane=PATH`` (or ``px4=PATH``) flies four vehicles whose
homes are 40 m apart, with ``sim-vehicles run --sitl`` and ``gcs run``. In each trial all are ordered to
return, which gives those that RTL would lead near another one missions in altitude layers of their own. Then
something happens (see --help for the kinds), and at last all are resumed and fly out again.

One row per trial: messages that steer after a mode that is not ours, the nearest pair by true positions,
pairs nearer than 30 m and 15 m in height, uploads, those that were verified without an equal read-back, and
alarms with warnings. With --keep the recordings stay. What was told is printed with its time after the order.
"""

import argparse
import random
import re
import secrets
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench_override import with_second_link
from flown_links import Relay, Station
from returns_trials import KINDS, Trial
from returns_watch import Reader, near_pairs

from gcs.errors import GcsError
from gcs.io.record_json import decode
from gcs.io.zenoh.discovery import ServiceAddress
from gcs.io.zenoh.key_expressions import truth_key
from gcs.io.zenoh.order_client import send_order
from gcs.io.zenoh.order_messages import OrderMessage
from gcs.io.zenoh.session import ZenohSession
from gcs.model import NS_PER_S, Truth, TruthObject

VEHICLES = (1, 2, 3, 4)
NAME = "returns"
RETURNS = [kind for kind, one in KINDS.items() if "no return" not in one.words and one.layers > 1]
ALT_MSL_M = 70.0
OUTWARD_S = {"loiter": 25.0, "land": 60.0}
FIELD = """
name = "{name}"
[frame]
lat_deg = 33.2
lon_deg = -87.6
alt_msl_m = {ground}
[map]
width_m = 9000.0
height_m = 3000.0
nodes_east = 91
nodes_north = 31
[links]
mavlink = "udpin:127.0.0.1:{mavlink}"
zenoh = "tcp/127.0.0.1:{zenoh}"
[mission]
altitude_rel_m = 80.0
layer_step_m = 30.0
layers = {layers}
end = "{end}"
[airframe]
speed_m_s = {speed}
[simulation]
forward_speed_m_s = {speed}
{more}
[simulation.sensor]
period_s = 0.5
clutter_per_scan = 0.0
"""


def mission_file(options: argparse.Namespace, firmware: str, folder: Path) -> Path:
    """Write the mission file; return its path."""
    more = f"px4 = {list(VEHICLES)}\n"
    more += "parameters = { RTL_TYPE = 1, COM_LOW_BAT_ACT = 3, RTL_DESCEND_ALT = 35.0 }"
    if firmware == "arduplane":
        more = "parameters = { BATT_LOW_VOLT = 10.5, BATT_FS_LOW_ACT = 1 }"
    speed = {"arduplane": 18.0, "px4": 12.0}[firmware]
    layers = KINDS[options.kinds[0]].layers
    ports = {"mavlink": options.port + 3, "zenoh": options.port + 1}
    shared = {"ground": ALT_MSL_M, "end": options.end, "layers": layers}
    text = FIELD.format(name=NAME, speed=speed, more=more, **ports, **shared)
    for vehicle in VEHICLES:
        home_m, target_m = (400.0, 1400.0 + 40.0 * vehicle), (8700.0, 500.0 * vehicle)
        if layers == 1:  # one behind the other, on one line
            home_m, target_m = (400.0 + 160.0 * vehicle, 1500.0), (7500.0 + 200.0 * vehicle, 1500.0)
        text += f"[[agents]]\nsystem_id = {vehicle}\ncourse_deg = 90.0\n{place(home_m)}"
        for table in ("births", "simulation.targets"):
            text += f"[[{table}]]\n{place(target_m)}"
    path = folder / "returns.toml"
    path.write_text(text, encoding="utf-8")
    return path


def place(place_m: tuple[float, float]) -> str:
    """Return a place as lines of a mission file."""
    return "east_m = {}\nnorth_m = {}\n".format(*place_m)


class Flight:
    """The vehicles, and central command as often as it is started."""

    def __init__(self, options: argparse.Namespace, folder: Path) -> None:
        self.folder, self.loss = folder, options.loss
        firmware, _, path = options.sitl.partition("=")
        binary = Path(path).resolve()
        self.station = Station(firmware, VEHICLES, options.port + 10)
        if firmware == "arduplane":
            binary = with_second_link(binary, folder, options.port + 10)
        self.file = mission_file(options, firmware, folder)
        self.truth = f"tcp/127.0.0.1:{options.port + 2}"
        self.address = ServiceAddress(NAME, f"tcp/127.0.0.1:{options.port + 1}", None)
        self.relay = Relay(options.port, options.port + 3)
        self.relay.lost = dict.fromkeys(VEHICLES, options.loss)
        self.relay.start()
        self.truths: list[Truth] = []
        self.runs: list[Path] = []
        self.serve()
        command = [sys.executable, "-P", "-m", "sim_vehicles", "run", str(self.file)]
        command += ["--gcs", f"127.0.0.1:{options.port}"]
        command += ["--sitl", f"{firmware}={binary}", "--sitl-folder", str(folder / "firmware")]
        command += ["--zenoh", f"{self.address.zenoh},{self.truth}"]
        command += ["--until-stdin-closes", "--seed", str(options.seed)]
        with (folder / "vehicles.log").open("w") as log:
            self.world = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=log, stderr=log)

    def serve(self) -> None:
        """Start central command; it resumes from its journal."""
        self.runs.append(self.folder / f"run{len(self.runs)}")
        command = [sys.executable, "-P", "-c", "from gcs.cli import main; main()", "run", str(self.file)]
        command += ["--headless", "--out", str(self.runs[-1]), "--journal", str(self.folder / "journal")]
        with (self.folder / f"{self.runs[-1].name}.log").open("w") as log:
            self.service = subprocess.Popen(command, stdout=log, stderr=log)

    def order(self, action: str, *, until_done: bool = False) -> str:
        """Give an order to all; return the first answer, or with `until_done` all answers."""
        message = OrderMessage(order_id=f"{action}-{secrets.token_hex(6)}", action=action, vehicles="all")
        said = []
        try:
            for one in send_order(self.address, message, 5.0, 20.0):
                said.append(f"{one.vehicle or 'all'} {one.state} {one.detail}")
                if not until_done:
                    break
        except GcsError as error:
            said.append(str(error))
        return "; ".join(said)

    def fly(self, trial: Trial) -> None:
        """Fly one trial, and resume all; those that would come near others when they are apart."""
        trial.began_ns = time.time_ns()
        KINDS[trial.kind].happen(self, trial)
        time.sleep(KINDS[trial.kind].watch_s)
        self.relay.lost = dict.fromkeys(VEHICLES, self.loss)
        for _ in range(6):
            said = self.order("resume", until_done=True)
            trial.said.append(f"resume: {said}")
            time.sleep(5.0)
            if "accepted" not in said:
                break

    def vehicles(self) -> list[TruthObject]:
        """Return the true places of the vehicles that fly."""
        return [one for one in self.truths[-1].objects if one.kind == "agents" and one.alive]

    def place(self, vehicle: int) -> TruthObject:
        """Return the true place of a vehicle."""
        return next(one for one in self.vehicles() if one.id == vehicle)

    def wait(self, log: str, words: str) -> None:
        """Wait until a log has these words."""
        while words not in (self.folder / log).read_text():
            if self.world.poll() is not None or self.service.poll() is not None:
                raise SystemExit(f"a process has ended: see the logs in {self.folder}")
            time.sleep(0.2)

    def wait_for_service(self) -> None:
        """Wait until central command has started."""
        self.wait(self._log().name, "MAVLink on")

    def mark(self) -> int:
        """Return how much central command has told until now."""
        return len(self._log().read_text())

    def named(self, words: re.Pattern[str], begins: int) -> int:
        """Return the first vehicle that central command named in some words since a mark; 0 for none."""
        found = words.search(self._log().read_text()[begins:])
        return 0 if found is None else int(found[1])

    def _log(self) -> Path:
        return self.folder / f"{self.runs[-1].name}.log"

    def end(self) -> None:
        """End all processes."""
        self.service.terminate()
        self.service.wait(60.0)
        self.world.stdin.close()
        self.world.wait(30.0)


def fly(options: argparse.Namespace, folder: Path) -> tuple[list[Trial], list[Path], list[Truth]]:
    """Fly all trials; return them, the recordings, and the true positions."""
    rng = random.Random(options.seed)
    flight = Flight(options, folder)
    trials = []

    def keep(key: str, payload: bytes) -> None:
        flight.truths.append(decode(key, payload, Truth))

    with ZenohSession(listen=flight.truth) as bus:
        bus.subscribe(truth_key(NAME), keep)
        try:
            flight.wait("vehicles.log", "flying at speed")
            flight.wait("run0.log", "first plan")
            for number, kind in enumerate(options.kinds):
                time.sleep(OUTWARD_S[options.end])
                trial = Trial(kind, VEHICLES[(number + 1) % len(VEHICLES)], rng)
                trials.append(trial)
                flight.fly(trial)
                print(
                    f"{number} {kind} {trial.vehicle}: {'; '.join(trial.said)}", file=sys.stderr, flush=True
                )
        finally:
            flight.end()
    return trials, flight.runs, flight.truths


def print_rows(trials: list[Trial], reader: Reader, truths: list[Truth]) -> None:
    """Print a row for each trial, from its order to the next trial's."""
    print("| kind | steering messages after another mode | nearest pair | near pairs | uploads, failed "
          "| not read back equal | alarms |\n|---|---|---|---|---|---|---|")  # fmt: skip
    ends = [trial.began_ns for trial in trials[1:]] + [2**63]
    for trial, end_ns in zip(trials, ends, strict=True):

        def during(found: list[tuple[int, str]]) -> list[str]:
            return [f"{(t - trial.began_ns) / NS_PER_S:6.1f} s {text}"  # noqa: B023
                    for t, text in found if trial.began_ns <= t < end_ns]  # noqa: B023  # fmt: skip

        steered, unequal, uploads = map(during, (reader.steered, reader.unequal, reader.uploads))
        alarms = [text for text in during(reader.notices) if " s info" not in text]
        flown = [one for one in truths if trial.began_ns <= one.t_ns < end_ns]
        _, nearest, near = near_pairs(flown, ALT_MSL_M)
        failed = sum(" s failed" in text for text in uploads)
        print(f"| {trial.kind} | {len(steered)} | {nearest} | {len(near)} | {len(uploads)}, {failed} "
              f"| {len(unequal)} | {len(alarms)} |", flush=True)  # fmt: skip
        print(f"{trial.kind}, vehicle {trial.vehicle}: {'; '.join(trial.said)}", file=sys.stderr)
        for text in sorted([*steered, *unequal, *uploads, *during(reader.notices)]):
            print(f"  {text}", file=sys.stderr)


def main() -> None:
    kinds = "\n".join(f"  {kind}: {one.words}" for kind, one in KINDS.items())
    parser = argparse.ArgumentParser(
        description=__doc__, epilog=f"kinds:\n{kinds}", formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sitl", required=True, help="arduplane=PATH or px4=PATH")
    parser.add_argument(
        "--kinds",
        nargs="+",
        choices=KINDS,
        default=RETURNS,
        metavar="KIND",
        help="of trials, in turn; default all returns",
    )
    parser.add_argument("--end", choices=("loiter", "land"), default="loiter", help="of missions")
    parser.add_argument("--loss", type=float, default=0.0, help="on our links, such as 0.3; default 0")
    parser.add_argument("--seed", type=int, default=1, help="of the moments during uploads")
    parser.add_argument("--port", type=int, default=24700, help="the first of 14 ports")
    parser.add_argument("--keep", type=Path, help="folder for the recordings; they are not kept without it")
    options = parser.parse_args()
    if len({KINDS[kind].layers for kind in options.kinds}) > 1:
        parser.error("trials in one layer are flown by themselves")
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        trials, recordings, truths = fly(options, folder)
        reader = Reader(options.sitl.partition("=")[0], VEHICLES)
        for recording in recordings:
            reader.read(recording)
        print_rows(trials, reader, truths)


if __name__ == "__main__":
    main()
