"""Disk space left for a recording, and how long it lasts."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DiskSpace:
    """Space of a recording, as last checked."""

    used_bytes: int
    """All parts together."""
    free_bytes: int
    """Left on the disk."""
    is_low: bool
    """True while the alarm about low disk space is raised."""
