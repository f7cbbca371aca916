"""Having the compiled kernels ready before anything flies or is measured, and saying what that takes."""

from __future__ import annotations

import time
from typing import Final

from rich.console import Console

from gcs import compiling

TRACKING: Final = "gcs.tracking.glmb"
PLANNING: Final = "gcs.planning.routes"
LINKS: Final = "gcs.mavlink.quiet"
RECORDING: Final = "gcs.edge.packing"


def load_kernels(console: Console, *rooms: str) -> None:
    """Load the kernels of rooms, of all when none is named; compile what is not in the cache, and say so.

    What is compiled is told before and after, for whoever reads a log, too: a first start that is silent for
    half a minute looks like one that hangs.
    """
    began_s = time.perf_counter()
    is_cold = False

    def on_cold() -> None:
        nonlocal is_cold
        if not is_cold:
            console.print("compiling the kernels, once after an installation: half a minute to a minute")
        is_cold = True

    with console.status("loading the compiled kernels"):
        for room in rooms or (TRACKING, PLANNING, LINKS, RECORDING):
            compiling.warm_up(room, on_cold)
    if is_cold:
        taken_s = time.perf_counter() - began_s
        console.print(f"compiled in {taken_s:.0f} s; later starts load them from the cache", highlight=False)
