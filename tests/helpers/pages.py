"""Pages of the documentation: their code blocks, the files to save, and the commands of this project."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]
COMMAND: Final = re.compile(r"(gcs|sim-vehicles) [a-z]")
FENCE: Final = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SAVED: Final = re.compile(
    r"\b[Ss]ave (?:this|it) as `([\w.]+)`.*?^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL
)


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def blocks(page: Path, language: str) -> list[str]:
    return [text for name, text in FENCE.findall(text_of(page)) if name == language]


def words_of(line: str) -> list[str]:
    """Split a command as a shell does, without its prompt and comment."""
    return shlex.split(line.strip().removeprefix("$ "), comments=True)


def shown_commands(page: Path) -> list[str]:
    """Return the commands in code blocks, fenced without a language or indented."""
    lines = [line for block in blocks(page, "") for line in block.splitlines()]
    lines += re.findall(r"^    (\S.*)$", FENCE.sub("", text_of(page)), re.MULTILINE)
    parts = [part.strip().removeprefix("$ ") for line in lines for part in line.split(" && ")]
    return [part for part in parts if COMMAND.match(part)]
