"""Dubins paths: they end where and as they should, turn no tighter than allowed, and none is shorter."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.planning.path.dubins import dubins_words

WORDS = ("LSL", "RSR", "LSR", "RSL", "RLR", "LRL")


class Pose(NamedTuple):
    """Position and course over ground, clockwise from north."""

    east_m: float
    north_m: float
    course_rad: float


@dataclass(frozen=True, slots=True)
class DubinsPath:
    """Shortest path of bounded curvature: a word, and the length of each of its pieces."""

    start: Pose
    radius_m: float
    word: str
    pieces_m: tuple[float, float, float]

    @property
    def length_m(self) -> float:
        """Length of the whole path."""
        return math.fsum(self.pieces_m)

    def at(self, along_m: float) -> Pose:
        """Return the pose at a distance along the path, at most its end."""
        east, north, course = self.start
        for kind, piece_m in zip(self.word, self.pieces_m, strict=True):
            go_m = min(along_m, piece_m)
            if kind == "S":
                east, north = east + go_m * math.sin(course), north + go_m * math.cos(course)
            else:
                side = 1.0 if kind == "R" else -1.0
                turned = course + side * go_m / self.radius_m
                east += side * self.radius_m * (math.cos(course) - math.cos(turned))
                north += side * self.radius_m * (math.sin(turned) - math.sin(course))
                course = turned
            along_m -= go_m
        return Pose(east, north, course)


def dubins_path(start: Pose, end: Pose, radius_m: float) -> DubinsPath:
    """Return the shortest path between two poses."""
    pieces = dubins_words(
        start.east_m,
        start.north_m,
        0.5 * math.pi - start.course_rad,
        end.east_m,
        end.north_m,
        0.5 * math.pi - end.course_rad,
        radius_m,
    )
    best = int(np.argmin(pieces.sum(axis=1)))
    a, b, c = (float(piece) * radius_m for piece in pieces[best])
    return DubinsPath(start, radius_m, WORDS[best], (a, b, c))


# Coarse numbers: where an end lies a hair behind its start the shortest path jumps by a full circle.
PLACE = st.integers(-1600, 1600).map(lambda k: k / 8)
POSE = st.builds(Pose, PLACE, PLACE, st.integers(-700, 700).map(lambda k: k / 100))
RADIUS = st.sampled_from([5.0, 40.0, 90.0])


@settings(max_examples=300)
@given(POSE, POSE, RADIUS)
def test_a_path_ends_at_its_end_on_its_course(start, end, radius):
    path = dubins_path(start, end, radius)
    reached = path.at(path.length_m)
    assert math.dist(reached[:2], end[:2]) < 1e-5
    assert math.cos(reached.course_rad - end.course_rad) == pytest.approx(1.0, abs=1e-9)


@settings(max_examples=200)
@given(POSE, POSE, RADIUS)
def test_every_word_that_reaches_at_all_reaches_the_end(start, end, radius):
    """Also those that are not the shortest: a start turn may have to take another way round."""
    angles = [0.5 * math.pi - pose.course_rad for pose in (start, end)]
    pieces = dubins_words(*start[:2], angles[0], *end[:2], angles[1], radius)
    for word, row in zip(WORDS, pieces, strict=True):
        if np.isfinite(row).all():
            path = DubinsPath(start, radius, word, tuple(radius * row))
            assert math.dist(path.at(path.length_m)[:2], end[:2]) < 1e-5, word


@settings(max_examples=200)
@given(POSE, POSE, RADIUS)
def test_no_path_is_shorter_than_the_straight_line_nor_turns_tighter_than_the_radius(start, end, radius):
    path = dubins_path(start, end, radius)
    assert path.length_m >= math.dist(start[:2], end[:2]) - 1e-6
    step = path.length_m / 400
    poses = [path.at(k * step) for k in range(401)]
    for a, b in itertools.pairwise(poses):
        assert abs(b.course_rad - a.course_rad) <= step / radius + 1e-9
        assert math.dist(a[:2], b[:2]) <= step + 1e-9


@settings(max_examples=200)
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
