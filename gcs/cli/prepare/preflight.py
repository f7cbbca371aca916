"""`gcs preflight`: ask every vehicle what matters before a flight, and print what stands against it."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace

from rich.console import Console
from rich.status import Status
from rich.table import Table
from rich.text import Text

from gcs.config import Config, load
from gcs.core.preflight.mission import mission_checks, rehearse, sensor_checks
from gcs.core.preflight.result import Check, Level
from gcs.core.preflight.vehicle import envelope_of, vehicle_checks
from gcs.errors import LinkError, WireError
from gcs.fence import fence_of
from gcs.io.clock import ClockWatch, RunClock
from gcs.io.mavsdk.uploader import REMEDY, mavsdk_problem
from gcs.io.vehicles.access import entrance_of
from gcs.io.vehicles.session import VehicleSession
from gcs.io.zenoh.messages import sensor_scan_keys
from gcs.io.zenoh.scans import decode_scan
from gcs.io.zenoh.session import ZenohSession
from gcs.mavlink.services.preflight_query import PREFLIGHT_MESSAGE_IDS, PreflightQuery
from gcs.model import NS_PER_S, Scan, vehicle_name

_STYLE = {"ok": "green", "warning": "yellow", "refused": "bold red"}
_TABLE_COLUMNS = 120
"""Narrower, words of the table's six columns would be cut into pieces."""
_SETTLE_S = 1.5
"""How long scans and telemetry are listened to at least."""


@dataclass(frozen=True, slots=True)
class PreflightOptions:
    """What the command line says."""

    config: str
    seed: int
    wait_s: float
    link: str | None
    sensors: bool
    brief: bool
    as_json: bool


def preflight(options: PreflightOptions, console: Console) -> bool:
    """Check, print, and return whether nothing was refused.

    Raises
    ------
    ConfigError, LinkError
        When the mission file is wrong or a port cannot be had.
    """
    config = load(options.config)
    fence_of(config, options.config)  # its mistakes first
    entrance = entrance_of(config, options.link, writes=False)
    ears = Ears(config)
    with ExitStack() as stack:
        if entrance.service is not None:
            options = replace(options, sensors=False)
            words = f"{entrance.words}; scans are left to it: it tells when none come"
            console.print(words, highlight=False, markup=False, soft_wrap=True)
        elif options.sensors:
            ears.open(stack)
        checks = asyncio.run(_checked(config, options, ears, console))
    refused = sum(check.level == "refused" for check in checks)
    told = sum(check.level == "warning" for check in checks)
    show([c for c in checks if not (options.brief and c.level == "ok")], config.name, console)
    verdict = f"{refused} refused: do not fly" if refused else "nothing refused"
    style = "bold red" if refused else "bold"
    console.print(f"{verdict}, {told} warnings", style=style, highlight=False, soft_wrap=True)
    if options.as_json:
        rows = [asdict(check) for check in checks]
        result = {
            "mission": config.name,
            "ok": not refused,
            "refused": refused,
            "warnings": told,
            "checks": rows,
        }
        print(json.dumps(result), flush=True)  # noqa: T201  the promised last line
    return not refused


class Ears:
    """Scans that arrive on zenoh meanwhile."""

    def __init__(self, config: Config) -> None:
        self.scans: list[Scan] = []
        self.problems: dict[str, None] = {}
        self._config = config
        self._clock = RunClock()

    def open(self, stack: ExitStack) -> None:
        """Listen until the stack is closed."""
        links = self._config.links
        try:
            bus = stack.enter_context(ZenohSession(**{links.zenoh_role: links.zenoh}))
        except LinkError as error:
            self.problems[str(error)] = None
            return
        bus.subscribe(sensor_scan_keys(self._config.name), self._heard)

    def _heard(self, key: str, payload: bytes) -> None:
        try:
            self.scans.append(decode_scan(key, payload, self._clock.now_ns(), self._config.local_frame))
        except WireError as error:
            self.problems[str(error)] = None


