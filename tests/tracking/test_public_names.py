"""A researcher imports from the package, and does not wait for the compiler before the first tracker."""

import subprocess
import sys

import numpy as np

import gcs.tracking
from gcs.tracking import Birth, Glmb, GlmbParams, Sensor, gospa, ospa


def test_ten_lines_track_a_small_data_set():
    rng = np.random.default_rng(1)
    radar = Sensor("radar", 0.9, 10 / 2000**2, 5.0**2 * np.eye(2), (-1000.0, -1000.0, 1000.0, 1000.0))
    birth = Birth(np.zeros(4), np.diag([100.0, 100.0, 400.0, 400.0]), 0.02)
    tracker = Glmb("targets", GlmbParams(accel_psd_m2_s3=1.0), seed=1)
    for k in range(30):
        truth = np.array([[20.0 * k, 5.0 * k]])
        clutter = rng.uniform(-1000.0, 1000.0, (rng.poisson(10), 2))
        tracker.update(k * 10**9, np.vstack([truth + rng.normal(0.0, 5.0, (1, 2)), clutter]), radar, (birth,))
    found = np.array([track.mean[:2] for track in tracker.estimate()])
    assert ospa(found, truth).total_m < 20.0
    assert gospa(found, truth).missed == 0


def test_the_package_alone_does_not_import_the_compiler():
    code = "import sys, gcs.tracking; from gcs.tracking import Birth, GlmbParams, Sensor, ospa;"
    code += "print([name for name in ('llvmlite', 'scipy') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_public_name_is_there():
    assert all(getattr(gcs.tracking, name) is not None for name in gcs.tracking.__all__)
