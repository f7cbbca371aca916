"""Trackers side by side in one run, on the same detections: OSPA, OSPA(2), CPU milliseconds per scan, ratios.

    pip install swarm-gcs[bench]
    python tests/bench/bench_peers.py --data DIR [--sets 2] [--scans 100] [--only ours] [--lmb PROGRAM]

DIR holds `demo_mc*.npz` and `hard_mc*.npz`; what is tracked are fresh draws of their detections (`draws.py`).
Every tracker gets the model in the file: motion, noise, p_S, p_D, clutter and the four places of birth.

- Stone Soup GM-PHD: its hypothesiser, updater and reducer as in its documentation's example, gate 4 sigma;
  shown is every component above weight 1/2.
- Stone Soup JPDA: probabilistic hypotheses, gate 4 sigma; tracks begin at the places of birth, are shown from
  their second detection in three scans on, and end after three misses in a row.
- Rust LMB: `multisensor-lmb-filters-rs` with its own limits, marginals by loopy belief propagation or from
  1,000 Gibbs samples. Built by `cargo build --release` in `tests/bench/rust_lmb`; `--lmb` names the program.
- nearest: the global nearest neighbour of `baselines`; begin and end as above.

A tracker that is not installed is left out.
"""

from __future__ import annotations

import argparse
import datetime
import subprocess
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np
from draws import sets

from gcs.io.detections.track_input import Detections, load
from gcs.tracking.glmb.filter import Glmb, warm_up
from gcs.tracking.metrics import ospa, ospa2
from gcs.tracking.models import constant_velocity

Shown = dict[object, np.ndarray]
Peer = Callable[[Detections], Iterator[Shown]]
"""Gives after each scan who is where; of a process of its own with the CPU milliseconds that it took."""

GATE = 4.0
RUST_LMB = Path(__file__).parent / "rust_lmb/target/release/rust-lmb"
START = datetime.datetime(2000, 1, 1, tzinfo=datetime.UTC)


def ours(of: Detections) -> Iterator[Shown]:
    tracker = Glmb("targets", of.params, 1)
    for scan in of.scans:
        tracker.update(scan.t_ns, scan.z_m, scan.sensor, of.births)
        found = tracker.estimates()
        yield dict(
            zip(map(tuple, found.label[found.estimated]), found.mean[found.estimated, :2], strict=True)
        )


class Confirmed:
    """Begin and end of a single-hypothesis track."""

    def __init__(self) -> None:
        self.seen: list[bool] = []
        self.shown = False

    def note(self, *, seen: bool) -> bool:
        """Take in a scan; return whether the track goes on."""
        self.seen = [*self.seen[-2:], seen]
        self.shown |= sum(self.seen) >= 2
        return any(self.seen) if self.shown or len(self.seen) < 3 else False


def near_birth(of: Detections, z: np.ndarray) -> int | None:
    """Which place of birth a detection may come from."""
    for i, birth in enumerate(of.births):
        off = z - birth.mean[:2]
        if off @ np.linalg.solve(birth.cov[:2, :2] + of.scans[0].sensor.noise_cov_m2, off) < GATE**2:
            return i
    return None


def nearest(of: Detections) -> Iterator[Shown]:
    from baselines import NearestNeighbourTracker

    tracker = NearestNeighbourTracker(of.params)
    for scan in of.scans:
        tracker.update(scan.t_ns, scan.z_m, scan.sensor, of.births)
        yield {label: state[:2] for label, state in tracker.estimates().items()}


class Soup:
    """Stone Soup's models for a set; states are east, v_east, north, v_north."""

    def __init__(self, of: Detections) -> None:
        from stonesoup.models.measurement.linear import LinearGaussian
        from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
        from stonesoup.predictor.kalman import KalmanPredictor
        from stonesoup.updater.kalman import KalmanUpdater

        order = np.ix_([0, 2, 1, 3], [0, 2, 1, 3])
        moves = LinearGaussianTimeInvariantTransitionModel(
            transition_matrix=constant_velocity.transition(1.0)[order],
            covariance_matrix=of.params.process_noise(1.0)[order],
        )
        self.sensor = of.scans[0].sensor
        self.sees = LinearGaussian(4, (0, 2), np.array(self.sensor.noise_cov_m2))
        self.predictor, self.updater = KalmanPredictor(moves), KalmanUpdater(self.sees)
        self.births = [(b.mean[[0, 2, 1, 3]], b.cov[order], b.probability) for b in of.births]

    def scan(self, of: Detections, k: int) -> tuple[datetime.datetime, set]:
        from stonesoup.types.detection import Detection

        t = START + datetime.timedelta(seconds=k)
        return t, {Detection(z, timestamp=t, measurement_model=self.sees) for z in of.scans[k].z_m}


