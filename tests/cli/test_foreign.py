"""Foreign recordings: detections with a log, and damaged files."""

from __future__ import annotations

import asyncio
import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rich.console import Console
from typer.testing import CliRunner

from gcs.cli import app
from gcs.cli.analyse.report_material import read_material
from gcs.cli.analyse.run_file import RunFile
from gcs.config import load
from gcs.io.detections import table_files
from gcs.io.detections.track_input import load as load_detections
from gcs.io.recording.reader import read, read_info
from gcs.io.recording.recorder import Recorder
from gcs.io.recording.tlog import LogFrame, read_log
from gcs.model import NS_PER_S, Event, Picture, Scan, Truth
from gcs.report.run.run_page import Material
from gcs.service.foreign_logs import DetectionFile, telemetry_records
from gcs.service.replay import Replay, Window

SHARED = Path(__file__).parents[3] / "shared" / "data"
MODEL = """
accel_psd_m2_s3 = 1.0
survival_probability = 0.99
detection_probability = 0.98
clutter_per_scan = 20.0
noise_std_m = 3.2
region_m = [-100.0, -100.0, 2100.0, 2100.0]
"""


def run(*arguments: object) -> tuple[int, str, dict[str, Any]]:
    """Exit code, everything printed, and the JSON of the last line (empty when there is none)."""
    result = CliRunner().invoke(app, [*map(str, arguments), "--json"], catch_exceptions=False)
    last = result.stdout.strip().splitlines()[-1:] if result.exit_code != 2 else []
    return result.exit_code, " ".join(result.output.split()), json.loads(last[0]) if last else {}


