"""A reader of the documentation site would miss a page, or follow a link that leads nowhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

if not all(map(find_spec, ("mkdocs", "material", "mkdocstrings", "mkdocstrings_handlers"))):
    pytest.skip("pip install -e '.[docs]'", allow_module_level=True)

ROOT = Path(__file__).parents[1]


@pytest.mark.real_time
@pytest.mark.timeout(300)
def test_the_site_is_built_without_a_warning_and_is_complete(tmp_path: Path) -> None:
    """Missing pages, links and anchors are errors (`strict`)."""
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(
        build, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=280, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr

    def page(uri: str) -> str:
        return (tmp_path / uri / "index.html").read_text(encoding="utf-8")

    assert 'id="gcs-order-hold"' in page("reference/command-line")
    assert 'id="sim-vehicles-run"' in page("reference/command-line")
    assert 'id="simulation"' in page("reference/mission-file")
    assert "0001-self-describing-scans" in page("decisions")
    for package in ("gcs.tracking", "gcs.planning", "gcs.mavlink"):
        documented = page(f"reference/{package}")
        public = getattr(import_module(package), "__all__", [])
        assert [name for name in public if f'id="{package}.{name}"' not in documented] == []
    guide = page("field-guide")
    assert 'href="../reference/mission-file/"' in guide
    copies = set(re.findall(r'href="\.\./(files/[^"]+)"', guide))
    assert len(copies) == 3
    assert all((tmp_path / copy).is_file() for copy in copies)
    assert 'id="swarmstatus"' in page("messages")
    check_that_nothing_is_loaded_from_elsewhere(tmp_path)


def check_that_nothing_is_loaded_from_elsewhere(site: Path) -> None:
    """Of scripts, styles, fonts and pictures; the theme would get mermaid from another host."""
    loads = re.compile(
        r'<(?:script|img|iframe|source)\b[^>]*\bsrc="?(https?:)?//|<link\b[^>]*\bhref="?(https?:)?//'
    )
    pages = {path: path.read_text(encoding="utf-8") for path in site.rglob("*.html")}
    assert [path for path, text in pages.items() if loads.search(text)] == []
    styles = [path for path in site.rglob("*.css") if re.search(r"url\([\"']?(https?:)?//", path.read_text())]
    assert styles == []
    drawn = [text for text in pages.values() if 'class="mermaid"' in text]
    assert all('assets/mermaid.js"></script>' in text for text in drawn)
    assert bool(drawn) is (site / "assets" / "mermaid.js").is_file()
    assert "stateDiagram-v2" in pages[site / "missions" / "index.html"]
