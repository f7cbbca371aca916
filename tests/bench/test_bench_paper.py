"""The paper's figures and claims come from one command."""

from __future__ import annotations

from pathlib import Path

import pytest
from bench_paper import run_paper
from rich.console import Console


@pytest.mark.slow
def test_the_papers_figures_and_claims_come_from_one_command(tmp_path: Path) -> None:
    found = run_paper(tmp_path, Console(quiet=True))
    assert {path.stem for path in (tmp_path / "figures").iterdir()} == {f"fig{n}" for n in range(3, 10)}
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    table = (tmp_path / "claims.md").read_text(encoding="utf-8")
    for claim in found:
        assert claim.verdict in page
        assert claim.seen in table
