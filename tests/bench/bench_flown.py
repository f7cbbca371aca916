"""How near vehicles come to obstacles as they are flown, over seeds, in calm air and in wind.

``python tests/bench/bench_flown.py [SCENARIO ...] [--seeds 16] [--each] [--home]`` prints a table: the least
distance of any vehicle from any blocked cell in whole missions on virtual time, until near the end
of its route; and in how many runs a vehicle was inside one there, passing or circling. Winds are shares of
the airspeed. Their direction is drawn for each seed, gusts have a quarter of their strength, and the mission
file states the sum of both (`airframe.wind_m_s`).

With ``--home`` vehicles land at home after their targets: how many were inside an obstacle between the
two, with return routes that are planned and with straight ones.
"""

import argparse
import math
from concurrent.futures import ProcessPoolExecutor
from itertools import product

import numpy as np
from helpers.flown_clearance import Nearest, ReturnFlight, flown_home, in_wind, landing, nearest

from gcs.planning.warm_up import warm_up as warm_up_planning
from gcs.tracking.glmb.filter import warm_up as warm_up_tracking
from sim_vehicles.world.scenario import Scenario, WindTable, load

SCENARIOS = ("deterministic", "prescribed", "random-obstacles", "random-targets")
GUST_SHARE = 0.25
LANDED_M = 150.0


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


def fly_home(name: str, seed: int, share: float, straight: bool) -> list[ReturnFlight]:
    scenario = landing(blown(name, seed, share))
    return list(flown_home(scenario, seed, straight=straight).values())


def show_ways_home(options: argparse.Namespace) -> None:
    print(
        "| scenario | wind | return routes | vehicles | landed | inside | least, a tenth below, median, m |"
    )
    print("|---|---|---|---|---|---|---|")
    n = options.seeds
    with ProcessPoolExecutor(2) as pool:
        for name, wind, straight in product(options.scenarios, options.winds, (True, False)):
            order = [name] * n, range(1, n + 1), [wind] * n, [straight] * n
            each = list(pool.map(fly_home, *order))
            if options.each:
                for seed, some in enumerate(each, 1):
                    print(
                        f"  {seed}: "
                        + ", ".join(f"{one.clearance_m:.1f} m, {one.home_m:.0f}" for one in some)
                    )
            found = [one for some in each for one in some]
            least_m = np.array([one.clearance_m for one in found])
            print(
                f"| {name} | {wind:g} | {'straight' if straight else 'planned'} | {len(found)} "
                f"| {sum(one.home_m <= LANDED_M for one in found)} | {int((least_m <= 0.0).sum())} "
                f"| {least_m.min():.1f}, {np.quantile(least_m, 0.1):.1f}, {np.median(least_m):.1f} |",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", default=SCENARIOS)
    parser.add_argument("--seeds", type=int, default=16)
    parser.add_argument("--winds", type=float, nargs="*", default=[0.0, 0.3], help="shares; default 0 0.3")
    parser.add_argument("--each", action="store_true", help="show every seed")
    parser.add_argument("--home", action="store_true", help="check the return routes from targets instead")
    options = parser.parse_args()
    warm_up_planning()
    warm_up_tracking()
    if options.home:
        show_ways_home(options)
        return
    print("| scenario | wind | least, m | a tenth below, m | median, m | runs inside | … at the end |")
    print("|---|---|---|---|---|---|---|")
    with ProcessPoolExecutor(2) as pool:
        for name in options.scenarios:
            for wind in options.winds:
                n = options.seeds
                found = list(pool.map(fly, [name] * n, range(1, n + 1), [wind] * n))
                if options.each:
                    for seed, one in enumerate(found, 1):
                        print(
                            f"  {seed}: {one.clearance_m:.1f} m, agent {one.vehicle} at {one.t_s:.0f} s, "
                            f"{one.tasked_s:.1f} s on route {one.routes}, "
                            f"({one.east_m:.0f}, {one.north_m:.0f})"
                        )
                least_m = np.array([one.clearance_m for one in found])
                print(
                    f"| {name} | {wind:g} | {least_m.min():.1f} | {np.quantile(least_m, 0.1):.1f} "
                    f"| {np.median(least_m):.1f} | {int((least_m <= 0.0).sum())} of {n} "
                    f"| {sum(one.at_end_m <= 0.0 for one in found)} of {n} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
