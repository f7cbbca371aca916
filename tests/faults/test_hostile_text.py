"""Escape sequences and hidden characters in what others say reach no terminal, log or report."""

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gcs.cli.errors import print_error
from gcs.cli.live_view import LiveView, PlainLines
from gcs.config import load, parse
from gcs.core.engine import Engine
from gcs.errors import ConfigError, GcsError, LinkError, WireError
from gcs.io.record_json import decode, encode
from gcs.io.terminal import Printable, console_for
from gcs.io.zenoh.order_messages import decode_order
from gcs.io.zenoh.scans import decode_scan
from gcs.mavlink.fleet.statustext import TextChunks
from gcs.mavlink.frames.codec import dialect
from gcs.model import BadInput, Notice, NoticeCode, Order, OrderAnswer, UploadReport
from gcs.report.html_page import Page, save_page
from gcs.safe_text import REPLACEMENT, printable

CLEAR = "\x1b[2J\x1b]52;c;cm0gLXJm\x07"
"""Clears the screen and writes to the clipboard."""
HIDDEN = "\x9b\x7f\u202e\u200b\u2066\ufeff\U000e0041\u2028\r\n"
HOSTILE = f"ok {CLEAR}{HIDDEN} ünïcode → 12°"


def is_safe(text: str, keep: str = "") -> bool:
    return printable(text, keep) == text and "ok " in text


def test_what_is_shown_as_itself_stays_and_nothing_else() -> None:
    shown = "ünïcode → 12° 日本語 a\u00a0b\u3000c"
    assert printable(shown) == shown
    assert printable("a\x1b[31mb") == f"a{REPLACEMENT}[31mb"
    assert printable(HIDDEN + "\udc80") == REPLACEMENT * (len(HIDDEN) + 1)
    assert printable("a\nb", keep="\n") == "a\nb"


def test_the_texts_of_a_vehicle_are_safe() -> None:
    message = dialect.MAVLink_statustext_message(4, b"")
    message.text = HOSTILE[:40]  # as the codec decodes it
    (text,) = TextChunks().add_chunk(message)
    assert is_safe(text)
    assert is_safe(Notice(0, NoticeCode.AUTOPILOT_ALARM, 1, {"said": HOSTILE}).text)


@pytest.mark.parametrize(
    "text",
    [
        BadInput(0, HOSTILE, "").source,
        BadInput(0, "", HOSTILE).problem,
        Notice(0, NoticeCode.LINK_FAILED, HOSTILE, {"problem": HOSTILE}).line,
        UploadReport(0, 1, 1, 8, False, HOSTILE, 0.0, 0).detail,
        OrderAnswer(0, "a", "hold", "refused", HOSTILE).detail,
        Order(0, "a", "hold", None, origin=HOSTILE).origin,
        str(LinkError("udp", HOSTILE.replace("\n", ""))),
    ],
)
def test_every_record_that_is_shown_is_safe(text: str) -> None:
    assert is_safe(text)


def test_a_notice_of_a_foreign_recording_is_safe_when_it_is_read() -> None:
    notice = Notice(0, NoticeCode.AUTOPILOT_ALARM, 1, {"said": "ok X"})
    payload = encode(notice).replace(b"X", json.dumps(HOSTILE)[1:-1].encode())
    assert is_safe(decode("notice", payload, Notice).text)


def test_hostile_payloads_on_zenoh_are_refused_in_safe_words() -> None:
    frame = load("prescribed").local_frame
    payload = msgspec.json.encode({"order_id": "a", "action": "hold", "vehicles": "all", HOSTILE: 1})
    for decode_payload in (decode_order, decode_scan):
        with pytest.raises(WireError) as refused:
            decode_payload(f"swarm/{HOSTILE}/order", payload, 0, frame)
        assert is_safe(str(refused.value), keep="\n")


def test_a_mission_file_shows_no_escape_sequences() -> None:
    text = 'description = "\\u001b[2J\\u202e"\nname = "x"\n"bad \\u001b[2J" = 1\n'
    with pytest.raises(ConfigError) as refused:
        parse(text, f"ok {CLEAR}.toml")
    assert is_safe(str(refused.value), keep="\n")


def test_lines_view_and_errors_on_a_terminal_hold_no_escapes_but_our_own(
    capsys: pytest.CaptureFixture[str],
) -> None:
    config = load("prescribed")
    notice = Notice(0, NoticeCode.AUTOPILOT_ALARM, 1)
    object.__setattr__(notice, "parameters", {"said": HOSTILE})  # past the record
    shown = io.StringIO()
    console = Console(file=shown, width=200, height=50, color_system=None)
    view = LiveView(config, Engine(config, 1), 1.0)
    for sink in (view, PlainLines(console_for())):
        sink.effect(0, notice)
    console.print(Printable(view))
    table = Table("a")
    table.add_row(Text(HOSTILE))
    console_for().print(table)
    console_for().print(HOSTILE, markup=False)
    print_error(GcsError(HOSTILE))
    out = capsys.readouterr()
    for text in (shown.getvalue(), out.out, out.err):
        assert is_safe(text, keep="\n")


def test_a_report_escapes_html_and_holds_no_control_characters(tmp_path: Path) -> None:
    hostile = f"<script>alert(1)</script>{HOSTILE}"
    save_page(Page(title=hostile, subtitle=hostile), tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "<script>alert" not in text
    assert is_safe(text, keep="\n\t")


def test_a_terminal_without_unicode_gets_ascii_and_no_traceback() -> None:
    code = "from gcs.io.terminal import console_for; console_for().print('1 → 2.3 – ☃')"
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, env=environment, check=True
    )
    assert done.stdout == b"1 -> 2.3 - ?\n"
