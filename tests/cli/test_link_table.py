"""The table of links fits a terminal of 80 columns and still says what matters."""

import io

from rich.console import Console

from gcs.cli.link_table import link_table

VEHICLES = {
    "link": "udpin:0.0.0.0:14550", "role": "vehicles", "frames": 753, "lost": 216, "crc_errors": 0,
    "unknown_systems": 0, "conflicts": 0, "unsent": 0,
}  # fmt: skip
OTHER_STATIONS = {
    "link": "udpin:127.0.0.1:14551", "role": "full", "other_ground_stations": ["1.2.3.4:5"],
    "frames": 34, "passed": 30, "sent": 700, "refused": {"mode": 4}, "unsent": 0,
}  # fmt: skip


def drawn(*rows: dict[str, object]) -> str:
    console = Console(file=io.StringIO(), width=80, color_system=None)
    console.print(link_table(rows))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_vehicles_alone_need_one_line_and_no_empty_columns() -> None:
    text = drawn(VEHICLES)
    row = next(line for line in text.splitlines() if "udpin" in line)
    assert row.split() == ["udpin:0.0.0.0:14550", "vehicles", "753", "22.3", "%"]
    assert "conflicts" not in text


def test_the_report_of_a_radio_is_shown() -> None:
    radio = {"signal": 180, "noise": 40, "remote_signal": 170, "remote_noise": 45, "free_percent": 98}
    text = " ".join(drawn({**VEHICLES, "radio": radio}).split())
    assert "180" in text
    assert "98 %" in text


def test_what_went_wrong_and_what_other_stations_did_is_there() -> None:
    text = drawn({**VEHICLES, "conflicts": 7}, OTHER_STATIONS)
    assert "conflicts" in text
    assert "udpin:127.0.0.1:14551" in text
    assert "34" in text
    assert "1; 700 sent," in text
