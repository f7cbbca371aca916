"""A vehicle would lose its track, or keep another's, if its report were compared with the wrong one."""

import numpy as np

from gcs.core.perception.mahalanobis import paired_squared_distances, squared_distances


def test_each_report_is_as_far_from_its_own_track_as_in_the_table_of_all():
    rng = np.random.default_rng(1)
    points = rng.uniform(-1000.0, 1000.0, (200, 2))
    means = points + rng.normal(0.0, 10.0, (200, 2))
    roots = rng.normal(0.0, 3.0, (200, 2, 2))
    S = roots @ roots.swapaxes(1, 2) + np.eye(2)
    points[7] = np.nan
    table = squared_distances(points, means, S)
    np.testing.assert_array_equal(paired_squared_distances(points, means, S), table.diagonal())
    dx = points[3] - means[5]
    np.testing.assert_allclose(table[3, 5], dx @ np.linalg.solve(S[5], dx))
