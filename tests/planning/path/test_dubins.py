"""Dubins paths: they end where and as they should, turn no tighter than allowed, and none is shorter."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.planning.path.dubins import WORDS, DubinsPath, Pose, dubins_path, dubins_words

# Coarse numbers: where an end lies a hair behind its start the shortest path jumps by a full circle.
PLACE = st.integers(-1600, 1600).map(lambda k: k / 8)
POSE = st.builds(Pose, PLACE, PLACE, st.integers(-700, 700).map(lambda k: k / 100))
RADIUS = st.sampled_from([5.0, 40.0, 90.0])


@settings(max_examples=300, deadline=None)
@given(POSE, POSE, RADIUS)
def test_a_path_ends_at_its_end_on_its_course(start, end, radius):
    path = dubins_path(start, end, radius)
    reached = path.at(path.length_m)
    assert math.dist(reached[:2], end[:2]) < 1e-5
    assert math.cos(reached.course_rad - end.course_rad) == pytest.approx(1.0, abs=1e-9)


@settings(max_examples=200, deadline=None)
@given(POSE, POSE, RADIUS)
def test_every_word_that_reaches_at_all_reaches_the_end(start, end, radius):
    """Also those that are not the shortest: a start turn may have to take another way round."""
    angles = [0.5 * math.pi - pose.course_rad for pose in (start, end)]
    pieces = dubins_words(*start[:2], angles[0], *end[:2], angles[1], radius)
    for word, row in zip(WORDS, pieces, strict=True):
        if np.isfinite(row).all():
            path = DubinsPath(start, radius, word, tuple(radius * row))
            assert math.dist(path.at(path.length_m)[:2], end[:2]) < 1e-5, word


@settings(max_examples=200, deadline=None)
@given(POSE, POSE, RADIUS)
def test_no_path_is_shorter_than_the_straight_line_nor_turns_tighter_than_the_radius(start, end, radius):
    path = dubins_path(start, end, radius)
    assert path.length_m >= math.dist(start[:2], end[:2]) - 1e-6
    step = path.length_m / 400
    poses = [path.at(k * step) for k in range(401)]
    for a, b in itertools.pairwise(poses):
        assert abs(b.course_rad - a.course_rad) <= step / radius + 1e-9
        assert math.dist(a[:2], b[:2]) <= step + 1e-9


@settings(max_examples=200, deadline=None)
@given(POSE, POSE, RADIUS)
def test_the_mirror_image_is_as_long_and_so_is_the_way_back(start, end, radius):
    length = dubins_path(start, end, radius).length_m
    mirrored = [Pose(-p.east_m, p.north_m, -p.course_rad) for p in (start, end)]
    assert dubins_path(*mirrored, radius).length_m == pytest.approx(length, abs=1e-5)
    back = [Pose(p.east_m, p.north_m, p.course_rad + math.pi) for p in (end, start)]
    assert dubins_path(*back, radius).length_m == pytest.approx(length, abs=1e-5)


@pytest.mark.parametrize(
    ("end", "word", "length_in_radii"),
    [
        (Pose(0.0, 100.0, 0.0), None, 10.0),
        (Pose(20.0, 0.0, math.pi), None, math.pi),
        (Pose(-20.0, 0.0, math.pi), None, math.pi),
        (Pose(100.0, 100.0, math.pi / 2), "RSR", 9.0 * math.sqrt(2.0) + math.pi / 2),
        (Pose(0.0, -1e-9, math.pi), ("RLR", "LRL"), 7.0 * math.pi / 3.0),
    ],
)
def test_paths_known_by_hand(end, word, length_in_radii):
    path = dubins_path(Pose(0.0, 0.0, 0.0), end, 10.0)
    assert path.length_m == pytest.approx(10.0 * length_in_radii, abs=1e-4)
    assert word is None or path.word in word


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan, math.inf])
def test_a_radius_that_is_none_is_refused(radius):
    with pytest.raises(ValueError, match="radius_m"):
        dubins_path(Pose(0.0, 0.0, 0.0), Pose(1.0, 1.0, 0.0), radius)
