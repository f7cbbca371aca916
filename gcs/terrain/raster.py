"""GeoTIFF and SRTM files, read in windows by rasterio.

A file may be larger than memory, cut short, or no raster at all. Nothing beside it is read: what a recording
holds of a file is then all that was used of it.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
import rasterio
from pyproj import CRS
from rasterio.windows import Window

from gcs.errors import TerrainFileError
from gcs.files import open_regular
from gcs.model import FloatArray
from gcs.terrain.datum import VerticalDatum, check_vertical_datum, degrees_to_file

MIN_HEIGHT_M: Final = -500.0
MAX_HEIGHT_M: Final = 9000.0
_CACHE_BYTES: Final = 64_000_000
_MAX_BLOCK_BYTES: Final = 256_000_000
"""Maximum size of a block: it is decoded as a whole."""


class Raster:
    """An open file with one band of heights.

    Pixel coordinates are columns and rows from the outer corner of the first pixel, whose centre is at 0.5.

    Parameters
    ----------
    dataset : rasterio.DatasetReader
        Checked by `open_raster`.
    """

    def __init__(self, dataset: Any, datum: VerticalDatum) -> None:
        self._dataset = dataset
        crs = CRS.from_wkt(dataset.crs.to_wkt())
        check_vertical_datum(crs, datum)
        self._to_file = degrees_to_file(crs)
        to_pixels = ~dataset.transform
        self._to_pixels = np.array([[to_pixels.a, to_pixels.b], [to_pixels.d, to_pixels.e]])
        self._corner = np.array([to_pixels.c, to_pixels.f])
        self.shape = (int(dataset.height), int(dataset.width))

    def pixels_at(self, lon_deg: FloatArray, lat_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return columns and rows of places on WGS84; infinite where the reference system has none."""
        x, y = self._to_file.transform(lon_deg, lat_deg)
        (a, b), (d, e) = self._to_pixels
        return a * x + b * y + self._corner[0], d * x + e * y + self._corner[1]

    def read(self, first: tuple[int, int], end: tuple[int, int]) -> FloatArray:
        """Return heights of a window of (row, column); NaN in holes.

        Raises
        ------
        TerrainFileError
            When the file is cut short, or has a height that the Earth does not have.
        """
        window = Window(first[1], first[0], end[1] - first[1], end[0] - first[0])
        pixels = self._dataset.read(1, window=window, masked=True)
        heights: FloatArray = np.asarray(pixels.filled(0), dtype=np.float64)
        heights = heights * self._dataset.scales[0] + self._dataset.offsets[0]
        heights[np.ma.getmaskarray(pixels) | ~np.isfinite(heights)] = np.nan
        wrong = (heights < MIN_HEIGHT_M) | (heights > MAX_HEIGHT_M)
        if wrong.any():
            row, col = (int(index[0]) for index in np.nonzero(wrong))
            raise TerrainFileError(
                f"has a height of {heights[row, col]:g} m at row {first[0] + row}, column {first[1] + col}: "
                f"expected {MIN_HEIGHT_M:g} to {MAX_HEIGHT_M:g} m; a value that marks holes must be named in "
                "the file: gdal_edit.py -a_nodata VALUE"
            )
        return heights


@contextmanager
def open_raster(path: Path, datum: VerticalDatum) -> Iterator[Raster]:
    """Open a file of heights.

    Raises
    ------
    TerrainFileError
        When it cannot be used: also later, while it is open and read.
    """
    try:
        open_regular(path).close()
    except OSError as error:
        raise TerrainFileError(f"cannot be read: {error.strerror}") from None
    driver = "SRTMHGT" if path.suffix.lower() == ".hgt" else "GTiff"
    settings = {
        "GDAL_CACHEMAX": _CACHE_BYTES,
        "GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR",
        "GDAL_PAM_ENABLED": "NO",
    }
    try:
        with (
            warnings.catch_warnings(action="ignore"),
            rasterio.Env(**settings),
            rasterio.open(path, driver=driver) as dataset,
        ):
            _check(dataset)
            yield Raster(dataset, datum)
    except TerrainFileError:
        raise
    except Exception as error:  # GDAL, PROJ and their wrappers raise whatever a damaged file leads them to
        problem = str(error.__cause__ or error) or type(error).__name__
        expected = "expected a GeoTIFF or an SRTM tile such as N46E009.hgt, complete"
        raise TerrainFileError(f"cannot be read as an elevation model ({problem}): {expected}") from None


def _check(dataset: Any) -> None:
    """Check what kind of raster a file is."""
    if dataset.count != 1:
        raise TerrainFileError(f"has {dataset.count} bands: expected one, of heights")
    if dataset.dtypes[0].startswith("complex"):
        raise TerrainFileError("has complex numbers: expected heights")
    if min(dataset.shape) < 2:
        raise TerrainFileError(f"has {dataset.width} x {dataset.height} pixels: expected 2 x 2 at least")
    if dataset.crs is None or dataset.transform.is_identity:
        raise TerrainFileError(
            "does not say where on the Earth it is: expected a reference system and a place "
            "(gdal_edit.py -a_srs EPSG:NUMBER -a_ullr WEST NORTH EAST SOUTH)"
        )
    if dataset.transform.is_degenerate:
        raise TerrainFileError("has pixels without an area")
    unit = dataset.units[0]
    if unit and unit.lower() not in ("m", "metre", "meter", "metres", "meters"):
        raise TerrainFileError(f"has heights in {unit}: expected metres")
    rows, cols = dataset.block_shapes[0]
    if rows * cols * np.dtype(dataset.dtypes[0]).itemsize > _MAX_BLOCK_BYTES:
        raise TerrainFileError(
            f"has blocks of {cols} x {rows} pixels, too large to be read one by one: "
            "gdal_translate -co TILED=YES"
        )
