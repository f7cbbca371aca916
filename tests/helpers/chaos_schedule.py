"""Faults of a run of chaos, drawn from a seed."""

from __future__ import annotations

from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np

Part: TypeAlias = Literal[
    "command", "standby", "bridge", "command and bridge",
    "command to bridge", "command to all", "standby to all", "all paths",
    "radio", "clock of command", "clock of standby", "disk of command", "readers", "senders",
]  # fmt: skip
Deed: TypeAlias = Literal[
    "kill", "stop", "restart", "cut", "delay", "lose", "repeat", "reorder", "step", "fill", "stall", "flood"
]

PATHS: tuple[Part, ...] = ("command to bridge", "command to all", "standby to all", "all paths")
"""TCP connections between the processes."""

_FLY_TO_THE_END: Final = 0.1
"""Share of the runs in which the mission must end; the others end after their faults, in half the time."""


class Fault(NamedTuple):
    """A fault of one part."""

    at_s: float
    """After the missions were uploaded and the standby had the state."""
    part: Part
    deed: Deed
    duration_s: float = 0.0
    """Of a stop, or of anything that ends by itself."""
    step_s: float = 0.0
    """Of a clock."""

    def __str__(self) -> str:
        words = f"{self.at_s:.1f} s {self.deed} {self.part}"
        if self.step_s:
            words += f" by {self.step_s:.1f} s"
        return words + (f" for {self.duration_s:.1f} s" if self.duration_s else "")


class Schedule(NamedTuple):
    """Faults of one run."""

    is_bridge_alone: bool
    """True: the bridge is a process by itself, as on another machine; False: command starts it."""
    faults: tuple[Fault, ...]
    orders: tuple[tuple[float, int, float], ...]
    """Times at which a vehicle is to hold, the vehicles, and times after which they resume."""
    flies_to_the_end: bool = True
    answer_s: float = 40.0
    """Time that an operator waits for the answer to an order; after a take-over there may be none."""


def draw_schedule(seed: int) -> Schedule:
    """Draw the faults of a run: of processes in half of the runs, of what is between them in the others."""
    rng = np.random.default_rng(seed)
    main_s = float(rng.uniform(3.0, 12.0))
    is_of_network = bool(rng.random() < 0.5)
    faults = _network_faults(rng, main_s) if is_of_network else _process_faults(rng, main_s)
    if rng.random() < 0.5:
        faults.append(_radio_fault(rng, float(rng.uniform(0.0, main_s))))
    orders = [
        (float(rng.uniform(0.0, main_s + 6.0)), int(rng.integers(1, 5)), float(rng.uniform(1.0, 4.0)))
        for _ in range(3)
    ]
    is_bridge_alone = is_of_network or bool(rng.random() < 0.4)  # paths to a bridge need an address
    flies_to_the_end = bool(rng.random() < _FLY_TO_THE_END)
    return Schedule(is_bridge_alone, tuple(sorted(faults)), tuple(sorted(orders)), flies_to_the_end)


def _process_faults(rng: np.random.Generator, main_s: float) -> list[Fault]:
    """Draw one that ends or stops command, others before and after it."""
    faults = [_main_fault(rng, main_s)]
    for _ in range(int(rng.integers(0, 3))):
        part: Part = "standby" if rng.random() < 0.5 else "bridge"
        faults.append(_fault(rng, float(rng.uniform(0.0, main_s)), part))
    if rng.random() < 0.5:
        part = "bridge" if rng.random() < 0.5 else "command"
        faults.append(_fault(rng, main_s + float(rng.uniform(6.0, 12.0)), part))
    return faults


def _main_fault(rng: np.random.Generator, at_s: float) -> Fault:
    kind = rng.random()
    if kind < 0.55:
        return Fault(at_s, "command", "kill")
    if kind < 0.65:
        return Fault(at_s, "command and bridge", "kill")
    if kind < 0.75:
        return Fault(at_s, "command", "restart")
    return Fault(at_s, "command", "stop", float(rng.uniform(1.0, 20.0)))


def _fault(rng: np.random.Generator, at_s: float, part: Part) -> Fault:
    kind = rng.random()
    if kind < 0.4:
        return Fault(at_s, part, "kill")
    if kind < 0.5:
        return Fault(at_s, part, "restart")
    return Fault(at_s, part, "stop", float(rng.uniform(1.0, 6.0)))


def _network_faults(rng: np.random.Generator, main_s: float) -> list[Fault]:
    """Draw two or three of paths, clocks, disk, readers and senders, and a kill of command after them."""
    at_s = main_s / 4.0
    faults = list[Fault]()
    for _ in range(int(rng.integers(2, 4))):
        faults.append(_network_fault(rng, at_s))
        at_s += faults[-1].duration_s + float(rng.uniform(3.0, 8.0))
    if rng.random() < 0.4:
        faults.append(Fault(at_s, "command", "kill"))
    return faults


def _network_fault(rng: np.random.Generator, at_s: float) -> Fault:
    duration_s = float(rng.uniform(1.0, 8.0))
    kind = rng.random()
    if kind < 0.6:
        part = PATHS[int(rng.integers(len(PATHS)))]
        deeds: tuple[Deed, ...] = ("cut", "delay", "lose")
        return Fault(at_s, part, deeds[int(rng.integers(3))], duration_s)
    if kind < 0.7:
        part = "clock of command" if rng.random() < 0.5 else "clock of standby"
        return Fault(at_s, part, "step", step_s=float(rng.choice((-3600.0, -1.0, 0.7, 30.0, 86_400.0))))
    if kind < 0.8:
        return Fault(at_s, "disk of command", "fill", duration_s)
    return (
        Fault(at_s, "readers", "stall", duration_s)
        if kind < 0.9
        else Fault(at_s, "senders", "flood", duration_s)
    )


def _radio_fault(rng: np.random.Generator, at_s: float) -> Fault:
    deeds: tuple[Deed, ...] = ("lose", "repeat", "reorder")
    return Fault(at_s, "radio", deeds[int(rng.integers(3))], float(rng.uniform(2.0, 10.0)))
