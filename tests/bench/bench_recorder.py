"""What recording costs in flight: the recorder's part of the service's CPU time, over real sockets.

``python tests/bench/bench_recorder.py [SCENARIO] [--duration 60] [--pack 25]`` flies a demo in this process
(the vehicles and the world are others) and prints the CPU time of the service's thread inside the recorder,
by what it does, against the CPU time of the whole process: two clocks of one run, so that load matters
little. Reading the thread's clock costs as much as taking a record, so calls that do nothing are timed
beside, and their time is taken off.
"""

import argparse
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from time import monotonic_ns, process_time_ns, thread_time_ns
from typing import Any

from rich.console import Console

from gcs.cli.fly.demo import DemoOptions, run_demo
from gcs.io.recording import packing
from gcs.io.recording.mcap_writer import McapWriter
from gcs.io.recording.writer import Recorder
from gcs.service.service import Service

NOTHING = "a call that does nothing"
ROWS = {
    "taking": "taking events and effects",
    "form": "JSON of pictures, plans and the like, and looking up forms",
    "pack": "datagrams as JSON messages and tlog entries",
    "chunk": "compression, index, and handing to the system",
}

spent_ns, calls = Counter[str](), Counter[str]()


def timed(owner: Any, name: str, what: str) -> None:
    """Have a function's CPU time counted."""
    function = getattr(owner, name)

    def measured(*arguments: Any, **options: Any) -> Any:
        began_ns = thread_time_ns()
        try:
            return function(*arguments, **options)
        finally:
            spent_ns[what] += thread_time_ns() - began_ns
            calls[what] += 1

    setattr(owner, name, measured)


class Nothing:
    def at_all(self, _event: Any) -> None:
        """Take something and leave it."""


def watch() -> None:
    """Have everything timed that matters."""
    for name in ("event", "effect"):
        timed(Recorder, name, "all")
    timed(packing.Packer, "_formed", "form")
    timed(packing.Packer, "_packed", "pack")
    timed(McapWriter, "flush", "chunk")
    timed(Nothing, "at_all", NOTHING)
    taken: Callable[[Recorder, Any], None] = Recorder.event
    nothing = Nothing()

    def event(self: Recorder, event: Any) -> None:
        nothing.at_all(event)
        taken(self, event)

    Recorder.event = event  # type: ignore[method-assign]
    serve = Service.run

    async def run(self: Service, *arguments: Any, **options: Any) -> None:
        before = process_time_ns(), monotonic_ns()
        spent_ns.clear()
        calls.clear()
        await serve(self, *arguments, **options)
        spent_ns["service"] = process_time_ns() - before[0]
        spent_ns["wall"] = monotonic_ns() - before[1]

    Service.run = run  # type: ignore[method-assign]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="swarm-50")
    parser.add_argument("--duration", type=float, default=60.0)
    parser.add_argument("--pack", type=int, default=25)
    options = parser.parse_args()
    watch()
    with tempfile.TemporaryDirectory() as parent:
        demo = DemoOptions(
            scenario=options.scenario, speed=1.0, seed=1, headless=True, out=Path(parent) / "run",
            duration_s=options.duration, as_json=False, loss=0.0, pack=options.pack,
        )  # fmt: skip
        run_demo(demo, Console(quiet=True))
    empty_ns = spent_ns[NOTHING] / calls[NOTHING]
    all_ns = round(spent_ns["all"] - empty_ns * calls["all"])
    spent_ns["taking"] = all_ns - sum(spent_ns[name] for name in ("form", "pack", "chunk"))
    wall_s, service_ns = spent_ns["wall"] / 1e9, round(spent_ns["service"] - empty_ns * calls.total())
    rate_hz = calls["all"] / wall_s
    print(f"| {options.scenario}, {wall_s:.0f} s, {rate_hz:.0f} records a second | ms a second | % |")
    print("|---|---|---|")
    print(f"| the service | {service_ns / 1e6 / wall_s:.1f} | 100 |")
    for what, ns in [("recording", all_ns), *((f"… {ROWS[name]}", spent_ns[name]) for name in ROWS)]:
        print(f"| {what} | {ns / 1e6 / wall_s:.2f} | {100 * ns / service_ns:.2f} |")


if __name__ == "__main__":
    main()
