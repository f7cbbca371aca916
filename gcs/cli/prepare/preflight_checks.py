"""Run of `gcs preflight`: asks vehicles, links and sensors, checks the answers, prints the tables."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import msgspec
from rich.console import Console
from rich.status import Status
from rich.table import Table
from rich.text import Text

from gcs.config import Config, load
from gcs.core.preflight.check_codes import CheckCode
from gcs.core.preflight.mission_checks import mission_checks, rehearse, sensor_checks
from gcs.core.preflight.result import Check, CheckRow, PreflightResult
from gcs.core.preflight.vehicle_checks import envelope_of, vehicle_checks
from gcs.errors import LinkError, WireError
from gcs.fence import fence_of
from gcs.io.clock import ClockWatch, RunClock
from gcs.io.vehicles.session import VehicleSession
from gcs.io.vehicles.vehicle_access import vehicle_access
from gcs.io.zenoh.key_expressions import sensor_scan_keys
from gcs.io.zenoh.scans import decode_scan
from gcs.io.zenoh.session import ZenohSession
from gcs.mavlink.services.preflight_query import PREFLIGHT_MESSAGE_IDS, PreflightQuery
from gcs.model import NS_PER_S, Scan, vehicle_name

_STYLE: Final = {"ok": "green", "warning": "yellow", "refused": "bold red"}
_MIN_TABLE_COLUMNS: Final = 120
"""A narrower terminal would cut the words of the table's six columns."""
_MIN_LISTEN_S: Final = 1.5
"""Time to collect scans and telemetry, at least."""


def run_preflight(
    source: str,
    console: Console,
    *,
    wait_s: float,
    link: str | None,
    sensors: bool,
    brief: bool,
    seed: int,
    as_json: bool,
) -> bool:
    """Run and print the checks; return True if none is refused.

    Raises
    ------
    ConfigError, LinkError
        When the mission file is wrong or a port cannot be opened.
    """
    config = load(source)
    fence_of(config, source)  # Reports mistakes in the fence before anything is sent.
    entrance = vehicle_access(config, link, writes=False)
    scan_listener = ScanListener(config, config.links.tls_folder(source))
    with ExitStack() as stack:
        if entrance.service is not None:
            sensors = False
            notice = f"{entrance.description}; the service itself warns when no scans come"
            console.print(notice, highlight=False, markup=False, soft_wrap=True)
        elif sensors:
            scan_listener.open(stack)
        checks = asyncio.run(
            _run_checks(
                config,
                VehicleSession.of_mission(config, source, PREFLIGHT_MESSAGE_IDS, link),
                scan_listener if sensors else None,
                wait_s,
                seed,
                console,
            )
        )
    rows = [check.row for check in checks]
    refused = sum(row.level == "refused" for row in rows)
    warnings = sum(row.level == "warning" for row in rows)
    print_checks([row for row in rows if not (brief and row.level == "ok")], config.name, console)
    verdict = f"{refused} refused: do not fly" if refused else "nothing refused"
    style = "bold red" if refused else "bold"
    console.print(f"{verdict}, {warnings} warnings", style=style, highlight=False, soft_wrap=True)
    if as_json:
        result = PreflightResult(config.name, not refused, refused, warnings, tuple(rows))
        print(msgspec.json.encode(result).decode(), flush=True)  # noqa: T201  the output of --json
    return not refused


class ScanListener:
    """Collects the scans that arrive on zenoh during the checks."""

    def __init__(self, config: Config, tls: Path | None) -> None:
        self.scans: list[Scan] = []
        self.problems: dict[str, None] = {}
        self._config = config
        self._tls = tls
        self._clock = RunClock()

    def open(self, stack: ExitStack) -> None:
        """Listen until the stack is closed."""
        links = self._config.links
        try:
            bus = stack.enter_context(ZenohSession(**{links.zenoh_role: links.zenoh}, tls=self._tls))
        except LinkError as error:
            self.problems[str(error)] = None
            return
        bus.subscribe(sensor_scan_keys(self._config.name), self._on_scan)

    def _on_scan(self, key: str, payload: bytes) -> None:
        try:
            self.scans.append(decode_scan(key, payload, self._clock.now_ns(), self._config.local_frame))
        except WireError as error:
            self.problems[str(error)] = None


