"""A run on one page: it stands alone, its numbers are the judge's, it shows whatever a file holds."""

import csv
import json
import re
import time
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rich.console import Console
from typer.testing import CliRunner

from gcs.cli import app
from gcs.cli.analyse.report_material import _Reading
from gcs.cli.analyse.run_file import RunFile
from gcs.config import load
from gcs.io.recording.reader import Damage, read, read_info
from gcs.io.recording.recorder import DiskBudget, Recorder
from gcs.io.recording.tlog import tlog_entries
from gcs.model import NS_PER_S, Effect, Event, Picture, Scan, Truth
from gcs.report.run.evaluation import Evaluator

T0_NS = 1_700_000_000 * NS_PER_S
SHARED = Path(__file__).parents[4] / "shared" / "data"


def run(*arguments: object) -> tuple[int, str, dict[str, Any]]:
    """Exit code, everything printed, and the JSON of the last line (empty when there is none)."""
    result = CliRunner().invoke(app, [*map(str, arguments)], catch_exceptions=False)
    last = result.stdout.strip().splitlines()[-1:] if result.exit_code == 0 else []
    found = json.loads(last[0]) if last and last[0].startswith("{") else {}
    return result.exit_code, " ".join(result.output.split()), found


class Links(HTMLParser):
    """What a browser would load or follow, and the words."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.followed: list[str] = []
        self.tags: set[str] = set()
        self.words = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        for name, value in attrs:
            if name in ("src", "srcset", "data", "poster") or (name.endswith("href") and tag != "a"):
                self.loaded.append(value or "")
            elif name == "href":
                self.followed.append(value or "")

    def handle_data(self, data: str) -> None:
        self.words += data + " "


def checked_page(folder: Path) -> str:
    """Return the words of a page that loads nothing and names only files that are there."""
    text = (folder / "index.html").read_text(encoding="utf-8")
    links = Links(text)
    assert all(one.startswith(("#", "data:image/png;base64,")) for one in links.loaded)
    assert all(one.startswith("#") or (folder / one).is_file() for one in links.followed)
    assert not links.tags & {"script", "link", "iframe", "object", "embed"}
    assert "@import" not in text
    assert all(one.startswith("#") for one in re.findall(r"url\(['\"]?([^)'\"]*)", text))
    assert "prefers-color-scheme: dark" in text
    figures = sorted((folder / "figures").iterdir())
    assert len(figures) == 2 * text.count("<figure>")
    for figure in figures:
        if figure.suffix == ".png":
            assert imread(figure).std() > 0.02, figure.name
        else:
            assert figure.read_bytes().startswith(b"%PDF")
            assert figure.stat().st_size > 3000
    return " ".join(links.words.split())


@pytest.fixture(scope="module")
def report(flight: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("report")
    code, _, found = run("report", flight, "-o", folder, "--json")
    assert code == 0
    return folder, found


def test_the_page_stands_alone_and_its_figures_are_there(report: tuple[Path, dict[str, Any]]) -> None:
    words = checked_page(report[0])
    for heading in (
        "Ground truth and tracks at half time",
        "Tracker output",
        "Plans and agent status",
        "scan times",
    ):
        assert heading in words


def test_the_numbers_on_the_page_are_the_judges(flight: Path, report: tuple[Path, dict[str, Any]]) -> None:
    config = load("random-obstacles")
    evaluator = Evaluator(config.planning.capture_radius_m, [agent.system_id for agent in config.agents])
    for record in read(flight):
        if isinstance(record.value, Truth):
            evaluator.add_truth(record.value)
        elif isinstance(record.value, Effect):
            evaluator.add_effect(record.value)
    folder, found = report
    words = checked_page(folder)
    means = {kind: evaluator.ospa(kind).mean_m for kind in ("agents", "targets")}
    assert found["summary"]["ospa_agents_mean_m"] == means["agents"]
    assert found["summary"]["ospa_targets_mean_m"] == means["targets"]
    for kind, mean_m in means.items():
        assert f"OSPA of {kind}, mean {mean_m:.2f} m" in words
    assert found["summary"]["retasks"] == len(evaluator.retasks())
    assert f"re-tasks {len(evaluator.retasks())} " in words
    assert found["summary"]["scan_ms_p99"] > 0.0


def test_the_csv_holds_every_track_of_every_picture(
    flight: Path, report: tuple[Path, dict[str, Any]]
) -> None:
    pictures = [record.value for record in read(flight) if isinstance(record.value, Picture)]
    with (report[0] / "tracks.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == sum(len(picture.tracks) for picture in pictures)
    last = pictures[-1]
    mine = [row for row in rows if row["kind"] == last.kind and int(row["k"]) == max(
        int(one["k"]) for one in rows if one["kind"] == last.kind
    )]  # fmt: skip
    for row, track in zip(mine, last.tracks, strict=True):
        assert row["label"] == f"{'T' if last.kind == 'targets' else 'A'}{track.label[0]}.{track.label[1]}"
        state = [float(row[name]) for name in ("x", "y", "vx", "vy")]
        assert state == pytest.approx(track.mean, abs=1e-4)
        assert float(row["existence"]) == pytest.approx(track.existence, abs=1e-6)
        assert bool(int(row["estimated"])) == track.estimated
    assert 24.0 < float(mine[0]["t"]) < 26.0


def test_a_real_flight_without_truth_that_breaks_off_is_shown_as_far_as_it_goes(
    flight: Path, tmp_path: Path
) -> None:
    made_with = read_info(flight)
    with Recorder(tmp_path / "run", made_with.config_text, {}, made_with.run) as recorder:
        for record in read(flight):
            if isinstance(record.value, Event):
                recorder.record_event(record.value)
            elif not isinstance(record.value, Truth | Damage):
                recorder.record_effect(record.t_ns, record.value)
            if record.sequence % 200 == 0:
                recorder.flush()
    mcap = tmp_path / "run" / "run.mcap"
    mcap.write_bytes(mcap.read_bytes()[: mcap.stat().st_size * 2 // 3])
    code, text, found = run("report", tmp_path / "run", "--no-timing", "--json")
    assert (code, found["has_truth"]) == (0, False)
    assert "ends early" in text
    words = checked_page(tmp_path / "run" / "report")
    assert "This recording has no ground truth" in words
    assert "cut off" in words
    assert "Tracker output" in words
    assert "OSPA of agents, mean" not in words
    assert 5.0 < found["seconds"] < 25.0


def test_load_is_measured_in_processor_time_not_on_a_busy_machines_clock() -> None:
    class UploadQueue:
        def step(self, _event: Event) -> list[Effect]:
            time.sleep(0.2)  # as where other programs have the processors
            return []

    reading = _Reading(RunFile(Path("x")), None, Console(quiet=True), timing=False)
    reading._timed_step(UploadQueue(), Scan(1, 1, "radar", np.empty((0, 2))))  # type: ignore[arg-type]
    (took_ms,) = reading.work_ms["scan"]
    assert took_ms < 100.0


def a_log(path: Path, set_back_s: float = 0.0) -> Path:
    """Sixty seconds of two aeroplanes that circle; in the middle the logger's clock is set."""
    data = b""
    for half_second in range(120):
        back_s = set_back_s if half_second >= 60 else 0.0
        t_ns = T0_NS + half_second * NS_PER_S // 2 - round(back_s * NS_PER_S)
        for system in (1, 2):
            packer = mavlink.MAVLink(None, srcSystem=system)
            packer.seq = half_second % 256
            turn = half_second / 10.0
            place = [round(4.7e8 + 2e4 * np.sin(turn) * system), round(8.5e8 + 3e4 * np.cos(turn))]
            position = mavlink.MAVLink_global_position_int_message(
                half_second * 500, *place, 500_000, 80_000, 1500, 0, 0, 0
            )
            beat = mavlink.MAVLink_heartbeat_message(1, 3, 128 if half_second > 20 else 0, 10, 4, 3)
            data += tlog_entries(t_ns, position.pack(packer))
            data += tlog_entries(t_ns, beat.pack(packer)) if half_second % 2 else b""
    path.write_bytes(data[:5000] + b"damage" * 30 + data[5000:])
    return path


