"""Elevation of the ground under a mission's map, from a file of an elevation model, refused with holes.

The nodes lie in the local frame, as far apart as the pixels of the file, with heights bilinear between the
pixels. A file that is finer than `MAX_NODES` allow gives fewer nodes. Each then has the greatest height of
the squares around it, so that what is read between nodes is nowhere below the file's heights.

The map must be covered, without holes. Around it the nodes reach as far as the file does on all sides, up to
a bound: for turns and returns, and for ArduPlane, which asks for terrain up to 6 km around itself.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from pyproj import Transformer
from scipy.ndimage import maximum_filter

from gcs.errors import TerrainFileError
from gcs.geo import LocalFrame
from gcs.model import FloatArray
from gcs.terrain.datum import VerticalDatum, ellipsoid_to_msl, frame_to_degrees, geoid_heights_m
from gcs.terrain.elevation_grid import Elevation
from gcs.terrain.elevation_text import ElevationModel
from gcs.terrain.grid_nodes import MAX_NODES, Nodes, cut_margin
from gcs.terrain.raster import Raster, open_raster

MARGIN_M: Final = 500.0
"""Margin around the map, where the file has it."""
_WIDE_MARGIN_M: Final = 6000.0
_WIDE_NODES: Final = 1_000_000
"""Number of nodes up to which the margin is made wider."""
_MAX_PIXELS: Final = 400_000_000
"""Maximum number of pixels that are read."""
_STEP: Final = 16
OUTSIDE: Final = -math.inf
"""Height of a node outside the file, until the margin is cut."""


def read_elevation_model(
    path: Path, frame: LocalFrame, size_m: tuple[float, float], datum: VerticalDatum
) -> ElevationModel:
    """Read the elevation of a map and of what is around it.

    Parameters
    ----------
    size_m : (float, float)
        Extent of the map east and north of the frame's origin.
    datum : "msl" or "ellipsoid"
        What the file's heights are measured from.

    Raises
    ------
    TerrainFileError
        When the file cannot be used.
    """
    with open_raster(path, datum) as raster:
        reader = _Reader(raster, frame, size_m, datum)
        nodes, heights = reader.read()
    cut, heights = cut_margin(nodes, heights, Nodes.around(size_m, 0.0, nodes.spacing_m))
    origin_m = round(cut.first[1] * cut.spacing_m, 3), round(cut.first[0] * cut.spacing_m, 3)
    margins_m = (
        -origin_m[0],
        -origin_m[1],
        (cut.end[1] - 1) * cut.spacing_m - size_m[0],
        (cut.end[0] - 1) * cut.spacing_m - size_m[1],
    )
    remarks = []
    if reader.is_coarser:
        remarks.append(
            f"{path.name} has pixels of {reader.resolution_m:.3g} m, too many for this map: its greatest "
            f"heights in squares of {cut.spacing_m:.3g} m are used"
        )
    if min(margins_m) < MARGIN_M:
        west, south, east, north = (f"{max(0.0, margin):.0f} m" for margin in margins_m)
        remarks.append(
            f"beyond the map, {path.name} has the ground {west} west, {south} south, {east} east and {north} "
            f"north; {MARGIN_M:.0f} m are useful for turns and returns"
        )
    elevation = Elevation(origin_m, cut.spacing_m, heights)
    return ElevationModel(path.name, reader.resolution_m, elevation, tuple(remarks))


class _Reader:
    """Reader of a file for one map."""

    def __init__(
        self, raster: Raster, frame: LocalFrame, size_m: tuple[float, float], datum: VerticalDatum
    ) -> None:
        self._raster = raster
        self._size_m = size_m
        self._to_degrees = frame_to_degrees(frame)
        self._to_msl: Transformer | None = ellipsoid_to_msl() if datum == "ellipsoid" else None
        self._per_m = self._pixels_per_m()
        metres = np.linalg.inv(self._per_m)
        self.resolution_m = max(0.01, round(float(np.hypot(*metres).min()), 3))
        self._nodes, self.is_coarser = self._choose_nodes()

    def read(self) -> tuple[Nodes, FloatArray]:
        """Return nodes and their heights; NaN in holes, `OUTSIDE` outside the file.

        Raises
        ------
        TerrainFileError
            When the file does not cover the map, has a hole there, or is too fine.
        """
        nodes = self._nodes
        needed = Nodes.around(self._size_m, 0.0, nodes.spacing_m)
        self._check_covered(needed)
        heights = np.empty(nodes.shape)
        for tile in nodes.tiles():
            heights[tile.within(nodes)] = self._tile_heights(tile)
        holes = np.argwhere(~np.isfinite(heights[needed.within(nodes)]))
        if holes.size:
            row, col = holes[0].tolist()
            place = self._place(col * nodes.spacing_m, row * nodes.spacing_m)
            raise TerrainFileError(
                f"has a hole in the map at {place}: expected heights everywhere on it (gdal_fillnodata.py)"
            )
        return nodes, heights

    def _pixels_per_m(self) -> FloatArray:
        """Return the change of column and row for a metre east and north, at the centre of the map."""
        east = 0.5 * self._size_m[0] + np.array([0.0, 1.0, 0.0])
        north = 0.5 * self._size_m[1] + np.array([0.0, 0.0, 1.0])
        lon, lat = self._degrees(east, north)
        pixels = np.array(self._raster.pixels_at(lon, lat))
        per_m = pixels[:, 1:] - pixels[:, :1]
        if not np.isfinite(per_m).all() or abs(np.linalg.det(per_m)) < 1e-12:
            raise TerrainFileError(f"is of another place than the map: {self._place(*self._middle_m)}")
        return per_m

    @property
    def _middle_m(self) -> tuple[float, float]:
        return 0.5 * self._size_m[0], 0.5 * self._size_m[1]

    def _choose_nodes(self) -> tuple[Nodes, bool]:
        """Return the nodes, and True if they are further apart than the pixels."""
        for margin_m in np.arange(_WIDE_MARGIN_M, MARGIN_M, -MARGIN_M).tolist():
            nodes = Nodes.around(self._size_m, margin_m, self.resolution_m)
            if nodes.count <= _WIDE_NODES:
                return nodes, False
        spacing_m = self.resolution_m
        nodes = Nodes.around(self._size_m, MARGIN_M, spacing_m)
        while nodes.count > MAX_NODES:
            spacing_m = round(spacing_m * max(1.01, math.sqrt(nodes.count / MAX_NODES)), 3) + 0.001
            nodes = Nodes.around(self._size_m, MARGIN_M, spacing_m)
        area_m2 = nodes.count * spacing_m**2
        pixels = area_m2 * abs(float(np.linalg.det(self._per_m)))
        if pixels > _MAX_PIXELS:
            raise TerrainFileError(
                f"has {pixels / 1e6:.0f} million pixels on this map; at most {_MAX_PIXELS / 1e6:.0f} are "
                f"read: gdalwarp -r max -tr {spacing_m:.3g} {spacing_m:.3g}"
            )
        return nodes, spacing_m > self.resolution_m

    def _check_covered(self, needed: Nodes) -> None:
        """Check that the outer nodes of the map lie in the file: those between them do as well."""
        east, north = needed.places_m()
        is_outer = np.zeros(east.shape, dtype=bool)
        is_outer[[0, -1], :] = True
        is_outer[:, [0, -1]] = True
        east = east[is_outer]
        north = north[is_outer]
        missing = np.flatnonzero(~self._is_inside(*self._raster.pixels_at(*self._degrees(east, north))))
        if missing.size:
            first = int(missing[0])
            corners = np.array([[0.0, 0.0], self._size_m, [0.0, self._size_m[1]], [self._size_m[0], 0.0]])
            lon, lat = self._degrees(corners[:, 0], corners[:, 1])
            place = self._place(east[first], north[first])
            raise TerrainFileError(
                f"does not cover the map: it has no height at {place}; expected latitudes {lat.min():.5f}° "
                f"to {lat.max():.5f}° and longitudes {lon.min():.5f}° to {lon.max():.5f}°, and a pixel more "
                "on each side"
            )

    def _is_inside(self, cols: FloatArray, rows: FloatArray) -> npt.NDArray[np.bool_]:
        height, width = self._raster.shape
        is_inside: npt.NDArray[np.bool_] = (cols >= 0.0) & (cols <= width) & (rows >= 0.0) & (rows <= height)
        return is_inside

    def _degrees(self, east: FloatArray, north: FloatArray) -> tuple[FloatArray, FloatArray]:
        lon, lat, _ = self._to_degrees.transform(east, north, np.zeros_like(east))
        return np.asarray(lon), np.asarray(lat)

    def _place(self, east_m: float, north_m: float) -> str:
        lon, lat = self._degrees(np.array([east_m]), np.array([north_m]))
        return f"{lat[0]:.6f}°, {lon[0]:.6f}° (east {east_m:.0f} m, north {north_m:.0f} m)"

    def _tile_heights(self, tile: Nodes) -> FloatArray:
        """Return heights above MSL of some nodes."""
        lon, lat, cols, rows = self._coordinates(tile)
        is_inside = self._is_inside(cols, rows)
        heights = np.full(tile.shape, OUTSIDE)
        if not is_inside.any():
            return heights
        read = self._greatest if self.is_coarser else self._bilinear
        heights[is_inside] = read(cols[is_inside], rows[is_inside])
        if self._to_msl is not None:
            heights[is_inside] -= geoid_heights_m(self._to_msl, lon[is_inside], lat[is_inside])
        return heights

    def _coordinates(self, tile: Nodes) -> list[FloatArray]:
        """Return longitude, latitude, column and row of some nodes, interpolated between every 16th of them.

        Over 16 nodes of 100 m this differs by less than 0.1 m from the exact ones.
        """
        rows, row_weights = _weights(tile.shape[0])
        cols, col_weights = _weights(tile.shape[1])
        east, north = (places[np.ix_(rows, cols)] for places in tile.places_m())
        lon, lat = self._degrees(east, north)
        exact = (lon, lat, *self._raster.pixels_at(lon, lat))
        by_row = (
            np.einsum("ri,ij->rj", row_weights, values) for values in exact
        )  # small: no threads of BLAS
        return [np.einsum("rj,cj->rc", values, col_weights) for values in by_row]

    def _bilinear(self, cols: FloatArray, rows: FloatArray) -> FloatArray:
        """Return heights between the centres of pixels; at the border those of the outer pixels."""
        height, width = self._raster.shape
        x = np.clip(cols - 0.5, 0.0, width - 1.0)
        y = np.clip(rows - 0.5, 0.0, height - 1.0)
        col = np.minimum(x.astype(np.intp), width - 2)
        row = np.minimum(y.astype(np.intp), height - 2)
        first = int(row.min()), int(col.min())
        z = self._raster.read(first, (int(row.max()) + 2, int(col.max()) + 2))
        along = x - col
        down = y - row
        row -= first[0]
        col -= first[1]
        upper: FloatArray = (1.0 - along) * z[row, col] + along * z[row, col + 1]
        lower: FloatArray = (1.0 - along) * z[row + 1, col] + along * z[row + 1, col + 1]
        heights: FloatArray = (1.0 - down) * upper + down * lower
        return heights

    def _greatest(self, cols: FloatArray, rows: FloatArray) -> FloatArray:
        """Return the greatest heights in squares from each node to its neighbours; NaN where one has a hole.

        The pixels are first reduced to blocks, a quarter of a square wide. The result may be of a square that
        is wider by a block.
        """
        reach = self._nodes.spacing_m * np.abs(self._per_m).sum(axis=1)  # columns, rows
        block = np.maximum(1, (reach / 4.0).astype(np.intp))
        blocks = np.ceil((reach + 1.0) / block).astype(np.intp)
        pixels = np.array([cols, rows]) / block[:, np.newaxis]
        number = pixels.astype(np.intp)
        low = number.min(axis=1) - blocks
        high = number.max(axis=1) + blocks + 1
        z = self._blocks(low, high, block)
        z = maximum_filter(z, size=tuple(2 * blocks[::-1] + 1), mode="nearest")
        greatest = z[number[1] - low[1], number[0] - low[0]]
        return np.where(np.isposinf(greatest), np.nan, greatest)

    def _blocks(
        self, low: npt.NDArray[np.intp], high: npt.NDArray[np.intp], block: npt.NDArray[np.intp]
    ) -> FloatArray:
        """Return the greatest height of blocks of pixels; infinite with a hole, `OUTSIDE` off the file."""
        first_col, first_row = (low * block).tolist()
        end_col, end_row = (high * block).tolist()
        height, width = self._raster.shape
        inner = max(first_row, 0), max(first_col, 0)
        end = min(end_row, height), min(end_col, width)
        z = np.full((end_row - first_row, end_col - first_col), OUTSIDE)
        rows = slice(inner[0] - first_row, end[0] - first_row)
        cols = slice(inner[1] - first_col, end[1] - first_col)
        z[rows, cols] = np.nan_to_num(self._raster.read(inner, end), nan=np.inf)
        count = (high - low).tolist()
        result: FloatArray = z.reshape(count[1], int(block[1]), count[0], int(block[0])).max(axis=(1, 3))
        return result


def _weights(count: int) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """Return every 16th of some numbers and the last, and weights (count, k) to interpolate between them."""
    chosen = np.unique(np.append(np.arange(0, count, _STEP), count - 1))
    weights = [np.interp(np.arange(count), chosen, one) for one in np.eye(len(chosen))]
    return chosen, np.array(weights).T
