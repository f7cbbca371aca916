"""What surrounds the processes of a run of chaos and can fail: paths, radio, clocks, disk, other programs."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import psutil

from helpers.chaos_schedule import Deed, Fault, Part
from helpers.heartbeat_tap import HeartbeatTap
from helpers.slow_network import Path as NetworkPath
from helpers.slow_network import SlowNetwork

PROGRAM: Final = (sys.executable, "-P", "-c", "from helpers.rewired import main; main()")
"""`gcs` with the paths and the clock of a node."""
_HELPERS: Final = str(Path(__file__).resolve().parents[1])
_DELAY_S: Final = 2.0
_LOSS: Final = 0.3
_DISK_LEFT: Final = 30_000
"""Bytes that the largest file of a node may still grow."""
_READER: Final = """
import sys
from gcs.io.zenoh.session import ZenohSession
bus = ZenohSession(connect=sys.argv[1])
bus.subscribe("swarm/**", lambda *_: None)
print("reads", flush=True)
sys.stdin.read()
"""
_SENDER: Final = """
import itertools, sys, time
from gcs.io.zenoh.session import ZenohSession
bus = ZenohSession(connect=sys.argv[1])
payloads = (b"", b"{}", b'{"t_ns": 1, "z": [[1, 2]]}', b"x" * 5000, bytes(range(256)))
for number in itertools.count():
    for what in ("sensor/rogue/scan", "order", "status_request", "console/feed", "bridge/main/down"):
        bus.publish(f"swarm/deterministic/{what}", payloads[number % 5])
    time.sleep(0.002)
"""


class Surroundings:
    """Of a command `one`, its standby `two`, and a bridge.

    Parameters
    ----------
    folder : Path
        For the clocks.
    zenoh, standby, bridge : str
        Endpoints at which command, its standby and the bridge listen.
    tap : HeartbeatTap
        The radio.
    """

    def __init__(
        self, folder: Path, zenoh: str, standby: str, bridge: str, tap: HeartbeatTap, seed: int
    ) -> None:
        self._folder = folder
        self._endpoints = f"{zenoh},{standby}"
        self._tap = tap
        self._network = SlowNetwork(seed)
        self._bridge = bridge
        self._zenoh = zenoh
        self._to_bridge = {name: self._network.path_to(bridge) for name in ("one", "two") if bridge}
        self._to_command = self._network.path_to(zenoh)
        self._programs: list[subprocess.Popen[bytes]] = []

    def environment(self, name: str) -> dict[str, str]:
        """Return the variables of a node."""
        paths = {self._zenoh: self._to_command.endpoint} if name == "two" else {}
        if name in self._to_bridge:
            paths[self._bridge] = self._to_bridge[name].endpoint
        clock = self._clock(name)
        clock.touch()
        python_path = f"{_HELPERS}:{Path(_HELPERS).parent}"
        return {"REWIRED_PATHS": json.dumps(paths), "REWIRED_CLOCK": str(clock), "PYTHONPATH": python_path}

    def _clock(self, name: str) -> Path:
        return self._folder / f"clock-{name}"

    # ------------------------------------------------------------ faults

    def step_clock(self, name: str, step_s: float) -> None:
        """Set the wall clock of a node."""
        new = self._folder / "clock.new"
        new.write_text(str(int(step_s * 1e9)))
        new.replace(self._clock(name))

    def _paths(self, part: Part, command: str) -> list[NetworkPath]:
        to_bridge = list(self._to_bridge.items())
        chosen = {
            "command to bridge": [path for name, path in to_bridge if name == command],
            "command to all": [*(path for name, path in to_bridge if name == command), self._to_command],
            "standby to all": [*(path for name, path in to_bridge if name != command), self._to_command],
        }
        return chosen.get(part, [*self._to_bridge.values(), self._to_command])

    def harm_paths(self, part: Part, deed: Deed, command: str) -> list[NetworkPath]:
        """Cut or slow the paths of a part; return them."""
        paths = self._paths(part, command)
        for path in paths:
            path.is_cut = deed == "cut"
            path.delay_s = _DELAY_S if deed == "delay" else 0.0
            path.loss = _LOSS if deed == "lose" else 0.0
        return paths

    def harm_radio(self, fault: Fault) -> None:
        """Lose, repeat or reorder datagrams for some time; return at once."""
        radio = self._tap.radio
        radio.loss = _LOSS if fault.deed == "lose" else 0.0
        radio.twice = _LOSS if fault.deed == "repeat" else 0.0
        radio.late = _LOSS if fault.deed == "reorder" else 0.0
        threading.Timer(fault.duration_s, self.heal_radio).start()

    def heal_radio(self) -> None:
        """Let the radio lose nothing."""
        radio = self._tap.radio
        radio.loss = radio.twice = radio.late = 0.0

    @contextlib.contextmanager
    def stalled_reader(self) -> Iterator[None]:
        """Let a program subscribe to everything and read nothing."""
        reader = self._start(_READER)
        assert reader.stdout is not None
        reader.stdout.readline()
        reader.send_signal(signal.SIGSTOP)
        yield
        self._end(reader)

    @contextlib.contextmanager
    def flood(self) -> Iterator[None]:
        """Let a program publish malformed messages on all keys that command reads."""
        sender = self._start(_SENDER)
        yield
        self._end(sender)

    def _start(self, program: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-c", program, self._endpoints]
        started = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._programs.append(started)
        return started

    def _end(self, program: subprocess.Popen[bytes]) -> None:
        program.kill()
        program.wait()

    def close(self) -> None:
        """End all."""
        for program in self._programs:
            self._end(program)
        self._network.close()


@contextlib.contextmanager
def full_disk(node: psutil.Process, folder: Path) -> Iterator[None]:
    """Let no file of a process grow beyond about the size of its largest one."""
    sizes = [file.stat().st_size for file in folder.glob("*")]
    before = node.rlimit(psutil.RLIMIT_FSIZE)
    with contextlib.suppress(psutil.NoSuchProcess):
        node.rlimit(psutil.RLIMIT_FSIZE, (max(sizes, default=0) + _DISK_LEFT, before[1]))
    try:
        yield
    finally:
        with contextlib.suppress(psutil.NoSuchProcess):
            node.rlimit(psutil.RLIMIT_FSIZE, before)


@contextlib.contextmanager
def stopped(pid: int, duration_s: float) -> Iterator[None]:
    """Stop a process for some time."""
    process = psutil.Process(pid)
    begin_s = time.monotonic()
    process.suspend()
    try:
        yield
        time.sleep(max(0.0, begin_s + duration_s - time.monotonic()))
    finally:
        with contextlib.suppress(psutil.NoSuchProcess):
            process.resume()
