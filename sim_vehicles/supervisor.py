"""Supervisor of the processes of a simulated world: one for each vehicle or pack, one for the world.

Each child prints ``ready``, waits for one JSON line with the common start, and ends when its standard input
closes, also when the supervisor is killed.
"""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from gcs.errors import SimulationError
from gcs.model import NS_PER_S
from sim_vehicles.process_start import (
    Address,
    Firmware,
    FirmwareArguments,
    Start,
    TruthLinkArguments,
    VehicleArguments,
    WorldArguments,
    process_command,
    save_elevation,
)
from sim_vehicles.vehicle.vehicle import VehicleSpec
from sim_vehicles.world.scenario import Scenario
from sim_vehicles.world.vehicle_specs import in_launch_layers, vehicle_specs

_READY_TIMEOUT_S = 60.0
_AIRBORNE_TIMEOUT_S = 180.0
"""Wall time for real firmware."""
_STOP_TIMEOUT_S = 3.0
_HEAD_START_S = 0.3
"""Time for the children to read the clock before time zero."""


@dataclass(slots=True)
class Child:
    """One process and its vehicles; without vehicles, the world."""

    process: subprocess.Popen[str]
    system_ids: tuple[int, ...] = ()
    has_ended: bool = False


@dataclass(frozen=True, slots=True)
class SimulationPlan:
    """Processes to start, and their connections."""

    scenario: Scenario
    seed: int
    speed: float
    gcs: Address
    """Ground station."""
    zenoh: str
    """Endpoint of the world."""
    zenoh_role: Literal["listen", "connect"]
    pack: int = 1
    loss: float = 0.0
    waits_for_ground: bool = False
    """True if targets and losses start when a ground station is heard."""
    sitl: Mapping[Firmware, Path] = field(default_factory=dict)
    """Programs of real firmware by name; empty for simulated autopilots."""
    folder: Path | None = None
    """Folder for the firmware's files; None: a temporary one."""
    truth_links: Sequence[str] = ()
    """MAVLink endpoints of running vehicles. If not empty, no vehicle is started."""
    zenoh_tls: Path | None = None
    """Folder of the world's certificate."""


