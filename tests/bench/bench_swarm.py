"""The load test: a swarm at speed 1 over real sockets, and whether every rate was held.

``python tests/bench/bench_swarm.py [SCENARIO] [--duration 300] [--pack 1]`` prints a table of CPU, memory,
rates and times. CPU and memory are sums over all processes of the side named; rates come from the recording.
``--agents 250 --rate-hz 50 --pack 125`` makes the swarm of that size, with position reports at that rate.
``--stop-s 5`` stops the service alone for so long in the middle of the flight (SIGSTOP), as a machine does
that has no time for it: the table then says how soon it is on time again.
"""

import argparse
import collections
import itertools
import json
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from gcs.config import read_text
from gcs.io.recording.reader import read
from gcs.mavlink.frames.codec import decode
from gcs.model import NS_PER_S, Datagram, Scan, Tick, UploadReport

COLUMNS = 10
SERVICE, SIMULATION = "central command", "the simulated side"


class Usage:
    """CPU seconds and peak memory of both sides, sampled while they run."""

    def __init__(self, pid: int) -> None:
        self._service = psutil.Process(pid)
        self._cpu_by_pid: dict[str, dict[int, float]] = {SERVICE: {}, SIMULATION: {}}
        self.memory_mb = {SERVICE: 0.0, SIMULATION: 0.0}

    def sample(self) -> None:
        try:
            sides = {SERVICE: [self._service], SIMULATION: self._service.children(recursive=True)}
        except psutil.NoSuchProcess:
            return
        for side, processes in sides.items():
            memory = 0
            for process in processes:
                try:
                    times = process.cpu_times()
                    memory += process.memory_info().rss
                except psutil.NoSuchProcess:
                    continue
                self._cpu_by_pid[side][process.pid] = times.user + times.system
            self.memory_mb[side] = max(self.memory_mb[side], memory / 1e6)

    def cpu_s(self, side: str) -> float:
        return sum(self._cpu_by_pid[side].values())


def percentiles(values: Any, which: tuple[int, ...], digits: int) -> str:
    return " / ".join(f"{np.percentile(values, p):.{digits}f}" for p in which)


def rates(folder: Path) -> list[tuple[str, str]]:
    """What the recording says of rates and delays."""
    scans: list[Scan] = []
    ticks: list[int] = []
    uploads: list[UploadReport] = []
    heard: dict[int, list[int]] = collections.defaultdict(list)
    for record in read(folder):
        value = record.value
        if isinstance(value, Scan):
            scans.append(value)
        elif isinstance(value, Tick):
            ticks.append(value.t_ns)
        elif isinstance(value, UploadReport):
            uploads.append(value)
        elif isinstance(value, Datagram):
            for message in decode(value.data)[0]:
                if message.get_type() == "GLOBAL_POSITION_INT":
                    heard[message.get_srcSystem()].append(value.t_ns)
    rates_hz = [(len(t) - 1) / (t[-1] - t[0]) * NS_PER_S for t in heard.values() if len(t) > 1]
    delays_ms = np.array([(scan.t_ns - scan.measured_t_ns) / 1e6 for scan in scans])
    gaps_s = np.diff([scan.measured_t_ns for scan in scans]) / NS_PER_S
    upload_s = [upload.duration_s for upload in uploads]
    failed = sum(not upload.ok for upload in uploads)
    return [
        ("scans", f"{len(scans)} at {1.0 / gaps_s.mean():.3f} Hz, longest gap {gaps_s.max():.2f} s"),
        ("scan delay, median / 99 % / worst", percentiles(delays_ms, (50, 99, 100), 0) + " ms"),
        ("gap of ticks, median / 99 % / worst", percentiles(np.diff(ticks) / 1e6, (50, 99, 100), 0) + " ms"),
        ("position reports, slowest / fastest vehicle", f"{min(rates_hz):.2f} / {max(rates_hz):.2f} Hz"),
        ("uploads, failed", f"{len(uploads)}, {failed}"),
        ("upload, median / 95 % / worst", percentiles(upload_s, (50, 95, 100), 2) + " s"),
    ]


