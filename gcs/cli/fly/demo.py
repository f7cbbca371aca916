"""`gcs demo`: a simulated swarm as processes of their own, and central command among them.

The service runs in this process; vehicles and the world run in others, started through ``sim_vehicles`` as
a program, and speak to it by MAVLink over UDP and by zenoh, as they would from another machine. They end
when their standard input closes, however this process ends.
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
from typing import Any

import numpy as np
from rich.console import Console

from gcs.cli.link_table import link_rows
from gcs.cli.outputs import EvaluatorSink, draw_recording, open_recorder, view_for, warm_up
from gcs.config import Config, parse, read_text
from gcs.endpoints import Link, parse_endpoint
from gcs.errors import InterruptedRunError, SimulationError
from gcs.io.clock import RunClock
from gcs.io.links.manager import Links
from gcs.io.output import QueuedText, off_loop
from gcs.io.recording.folder import Run
from gcs.io.recording.writer_thread import RecorderThread
from gcs.io.signing.gate import Signing
from gcs.io.zenoh.discovery import announced
from gcs.io.zenoh.messages import decode_truth, truth_key
from gcs.io.zenoh.session import ZenohSession, free_endpoint
from gcs.model import NS_PER_S
from gcs.report.run.evaluation import Evaluator, Summary, judge_of, summary_json
from gcs.report.run.summary import print_summary
from gcs.service.service import Health, Service, fly_on_after_hangup, on_loop, wait_for_interrupt

_STARTS_WITHIN_S = 90.0
_LAUNCH_WITHIN_S = 180.0
"""More, for real firmware: it boots and takes off."""
_STOPS_WITHIN_S = 6.0


@dataclass(frozen=True, slots=True)
class DemoOptions:
    """What the command line says."""

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
    """Where other ground stations may look on, besides those of the mission file."""
    sitl: tuple[str, ...] = ()
    """Real firmware to fly, each as NAME=PATH."""


def run_demo(options: DemoOptions, console: Console) -> int:
    """Fly a scenario, show it, record it and judge it; return the exit code.

    Raises
    ------
    GcsError
        When it cannot be flown: a mistake in the file, a port that is taken, vehicles that do not start.
    """
    text, source = read_text(options.scenario)
    for endpoint in options.forward:
        parse_endpoint(endpoint)
        text += f'\n[[links.forward]]  # by --forward\nendpoint = "{endpoint}"\n'
    config = parse(text, source)
    with off_loop(console) as view:
        code, summary = _flown(options, config, text, source, console, view)
    if options.as_json:
        print(summary_json(summary), flush=True)  # noqa: T201  the promised last line
    return code


def _flown(
    options: DemoOptions, config: Config, text: str, source: str, console: Console, view: QueuedText
) -> tuple[int, Summary]:
    """Fly it; return the exit code and the summary."""
    warm_up(console)
    judge = judge_of(config)
    run = Run(config.name, options.seed)
    name, table = f"{config.name}-{options.seed}", config.recording
    with open_recorder(options.out, name, text, run, table) as recorder:
        health, links, duration_s, interrupted = asyncio.run(
            _fly(config, config.links.key_file(source), options, recorder, judge, console, view)
        )
        folder = recorder.folder
    summary = judge.summary(
        scenario=config.name,
        seed=options.seed,
        duration_s=duration_s,
        scan_ms_p99=percentile(health.scan_ms),
        plan_ms_p99=percentile(health.plan_ms),
        recording=str(folder),
    )
    summary = replace(summary, links=links)
    return _show(config, options, summary, folder, console, interrupted=interrupted), summary


def _show(
    config: Config,
    options: DemoOptions,
    summary: Summary,
    folder: Path,
    console: Console,
    *,
    interrupted: bool,
) -> int:
    picture, problem = None, ""
    try:
        with console.status("drawing the picture of the run"):
            picture = draw_recording(folder, config, options.seed)
        (folder / "summary.json").write_text(summary_json(summary) + "\n", encoding="utf-8")
    except OSError as error:  # a full disk takes nobody the summary
        problem = f"picture and summary.json cannot be written to {folder}: {error.strerror}"
    print_summary(summary, console, picture=picture)
    if problem:
        console.print(problem, style="yellow", highlight=False, markup=False, soft_wrap=True)
    if interrupted:
        return 130
    return 0 if summary.outcome == "complete" else 1


def percentile(values_ms: Collection[float]) -> float:
    """99th percentile, NaN-free: 0 when nothing was measured."""
    return float(np.percentile(list(values_ms), 99)) if values_ms else 0.0


async def _fly(
    config: Config,
    keys: Path | None,
    options: DemoOptions,
    recorder: RecorderThread,
    judge: Evaluator,
    console: Console,
    view: QueuedText,
) -> tuple[Health, tuple[dict[str, Any], ...], float, bool]:
    """Fly from start to end; return health, links, run time in seconds, and whether it was interrupted."""
    guests = [link for link in config.mavlink_links if link.role != "vehicles"]
    here = [Link(parse_endpoint("udpin:127.0.0.1:0")), *guests]
    vehicles = [agent.vehicle for agent in config.agents]
    links = Links(here, vehicles, config.local_frame, Signing(here, keys, kernel=True))
    stop, interrupt = asyncio.Event(), asyncio.Event()
    loop = asyncio.get_running_loop()
    endpoint = free_endpoint()

    def take_truth(key: str, payload: bytes) -> None:
        truth = decode_truth(key, payload)
        judge.truth(truth)
        service.truth(truth)

    with ZenohSession(listen=endpoint) as bus, announced(config.name, endpoint):
        service = Service(config, options.seed, links, bus)
        service.recorder = recorder
        service.outputs += [view.writer, recorder.writer]
        service.sinks.append(EvaluatorSink(judge))
        bus.subscribe(
            truth_key(config.name),
            lambda key, payload: on_loop(loop, take_truth, key, payload),
        )
        undo, undo_hangup = wait_for_interrupt(interrupt), fly_on_after_hangup(view)
        relay = asyncio.create_task(_relay(interrupt, stop))
        try:
            console.print(
                f"central command listens on UDP port {links.port}; starting the vehicles", highlight=False
            )
            async with _simulation(options, links.port, endpoint, stop, console) as clock:
                limit_s = options.duration_s or config.mission.max_duration_s
                limit = loop.call_later(limit_s / options.speed, stop.set)
                async with view_for(service, console, speed=options.speed, headless=options.headless):
                    await service.run(clock, stop, end_with_mission=True)
                limit.cancel()
                duration_s = (clock.now_ns() - clock.start_t_ns) / NS_PER_S
        finally:
            relay.cancel()
            undo()
            undo_hangup()
    rows = tuple(link_rows(service.command.fleet, links, service.now_ns()))
    return service.health, rows, duration_s, interrupt.is_set()


async def _relay(interrupt: asyncio.Event, stop: asyncio.Event) -> None:
    await interrupt.wait()
    stop.set()


@asynccontextmanager
async def _simulation(
    options: DemoOptions, port: int, zenoh: str, stop: asyncio.Event, console: Console
) -> AsyncIterator[RunClock]:
    """The simulated side as a process; yields the clock that it flies by, and ends it on the way out."""
    firmware = [word for text in options.sitl for word in ("--sitl", text)]
    starts_within_s = _STARTS_WITHIN_S + (_LAUNCH_WITHIN_S if options.sitl else 0.0)
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-P", "-m", "sim_vehicles", "run", options.scenario,
        "--seed", str(options.seed), "--speed", str(options.speed),
        "--gcs", f"127.0.0.1:{port}", "--zenoh", zenoh, "--zenoh-role", "connect",
        "--loss", str(options.loss), "--pack", str(options.pack), "--json", "--until-stdin-closes",
        "--start-at-once",
        *firmware,
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
            raise SimulationError("the simulated side ended before the mission did: see the messages above")
    finally:
        if watcher is not None:
            watcher.cancel()
        await _end(process)


async def _end(process: asyncio.subprocess.Process) -> None:
    assert process.stdin is not None
    process.stdin.close()
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(process.wait(), _STOPS_WITHIN_S)
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
    """Read on, so that the pipe never fills; when the simulated side ends by itself, the run is over."""
    async for _ in _events(process):
        pass
    stop.set()
