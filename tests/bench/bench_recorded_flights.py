"""How far a simulated ArduPlane stays from the recorded paths of real ones with the same commands.

``python tests/bench/bench_recorded_flights.py [FOLDER]`` replays what the ground sent in each recording of a
folder (default ``../shared/data/arduplane/flights``) to a simulated plane, and prints a table: distance from
the true path (within 10 s of the same time) and from the true plane at the same time.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from helpers.recorded_flights import apart_m, extract, fly, off_path_m

DEFAULT = Path(__file__).parents[3] / "shared/data/arduplane/flights"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=DEFAULT)
    folder = parser.parse_args().folder
    if not folder.is_dir():
        sys.exit(f"{folder} is not here: give the folder that holds the recorded flights")
    print("| flight | plane | seconds | off the path: median, 95 %, most, m | apart: median, 95 %, m |")
    print("|---|---|---|---|---|")
    everything = []
    for recording in sorted(path for path in folder.iterdir() if path.is_dir()):
        for flight in extract(recording):
            path = fly(flight)
            off_m, away_m = off_path_m(flight, path), apart_m(flight, path)
            everything.append(off_m)
            print(
                f"| {flight.name} | {flight.system_id} | {flight.ends_s - flight.begins_s:.0f} "
                f"| {np.median(off_m):.1f}, {np.quantile(off_m, 0.95):.1f}, {off_m.max():.0f} "
                f"| {np.median(away_m):.1f}, {np.quantile(away_m, 0.95):.1f} |"
            )
    off_m = np.concatenate(everything)
    print(f"| all | | | {np.median(off_m):.1f}, {np.quantile(off_m, 0.95):.1f}, {off_m.max():.0f} | |")


if __name__ == "__main__":
    main()
