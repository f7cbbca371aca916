"""The notebooks in `examples/notebooks` run as they are.

Cells run in this process: a kernel of Jupyter would take longer than most of them. They are written with
their outputs by ``jupyter execute --inplace examples/notebooks/*.ipynb``.
"""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parents[1] / "examples" / "notebooks"
MAX_BYTES = 60_000
SLOW = {"monte_carlo"}
"""They fly whole missions."""


def cells(path: Path) -> list[dict[str, Any]]:
    return [
        one for one in json.loads(path.read_text(encoding="utf-8"))["cells"] if one["cell_type"] == "code"
    ]


def printed(cell: dict[str, Any]) -> list[str]:
    """Return the lines that a cell has printed when the notebook was written."""
    texts = ["".join(one["text"]) for one in cell["outputs"] if one["output_type"] == "stream"]
    return "".join(texts).splitlines()


@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=[pytest.mark.slow] if path.stem in SLOW else [], id=path.stem)
        for path in sorted(FOLDER.glob("*.ipynb"))
    ],
)
def test_a_notebook_runs_and_prints_as_many_lines_as_it_shows(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plt = pytest.importorskip("matplotlib.pyplot", reason="pip install -e '.[test]'")
    plt.switch_backend("agg")
    monkeypatch.setattr(plt, "show", lambda: plt.close("all"))
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for number, cell in enumerate(cells(path), 1):
        shown = io.StringIO()
        with contextlib.redirect_stdout(shown):
            exec(compile("".join(cell["source"]), f"{path.name}, cell {number}", "exec"), names)
        assert len(shown.getvalue().splitlines()) == len(printed(cell))


def test_the_notebooks_are_small_and_show_their_results() -> None:
    paths = sorted(FOLDER.glob("*.ipynb"))
    assert [path.stem for path in paths] == [
        "monte_carlo",
        "plan_a_swarm",
        "read_a_recording",
        "track_a_data_set",
    ]
    for path in paths:
        assert path.stat().st_size < MAX_BYTES
        outputs = [one for cell in cells(path) for one in cell["outputs"]]
        assert outputs
        assert all(one["output_type"] != "error" for one in outputs)
