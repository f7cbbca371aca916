"""Stages and results of a mission upload."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

Stage: TypeAlias = Literal["new", "park", "upload", "verify", "select", "mode", "hold", "clear", "done"]
OnboardState: TypeAlias = Literal["equal", "old", "whole", "cleared", "unknown"]


@dataclass(frozen=True, slots=True)
class UploadResult:
    """Result of a mission upload."""

    t_ns: int
    ok: bool
    """True if the mission is stored, verified and being flown."""
    onboard: OnboardState
    """Onboard mission: this one ("equal"), the one before ("old"), one of the two ("whole"), none
    ("cleared"), or possibly inconsistent ("unknown")."""
    detail: str
    duration_s: float
    retries: int
    was_held: bool
    """True if the vehicle was put into LOITER. It then flies its mission only if `ok`."""
    selected: bool
    """True if the vehicle flies its stored mission. Before its first item is selected it flies an item of the
    mission before, and counts on from that number."""