def gm_phd(of: Detections) -> Iterator[Shown]:
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.hypothesiser.gaussianmixture import GaussianMixtureHypothesiser
    from stonesoup.measures import Mahalanobis
    from stonesoup.mixturereducer.gaussianmixture import GaussianMixtureReducer
    from stonesoup.types.state import TaggedWeightedGaussianState
    from stonesoup.updater.pointprocess import PHDUpdater

    soup = Soup(of)
    updater = PHDUpdater(
        soup.updater,
        clutter_spatial_density=soup.sensor.clutter_density_per_m2,
        prob_detection=soup.sensor.detection_probability,
        prob_survival=of.params.survival_probability_per_s,
    )
    pairs = DistanceHypothesiser(soup.predictor, soup.updater, Mahalanobis(), missed_distance=GATE)
    hypothesiser = GaussianMixtureHypothesiser(pairs, order_by_detection=True)
    reducer = GaussianMixtureReducer(prune_threshold=1e-5, merge_threshold=4, max_number_components=100)
    mixture = []
    for k in range(len(of.scans)):
        t, detections = soup.scan(of, k)
        born = [
            TaggedWeightedGaussianState(m, P, timestamp=t, weight=w, tag=TaggedWeightedGaussianState.BIRTH)
            for m, P, w in soup.births
        ]
        hypotheses = hypothesiser.hypothesise([*mixture, *born], detections, t)
        mixture = list(reducer.reduce(updater.update(hypotheses).components))
        shown: Shown = {}
        for c in mixture:
            if c.weight > 0.5:
                # Components that split keep one tag; the later ones need names of their own.
                twin = sum(name[0] == c.tag for name in shown)
                shown[c.tag, twin] = np.ravel(c.state_vector)[[0, 2]].astype(float)
        yield shown


def jpda(of: Detections) -> Iterator[Shown]:
    from scipy.stats import chi2
    from stonesoup.dataassociator.probability import JPDA
    from stonesoup.functions import gm_reduce_single
    from stonesoup.hypothesiser.probability import PDAHypothesiser
    from stonesoup.types.array import StateVectors
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.types.track import Track
    from stonesoup.types.update import GaussianStateUpdate

    soup = Soup(of)
    hypothesiser = PDAHypothesiser(
        soup.predictor,
        soup.updater,
        clutter_spatial_density=soup.sensor.clutter_density_per_m2,
        prob_detect=soup.sensor.detection_probability,
        prob_gate=float(chi2.cdf(GATE**2, 2)),
    )
    associator, lives = JPDA(hypothesiser), {}
    for k in range(len(of.scans)):
        t, detections = soup.scan(of, k)
        used = set()
        for track, hypotheses in associator.associate(set(lives), detections, t).items():
            states, weights, missed = [], [], 1.0
            for h in hypotheses:
                if h:
                    states.append(soup.updater.update(h))
                    if float(h.probability) > 0.5:
                        used.add(h.measurement)
                else:
                    states.append(h.prediction)
                    missed = float(h.probability)
                weights.append(float(h.probability))
            mean, cov = gm_reduce_single(
                StateVectors([s.state_vector for s in states]),
                np.stack([s.covar for s in states], axis=2),
                np.asarray(weights),
            )
            track.append(GaussianStateUpdate(mean, cov, hypotheses, t))
            if not lives[track].note(seen=missed < 0.5):
                del lives[track]
        for detection in detections - used:
            place = near_birth(of, np.ravel(detection.state_vector).astype(float))
            if place is not None:
                mean, cov, _ = soup.births[place]
                first = SingleHypothesis(GaussianState(mean, cov, timestamp=t), detection)
                track = Track([soup.updater.update(first)])
                lives[track] = Confirmed()
                lives[track].note(seen=True)
        yield {
            tr.id: np.ravel(tr.state_vector)[[0, 2]].astype(float) for tr, life in lives.items() if life.shown
        }


