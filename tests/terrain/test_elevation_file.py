"""Heights of files: where they end up in the local frame, and what is said of a file that cannot be used."""

from __future__ import annotations

import io
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyproj
import pytest
import rasterio
from helpers.ground_files import FRAME, NORTH_M, SIZE_M, UTM, WEST_M, slope, slope_at, write_ground

from gcs.errors import TerrainFileError
from gcs.geo import LocalFrame
from gcs.terrain import elevation_file
from gcs.terrain.elevation_file import read_elevation_model
from gcs.terrain.elevation_text import decode_model

WITH_GEOID = """
import sys
from pathlib import Path
import pyproj.datadir
pyproj.datadir.append_data_dir(sys.argv[1])
from gcs.geo import LocalFrame
from gcs.terrain.elevation_file import read_elevation_model
from gcs.terrain.elevation_text import encode_model
frame = LocalFrame(46.8, 9.8, 1500.0)
path = Path(sys.argv[1]) / "slope.tif"
print(encode_model(read_elevation_model(path, frame, (1000.0, 800.0), "ellipsoid")))
"""
DAVOS = os.environ.get("DAVOS_TIF", "")
"""File of the Alps around Davos, 10 m pixels, EPSG:21781 (ethz-asl/terrain-navigation)."""


def read(path, datum="msl", size_m=SIZE_M, frame=FRAME):
    return read_elevation_model(path, frame, size_m, datum)


def random_places(count=500, size_m=SIZE_M, margin_m=400.0):
    low = -margin_m, -margin_m
    high = size_m[0] + margin_m, size_m[1] + margin_m
    return np.random.default_rng(1).uniform(low, high, (count, 2))


def test_a_slope_in_utm_has_its_heights_in_the_local_frame(tmp_path):
    model = read(write_ground(tmp_path / "slope.tif", slope()))
    places = random_places()
    np.testing.assert_allclose(model.elevation.heights_at(places), slope_at(FRAME, places), atol=0.01)
    assert model.resolution_m == pytest.approx(10.0, abs=0.01)
    assert model.elevation.spacing_m == model.resolution_m
    assert model.remarks == ()
    assert str(model).startswith("slope.tif, pixels of 10 m, ground ")


@pytest.mark.parametrize("dtype", ["int16", "uint16", "float64"])
def test_whole_metres_and_scaled_heights_are_read(tmp_path, dtype):
    path = write_ground(tmp_path / "slope.tif", np.rint(slope()) / 0.5, dtype=dtype)
    with rasterio.open(path, "r+") as file:
        file.scales = (0.5,)
    places = random_places(50)
    np.testing.assert_allclose(read(path).elevation.heights_at(places), slope_at(FRAME, places), atol=1.0)


def test_pixels_in_degrees_are_read(tmp_path):
    rows, cols = np.indices((200, 200))
    lat = 46.82 - (rows + 0.5) * 2e-4
    lon = 9.78 + (cols + 0.5) * 2e-4
    heights = 1500.0 + 1e4 * (lat - 46.8) + 5e3 * (lon - 9.8)
    transform = rasterio.Affine(2e-4, 0.0, 9.78, 0.0, -2e-4, 46.82)
    model = read(write_ground(tmp_path / "degrees.tif", heights, crs="EPSG:4326", transform=transform))
    places = random_places()
    lat, lon = np.array([FRAME.to_geodetic(*place) for place in places]).T
    expected = 1500.0 + 1e4 * (lat - 46.8) + 5e3 * (lon - 9.8)
    np.testing.assert_allclose(model.elevation.heights_at(places), expected, atol=0.02)
    assert model.resolution_m == pytest.approx(15.25, abs=0.05), "the narrower side of a pixel"


