"""Playback of a recording or a log through central command: sources, display and comparison."""

from __future__ import annotations

import asyncio
import itertools
import json
import math
import time
from collections.abc import AsyncIterator, Callable, Iterable, Iterator
from contextlib import asynccontextmanager, nullcontext
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Final, get_args

import typer
from rich.console import Console

from gcs.cli.analyse.run_file import RunFile
from gcs.cli.analyse.whatif import Comparison, comparison_table, different_settings
from gcs.cli.console_options import DEFAULT_PAGE, PageOptions
from gcs.cli.prepare.first_mission_file import mission_name, mission_text
from gcs.cli.prepare.sketch.telemetry import read_vehicles
from gcs.cli.replay_console import replay_page
from gcs.cli.run_setup import display, warm_up
from gcs.cli.warm_up_progress import flying
from gcs.config import Config, load, parse
from gcs.errors import RecordingError
from gcs.io.recording.folder import versions
from gcs.io.recording.index import read_end_t_ns, snapshot_places
from gcs.io.recording.reader import Record, RecordingInfo, read, read_info
from gcs.model import NS_PER_S, Effect, Event, Snapshot, named
from gcs.report.run.verification import Verification
from gcs.service.replay import Replay, Verifier, Window
from gcs.service.signals import wait_for_interrupt

_SCANNED_NS: Final = 2 * NS_PER_S
"""A replay begins this long before the time to show, so that scans bring tracks."""


@dataclass(frozen=True, slots=True)
class ReplayOptions:
    """The options of `gcs replay`."""

    file: RunFile
    speed: float | None
    """Multiple of real time; None: 1 in a live view, infinite elsewhere."""
    window: Window
    verify: bool
    headless: bool
    as_json: bool
    page: PageOptions = DEFAULT_PAGE


@dataclass(frozen=True, slots=True)
class _Source:
    """Records to replay, with their configuration."""

    header: RecordingInfo | None
    """None for a telemetry log."""
    config: Config
    seed: int
    records: Iterable[Record]
    start_t_ns: int | None = None
    """Start of the run; None: the first record."""
    records_from: Callable[[int], Iterable[Record]] | None = None
    """Records from the last snapshot up to a time on; None if they cannot be read again."""

    def replay(self, window: Window) -> Replay:
        """Return a replay of the records."""
        return Replay(self.config, self.seed, self.records, window, self.start_t_ns, self.records_from)


def parse_speed(text: str | None) -> float | None:
    """Return ``--speed``: a positive number, or ``max``.

    Raises
    ------
    typer.BadParameter
        When the text is neither.
    """
    if text is None:
        return None
    if text == "max":
        return math.inf
    try:
        speed = float(text)
    except ValueError:
        speed = 0.0
    if not 0.0 < speed < math.inf:
        raise typer.BadParameter(f"{text!r} is neither a positive number nor `max`", param_hint="--speed")
    return speed


def run_replay(options: ReplayOptions, console: Console) -> int:
    """Replay, show and compare; return the exit code: 1 when the verification finds a difference.

    Raises
    ------
    RecordingError, ConfigError
        When the recording has no events, or its mission or seed is missing.
    """
    options.page.check()
    source = open_source(options, console)
    warm_up(console, *flying(source.config))
    replay = source.replay(options.window)
    verifier = Verifier()
    comparison = Comparison()
    if options.verify:
        replay.watchers.append(verifier)
    compares = options.file.config is not None and source.header is not None
    if compares:
        replay.watchers.append(comparison)
        replay.on_restart.append(comparison.restart)
    started = time.perf_counter()
    interrupted = asyncio.run(_play(replay, options, console))
    wall_s = time.perf_counter() - started
    if replay.events == 0 and not interrupted:
        why = "" if replay.damage is None else f": {replay.damage.problem}"
        raise RecordingError(str(options.file.path), f"has no events to replay{why}")
    summary = _summary(replay, options.file.path, wall_s)
    _print_summary(replay, summary, console)
    if not interrupted and replay.duration_s < options.window.from_s:
        console.print(
            f"nothing to show: it ends at {replay.duration_s:.1f} s, before --from {options.window.from_s:g}",
            style="yellow",
            highlight=False,
        )
    if options.verify:
        summary |= _print_verification(verifier.result, replay, source.header, console)
    if compares:
        summary |= _print_comparison(comparison, replay, source, console)
    if options.as_json:
        print(json.dumps(summary), flush=True)  # noqa: T201  the output of --json
    if interrupted:
        return 130
    return 1 if verifier.result.first is not None else 0


