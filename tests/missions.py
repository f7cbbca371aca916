"""A mission that is over soon, for faults that must not end it."""

import re
from pathlib import Path

from gcs.config import read_text


def short_mission(folder: Path) -> Path:
    """Write the shipped deterministic mission with its targets 300 m ahead of the agents, on a free map."""
    text, _ = read_text("deterministic")
    text = re.sub(r"discs_m = \[\n.*?\n\]", "discs_m = []", text, count=1, flags=re.DOTALL)
    text, moved = re.subn(r"east_m = 1[78]\d0\.0", "east_m = 420.0", text)
    assert moved == 8, "four targets and their places of birth"
    file = folder / "short.toml"
    file.write_text(text)
    return file
