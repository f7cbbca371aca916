"""Missions over the Davos tile on virtual time: heights above ground, and distances between vehicles.

    python tests/bench/bench_terrain_missions.py davos.tif --seeds 10

The elevation model is that of an argument or of the environment variable DAVOS_TIF. Each row is one mission
in one wind over all seeds. With --each it lists what was outside the band, and the near pairs. With --write
it writes the mission files instead, for other programs.
"""

from __future__ import annotations

import argparse
import os
import shutil
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from terrain_missions import DAVOS, Flight, FlownMission, NearPair, mission_text, read_site


def fly(path: Path, vehicles: int, wind_m_s: float, seed: int) -> Flight:
    """Fly one mission over the Davos tile."""
    return FlownMission(DAVOS, read_site(DAVOS, path), vehicles, wind_m_s, seed).fly()


def show(vehicles: int, wind_m_s: float, flights: list[Flight]) -> None:
    """Print one row of the table."""
    n = len(flights)
    cells = [
        f"{vehicles}",
        f"{wind_m_s:g}",
        f"{sum(one.arrived for one in flights)} of {n * vehicles}",
        f"{sum(one.lost for one in flights)}",
        f"{min(one.least_agl_m for one in flights):.1f}",
        f"{max(one.greatest_agl_m for one in flights):.1f}",
        f"{sum(len(one.outside) for one in flights)} in {sum(bool(one.outside) for one in flights)}",
        f"{sum(len(one.near) for one in flights)} in {sum(bool(one.near) for one in flights)}",
        f"{sum(one.uploads for one in flights)}",
        f"{sum(one.cpu_s for one in flights) / n:.0f}",
    ]
    print("| " + " | ".join(cells) + " |", flush=True)


def show_each(seed: int, flight: Flight, *, notices: bool) -> None:
    """Print what went wrong in one mission."""
    first: dict[tuple[int, int], tuple[float, float]] = {}
    print(
        f"  seed {seed}: {flight.arrived} arrived, {flight.lost} lost, {flight.duration_s:.0f} s", flush=True
    )
    for one in flight.outside:
        key = (one.vehicle, round(one.t_s) // 20)
        if key not in first:
            first[key] = (one.t_s, one.agl_m)
            print(
                f"    agent {one.vehicle} from {one.t_s:.1f} s at ({one.east_m:.0f}, {one.north_m:.0f}) m: "
                f"{one.agl_m:.1f} m above ground"
            )
    for pair in flight.near:
        print(f"    {words(pair)}")
    for t_s, code, vehicle, text in flight.notices if notices else ():
        print(f"    {t_s:.1f} s {code} {vehicle}: {text}")


def words(pair: NearPair) -> str:
    """Return a near pair in words."""
    return (
        f"agents {pair.vehicles[0]} and {pair.vehicles[1]} from {pair.begin_s:.1f} to {pair.end_s:.1f} s: "
        f"{pair.distance_m:.0f} m and {pair.height_m:.1f} m in height "
        f"at ({pair.place_m[0]:.0f}, {pair.place_m[1]:.0f}) m"
    )


def write(path: Path, folder: Path, vehicles: int, wind_m_s: float, seed: int) -> None:
    """Write one mission file with its elevation model beside it."""
    elevation = read_site(DAVOS, path)
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, folder / path.name)
    text = mission_text(DAVOS, elevation, vehicles, wind_m_s, seed)
    (folder / f"davos{vehicles}-wind{wind_m_s:g}-{seed}.toml").write_text(text, encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tile", type=Path, nargs="?", default=os.environ.get("DAVOS_TIF"))
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--vehicles", type=int, nargs="+", default=[4, 8, 20])
    parser.add_argument("--wind", type=float, nargs="+", default=[0.0, 8.0], help="m/s")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--each", action="store_true", help="list what went wrong")
    parser.add_argument("--notices", action="store_true", help="with --each: list warnings and alarms too")
    parser.add_argument("--write", type=Path, metavar="DIR", help="write the mission files")
    options = parser.parse_args()
    if options.tile is None:
        parser.error("name the elevation model, or set DAVOS_TIF")
    seeds = range(options.first, options.first + options.seeds)
    began_s = time.perf_counter()
    print(
        "| vehicles | wind, m/s | arrived | lost | least AGL, m | greatest AGL, m "
        "| samples outside, in missions | near pairs, in missions | uploads | CPU, s |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    with ProcessPoolExecutor(options.workers) as pool:
        for vehicles in options.vehicles:
            for wind_m_s in options.wind:
                if options.write is not None:
                    for seed in seeds:
                        write(options.tile, options.write, vehicles, wind_m_s, seed)
                    continue
                flights = []
                flown = pool.map(partial(fly, options.tile, vehicles, wind_m_s), seeds)
                for seed, flight in zip(seeds, flown, strict=True):
                    flights.append(flight)
                    if options.each:
                        show_each(seed, flight, notices=options.notices)
                show(vehicles, wind_m_s, flights)
    print(f"took {time.perf_counter() - began_s:.0f} s")


if __name__ == "__main__":
    main()
