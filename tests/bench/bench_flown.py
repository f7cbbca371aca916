"""How near vehicles come to obstacles, and to each other, as they are flown, in calm air and in wind.

``python tests/bench/bench_flown.py [SCENARIO ...] [--seeds 16] [--each] [--home]`` prints a table: the least
distance of any vehicle from any blocked cell in whole missions on virtual time, until near the end
of its route; in how many missions a vehicle was inside one there, passing or circling; and how many pairs in
the air lost separation. Winds are shares of the airspeed. Their direction is drawn for each seed, gusts have
a quarter of their strength, and the mission file states the sum of both (`airframe.wind_m_s`).

With ``--home`` vehicles land at home after their targets: how many were inside an obstacle between the
two.
"""

import argparse
import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import product

import numpy as np
from helpers.flown_clearance import FlownHome, Nearest, NearPair, flown_home, in_wind, landing, nearest

from gcs.model import FloatArray
from gcs.planning.warm_up import warm_up as warm_up_planning
from gcs.tracking.glmb.filter import warm_up as warm_up_tracking
from sim_vehicles.world.scenario import Scenario, WindTable, load

SCENARIOS = ("deterministic", "prescribed", "random-obstacles", "random-targets")
GUST_SHARE = 0.25
LANDED_M = 150.0
_QUANTILES = "least / 5 % / 10 % / median, m"


def blown(name: str, seed: int, share: float) -> Scenario:
    scenario = load(name)
    if not share:
        return scenario
    wind_m_s = share * scenario.config.airframe.speed_m_s
    towards_rad = np.random.default_rng(1000 + seed).uniform(0.0, 2.0 * math.pi)
    wind = WindTable(
        east_m_s=wind_m_s * math.sin(towards_rad),
        north_m_s=wind_m_s * math.cos(towards_rad),
        gust_std_m_s=GUST_SHARE * wind_m_s,
    )
    return in_wind(scenario, wind, (1.0 + GUST_SHARE) * wind_m_s)


def fly(name: str, seed: int, share: float) -> Nearest:
    return nearest(blown(name, seed, share), seed)


def fly_home(name: str, seed: int, share: float, straight: bool) -> FlownHome:
    return flown_home(landing(blown(name, seed, share)), seed, straight=straight)


def words(pair: NearPair) -> str:
    return (
        f"agents {pair.vehicles[0]} and {pair.vehicles[1]} at {pair.t_s:.1f} s: {pair.distance_m:.0f} m and "
        f"{pair.height_m:.1f} m in height, {pair.modes[0]} and {pair.modes[1]}"
    )


def distribution(least_m: FloatArray) -> str:
    return " / ".join(f"{np.quantile(least_m, share):.1f}" for share in (0.0, 0.05, 0.1, 0.5))


def pairs_of(flown: Sequence[Nearest | FlownHome]) -> str:
    each = [one.near_pairs for one in flown]
    return f"{sum(map(len, each))} in {sum(map(bool, each))}"


def show_ways_home(options: argparse.Namespace, seeds: range, routes: Sequence[bool]) -> None:
    print(
        f"| scenario | wind | return routes | vehicles | landed | inside | {_QUANTILES} "
        "| near pairs, in missions |"
    )
    print("|---|---|---|---|---|---|---|---|")
    with ProcessPoolExecutor(options.workers) as pool:
        for name, wind, straight in product(options.scenarios, options.winds, routes):
            n = len(seeds)
            flown = list(pool.map(fly_home, [name] * n, seeds, [wind] * n, [straight] * n))
            found = [one for mission in flown for one in mission.flights.values()]
            least_m = np.array([one.clearance_m for one in found])
            for seed, mission in zip(seeds, flown, strict=True) if options.each else ():
                clearances_m = ", ".join(f"{one.clearance_m:.1f} m" for one in mission.flights.values())
                print("; ".join([f"  {seed}: {clearances_m}", *map(words, mission.near_pairs)]))
            print(
                f"| {name} | {wind:g} | {'straight' if straight else 'planned'} | {len(found)} "
                f"| {sum(one.home_m <= LANDED_M for one in found)} | {int((least_m <= 0.0).sum())} "
                f"| {distribution(least_m)} | {pairs_of(flown)} |",
                flush=True,
            )


def show_missions(options: argparse.Namespace, seeds: range) -> None:
    print(
        f"| scenario | wind | missions | {_QUANTILES} | inside | … at the end | arrived "
        "| near pairs, in missions |"
    )
    print("|---|---|---|---|---|---|---|---|")
    with ProcessPoolExecutor(options.workers) as pool:
        for name, wind in product(options.scenarios, options.winds):
            n = len(seeds)
            flown = list(pool.map(fly, [name] * n, seeds, [wind] * n))
            for seed, one in zip(seeds, flown, strict=True) if options.each else ():
                nearest_words = (
                    f"  {seed}: {one.clearance_m:.1f} m, agent {one.vehicle} at {one.t_s:.0f} s, "
                    f"{one.tasked_s:.1f} s on route {one.routes}, ({one.east_m:.0f}, {one.north_m:.0f})"
                )
                print("; ".join([nearest_words, *map(words, one.near_pairs)]))
            least_m = np.array([one.clearance_m for one in flown])
            print(
                f"| {name} | {wind:g} | {n} | {distribution(least_m)} | {int((least_m <= 0.0).sum())} "
                f"| {sum(one.at_end_m <= 0.0 for one in flown)} | {sum(one.arrived for one in flown)} "
                f"| {pairs_of(flown)} |",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", default=SCENARIOS)
    parser.add_argument("--seeds", type=int, default=16)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--winds", type=float, nargs="*", default=[0.0, 0.3], help="shares; default 0 0.3")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--each", action="store_true", help="show every seed")
    parser.add_argument("--home", action="store_true", help="land at home; check the return flights")
    parser.add_argument("--straight", action="store_true", help="with --home: straight return routes, too")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.seeds)
    warm_up_planning()
    warm_up_tracking()
    if options.home:
        show_ways_home(options, seeds, (True, False) if options.straight else (False,))
    else:
        show_missions(options, seeds)


if __name__ == "__main__":
    main()
