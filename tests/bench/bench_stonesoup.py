"""Our tracker against Stone Soup's GNN, JPDA, MFA (its MHT) and GM-PHD, on the simulation of its MFA example.

    pip install swarm-gcs[bench]
    python tests/bench/bench_stonesoup.py [--runs 100]

Two objects at nearly constant velocity cross; 20 scans of 1 s, detection probability 0.9, error 0.7 m, and
Poisson clutter of mean 5 for each object over 35 m x 35 m. All trackers know this model and the
distribution of the two starts. Metrics are Stone Soup's: OSPA (c = 10 m, p = 1) and SIAP (associated within
3 m). "GLMB smoothed" uses all scans for each state, the others the scans up to it. Time is CPU time for all
scans of a run.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from datetime import timedelta
from typing import Any

import numpy as np
from scipy.stats import chi2
from stonesoup.dataassociator.mfa import MFADataAssociator
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.dataassociator.probability import JPDA
from stonesoup.dataassociator.tracktotrack import TrackToTruth
from stonesoup.functions import gm_reduce_single
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.hypothesiser.gaussianmixture import GaussianMixtureHypothesiser
from stonesoup.hypothesiser.mfa import MFAHypothesiser
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.measures import Euclidean, Mahalanobis
from stonesoup.metricgenerator.manager import MultiManager
from stonesoup.metricgenerator.ospametric import OSPAMetric
from stonesoup.metricgenerator.tracktotruthmetrics import SIAPMetrics
from stonesoup.mixturereducer.gaussianmixture import GaussianMixtureReducer
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.tracker.pointprocess import PointProcessMultiTargetTracker
from stonesoup.types.array import StateVectors
from stonesoup.types.detection import Clutter, TrueDetection
from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
from stonesoup.types.mixture import GaussianMixture
from stonesoup.types.numeric import Probability
from stonesoup.types.state import GaussianState, TaggedWeightedGaussianState
from stonesoup.types.track import Track
from stonesoup.types.update import GaussianMixtureUpdate, GaussianStateUpdate
from stonesoup.updater.kalman import KalmanUpdater
from stonesoup.updater.pointprocess import PHDUpdater

from gcs.tracking import Birth, GlmbParams, Sensor, TrackingModel, track
from gcs.tracking.glmb.filter import warm_up
from gcs.tracking.stonesoup_adapter import StoneSoupTracker, time_of, to_arrays, to_tracks

START = time_of(1_700_000_000 * 10**9)
SCANS = 20
ACCEL_PSD = 0.005
NOISE_M2 = 0.7**2 * np.eye(2)
DETECTION = 0.9
GATE = float(chi2.cdf(8, 2))
BOX_M = (-5.0, -5.0, 30.0, 30.0)
CLUTTER = 5.0
"""Mean number of false detections for each object."""
DENSITY = 2 * CLUTTER / 35.0**2
STARTS = np.array([[0.0, 1.0, 0.0, 1.0], [0.0, 1.0, 20.0, -1.0]])
START_VARIANCE = np.array([1.5, 0.5, 1.5, 0.5])

motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(ACCEL_PSD), ConstantVelocity(ACCEL_PSD)])
measurement = LinearGaussian(4, (0, 2), NOISE_M2)
predictor = KalmanPredictor(motion)
updater = KalmanUpdater(measurement)


def simulate(seed: int) -> tuple[set[Any], list[tuple[Any, list[Any]]]]:
    """Return ground truth and the detections of each time."""
    rng = np.random.default_rng(seed)
    process_m2 = motion.covar(time_interval=timedelta(seconds=1))
    step = motion.matrix(time_interval=timedelta(seconds=1))
    times = [START + timedelta(seconds=k) for k in range(SCANS)]
    truths = []
    for start in STARTS:
        states = [start]
        for _ in times[1:]:
            states.append(rng.multivariate_normal(step @ states[-1], process_m2))
        path = [GroundTruthState(s, timestamp=t) for s, t in zip(states, times, strict=True)]
        truths.append(GroundTruthPath(path))
    scans = []
    for k, at in enumerate(times):
        found = []
        for truth in truths:
            if rng.random() < DETECTION:
                place = rng.multivariate_normal(truth[k].state_vector[[0, 2], 0].astype(float), NOISE_M2)
                found.append(
                    TrueDetection(place, groundtruth_path=truth, timestamp=at, measurement_model=measurement)
                )
            false = rng.uniform(-5.0, 30.0, (rng.poisson(CLUTTER), 2))
            found += [Clutter(place, timestamp=at, measurement_model=measurement) for place in false]
        scans.append((at, found))
    return set(truths), scans


def gnn(scans: list[tuple[Any, list[Any]]]) -> set[Any]:
    """Track by global nearest neighbour."""
    hypothesiser = DistanceHypothesiser(predictor, updater, Mahalanobis(), missed_distance=3)
    associator = GNNWith2DAssignment(hypothesiser)
    tracks = {Track([GaussianState(s, np.diag(START_VARIANCE), timestamp=START)]) for s in STARTS}
    for at, detections in scans:
        for one, hypothesis in associator.associate(tracks, set(detections), at).items():
            one.append(updater.update(hypothesis) if hypothesis else hypothesis.prediction)
    return {Track(one.states[1:]) for one in tracks}


def jpda(scans: list[tuple[Any, list[Any]]]) -> set[Any]:
    """Track by joint probabilistic data association."""
    associator = JPDA(PDAHypothesiser(predictor, updater, DENSITY, prob_gate=GATE, prob_detect=DETECTION))
    tracks = {Track([GaussianState(s, np.diag(START_VARIANCE), timestamp=START)]) for s in STARTS}
    for at, detections in scans:
        for one, hypotheses in associator.associate(tracks, set(detections), at).items():
            states = [updater.update(h) if h else h.prediction for h in hypotheses]
            weights = np.array([h.probability for h in hypotheses], float)
            mean, cov = gm_reduce_single(
                StateVectors([s.state_vector for s in states]),
                np.stack([s.covar for s in states], axis=2),
                weights,
            )
            one.append(GaussianStateUpdate(mean, cov, hypotheses, at))
    return {Track(one.states[1:]) for one in tracks}


def mfa(scans: list[tuple[Any, list[Any]]]) -> set[Any]:
    """Track by multi-frame assignment over three scans, Stone Soup's multiple hypothesis tracker."""
    hypothesiser = PDAHypothesiser(predictor, updater, DENSITY, prob_gate=GATE, prob_detect=DETECTION)
    associator = MFADataAssociator(MFAHypothesiser(hypothesiser), slide_window=3)
    tracks = {Track([GaussianMixture([tagged(s, [], Probability(1))])]) for s in STARTS}
    shown: dict[Any, list[Any]] = {one: [] for one in tracks}
    for at, detections in scans:
        for one, hypotheses in associator.associate(tracks, set(detections), at).items():
            parts = [updater.update(h) if h else h.prediction for h in hypotheses]
            one.append(GaussianMixtureUpdate(components=parts, hypothesis=hypotheses))
            best = max(parts, key=lambda part: float(part.weight))
            shown[one].append(GaussianState(best.state_vector, best.covar, timestamp=at))
    return {Track(states) for states in shown.values()}