def open_source(options: ReplayOptions, console: Console) -> _Source:
    """Return what a file has to replay.

    Raises
    ------
    RecordingError, ConfigError
        When it cannot be read, or its mission or seed is missing.
    """
    file = options.file
    path = file.path
    if not file.is_recording():
        return _open_log(options, console)
    header = read_info(path)
    if file.config is not None:
        config = load(file.config)
    elif header.config_text:
        config = parse(header.config_text, f"{path}: its mission file")
    else:
        raise RecordingError(str(path), "its mission file cannot be read; name one with --config")
    needs_effects = options.verify or file.config is not None
    only = get_args(Event) + get_args(Effect) if needs_effects else get_args(Event)
    is_unchanged = file.config is None and file.seed is None
    records = read(path, only=(*only, Snapshot) if is_unchanged else only)
    first = list(itertools.islice(records, 1))
    number = next(read(path)).sequence if first and options.verify else 0
    if number > 0:
        raise RecordingError(
            str(path),
            f"begins in the middle of a run, with record {number}; to verify it, name its folder",
        )
    seed = _seed(file, header, config)
    if not first:
        return _Source(header, config, seed, ())
    start_t_ns = first[0].t_ns
    if not is_unchanged:
        records = itertools.chain(first, records)
        return _Source(header, config, seed, records, start_t_ns, lambda _: read(path, only=only))
    places = cache(partial(snapshot_places, path))
    end_t_ns = cache(partial(read_end_t_ns, path))

    def records_from(t_ns: int) -> Iterator[Record]:
        scanned_t_ns = min(t_ns, end_t_ns() or t_ns) - _SCANNED_NS
        before = [place for place in places() if place.t_ns < scanned_t_ns]
        if before:
            return read(path, only=only, start=before[-1])
        return read(path, only=(*only, Snapshot))  # the first one is the state of a resumed run

    if options.window.from_s > 0.0 or isinstance(first[0].value, Snapshot):
        records = records_from(start_t_ns + round(options.window.from_s * NS_PER_S))
    else:
        records = itertools.chain(first, records)
    return _Source(header, config, seed, records, start_t_ns, records_from)


def _open_log(options: ReplayOptions, console: Console) -> _Source:
    file = options.file
    path = file.path
    if options.verify:
        raise RecordingError(str(path), "is not a recording of gcs: it has no outputs to verify")
    config = _derived_mission(path, console) if file.config is None else load(file.config)
    added = file.load_detections()
    for remark in () if added is None else added.detections.remarks:
        console.print(remark, style="yellow", highlight=False, markup=False, soft_wrap=True)
    return _Source(None, config, file.seed or 0, file.log_records(config, added))


def _derived_mission(path: Path, console: Console) -> Config:
    """Return a mission with the vehicles of a log, its positions and speed, and no targets."""
    config = parse(mission_text(read_vehicles(path), mission_name(path.stem), path.name), str(path))
    frame = config.local_frame
    area = config.map
    console.print(
        f"mission from the log: {named(agent.vehicle for agent in config.agents)}, no targets, "
        f"{config.airframe.speed_m_s:g} m/s, map {area.width_m / 1e3:.1f} km x {area.height_m / 1e3:.1f} km "
        f"from {frame.lat_deg:.5f}, {frame.lon_deg:.5f} degrees; `gcs init {path}` writes it to a file, and "
        "--config uses another",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )
    return config


def _seed(file: RunFile, header: RecordingInfo, config: Config) -> int:
    if file.seed is not None:
        return file.seed
    if header.run is not None:
        return header.run.seed
    if config.map.random_threshold > 0.0:
        raise RecordingError(
            str(file.path),
            "does not say with which seed it was made, and its obstacles are random; give --seed",
        )
    return 0


async def _play(replay: Replay, options: ReplayOptions, console: Console) -> bool:
    """Play the records; return True if interrupted."""
    stop = asyncio.Event()
    undo = wait_for_interrupt(stop)
    plain = options.headless or options.verify or not console.is_terminal
    speed = options.speed
    if speed is None:
        speed = math.inf if plain and not options.page.is_asked_for else 1.0
    try:
        async with _display(replay, options, console, speed):
            await replay.run(stop, speed)
    finally:
        undo()
    return stop.is_set()


