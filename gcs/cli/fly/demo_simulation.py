"""Simulated vehicles and world of `gcs demo`: another process, which starts while the service is loaded.

It uses MAVLink over UDP and zenoh, as from another machine, and ends when its standard input closes. This
module imports little, so that the process starts first. Its clock starts when it is told the port of central
command, as a line.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self

from gcs.cli.console_options import DEFAULT_PAGE, PageOptions
from gcs.errors import ConfigError, InterruptedRunError, SimulationError
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.mistake_codes import MistakeCode

if TYPE_CHECKING:
    from rich.console import Console

    from gcs.io.clock import RunClock

_START_TIMEOUT_S: Final = 90.0
_FIRMWARE_TIMEOUT_S: Final = 180.0
"""Added for real firmware, which boots and takes off."""
_STOP_TIMEOUT_S: Final = 6.0


@dataclass(frozen=True, slots=True)
class DemoOptions:
    """The options of `gcs demo`."""

    scenario: str
    seed: int
    speed: float
    duration_s: float | None
    loss: float
    pack: int
    headless: bool
    as_json: bool
    out: Path | None
    forward: tuple[str, ...] = ()
    """Endpoints of other ground stations, in addition to those of the mission file."""
    sitl: tuple[str, ...] = ()
    """Real firmware, each as NAME=PATH."""
    page: PageOptions = DEFAULT_PAGE
    faults: tuple[str, ...] = ()
    """Faults of vehicles, each as KIND:VEHICLE@SECONDS or KIND:VEHICLE@SECONDS+DURATION."""

    def check(self) -> None:
        """Raise `ConfigError` for options that contradict each other, or a firmware of another form."""
        self.page.check()
        for firmware in self.sitl:
            name, _, path = firmware.partition("=")
            if name not in ("arduplane", "px4") or not path:
                raise ConfigError(
                    "--sitl", firmware, MistakeCode.WRONG_TYPE, "expected arduplane=PATH or px4=PATH"
                )


class DemoSimulation:
    """The process of the simulated vehicles and their world.

    Parameters
    ----------
    options : DemoOptions

    Attributes
    ----------
    options : DemoOptions
    bus : ZenohSession
        Session of the service. It listens already, so that the world is connected before the first scan.
    """

    def __init__(self, options: DemoOptions) -> None:
        self.bus = ZenohSession(listen=free_endpoint())
        self.options = options
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()
        self.bus.close()

    def start(self, port: int = 0, folder: Path | None = None) -> None:
        """Start the process, unless it runs already.

        Real firmware needs the UDP port of central command and a folder for its files at the start.
        """
        if self._process is not None:
            return
        options = self.options
        words = [word for text in options.sitl for word in ("--sitl", text)]
        words += ["--sitl-folder", str(folder)] if folder is not None else []
        words += [word for text in options.faults for word in ("--faults", text)]
        self._process = subprocess.Popen(  # noqa: S603  this program
            [
                sys.executable, "-P", "-m", "sim_vehicles", "run", options.scenario,
                "--seed", str(options.seed), "--speed", str(options.speed),
                "--gcs", f"127.0.0.1:{port}", "--zenoh", self.bus.endpoint, "--zenoh-role", "connect",
                "--loss", str(options.loss), "--pack", str(options.pack), "--json", "--until-stdin-closes",
                "--await-ground-station", "--start-at-once", *words,
            ],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True,
        )  # fmt: skip

    @asynccontextmanager
    async def flying(self, port: int, stop: asyncio.Event, console: Console) -> AsyncIterator[RunClock]:
        """Start the clock with central command at a UDP port; yield it, and end the process behind.

        Raises
        ------
        SimulationError
            The vehicles do not start, or end before the mission.
        InterruptedRunError
            `stop` was set before they started.
        """
        process = self._process
        assert process is not None
        assert process.stdin is not None
        assert process.stdout is not None
        with contextlib.suppress(OSError):  # it ended at once
            process.stdin.write(f"127.0.0.1:{port}\n".encode())
            process.stdin.flush()
        lines = asyncio.StreamReader()
        loop = asyncio.get_running_loop()
        await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(lines), process.stdout)
        watcher: asyncio.Task[None] | None = None
        try:
            clock = await self._started(lines, stop, console)
            watcher = asyncio.create_task(_watch(lines, stop))
            yield clock
            if watcher.done():
                raise SimulationError("the simulation ended before the mission: see the messages above")
        finally:
            if watcher is not None:
                watcher.cancel()
            await asyncio.to_thread(self.end)

    async def _started(self, lines: asyncio.StreamReader, stop: asyncio.Event, console: Console) -> RunClock:
        """Return the clock when the vehicles have started."""
        starting = asyncio.create_task(_until_started(lines, console))
        stopping = asyncio.create_task(stop.wait())
        timeout_s = _START_TIMEOUT_S + (_FIRMWARE_TIMEOUT_S if self.options.sitl else 0.0)
        await asyncio.wait({starting, stopping}, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
        stopping.cancel()
        if starting.done():
            return starting.result()
        starting.cancel()
        if stop.is_set():
            raise InterruptedRunError("interrupted before the vehicles were started")
        raise SimulationError("the simulated vehicles did not start in time")

    def end(self) -> None:
        """End the process, if it runs."""
        process = self._process
        if process is None or process.stdin is None or process.stdin.closed:
            return
        with contextlib.suppress(OSError):  # it has ended already
            process.stdin.close()
        try:
            process.wait(_STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


async def _events(lines: asyncio.StreamReader) -> AsyncIterator[dict[str, Any]]:
    async for line in lines:
        with contextlib.suppress(ValueError):
            yield json.loads(line)


async def _until_started(lines: asyncio.StreamReader, console: Console) -> RunClock:
    from gcs.io.clock import RunClock

    async for event in _events(lines):
        if event.get("event") == "vehicle":
            console.print(f"vehicle {event['system_id']} is process {event['pid']}", highlight=False)
        if event.get("event") == "started":
            return RunClock(event["epoch_ns"], event["start_t_ns"], event["speed"])
    raise SimulationError("the simulated vehicles could not be started: see the messages above")


async def _watch(lines: asyncio.StreamReader, stop: asyncio.Event) -> None:
    """Read events so that the pipe never fills; stop the run when the simulation ends."""
    async for _ in _events(lines):
        pass
    stop.set()
