"""Whole missions on virtual time: how many end as they should, how soon deaths are seen, how fast it runs.

``python tests/bench/bench_missions.py [--runs 100] [--loss 0.2] [SCENARIO ...]`` prints one row a scenario.
"""

import argparse
import time

import numpy as np

from gcs.planning.routes import warm_up as warm_up_planning
from gcs.report.judge import Summary
from gcs.tracking.glmb import warm_up as warm_up_tracking
from sim_vehicles.scenario import load
from sim_vehicles.simulate import fly

PAPER = ["deterministic", "prescribed", "random-obstacles", "random-targets"]


def row(name: str, summaries: list[Summary], wall_s: float) -> str:
    times_s = np.array([s.duration_s for s in summaries])
    delays_s = np.concatenate([s.death_delays_s for s in summaries])
    ospas_m = [[s.ospa_agents_mean_m for s in summaries], [s.ospa_targets_mean_m for s in summaries]]
    fates = [agent.fate for s in summaries for agent in s.agents]
    cells = [
        name,
        f"{sum(s.outcome == 'complete' for s in summaries)} / {len(summaries)}",
        f"{times_s.mean():.0f} ({times_s.min():.0f}–{times_s.max():.0f})",
        f"{fates.count('arrived')}",
        f"{fates.count('dead')}",
        f"{delays_s.size} / {sum(s.deaths for s in summaries)}",
        f"{np.mean(delays_s):.1f} / {np.max(delays_s):.0f}" if delays_s.size else "",
        f"{sum(s.false_deaths for s in summaries)}",
        " / ".join(f"{np.mean(ospa):.2f}" for ospa in ospas_m),
        f"{np.mean([s.retasks for s in summaries]):.1f}",
        f"{np.mean([s.uploads for s in summaries]):.1f} ({sum(s.upload_failures for s in summaries)})",
        f"{times_s.sum() / wall_s:.0f}",
    ]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", default=PAPER)
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--loss", type=float, default=0.0)
    arguments = parser.parse_args()
    warm_up_tracking()
    warm_up_planning()
    names = ["scenario", "complete", "run time s, mean (min–max)", "arrived", "lost", "deaths seen"]
    names += [
        "seen after s, mean / max",
        "false deaths",
        "OSPA agents / targets, m",
        "re-tasks",
        "uploads (failed)",
    ]
    names += ["times real time"]
    print("| " + " | ".join(names) + " |\n" + "|---" * len(names) + "|")
    for name in arguments.scenarios:
        scenario = load(name)
        started = time.perf_counter()
        summaries = [fly(scenario, seed, loss=arguments.loss) for seed in range(1, arguments.runs + 1)]
        print(row(name, summaries, time.perf_counter() - started), flush=True)


if __name__ == "__main__":
    main()
