"""Mode names: one name for the same behaviour on every autopilot.

Each profile (`gcs.mavlink.autopilots`) has the numbers. Modes of one autopilot only keep its name.
"""

from __future__ import annotations

from typing import Final

AUTO: Final = "AUTO"
"""Flies its mission."""
LOITER: Final = "LOITER"
"""Circles at its position (PX4: Hold)."""
RTL: Final = "RTL"
"""Returns to launch."""
INITIALISING: Final = "INITIALISING"
"""Starts: an ArduPlane chooses its mode itself afterwards."""
PILOTED: Final = frozenset(
    {"MANUAL", "STABILIZE", "STABILIZED", "TRAINING", "ACRO", "FBWA", "FBWB", "CRUISE", "AUTOTUNE"}
    | {"ALTCTL", "POSCTL", "RATTITUDE", "QSTABILIZE", "QHOVER", "QACRO"}
)
"""Modes of manual flight: the pilot keeps control."""