def test_an_srtm_tile_is_read_by_its_name(tmp_path):
    rows, cols = np.indices((1201, 1201))
    heights = np.rint(1000.0 + 0.4 * (1200 - rows) + 0.2 * cols).astype(">i2")
    (tmp_path / "N46E009.hgt").write_bytes(heights.tobytes())
    model = read(tmp_path / "N46E009.hgt")
    lat, lon = FRAME.to_geodetic(500.0, 400.0)
    expected = 1000.0 + 0.4 * 1200 * (lat - 46.0) + 0.2 * 1200 * (lon - 9.0)
    assert model.elevation.height_msl_m(500.0, 400.0) == pytest.approx(expected, abs=0.6)
    (tmp_path / "hills.hgt").write_bytes(heights.tobytes())
    with pytest.raises(TerrainFileError, match=r"such as N46E009\.hgt"):
        read(tmp_path / "hills.hgt")


def test_too_many_pixels_give_wider_squares_that_no_peak_rises_above(tmp_path, monkeypatch):
    monkeypatch.setattr(elevation_file, "MAX_NODES", 4000)
    monkeypatch.setattr(elevation_file, "_WIDE_NODES", 0)
    rng = np.random.default_rng(2)
    heights = slope() + 50.0 * (rng.random((360, 360)) > 0.99)
    path = write_ground(tmp_path / "peaks.tif", heights)
    model = read(path)
    assert model.elevation.heights_msl_m.size <= 4000
    assert model.elevation.spacing_m > 20.0
    assert "squares of" in model.remarks[0]
    to_degrees = pyproj.Transformer.from_crs(UTM, "EPSG:4326", always_xy=True)
    rows, cols = np.indices(heights.shape)
    lon, lat = to_degrees.transform(WEST_M + (cols + 0.5) * 10.0, NORTH_M - (rows + 0.5) * 10.0)
    places = np.array([FRAME.to_local(*place) for place in zip(lat.ravel(), lon.ravel(), strict=True)])
    above_m = model.elevation.heights_at(places) - heights.ravel()
    known = ~np.isnan(above_m)
    assert known.sum() > 20_000
    assert above_m[known].min() >= 0.0
    spacing_m = model.elevation.spacing_m
    assert above_m[known].max() < 50.0 + 0.6 * spacing_m, "and only the squares around a peak are raised"


def test_ten_gigabytes_cost_neither_memory_nor_time(tmp_path):
    """Of 60,000 x 45,000 pixels of 1 m only those of the map are there: the others would be holes."""
    path = tmp_path / "large.tif"
    profile = {
        "driver": "GTiff", "dtype": "float32", "crs": UTM, "count": 1, "height": 45_000, "width": 60_000,
        "transform": rasterio.Affine(1.0, 0.0, WEST_M, 0.0, -1.0, NORTH_M), "nodata": -9999.0,
        "tiled": True, "sparse_ok": True, "bigtiff": "yes",
    }  # fmt: skip
    with rasterio.open(path, "w", **profile) as file:
        file.write(slope(1.0, (4096, 4096)).astype("float32"), 1, window=((0, 4096), (0, 4096)))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.process_time()
    model = read(path)
    assert time.process_time() - began < 10.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000
    places = random_places()
    np.testing.assert_allclose(model.elevation.heights_at(places), slope_at(FRAME, places), atol=0.05)


def test_a_map_with_too_many_pixels_is_refused_with_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setattr(elevation_file, "MAX_NODES", 4000)
    monkeypatch.setattr(elevation_file, "_WIDE_NODES", 0)
    monkeypatch.setattr(elevation_file, "_MAX_PIXELS", 10_000)
    with pytest.raises(TerrainFileError, match="gdalwarp -r max"):
        read(write_ground(tmp_path / "slope.tif", slope()))


def test_a_hole_in_the_map_is_refused_with_its_place(tmp_path):
    heights = slope()
    heights[150, 150] = -9999.0
    with pytest.raises(TerrainFileError, match=r"hole in the map at 46\.80\d+°, 9\.80\d+° \(east \d+ m"):
        read(write_ground(tmp_path / "hole.tif", heights, nodata=-9999.0))
    heights[150, 150] = np.nan
    with pytest.raises(TerrainFileError, match="hole in the map"):
        read(write_ground(tmp_path / "nan.tif", heights))


