"""Flight of `gcs demo`: the service, with simulated vehicles in other processes.

Vehicles and the world run in other processes (``python -m sim_vehicles``) and use MAVLink over UDP and zenoh,
as from another machine. They end when their standard input closes.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from collections.abc import AsyncIterator, Collection
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from msgspec import structs
from rich.console import Console

from gcs.cli.console_options import DEFAULT_PAGE, PageOptions
from gcs.cli.link_table import link_rows
from gcs.cli.run_setup import display, open_recorder, warm_up
from gcs.cli.service_console import service_page
from gcs.cli.warm_up_progress import flying
from gcs.config import Config, parse, read_text
from gcs.core.airspace.obstacle_map import mission_grid
from gcs.core.replanning.mission_inputs import terrain_of
from gcs.endpoints import Link, parse_endpoint
from gcs.errors import ConfigError, InterruptedRunError, SimulationError
from gcs.io.background_writer import QueuedText, off_loop
from gcs.io.clock import RunClock
from gcs.io.event_loop import on_loop
from gcs.io.private_files import new_folder
from gcs.io.record_json import decode
from gcs.io.recording.folder import FIRMWARE_NAME, Run
from gcs.io.recording.reader import read
from gcs.io.recording.recorder_thread import RecorderThread
from gcs.io.zenoh.discovery import announced
from gcs.io.zenoh.key_expressions import truth_key
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.mavlink.frames.fast_scan import Scanner
from gcs.model import NS_PER_S, Effect, Event, NoticeCode, Truth
from gcs.report.plots.figures import draw_run
from gcs.report.plots.maps import Ground
from gcs.report.run.evaluation import Evaluator, Summary, evaluator_of, summary_json
from gcs.report.run.summary import print_summary
from gcs.service.bridge_connection import bridges_of
from gcs.service.service import Service
from gcs.service.service_load import ServiceLoad
from gcs.service.signals import fly_on_after_hangup, wait_for_interrupt

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


def run_demo(options: DemoOptions, console: Console) -> int:
    """Fly, show, record and evaluate a scenario; return the exit code.

    Raises
    ------
    GcsError
        When the run cannot start: a mistake in the file, a port in use, vehicles that do not start.
    """
    options.page.check()
    for firmware in options.sitl:
        name, _, path = firmware.partition("=")
        if name not in ("arduplane", "px4") or not path:
            raise ConfigError("--sitl", firmware, "expected arduplane=PATH or px4=PATH")
    text, source = read_text(options.scenario)
    for endpoint in options.forward:
        parse_endpoint(endpoint)
        text += f'\n[[links.forward]]  # by --forward\nendpoint = "{endpoint}"\n'
    config = parse(text, source)
    links = structs.replace(config.links, bridges=[])
    config = structs.replace(config, links=links)  # all of it is on this machine
    with off_loop(console) as view:
        code, summary = _fly_and_summarise(options, config, text, source, console, view)
    if options.as_json:
        print(summary_json(summary), flush=True)  # noqa: T201  the last line of --json
    return code


def _fly_and_summarise(
    options: DemoOptions, config: Config, text: str, source: str, console: Console, view: QueuedText
) -> tuple[int, Summary]:
    """Fly; return the exit code and the summary."""
    warm_up(console, *flying(config))
    evaluator = evaluator_of(config)
    run = Run(config.name, options.seed)
    name = f"{config.name}-{options.seed}"
    with open_recorder(options.out, name, text, run, config.recording) as recorder:
        folder = recorder.folder
        firmware = new_folder(folder, FIRMWARE_NAME) if options.sitl else None
        health, links, duration_s, interrupted = asyncio.run(
            _fly(config, source, options, recorder, firmware, evaluator, console, view)
        )
    summary = evaluator.summary(
        scenario=config.name,
        seed=options.seed,
        duration_s=duration_s,
        scan_ms_p99=p99(health.scan_ms),
        plan_ms_p99=p99(health.plan_ms),
        recording=str(folder),
    )
    summary = replace(summary, links=links)
    return _show(config, options, summary, folder, firmware, console, interrupted=interrupted), summary


def _show(
    config: Config,
    options: DemoOptions,
    summary: Summary,
    folder: Path,
    firmware: Path | None,
    console: Console,
    *,
    interrupted: bool,
) -> int:
    picture = None
    problem = ""
    try:
        with console.status("drawing the picture of the run"):
            picture = _draw_recording(folder, config, options.seed)
        (folder / "summary.json").write_text(summary_json(summary) + "\n", encoding="utf-8")
    except OSError as error:  # The summary is printed even when the disk is full.
        problem = f"picture and summary.json cannot be written to {folder}: {error.strerror}"
    print_summary(summary, console, picture=picture, firmware=firmware)
    if problem:
        console.print(problem, style="yellow", highlight=False, markup=False, soft_wrap=True)
    if interrupted:
        return 130
    return 0 if summary.outcome == "complete" else 1


def p99(values_ms: Collection[float]) -> float:
    """Return the 99th percentile; 0 without values."""
    return float(np.percentile(list(values_ms), 99)) if values_ms else 0.0


class EvaluatorSink:
    """Passes effects to the evaluator."""

    def __init__(self, evaluator: Evaluator) -> None:
        self._evaluator = evaluator

    def event(self, event: Event) -> None:
        """Ignore events: the evaluator does not need them."""

    def effect(self, _t_ns: int, effect: Effect) -> None:
        """Pass an effect on."""
        self._evaluator.add_effect(effect)


def _draw_recording(folder: Path, config: Config, seed: int) -> Path:
    """Draw the picture of a recorded run into its folder; return the file."""
    picture = folder / "run.png"
    ground = Ground.of(mission_grid(config, seed), terrain_of(config))
    draw_run((record.value for record in read(folder)), picture, ground, f"{config.name}, seed {seed}")
    return picture


async def _fly(
    config: Config,
    source: str,
    options: DemoOptions,
    recorder: RecorderThread,
    firmware: Path | None,
    evaluator: Evaluator,
    console: Console,
    view: QueuedText,
) -> tuple[ServiceLoad, tuple[dict[str, Any], ...], float, bool]:
    """Fly; return health, link counters, run time in seconds, and True if interrupted."""
    forward = [link for link in config.mavlink_links if link.role != "vehicles"]
    open_links = [Link(parse_endpoint("udpin:127.0.0.1:0")), *forward]
    stop = asyncio.Event()
    interrupt = asyncio.Event()
    loop = asyncio.get_running_loop()
    endpoint = free_endpoint()

    late = set[int]()

    def add_truth(key: str, payload: bytes) -> None:
        truth = decode(key, payload, Truth)
        evaluator.add_truth(truth)
        service.truth(truth)
        new = sorted(set(truth.late) - late)
        late.update(new)
        if new:
            service.on_notice("simulation", NoticeCode.SIMULATION_SLOW, vehicles=tuple(new))

    with (
        bridges_of(config, source, open_links, Scanner()) as links,
        ZenohSession(listen=endpoint) as bus,
        announced(config.name, endpoint),
    ):
        service = Service(config, options.seed, links, bus)
        service.recorder = recorder
        service.outputs += [view.writer, recorder.writer, links, *links.bridges]
        service.sinks.append(EvaluatorSink(evaluator))
        bus.subscribe(
            truth_key(config.name),
            lambda key, payload: on_loop(loop, add_truth, key, payload),
        )
        undo = wait_for_interrupt(interrupt)
        undo_hangup = fly_on_after_hangup(view)
        relay = asyncio.create_task(_stop_on_interrupt(interrupt, stop))
        try:
            console.print(
                f"central command listens on UDP port {links.port}; starting the vehicles", highlight=False
            )
            async with (
                service_page(service, bus, endpoint, options.page, console, options.speed) as url,
                _simulation(options, links.port, endpoint, firmware, stop, console) as clock,
            ):
                limit_s = options.duration_s or config.mission.max_duration_s
                limit = loop.call_later(limit_s / options.speed, stop.set)
                async with display(
                    service, console, speed=options.speed, headless=options.headless, page_url=url
                ):
                    await service.run(clock, stop, end_with_mission=True)
                limit.cancel()
                duration_s = (clock.now_ns() - clock.start_t_ns) / NS_PER_S
        finally:
            relay.cancel()
            undo()
            undo_hangup()
        rows = tuple(link_rows(service.engine.stages.fleet, links, service.now_ns()))
    return service.health, rows, duration_s, interrupt.is_set()


async def _stop_on_interrupt(interrupt: asyncio.Event, stop: asyncio.Event) -> None:
    await interrupt.wait()
    stop.set()


@asynccontextmanager
async def _simulation(
    options: DemoOptions, port: int, zenoh: str, folder: Path | None, stop: asyncio.Event, console: Console
) -> AsyncIterator[RunClock]:
    """Run the simulated vehicles as a process; yield the clock that they fly by.

    The files of real firmware are written to `folder`.
    """
    firmware = [word for text in options.sitl for word in ("--sitl", text)]
    firmware += ["--sitl-folder", str(folder)] if folder is not None else []
    faults = [word for text in options.faults for word in ("--faults", text)]
    starts_within_s = _START_TIMEOUT_S + (_FIRMWARE_TIMEOUT_S if options.sitl else 0.0)
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-P", "-m", "sim_vehicles", "run", options.scenario,
        "--seed", str(options.seed), "--speed", str(options.speed),
        "--gcs", f"127.0.0.1:{port}", "--zenoh", zenoh, "--zenoh-role", "connect",
        "--loss", str(options.loss), "--pack", str(options.pack), "--json", "--until-stdin-closes",
        "--start-at-once",
        *firmware,
        *faults,
        stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, start_new_session=True,
    )  # fmt: skip
    watcher: asyncio.Task[None] | None = None
    try:
        starting = asyncio.create_task(_until_started(process, console))
        stopping = asyncio.create_task(stop.wait())
        await asyncio.wait({starting, stopping}, timeout=starts_within_s, return_when=asyncio.FIRST_COMPLETED)
        if not starting.done():
            starting.cancel()
            if stop.is_set():
                raise InterruptedRunError("interrupted before the vehicles were started")
            raise SimulationError("the simulated vehicles did not start in time")
        stopping.cancel()
        clock = starting.result()
        watcher = asyncio.create_task(_watch(process, stop))
        yield clock
        if watcher.done():
            raise SimulationError("the simulation ended before the mission: see the messages above")
    finally:
        if watcher is not None:
            watcher.cancel()
        await _end(process)


async def _end(process: asyncio.subprocess.Process) -> None:
    assert process.stdin is not None
    process.stdin.close()
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(process.wait(), _STOP_TIMEOUT_S)
    if process.returncode is None:
        process.kill()
        await process.wait()


async def _events(process: asyncio.subprocess.Process) -> AsyncIterator[dict[str, Any]]:
    assert process.stdout is not None
    async for line in process.stdout:
        with contextlib.suppress(ValueError):
            yield json.loads(line)


async def _until_started(process: asyncio.subprocess.Process, console: Console) -> RunClock:
    async for event in _events(process):
        if event.get("event") == "vehicle":
            console.print(f"vehicle {event['system_id']} is process {event['pid']}", highlight=False)
        if event.get("event") == "started":
            return RunClock(event["epoch_ns"], event["start_t_ns"], event["speed"])
    raise SimulationError("the simulated vehicles could not be started: see the messages above")


async def _watch(process: asyncio.subprocess.Process, stop: asyncio.Event) -> None:
    """Read events so that the pipe never fills; stop the run when the simulation ends."""
    async for _ in _events(process):
        pass
    stop.set()