@asynccontextmanager
async def _display(
    replay: Replay, options: ReplayOptions, console: Console, speed: float
) -> AsyncIterator[None]:
    if options.verify:
        with console.status("recomputing every picture, plan and send"):
            yield
        return
    has_page = options.page.is_asked_for or not options.headless
    if has_page:
        replay.playback.duration_s = duration_s(options, replay.start_t_ns)
        replay.playback.stays_at_end = options.page.is_asked_for
    page = replay_page(replay, options.page, console, options.file) if has_page else nullcontext("")
    with page as url:
        async with display(
            replay,
            console,
            speed=speed,
            headless=options.headless,
            page_url=url,
            start_t_ns=replay.start_t_ns,
        ):
            yield


def duration_s(options: ReplayOptions, start_t_ns: int | None) -> float | None:
    """Return the length of a recording in seconds; None for a telemetry log."""
    end_t_ns = read_end_t_ns(options.file.path) if options.file.is_recording() else None
    return None if start_t_ns is None or end_t_ns is None else (end_t_ns - start_t_ns) / NS_PER_S


def _summary(replay: Replay, path: Path, wall_s: float) -> dict[str, Any]:
    return {
        "recording": str(path),
        "seconds": replay.duration_s,
        "events": replay.events,
        "effects": replay.effects,
        "wall_s": wall_s,
        "times_real_time": (replay.t_ns - replay.begin_t_ns) / NS_PER_S / max(wall_s, 1e-9),
        "damage": None if replay.damage is None else asdict(replay.damage),
    }


def _print_summary(replay: Replay, summary: dict[str, Any], console: Console) -> None:
    console.print(
        f"replayed up to {replay.duration_s:.1f} s of run time in {summary['wall_s']:.1f} s "
        f"({summary['times_real_time']:.0f} times real time): "
        f"{replay.events} events in, {replay.effects} effects out",
        highlight=False,
    )
    if replay.damage is not None:
        console.print(
            f"the recording ends early: {replay.damage.problem}",
            style="yellow",
            highlight=False,
            soft_wrap=True,
        )


def _print_verification(
    result: Verification, replay: Replay, header: RecordingInfo | None, console: Console
) -> dict[str, Any]:
    equal = sum(result.equal.values())
    summary: dict[str, Any] = {
        "verified": result.first is None,
        "equal": dict(sorted(result.equal.items())),
        "different": result.different,
        "first_difference": None if result.first is None else asdict(result.first),
    }
    if equal == 0 and result.first is None:
        console.print("the recording has no outputs to compare", style="yellow", highlight=False)
        return summary
    if result.first is None:
        counts = ", ".join(f"{count} {topic}" for topic, count in sorted(result.equal.items()))
        console.print(
            f"all {equal} effects are equal, byte for byte: {counts}", style="green", highlight=False
        )
        return summary
    first = result.first
    seconds = (first.t_ns - (replay.start_t_ns or first.t_ns)) / 1e9
    console.print(
        f"{result.different} of {equal + result.different} effects differ; the first is "
        f"record {first.number} at {seconds:.3f} s, {first.topic}",
        style="bold red", highlight=False, soft_wrap=True,
    )  # fmt: skip
    console.print(f"  recorded: {first.recorded}", highlight=False, markup=False, soft_wrap=True)
    console.print(f"  replayed: {first.replayed}", highlight=False, markup=False, soft_wrap=True)
    for library, recorded, present in _different_versions(header):
        console.print(
            f"  {library} was {recorded} in the recording and is {present} here", style="dim", highlight=False
        )
    return summary


def _different_versions(header: RecordingInfo | None) -> list[tuple[str, str, str]]:
    recorded = {} if header is None else header.versions
    present = versions()
    return [
        (name, version, present.get(name, "missing"))
        for name, version in recorded.items()
        if version != present.get(name)
    ]


def _print_comparison(
    comparison: Comparison, replay: Replay, source: _Source, console: Console
) -> dict[str, Any]:
    header = source.header
    assert header is not None
    changed = (
        different_settings(parse(header.config_text, "recorded"), source.config) if header.config_text else []
    )
    rows = comparison.rows(replay.start_t_ns or 0)
    if changed:
        console.print(comparison_table("Settings that differ", changed))
    console.print(comparison_table("Results", rows))
    if any(row.differs for row in rows):
        console.print("the recorded vehicles do not react to the plans made here", style="dim")
    else:
        console.print("the results are the same", style="green")
    return {
        "settings": [asdict(row) for row in changed],
        "outcome": [asdict(row) | {"differs": row.differs} for row in rows],
    }
