"""CPU time of recording in flight: the writer thread's part of the service, over real sockets.

``python tests/bench/bench_recorder.py [SCENARIO] [--duration 60] [--pack 25]`` flies a demo in this process.
The vehicles and the world are other processes. It prints the CPU time of the writer thread, and of the whole
process in the same period, so that the load of the machine matters little. Handing records to the thread is
not measured.
"""

import argparse
import tempfile
from collections import Counter
from pathlib import Path
from time import monotonic_ns, process_time_ns, thread_time_ns
from typing import Any

from rich.console import Console

from gcs.cli.fly.demo_flight import run_demo
from gcs.cli.fly.demo_simulation import DemoOptions, DemoSimulation
from gcs.io.recording.part import RecordingPart
from gcs.io.recording.recorder_thread import RecorderThread
from gcs.service.service import Service

spent_ns = Counter[str]()
record_count = 0


def measure(owner: Any, name: str, row: str) -> None:
    """Add the CPU time of a method to a row."""
    function = getattr(owner, name)

    def measured(*arguments: Any) -> Any:
        began_ns = thread_time_ns()
        try:
            return function(*arguments)
        finally:
            spent_ns[row] += thread_time_ns() - began_ns

    setattr(owner, name, measured)


def measure_service() -> None:
    """Measure the process from the start to the end of the service."""
    run_service = Service.run

    async def run(self: Service, *arguments: Any, **options: Any) -> None:
        before = process_time_ns(), monotonic_ns()
        spent_ns.clear()
        await run_service(self, *arguments, **options)
        spent_ns["service"] = process_time_ns() - before[0]
        spent_ns["wall"] = monotonic_ns() - before[1]
        assert isinstance(self.recorder, RecorderThread)
        global record_count
        record_count = self.recorder._written_count

    Service.run = run  # type: ignore[method-assign]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="swarm-50")
    parser.add_argument("--duration", type=float, default=60.0)
    parser.add_argument("--pack", type=int, default=25)
    options = parser.parse_args()
    measure(RecorderThread, "_write", "recording")
    measure(RecordingPart, "flush", "flush")
    measure_service()
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "run"
        demo = DemoOptions(
            scenario=options.scenario, speed=1.0, seed=1, headless=True, out=folder,
            duration_s=options.duration, as_json=False, loss=0.0, pack=options.pack,
        )  # fmt: skip
        with DemoSimulation(demo) as simulation:
            run_demo(simulation, Console(quiet=True))
        mcap_mb = sum(path.stat().st_size for path in folder.glob("*.mcap")) / 1e6
    wall_s = spent_ns["wall"] / 1e9
    name, rate_hz = Path(options.scenario).stem, record_count / wall_s
    print(f"| {name}, {wall_s:.0f} s, {rate_hz:.0f} records a second | ms a second | % |\n|---|---|---|")
    rows = {
        "service": spent_ns["service"],
        "recording": spent_ns["recording"],
        "… records": spent_ns["recording"] - spent_ns["flush"],
        "… compression, index, and handing to the system": spent_ns["flush"],
    }
    for row, ns in rows.items():
        print(f"| {row} | {ns / 1e6 / wall_s:.2f} | {100 * ns / spent_ns['service']:.2f} |")
    print(f"\nMCAP: {mcap_mb / wall_s * 60:.2f} MB a minute")


if __name__ == "__main__":
    main()
