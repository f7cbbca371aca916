"""Time until a replay shows the state at any time of a long recording.

``python tests/bench/bench_seek.py [--hours 1] [--times 10]`` flies the mission of `soak.py` and keeps its
recording. For random times it finds the last snapshot before, restores it, and processes the events until
then, as `gcs replay --from` does after its warm-up.
"""

import argparse
import asyncio
import math
import tempfile
import time
from pathlib import Path
from typing import get_args
from unittest.mock import patch

import numpy as np
from soak import Soak

from gcs.core.perception import arrival_and_loss
from gcs.io.recording.index import read_end_t_ns, snapshot_places
from gcs.io.recording.mcap_file import recording_bytes
from gcs.io.recording.reader import read
from gcs.model import NS_PER_S, Event
from gcs.planning.warm_up import warm_up as warm_up_planning
from gcs.service.replay import Replay, Window
from gcs.tracking.glmb.filter import warm_up as warm_up_tracking
from sim_vehicles.campaign.virtual_run import START_T_NS


def seek(folder: Path, soak: Soak, at_s: float) -> Replay:
    """Replay from the last snapshot to a time."""
    at_ns = START_T_NS + round(at_s * NS_PER_S)
    place = max((one for one in snapshot_places(folder) if one.t_ns < at_ns), key=lambda one: one.t_ns)
    records = read(folder, only=get_args(Event), start=place)
    replay = Replay(soak.scenario.config, soak.seed, records, Window(at_s, at_s), START_T_NS)
    asyncio.run(replay.run(asyncio.Event(), math.inf))
    assert abs(replay.duration_s - at_s) < 1.0
    return replay


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--times", type=int, default=10)
    options = parser.parse_args()
    warm_up_tracking()
    warm_up_planning()
    with tempfile.TemporaryDirectory() as parent, patch.object(arrival_and_loss, "ARRIVAL_EPOCHS", math.inf):
        folder = Path(parent)
        soak = Soak(1, 0.05, folder, keeps_recording=True)
        soak.fly(options.hours * 3600.0)
        soak.close()
        end_t_ns = read_end_t_ns(folder)
        assert end_t_ns is not None
        print(f"{(end_t_ns - START_T_NS) / NS_PER_S:.0f} s of flight, {recording_bytes(folder) / 1e6:.0f} MB")
        seek(folder, soak, 20.0)
        spent_s = []
        for at_s in np.random.default_rng(1).uniform(20.0, options.hours * 3600.0, options.times):
            began_s = time.process_time()
            replay = seek(folder, soak, at_s)
            spent_s.append(time.process_time() - began_s)
            print(f"{at_s:7.1f} s: {replay.events:5d} events, {spent_s[-1]:.3f} s of CPU")
    print(f"median {np.median(spent_s):.3f} s, most {max(spent_s):.3f} s")


if __name__ == "__main__":
    main()
