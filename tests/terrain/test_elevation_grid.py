"""Heights of the ground at places of the local frame."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.terrain.elevation_grid import Elevation


def test_a_plane_is_read_exactly_between_the_nodes():
    east, north = np.meshgrid(np.arange(4) * 10.0 - 5.0, np.arange(3) * 10.0 + 2.0)
    ground = Elevation((-5.0, 2.0), 10.0, 100.0 + 0.3 * east - 0.2 * north)
    places = np.random.default_rng(1).uniform((-5.0, 2.0), (25.0, 22.0), (50, 2))
    np.testing.assert_allclose(ground.heights_at(places), 100.0 + places @ (0.3, -0.2))
    assert ground.height_msl_m(25.0, 22.0) == pytest.approx(100.0 + 7.5 - 4.4)


def test_outside_the_nodes_no_height_is_known():
    ground = Elevation((0.0, 0.0), 10.0, np.zeros((2, 2)))
    assert np.isnan(ground.heights_at(np.array([[-0.1, 5.0], [5.0, 10.1], [np.nan, 5.0]]))).all()


@pytest.mark.parametrize(
    ("spacing_m", "heights"),
    [(0.0, np.zeros((2, 2))), (10.0, np.zeros((1, 5))), (10.0, np.full((2, 2), np.nan))],
)
def test_what_is_no_elevation_is_refused(spacing_m, heights):
    with pytest.raises(ValueError, match="must be"):
        Elevation((0.0, 0.0), spacing_m, heights)
