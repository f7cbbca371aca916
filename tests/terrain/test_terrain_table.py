"""Terrain of a mission file: what is read, recorded and said of it."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from helpers.ground_files import FRAME, MISSION, slope_at, write_mission

from gcs.cli.prepare.check import describe
from gcs.config import load, parse, read_text
from gcs.errors import ConfigError
from gcs.io.terminal import console_for

PLACE = np.array([[300.0, 200.0]])


def test_a_mission_has_the_heights_of_its_file(tmp_path):
    config = load(write_mission(tmp_path))
    assert config.elevation is not None
    assert config.elevation is config.elevation, "it is decoded once"
    np.testing.assert_allclose(config.elevation.heights_at(PLACE), slope_at(FRAME, PLACE), atol=0.1)
    assert config.terrain is not None
    assert (config.terrain.min_agl_m, config.terrain.max_agl_m) == (50.0, 120.0)


def test_what_is_recorded_of_a_mission_holds_its_ground(tmp_path):
    text, source = read_text(write_mission(tmp_path))
    (tmp_path / "ground.tif").unlink()
    config = parse(text, source)
    assert config.elevation is not None
    np.testing.assert_allclose(config.elevation.heights_at(PLACE), slope_at(FRAME, PLACE), atol=0.1)
    assert "# next to it" in text
    with pytest.raises(ConfigError, match=r"terrain\.file: no such file: .*ground\.tif"):
        read_text(source)


@pytest.mark.parametrize("line", ['terrain.file = "ground.tif"', "[terrain]\nfile = 'ground.tif'"])
def test_the_file_may_be_named_in_other_ways(tmp_path, line):
    text = MISSION.replace('[terrain]\nfile = "ground.tif"', "")
    text = line + text if line.startswith("terrain") else f"{text}\n{line}\n"
    assert load(write_mission(tmp_path, text)).elevation is not None


def test_without_terrain_the_ground_is_flat(tmp_path):
    config = load(write_mission(tmp_path, MISSION.replace('[terrain]\nfile = "ground.tif"', "")))
    assert config.elevation is None
    assert config.ground == "flat"


def test_keys_are_changed_before_the_file_is_read(tmp_path):
    mission = write_mission(tmp_path)
    text, source = read_text(mission, ["map.width_m=1500.0", "map.nodes_east=76"])
    elevation = parse(text, source).elevation
    assert elevation is not None
    assert elevation.height_msl_m(1500.0, 0.0) == pytest.approx(
        float(slope_at(FRAME, np.array([[1500.0, 0.0]]))[0]), abs=0.1
    )
    text, source = read_text(mission)
    wider = text.replace("width_m = 1000.0", "width_m = 8000.0").replace(
        "nodes_east = 51", "nodes_east = 401"
    )
    with pytest.raises(ConfigError, match=r"terrain\.file: the elevation model is that of a smaller map"):
        parse(wider, source)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("min_agl_m = 110.0", r"terrain\.max_agl_m: expected at least 20 m above terrain\.min_agl_m, 110 m"),
        ("min_agl_m = -1.0", r"terrain\.min_agl_m: "),
        ('vertical_datum = "egm96"', r'terrain\.vertical_datum: .*"ellipsoid"'),
        ('vertical_datum = "ellipsoid"', r"terrain\.file: .*ground\.tif: .*pyproj sync"),
        ("file_m = 1", "did you mean `file`"),
    ],
)
def test_a_mistake_is_named_with_its_key(tmp_path, line, said):
    with pytest.raises(ConfigError, match=said):
        load(write_mission(tmp_path, MISSION.replace("# next to it", f"\n{line}")))


def test_a_file_that_is_no_elevation_model_is_named_with_its_key(tmp_path):
    mission = write_mission(tmp_path)
    (tmp_path / "ground.tif").write_text("no raster")
    with pytest.raises(
        ConfigError, match=r"mission\.toml: terrain\.file: .*ground\.tif: .*expected a GeoTIFF"
    ) as found:
        load(mission)
    assert found.value.key == "terrain.file"


@pytest.mark.parametrize("table", ['terrain = { file = "ground.tif" }', 'terrain = { file = "{" }'])
def test_the_name_of_a_file_is_found_on_a_line_of_its_own(tmp_path, table):
    text = f"{table}\n{MISSION}".replace('[terrain]\nfile = "ground.tif"', "")
    with pytest.raises(ConfigError, match=r"on a line of its own|expected the name of a file"):
        load(write_mission(tmp_path, text))


def test_without_rasterio_the_package_to_install_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rasterio", None)
    for name in ("gcs.terrain.elevation_file", "gcs.terrain.raster"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    with pytest.raises(ConfigError, match=r"pip install 'swarm-gcs\[terrain\]'"):
        load(write_mission(tmp_path))


def test_the_check_of_a_file_describes_the_ground(tmp_path, capsys):
    describe(write_mission(tmp_path), 1, console_for())
    assert "ground.tif, pixels of 10 m, ground " in capsys.readouterr().out


def test_climbs_and_descents_are_flatter_downwind(tmp_path):
    text = MISSION.replace("north_m = 400.0", 'north_m = 400.0\nairframe = "slow"')
    text += "[airframe]\nspeed_m_s = 15.0\nwind_m_s = 5.0\nclimb_m_s = 3.0\n"
    text += "[airframes.slow]\nsink_m_s = 1.0\n"
    config = load(write_mission(tmp_path, text))
    assert config.elevation is not None
    highest_m = config.elevation.heights_msl_m.max() + 120.0
    true_m_s = 15.0 / (1.0 - 2.25577e-5 * highest_m) ** 2.12794
    assert 16.0 < true_m_s < 17.0, "15 m/s of indicated airspeed"
    over_ground_m_s = true_m_s + 5.0
    assert config.default_airframe.climb_gradient == pytest.approx(0.85 * 3.0 / over_ground_m_s)
    assert config.default_airframe.sink_gradient == pytest.approx(0.85 * 2.0 / over_ground_m_s)
    assert config.airframe_of(1).climb_gradient == pytest.approx(0.85 * 3.0 / over_ground_m_s)
    assert config.airframe_of(1).sink_gradient == pytest.approx(0.85 * 1.0 / over_ground_m_s)
