"""What commands print can be read on a narrow terminal, and searched and printed from a file."""

import io

import pytest
from rich.console import Console

from gcs.command.checks import Check
from gcs.command.fold import Command
from gcs.commands.preflight import show
from gcs.config import load
from gcs.edge.consoles import console_for
from gcs.edge.terminal import LiveView

CHECKS = [
    Check(1, "link", "ok", "alive"),
    Check(1, "BATT_FS_LOW_ACT", "warning", "0", "1 ... 6", "set it: without a link it circles until the end"),
    Check(None, "scans", "refused", "none came", "within 1 s", "is the sensor there?"),
]


def shown(width: int, *, terminal: bool) -> str:
    console = Console(file=io.StringIO(), force_terminal=terminal, width=width, color_system=None)
    show(CHECKS, "m", console)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


@pytest.mark.parametrize(("width", "terminal"), [(60, True), (80, True), (80, False), (200, False)])
def test_a_check_is_one_line_with_its_words_whole(width: int, terminal: bool) -> None:
    lines = shown(width, terminal=terminal).splitlines()
    assert lines[1] == "agent 1"
    (battery,) = [line for line in lines if "BATT_FS_LOW_ACT" in line]
    assert " ".join(battery.split()).startswith(
        "warning BATT_FS_LOW_ACT 0, wanted: 1 ... 6 – set it: without"
    )
    assert lines[-2:] == [
        "mission",
        "  refused scans            none came, wanted: within 1 s – is the sensor there?",
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
def test_the_live_view_says_who_is_who_on_any_terminal(width: int) -> None:
    config = load("prescribed")
    console = Console(file=io.StringIO(), width=width, height=40, color_system=None)
    console.print(LiveView(config, Command(config, 1), 1.0))
    assert isinstance(console.file, io.StringIO)
    titles = next(line for line in console.file.getvalue().splitlines() if "fate" in line)
    words = titles.replace("│", " ").split()
    assert {"id", "fate", "mode", "target", "mission"} <= set(words)
    assert ("exist." in words) is (width >= 100)
