"""The page of modules in the documentation: the first sentence of each file.

``python tests/helpers/modules_page.py > docs/modules.md`` writes it. A test compares both.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

_ROOT: Final = Path(__file__).resolve().parents[2]
_HEAD: Final = """# Modules

What each file does, in one sentence. Search this page for the thing that you want to change: a limit or a
threshold is in the file that the sentence names. [Working on swarm-gcs](../CONTRIBUTING.md#where-things-are)
shows how the packages depend on each other.
"""
_INITS: Final = ("__init__.py", "__main__.py")


def modules_page() -> str:
    """Return the page."""
    return _HEAD + "".join(_section(folder) for folder in _folders())


def _folders() -> Iterator[Path]:
    for package in ("gcs", "sim_vehicles"):
        for init in sorted((_ROOT / package).rglob("__init__.py")):
            yield init.parent
            if init.parent.name == "console":
                yield init.parent / "static"


def _section(folder: Path) -> str:
    files = sorted([*folder.glob("*.py"), *folder.glob("*.js")])
    rows = [f"| `{file.stem}` | {_cell(_sentence(file))} |\n" for file in files if file.name not in _INITS]
    init = folder / "__init__.py"
    about = _sentence(init) if init.exists() else "Modules of the console's page, in the browser."
    table = "\n| module | |\n|---|---|\n" + "".join(rows) if rows else ""
    return f"\n## {folder.relative_to(_ROOT)}\n\n{about}\n{table}"


def _sentence(file: Path) -> str:
    """Return the first line of a file's docstring, or of its comment."""
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".js":
        return text.partition("\n")[0].removeprefix("// ")
    return (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]


def _cell(text: str) -> str:
    return text.replace("``", "`").replace("|", r"\|")


if __name__ == "__main__":
    sys.stdout.write(modules_page())
