"""A mission whose points are above the ground, and whose legs are not."""

import numpy as np

from gcs.planning.flown_heights import lowest_heights_m

POINTS_M = np.array([(0.0, 0.0), (1000.0, 0.0), (1000.0, 500.0)])


def lowest(places, parts, heights=(100.0, 200.0, 140.0)):
    return lowest_heights_m(np.array(places, dtype=float), np.array(parts), POINTS_M, np.array(heights))


def test_a_climb_is_linear_between_its_points():
    places = [(0.0, 0.0), (500.0, 20.0), (1000.0, 0.0), (1100.0, 0.0), (-50.0, 0.0)]
    np.testing.assert_allclose(lowest(places, [0] * 5), [100.0, 150.0, 200.0, 200.0, 100.0])


def test_a_descent_ends_before_its_point():
    np.testing.assert_allclose(lowest([(1000.0, 210.0), (1000.0, 420.0)], [1, 1]), [170.0, 140.0])


def test_a_leg_that_is_shorter_than_a_loiter_radius_is_descended_at_once():
    points_m = np.array([(0.0, 0.0), (60.0, 0.0)])
    low = lowest_heights_m(np.array([(1.0, 0.0)]), np.array([0]), points_m, np.array([150.0, 120.0]))
    np.testing.assert_allclose(low, [120.0])