def rust_lmb(program: Path, way: str, of: Detections) -> Iterator[tuple[Shown, float]]:
    sensor, births = of.scans[0].sensor, of.births
    (dt_s,) = {(b.t_ns - a.t_ns) / 1e9 for a, b in zip(of.scans, of.scans[1:], strict=False)}
    survival = of.params.survival_probability_per_s**dt_s
    Q = of.params.process_noise(dt_s)
    # What counts is the clutter's density: a unit of it over the area in which there is one.
    numbers = [
        [constant_velocity.transition(dt_s), Q, sensor.noise_cov_m2],
        [survival, sensor.detection_probability, 1.0, 1.0 / sensor.clutter_density_per_m2],
        [len(births), births[0].probability, *chain(*((b.mean, b.cov) for b in births))],
        [len(of.scans), *chain(*((len(scan.z_m), scan.z_m) for scan in of.scans))],
    ]
    text = " ".join(repr(float(x)) for part in chain(*numbers) for x in np.ravel(part))
    try:
        done = subprocess.run([program, way], input=text, capture_output=True, text=True, check=True)
    except FileNotFoundError:
        raise ImportError(f"--lmb {program}") from None
    for line in done.stdout.splitlines():
        cpu_ns, *rest = map(float, line.split())
        yield {(born, place): np.array(xy) for born, place, *xy in np.reshape(rest, (-1, 4))}, cpu_ns / 1e6


PEERS: dict[str, Peer] = {
    "ours": ours,
    "Stone Soup GM-PHD": gm_phd,
    "Stone Soup JPDA": jpda,
    "nearest": nearest,
}


def measure(peer: Peer, of: Detections, scans: int) -> tuple[float, float, float]:
    """OSPA, OSPA(2) and mean CPU milliseconds per scan of the first scans of a set.

    Scored behind all scans: what scores would drive what tracks out of the processor's caches.
    """
    truth, found, spent = list(of.truth.values()), [], []
    run = peer(of)
    for _ in range(min(scans, len(of.scans))):
        begin = time.process_time()
        shown = next(run)
        ms = (time.process_time() - begin) * 1e3
        shown, ms = shown if isinstance(shown, tuple) else (shown, ms)
        found.append(shown)
        spent.append(ms)
    near, windows = [], []
    for k in range(len(found)):
        x, y = (np.reshape(list(s.values()), (-1, 2)) for s in (found[k], truth[k]))
        near.append(ospa(x, y).total_m)
        windows.append(ospa2(found[max(0, k - 9) : k + 1], truth[max(0, k - 9) : k + 1]).total_m)
    return float(np.mean(near)), float(np.mean(windows)), float(np.mean(spent))


def main() -> None:
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--sets", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1000, help="of the first fresh draw")
    parser.add_argument("--scans", type=int, default=100)
    parser.add_argument("--recorded", action="store_true", help="track the recorded sets, not fresh draws")
    parser.add_argument(
        "--only", action="append", help="name of a tracker, besides ours; any number of times"
    )
    parser.add_argument("--lmb", type=Path, default=RUST_LMB, help="the built rust_lmb")
    arguments = parser.parse_args()
    peers = PEERS | {f"Rust LMB, {way}": partial(rust_lmb, arguments.lmb, way) for way in ("lbp", "gibbs")}
    peers = {n: p for n, p in peers.items() if n in ("ours", *(arguments.only or peers))}
    warm_up()
    n_fresh = 0 if arguments.recorded else arguments.sets
    for difficulty in ("demo", "hard"):
        with sets(arguments.data, difficulty, n_fresh, arguments.seed) as paths:
            loaded = [load(path, None, None) for path in paths[: arguments.sets]]
        what = "recorded sets" if arguments.recorded else "fresh draws"
        print(f"{difficulty}: {len(loaded)} {what} of {arguments.scans} scans")
        our_ms = 0.0
        for name, peer in peers.items():
            try:
                near, window, ms = np.mean([measure(peer, of, arguments.scans) for of in loaded], axis=0)
            except ImportError as error:
                print(f"    {name:20s} not installed: {error}")
                continue
            our_ms = our_ms or ms
            ratio = ms / our_ms
            print(
                f"    {name:20s} OSPA {near:6.2f}  OSPA(2) {window:6.2f}  {ms:8.2f} ms/scan  {ratio:7.1f} x"
            )


if __name__ == "__main__":
    main()