def test_a_hole_beside_the_map_cuts_the_margin_and_is_said(tmp_path):
    heights = slope()
    heights[:, :80] = -9999.0  # up to 240 m west of the map
    model = read(write_ground(tmp_path / "hole.tif", heights, nodata=-9999.0))
    assert -260.0 < model.elevation.origin_m[0] < -150.0
    assert "m west" in model.remarks[0]
    assert np.isfinite(model.elevation.heights_msl_m).all()


def test_a_lake_beside_the_map_is_cut_off_on_its_side_alone(tmp_path):
    """The lake lies 200 m east of the map, within ground that is known 400 m further."""
    heights = slope()
    heights[100:140, 230:235] = np.nan
    elevation = read(write_ground(tmp_path / "lake.tif", heights)).elevation
    west, south = elevation.origin_m
    rows, cols = elevation.heights_msl_m.shape
    assert west < -900.0
    assert south < -900.0
    assert 1150.0 < west + (cols - 1) * elevation.spacing_m < 1300.0
    assert south + (rows - 1) * elevation.spacing_m > 1600.0


@pytest.mark.parametrize(
    ("size_m", "frame", "said"),
    [
        (
            (3000.0, 800.0),
            FRAME,
            r"does not cover the map: it has no height at .*; expected lat.* 46\.79",
        ),
        (SIZE_M, LocalFrame(46.8, 11.0, 1500.0), "does not cover the map"),
        (SIZE_M, LocalFrame(-33.0, -87.0, 70.0), "does not cover the map|another place"),
    ],
)
def test_a_file_of_another_place_is_refused(tmp_path, size_m, frame, said):
    with pytest.raises(TerrainFileError, match=said):
        read(write_ground(tmp_path / "slope.tif", slope()), size_m=size_m, frame=frame)


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
@pytest.mark.parametrize(
    ("profile", "said"),
    [
        ({"heights": np.stack([slope()] * 3)}, "3 bands: expected one"),
        ({"crs": None}, "does not say where"),
        ({"transform": rasterio.Affine.identity()}, "does not say where"),
        ({"crs": "+proj=utm +zone=32 +ellps=bessel"}, "unknown relation to WGS84"),
        ({"crs": 'LOCAL_CS["site",UNIT["metre",1]]'}, "expected one that PROJ knows"),
        ({"heights": slope() * 10.0}, r"height of \S+ m at row \d+, column \d+: expected -500 to 9000 m"),
        ({"heights": np.where(slope() > 1550.0, slope(), -9999.0)}, "gdal_edit.py -a_nodata VALUE"),
        ({"dtype": "complex64"}, "complex numbers"),
        ({"heights": slope()[:1]}, "2 x 2 at least"),
        ({"crs": "EPSG:32632+5773", "datum": "ellipsoid"}, 'expected vertical_datum = "msl"'),
        ({"crs": "EPSG:32632+8228"}, "foot|US survey|expected up in metres"),
        ({"crs": "EPSG:31254", "datum": "ellipsoid"}, "heights above the ellipsoid of WGS84"),
        ({"datum": "ellipsoid"}, r"pyproj sync --file us_nga_egm96_15\.tif"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_elevation_model_is_refused_with_what_was_expected(tmp_path, profile, said):
    given = dict(profile)
    datum = given.pop("datum", "msl")
    heights = given.pop("heights", slope())
    path = write_ground(tmp_path / "odd.tif", heights, **given)
    with pytest.raises(TerrainFileError, match=said):
        read(path, datum)


def test_heights_in_feet_are_refused(tmp_path):
    path = write_ground(tmp_path / "feet.tif", slope())
    with rasterio.open(path, "r+") as file:
        file.units = ("ft",)
    with pytest.raises(TerrainFileError, match="heights in ft: expected metres"):
        read(path)


def test_ellipsoidal_heights_become_msl_by_the_geoid_grid(tmp_path):
    """The grid of this test says 50 m at its western and 52 m at its eastern border."""
    write_ground(tmp_path / "slope.tif", slope())
    grid = tmp_path / "us_nga_egm96_15.tif"
    undulation = np.tile(np.linspace(50.0, 52.0, 9), (9, 1)).astype("float32")
    with rasterio.open(
        grid, "w", driver="GTiff", dtype="float32", count=1, height=9, width=9, crs="EPSG:4326",
        transform=rasterio.Affine(0.25, 0.0, 8.875, 0.0, -0.25, 47.875),
    ) as file:  # fmt: skip
        file.write(undulation, 1)
        file.update_tags(TYPE="VERTICAL_OFFSET_GEOGRAPHIC_TO_VERTICAL", AREA_OR_POINT="Point")
        file.set_band_description(1, "geoid_undulation")
    done = subprocess.run(
        [sys.executable, "-c", WITH_GEOID, str(tmp_path)], capture_output=True, text=True, check=True
    )  # a process of its own: PROJ keeps the grids that it has found
    elevation = decode_model(done.stdout).elevation
    places = random_places(50)
    lon = np.array([FRAME.to_geodetic(*place)[1] for place in places])
    expected = slope_at(FRAME, places) - 50.0 - (lon - 9.0)
    np.testing.assert_allclose(elevation.heights_at(places), expected, atol=0.2)


def test_what_cannot_be_opened_is_refused(tmp_path):
    (tmp_path / "empty.tif").touch()
    os.mkfifo(tmp_path / "pipe.tif")
    large = io.BytesIO()
    np.save(large, slope())
    (tmp_path / "array.tif").write_bytes(large.getvalue())
    for name, said in (
        (".", "a folder"),
        ("pipe.tif", "a named pipe"),
        ("none.tif", "No such file"),
        ("empty.tif", "expected a GeoTIFF"),
        ("array.tif", "expected a GeoTIFF"),
    ):
        with pytest.raises(TerrainFileError, match=said):
            read(tmp_path / name)


TILED = {"compress": "deflate", "tiled": True, "blockxsize": 64, "blockysize": 64}


@pytest.mark.parametrize("profile", [{}, TILED])
@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_damaged_files_end_in_one_readable_line(tmp_path, profile):
    whole = write_ground(tmp_path / "whole.tif", slope(), **profile).read_bytes()
    damaged = tmp_path / "damaged.tif"
    rng = np.random.default_rng(3)
    said = []
    for number in range(120):
        data = bytearray(whole)
        if number % 3 == 0:
            del data[int(rng.integers(0, len(data))) :]
        elif number % 3 == 1:
            for at in rng.integers(0, 600, 4):
                data[at] = int(rng.integers(256))
        else:
            at = int(rng.integers(0, len(data) - 64))
            data[at : at + 64] = rng.bytes(64)
        damaged.write_bytes(data)
        try:
            read(damaged)
        except TerrainFileError as error:
            said.append(str(error))
    assert len(said) > 40, "every cut, at least"
    assert "\n" not in "".join(said)


@pytest.mark.skipif(not DAVOS, reason="DAVOS_TIF names no file")
def test_the_alps_are_where_they_are():
    to_degrees = pyproj.Transformer.from_crs("EPSG:21781", "EPSG:4326", always_xy=True)
    lon, lat = to_degrees.transform(780_300.0, 186_300.0)
    frame = LocalFrame(lat, lon, 1560.0)
    elevation = read(Path(DAVOS), size_m=(4000.0, 3000.0), frame=frame).elevation
    with rasterio.open(DAVOS) as file:
        heights = file.read(1).astype(float)
    rows, cols = np.meshgrid(np.arange(100, 400), np.arange(100, 450), indexing="ij")
    lon, lat = to_degrees.transform(779_503.0 + (cols + 0.5) * 10.0, 190_480.0 - (rows + 0.5) * 10.0)
    places = np.array([frame.to_local(*place) for place in zip(lat.ravel(), lon.ravel(), strict=True)])
    error_m = elevation.heights_at(places) - heights[100:400, 100:450].ravel()
    assert np.abs(np.median(error_m)) < 0.05
    assert error_m.std() < 1.0
