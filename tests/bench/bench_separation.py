"""Separation in random missions on virtual time: how near vehicles came, and how early it was told.

    python tests/bench/bench_separation.py --missions 1000

Each row counts intervals in which two vehicles in the air were within 30 m and 15 m in height, by what was
told before. With --all each order to hold, return or resume is to all vehicles; with --home all return once
to one strip. With --cost it measures one check of the look-ahead instead, by swarm and time step.
"""

from __future__ import annotations

import argparse
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np
from flown_separation import Flown, Pair, fly

from gcs.core.separation.forward_flight import Flight, Goal, GoalKind, simulate_flights
from gcs.core.separation.look_ahead import encounters

MIN_LEAD_S = 5.0
LATE_S = 3.0


def show(flown: list[Flown], each: bool) -> None:
    pairs = [pair for one in flown for pair in one.pairs]
    early = [pair for pair in pairs if pair.lead_s is not None and pair.lead_s >= MIN_LEAD_S]
    late = [pair for pair in pairs if pair not in early]
    alarms, false = sum(one.alarms for one in flown), sum(one.false_alarms for one in flown)
    hours = sum(one.in_air_s for one in flown) / 3600.0
    print(f"missions: {len(flown)}, {hours:.1f} h in the air")
    print(f"take-offs: {sum(one.takeoffs for one in flown)}, landings: {sum(one.landings for one in flown)}")
    print(f"refused orders: {sum(one.refused for one in flown)}")
    print(f"missions with a pair within 30 m and 15 m: {sum(bool(one.pairs) for one in flown)}")
    print(f"such intervals: {len(pairs)}; told 5 s before: {len(early)}; later or never: {len(late)}")
    leads = np.array([pair.lead_s for pair in early]) if early else np.zeros(1)
    print(f"lead of the former, s: least {leads.min():.1f}, median {np.median(leads):.1f}")
    avoided, undecided = sum(one.avoided for one in flown), sum(one.undecided for one in flown)
    print(
        f"alarms: {alarms}, and {undecided} shortly before the end; pairs that stayed apart: {false} "
        f"({100.0 * false / max(alarms, 1):.0f} %), in {avoided} of them a mode changed after the alarm"
    )
    for action in ("hold", "return"):
        delays = [s for one in flown for (order, _), s in one.answered.items() if order.startswith(action)]
        done = np.array([s for s in delays if s is not None])
        if not len(done):
            continue
        late = int((done > LATE_S).sum())
        print(
            f"orders to {action}: {len(done)} of {len(delays)} carried out, {late} of them after "
            f"{LATE_S:g} s; median {np.median(done):.1f} s, most {done.max():.1f} s"
        )
    print(f"vehicles held for others: {sum(one.held for one in flown)}")
    if each:
        for pair in sorted(pairs, key=lambda one: (one in early, one.seed, one.begin_s)):
            print(words(pair))


def words(pair: Pair) -> str:
    lead = "never told" if pair.lead_s is None else f"told {pair.lead_s:.1f} s before"
    return (
        f"  seed {pair.seed}: {pair.vehicles[0]} and {pair.vehicles[1]} at {pair.begin_s:.1f} s for "
        f"{pair.end_s - pair.begin_s:.1f} s, {pair.distance_m:.0f} m and {pair.height_m:.0f} m; {lead}; "
        f"{pair.what}"
    )


def show_cost() -> None:
    rng = np.random.default_rng(1)
    print("| vehicles | step, s | simulation, ms | pairs, ms |")
    print("|---|---|---|---|")
    for n in (5, 50, 250):
        for step_s in (0.25, 0.5, 1.0):
            side_m = 300.0 * np.sqrt(n)
            flights = [
                Flight(
                    i + 1,
                    *rng.uniform(0.0, side_m, 2),
                    100.0 + 20.0 * (i % 5),
                    15.0,
                    rng.uniform(0.0, 6.0),
                    0.0,
                    0.0,
                    0.4,
                    tuple(
                        Goal(GoalKind.WAYPOINT, *rng.uniform(0.0, side_m, 2), 20.0, 100.0 + 20.0 * (i % 5))
                        for _ in range(4)
                    ),
                )
                for i in range(n)
            ]
            took = np.empty((30, 2))
            for k in range(len(took)):
                began = time.perf_counter()
                paths = simulate_flights(flights, 25.0, step_s)
                middle = time.perf_counter()
                encounters(paths, 60.0, 15.0, step_s=step_s)
                took[k] = (middle - began, time.perf_counter() - middle)
            simulated, paired = 1e3 * np.median(took, axis=0)
            print(f"| {n} | {step_s:g} | {simulated:.1f} | {paired:.1f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--missions", type=int, default=50)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--each", action="store_true", help="list the intervals")
    parser.add_argument("--all", action="store_true", help="order all vehicles at once")
    parser.add_argument("--home", action="store_true", help="order all home once, and nothing else")
    parser.add_argument("--wind", type=float, default=0.0, help="share of the airspeed")
    parser.add_argument("--cost", action="store_true", help="measure one check")
    options = parser.parse_args()
    if options.cost:
        show_cost()
        return
    seeds = range(options.first, options.first + options.missions)
    began = time.perf_counter()
    with ProcessPoolExecutor(options.workers) as pool:
        flight = partial(fly, all_at_once=options.all, home=options.home, wind=options.wind)
        flown = list(pool.map(flight, seeds, chunksize=4))
    show(flown, options.each)
    print(f"took {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
