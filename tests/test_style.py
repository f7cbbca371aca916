"""Style and layers, checked by the command that runs the tests; `.ci/run` checks the types, too."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
CHECKED = ["gcs", "sim_vehicles", "tests", "mkdocs_hooks.py"]

CHECKS = {
    "ruff": [sys.executable, "-m", "ruff", "check", *CHECKED],
    "format": [sys.executable, "-m", "ruff", "format", "--check", *CHECKED],
    "layers": [str(Path(sys.executable).parent / "lint-imports"), "--no-cache"],
}


@pytest.mark.parametrize("check", CHECKS)
def test_style_and_layers_hold(check: str) -> None:
    done = subprocess.run(CHECKS[check], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def _unpacked_displays(path: Path) -> list[str]:
    """Return the places where a tuple display is assigned to a tuple, other than swaps."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.Assign) or not isinstance(node.value, ast.Tuple | ast.List):
            continue
        for target in node.targets:
            if not isinstance(target, ast.Tuple | ast.List):
                continue
            assigned = sorted(ast.unparse(one) for one in target.elts)
            if assigned != sorted(ast.unparse(one) for one in node.value.elts):
                found.append(f"{path.relative_to(ROOT)}:{node.lineno}: {ast.unparse(node)}")
    return found


MAX_PARAMETERS = 8


def _many_parameters(path: Path) -> list[str]:
    """Return the functions with too many parameters, other than kernels and commands: those are decorated."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) or node.decorator_list:
            continue
        names = [one.arg for one in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
        count = len(names) - (names[:1] == ["self"])
        if count > MAX_PARAMETERS:
            found.append(f"{path.relative_to(ROOT)}:{node.lineno}: {node.name} has {count} parameters")
    return found


def test_no_function_has_too_many_parameters() -> None:
    paths = [path for folder in ("gcs", "sim_vehicles") for path in sorted((ROOT / folder).rglob("*.py"))]
    assert not [place for path in paths for place in _many_parameters(path)]


def test_there_is_one_assignment_a_line() -> None:
    paths = [path for folder in ("gcs", "sim_vehicles") for path in sorted((ROOT / folder).rglob("*.py"))]
    assert not [place for path in paths for place in _unpacked_displays(path)]
