"""Reference systems of elevation models: places of the local frame in a file, and its heights above MSL.

Heights are of the EGM96 geoid, as the receivers and firmwares of vehicles give their altitudes above mean sea
level. National heights differ from it by less than 1 m, and count as the same.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from pyproj import CRS, Transformer
from pyproj.exceptions import ProjError

from gcs.errors import TerrainFileError
from gcs.geo import LocalFrame
from gcs.model import FloatArray

VerticalDatum = Literal["msl", "ellipsoid"]

_GEOID_GRID: Final = "us_nga_egm96_15.tif"
_WGS84_RADIUS_M: Final = 6_378_137.0
_DEGREES: Final = "+step +proj=unitconvert +xy_in=rad +xy_out=deg"
_RADIANS: Final = "+step +proj=unitconvert +xy_in=deg +xy_out=rad"


def frame_to_degrees(frame: LocalFrame) -> Transformer:
    """Return the transformer from east, north and 0 to longitude, latitude and a height, as `to_geodetic`."""
    origin = f"+lat_0={frame.lat_deg!r} +lon_0={frame.lon_deg!r} +h_0={frame.alt_msl_m!r}"
    return Transformer.from_pipeline(
        f"+proj=pipeline +ellps=WGS84 +step +inv +proj=topocentric {origin} +step +inv +proj=cart {_DEGREES}"
    )


def degrees_to_file(crs: CRS) -> Transformer:
    """Return the transformer from longitude and latitude on WGS84 to the axes of a file.

    Raises
    ------
    TerrainFileError
        When the relation of the file's datum to WGS84 is not known.
    """
    level = crs.sub_crs_list[0] if crs.is_compound else crs.to_2d()
    expected = "expected one that PROJ knows: gdal_edit.py -a_srs EPSG:NUMBER"
    if not (level.is_projected or level.is_geographic):
        raise TerrainFileError(f"its reference system, {crs.name}, is not one of the Earth; {expected}")
    try:
        return Transformer.from_crs("EPSG:4326", level, always_xy=True, allow_ballpark=False)
    except ProjError:
        raise TerrainFileError(
            f"its reference system, {crs.name}, has a datum of unknown relation to WGS84; {expected}"
        ) from None


def check_vertical_datum(crs: CRS, datum: VerticalDatum) -> None:
    """Check that the heights of a reference system are those that the mission file says.

    Raises
    ------
    TerrainFileError
        For heights of another kind, in another unit than metres, or of another ellipsoid than that of WGS84.
    """
    vertical = crs.sub_crs_list[1] if crs.is_compound else None
    has_height = len(crs.axis_info) > 2
    is_ellipsoidal = has_height and (vertical is None or "ellipsoid" in vertical.name.lower())
    if has_height and is_ellipsoidal != (datum == "ellipsoid"):
        kind = "ellipsoid" if is_ellipsoidal else "msl"
        raise TerrainFileError(
            f"its heights are those of {crs.name if vertical is None else vertical.name}: "
            f'expected vertical_datum = "{kind}"'
        )
    axis = crs.axis_info[-1] if has_height else None
    if axis is not None and (axis.unit_conversion_factor != 1.0 or axis.direction.lower() != "up"):
        raise TerrainFileError(f"its heights are {axis.direction} in {axis.unit_name}; expected up in metres")
    ellipsoid = crs.ellipsoid
    is_wgs84 = ellipsoid is not None and abs(ellipsoid.semi_major_metre - _WGS84_RADIUS_M) < 1.0
    if datum == "ellipsoid" and not is_wgs84:
        name = "another ellipsoid" if ellipsoid is None else ellipsoid.name
        raise TerrainFileError(
            f'is of {name}: with vertical_datum = "ellipsoid", expected heights above the ellipsoid of WGS84'
        )


def ellipsoid_to_msl() -> Transformer:
    """Return the transformer of heights above the ellipsoid, at longitude and latitude, to MSL.

    Raises
    ------
    TerrainFileError
        When the geoid grid is not installed.
    """
    try:
        return Transformer.from_pipeline(
            f"+proj=pipeline {_RADIANS} +step +proj=vgridshift +grids={_GEOID_GRID} {_DEGREES}"
        )
    except ProjError:
        raise TerrainFileError(
            "its heights above the ellipsoid need the geoid grid of EGM96, which is not installed: "
            f"pyproj sync --file {_GEOID_GRID}"
        ) from None


def geoid_heights_m(to_msl: Transformer, lon_deg: FloatArray, lat_deg: FloatArray) -> FloatArray:
    """Return the height of the geoid above the ellipsoid at places.

    Raises
    ------
    TerrainFileError
        When the geoid grid does not cover the places.
    """
    heights = np.asarray(to_msl.transform(lon_deg, lat_deg, np.zeros_like(lon_deg))[2])
    if not np.isfinite(heights).all():
        raise TerrainFileError(f"the installed geoid grid, {_GEOID_GRID}, does not cover it")
    return -heights
