"""What commands print can be read on a narrow terminal, and searched and printed from a file."""

import asyncio
import io
import re
from typing import Any, ClassVar

import pytest
from msgspec.structs import replace
from rich.console import Console

from gcs.cli.live_view import LiveView
from gcs.cli.prepare.preflight_checks import print_checks
from gcs.cli.run_setup import display
from gcs.config import load
from gcs.core.engine import Engine
from gcs.core.preflight.result import CheckRow
from gcs.io.terminal import console_for
from gcs.model import Notice, NoticeCode, SwarmStatus, TargetRecord, Tick

CHECKS = [
    CheckRow(1, "link", "link", "ok", "alive"),
    CheckRow(
        1,
        "parameter-unwise",
        "BATT_FS_LOW_ACT",
        "warning",
        "0",
        "1 ... 6",
        "set it: without a link it circles until the end",
    ),
    CheckRow(None, "no-scans", "scans", "refused", "none came", "within 1 s", "is the sensor there?"),
]


def shown(width: int, *, terminal: bool) -> str:
    console = Console(file=io.StringIO(), force_terminal=terminal, width=width, color_system=None)
    print_checks(CHECKS, "m", console)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


@pytest.mark.parametrize(("width", "terminal"), [(60, True), (80, True), (80, False), (200, False)])
def test_a_check_is_one_line_with_its_words_whole(width: int, terminal: bool) -> None:
    lines = shown(width, terminal=terminal).splitlines()
    assert lines[1] == "agent 1"
    (battery,) = [line for line in lines if "BATT_FS_LOW_ACT" in line]
    assert " ".join(battery.split()).startswith(
        "warning BATT_FS_LOW_ACT 0, expected: 1 ... 6 – set it: without"
    )
    assert lines[-2:] == [
        "mission",
        "  refused scans            none came, expected: within 1 s – is the sensor there?",
    ]


def test_a_wide_terminal_gets_a_table() -> None:
    assert "what to do" in shown(140, terminal=True)


def test_sentences_in_a_file_are_not_cut(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    console_for().print("word " * 30)
    assert len(capsys.readouterr().out.splitlines()) == 1
    monkeypatch.setenv("COLUMNS", "60")
    assert console_for().width == 60


@pytest.mark.parametrize("width", [60, 80, 160])
def test_the_live_view_names_vehicles_on_any_terminal(width: int) -> None:
    config = load("prescribed")
    console = Console(file=io.StringIO(), width=width, height=40, color_system=None)
    console.print(LiveView(config, Engine(config, 1), 1.0))
    assert isinstance(console.file, io.StringIO)
    titles = next(line for line in console.file.getvalue().splitlines() if "status" in line)
    words = titles.replace("│", " ").split()
    assert {"id", "status", "mode", "battery", "heard", "target", "mission"} <= set(words)
    assert ("authority" in words) is (width >= 100)


@pytest.mark.parametrize("height", [24, 50])
def test_the_live_view_shows_the_address_of_the_console(height: int) -> None:
    config = load("prescribed")
    view = LiveView(config, Engine(config, 1), 1.0, page_url="http://127.0.0.1:8765")
    assert "console http://127.0.0.1:8765" in "\n".join(drawn(view, 80, height))


def live_view(scenario: str, width: int, height: int) -> list[str]:
    """Draw a mission with a target for each agent, and an agent with a failed upload."""
    config = load(scenario)
    engine = Engine(config, 1)
    before = engine.stages.status_report.build(0)
    status = replace(
        before,
        agents=tuple(replace(one, has_failed=one.vehicle == 1) for one in before.agents),
        targets=tuple(
            TargetRecord((0, index), 0.99, (10.0, 20.0), 3.2, (), ()) for index in range(len(config.agents))
        ),
    )
    engine.stages.status_report = Given(status)  # type: ignore[assignment]
    view = LiveView(config, engine, 1.0)
    view.event(Tick(0))
    view.effect(0, Notice(0, NoticeCode.AUTOPILOT_ALARM, 1, {"said": "a long alarm " * 20 + "the newest"}))
    return drawn(view, width, height)


class Given:
    """A status report that was written beforehand."""

    def __init__(self, status: SwarmStatus) -> None:
        self._status = status

    def build(self, _t_ns: int) -> SwarmStatus:
        return self._status


def drawn(view: LiveView, width: int, height: int) -> list[str]:
    console = Console(file=io.StringIO(), width=width, height=height, color_system=None)
    console.print(view)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue().splitlines()


def test_a_small_terminal_shows_all_targets_and_the_newest_alarm() -> None:
    lines = live_view("prescribed", 80, 24)
    assert len(lines) <= 24
    for target in ("T0.0", "T0.1", "T0.2", "T0.3"):
        assert any(line.strip().startswith(target) for line in lines), target
    assert any("the newest" in line for line in lines)


@pytest.mark.parametrize(("width", "height"), [(80, 24), (200, 50)])
def test_hidden_rows_are_counted_and_those_in_trouble_are_shown(width: int, height: int) -> None:
    lines = live_view("swarm-50", width, height)
    assert len(lines) <= height
    tables = [line.rsplit("│", 1)[-1] if width > 100 else line for line in lines]
    first_target = next(index for index, line in enumerate(tables) if "Targets" in line)
    for part in (tables[:first_target], tables[first_target:]):
        shown = sum("active" in line or "T0." in line for line in part)
        more = next(
            re.search(r"and (\d+) more; the most urgent are shown", line) for line in part if "more" in line
        )
        assert more is not None
        assert shown + int(more[1]) == 50
    assert sum("failed" in line for line in tables) >= 1


@pytest.mark.parametrize(
    ("scenario", "width", "height"),
    [("prescribed", 80, 24), ("prescribed", 200, 50), ("swarm-50", 80, 24), ("swarm-50", 200, 50)],
)
def test_vehicles_in_modes_that_are_not_ours_are_named_with_what_to_do(
    scenario: str, width: int, height: int
) -> None:
    """The warning when it began has long left the events; LOITER resembles ours."""
    config = load(scenario)
    engine = Engine(config, 1)
    for vehicle, mode in {2: "LOITER", 3: "RTL", 4: "FBWA"}.items():
        engine.stages.tasking.overrides.of(vehicle).observe_mode("AUTO", 0)
        engine.stages.tasking.overrides.of(vehicle).observe_mode(mode, 0)
    lines = drawn(LiveView(config, engine, 1.0), width, height)
    assert len(lines) <= height
    wanted = "not ours: 2 in LOITER: gcs order resume 2; 3 in RTL: gcs order resume 3; 4 in FBWA: "
    assert any(wanted[: min(width, len(wanted)) - 1] in line for line in lines)
    first = [line.rsplit("│", 1)[-1].split()[0] for line in lines if "active" in line]
    assert set(first[:4]) >= {"2", "3", "4"}


def test_a_dumb_terminal_gets_plain_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "dumb")
    config, screen = load("prescribed"), io.StringIO()
    console = Console(file=screen, force_terminal=True)

    class Run:
        links = None
        sinks: ClassVar[list[Any]] = []

    Run.config, Run.command = config, Engine(config, 1)

    async def show() -> None:
        async with display(Run(), console, speed=1.0, headless=False):
            Run.sinks[0].effect(0, Notice(0, NoticeCode.AUTOPILOT_ALARM, 3, {"said": "not heard at all"}))

    asyncio.run(show())
    shown = screen.getvalue()
    assert "agent 3: " in shown
    assert "not heard at all" in shown
