"""The files that the commands of the documentation name."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import numpy as np

from gcs.config import read_text
from helpers.detection_sets import MODEL, made
from sim_vehicles.campaign.simulate import fly
from sim_vehicles.world.scenario import load

HOME = [33.2, -87.6]
PLAN = {
    "fileType": "Plan",
    "version": 1,
    "mission": {
        "cruiseSpeed": 15,
        "plannedHomePosition": [*HOME, 70.0],
        "items": [{"type": "SimpleItem", "command": 16, "params": [0, 0, 0, None, 33.204, -87.59, 50]}],
    },
    "geoFence": {"polygons": [], "circles": []},
    "rallyPoints": {"points": []},
}
KML = """<kml xmlns="http://www.opengis.net/kml/2.2"><Document>
<Placemark><name>agent 3</name><Point><coordinates>-87.6,33.2,0</coordinates></Point></Placemark>
<Placemark><name>barn</name><Point><coordinates>-87.59,33.204,0</coordinates></Point></Placemark>
</Document></kml>"""


def write_documented_files(folder: Path) -> None:
    """Write a recording, a log, detections with model and truth, a plan, a map and a mission file."""
    run = folder / "runs" / "prescribed-1"
    fly(load("prescribed"), 1, run, duration_s=10.0)
    shutil.copy(run / "link.tlog", folder / "flight.tlog")
    arrays = made()
    for name in ("set", "mc-1", "mc-2", "mc-3"):
        np.savez(folder / f"{name}.npz", **arrays)
    _write_table(folder / "set.csv", ("k", "x", "y"), arrays["meas"][:, :3])
    _write_table(folder / "truth.csv", ("k", "id", "x", "y"), arrays["truth"][:, [0, 1, 2, 4]])
    (folder / "model.toml").write_text(MODEL)
    (folder / "field.plan").write_text(json.dumps(PLAN))
    (folder / "field.kml").write_text(KML)
    (folder / "mission.toml").write_text(read_text("prescribed")[0])


def _write_table(path: Path, titles: tuple[str, ...], rows: np.ndarray) -> None:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([titles, *rows])
