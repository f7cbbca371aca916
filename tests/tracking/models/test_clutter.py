"""A wrong clutter intensity would let detections of other objects start tracks."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from gcs.tracking.models.clutter import intensity_per_m2


@settings(max_examples=60)
@given(st.integers(0, 2**32), st.integers(0, 6), st.integers(0, 5), st.sampled_from([10.0, 1000.0, 1e5]))
def test_clutter_intensity_is_the_sum_of_the_gaussians(seed, objects, places, wide_m):
    rng = np.random.default_rng(seed)
    mean = rng.uniform(0, wide_m, (objects, 2))
    z = rng.uniform(0, wide_m, (places, 2))
    roots = [rng.normal(0, 5, (n, 2, 2)) for n in (objects, places)]
    cov, noise = (root @ root.transpose(0, 2, 1) + 0.1 * np.eye(2) for root in roots)
    existence = rng.uniform(0, 1, objects)
    expected = [
        sum(existence[i] * multivariate_normal.pdf(z[j], mean[i], cov[i] + noise[j]) for i in range(objects))
        for j in range(places)
    ]
    np.testing.assert_allclose(
        intensity_per_m2(mean, cov, existence, z, noise), expected, rtol=1e-9, atol=1e-300
    )