def test_a_telemetry_log_of_others_is_shown_without_a_mission(tmp_path: Path) -> None:
    log = a_log(tmp_path / "flight.tlog", set_back_s=86_400.0 * 400)
    code, _, found = run("report", log, "-o", tmp_path / "out", "--json")
    assert (code, found["kind"], found["has_truth"]) == (0, "telemetry log", False)
    assert 59.0 <= found["seconds"] <= 60.0  # a clock that was set back by a year makes no flight of a year
    words = checked_page(tmp_path / "out")
    assert re.search(r"\b\d{3} damaged bytes, in 1 stretch", words)
    assert "Its clock was set 1 time while" in words
    assert re.search(r"vehicles in telemetry 2\b", words)
    assert "AUTO" in words
    assert run("info", log, "--json")[2]["clock_jumps"] == 1


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("empty.tlog", b"", "is empty"),
        ("letter.txt", b"dear reader\n" * 200, "no MAVLink frame"),
        ("zeros.bin", bytes(300_000), "no MAVLink frame"),
        ("foreign.mcap", b"\x89MCAP0\r\n\x01" + bytes([8, *[0] * 15]), "has no records"),
        ("[red]odd.tlog", b"", "is empty"),
        ("radar.csv", b"t_s,x,y\n1,2,3\n", "--detections"),
    ],
)  # fmt: skip
def test_what_is_no_recording_is_refused_in_one_line(
    tmp_path: Path, name: str, content: bytes, words: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    code, text, _ = run("report", path, "-o", tmp_path / "out", "--no-timing")
    assert code == 2
    assert words in text
    assert name in text
    assert not (tmp_path / "out").exists() or name.endswith(".mcap")
    code, text, _ = run("replay", path, "--config", "prescribed")
    assert (code, name in text) == (2, True)
    if not name.endswith(".mcap"):
        code, text, _ = run("replay", path)
        assert (code, words in text) == (2, True)


def test_a_folder_without_a_recording_and_a_missing_file_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "nothing.tlog"):
        for command in (("report", path, "-o", tmp_path / "out"), ("info", path), ("replay", path)):
            code, text, _ = run(*command)
            assert code == 2
            assert ("has no recording" if path.is_dir() else "cannot be read") in text


