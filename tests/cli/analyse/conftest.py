"""Files of detections, and what makes them."""

import numpy as np
import pytest
from helpers.detection_sets import MODEL, RADARS, made, seen_by_both


@pytest.fixture
def files(tmp_path):
    arrays = made()
    np.savez(tmp_path / "set.npz", **arrays)
    np.savetxt(tmp_path / "set.csv", arrays["meas"], "%.10g", ",", header="k,x,y,src")
    np.savetxt(tmp_path / "truth.csv", arrays["truth"], "%.10g", ",", header="k,id,px,vx,py,vy")
    (tmp_path / "model.toml").write_text(MODEL)
    return tmp_path


@pytest.fixture
def radars(tmp_path):
    text, truth = seen_by_both(np.random.default_rng(3))
    (tmp_path / "set.csv").write_text(text)
    (tmp_path / "model.toml").write_text(RADARS)
    np.savez(tmp_path / "truth.npz", truth=truth)
    return tmp_path
