"""A user would wait for targets that are seen and never tracked; or learn to ignore alarms about clutter."""

import math

import numpy as np
import pytest

from gcs.model import NS_PER_S, Sensor
from gcs.tracking.models.persistent_detections import PersistentDetections

SIDE_M = 2000.0
FIELD = (0.0, 0.0, SIDE_M, SIDE_M)


def sensor(clutter, detection=0.95, field=FIELD):
    return Sensor("s", detection, clutter / SIDE_M**2, np.eye(2) * 10.0, field)


def scan(rng, clutter, objects=(), detection=0.95):
    seen = [place + rng.normal(0.0, math.sqrt(10.0), 2) for place in objects if rng.random() < detection]
    noise = rng.uniform(0.0, SIDE_M, (rng.poisson(clutter), 2))
    return rng.permutation(np.vstack([np.reshape(seen, (-1, 2)), noise]))


def found(clutter, objects, scans, seed, detection=0.95, one=None):
    """Numbers of the scans at which chains became persistent, and where."""
    rng = np.random.default_rng(seed)
    persistent = PersistentDetections()
    news = []
    for k in range(scans):
        z = scan(rng, clutter, objects(k), detection)
        used = one or sensor(clutter, detection)
        new, is_persistent = persistent.process_scan(k * NS_PER_S, z, used, np.zeros(len(z)))
        assert is_persistent.sum() <= len(persistent.places_m)
        news += [(k, place) for place in new]
    return news, persistent


@pytest.mark.parametrize(("clutter", "scans"), [(0.0, 50), (20.0, 1500), (100.0, 300)])
def test_clutter_alone_persists_nowhere(clutter, scans):
    news, _ = found(clutter, lambda _: [], scans, seed=1)
    assert news == []


@pytest.mark.parametrize("detection", [0.7, 0.95, 1.0])
@pytest.mark.parametrize("speed_m_s", [0.0, 3.0, 20.0])
@pytest.mark.parametrize("clutter", [5.0, 60.0])
def test_an_object_persists_within_some_scans_and_once(clutter, speed_m_s, detection):
    def place(k):
        return np.array([300.0 + speed_m_s * k, 700.0])

    news, persistent = found(clutter, lambda k: [place(k)], 25, 2, detection)
    assert len(news) == 1
    (k, where) = news[0]
    assert k <= (18 if detection < 0.9 else 10)
    assert math.dist(where, place(k)) < 15.0
    assert len(persistent.places_m) == 1


def test_the_detections_of_a_persistent_chain_are_told():
    persistent = PersistentDetections()
    told = []
    for k in range(12):
        z = np.array([[1500.0, 100.0 + 150.0 * k], [300.0, 700.0]])  # the first are too far from each other
        told.append(persistent.process_scan(k * NS_PER_S, z, sensor(20), np.zeros(2))[1].tolist())
    assert told[0] == [False, False]
    assert told[-1] == [False, True]


def test_explained_detections_do_not_persist():
    persistent = PersistentDetections()
    for k in range(30):
        z = np.array([[300.0, 700.0], [1500.0, 100.0]])
        new, is_persistent = persistent.process_scan(k * NS_PER_S, z, sensor(20), np.array([0.99, 1.0]))
        assert not len(new)
        assert not is_persistent.any()


def test_it_ends_when_the_object_is_gone_or_tracked():
    _, persistent = found(20.0, lambda _: [np.array([300.0, 700.0])], 25, seed=3)
    nothing = np.zeros((0, 2))
    for k in range(25, 40):
        persistent.process_scan(k * NS_PER_S, nothing, sensor(20), np.zeros(0))
    assert not len(persistent.places_m)


def test_an_unobserved_chain_lasts_until_its_position_is_lost():
    _, persistent = found(20.0, lambda _: [np.array([300.0, 700.0])], 25, seed=3)
    elsewhere = sensor(20, field=(1000.0, 0.0, 2000.0, 2000.0))
    persistent.process_scan(27 * NS_PER_S, np.zeros((0, 2)), elsewhere, np.zeros(0))
    assert len(persistent.places_m) == 1
    persistent.process_scan(600 * NS_PER_S, np.zeros((0, 2)), elsewhere, np.zeros(0))
    assert not len(persistent.places_m)


def test_a_flood_of_detections_is_bounded():
    rng = np.random.default_rng(1)
    persistent = PersistentDetections()
    for k in range(3):
        z = rng.uniform(0.0, SIDE_M, (20_000, 2))
        persistent.process_scan(k * NS_PER_S, z, sensor(20_000), np.zeros(len(z)))
    assert persistent.score.size <= 300
