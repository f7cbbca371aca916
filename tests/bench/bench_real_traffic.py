"""Our tracker against that of Stone Soup's own demonstration, on its AIS reports of ships in the Solent.

    pip install swarm-gcs[bench]
    python tests/bench/bench_real_traffic.py SolentAIS_20160112_130211.csv

The file is in `docs/demos` of the Stone Soup repository. The detections are those of its demonstration: the
last report of each ship in each minute, in UTM. So ships come irregularly, and those at anchor in a third of
the minutes. The tracker of the demonstration (nearest neighbour, Ornstein-Uhlenbeck motion, 10 minutes until
a track is deleted) is run as it is, which compares MMSI numbers, and without that. Ours knows positions only.

The ground truth are the reports by MMSI, at each minute between reports that are at most 10 minutes apart.
Scores are Stone Soup's: OSPA (c = 500 m, p = 1) and SIAP (associated within 500 m), once a minute, and
identity switches (CLEAR MOT, 500 m). Tracks are predicted to the minute. Time is CPU time for all reports.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from datetime import datetime, timedelta
from functools import partial
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from stonesoup.dataassociator.neighbour import NearestNeighbour
from stonesoup.dataassociator.tracktotrack import TrackToTruth
from stonesoup.deleter.time import UpdateTimeDeleter
from stonesoup.feeder.filter import MetadataReducer
from stonesoup.feeder.geo import LongLatToUTMConverter
from stonesoup.feeder.time import TimeSyncFeeder
from stonesoup.gater.filtered import FilteredDetectionsGater
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.initiator.simple import SimpleMeasurementInitiator
from stonesoup.measures import Euclidean, Mahalanobis
from stonesoup.metricgenerator.manager import MultiManager
from stonesoup.metricgenerator.ospametric import OSPAMetric
from stonesoup.metricgenerator.tracktotruthmetrics import SIAPMetrics
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, OrnsteinUhlenbeck
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.reader.generic import CSVDetectionReader
from stonesoup.tracker.simple import MultiTargetTracker
from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track
from stonesoup.updater.kalman import KalmanUpdater

from gcs.tracking import (
    GlmbParams,
    Sensor,
    SwitchingMotion,
    TrackingModel,
    constant_velocity,
    identity_switches,
    linear_motion,
    track_scans,
)
from gcs.tracking.glmb.filter import warm_up
from gcs.tracking.stonesoup_adapter import StoneSoupTracker, positions_m, to_scans, to_tracks

Scans: TypeAlias = list[tuple[datetime, set[Any]]]

NOISE_M2 = 15.0 * np.eye(2)
MAX_GAP = timedelta(minutes=10)

motion = CombinedLinearGaussianTransitionModel([OrnsteinUhlenbeck(0.5, 1e-4), OrnsteinUhlenbeck(0.5, 1e-4)])
measurement = LinearGaussian(4, (0, 2), NOISE_M2)
predictor = KalmanPredictor(motion)
updater = KalmanUpdater(measurement)


def read(path: str) -> Scans:
    """Return the detections of each minute, as the demonstration has them."""
    reports = CSVDetectionReader(
        path, state_vector_fields=("Longitude_degrees", "Latitude_degrees"), time_field="Time"
    )
    minutes = MetadataReducer(TimeSyncFeeder(reports, time_window=timedelta(seconds=60)), "MMSI")
    return [(at, set(found)) for at, found in LongLatToUTMConverter(minutes)]


def ground_truth(scans: Scans) -> set[Any]:
    """Return the ship of each MMSI at each minute; it is another path behind a gap."""
    ships: dict[str, list[Any]] = {}
    for _, found in scans:
        for one in found:
            ships.setdefault(one.metadata["MMSI"], []).append(one)
    paths = []
    for mmsi, reports in ships.items():
        path = GroundTruthPath(id=mmsi)
        for before, after in pairwise(sorted(reports, key=lambda one: one.timestamp)):
            span = after.timestamp - before.timestamp
            step = after.state_vector - before.state_vector
            if span > MAX_GAP:
                paths.append(path)
                path = GroundTruthPath(id=mmsi)
                continue
            for at, _ in scans:
                if before.timestamp < at <= after.timestamp:
                    place = before.state_vector + step * ((at - before.timestamp) / span)
                    path.append(GroundTruthState(place, timestamp=at))
        paths.append(path)
    return {path for path in paths if len(path) > 0}


def demonstration(scans: Scans, *, with_mmsi: bool) -> set[Any]:
    """Track as the demonstration does."""
    hypothesiser = DistanceHypothesiser(predictor, updater, Mahalanobis(), missed_distance=3)
    gated = FilteredDetectionsGater(hypothesiser, metadata_filter="MMSI") if with_mmsi else hypothesiser
    tracker = MultiTargetTracker(
        initiator=SimpleMeasurementInitiator(
            GaussianState([[0], [0], [0], [0]], np.diag([0, 10, 0, 10])), measurement
        ),
        deleter=UpdateTimeDeleter(time_since_update=MAX_GAP),
        detector=scans,
        data_associator=NearestNeighbour(gated),
        updater=updater,
    )
    shown: dict[Any, list[Any]] = {}
    for at, tracks in tracker:
        for one in tracks:
            state = one[-1] if one[-1].timestamp == at else predictor.predict(one[-1], timestamp=at)
            shown.setdefault(one, []).append(GaussianState(state.state_vector, state.covar, timestamp=at))
    return {Track(states) for states in shown.values()}


def sensor_of(scans: Scans) -> Sensor:
    """Return the sensor: hardly a false report in the box about all reports."""
    places = np.array([one.state_vector.ravel() for _, found in scans for one in found], float)
    box = (*(places.min(0) - 1000.0), *(places.max(0) + 1000.0))
    area = (box[2] - box[0]) * (box[3] - box[1])
    return Sensor("ais", 0.5, 0.01 / area, NOISE_M2, box)


PARAMS = GlmbParams(accel_psd_m2_s3=0.5, survival_probability_per_s=0.99995)
BIRTHS = {"births_per_s": 0.02, "birth_speed_std_m_s": 5.0}
SAME_MOTION = TrackingModel(PARAMS, **BIRTHS)
"""The acceleration of the demonstration's motion."""


