"""Flight of `gcs demo`: the service, with simulated vehicles in other processes (`demo_simulation`)."""

from __future__ import annotations

import asyncio
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs
from rich.console import Console

from gcs.cli.fly.demo_simulation import DemoOptions, DemoSimulation
from gcs.cli.link_table import link_rows
from gcs.cli.run_setup import display, open_recorder, warm_up
from gcs.cli.service_console import service_page
from gcs.cli.warm_up_progress import flying
from gcs.config import Config, parse, read_text
from gcs.core.airspace.obstacle_map import mission_grid
from gcs.core.replanning.mission_inputs import terrain_of
from gcs.endpoints import Link, parse_endpoint
from gcs.io.background_writer import QueuedText, off_loop
from gcs.io.event_loop import on_loop
from gcs.io.private_files import new_folder
from gcs.io.record_json import decode
from gcs.io.recording.folder import FIRMWARE_NAME, Run
from gcs.io.recording.reader import read
from gcs.io.recording.recorder_thread import RecorderThread
from gcs.io.zenoh.discovery import announced
from gcs.io.zenoh.key_expressions import truth_key
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


def run_demo(simulation: DemoSimulation, console: Console) -> int:
    """Fly, show, record and evaluate the scenario of a simulation; return the exit code.

    It may have been started already.

    Raises
    ------
    GcsError
        When the run cannot start: a mistake in the file, a port in use, vehicles that do not start.
    """
    options = simulation.options
    text, source = read_text(options.scenario)
    for endpoint in options.forward:
        parse_endpoint(endpoint)
        text += f'\n[[links.forward]]  # by --forward\nendpoint = "{endpoint}"\n'
    config = parse(text, source)
    links = structs.replace(config.links, bridges=[])
    config = structs.replace(config, links=links)  # all of it is on this machine
    with off_loop(console) as view:
        code, summary = _fly_and_summarise(simulation, config, text, source, console, view)
    if options.as_json:
        print(summary_json(summary), flush=True)  # noqa: T201  the last line of --json
    return code


def _fly_and_summarise(
    simulation: DemoSimulation,
    config: Config,
    text: str,
    source: str,
    console: Console,
    view: QueuedText,
) -> tuple[int, Summary]:
    """Fly; return the exit code and the summary."""
    options = simulation.options
    warm_up(console, *flying(config))
    evaluator = evaluator_of(config)
    run = Run(config.name, options.seed)
    name = f"{config.name}-{options.seed}"
    with open_recorder(options.out, name, text, run, config.recording) as recorder:
        folder = recorder.folder
        firmware = new_folder(folder, FIRMWARE_NAME) if options.sitl else None
        health, links, duration_s, interrupted = asyncio.run(
            _fly(config, source, simulation, recorder, firmware, evaluator, console, view)
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
    simulation: DemoSimulation,
    recorder: RecorderThread,
    firmware: Path | None,
    evaluator: Evaluator,
    console: Console,
    view: QueuedText,
) -> tuple[ServiceLoad, tuple[dict[str, Any], ...], float, bool]:
    """Fly; return health, link counters, run time in seconds, and True if interrupted."""
    options = simulation.options
    forward = [link for link in config.mavlink_links if link.role != "vehicles"]
    open_links = [Link(parse_endpoint("udpin:127.0.0.1:0")), *forward]
    stop = asyncio.Event()
    interrupt = asyncio.Event()
    loop = asyncio.get_running_loop()
    bus = simulation.bus
    endpoint = bus.endpoint

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
        simulation.start(links.port, firmware)
        try:
            listens = f"central command listens on UDP port {links.port}, zenoh on {endpoint}"
            console.print(f"{listens}; starting the vehicles", highlight=False)
            async with (
                service_page(service, bus, endpoint, options.page, console, options.speed) as url,
                simulation.flying(links.port, stop, console) as clock,
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
