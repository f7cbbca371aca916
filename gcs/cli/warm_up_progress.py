"""Compiled kernels: load or compile them before a run, and show the progress."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

from rich.console import Console

if TYPE_CHECKING:
    from gcs.config import Config

TRACKING: Final = "gcs.tracking.glmb.filter"
HISTORIES: Final = "gcs.tracking.trajectories.recovery"
"""Recovered and smoothed trajectories, for `gcs track` only."""
STATE_SPACE: Final = "gcs.tracking.state_space.filter"
"""Trackers with manoeuvres or models of the user, for `gcs track` and the library only."""
PLANNING: Final = "gcs.planning.warm_up"
LINKS: Final = "gcs.mavlink.fleet.fast_telemetry"
SEPARATION: Final = "gcs.core.separation.forward_flight"
TERRAIN: Final = "gcs.planning.terrain.warm_up"
"""Routes over terrain, for missions with `[terrain]` only."""
FLYING: Final = (TRACKING, PLANNING, LINKS, SEPARATION)
ALL: Final = (*FLYING, HISTORIES, STATE_SPACE, TERRAIN)
_NAMES: Final = {
    TRACKING: "trackers", HISTORIES: "trajectories", PLANNING: "planner", LINKS: "links",
    SEPARATION: "separation", TERRAIN: "routes over terrain", STATE_SPACE: "trackers with other models",
}  # fmt: skip


def flying(config: Config) -> tuple[str, ...]:
    """Return the modules whose kernels fly a mission."""
    return FLYING if config.terrain is None else (*FLYING, TERRAIN)


def load_kernels(console: Console, *modules: str) -> None:
    """Load the kernels of modules, by default those of a flight; compile those that are not in the cache.

    Prints the progress of a compilation: for each kernel in a terminal, for each module in a log.
    """
    from gcs import jit  # Loads numba.

    began_s = time.perf_counter()
    cold: list[str] = []
    with console.status("loading the compiled kernels") as status:

        def on_compiled(module: str, number: int, count: int) -> None:
            name = _NAMES.get(module, module)
            if not cold:
                console.print(
                    "compiling the kernels, once after an installation: half a minute on two free cores "
                    "(gcs warm-up does it beforehand)"
                )
            if name not in cold:
                cold.append(name)
                if not console.is_terminal:
                    console.print(f"compiling {count} kernels: {name}", highlight=False)
            status.update(f"compiling kernel {number} of {count}: {name}")

        jit.warm_up(*(modules or FLYING), on_compiled=on_compiled)
    if cold:
        elapsed_s = time.perf_counter() - began_s
        console.print(
            f"compiled in {elapsed_s:.0f} s; later starts load them from the cache", highlight=False
        )