@dataclass(slots=True)
class Supervisor:
    """The running processes of one simulated world.

    Parameters
    ----------
    report : callable
        Called with one dict for each event: ``started``, ``vehicle``, ``exited``.
    """

    plan: SimulationPlan
    report: Callable[[dict[str, Any]], None]
    children: list[Child] = field(default_factory=list)
    _truth: Address = ("", 0)
    """Receiver of true states."""
    _stack: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)

    def start(self) -> None:
        """Start all processes, and wait until they are ready.

        Raises
        ------
        SimulationError
            When a process does not start; its messages are on standard error.
        """
        plan = self.plan
        scenario = plan.scenario
        waits = plan.waits_for_ground
        tls = "" if plan.zenoh_tls is None else str(plan.zenoh_tls)
        arguments = WorldArguments(scenario.source, plan.seed, plan.zenoh, plan.zenoh_role, waits, tls)
        world = self._spawn("world.world_process", arguments)
        if plan.sitl or plan.truth_links:
            self._await_world(world)  # they send true states before the start
        specs = [replace(spec, waits_for_ground=waits) for spec in vehicle_specs(scenario, plan.seed)]
        ground = self._elevation_file()
        if plan.truth_links:
            for link in plan.truth_links:
                self._spawn("world.truth_link", TruthLinkArguments(link, self._truth))
        elif plan.sitl:
            self._spawn_firmware(in_launch_layers(specs, scenario), ground)
        else:
            for i in range(0, len(specs), plan.pack):
                pack = specs[i : i + plan.pack]
                vehicles = VehicleArguments(scenario.frame, pack, plan.loss, ground)
                self._spawn("vehicle.vehicle_process", vehicles, tuple(spec.system_id for spec in pack))
            self._await_world(world)
        for child in self.children[1:]:
            self._await_ready(child, _AIRBORNE_TIMEOUT_S if plan.sitl else _READY_TIMEOUT_S)
            for system_id in child.system_ids:
                self.report({"event": "vehicle", "system_id": system_id, "pid": child.process.pid})

    def _await_world(self, world: Child) -> None:
        """Wait until the world is ready, and note where it receives true states."""
        self._truth = "127.0.0.1", int(self._await_ready(world).split()[1])

    def _elevation_file(self) -> str:
        """Write the elevation model of the scenario into a file until the end; return its name, or ""."""
        elevation = self.plan.scenario.config.elevation
        if elevation is None:
            return ""
        folder = self._stack.enter_context(tempfile.TemporaryDirectory(prefix="sim-vehicles-"))
        path = Path(folder) / "elevation.npz"
        save_elevation(elevation, path)
        return str(path)

    def _spawn_firmware(self, specs: Sequence[VehicleSpec], ground: str) -> None:
        plan = self.plan
        sitl = plan.sitl
        folder = self._firmware_folder()
        for instance, spec in enumerate(specs):
            name: Firmware = "px4" if spec.autopilot == "px4" else "arduplane"
            if name not in sitl:
                (name,) = sitl
            spec = replace(spec, autopilot="px4" if name == "px4" else "ardupilot")
            vehicle = VehicleArguments(plan.scenario.frame, [spec], plan.loss, ground)
            own_folder = str(folder / f"{name}-{spec.system_id}")
            arguments = FirmwareArguments(
                vehicle, plan.gcs, self._truth, name, str(sitl[name]), instance, plan.speed, own_folder
            )
            self._spawn("autopilots.firmware_process", arguments, (spec.system_id,))

    def _firmware_folder(self) -> Path:
        """Return the folder of the firmware's files; a temporary one stays when a firmware has failed."""
        if self.plan.folder is not None:
            return self.plan.folder.expanduser().resolve()
        folder = tempfile.mkdtemp(prefix="sim-vehicles-")
        self._stack.callback(self._remove_folder, folder)
        return Path(folder)

    def _remove_folder(self, folder: str) -> None:
        if any(child.process.returncode > 0 for child in self.children):
            sys.stderr.write(f"the files and logs of the firmware are kept in {folder}\n")
        else:
            shutil.rmtree(folder, ignore_errors=True)

    def _spawn(self, module: str, arguments: object, system_ids: tuple[int, ...] = ()) -> Child:
        process = subprocess.Popen(  # noqa: S603  our own modules, no shell
            process_command(module, arguments),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        child = Child(process, system_ids)
        self.children.append(child)
        return child

    def _await_ready(self, child: Child, timeout_s: float = _READY_TIMEOUT_S) -> str:
        assert child.process.stdout is not None
        with selectors.DefaultSelector() as selector:
            selector.register(child.process.stdout, selectors.EVENT_READ)
            line = child.process.stdout.readline().strip() if selector.select(timeout_s) else ""
        if not line.startswith("ready"):
            name = "the world" if child is self.children[0] else "the link to the running vehicles"
            if child.system_ids:
                name = f"vehicle {', '.join(map(str, child.system_ids))}"
            self.stop()
            raise SimulationError(f"{name} did not start: see the messages above")
        return line

    def begin(self, gcs: Address | None = None) -> None:
        """Send all processes the common clock; `gcs` is the ground station, by default that of the plan."""
        # Whole milliseconds: true states are stamped in microseconds.
        epoch_ns = (time.time_ns() + int(_HEAD_START_S * NS_PER_S)) // 1_000_000 * 1_000_000
        speed = self.plan.speed
        line = Start(epoch_ns, epoch_ns, speed, gcs or self.plan.gcs, self._truth).line()
        for child in self.children:
            assert child.process.stdin is not None
            child.process.stdin.write(line)
            child.process.stdin.flush()
        self.report({"event": "started", "epoch_ns": epoch_ns, "start_t_ns": epoch_ns, "speed": speed})

    def newly_ended(self) -> Iterator[Child]:
        """Yield the children that ended since the last call."""
        for child in self.children:
            if not child.has_ended and child.process.poll() is not None:
                child.has_ended = True
                self._tell_world(child)
                self.report(
                    {"event": "exited", "system_ids": child.system_ids, "code": child.process.returncode}
                )
                yield child

    def _tell_world(self, ended: Child) -> None:
        """Report lost vehicles to the world: without states they could also be late."""
        world = self.children[0].process
        if ended.system_ids and world.stdin is not None:
            with contextlib.suppress(BrokenPipeError):  # The world has ended, too.
                world.stdin.write(json.dumps(ended.system_ids) + "\n")
                world.stdin.flush()

    def stop(self) -> None:
        """End all children: close their input, wait, kill."""
        for child in self.children:
            if child.process.stdin is not None:
                with contextlib.suppress(BrokenPipeError):  # It has ended already.
                    child.process.stdin.close()
        deadline = time.monotonic() + _STOP_TIMEOUT_S
        for child in self.children:
            try:
                child.process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                os.killpg(child.process.pid, 9)
                child.process.wait()
        self._stack.close()