def swarm(agents: int, rate_hz: float, folder: Path) -> Path:
    """Write `swarm-50` with so many agents, in ten columns along its western edge."""
    text, _ = read_text("swarm-50")
    head, *blocks = re.split(r"(?=^\[\[agents\]\])", text, flags=re.MULTILINE)
    rest = blocks[-1][re.search(r"^\[\[births", blocks[-1], re.MULTILINE).start() :]
    rows = -(-agents // COLUMNS)
    places = itertools.product(range(COLUMNS), range(rows))
    starts = [
        f"[[agents]]\nsystem_id = {n}\neast_m = {40.0 + 70.0 * column}\n"
        f"north_m = {120.0 + 5700.0 * row / rows}\n"
        for n, (column, row) in zip(range(1, agents + 1), places, strict=False)
    ]
    rest = re.sub(r"^rate_hz = [0-9.]+", f"rate_hz = {rate_hz}", rest, flags=re.MULTILINE)
    path = folder / "swarm.toml"
    path.write_text(head + "\n".join(starts) + "\n" + rest, encoding="utf-8")
    return path


def fly(
    scenario: str, duration_s: float, pack: int, folder: Path, stop_s: float = 0.0
) -> tuple[dict[str, Any], Usage, float]:
    """Run the demo; return its result, what it used, and how long it ran."""
    gcs = [sys.executable, "-P", "-c", "from gcs.cli import main; main()"]
    command = [*gcs, "demo", scenario, "--headless", "--json", "--out", str(folder)]
    command += ["--duration", str(duration_s), "--pack", str(pack)]
    started = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    usage = Usage(process.pid)
    while process.poll() is None and time.monotonic() - started < duration_s + 120.0:
        usage.sample()
        time.sleep(1.0)
        if stop_s and time.monotonic() - started > duration_s / 2.0:
            process.send_signal(signal.SIGSTOP)
            time.sleep(stop_s)
            process.send_signal(signal.SIGCONT)
            stop_s = 0.0
    wall_s = time.monotonic() - started
    assert process.stdout is not None
    return json.loads(process.stdout.read().strip().splitlines()[-1]), usage, wall_s


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="swarm-50")
    parser.add_argument("--duration", type=float, default=300.0)
    parser.add_argument("--pack", type=int, default=1)
    parser.add_argument("--agents", type=int, help="a swarm of so many, in place of SCENARIO")
    parser.add_argument("--rate-hz", type=float, default=4.0, help="of its position reports; default 4")
    parser.add_argument("--stop-s", type=float, default=0.0, help="the service stands still for so long")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "run"
        if arguments.agents:
            arguments.scenario = str(swarm(arguments.agents, arguments.rate_hz, Path(parent)))
        result, usage, wall_s = fly(
            arguments.scenario, arguments.duration, arguments.pack, folder, arguments.stop_s
        )
        lost = {key: sum(link[key] for link in result["links"]) for key in ("frames", "lost")}
        table = [
            ("outcome", f"{result['outcome']}: {result['reason']}"),
            ("run time", f"{result['duration_s']:.0f} s"),
            *rates(folder),
            ("frames heard, lost on their way", f"{lost['frames']}, {lost['lost']}"),
            ("scan work, 99 %", f"{result['scan_ms_p99']:.1f} ms"),
            ("plan work, 99 %", f"{result['plan_ms_p99']:.1f} ms"),
            (
                "OSPA agents / targets",
                f"{result['ospa_agents_mean_m']:.2f} / {result['ospa_targets_mean_m']:.2f} m",
            ),
        ]
    for side in (SERVICE, SIMULATION):
        table.append((f"CPU of {side}", f"{100.0 * usage.cpu_s(side) / wall_s:.0f} % of a core"))
        table.append((f"memory of {side}, peak", f"{usage.memory_mb[side]:.0f} MB"))
    print(f"| {arguments.scenario}, vehicles in a process: {arguments.pack} | |\n|---|---|")
    for name, value in table:
        print(f"| {name} | {value} |")


if __name__ == "__main__":
    main()
