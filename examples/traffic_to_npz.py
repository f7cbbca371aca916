"""Turn a CSV of ADS-B or AIS reports into detections of a simulated radar, with ground truth.

python examples/traffic_to_npz.py reports.csv set.npz [timestamp icao24 latitude longitude]
"""

import csv
import sys
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import numpy as np

from gcs.geo import LocalFrame

source, out, *titles = [*sys.argv[1:], "timestamp", "icao24", "latitude", "longitude"]
period_s, reports = 10.0, {}
with Path(source).open(newline="", encoding="utf-8") as file:
    for row in csv.DictReader(file):
        at, name, lat, lon = (row[title] for title in titles[:4])
        if lat and lon:  # times are Unix seconds, or ISO 8601
            at_s = float(at) if at.replace(".", "").isdigit() else datetime.fromisoformat(at).timestamp()
            reports.setdefault(name, {})[at_s] = float(lat), float(lon)
frame = LocalFrame(*np.mean([place for path in reports.values() for place in path.values()], axis=0), 0.0)
begin, truth = min(min(path) for path in reports.values()), []  # k, id, px, vx, py, vy
for number, path in enumerate(reports.values(), 1):
    for (t, place), (t2, place2) in pairwise(sorted(path.items())):  # on a line between two near reports
        at, at2 = np.array(frame.to_local(*place)), np.array(frame.to_local(*place2))
        for k in range(*np.ceil(np.array([t - begin, t2 - begin]) / period_s).astype(int)):
            (px, py), (vx, vy) = at + (begin + k * period_s - t) * (v := (at2 - at) / (t2 - t)), v
            truth += [(k, number, px, vx, py, vy)] * (t2 - t <= 3.0 * period_s)
rng, truth = np.random.default_rng(1), np.array(truth)
seen = truth[rng.random(len(truth)) < 0.9]  # detection probability 0.9, error 60 m, 50 false ones a scan
real = np.column_stack([seen[:, 0], seen[:, [2, 4]] + rng.normal(0.0, 60.0, (len(seen), 2)), seen[:, 1]])
scans, box = int(truth[:, 0].max()) + 1, truth[:, [2, 4]]  # k, x, y, true object
false = rng.uniform([0, *box.min(0), 0], [scans, *box.max(0), 0], (rng.poisson(50 * scans), 4))
false[:, 0] //= 1.0
np.savez(out, meas=np.vstack([real, false]), truth=truth)
print(f"{len(reports)} objects, {scans} scans, {len(real)} detections of them")
print(f"region_m = {[float(x) for x in (*box.min(0).round(), *box.max(0).round())]}  # for the model")
