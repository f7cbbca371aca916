"""What recordings cost: replaying one, and writing it in flight, in CPU time.

``python tests/bench/bench_recordings.py [SCENARIO] [--duration 60] [--repeats 5]`` flies a scenario on
virtual time with its recording, and prints what `gcs replay` takes for it in all its parts, as fast as it
can, and what recording took of what the service does.

CPU time of a shared machine is not steady either: the least of the repeats is given, and next to it the time
of a fixed loop of plain Python, to compare runs by.
"""

import argparse
import asyncio
import math
import statistics
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

from rich.console import Console

from gcs.cli.run_setup import warm_up
from gcs.config import Config, parse
from gcs.core.engine import Engine
from gcs.io.recording.folder import Run, versions
from gcs.io.recording.reader import read, read_info
from gcs.io.recording.recorder import Recorder
from gcs.model import NS_PER_S, Effect, Event
from gcs.service.replay import Replay, Verifier, Window
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import load


def cpu_s(work: Callable[[], Any]) -> float:
    began = time.process_time()
    work()
    return time.process_time() - began


def fly(scenario: str, duration_s: float, folder: Path) -> None:
    run = VirtualRun(load(scenario), seed=1)
    name = run.scenario.config.name
    with Recorder(folder, run.scenario.text, versions(), Run(name, 1)) as recorder:
        run.on_event = recorder.record_event
        run.on_effect = recorder.record_effect
        run.on_truth = recorder.record_truth
        run.run(duration_s)


def replay(folder: Path, config: Config, *, verify: bool) -> None:
    types = get_args(Event) + get_args(Effect) if verify else get_args(Event)
    played = Replay(config, 1, read(folder, only=types), Window())
    if verify:
        played.watchers.append(Verifier())
    asyncio.run(played.run(asyncio.Event(), math.inf))


def step_times(folder: Path, config: Config) -> Counter[str]:
    """CPU time of the engine by kind of event, without reading."""
    engine, spent = Engine(config, 1), Counter[str]()
    for record in read(folder, only=get_args(Event)):
        kind = type(record.value).__name__
        began = time.process_time()
        engine.step(record.value)
        spent[kind] += time.process_time() - began
    return spent


def write(folder: Path, copy: Path) -> float:
    """CPU time of recording the same again, as the service does it: flushed once a second."""
    records = list(read(folder))
    began, flushed_ns = time.process_time(), records[0].t_ns
    with Recorder(copy, "", {}) as recorder:
        for record in records:
            if isinstance(record.value, Event):
                recorder.record_event(record.value)
                if record.t_ns - flushed_ns > NS_PER_S:
                    recorder.flush()
                    flushed_ns = record.t_ns
            elif isinstance(record.value, Effect):
                recorder.record_effect(record.t_ns, record.value)
    return time.process_time() - began


def yardstick() -> float:
    return cpu_s(lambda: sum(i * i for i in range(2_000_000)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="swarm-50")
    parser.add_argument("--duration", type=float, default=60.0)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    warm_up(Console(stderr=True))
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "run"
        fly(options.scenario, options.duration, folder)
        config = parse(read_info(folder).config_text, options.scenario)
        times = [record.value.t_ns for record in read(folder, only=get_args(Event))]
        run_s = (times[-1] - times[0]) / NS_PER_S
        rounds = range(options.repeats)
        rows = {
            "gcs replay": min(cpu_s(lambda: replay(folder, config, verify=False)) for _ in rounds),
            "gcs replay --verify": min(cpu_s(lambda: replay(folder, config, verify=True)) for _ in rounds),
            "reading the events": min(
                cpu_s(lambda: Counter(r.t_ns for r in read(folder, only=get_args(Event)))) for _ in rounds
            ),
        }
        engine_s = [step_times(folder, config) for _ in rounds]
        least = min(engine_s, key=lambda spent: spent.total())
        rows |= {f"the engine: {kind}": spent for kind, spent in least.most_common(3)}
        rows["writing it"] = min(write(folder, Path(parent) / f"copy-{i}") for i in rounds)
    print(f"| {options.scenario}, {run_s:.0f} s, {len(times)} events | CPU, s | times real time |")
    print("|---|---|---|")
    for what, spent_s in rows.items():
        print(f"| {what} | {spent_s:.3f} | {run_s / spent_s:.0f} |")
    print(f"\na loop of 2,000,000 squares: {statistics.median(yardstick() for _ in rounds):.3f} s")


if __name__ == "__main__":
    main()
