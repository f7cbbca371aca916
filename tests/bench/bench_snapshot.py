"""Cost of a snapshot of the state against the number of vehicles.

``python tests/bench/bench_snapshot.py [--agents 10 50 250] [--duration 60]`` flies `swarm-50` with so many
vehicles on virtual time. It prints the CPU time to encode and to decode the state, and its size.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from bench_swarm import swarm
from rich.console import Console
from rich.table import Table

from gcs.config import read_text
from gcs.core.snapshot import decode_state, encode_state
from gcs.planning.warm_up import warm_up as warm_up_planning
from gcs.tracking.glmb.filter import warm_up as warm_up_tracking
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import parse_scenario


def median_ms(work: Callable[[], object], repeats: int = 101) -> float:
    """CPU time of one call."""
    spent_ms = []
    for _ in range(repeats):
        began = time.process_time_ns()
        work()
        spent_ms.append((time.process_time_ns() - began) / 1e6)
    return statistics.median(spent_ms)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--agents", type=int, nargs="+", default=[10, 50, 250])
    parser.add_argument("--duration", type=float, default=60.0, help="seconds of flight before")
    options = parser.parse_args()
    warm_up_tracking()
    warm_up_planning()
    table = Table("vehicles", "tracks of agents", "of targets", "encode, ms", "decode, ms", "kB")
    for agents in options.agents:
        with tempfile.TemporaryDirectory() as folder:
            scenario = parse_scenario(*read_text(str(swarm(agents, 4.0, Path(folder)))))
        run = VirtualRun(scenario, 1)
        run.run(options.duration)
        state = run.engine.state
        data = encode_state(state)
        assert encode_state(decode_state("snapshot", data)) == data
        trackers = state.perception.trackers
        table.add_row(
            str(agents),
            str(len(trackers.agents.confirmation.confirmed)),
            str(len(trackers.targets.confirmation.confirmed)),
            f"{median_ms(partial(encode_state, state)):.2f}",
            f"{median_ms(partial(decode_state, 'snapshot', data)):.2f}",
            f"{len(data) / 1e3:.0f}",
        )
    Console(width=100).print(table)


if __name__ == "__main__":
    main()
