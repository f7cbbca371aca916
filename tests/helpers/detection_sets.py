"""Sets of detections with their models, and `gcs track` on them."""

import json

import numpy as np
from typer.testing import CliRunner

from gcs.cli import app

KEYS = [
    "scans",
    "ospa_mean_m",
    "ospa2_mean_m",
    "gospa_mean_m",
    "cardinality_error_mean",
    "id_switches",
    "labels_per_object",
    "scan_ms_mean",
    "scan_ms_p99",
    "remarks",
]
SCANS = 30
MODEL = """
piecewise_accel_std_m_s2 = 5.0
survival_probability = 0.99
detection_probability = 0.95
clutter_per_scan = 10.0
noise_std_m = 10.0
region_m = [-500.0, -500.0, 500.0, 500.0]
scans = 30
[[births]]
x_m = -300.0
y_m = 0.0
std_m = 10.0
speed_std_m_s = 10.0
probability = 0.03
[[births]]
x_m = 0.0
y_m = 300.0
std_m = 10.0
speed_std_m_s = 10.0
probability = 0.03
"""


def made(seed=1, scans=SCANS):
    """Arrays as in the shared sets: two objects, the second from scan 8 to 22 alone."""
    rng = np.random.default_rng(seed)
    truth, meas = [], []
    for k in range(1, scans + 1):
        here = [(1, -300.0 + 15.0 * k, 15.0, 2.0 * k, 2.0)]
        if 8 <= k <= 22:
            here.append((2, 3.0 * (k - 8), 3.0, 300.0 - 12.0 * (k - 8), -12.0))
        truth += [(k, *row) for row in here]
        seen = [(k, row[1] + rng.normal(0, 10), row[3] + rng.normal(0, 10), row[0]) for row in here]
        meas += [row for row in seen if rng.random() < 0.95]
        meas += [(k, *rng.uniform(-500, 500, 2), 0.0) for _ in range(rng.poisson(10))]
    return {
        "truth": np.array(truth),
        "meas": rng.permutation(np.array(meas)),
        "F": np.kron(np.eye(2), [[1.0, 1.0], [0.0, 1.0]]),
        "sigma_v": 5.0,
        "sigma_z": 10.0,
        "pS": 0.99,
        "pD": 0.95,
        "lambda_c": 10.0,
        "region": np.array([[-500.0, 500.0], [-500.0, 500.0]]),
        "birth_mean": np.array([[-300.0, 0.0, 0.0, 0.0], [0.0, 0.0, 300.0, 0.0]]),
        "birth_std": np.full(4, 10.0),
        "r_birth": 0.03,
        "K": scans,
    }


RADARS = """
accel_psd_m2_s3 = 1.0
survival_probability = 0.99
[[sensors]]
name = "west"
kind = "range_bearing"
detection_probability = 0.9
clutter_per_scan = 5.0
x_m = -800.0
y_m = 0.0
range_std_m = 5.0
bearing_std_deg = 0.5
most_range_m = 2000.0
sector_centre_deg = 90.0
sector_width_deg = 120.0
[[sensors]]
name = "camera"
kind = "position"
detection_probability = 0.9
clutter_per_scan = 5.0
noise_std_m = 5.0
region_m = [0.0, -500.0, 500.0, 500.0]
field_of_view_m = [0.0, -500.0, 500.0, 500.0]
[[births]]
x_m = -300.0
y_m = 0.0
std_m = 10.0
speed_std_m_s = 20.0
probability = 0.03
"""


def seen_by_both(rng, bearing="bearing_deg", time="k"):
    """CSV of what a radar and a camera see of one object that flies into the camera's view; its truth."""
    unit = 180.0 / np.pi if bearing == "bearing_deg" else 1.0
    lines, truth = [f"{time},sensor,range_m,{bearing},x,y"], []
    for k in range(1, 41):
        x, y = -315.0 + 15.0 * k, 2.0 * k
        truth.append((k, 1, x, 15.0, y, 2.0))
        seen = [(np.hypot(x + 800.0, y), np.arctan2(x + 800.0, y))] if rng.random() < 0.9 else []
        clutter = zip(rng.uniform(0, 2000, 5), rng.uniform(np.pi / 6, 5 * np.pi / 6, 5), strict=True)
        polar = [(r + rng.normal(0, 5), b + rng.normal(0, 0.0087)) for r, b in seen] + list(clutter)
        lines += [f"{k},west,{r:.3f},{b * unit:.5f},," for r, b in polar] or [f"{k},west,,,,"]
        places = [(x + rng.normal(0, 5), y + rng.normal(0, 5))] if x > 0 and rng.random() < 0.9 else []
        places += [(rng.uniform(0, 500), rng.uniform(-500, 500)) for _ in range(5)]
        lines += [f"{k},camera,,,{a:.3f},{b:.3f}" for a, b in places]
    return "\n".join(lines) + "\n", np.array(truth)


def run(*arguments):
    return CliRunner().invoke(app, ["track", *map(str, arguments)])


def scores(*arguments):
    done = run(*arguments, "--json")
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout.splitlines()[-1])
    assert list(result) == KEYS
    return result
