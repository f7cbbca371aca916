"""Starts, watches and stops the processes of a simulated world: one a vehicle (or a pack), one for the world.

Every child prints ``ready`` when it can fly, waits for one JSON line with the common clock, and ends when
its standard input closes: when the supervisor dies, however that happens, no process stays behind.
"""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from gcs.errors import SimulationError
from gcs.model import NS_PER_S
from sim_vehicles.vehicle.vehicle import VehicleSpec
from sim_vehicles.world.scenario import Scenario
from sim_vehicles.world.specs import vehicle_specs

_READY_WITHIN_S = 60.0
_AIRBORNE_WITHIN_S = 180.0
"""Of wall time, with real firmware."""
_STOP_WITHIN_S = 3.0
_HEAD_START_S = 0.3
"""Between the start line and time zero, so that every child has read it."""


@dataclass(slots=True)
class Child:
    """One process and the vehicles that it hosts (none: the world)."""

    process: subprocess.Popen[str]
    system_ids: tuple[int, ...] = ()
    ended: bool = False


@dataclass(frozen=True, slots=True)
class Plan:
    """What to start and how they reach each other."""

    scenario: Scenario
    seed: int
    speed: float
    gcs: str
    """host:port that vehicles talk to."""
    zenoh: str
    """Endpoint that the world connects or listens to."""
    zenoh_role: str
    pack: int = 1
    loss: float = 0.0
    waits_for_ground: bool = False
    """True if targets move and deaths count only from when a ground station is there."""
    sitl: Mapping[str, Path] = field(default_factory=dict)
    """Programs of real firmware by name, in place of simulated autopilots (`autopilots.firmware`)."""
    folder: Path | None = None
    """Where firmware keeps its files; None for a temporary one."""
    truth_links: Sequence[str] = ()
    """MAVLink endpoints of vehicles that fly already. When given, no vehicle is started."""