def with_glitch(tlog: Path, path: Path, at_s: tuple[float, float]) -> Path:
    """Move the reported positions of system 1 by 60 m for some seconds."""
    begin_ns = 0
    with tlog.open("rb") as file, path.open("wb") as out:
        for part in read_log(file):
            if not isinstance(part, LogFrame):
                continue
            begin_ns = begin_ns or part.t_ns
            data = part.frame.data
            in_glitch = at_s[0] <= (part.t_ns - begin_ns) / NS_PER_S < at_s[1]
            if in_glitch and (part.frame.system_id, part.frame.message_id) == (1, 33):
                message = part.frame.message()
                assert message is not None
                message.lat += round(60.0 / 111_200.0 * 1e7)
                packer = mavlink.MAVLink(None, 1, part.frame.component_id)
                packer.seq = part.frame.sequence
                data = message.pack(packer, force_mavlink1=data[0] == 0xFE)
            out.write((part.t_ns // 1000).to_bytes(8, "big") + data)
    return path


def check_jumps(tlog: Path, folder: Path, at_s: tuple[float, float]) -> None:
    """Check that a glitch is found, and nothing in the log as it is."""
    assert run("info", tlog)[2]["position_jumps"] == {}
    code, text, found = run("info", with_glitch(tlog, folder / "glitch.tlog", at_s))
    assert (code, list(found["position_jumps"])) == (0, ["1"])
    jumps = found["position_jumps"]["1"]
    assert [jump["t_s"] for jump in jumps] == pytest.approx(at_s, abs=1.5)
    assert [jump["size_m"] for jump in jumps] == pytest.approx([60.0, 60.0], abs=10.0)
    assert "Vehicle 1: the reported position jumps by" in text
    assert any("Vehicle 1: the reported" in remark for remark in reported(folder / "glitch.tlog").remarks)


def test_a_jump_of_a_gps_is_found_and_none_in_a_clean_log(flight: Path, tmp_path: Path) -> None:
    check_jumps(flight / "link.tlog", tmp_path, (10.0, 14.0))


@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared data are not here")
@pytest.mark.parametrize(
    ("log", "at_s"),
    [
        ("flight_2015/flight.tlog", (900.0, 906.0)),
        ("arduplane/three_planes.tlog", (200.0, 203.0)),
        ("px4/flights/11/link.tlog", (60.0, 70.0)),
    ],
)
def test_a_jump_of_a_gps_is_found_in_real_logs(log: str, at_s: tuple[float, float], tmp_path: Path) -> None:
    check_jumps(SHARED / log, tmp_path, at_s)


def raw_of(tlog: Path, path: Path) -> Path:
    """Leave the stamps of a log out."""
    with tlog.open("rb") as file:
        path.write_bytes(b"".join(part.frame.data for part in read_log(file) if isinstance(part, LogFrame)))
    return path


def reported(path: Path) -> Material:
    """What a report would show."""
    return read_material(RunFile(path), None, Console(quiet=True), timing=False)


@pytest.fixture(scope="module")
def scans(flight: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the radar of the flight saw, as a CSV with Unix times, and the model of the radar."""
    folder = tmp_path_factory.mktemp("scans")
    (folder / "radar.toml").write_text(MODEL)
    rows = ["t_ns,x,y"]
    for record in read(flight):
        if isinstance(record.value, Scan):
            t_ns = record.value.t_ns
            rows += [f"{t_ns},{x},{y}" for x, y in record.value.z_m] or [f"{t_ns},,"]
    (folder / "radar.csv").write_text("\n".join(rows) + "\n")
    return folder


def pictures_of(flight: Path, log: Path, options: DetectionFile | None) -> list[Picture]:
    config = load(str(flight / "mission.toml"))
    found: list[Picture] = []

    class Keep:
        def event(self, event: object) -> None:
            pass

        def effect(self, t_ns: int, effect: object) -> None:
            if isinstance(effect, Picture):
                found.append(effect)

    replay = Replay(config, 3, telemetry_records(log, [a.vehicle for a in config.agents], options), Window())
    replay.sinks.append(Keep())
    asyncio.run(replay.run(asyncio.Event(), float("inf")))
    return found


def missed_m(flight: Path, pictures: list[Picture], kind: str) -> list[float]:
    """Distance from each living object at the end to the nearest track in the estimate."""
    last = [picture for picture in pictures if picture.kind == kind][-1]
    truth = [record.value for record in read(flight) if isinstance(record.value, Truth)][-1]
    tracks = [track.mean[:2] for track in last.tracks if track.estimated]
    alive = [o for o in truth.objects if o.kind == kind and o.alive]
    assert len(tracks) == len(alive)
    return [min(np.hypot(*(track - (o.east_m, o.north_m))) for track in tracks) for o in alive]


@pytest.mark.parametrize("unit", ["t_ns", "t_s", "recording"])
def test_both_trackers_use_detections_given_with_a_log(
    flight: Path, scans: Path, tmp_path: Path, unit: str
) -> None:
    path, offset_s = scans / "radar.csv", 0.0
    if unit == "recording":
        path = flight
    elif unit == "t_s":  # on a clock of its own, that began ten seconds before the log
        with (flight / "link.tlog").open("rb") as file:
            start_ns = next(part.t_ns for part in read_log(file) if isinstance(part, LogFrame))
        rows = [line.split(",", 1) for line in path.read_text().splitlines()[1:]]
        text = "\n".join(f"{(int(t_ns) - start_ns) / 1e9 + 10.0:.6f},{rest}" for t_ns, rest in rows)
        path, offset_s = tmp_path / "radar.csv", -10.0
        path.write_text(f"t_s,x,y\n{text}\n")
    model = None if unit == "recording" else scans / "radar.toml"
    detections = load_detections(path, model, None)
    pictures = pictures_of(flight, flight / "link.tlog", DetectionFile(path.name, detections, offset_s))
    for kind in ("agents", "targets"):
        assert max(missed_m(flight, pictures, kind)) < 25.0
    times = [picture.scan_t_ns for picture in pictures if picture.kind == "targets"]
    assert times == sorted(times)
    assert len(times) <= len(detections.scans)


def test_events_enter_in_the_order_of_time(flight: Path, scans: Path) -> None:
    detections = load_detections(scans / "radar.csv", scans / "radar.toml", None)
    records = telemetry_records(flight / "link.tlog", [1, 2, 3, 4], DetectionFile("radar", detections, 2.5))
    events = [record.value for record in records]
    times = [event.t_ns for event in events if isinstance(event, Event)]
    assert times == sorted(times)
    seen = [event for event in events if isinstance(event, Scan)]
    assert {scan.sensor.name for scan in seen} == {"radar.csv"}
    assert len(seen) == len(detections.scans) - 3


def test_a_replay_with_detections_from_the_command_line(flight: Path, scans: Path) -> None:
    log = (flight / "link.tlog", "--config", flight / "mission.toml", "--headless")
    options = ("--detections", scans / "radar.csv", "--model", scans / "radar.toml")
    code, _, found = run("replay", *log, *options)
    assert (code, found["damage"]) == (0, None)
    code, text, _ = run("replay", *log, *options, "--offset", 1000)
    assert code == 2
    assert "none of its 26 scans is within the 2" in text
    assert "--offset" in text
    code, text, _ = run("replay", flight, *options)
    assert code == 2
    assert "--detections is for logs" in text
    code, text, _ = run("replay", *log, "--detections", scans / "radar.csv")
    assert code == 2
    assert "--model" in text


def test_a_report_shows_both_trackers_for_detections_with_a_log(
    flight: Path, scans: Path, tmp_path: Path
) -> None:
    log = (flight / "link.tlog", "-o", tmp_path / "report")
    options = ("--detections", scans / "radar.csv", "--model", scans / "radar.toml")
    code, _, found = run("report", *log, "--config", flight / "mission.toml", *options)
    assert (code, found["kind"]) == (0, "telemetry log")
    with Path(found["tracks"]).open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["estimated"] == "1"]
    truth = [record.value for record in read(flight) if isinstance(record.value, Truth)][-1]
    for kind in ("agents", "targets"):
        last = max(float(row["t"]) for row in rows if row["kind"] == kind)
        places = [(float(r["x"]), float(r["y"])) for r in rows if r["kind"] == kind and float(r["t"]) == last]
        alive = [(o.east_m, o.north_m) for o in truth.objects if o.kind == kind and o.alive]
        assert len(places) == len(alive)
        assert max(min(np.hypot(x - e, y - n) for x, y in places) for e, n in alive) < 25.0
    code, text, _ = run("report", *log, *options)
    assert code == 2
    assert "name it with --config" in text
    code, text, _ = run("report", *log, "--config", flight / "mission.toml", *options, "--offset", 1000)
    assert code == 2
    assert "shift them with --offset" in text
    code, text, _ = run("report", flight, *options)
    assert code == 2
    assert "--detections is for logs" in text


def test_mavlink_without_time_stamps_is_refused(flight: Path, tmp_path: Path) -> None:
    raw = raw_of(flight / "link.tlog", tmp_path / "uart.bin")
    for command in (("info",), ("report",), ("replay", "--config", flight / "mission.toml", "--headless")):
        code, text, _ = run(command[0], raw, *command[1:])
        assert code == 2
        assert "without time stamps: expected a .tlog" in text


def test_a_log_out_of_order_never_runs_back(flight: Path, tmp_path: Path) -> None:
    with (flight / "link.tlog").open("rb") as file:
        parts = [part for part in read_log(file) if isinstance(part, LogFrame)]
    order = np.argsort(np.arange(len(parts)) + np.random.default_rng(1).uniform(0, 40, len(parts)))
    data = b"".join((parts[i].t_ns // 1000).to_bytes(8, "big") + parts[i].frame.data for i in order)
    (tmp_path / "mixed.tlog").write_bytes(data)
    times = [record.t_ns for record in telemetry_records(tmp_path / "mixed.tlog", [1, 2, 3, 4])]
    assert times == sorted(times)
    mixed, whole = (run("info", path)[2] for path in (tmp_path / "mixed.tlog", flight / "link.tlog"))
    assert mixed["seconds"] == whole["seconds"]


def test_detections_that_break_off_are_tracked_up_to_there(flight: Path, scans: Path, tmp_path: Path) -> None:
    (tmp_path / "radar.toml").write_text(MODEL + "[anywhere]\nper_s = 0.1\n")
    text = (scans / "radar.csv").read_text()
    (tmp_path / "cut.csv").write_text(text[: text.rindex(",")])
    code, said, found = run("track", tmp_path / "cut.csv", "--model", tmp_path / "radar.toml")
    assert (code, found["scans"]) == (0, 26)
    assert "the last, breaks off and is left out" in said
    (tmp_path / "bad.csv").write_text(text.replace("\n", "\nwhat is this\n", 40))
    assert run("track", tmp_path / "bad.csv", "--model", tmp_path / "radar.toml")[0] == 2
    with Recorder(tmp_path / "run", read_info(flight).config_text, {}) as recorder:
        for record in read(flight):
            if isinstance(record.value, Event):
                recorder.record_event(record.value)
            if record.sequence % 200 == 0:
                recorder.flush()
    mcap = tmp_path / "run" / "run.mcap"
    mcap.write_bytes(mcap.read_bytes()[: mcap.stat().st_size * 2 // 3])
    code, said, found = run("track", tmp_path / "run")
    assert code == 0
    assert 5 < found["scans"] < 26
    assert "cut off" in said
    assert "breaks off" in found["remarks"][0]


def test_files_that_would_not_fit_into_memory_are_refused_before_they_are_read(
    scans: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table_files, "MAX_NUMBERS", 100)
    code, text, _ = run("track", scans / "radar.csv", "--model", scans / "radar.toml")
    assert code == 2
    assert "holds more than 100 numbers" in text
    np.savez_compressed(tmp_path / "bomb.npz", meas=np.zeros((1000, 3)))
    code, text, _ = run("track", tmp_path / "bomb.npz", "--model", scans / "radar.toml")
    assert code == 2
    assert "unpacks to" in text


@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared data are not here")
def test_shared_logs_and_detections_go_together(tmp_path: Path) -> None:
    log = SHARED / "arduplane" / "three_planes.tlog"
    with log.open("rb") as file:
        positions = [
            message
            for part in read_log(file)
            if isinstance(part, LogFrame)
            and part.frame.message_id == 33
            and (message := part.frame.message())
        ]
    text = Path("config/scenarios/prescribed.toml").read_text(encoding="utf-8")
    text = text.replace("lat_deg = 33.2000", f"lat_deg = {positions[0].lat / 1e7 - 0.009}")
    text = text.replace("lon_deg = -87.6000", f"lon_deg = {positions[0].lon / 1e7 - 0.011}")
    (tmp_path / "mission.toml").write_text(text, encoding="utf-8")
    demo = SHARED / "vo_linear_gaussian" / "demo_mc00.npz"
    code, _, found = run(
        "replay", log, "--config", tmp_path / "mission.toml", "--headless", "--to", 20,
        "--detections", demo, "--offset", 10,
    )  # fmt: skip
    assert code == 0
    assert found["seconds"] == pytest.approx(20.0, abs=1.0)
