"""What an operator loses when the tracker errs: agents that fade after one miss, swapped names."""

import math

import numpy as np
import pytest

from gcs import jit
from gcs.model import NS_PER_S, Sensor
from gcs.tracking.glmb import hypotheses, marginals
from gcs.tracking.glmb.filter import Birth, Glmb, GlmbParams, warm_up, warm_up_calls
from gcs.tracking.metrics import ospa
from gcs.tracking.trajectories import recovery

FOV = (0.0, 0.0, 2000.0, 2000.0)
COV = np.diag([100.0, 100.0, 20.0, 20.0])
PLACES = np.array([[200.0, 300.0], [220.0, 900.0], [200.0, 1500.0], [240.0, 1800.0]])


def sensor(p_d=0.98, clutter=20.0, noise_m=3.16, fov=FOV, name="radar"):
    area = (fov[2] - fov[0]) * (fov[3] - fov[1])
    return Sensor(name, p_d, clutter / area, np.eye(2) * noise_m**2, fov)


def births(places=PLACES, probability=0.03):
    return [Birth(np.array([*place, 0.0, 0.0]), COV, probability) for place in places]


def tracker(seed=1, **params):
    return Glmb("agents", GlmbParams(**{"accel_psd_m2_s3": 1.0, **params}), seed)


def existence(of):
    return {track.label: track.existence for track in of.picture(0).tracks}


def clutter(rng, n=20):
    return rng.uniform(0, 2000, (rng.poisson(n), 2))


def followed(scans, p_d=0.98, **params):
    """A tracker that saw one object at rest for some scans, and the time of the last one."""
    of = tracker(**params)
    for k in range(scans):
        of.update(k * NS_PER_S, PLACES[:1], sensor(p_d), births(PLACES[:1]) if k == 0 else [])
    return of, (scans - 1) * NS_PER_S


def test_four_objects_there_at_the_first_scan_are_all_picked_up_at_once():
    rng = np.random.default_rng(2)
    of = tracker()
    of.update(0, np.vstack([PLACES + rng.normal(0, 3, (4, 2)), clutter(rng)]), sensor(), births())
    picture = of.picture(0)
    assert [track.label for track in picture.tracks] == [(0, 0), (0, 1), (0, 2), (0, 3)]
    assert all(track.existence > 0.8 for track in picture.tracks)
    assert np.argmax(picture.cardinality) == 4
    np.testing.assert_allclose([track.mean[:2] for track in picture.tracks], PLACES, atol=12)


def test_existence_after_misses_is_bayes_rule_and_recovers():
    p_s = 0.99
    p_d = 0.98
    of, t_ns = followed(5)
    alive = existence(of)[(0, 0)]
    for _ in range(2):
        t_ns += NS_PER_S
        of.update(t_ns, np.empty((0, 2)), sensor())
        alive = alive * p_s * (1 - p_d) / (alive * p_s * (1 - p_d) + 1 - alive * p_s)
        assert existence(of)[(0, 0)] == pytest.approx(alive, rel=1e-6)
    of.update(t_ns + NS_PER_S, PLACES[:1], sensor())
    assert existence(of)[(0, 0)] > 0.9


def test_each_of_sixty_missed_objects_has_the_existence_of_a_single_one():
    """No cap on joint hypotheses may make sure of an object, or lose it, as others were missed as well."""
    east, north = np.meshgrid(np.arange(100.0, 1900, 180), np.arange(100.0, 1900, 300))
    places = np.column_stack([east.ravel(), north.ravel()])
    of = tracker()
    detector = sensor(0.98, 1.0)
    for k in range(4):
        of.update(k * NS_PER_S, places, detector, births(places) if k == 0 else [])
    gone = [3, 17, 29, 44, 58]
    of.update(4 * NS_PER_S, np.delete(places, gone, axis=0), detector)
    found = existence(of)
    assert len(found) == 60
    for i in range(60):
        bayes = 0.99 * 0.02 / (0.99 * 0.02 + 0.01) if i in gone else 1.0
        assert found[(0, i)] == pytest.approx(bayes, abs=0.01)
    expected = of.picture(0).cardinality @ np.arange(61)
    assert expected == pytest.approx(sum(found.values()), abs=1e-6)


