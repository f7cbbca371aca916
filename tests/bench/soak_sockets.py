"""An hour and more of flight over real sockets, and whether anything grows meanwhile.

``python tests/bench/soak_sockets.py [--hours 1] [--loss 0.05] [--speed 1]`` flies ``gcs demo`` with
vehicle processes, the world, zenoh and a recording. Its mission does not end: arrivals are not counted.
Every other minute an operator holds a vehicle, and resumes it, with ``gcs order``. It prints one row for
each sample: memory, open files, threads and CPU of the service; then what the flight came to. `soak.py` flies
days on virtual time, without sockets.
"""

import argparse
import collections
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

from gcs.config import read_text
from gcs.config.key_overrides import override_keys
from gcs.io.recording.reader import read
from gcs.model import NS_PER_S, AgentStatus, Notice, Tick

SETTINGS = (
    "mission.max_duration_s=200000",
    "simulation.death.survival_probability=1.0",
    "recording.rotate_mb=20",
)
ORDER_EVERY_S = 60.0
WITHOUT_ARRIVALS = (
    "from gcs.core.perception import arrival_and_loss; arrival_and_loss.ARRIVAL_EPOCHS = float('inf')"
)
GCS = [sys.executable, "-P", "-c", f"{WITHOUT_ARRIVALS}; from gcs.cli import main; main()"]


def fly(hours: float, loss: float, samples: int, speed: float, folder: Path) -> dict[str, object]:
    """Fly and print a row for each sample; return the summary of the run."""
    mission = folder / "soak.toml"
    mission.write_text(override_keys(read_text("random-targets")[0], SETTINGS, "soak"), encoding="utf-8")
    duration_s = hours * 3600.0
    command = [*GCS, "demo", str(mission), "--headless", "--json", "--out", str(folder / "run")]
    command += ["--duration", str(duration_s), "--loss", str(loss), "--speed", str(speed)]
    environment = os.environ | {"XDG_RUNTIME_DIR": str(folder)}
    with (folder / "log").open("w") as log:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True, env=environment)
    service, started_s, orders = psutil.Process(process.pid), time.monotonic(), 0
    next_order_s, next_sample_s = ORDER_EVERY_S, duration_s / samples / 2.0
    print(
        "| flown, s | resident, MB | open files | threads | CPU, % of a core | recording, MB |\n|"
        + "---|" * 6
    )
    while process.poll() is None:
        time.sleep(1.0)
        flown_s = speed * (time.monotonic() - started_s)
        if flown_s >= next_order_s:
            next_order_s += ORDER_EVERY_S
            action, vehicle = ("hold", "resume")[orders % 2], 1 + orders // 2 % 4
            subprocess.run(
                [*GCS, "order", action, str(vehicle)], env=environment, capture_output=True, check=False
            )
            orders += 1
        if flown_s >= next_sample_s and flown_s < duration_s:
            next_sample_s += duration_s / samples
            times = service.cpu_times()
            stored = sum(file.stat().st_size for file in (folder / "run").rglob("*") if file.is_file())
            print(
                f"| {flown_s:.0f} | {service.memory_info().rss / 1e6:.1f} | {service.num_fds()} "
                f"| {service.num_threads()} | {100.0 * speed * (times.user + times.system) / flown_s:.1f} "
                f"| {stored / 1e6:.0f} |",
                flush=True,
            )
    assert process.stdout is not None
    summary: dict[str, object] = json.loads(process.stdout.read().strip().splitlines()[-1])
    return summary | {"orders": orders}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--loss", type=float, default=0.05)
    parser.add_argument("--samples", type=int, default=12)
    parser.add_argument("--speed", type=float, default=1.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent)
        summary = fly(options.hours, options.loss, options.samples, options.speed, folder)
        notices, last_ns, gap_ns = collections.Counter[str](), 0, 0
        for record in read(folder / "run", only={Tick, Notice, AgentStatus}):
            if isinstance(record.value, Tick):
                gap_ns = max(gap_ns, record.t_ns - last_ns if last_ns else 0)
                last_ns = record.t_ns
            elif isinstance(record.value, Notice) and record.value.level != "info":
                notices[f"{record.value.level}: {record.value.code}"] += 1
            elif isinstance(record.value, AgentStatus):
                notices[f"seen {record.value.status}"] += 1
    keys = ("outcome", "reason", "duration_s", "retasks", "uploads", "upload_failures", "orders")
    print(", ".join(f"{key} {summary[key]}" for key in keys))
    print(f"longest gap of ticks {gap_ns / NS_PER_S:.2f} s")
    for text, count in notices.most_common():
        print(f"{count} x {text}")


if __name__ == "__main__":
    main()
