"""Who collects logs would have to guess times, levels and vehicles from sentences."""

import io
import json
import os
import sys

import pytest
from rich.console import Console
from rich.text import Text
from typer.testing import CliRunner

from gcs.cli import app
from gcs.cli.live_view import PlainLines
from gcs.io.log_output import LogConsole
from gcs.io.terminal import console_for
from gcs.model import AgentStatus, Notice, NoticeCode, Tick

FIELDS = ["time", "t_ns", "code", "level", "subject", "parameters", "text"]
T_NS = 1_800_000_000_250_000_000


def logged(as_json: bool, has_priorities: bool = False) -> tuple[LogConsole, io.StringIO]:
    console = LogConsole(stderr=False, as_json=as_json, has_priorities=has_priorities)
    console.file = file = io.StringIO()
    return console, file


def test_a_notice_is_one_object_with_code_subject_and_parameters() -> None:
    console, file = logged(as_json=True)
    lines = PlainLines(console)
    lines.event(Tick(T_NS))
    lines.effect(T_NS, Notice(T_NS, NoticeCode.AUTOPILOT_ALARM, 3, {"said": 'two\nlines "quoted"'}))
    lines.effect(T_NS, AgentStatus(T_NS, 2, "lost", None, None))
    said, lost = map(json.loads, file.getvalue().splitlines())
    assert list(said) == FIELDS
    assert said["time"] == "2027-01-15T08:00:00.250000Z"
    assert (said["code"], said["level"], said["subject"]) == ("autopilot-alarm", "alarm", 3)
    assert said["parameters"].keys() == {"said"}
    assert (lost["code"], lost["subject"]) == ("agent-lost", 2)


def test_other_messages_are_objects_without_a_code_and_with_the_level_of_their_style() -> None:
    console, file = logged(as_json=True)
    console.print("MAVLink on udpin:0.0.0.0:14550; [zenoh] here", markup=False)
    console.print("warning: the certificate expires", style="yellow")
    console.print(Text.assemble(("error: ", "bold red"), "no such file " * 40))
    found = [json.loads(line) for line in file.getvalue().splitlines()]
    assert [list(one) for one in found] == [FIELDS] * 3
    assert [one["level"] for one in found] == ["info", "warning", "alarm"]
    assert found[0]["text"] == "MAVLink on udpin:0.0.0.0:14550; [zenoh] here"
    assert all(one["code"] is None for one in found)


def test_each_line_in_the_journal_has_its_priority() -> None:
    console, file = logged(as_json=False, has_priorities=True)
    console.print("one\ntwo")
    lines = PlainLines(console)
    lines.effect(T_NS, Notice(T_NS, NoticeCode.LINK_STALE, 3, {"silence_s": 2.6}))
    lines.effect(T_NS, Notice(T_NS, NoticeCode.LINK_DOWN, 3, {"silence_s": 5.1}))
    found = file.getvalue().splitlines()
    assert found[:2] == ["<6>one", "<6>two"]
    assert [line[:3] for line in found[2:]] == ["<4>", "<1>"]


@pytest.mark.parametrize("is_connected", [True, False])
def test_priorities_are_written_where_systemd_connects_the_output_to_its_journal(
    is_connected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    reader, writer = os.pipe()
    with os.fdopen(writer, "w", encoding="utf-8") as stream, os.fdopen(reader, encoding="utf-8") as read:
        found = os.fstat(writer)
        monkeypatch.setenv("JOURNAL_STREAM", f"{found.st_dev}:{found.st_ino + (not is_connected)}")
        monkeypatch.setattr(sys, "stdout", stream)
        console_for().print("a line", style="yellow")
        stream.flush()
        assert read.readline() == ("<4>a line\n" if is_connected else "a line\n")


def test_a_mistake_is_an_object_of_the_log_too() -> None:
    result = CliRunner().invoke(app, ["run", "no-such-mission.toml", "--log-format", "json"])
    assert result.exit_code == 2
    (found,) = map(json.loads, result.stdout.splitlines())
    assert found["level"] == "alarm"
    assert "no-such-mission.toml" in found["text"]


def test_a_log_is_plain_text_elsewhere() -> None:
    assert type(console_for()) is Console