async def _run_checks(
    config: Config,
    session: VehicleSession,
    scan_listener: ScanListener | None,
    wait_s: float,
    seed: int,
    console: Console,
) -> list[Check]:
    own = session.access.own
    queries = [
        PreflightQuery(vehicle, envelope_of(config, vehicle), session.fleet.encoder(vehicle), own)
        for vehicle in config.speeds_m_s
    ]
    began_s = time.monotonic()
    watch = ClockWatch()

    def has_heard_enough() -> bool:
        has_scans = scan_listener is None or bool(scan_listener.scans or scan_listener.problems)
        return has_scans and time.monotonic() - began_s >= _MIN_LISTEN_S

    with console.status("") as status:
        await session.run(queries, wait_s, _progress(status, queries), has_heard_enough)
        waited_s = time.monotonic() - began_s
        status.update("planning")
        states = session.fleet.states()
        area = config.map
        places = {
            s.system_id: (min(max(s.east_m, 0.0), area.width_m), min(max(s.north_m, 0.0), area.height_m))
            for s in states
        }
        rehearsal = rehearse(config, seed, places, session.fleet)
    checks = vehicle_checks(
        queries,
        session.fleet,
        config,
        lambda vehicle: [path_m for v, path_m in rehearsal.plan.paths_m.items() if v == vehicle],
        rehearsal.obstacles,
        session.now_ns(),
        session.has_key,
    )
    checks += mission_checks(config, rehearsal)
    news = {(one.code, one.subject, *one.parameters.items()): one for one in session.notices}
    for notice in news.values():
        code = CheckCode.LINK_NEWS if notice.level == "info" else CheckCode.LINK_WARNING
        checks.append(Check(None, code, {"notice": notice.line}))
    if scan_listener is not None:
        checks += sensor_checks(scan_listener.scans, scan_listener.problems, waited_s)
    if step_ns := watch.step_ns():
        checks.append(Check(None, CheckCode.CLOCK_SET, {"step_s": step_ns / NS_PER_S}))
    return checks


def _progress(status: Status, queries: list[PreflightQuery]) -> Callable[[], None]:
    def show() -> None:
        waiting = [f"{vehicle_name(query.vehicle)}: {query.stage}" for query in queries if not query.is_done]
        text = f"asking {', '.join(waiting[:6])}" if waiting else "waiting for scans"
        status.update(text + (" ..." if len(waiting) > 6 else ""))

    return show


def print_checks(checks: list[CheckRow], name: str, console: Console) -> None:
    """Print the checks: as a table in a wide terminal, else one line for each."""
    if console.is_terminal and console.width >= _MIN_TABLE_COLUMNS:
        console.print(_table(checks, name))
        return
    console.print(f"pre-flight of {name}", highlight=False, markup=False, soft_wrap=True)
    subject = ""
    width = max((len(check.name) for check in checks), default=0)
    for check in checks:
        if check.subject != subject:
            subject = check.subject
            title = subject if check.vehicle is None else f"agent {subject}"
            console.print(title, style="bold", highlight=False, markup=False, soft_wrap=True)
        expected = f", expected: {check.wanted}" if check.wanted and check.level != "ok" else ""
        remedy = f" – {check.remedy}" if check.remedy and check.level != "ok" else ""
        line = Text.assemble(
            "  ",
            (f"{check.level:8}", _STYLE[check.level]),
            f"{check.name:{width}}  {check.value}{expected}{remedy}".rstrip(),
        )
        console.print(line, highlight=False, soft_wrap=True)


def _table(checks: list[CheckRow], name: str) -> Table:
    table = Table(title=f"pre-flight of {name}", title_justify="left", pad_edge=False)
    for column in ("subject", "check", "", "value", "expected", "what to do"):
        table.add_column(column, overflow="fold")
    subject = ""
    for check in checks:
        if subject and check.subject != subject:
            table.add_section()
        is_first = check.subject != subject
        subject = check.subject
        style = _STYLE[check.level]
        table.add_row(
            subject if is_first else "",
            check.name,
            f"[{style}]{check.level}[/]",
            check.value,
            check.wanted,
            check.remedy,
        )
    return table
