"""Warm-up of the terrain planner: compilation of its kernels."""

from __future__ import annotations

import math

import numpy as np

from gcs import jit
from gcs.planning.terrain.corner_path import shorten_path
from gcs.planning.terrain.height_field import MAX_LABELS, field_lengths, fill_field, move_limits
from gcs.planning.terrain.height_profile import choose_knots, plan_heights, sample_path
from gcs.planning.terrain.loiter_circles import circle_heights
from gcs.planning.terrain.pose_search import make_primitives, search_poses


def warm_up_calls() -> list[jit.Call]:
    """Return one call of every kernel, as typed in a plan. The slowest to compile stand at the ends."""
    surfaces = np.zeros((3, 3, 3), np.float32)
    surfaces.flags.writeable = False
    rates = np.array([0.1, 0.1, 10.0])
    limits = np.full((3, 3, 16, 4), -np.inf, np.float32)  # no move is possible
    counts = np.zeros((1, 3, 3), np.int32)
    labels = np.zeros((1, 3, 3, MAX_LABELS, 3), np.float32)
    samples, shapes = make_primitives(10.0, 5.0)
    ends = np.zeros((2, 7))
    points = np.array([[0.0, 0.0], [10.0, 0.0]])
    places = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 10.0]])
    via = np.array([0.0, 0.0, -1.0])
    knots = np.array([0, 1])
    frame = np.array([10.0, 10.0, 10.0, 10.0, 5.0])
    goals = np.zeros((1, 6))
    starts = np.zeros((1, 5))
    two = np.array([2, 2])
    fields = (counts, labels)
    primitives = (samples, shapes)
    return [
        (choose_knots, places[:, 2], np.zeros(2, np.int32), np.zeros(2), np.zeros((2, 2)), knots),
        (shorten_path, surfaces, np.array([10.0, 10.0, 5.0]), rates, points, ends, -1, via),
        (field_lengths, counts, labels, 10.0, np.zeros((1, 4)), 0.1),
        (circle_heights, surfaces, 1.0, 0, 3, 0, 3),
        (sample_path, points, 10.0, 5.0),
        (move_limits, surfaces, 10.0, 10.0, two, 0.1, 0.1),
        (fill_field, limits, 10.0, 0.1, 0.1, np.zeros((1, 5)), math.inf),
        (plan_heights, surfaces, 10.0, rates, places, ends, 0.5, 1.0),
        (search_poses, surfaces, frame, rates, *fields, *primitives, starts, 0.0, via, goals, two, 1.0, 0.1),
    ]  # fmt: skip


def warm_up() -> None:
    """Compile every kernel, or load it from the cache. Otherwise the first route takes seconds longer."""
    jit.warm_up(__name__)
