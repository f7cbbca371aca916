"""What a researcher pastes from docs/tracking.md works, and prints what the page says."""

import contextlib
import io
import re
from pathlib import Path

import numpy as np
import pytest

from gcs.io.detections.track_input import load

PAGE = (Path(__file__).parents[2] / "docs" / "tracking.md").read_text(encoding="utf-8")


def blocks(kind):
    fences = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)
    return [text for name, text in fences if name == kind]


def test_the_example_in_python_prints_the_pages_output():
    (code,) = blocks("python")
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        exec(compile(code, "docs/tracking.md", "exec"), {})
    assert said.getvalue() in blocks("")


@pytest.mark.parametrize("optional", [False, True])
def test_the_model_on_the_page_is_one_with_all_its_optional_keys_as_well(tmp_path, optional):
    model = blocks("toml")[0]
    if optional:
        model = re.sub(r"^# (\w+ = [^.\[]|\[anywhere])", r"\1", model, flags=re.MULTILINE)
        assert "\nturn_rate_std_deg_s = 17.0" in model
    (tmp_path / "model.toml").write_text(model)
    (tmp_path / "set.csv").write_text("k,x,y\n1,400.0,-600.0\n")
    found = load(tmp_path / "set.csv", tmp_path / "model.toml", None)
    assert [birth.probability for birth in found.model.births] == [0.03]
    assert found.model.births_per_s == (0.1 if optional else 0.0)


def test_the_sensors_and_the_table_on_the_page_fit_each_other(tmp_path):
    (table,) = (text for text in blocks("") if text.startswith("t_s,sensor"))
    model = "accel_psd_m2_s3 = 1.0\nsurvival_probability = 0.99\n" + blocks("toml")[1]
    model += "[anywhere]\nper_s = 0.1\n"
    (tmp_path / "model.toml").write_text(model)
    (tmp_path / "set.csv").write_text(table)
    scans = load(tmp_path / "set.csv", tmp_path / "model.toml", None).scans
    assert [(scan.sensor.name, len(scan.z_m)) for scan in scans] == [
        ("west", 2),
        ("camera", 0),
        ("camera", 1),
    ]
    np.testing.assert_allclose(scans[0].z_m[0], [-298.6, 2.54], atol=0.1)