async def _checked(config: Config, options: PreflightOptions, ears: Ears, console: Console) -> list[Check]:
    visit = VehicleSession(config, options.config, PREFLIGHT_MESSAGE_IDS, options.link)
    envelope, own = envelope_of(config), visit.entrance.own
    talks = [
        PreflightQuery(agent.vehicle, envelope, visit.fleet.encoder(agent.vehicle), own)
        for agent in config.agents
    ]
    began_s, watch = time.monotonic(), ClockWatch()

    def enough() -> bool:
        heard = bool(ears.scans or ears.problems or not options.sensors)
        return heard and time.monotonic() - began_s >= _SETTLE_S

    with console.status("") as status:
        await visit.run(talks, options.wait_s, _progress(status, talks), enough)
        waited_s = time.monotonic() - began_s
        status.update("planning")
        states = visit.fleet.states()
        area = config.map
        places = {
            s.system_id: (min(max(s.east_m, 0.0), area.width_m), min(max(s.north_m, 0.0), area.height_m))
            for s in states
        }
        rehearsal = rehearse(config, options.seed, places, visit.fleet)
    checks = vehicle_checks(
        talks,
        visit.fleet,
        config,
        lambda vehicle: rehearsal.ways_m.get(vehicle, ()),
        visit.now_ns(),
        visit.has_key,
    )
    checks += mission_checks(config, rehearsal)
    checks += [
        Check(None, "link", "ok" if level == "info" else "warning", f"{name}: {text}")
        for name, level, text in dict.fromkeys(visit.news)
    ]
    if config.mission.uploader == "mavsdk":
        problem = mavsdk_problem()
        level: Level = "refused" if problem else "ok"
        text = problem or "starts"
        checks.append(Check(None, "MAVSDK", level, text, "starts", REMEDY))
    if options.sensors:
        checks += sensor_checks(ears.scans, ears.problems, waited_s)
    if step_ns := watch.step_ns():
        text = f"set by {step_ns / NS_PER_S:+.1f} s meanwhile"
        checks.append(
            Check(None, "clock", "warning", text, "not set", "check again: ages of scans may be wrong")
        )
    return checks


def _progress(status: Status, talks: list[PreflightQuery]) -> Callable[[], None]:
    def show() -> None:
        waiting = [f"{vehicle_name(talk.vehicle)}: {talk.stage}" for talk in talks if not talk.is_done]
        text = f"asking {', '.join(waiting[:6])}" if waiting else "waiting for scans"
        status.update(text + (" ..." if len(waiting) > 6 else ""))

    return show


def show(checks: list[Check], name: str, console: Console) -> None:
    """Print a table where there is room for one; elsewhere, and into files, a line for each check."""
    if console.is_terminal and console.width >= _TABLE_COLUMNS:
        console.print(_table(checks, name))
        return
    console.print(f"pre-flight of {name}", highlight=False, markup=False, soft_wrap=True)
    whom = ""
    width = max((len(check.name) for check in checks), default=0)
    for check in checks:
        if check.whom != whom:
            whom = check.whom
            title = whom if check.vehicle is None else f"agent {whom}"
            console.print(title, style="bold", highlight=False, markup=False, soft_wrap=True)
        wanted = f", wanted: {check.wanted}" if check.wanted and check.level != "ok" else ""
        remedy = f" – {check.remedy}" if check.remedy and check.level != "ok" else ""
        line = Text.assemble(
            "  ",
            (f"{check.level:8}", _STYLE[check.level]),
            f"{check.name:{width}}  {check.value}{wanted}{remedy}".rstrip(),
        )
        console.print(line, highlight=False, soft_wrap=True)


def _table(checks: list[Check], name: str) -> Table:
    table = Table(title=f"pre-flight of {name}", title_justify="left", pad_edge=False)
    for column in ("whom", "check", "", "value", "wanted", "what to do"):
        table.add_column(column, overflow="fold")
    whom = ""
    for check in checks:
        if whom and check.whom != whom:
            table.add_section()
        first, whom = check.whom != whom, check.whom
        style = _STYLE[check.level]
        table.add_row(
            whom if first else "",
            check.name,
            f"[{style}]{check.level}[/]",
            check.value,
            check.wanted,
            check.remedy,
        )
    return table
