"""Names of what a vehicle does by itself: the same word for the same behaviour on every autopilot.

Which numbers an autopilot has for them stands in its profile (`gcs.mavlink.autopilots`); modes that only one
autopilot knows keep the name that its users know.
"""

from __future__ import annotations

from typing import Final

AUTO: Final = "AUTO"
"""It flies its mission."""
LOITER: Final = "LOITER"
"""It circles where it is (PX4's Hold)."""
RTL: Final = "RTL"
"""It returns home."""
