"""An installed package would lack a file, or two places would give different versions."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
NOT_SHIPPED = {"gcs/console/page_types.d.ts"}
"""Files of the packages that only checks read."""
NO_TEXT = {".png", ".mcap", ".tlog", ".bin", ".ulg", ".npz"}


def sources() -> set[str]:
    """Return the files of both packages, as names in the wheel."""
    paths = [path for package in ("gcs", "sim_vehicles") for path in walk(ROOT / package)]
    return {path.relative_to(ROOT).as_posix() for path in paths} - NOT_SHIPPED


def walk(folder: Path) -> list[Path]:
    """Return the files below a folder, also below linked folders."""
    found = []
    for path in folder.iterdir():
        if path.is_dir() and path.name != "__pycache__":
            found += walk(path)
        elif path.is_file() and path.suffix != ".pyc":
            found.append(path)
    return found


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with wheel and sdist, built from a copy: a build writes beside its sources."""
    pytest.importorskip("setuptools", minversion="77", reason="pip install -e '.[test]'")
    copy = tmp_path_factory.mktemp("packaged") / "copy"
    copy.mkdir()
    ignore = shutil.ignore_patterns("__pycache__", "target")
    for name in ("gcs", "sim_vehicles", "config", "docs", "examples", ".github"):
        shutil.copytree(ROOT / name, copy / name, ignore=ignore, symlinks=True)
    for path in ROOT.iterdir():
        if path.is_file():
            shutil.copy(path, copy)
    build = "from setuptools import build_meta as b; b.build_wheel('dist'); b.build_sdist('dist')"
    done = subprocess.run(
        [sys.executable, "-c", build], cwd=copy, capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stderr
    return copy / "dist"


def test_the_wheel_has_every_file_of_the_packages(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    names = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert sources() - names == set()
    assert names - sources() == set()
    assert {
        "gcs/tracking/glmb/recursion.py",
        "gcs/console/static/index.html",
        "gcs/config/reference.toml",
        "gcs/scenarios/prescribed.toml",
        "gcs/field/px4-sitl.toml",
        "gcs/py.typed",
    } <= names


def test_the_sdist_has_what_a_build_and_a_reader_need(built: Path) -> None:
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert sources() - names == set()
    read = {"README.md", "CHANGELOG.md", "SECURITY.md", "LICENSE", "CITATION.cff", "requirements.lock"}
    checked = {"package.json", "package-lock.json", "biome.json", "tsconfig.json", ".github/workflows/ci.yml"}
    assert read | checked <= names


def test_the_version_is_in_one_place() -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+(\.dev0|rc\d+)?", PROJECT["version"])
    others = {"pyproject.toml", "requirements.lock", "package-lock.json", "CHANGELOG.md"}
    files = [path for path in ROOT.iterdir() if path.is_file() and path.name not in others]
    for folder in ("gcs", "sim_vehicles", "config", "docs", "examples", ".github"):
        files += [path for path in walk(ROOT / folder) if path.suffix not in NO_TEXT]
    version = re.compile(
        rf"(?<![\d.]){re.escape(PROJECT['version'])}(?![\d.]*\d)|^__version__|^version: ", re.MULTILINE
    )
    assert [path for path in files if version.search(path.read_text(encoding="utf-8"))] == []
    released = re.findall(
        r"^## (\d+\.\d+\.\d+) - \d{4}-\d\d-\d\d$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE
    )
    assert "dev" in PROJECT["version"] or PROJECT["version"] == released[0]


def test_the_locked_versions_are_those_that_the_package_allows_and_name_no_place() -> None:
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    assert not re.search(r"https?:|file:|^-|[ =]/\w", text, re.MULTILINE)
    locked = {name.lower() for name in re.findall(r"^([\w.-]+)==", text, re.MULTILINE)}
    extras = PROJECT["optional-dependencies"]
    wanted = [*PROJECT["dependencies"], *extras["serial"], *extras["terrain"]]
    assert {re.match(r"[\w-]+", one)[0].lower() for one in wanted} - locked == set()  # type: ignore[index]


def test_ci_runs_the_commands_of_the_readme_on_every_version() -> None:
    ci = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert "pip install . && gcs demo" in ci
    assert "pip install . && gcs demo" in readme
    assert "pip install -e '.[test]' && gcs warm-up\npytest\n" in readme
    assert "pip install -e '.[test,docs]' && gcs warm-up" in ci
    assert "run: pytest\n" in ci
    versions = [one.rpartition(" ")[2] for one in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", one)]
    tested = re.findall(r'"(3\.\d+)"', ci.partition("python: [")[2].partition("]")[0])
    assert set(versions) <= set(tested)