def test_an_object_outside_the_field_of_view_is_not_missed():
    of, t_ns = followed(5)
    blind = sensor(fov=(1000.0, 0.0, 2000.0, 2000.0), name="east")
    for _ in range(20):
        t_ns += NS_PER_S
        of.update(t_ns, np.empty((0, 2)), blind)
    assert existence(of)[(0, 0)] == pytest.approx(0.99**20, rel=0.01)


def test_a_second_sensor_at_the_same_time_costs_no_survival_and_adds_its_accuracy():
    of, t_ns = followed(3)
    before = existence(of)[(0, 0)]
    (track,) = of.picture(0).tracks
    of.update(t_ns, np.empty((0, 2)), sensor(p_d=0.0, name="off"))
    assert existence(of)[(0, 0)] == pytest.approx(before, abs=1e-9)
    precise = sensor(0.9, noise_m=0.5, name="lidar")
    of.update(t_ns, PLACES[:1] + 1.0, precise)
    (after,) = of.picture(0).tracks
    information = np.linalg.inv(track.cov[:2, :2]) + np.linalg.inv(precise.noise_cov_m2)
    np.testing.assert_allclose(after.cov[:2, :2], np.linalg.inv(information), rtol=1e-6)


def test_empty_predictions_do_not_change_the_picture():
    blind = sensor(p_d=0.0)
    once, t_ns = followed(4)
    often, _ = followed(4)
    once.update(t_ns + 2 * NS_PER_S, np.empty((0, 2)), blind)
    for k in range(1, 9):
        often.update(t_ns + k * NS_PER_S // 4, np.empty((0, 2)), blind)
    (a,) = once.picture(0).tracks
    (b,) = often.picture(0).tracks
    np.testing.assert_allclose(a.mean, b.mean)
    np.testing.assert_allclose(a.cov, b.cov, rtol=1e-9, atol=1e-9)
    assert a.existence == pytest.approx(b.existence, rel=1e-6)


def test_a_detection_explained_by_something_else_raises_existence_less():
    detector = sensor()
    rate = np.array([5e-6, 2e-3])
    for density in rate:
        of = tracker()
        of.update(0, PLACES[:1], detector, births(PLACES[:1]), np.array([density]))
        made = 0.03 * 0.98 / (2 * np.pi * (100 + 3.16**2)) / density
        alive = 0.03 * 0.02 + made
        assert existence(of)[(0, 0)] == pytest.approx(alive / (alive + 0.97), rel=1e-4)


def test_an_unusable_clutter_intensity_costs_its_own_detection_alone():
    of, t_ns = followed(4)
    alone, _ = followed(4)
    z = np.array([PLACES[0], PLACES[0] + 4.0, PLACES[0] - 4.0])
    of.update(t_ns + NS_PER_S, z, sensor(), (), np.array([1e-6, np.nan, np.inf]))
    alone.update(t_ns + NS_PER_S, z[:1], sensor(), (), np.array([1e-6]))
    assert of.bad_detections == 2
    assert repr(of.picture(0)) == repr(alone.picture(0))


def test_a_scan_from_the_past_is_counted_and_changes_nothing():
    of, t_ns = followed(4)
    before = of.picture(0)
    of.update(t_ns - 1, PLACES + 50.0, sensor(), births())
    after = of.picture(0)
    assert of.late_scans == 1
    assert repr(before) == repr(after)


def test_crossing_objects_keep_their_labels():
    kept = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        state = np.array([[400.0, 900.0, 20.0, 10.0], [400.0, 1100.0, 20.0, -10.0]])
        born = [Birth(s, COV, 0.03) for s in state]
        of = tracker(seed)
        for k in range(20):
            seen = state[rng.random(2) < 0.95, :2]
            z = np.vstack([seen + rng.normal(0, 3, seen.shape), clutter(rng)])
            of.update(k * NS_PER_S, rng.permutation(z), sensor(0.95, noise_m=3.0), born if k == 0 else [])
            last = state.copy()
            state[:, :2] += state[:, 2:]
        at = {track.label: track.mean[:2] for track in of.picture(0).tracks}
        kept += all((0, i) in at and np.hypot(*(at[(0, i)] - last[i, :2])) < 20 for i in range(2))
    assert kept >= 10


def test_two_labels_are_never_at_one_object():
    """Two objects, three labels: the best hypothesis lacks a likely label, whose own best is another one.

    Tracks 0 and 1 are of label 0 (at the first and the second object), 2 and 3 of label 1, 4 of label 2.
    """
    groups = hypotheses.Clusters(
        np.array([0, 3]), np.array([0, 2, 4, 6]), np.array([2, 4, 0, 3, 1, 2]), np.log([0.45, 0.30, 0.25])
    )
    existence, shown, estimate, cardinality, _ = marginals.compute_marginals(
        groups, np.array([0, 0, 1, 1, 2]), 3
    )
    np.testing.assert_allclose(existence, [0.55, 1.0, 0.45])
    np.testing.assert_allclose(cardinality, [0, 0, 1, 0], atol=1e-12)
    assert (shown[0], shown[1]) == (0, 3)
    assert list(estimate) == list(marginals.map_tracks(groups)) == [2, 4]


def test_two_objects_of_one_birth_component_are_counted_while_identities_are_ambiguous():
    of = tracker()
    first = np.array([800.0, 800.0])
    for k in range(6):
        apart = np.array([[0.0, 6.0 * k], [12.0, -6.0 * k]])
        of.update(k * NS_PER_S, first + (apart if k else apart[:1]), sensor(), births([first]))
    at = np.array([track.mean[:2] for track in of.estimate()])
    assert len(at) == 2
    assert np.hypot(*(at[0] - at[1])) > 30


def test_a_birth_component_without_an_object_makes_no_tracks():
    rng = np.random.default_rng(5)
    of = tracker()
    worst = 0.0
    for k in range(50):
        of.update(k * NS_PER_S, clutter(rng), sensor(), births())
        worst = max(worst, sum(existence(of).values()))
    assert worst < 0.9
    assert not of.estimate()


def linear_gaussian_scene(seed, scans=40):
    """Yield (z, truth) of a truth that obeys the filter's model: births at known places, deaths, misses."""
    rng = np.random.default_rng(seed)
    alive = np.empty((0, 2))
    velocity = np.empty((0, 2))
    for k in range(scans):
        stays = rng.random(len(alive)) < 0.99
        alive = alive[stays] + velocity[stays]
        velocity = velocity[stays] + rng.normal(0, 0.5, (stays.sum(), 2))
        new = PLACES[rng.random(4) < (0.9 if k == 0 else 0.03)]
        alive = np.vstack([alive, new + rng.normal(0, 10, new.shape)])
        velocity = np.vstack([velocity, rng.normal(0, 20**0.5, new.shape)])
        seen = alive[rng.random(len(alive)) < 0.95]
        yield rng.permutation(np.vstack([seen + rng.normal(0, 5, seen.shape), clutter(rng)])), alive


def test_pictures_are_accurate_and_the_count_is_unbiased_where_the_model_holds():
    detector = sensor(0.95, noise_m=5.0)
    distances = []
    errors = []
    for seed in range(8):
        of = tracker(seed, accel_psd_m2_s3=0.36)
        for k, (z, truth) in enumerate(linear_gaussian_scene(seed)):
            of.update(k * NS_PER_S, z, detector, births(probability=0.9 if k == 0 else 0.03))
            cardinality = of.picture(0).cardinality
            errors.append(cardinality @ np.arange(cardinality.size) - len(truth))
            at = np.reshape([track.mean[:2] for track in of.estimate()], (-1, 2))
            distances.append(ospa(at, truth, 100.0, 1.0).total_m)
    assert np.mean(distances) < 8.0
    assert abs(np.mean(errors)) < 0.1


def busy_run(seed, scans=60):
    """Twelve objects that meet in the middle of much clutter: groups large enough to be sampled."""
    rng = np.random.default_rng(seed)
    angle = np.arange(12) * np.pi / 6
    way = np.column_stack([np.cos(angle), np.sin(angle)])
    of = tracker(seed, max_enumerated=50, gibbs_sweeps=200)
    pictures = []
    for k in range(scans):
        at = 1000.0 + way * (150.0 - 5.0 * k)
        z = np.vstack([at[rng.random(12) < 0.9] + rng.normal(0, 3), clutter(rng, 60)])
        of.update(k * NS_PER_S, z, sensor(0.9, 60.0), births(at) if k == 0 else [])
        pictures.append(of.picture(k * NS_PER_S))
    return of, pictures


def test_the_same_seed_and_scans_give_the_same_bytes():
    (_, one) = busy_run(3)
    (_, two) = busy_run(3)
    for a, b in zip(one, two, strict=True):
        assert a.cardinality.tobytes() == b.cardinality.tobytes()
        assert [t.label for t in a.tracks] == [t.label for t in b.tracks]
        assert [(t.mean.tobytes(), t.cov.tobytes()) for t in a.tracks] == [
            (t.mean.tobytes(), t.cov.tobytes()) for t in b.tracks
        ]


def test_state_does_not_grow_over_a_thousand_scans():
    rng = np.random.default_rng(8)
    of = tracker()
    held = []
    for k in range(1000):
        seen = PLACES[rng.random(4) < 0.98]
        z = np.vstack([seen + rng.normal(0, 3, seen.shape), clutter(rng, 30)])
        of.update(k * NS_PER_S, z, sensor(clutter=30.0), births())
        posterior = of.state.posterior
        held.append((len(posterior.labels), posterior.mean.shape[0], posterior.clusters.logw.size))
    early = np.array(held[20:200])
    late = np.array(held[-180:])
    assert (late.mean(axis=0) < 1.5 * early.mean(axis=0) + 5).all()
    assert len(of.estimate()) == 4


def test_nothing_is_compiled_in_flight_after_the_warm_up():
    warm_up()
    kernels = [call[0] for call in [*warm_up_calls(), *recovery.warm_up_calls()]]
    jit.warm_up(recovery.__name__)
    before = [len(kernel.signatures) for kernel in kernels]
    busy_run(1, scans=30)
    of = Glmb("targets", GlmbParams(accel_psd_m2_s3=1.0, turn_rate_std_rad_s=1), 1, keep_histories=True)
    for k, dtype in enumerate((np.float64, np.int64)):  # laid out otherwise, or of whole numbers
        noise = np.asfortranarray(np.eye(2, dtype=dtype))
        z = np.asfortranarray(PLACES.astype(dtype))
        strange = [
            Birth(place, np.asfortranarray(np.eye(4, dtype=dtype)), 0.5) for place in np.eye(4, dtype=dtype)
        ]
        of.update(k, z, Sensor("radar", 1, 1, noise, (0, 0, 9, 9)), strange, np.ones(8)[::2])
    of.picture(9)
    of.histories.paths(smooth=True)
    assert [len(kernel.signatures) for kernel in kernels] == before


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("accel_psd_m2_s3", -1.0),
        ("accel_psd_m2_s3", math.nan),
        ("piecewise_accel_std_m_s2", -1.0),
        ("survival_probability_per_s", 99.0),
        ("turn_rate_std_rad_s", -0.3),
        ("max_hypotheses", 0),
    ],
)
def test_an_invalid_parameter_is_refused_by_name(key, value):
    with pytest.raises(ValueError, match=f"{key}: expected"):
        GlmbParams(**{"accel_psd_m2_s3": 1.0, key: value})
