"""Without known birth positions, all objects must be found, and clutter must not fill the picture."""

import numpy as np
import pytest

from gcs.model import NS_PER_S, Sensor
from gcs.tracking.glmb.filter import Glmb, GlmbParams
from gcs.tracking.models.adaptive_birth import AdaptiveBirth

SIDE_M = 2000.0
FIELD = (0.0, 0.0, SIDE_M, SIDE_M)


def sensor(clutter, name="s", field=FIELD):
    return Sensor(name, 0.95, clutter / SIDE_M**2, np.eye(2) * 25.0, field)


def unknown(per_s=0.05, most=0.1):
    return AdaptiveBirth(per_s, 8.0, most, GlmbParams(1.0).process_noise)


def scan(rng, clutter, objects=()):
    seen = [place + rng.normal(0.0, 5.0, 2) for place in objects if rng.random() < 0.95]
    noise = rng.uniform(0.0, SIDE_M, (rng.poisson(clutter), 2))
    return rng.permutation(np.vstack([np.reshape(seen, (-1, 2)), noise]))


def follow(clutter, objects, scans, seed, sensors=None):
    """Numbers in the estimate, scan by scan; `objects(k)` gives the true places."""
    rng = np.random.default_rng(seed)
    births = unknown()
    tracker = Glmb("targets", GlmbParams(accel_psd_m2_s3=1.0), 1, summarise_detections=True)
    found = []
    for k in range(scans):
        t_ns = k * NS_PER_S
        for one in sensors or [sensor(clutter)]:
            z = scan(rng, clutter, objects(k))
            tracker.update(t_ns, z, one, births.births(t_ns))
            births.add_scan(t_ns, z, one, tracker.detection_summary.explained)
        found.append(len(tracker.estimate()))
    return np.array(found), tracker


@pytest.mark.parametrize("clutter", [5, 60])
def test_clutter_alone_leaves_the_picture_empty(clutter):
    found, _ = follow(clutter, lambda _: [], 60, seed=clutter)
    assert found.mean() < 0.1


def moving(k):
    return [
        np.array([300.0 + 7.0 * k, 500.0]),
        np.array([1500.0, 400.0 + 5.0 * k]),
        np.array([900.0, 1600.0]),
    ]


def test_every_object_is_found_within_a_few_scans_and_once():
    found, tracker = follow(20, moving, 30, seed=1)
    assert (found[6:] == 3).mean() > 0.9
    places = np.array([track.mean[:2] for track in tracker.estimate()])
    for true in moving(29):
        assert np.linalg.norm(places - true, axis=1).min() < 15.0


def test_two_sensors_at_one_epoch_find_each_object_once():
    found, _ = follow(10, moving, 30, 2, [sensor(10, "a"), sensor(10, "b")])
    assert found.max() <= 4
    assert (found[4:] == 3).mean() > 0.9


def test_births_add_up_to_the_rate_however_many_detections_and_sensors_there_are():
    rng = np.random.default_rng(0)
    for n_sensors in (1, 3):
        for n in (50, 500):
            births = unknown(per_s=0.2)
            total = 0.0
            for k in range(1, 21):
                for i in range(n_sensors):
                    z = rng.uniform(0.0, SIDE_M, (n, 2))
                    total += sum(b.probability for b in births.births(k * NS_PER_S))
                    births.add_scan(k * NS_PER_S, z, sensor(n, f"s{i}"), np.zeros(n))
            assert total == pytest.approx(0.2 * 20, rel=0.1)


def test_explained_detections_give_no_birth_and_no_birth_exceeds_the_cap():
    births = unknown(per_s=5.0, most=0.1)
    z = np.array([[10.0, 10.0], [500.0, 500.0]])
    births.add_scan(0, z, sensor(1), np.array([1.0, 0.2]))
    (only,) = births.births(NS_PER_S)
    assert only.mean[:2] == pytest.approx((500.0, 500.0))
    assert only.probability == 0.1
    assert births.births(2 * NS_PER_S) == []


def test_a_birth_is_predicted_to_the_next_scan():
    births = unknown()
    births.add_scan(0, np.array([[10.0, 10.0]]), sensor(1), np.zeros(1))
    (soon,) = births.births(0)
    births.add_scan(NS_PER_S, np.array([[10.0, 10.0]]), sensor(1), np.zeros(1))
    (later,) = births.births(3 * NS_PER_S)
    np.testing.assert_allclose(soon.cov, np.diag([25.0, 25.0, 64.0, 64.0]))
    assert later.cov[0, 0] > 25.0 + 4.0 * 64.0
    assert np.linalg.eigvalsh(later.cov).min() > 0.0


def test_an_object_outside_every_field_of_view_fades():
    """It lives by survival alone, as one track, and is given up when its place is no more than a guess."""
    params = GlmbParams(accel_psd_m2_s3=1.0, lost_std_m=300.0)
    rng = np.random.default_rng(3)
    births = unknown()
    tracker = Glmb("targets", params, 1, summarise_detections=True)
    radar = sensor(5)
    numbers = []
    existence = []
    for k in range(140):
        place = np.array([1500.0 + 20.0 * k, 1000.0])
        z = scan(rng, 5, [place] if place[0] <= SIDE_M else [])
        tracker.update(k * NS_PER_S, z, radar, births.births(k * NS_PER_S))
        births.add_scan(k * NS_PER_S, z, radar, tracker.detection_summary.explained)
        tracks = [t for t in tracker.picture(0).tracks if t.existence > 0.2]
        numbers.append(len(tracks))
        existence.append(max((t.existence for t in tracks), default=0.0))
    assert numbers[20] == 1  # still there, in sight
    assert 0.6 < existence[45] <= 0.99**15  # some twenty seconds after it left
    assert max(numbers[30:]) <= 1
    assert numbers[-1] == 0
