"""`gcs replay`: a recorded run once more, exactly or with other settings."""

from __future__ import annotations

import asyncio
import itertools
import json
import math
import time
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, get_args

import typer
from rich.console import Console

from gcs.cli.analyse.whatif import Comparison, settings, table
from gcs.cli.outputs import view_for, warm_up
from gcs.cli.warm_up_progress import LINKS, PLANNING, TRACKING
from gcs.config import Config, load, parse
from gcs.errors import RecordingError
from gcs.files import open_regular
from gcs.io.recording.folder import versions
from gcs.io.recording.reader import Record, RecordingInfo, is_recording, read, read_info
from gcs.io.recording.tlog import is_stamped
from gcs.model import Effect, Event
from gcs.report.run.verification import Verification
from gcs.service.foreign_logs import Beside, load_beside, refuse_detections, telemetry_records
from gcs.service.replay import Replay, Verifier, Window
from gcs.service.service import wait_for_interrupt


@dataclass(frozen=True, slots=True)
class ReplayOptions:
    """What the command line says."""

    path: Path
    speed: float | None
    """Infinite as fast as can be; None: 1 in a live view, as fast as can be elsewhere."""
    window: Window
    verify: bool
    config: str | None
    seed: int | None
    headless: bool
    as_json: bool
    detections: Path | None = None
    """To lay beside a log."""
    model: Path | None = None
    """Of the detections, where their file has none."""
    offset_s: float = 0.0


@dataclass(frozen=True, slots=True)
class _Plan:
    """What to replay, and with what."""

    made_with: RecordingInfo | None
    """None for a telemetry log."""
    config: Config
    seed: int
    records: Iterable[Record]