def at_rest(dt_s: float) -> Any:
    """Return the covariance that a ship at anchor or in a berth gains: it swings a little."""
    return np.diag([0.02 * dt_s, 0.02 * dt_s, 0.1, 0.1])


REST = linear_motion(("x", "y", "vx", "vy"), lambda _: np.diag([1.0, 1.0, 0.0, 0.0]), at_rest)
SHIPS = TrackingModel(
    replace(PARAMS, accel_psd_m2_s3=0.0),
    motion=SwitchingMotion((REST, constant_velocity(2, 0.05)), (36_000.0, 3600.0)),
    **BIRTHS,
)
"""Ships at rest, and under way."""


def glmb(scans: Scans, model: TrackingModel) -> set[Any]:
    """Track by our filter, as a tracker of Stone Soup."""
    tracks: set[Any] = set()
    for _, found in StoneSoupTracker(scans, sensor_of(scans), model):
        tracks |= found
    return tracks


def glmb_smoothed(scans: Scans) -> set[Any]:
    """Track by our smoother."""
    return to_tracks(track_scans(to_scans(scans, sensor_of(scans)), SHIPS, "smoothed"))


TRACKERS: dict[str, Callable[[Scans], set[Any]]] = {
    "demonstration, with MMSI": partial(demonstration, with_mmsi=True),
    "demonstration, without": partial(demonstration, with_mmsi=False),
    "GLMB, same motion": partial(glmb, model=SAME_MOTION),
    "GLMB, rest and sailing": partial(glmb, model=SHIPS),
    "the same, smoothed": glmb_smoothed,
}
SIAP = {
    "complete": "SIAP Completeness",
    "ambiguity": "SIAP Ambiguity",
    "spurious": "SIAP Spuriousness",
    "position m": "SIAP Position Accuracy",
}


def sampled(tracks: Iterable[Any], times: list[datetime]) -> set[Any]:
    """Return tracks with their states at the minutes only."""
    wanted = set(times)
    parts = [Track([state for state in one if state.timestamp in wanted], id=one.id) for one in tracks]
    return {part for part in parts if len(part) > 0}


def measures(tracks: set[Any], truths: set[Any]) -> list[float]:
    """Return OSPA, its mean over time, and the figures of SIAP."""
    places = Euclidean((0, 2), (0, 1))
    keys = {"tracks_key": "tracks", "truths_key": "truths"}
    manager = MultiManager(
        [
            OSPAMetric(c=500.0, p=1, generator_name="ospa", measure=places, **keys),
            SIAPMetrics(places, Euclidean((1, 3), (0, 1)), generator_name="siap", **keys),
        ],
        TrackToTruth(500.0, measure=places),
    )
    manager.add_data({"tracks": tracks, "truths": truths}, overwrite=False)
    found = manager.generate_metrics()
    ospa = np.mean([one.value for one in found["ospa"]["OSPA distances"].value])
    return [float(ospa), *(float(found["siap"][name].value) for name in SIAP.values())]


def main() -> None:
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file")
    parser.add_argument("--only", choices=list(TRACKERS), help="one tracker alone")
    options = parser.parse_args()
    scans = read(options.file)
    truths = ground_truth(scans)
    times = [at for at, _ in scans]
    ships = len({path.id for path in truths})
    warm_up()
    titles = ["labels/ship", "switches", "OSPA m", *SIAP, "CPU s"]
    print(f"{ships} ships".ljust(26) + "".join(title.rjust(14) for title in titles))
    for name, tracker in TRACKERS.items():
        if options.only not in (None, name):
            continue
        begin_s = time.process_time()
        tracks = tracker(scans)
        took_s = time.process_time() - begin_s
        tracks = sampled(tracks, times)
        labels = len({one.id for one in tracks}) / ships
        places_m = [positions_m(tracks, times), positions_m(truths, times, (0, 1))]
        switches = identity_switches(*places_m, c_m=500.0)
        figures = [labels, switches, *measures(tracks, truths), took_s]
        print(name.ljust(26) + "".join(f"{figure:14.3f}" for figure in figures), flush=True)


if __name__ == "__main__":
    main()
