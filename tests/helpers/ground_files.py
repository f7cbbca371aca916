"""Small files of elevation models, and missions that name them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from pyproj import Transformer

from gcs.geo import LocalFrame

FRAME = LocalFrame(46.8, 9.8, 1500.0)
SIZE_M = (1000.0, 800.0)
UTM = "EPSG:32632"
WEST_M, NORTH_M = 560_000.0, 5_185_000.0
"""Corner of the files in UTM: 1,047 m west and 1,816 m north of the frame's origin."""
MISSION = """
name = "hills"
[frame]
lat_deg = 46.8
lon_deg = 9.8
alt_msl_m = 1500.0
[map]
width_m = 1000.0
height_m = 800.0
nodes_east = 51
nodes_north = 41
[terrain]
file = "ground.tif"  # next to it
[[agents]]
system_id = 1
east_m = 500.0
north_m = 400.0
"""


def plane(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    """Return heights of a slope at places in metres from the corner of a file."""
    return 1500.0 + 0.1 * east - 0.05 * north


def slope(pixel_m: float = 10.0, shape: tuple[int, int] = (360, 360)) -> np.ndarray:
    """Return the heights of `plane` at the centres of a file's pixels."""
    rows, cols = np.indices(shape)
    return plane((cols + 0.5) * pixel_m, -(rows + 0.5) * pixel_m)


def slope_at(frame: LocalFrame, places_m: np.ndarray) -> np.ndarray:
    """Return the heights of `plane` at places of a local frame."""
    to_utm = Transformer.from_crs("EPSG:4326", UTM, always_xy=True)
    lat, lon = np.array([frame.to_geodetic(*place) for place in places_m]).T
    x, y = to_utm.transform(lon, lat)
    return plane(np.asarray(x) - WEST_M, np.asarray(y) - NORTH_M)


def write_ground(path: Path, heights: np.ndarray, pixel_m: float = 10.0, **profile: Any) -> Path:
    """Write a GeoTIFF of one or several bands."""
    bands = heights if heights.ndim == 3 else heights[np.newaxis]
    given: dict[str, Any] = {
        "driver": "GTiff",
        "dtype": "float32",
        "crs": UTM,
        "transform": rasterio.Affine(pixel_m, 0.0, WEST_M, 0.0, -pixel_m, NORTH_M),
        "count": len(bands),
        "height": bands.shape[1],
        "width": bands.shape[2],
        **profile,
    }
    with rasterio.open(path, "w", **given) as file:
        file.write(bands.astype(given["dtype"]))
    return path


def write_mission(folder: Path, text: str = MISSION) -> str:
    """Write a mission and its elevation model; return the name of the mission file."""
    write_ground(folder / "ground.tif", slope())
    (folder / "mission.toml").write_text(text, encoding="utf-8")
    return str(folder / "mission.toml")
