"""Harm command, its bridge, its standby and what is between them at random moments, beneath vehicles.

``python tests/bench/chaos.py --runs 1000 [--seed 1] [--speed 2] [--json]`` flies `deterministic` with real
processes. They are killed, stopped and restarted; paths between them are cut, late (2 s) or lossy (30 %); the
radio loses, repeats and reorders 30 % of the datagrams; wall clocks are set, disks are full, another program
reads nothing or sends without end. Each run checks that two nodes never reach one vehicle, that no equal
mission is uploaded and no order carried out twice, that no mission is flown that was not read back, that the
standby has the state of command, that each recording is readable to the last second, that the picture is
right within five scans, and that the mission ends (`helpers.chaos_checks`). Times are real ones.
"""

import argparse
import json
import shutil
import tempfile
from pathlib import Path

import msgspec
import numpy as np
from helpers.chaos import fly_under
from helpers.chaos_checks import check
from rich.console import Console
from rich.table import Table


def one_run(seed: int, speed: float, keep: Path | None) -> dict[str, object]:
    """Fly a run; keep its folder if there is a problem."""
    folder = Path(tempfile.mkdtemp(prefix="chaos-"))
    try:
        flight = fly_under(folder, seed, speed, check)
        (folder / "events.msgpack").write_bytes(msgspec.msgpack.encode(flight.events))
        found = {
            "seed": seed,
            "faults": flight.done,
            "gap_s": round(flight.gap_s, 3),
            "all_gap_s": round(flight.all_gap_s, 3),
            "take_over_s": [round(one, 3) for one in flight.take_over_s],
            "uncompared": flight.uncompared,
            "scans_to_picture": flight.scans_to_picture,
            "problems": flight.problems,
        }
    except AssertionError as error:
        found = {"seed": seed, "problems": [f"broken off: {error}"[:600]]}
    if found["problems"] and keep is not None:
        shutil.copytree(
            folder, keep / str(seed), ignore=shutil.ignore_patterns("*.sock*"), dirs_exist_ok=True
        )
    shutil.rmtree(folder, ignore_errors=True)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1, help="of the first run")
    parser.add_argument("--speed", type=float, default=2.0, help="times real time")
    parser.add_argument("--json", action="store_true", help="print each run as a line of JSON, no table")
    parser.add_argument("--keep", type=Path, help="folder for logs and recordings of runs with problems")
    options = parser.parse_args()
    runs = []
    for seed in range(options.seed, options.seed + options.runs):
        runs.append(one_run(seed, options.speed, options.keep))
        if options.json or runs[-1]["problems"]:
            print(json.dumps(runs[-1]), flush=True)
    if not options.json:
        Console(width=100).print(table_of(runs))


def table_of(runs: list[dict[str, object]]) -> Table:
    """Return the figures of all runs."""
    flown = [run for run in runs if "gap_s" in run]
    took_s = [one for run in flown for one in run["take_over_s"]]
    gaps_s = [run["gap_s"] for run in flown]
    scans = [one for run in flown for one in run["scans_to_picture"]]
    table = Table("figure", "value", title=f"{len(runs)} runs")
    table.add_row("runs with problems", str(sum(bool(run["problems"]) for run in runs)))
    table.add_row("faults", str(sum(len(run["faults"]) for run in flown)))
    table.add_row("take-overs", str(len(took_s)))
    if took_s:
        table.add_row("take-over, s: median, 99 %, most", _quantiles(took_s))
    if scans:
        table.add_row("scans from a fault's end to the right picture: median, 99 %, most", _quantiles(scans))
    if gaps_s:
        table.add_row(
            "longest gap of heartbeats, bridge undisturbed, s: median, 99 %, most", _quantiles(gaps_s)
        )
    return table


def _quantiles(values: list[float]) -> str:
    return ", ".join(f"{np.quantile(values, one):.2f}" for one in (0.5, 0.99, 1.0))


if __name__ == "__main__":
    main()
