"""Heights above ground and near pairs of recorded flights over the Davos tile, such as with real firmware.

``python tests/bench/terrain_recording.py davos.tif RECORDING ...`` reads the true positions of recordings of
``gcs demo FILE --sitl``; ``bench_terrain_missions.py --write`` writes the mission files. One row for each.
Heights count from a vehicle's first mission on, in AUTO and LOITER; those in other modes, such as RTL, by
themselves. The simulation launches all at once, so the first 20 s do not count. Samples outside the band, and
pairs nearer than both minima, are listed.
"""

import argparse
import itertools
import math
import sys
from collections import defaultdict
from pathlib import Path

from terrain_missions import ALLOWED_M, DAVOS, LAYER_STEP_M, MAX_AGL_M, MIN_AGL_M, SEPARATION_M, read_site

from gcs.io.recording.reader import read
from gcs.mavlink.frames.codec import scan
from gcs.model import NS_PER_S, Datagram, Truth
from gcs.terrain.elevation_grid import Elevation
from sim_vehicles.autopilots.autopilot_traits import TRAITS, Mode

LAUNCHED_S = 20.0
MISSIONS = (Mode.AUTO, Mode.LOITER)


class Heights:
    """What one recording shows."""

    def __init__(self, elevation: Elevation) -> None:
        self.elevation = elevation
        self.modes, self.begun = dict[int, Mode](), set[int]()
        self.agl_m, self.in_rtl_m = list[float](), list[float]()
        self.outside, self.near = defaultdict[tuple, list](list), defaultdict[tuple, list](list)

    def read(self, recording: Path) -> None:
        start_ns = None
        for record in read(recording, only=(Datagram, Truth)):
            start_ns = start_ns or record.t_ns
            if isinstance(record.value, Truth):
                t_s = (record.t_ns - start_ns) / NS_PER_S
                if t_s >= LAUNCHED_S:
                    self._take(record.value, t_s)
                continue
            for frame in scan(record.value.data).frames:
                if frame.message_id == 0 and frame.component_id == 1:
                    heartbeat = frame.message()
                    kind = "px4" if heartbeat.autopilot == 12 else "ardupilot"
                    self.modes[frame.system_id] = TRAITS[kind].mode_of_custom(heartbeat.custom_mode)

    def _take(self, truth: Truth, t_s: float) -> None:
        places = {}
        for one in truth.objects:
            mode = self.modes.get(one.id)
            if one.kind != "agents" or not one.alive or one.down or math.isnan(one.alt_msl_m or math.nan):
                continue
            self.begun |= {one.id} if mode is Mode.AUTO else set()
            if one.id not in self.begun:
                continue
            places[one.id] = one
            agl_m = one.alt_msl_m - self.elevation.height_msl_m(one.east_m, one.north_m)
            (self.agl_m if mode in MISSIONS else self.in_rtl_m).append(agl_m)
            if mode in MISSIONS and not MIN_AGL_M - ALLOWED_M <= agl_m <= MAX_AGL_M + ALLOWED_M:
                self.outside[one.id, mode.name].append((t_s, agl_m))
        for first, second in itertools.combinations(places.values(), 2):
            away_m = math.dist((first.east_m, first.north_m), (second.east_m, second.north_m))
            height_m = abs(first.alt_msl_m - second.alt_msl_m)
            if away_m < SEPARATION_M and height_m < 0.5 * LAYER_STEP_M:
                self.near[first.id, second.id].append((t_s, away_m, height_m))

    def show(self, name: str) -> None:
        lowest = f"{min(self.in_rtl_m):.0f}" if self.in_rtl_m else "-"
        outside = sum(map(len, self.outside.values()))
        print(f"| {name} | {len(self.agl_m)} | {min(self.agl_m):.1f} | {max(self.agl_m):.1f} | {outside} "
              f"| {lowest} | {len(self.near)} |", flush=True)  # fmt: skip
        for (vehicle, mode), samples in self.outside.items():
            span = f"{samples[0][0]:.0f} to {samples[-1][0]:.0f} s"
            low, high = min(one[1] for one in samples), max(one[1] for one in samples)
            print(f"  agent {vehicle} in {mode}: {len(samples)} samples, {span}, {low:.1f} to {high:.1f} m",
                  file=sys.stderr)  # fmt: skip
        for pair, samples in self.near.items():
            t_s, away_m, height_m = min(samples, key=lambda one: one[1])
            span = f"{samples[0][0]:.0f} to {samples[-1][0]:.0f} s"
            modes = [self.modes[vehicle].name for vehicle in pair]
            nearest = f"{away_m:.0f} m and {height_m:.0f} m in height at {t_s:.0f} s"
            print(f"  {pair}: {span}, {nearest}, last in {modes}", file=sys.stderr)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tile", type=Path)
    parser.add_argument("recordings", type=Path, nargs="+")
    options = parser.parse_args()
    elevation = read_site(DAVOS, options.tile)
    print("| recording | samples | least AGL, m | greatest, m | outside | least in RTL | near pairs |")
    print("|---|---|---|---|---|---|---|")
    for recording in options.recordings:
        heights = Heights(elevation)
        heights.read(recording)
        heights.show(recording.name)


if __name__ == "__main__":
    main()
