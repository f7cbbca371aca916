"""Having the compiled kernels ready before anything flies or is measured, and saying what that takes."""

from __future__ import annotations

import time
from typing import Final

from rich.console import Console

from gcs import jit

TRACKING: Final = "gcs.tracking.glmb.filter"
HISTORIES: Final = "gcs.tracking.trajectories.recovery"
"""Recovered and smoothed trajectories: `gcs track` alone asks for them."""
PLANNING: Final = "gcs.planning.planner"
LINKS: Final = "gcs.mavlink.fleet.fast_telemetry"
FLYING: Final = (TRACKING, PLANNING, LINKS)
ALL: Final = (*FLYING, HISTORIES)
_NAMES: Final = {
    TRACKING: "trackers", HISTORIES: "trajectories", PLANNING: "planner", LINKS: "links",
}  # fmt: skip


def load_kernels(console: Console, *rooms: str) -> None:
    """Load the kernels of rooms, of all that fly when none is named; compile what is not in the cache.

    What is compiled is told before, meanwhile and after: a first start that is silent for a minute looks like
    one that hangs. A terminal shows the number of the kernel; a log gets a line for each room.
    """
    began_s = time.perf_counter()
    cold: list[str] = []
    with console.status("loading the compiled kernels") as status:

        def on_compiled(room: str, number: int, count: int) -> None:
            name = _NAMES.get(room, room)
            if not cold:
                console.print(
                    "compiling the kernels, once after an installation: one to two minutes on two cores "
                    "(gcs warm-up does it beforehand)"
                )
            if name not in cold:
                cold.append(name)
                if not console.is_terminal:
                    console.print(f"compiling {count} kernels: {name}", highlight=False)
            status.update(f"compiling kernel {number} of {count}: {name}")

        jit.warm_up(*(rooms or FLYING), on_compiled=on_compiled)
    if cold:
        taken_s = time.perf_counter() - began_s
        console.print(f"compiled in {taken_s:.0f} s; later starts load them from the cache", highlight=False)