def gm_phd(scans: list[tuple[Any, list[Any]]]) -> set[Any]:
    """Track by a Gaussian-mixture PHD filter."""
    base = DistanceHypothesiser(predictor, updater, Mahalanobis(), missed_distance=3)
    tracker = PointProcessMultiTargetTracker(
        detector=[(at, set(detections)) for at, detections in scans],
        updater=PHDUpdater(
            updater, clutter_spatial_density=DENSITY, prob_detection=DETECTION, prob_survival=0.99
        ),
        hypothesiser=GaussianMixtureHypothesiser(base, order_by_detection=True),
        reducer=GaussianMixtureReducer(prune_threshold=1e-6, pruning=True, merge_threshold=16, merging=True),
        extraction_threshold=0.5,
        birth_component=tagged([12.5, 0.0, 12.5, 0.0], TaggedWeightedGaussianState.BIRTH, 1e-6),
    )
    tracker.gaussian_mixture = GaussianMixture([tagged(s, str(n), 1.0) for n, s in enumerate(STARTS)])
    tracks: set[Any] = set()
    for _, found in tracker:
        tracks |= found
    return tracks


def tagged(state: Any, tag: Any, weight: Any) -> Any:
    """Return a component of a mixture at the start."""
    cov = np.diag(START_VARIANCE)
    return TaggedWeightedGaussianState(state, cov, timestamp=START, weight=weight, tag=tag)