def speed_of(text: str | None) -> float | None:
    """Read ``--speed``: a positive number, or ``max``.

    Raises
    ------
    typer.BadParameter
        When it is neither.
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
    """Replay, show and judge; return the exit code: 1 when a verification finds a difference.

    Raises
    ------
    RecordingError, ConfigError
        When there is nothing to replay, or not enough to replay it with.
    """
    plan = _prepared(options, console)
    warm_up(console, TRACKING, PLANNING, LINKS)
    replay = Replay(plan.config, plan.seed, plan.records, options.window)
    verifier, comparison = Verifier(), Comparison()
    if options.verify:
        replay.watchers.append(verifier)
    if options.config is not None and plan.made_with is not None:
        replay.watchers.append(comparison)
    started = time.perf_counter()
    interrupted = asyncio.run(_play(replay, options, console))
    wall_s = time.perf_counter() - started
    if replay.events == 0 and not interrupted:
        why = "" if replay.damage is None else f": {replay.damage.problem}"
        raise RecordingError(str(options.path), f"holds no events to replay{why}")
    summary = _summary(replay, options.path, wall_s)
    _say(replay, summary, console)
    if options.verify:
        summary |= _verified(verifier.result, replay, plan.made_with, console)
    if options.config is not None and plan.made_with is not None:
        summary |= _compared(comparison, replay, plan, console)
    if options.as_json:
        print(json.dumps(summary), flush=True)  # noqa: T201  the promised last line
    if interrupted:
        return 130
    return 1 if verifier.result.first is not None else 0


def _prepared(options: ReplayOptions, console: Console) -> _Plan:
    path = options.path
    if not is_recording(path):
        refuse_detections(path)
        if options.config is None:
            with open_regular(path) as file:
                is_stamped(file, str(path))
            raise RecordingError(
                str(path), "is a telemetry log: name the mission of its vehicles with --config"
            )
        if options.verify:
            raise RecordingError(str(path), "is no recording of ours: there is nothing to verify it against")
        config = load(options.config)
        records = telemetry_records(
            path, [agent.vehicle for agent in config.agents], _beside(options, console)
        )
        return _Plan(None, config, options.seed or 0, records)
    if options.detections is not None:
        raise RecordingError(str(path), "is a recording with scans of its own; --detections goes with a log")
    made_with = read_info(path)
    if options.config is not None:
        config = load(options.config)
    elif made_with.config_text:
        config = parse(made_with.config_text, f"{path}: its mission file")
    else:
        raise RecordingError(str(path), "its mission file cannot be read; name one with --config")
    is_held_against = options.verify or options.config is not None
    records = read(path, only=get_args(Event) + get_args(Effect) if is_held_against else get_args(Event))
    first = list(itertools.islice(records, 1))
    if options.verify and first and first[0].sequence > 0:
        raise RecordingError(
            str(path),
            f"begins in the middle of a run, with record {first[0].sequence}; to verify it, name its folder",
        )
    seed = _seed(options, made_with, config)
    return _Plan(made_with, config, seed, itertools.chain(first, records))


def _beside(options: ReplayOptions, console: Console) -> Beside | None:
    if options.detections is None:
        return None
    beside = load_beside(options.detections, options.model, options.offset_s)
    for remark in beside.detections.remarks:
        console.print(remark, style="yellow", highlight=False, markup=False, soft_wrap=True)
    return beside


def _seed(options: ReplayOptions, made_with: RecordingInfo, config: Config) -> int:
    if options.seed is not None:
        return options.seed
    if made_with.run is not None:
        return made_with.run.seed
    if config.map.random_threshold > 0.0:
        raise RecordingError(
            str(options.path),
            "does not say with which seed it was made, and its obstacles are random; give --seed",
        )
    return 0


async def _play(replay: Replay, options: ReplayOptions, console: Console) -> bool:
    """Play it with what the user wants to see; return whether it was interrupted."""
    stop = asyncio.Event()
    undo = wait_for_interrupt(stop)
    plain = options.headless or options.verify or not console.is_terminal
    speed = options.speed if options.speed is not None else math.inf if plain else 1.0
    try:
        async with _shown(replay, options, console, speed):
            await replay.run(stop, speed)
    finally:
        undo()
    return stop.is_set()


@asynccontextmanager
async def _shown(
    replay: Replay, options: ReplayOptions, console: Console, speed: float
) -> AsyncIterator[None]:
    if options.verify:
        with console.status("recomputing every picture, plan and send"):
            yield
        return
    async with view_for(replay, console, speed=speed, headless=options.headless):
        yield


def _summary(replay: Replay, path: Path, wall_s: float) -> dict[str, Any]:
    return {
        "recording": str(path),
        "seconds": replay.duration_s,
        "events": replay.events,
        "effects": replay.effects,
        "wall_s": wall_s,
        "times_real_time": replay.duration_s / wall_s if wall_s > 0.0 else 0.0,
        "damage": None if replay.damage is None else asdict(replay.damage),
    }


def _say(replay: Replay, summary: dict[str, Any], console: Console) -> None:
    console.print(
        f"replayed {replay.duration_s:.1f} s of run time in {summary['wall_s']:.1f} s "
        f"({summary['times_real_time']:.0f} times real time): "
        f"{replay.events} events in, {replay.effects} effects out",
        highlight=False,
    )
    if replay.damage is not None:
        console.print(
            f"the recording breaks off there: {replay.damage.problem}",
            style="yellow",
            highlight=False,
            soft_wrap=True,
        )


def _verified(
    result: Verification, replay: Replay, made_with: RecordingInfo | None, console: Console
) -> dict[str, Any]:
    equal = sum(result.equal.values())
    summary: dict[str, Any] = {
        "verified": result.first is None,
        "equal": dict(sorted(result.equal.items())),
        "different": result.different,
        "first_difference": None if result.first is None else asdict(result.first),
    }
    if equal == 0 and result.first is None:
        console.print("nothing was recorded there that could be compared", style="yellow", highlight=False)
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
    for library, then, now in _other_versions(made_with):
        console.print(f"  {library} was {then} then and is {now} here", style="dim", highlight=False)
    return summary


def _other_versions(made_with: RecordingInfo | None) -> list[tuple[str, str, str]]:
    then, now = {} if made_with is None else made_with.versions, versions()
    return [(name, then[name], now.get(name, "missing")) for name in then if then[name] != now.get(name)]


def _compared(comparison: Comparison, replay: Replay, plan: _Plan, console: Console) -> dict[str, Any]:
    made_with = plan.made_with
    assert made_with is not None
    changed = settings(parse(made_with.config_text, "recorded"), plan.config) if made_with.config_text else []
    rows = comparison.rows(replay.start_t_ns or 0)
    if changed:
        console.print(table("Settings that differ", changed))
    console.print(table("What came of it", rows))
    if any(row.differs for row in rows):
        console.print("the recorded vehicles fly on as they did then, whatever is planned here", style="dim")
    else:
        console.print("nothing would have been different", style="green")
    return {
        "settings": [asdict(row) for row in changed],
        "outcome": [asdict(row) | {"differs": row.differs} for row in rows],
    }
