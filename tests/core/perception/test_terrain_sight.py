"""A user would lose what a mountain hides: it is not seen, and it is not gone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.ridged import ridge, terrain_table
from helpers.staging import RADAR, mission, scan, state

from gcs.core.perception.fusion import MultiSensorTracker
from gcs.core.perception.position_integrity import PositionIntegrityMonitor
from gcs.core.perception.terrain_sight import TARGET_HEIGHT_M, TerrainSight
from gcs.core.state import State
from gcs.model import Polar, Viewpoint, read_only
from gcs.tracking.models.sensor_geometry import covers, polar_sensor, sensor_coordinates

START = (100.0, 200.0)
WEST, EAST = (900.0, 1000.0), (1500.0, 1000.0)
"""Before the ridge and behind it, from the mast."""
MAST = Viewpoint(300.0, 1000.0, 10.0, is_agl=True)
OVER_RIDGE = mission(agents=[START], births=[WEST], tables=terrain_table(ridge()))
SPEED_M_S = 6.0
HIDDEN_FROM_S = 18
HIDDEN_S = 40


def crossing(t_s):
    """Place of a target that goes east over the ridge."""
    return WEST[0] + SPEED_M_S * t_s, WEST[1]


def tracked(viewpoint, config=OVER_RIDGE):
    """Return the existence of the target that crosses the ridge, and the confirmed tracks, each second.

    In the end another sensor sees it.
    """
    west = replace(RADAR, viewpoint=viewpoint)
    east = replace(RADAR, name="east")
    trackers = MultiSensorTracker(config)
    rng = np.random.default_rng(1)
    found = []
    for t_s in range(HIDDEN_FROM_S + HIDDEN_S + 15):
        place = crossing(t_s)
        is_out = t_s >= HIDDEN_FROM_S + HIDDEN_S
        is_seen = t_s < HIDDEN_FROM_S or is_out
        things = [tuple(np.array(place) + rng.normal(0.0, 3.0, 2))] if is_seen else []
        _, targets = trackers.scan(scan(t_s, *things, sensor=east if is_out else west), [])
        existence = [track.existence for track in targets.tracks if track.label[1] == 0]
        found.append((max(existence, default=0.0), list(trackers.targets.confirmation.tracks)))
    return found


def test_a_target_behind_a_ridge_is_kept():
    found = tracked(MAST)
    (label,) = found[HIDDEN_FROM_S - 1][1]
    for existence, tracks in found[HIDDEN_FROM_S : HIDDEN_FROM_S + HIDDEN_S]:
        assert existence > 0.98**HIDDEN_S  # It may have ended by itself: 1 % a second.
        assert tracks == [label]
    # It comes out again, and is the same.
    assert found[-1] == (pytest.approx(1.0, abs=0.01), [label])


@pytest.mark.parametrize(
    ("viewpoint", "config"), [(None, OVER_RIDGE), (MAST, mission(agents=[START], births=[WEST]))]
)
def test_without_height_or_terrain_its_track_ends(viewpoint, config):
    found = tracked(viewpoint, config)
    assert found[HIDDEN_FROM_S - 1][1]
    assert all(tracks == [] for _, tracks in found[HIDDEN_FROM_S + 5 : HIDDEN_FROM_S + HIDDEN_S])


def test_targets_are_not_born_behind_a_ridge():
    config = mission(agents=[START], births=[EAST], tables=terrain_table(ridge()))
    trackers = MultiSensorTracker(config)
    for t_s in range(30):
        _, targets = trackers.scan(scan(t_s, sensor=replace(RADAR, viewpoint=MAST)), [])
    assert max((track.existence for track in targets.tracks), default=0.0) < 0.05


def test_a_vehicle_that_reports_behind_a_ridge_is_not_accused():
    known = State.initial([1]).agents
    sight = TerrainSight(OVER_RIDGE)
    for viewpoint, is_accused in ((MAST, False), (None, True)):
        monitor = PositionIntegrityMonitor(known, OVER_RIDGE.telemetry)
        notices = []
        for t_s in range(20):
            seen = sight.scan_of(scan(t_s, sensor=replace(RADAR, viewpoint=viewpoint)), "agents")
            notices += monitor.update(seen, [state(1, EAST, t_s)], {}, [])
        assert bool(notices) == is_accused


def test_a_sensor_that_moves_sees_from_where_it_is():
    sight = TerrainSight(OVER_RIDGE)
    for viewpoint in (MAST, Viewpoint(1800.0, 1000.0, 10.0, is_agl=True), MAST):
        seen = sight.scan_of(scan(0.0, sensor=replace(RADAR, viewpoint=viewpoint)), "targets")
        assert covers(seen.sensor, np.array([WEST, EAST])).tolist() == [
            viewpoint is MAST,
            viewpoint is not MAST,
        ]


def test_slant_ranges_are_projected_for_each_kind_by_its_height():
    polar = Polar(900.0, 500.0, 5.0, 0.01, (0.0, 3000.0), (0.0, math.pi), 1e-3, is_slant=True)
    tower = Viewpoint(900.0, 500.0, 400.0, is_agl=False)
    radar = replace(polar_sensor("r", 0.9, polar), viewpoint=tower)
    sight = TerrainSight(OVER_RIDGE)
    far_m = 700.0
    for kind, alt_m in (("targets", 100.0 + TARGET_HEIGHT_M), ("agents", 185.0)):
        slant_m = math.hypot(far_m, 400.0 - alt_m)
        raw = scan(0.0, (900.0 - slant_m, 500.0), sensor=radar)
        assert sight.scan_of(raw, kind).z_m == pytest.approx(np.array([[900.0 - far_m, 500.0]]), abs=0.1)
        measured = replace(raw, heights_msl_m=read_only([alt_m]))
        for any_kind in ("agents", "targets"):
            z_m = sight.scan_of(measured, any_kind).z_m
            assert sensor_coordinates(radar, z_m)[0, 0] == pytest.approx(far_m)


@pytest.mark.parametrize(
    ("viewpoint", "words"),
    [
        (Viewpoint(1000.0, 500.0, 120.0, is_agl=False), "is from 120 m AMSL at east 1000 m, north 500 m"),
        (Viewpoint(9000.0, 500.0, 10.0, is_agl=True), "outside the elevation model"),
        (Viewpoint(9000.0, 500.0, 10.0, is_agl=False), ""),
        (MAST, ""),
        (None, ""),
    ],
)
def test_a_place_that_cannot_be_right_is_refused_with_the_reason(viewpoint, words):
    trackers = MultiSensorTracker(OVER_RIDGE)
    refusal = trackers.refusal(scan(0.0, sensor=replace(RADAR, viewpoint=viewpoint)))
    assert words in refusal
    assert bool(refusal) == bool(words)