@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared data are not here")
@pytest.mark.slow
@pytest.mark.parametrize("log", ["arduplane/three_planes.tlog", "flight_2015/flight.tlog"])
def test_logs_of_real_autopilots_are_shown(tmp_path: Path, log: str) -> None:
    code, _, found = run("report", SHARED / log, "-o", tmp_path, "--json")
    assert code == 0
    assert found["seconds"] > 300.0
    assert "Vehicle telemetry" in checked_page(tmp_path)


def test_a_run_in_parts_is_one_run_to_every_command(flight: Path, tmp_path: Path) -> None:
    made_with = read_info(flight)
    with Recorder(tmp_path / "run", made_with.config_text, {}, made_with.run, DiskBudget(60_000)) as recorder:
        for record in read(flight):
            if isinstance(record.value, Event):
                recorder.record_event(record.value)
            elif isinstance(record.value, Truth):
                recorder.record_truth(record.value)
            elif not isinstance(record.value, Damage):
                recorder.record_effect(record.t_ns, record.value)
            if record.sequence % 50 == 0:
                recorder.flush()
    assert (tmp_path / "run" / "run-002.mcap").is_file()
    code, _, found = run("replay", tmp_path / "run", "--verify", "--json")
    assert (code, found["verified"]) == (0, True)
    info = run("info", tmp_path / "run", "--json")[2]
    assert info["parts"] >= 2
    assert info["records"] == run("info", flight, "--json")[2]["records"]
    assert run("info", tmp_path / "run" / "run-002.mcap", "--json")[2]["damage"] == []
    code, text, _ = run("replay", tmp_path / "run" / "run-002.mcap", "--verify")
    assert code == 2
    assert "begins in the middle of a run" in text