SENSOR = Sensor("sensor", DETECTION, DENSITY, NOISE_M2, BOX_M)
BIRTHS = tuple(Birth(start[[0, 2, 1, 3]], np.diag(START_VARIANCE[[0, 2, 1, 3]]), 0.99) for start in STARTS)
MODEL = TrackingModel(
    GlmbParams(accel_psd_m2_s3=ACCEL_PSD, survival_probability_per_s=0.99),
    BIRTHS,
    birth_again_probability=1e-9,
)


def glmb(scans: list[tuple[Any, list[Any]]]) -> set[Any]:
    """Track by our filter, as a tracker of Stone Soup."""
    tracks: set[Any] = set()
    for _, found in StoneSoupTracker(scans, SENSOR, MODEL):
        tracks |= found
    return tracks


def glmb_smoothed(scans: list[tuple[Any, list[Any]]]) -> set[Any]:
    """Track by our smoother."""
    return to_tracks(track(*to_arrays(scans), SENSOR, MODEL, "smoothed"))


TRACKERS: dict[str, Callable[[list[tuple[Any, list[Any]]]], set[Any]]] = {
    "GNN": gnn,
    "JPDA": jpda,
    "MFA (MHT), 3 scans": mfa,
    "GM-PHD": gm_phd,
    "GLMB (ours)": glmb,
    "GLMB smoothed (ours)": glmb_smoothed,
}
SIAP = {
    "completeness": "SIAP Completeness",
    "ambiguity": "SIAP Ambiguity",
    "spuriousness": "SIAP Spuriousness",
    "position m": "SIAP Position Accuracy",
    "ID changes": "SIAP Rate of Track Number Change",
}


def measures(tracks: set[Any], truths: set[Any]) -> list[float]:
    """Return OSPA, its mean over time, and the figures of SIAP."""
    places = Euclidean((0, 2))
    keys = {"tracks_key": "tracks", "truths_key": "truths"}
    manager = MultiManager(
        [
            OSPAMetric(c=10.0, p=1, generator_name="ospa", measure=places, **keys),
            SIAPMetrics(places, Euclidean((1, 3)), generator_name="siap", **keys),
        ],
        TrackToTruth(3.0, measure=places),
    )
    manager.add_data({"tracks": tracks, "truths": truths}, overwrite=False)
    found = manager.generate_metrics()
    ospa = np.mean([one.value for one in found["ospa"]["OSPA distances"].value])
    return [float(ospa), *(float(found["siap"][name].value) for name in SIAP.values())]


def main() -> None:
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=100)
    runs = parser.parse_args().runs
    warm_up()
    for tracker in TRACKERS.values():
        tracker(simulate(0)[1])  # nothing is loaded or compiled in a measured run
    titles = ["OSPA m", "± error", *SIAP, "ms a run"]
    print(f"{runs} runs".ljust(22) + "".join(title.rjust(14) for title in titles))
    for name, tracker in TRACKERS.items():
        rows, took_s = [], 0.0
        for seed in range(1, runs + 1):
            truths, scans = simulate(seed)
            begin_s = time.process_time()
            tracks = tracker(scans)
            took_s += time.process_time() - begin_s
            rows.append(measures(tracks, truths))
        mean = np.nanmean(rows, axis=0)
        error = np.std(rows, axis=0, ddof=1)[0] / np.sqrt(runs)
        figures = [mean[0], error, *mean[1:], 1e3 * took_s / runs]
        print(name.ljust(22) + "".join(f"{figure:14.3f}" for figure in figures), flush=True)


if __name__ == "__main__":
    main()