@dataclass(slots=True)
class Supervisor:
    """The running processes of one simulated world.

    Parameters
    ----------
    report : callable
        Takes one dict an event: ``started``, ``vehicle``, ``exited``; for a person or a program to read.
    """

    plan: Plan
    report: Callable[[dict[str, Any]], None]
    children: list[Child] = field(default_factory=list)
    _stack: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)

    def start(self) -> None:
        """Start every process, wait until all are ready, and give them a common clock.

        Raises
        ------
        SimulationError
            When a process does not come up; its own words are on standard error.
        """
        world = self._spawn(["-m", "sim_vehicles.world.process", *self._world_arguments()])
        truth_port = self._await_ready(world).split()[1]
        specs = [
            replace(spec, waits_for_ground=self.plan.waits_for_ground)
            for spec in vehicle_specs(self.plan.scenario, self.plan.seed)
        ]
        if self.plan.truth_links:
            for link in self.plan.truth_links:
                self._spawn(
                    [
                        "-m",
                        "sim_vehicles.world.truth_link",
                        "--link",
                        link,
                        "--truth",
                        f"127.0.0.1:{truth_port}",
                    ]
                )
        elif self.plan.sitl:
            self._spawn_firmware(specs, truth_port)
        else:
            packs = [specs[i : i + self.plan.pack] for i in range(0, len(specs), self.plan.pack)]
            for pack in packs:
                arguments = ["-m", "sim_vehicles.process", *self._vehicle_arguments(truth_port, pack)]
                self._spawn(arguments, tuple(spec.system_id for spec in pack))
        for child in self.children[1:]:
            self._await_ready(child, _AIRBORNE_WITHIN_S if self.plan.sitl else _READY_WITHIN_S)
            for system_id in child.system_ids:
                self.report({"event": "vehicle", "system_id": system_id, "pid": child.process.pid})
        self._give_clock()

    def _vehicle_arguments(self, truth_port: str, specs: Sequence[VehicleSpec]) -> list[str]:
        arguments = ["--gcs", self.plan.gcs, "--truth", f"127.0.0.1:{truth_port}"]
        arguments += ["--frame-json", json.dumps(_frame(self.plan.scenario)), "--loss", str(self.plan.loss)]
        for spec in specs:
            arguments += ["--spec-json", spec.to_json()]
        return arguments

    def _spawn_firmware(self, specs: Sequence[VehicleSpec], truth_port: str) -> None:
        sitl = self.plan.sitl
        folder = self.plan.folder or Path(self._stack.enter_context(tempfile.TemporaryDirectory()))
        for instance, spec in enumerate(specs):
            name = "px4" if spec.autopilot == "px4" else "arduplane"
            if name not in sitl:
                (name,) = sitl
            spec = replace(spec, autopilot="px4" if name == "px4" else "ardupilot")
            arguments = [
                "-m",
                "sim_vehicles.autopilots.firmware_process",
                *self._vehicle_arguments(truth_port, [spec]),
            ]
            arguments += ["--firmware", name, "--binary", str(sitl[name]), "--instance", str(instance)]
            arguments += [
                "--speed",
                str(self.plan.speed),
                "--folder",
                str(folder / f"{name}-{spec.system_id}"),
            ]
            self._spawn(arguments, (spec.system_id,))

    def _world_arguments(self) -> list[str]:
        plan = self.plan
        return [
            "--scenario",
            plan.scenario.source,
            "--seed",
            str(plan.seed),
            "--zenoh",
            plan.zenoh,
            "--zenoh-role",
            plan.zenoh_role,
            *(["--wait-for-ground"] if plan.waits_for_ground else []),
        ]

    def _spawn(self, arguments: list[str], system_ids: tuple[int, ...] = ()) -> Child:
        process = subprocess.Popen(  # noqa: S603  our own modules, no shell
            [sys.executable, "-P", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        child = Child(process, system_ids)
        self.children.append(child)
        return child

    def _await_ready(self, child: Child, within_s: float = _READY_WITHIN_S) -> str:
        assert child.process.stdout is not None
        with selectors.DefaultSelector() as selector:
            selector.register(child.process.stdout, selectors.EVENT_READ)
            line = child.process.stdout.readline().strip() if selector.select(within_s) else ""
        if not line.startswith("ready"):
            who = "the world" if child is self.children[0] else "the link to vehicles that fly already"
            if child.system_ids:
                who = f"vehicle {', '.join(map(str, child.system_ids))}"
            self.stop()
            raise SimulationError(f"{who} did not come up: see the messages above")
        return line

    def _give_clock(self) -> None:
        # Whole milliseconds: true states are stamped in microseconds, and scans fall on the same grid.
        epoch_ns = (time.time_ns() + int(_HEAD_START_S * NS_PER_S)) // 1_000_000 * 1_000_000
        clock = {"epoch_ns": epoch_ns, "start_t_ns": epoch_ns, "speed": self.plan.speed}
        line = json.dumps(clock) + "\n"
        for child in self.children:
            assert child.process.stdin is not None
            child.process.stdin.write(line)
            child.process.stdin.flush()
        self.report({"event": "started", **clock})

    def newly_ended(self) -> Iterator[Child]:
        """Children that ended since the last call."""
        for child in self.children:
            if not child.ended and child.process.poll() is not None:
                child.ended = True
                self.report(
                    {"event": "exited", "system_ids": child.system_ids, "code": child.process.returncode}
                )
                yield child

    def stop(self) -> None:
        """End every child: ask, wait, insist."""
        for child in self.children:
            if child.process.stdin is not None:
                with contextlib.suppress(BrokenPipeError):  # it is gone already
                    child.process.stdin.close()
        deadline = time.monotonic() + _STOP_WITHIN_S
        for child in self.children:
            try:
                child.process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                os.killpg(child.process.pid, 9)
                child.process.wait()
        self._stack.close()


def _frame(scenario: Scenario) -> dict[str, float]:
    frame = scenario.frame
    return {"lat_deg": frame.lat_deg, "lon_deg": frame.lon_deg, "alt_msl_m": frame.alt_msl_m}
