"""A flight replays exactly, says where it does not, and says what other settings would have changed."""

import asyncio
import json
import math
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from typer.testing import CliRunner

from gcs.cli import app
from gcs.cli.analyse.playback import ReplayOptions, open_source
from gcs.cli.analyse.run_file import RunFile
from gcs.config import load, parse
from gcs.core.snapshot import encode_state
from gcs.io.record_json import encode
from gcs.io.recording.folder import Run
from gcs.io.recording.index import snapshot_places
from gcs.io.recording.reader import Damage, Record, read, read_info
from gcs.io.recording.recorder import Recorder
from gcs.io.recording.topics import Recordable
from gcs.model import (
    NS_PER_S,
    BadInput,
    Datagram,
    LaggedPicture,
    Notice,
    NoticeCode,
    Picture,
    Plan,
    Scan,
    Send,
    Snapshot,
    Tick,
    Truth,
    read_only,
)
from gcs.service.foreign_logs import telemetry_records
from gcs.service.replay import Replay, Window
from sim_vehicles.campaign.simulate import fly
from sim_vehicles.world.scenario import load as load_scenario
from sim_vehicles.world.scenario import parse_scenario

EVENTS = (Datagram, Scan, Tick, BadInput)
Rows = list[tuple[int, Recordable]]


def replay(*arguments: object) -> tuple[int, str, dict[str, Any]]:
    """Exit code, everything printed, and the JSON of the last line (empty when there is none)."""
    result = CliRunner().invoke(app, ["replay", *map(str, arguments), "--json"], catch_exceptions=False)
    last = result.stdout.strip().splitlines()[-1:] if result.exit_code != 2 else []
    return result.exit_code, " ".join(result.output.split()), json.loads(last[0]) if last else {}


def written(folder: Path, records: Iterable[tuple[int, Recordable]], run: Run | None, config: str) -> Path:
    with Recorder(folder, config, {}, run) as recorder:
        for t_ns, value in records:
            if isinstance(value, EVENTS):
                recorder.record_event(value)
            elif isinstance(value, Truth):
                recorder.record_truth(value)
            elif isinstance(value, Snapshot):
                recorder.record_snapshot(value)
            else:
                recorder.record_effect(t_ns, value)
    return folder


def changed(
    flight: Path, folder: Path, change: Callable[[list[Record]], list[tuple[int, Recordable]]]
) -> Path:
    """Write the flight again with a change to its records."""
    made_with = read_info(flight)
    return written(folder, change(list(read(flight))), made_with.run, made_with.config_text)


def plain(record: Record) -> tuple[int, Recordable]:
    assert not isinstance(record.value, Damage)
    return record.t_ns, record.value


def test_a_flight_replays_byte_for_byte(flight: Path) -> None:
    code, text, found = replay(flight, "--verify")
    recorded = [record for record in read(flight) if isinstance(record.value, Picture | Plan | Send)]
    assert (code, found["verified"], found["different"]) == (0, True, 0)
    assert "equal, byte for byte" in text
    counted = found["equal"]
    assert counted["/effect/plan"] >= 1
    assert counted["/effect/send"] > 100
    assert sum(
        counted[topic]
        for topic in ("/effect/picture/agents", "/effect/picture/targets", "/effect/plan", "/effect/send")
    ) == len(recorded)
    assert 24.0 < found["seconds"] < 26.0


def test_late_pictures_are_recorded_and_a_flight_with_them_replays(tmp_path: Path) -> None:
    text = load_scenario("prescribed").text
    text = text.replace("[tracking.agents]", "[tracking]\nlag_scans = 2\n[tracking.agents]", 1)
    fly(parse_scenario(text, "late.toml"), 3, tmp_path / "late", duration_s=10.0)
    late = [record.value for record in read(tmp_path / "late", only=(LaggedPicture,))]
    assert {one.kind for one in late} == {"agents", "targets"}
    assert all(0 < one.t_ns - one.scan_t_ns < 4 * NS_PER_S for one in late)
    assert any(one.tracks for one in late)
    for window in ([], ["--from", "6"]):
        code, _, found = replay(tmp_path / "late", "--verify", *window)
        assert (code, found["verified"], found["different"]) == (0, True, 0)


def test_a_replay_from_the_middle_begins_at_a_snapshot_and_has_the_same_effects(flight: Path) -> None:
    _, _, whole = replay(flight, "--verify")
    code, _, found = replay(flight, "--verify", "--from", "15", "--to", "22")
    assert (code, found["verified"], found["different"]) == (0, True, 0)
    assert found["equal"]["/effect/send"] > 30
    assert found["events"] < 0.6 * whole["events"]
    assert 21.0 < found["seconds"] < 22.5


def test_a_replay_that_begins_anywhere_has_scans_before_the_time_to_show(flight: Path) -> None:
    """A paused page would show targets without their tracks."""
    options = ReplayOptions(RunFile(flight), None, Window(), False, False, False)
    source = open_source(options, Console(quiet=True))
    assert source.records_from is not None
    assert source.start_t_ns is not None
    for at_s in (10.01, 20.01, 25.0, 1000.0):
        at_ns = source.start_t_ns + round(at_s * NS_PER_S)
        records = [record for record in source.records_from(at_ns) if record.t_ns < at_ns]
        assert any(isinstance(record.value, Scan) for record in records)


def test_a_start_behind_the_end_is_said(flight: Path) -> None:
    code, text, _ = replay(flight, "--headless", "--from", "1000")
    assert code == 0
    assert "nothing to show: it ends at 25" in text


def test_a_snapshot_that_cannot_be_used_is_one_line(flight: Path, tmp_path: Path) -> None:
    def change(records: list[Record]) -> Rows:
        rows = [plain(record) for record in records]
        return [(t, replace(v, data=b"x" + v.data) if isinstance(v, Snapshot) else v) for t, v in rows]

    code, text, _ = replay(changed(flight, tmp_path / "run", change), "--headless", "--from", "15")
    assert code == 2
    assert "snapshot that cannot be used" in text
    assert "replay it from its start" in text


def test_a_replay_goes_back_and_forth(flight: Path) -> None:
    """The state at a time is the same from whichever side it is reached."""
    info, times_s, states = read_info(flight), [18.0, 3.0, 24.0, 12.5, 12.5, 0.0], []
    places = snapshot_places(flight)
    start_t_ns = next(iter(read(flight))).t_ns

    def records_from(t_ns: int) -> Iterator[Record]:
        before = [place for place in places if place.t_ns < t_ns]
        return read(flight, start=before[-1] if before else None)

    def reached(at_s: float) -> bytes:
        run = Replay(parse(info.config_text, "x"), 3, read(flight), Window(to_s=at_s))
        asyncio.run(run.run(asyncio.Event(), math.inf))
        return encode_state(run.engine.state)

    async def scrub() -> None:
        config = parse(info.config_text, "x")
        run = Replay(config, 3, read(flight), Window(), start_t_ns, records_from)
        run.playback.stays_at_end, stop = True, asyncio.Event()
        playing = asyncio.create_task(run.run(stop, math.inf))
        for at_s in times_s:
            run.playback.is_paused = True
            run.playback.seek(at_s)
            while run.playback.restart_s is not None or run.playback.at_s < at_s - 0.06:
                await asyncio.sleep(0.01)
            await asyncio.sleep(0.15)
            states.append(encode_state(run.engine.state))
        stop.set()
        await playing

    asyncio.run(scrub())
    for wanted_s, state in zip(times_s, states, strict=True):
        assert state == reached(np.nextafter(wanted_s, -1.0))


def test_a_recording_that_begins_with_the_truth_is_verified(flight: Path, tmp_path: Path) -> None:
    def change(records: list[Record]) -> Rows:
        rows = [plain(record) for record in records]
        return [(rows[0][0], Truth(rows[0][0], ())), *rows]

    code, text, found = replay(changed(flight, tmp_path / "run", change), "--verify")
    assert (code, found["verified"]) == (0, True), text


def test_a_changed_byte_is_found_and_named(flight: Path, tmp_path: Path) -> None:
    at = next(i for i, r in enumerate(read(flight)) if isinstance(r.value, Picture) and r.sequence > 600)

    def change(records: list[Record]) -> Rows:
        rows = [plain(record) for record in records]
        picture = rows[at][1]
        assert isinstance(picture, Picture)
        rows[at] = (
            rows[at][0],
            replace(picture, cardinality=read_only(np.nextafter(picture.cardinality, 2.0))),
        )
        return rows

    code, text, found = replay(changed(flight, tmp_path / "run", change), "--verify")
    first = found["first_difference"]
    assert (code, found["different"], first["number"]) == (1, 1, at)
    assert first["topic"].startswith("/effect/picture/")
    assert first["recorded"] != first["replayed"]
    assert len(first["recorded"]) < 200
    assert f"record {at} at" in text


def test_a_record_that_is_missing_is_found(flight: Path, tmp_path: Path) -> None:
    def change(records: list[Record]) -> Rows:
        first = next(i for i, record in enumerate(records) if isinstance(record.value, Plan))
        return [plain(record) for i, record in enumerate(records) if i != first]

    code, _, found = replay(changed(flight, tmp_path / "run", change), "--verify")
    assert code == 1
    assert found["first_difference"]["replayed"] != "nothing"
    assert found["first_difference"]["topic"] in ("/effect/plan", "/effect/send", "/effect/notice")


def test_a_record_too_many_is_found(flight: Path, tmp_path: Path) -> None:
    def change(records: list[Record]) -> Rows:
        rows = [plain(record) for record in records]
        return [
            *rows,
            (rows[-1][0], Notice(rows[-1][0], NoticeCode.AUTOPILOT_INFO, 1, {"said": "never said"})),
        ]

    code, _, found = replay(changed(flight, tmp_path / "run", change), "--verify")
    assert (code, found["different"]) == (1, 1)
    assert found["first_difference"]["replayed"] == "nothing"
    assert '"autopilot-info"' in found["first_difference"]["recorded"]


def test_notices_of_the_service_are_no_difference(flight: Path, tmp_path: Path) -> None:
    def change(records: list[Record]) -> Rows:
        rows = [plain(record) for record in records]
        events = [i for i, row in enumerate(rows) if isinstance(row[1], EVENTS)]
        at = events[len(events) // 2]
        t_ns = rows[at][0]
        rows.insert(at, (t_ns, Notice(t_ns, NoticeCode.SERVICE_SLOW)))
        return rows

    code, _, found = replay(changed(flight, tmp_path / "run", change), "--verify")
    assert (code, found["verified"]) == (0, True)


def test_another_seed_does_not_give_the_same(flight: Path) -> None:
    code, _, found = replay(flight, "--verify", "--seed", 4)
    assert code == 1
    assert found["first_difference"]["topic"].startswith("/effect/")


def test_a_recording_without_a_seed_asks_for_it(flight: Path, tmp_path: Path) -> None:
    records = [plain(record) for record in read(flight)][:2000]
    while not isinstance(records[-1][1], Tick):
        records.pop()
    records.pop()
    old = written(tmp_path / "old", records, None, read_info(flight).config_text)
    code, text, _ = replay(old, "--verify")
    assert code == 2
    assert "--seed" in text
    assert replay(old, "--verify", "--seed", 3)[0] == 0


def test_a_cut_off_flight_is_replayed_up_to_the_break(flight: Path, tmp_path: Path) -> None:
    data = (flight / "run.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 9 // 10])
    code, text, found = replay(tmp_path / "cut.mcap", "--verify")
    assert code == 0
    assert "ends early" in text
    assert found["damage"]["offset"] <= len(data) * 9 // 10


def test_an_event_whose_effects_were_never_written_is_no_difference(flight: Path, tmp_path: Path) -> None:
    made_with = read_info(flight)
    recorder = Recorder(tmp_path / "run", made_with.config_text, {}, made_with.run)
    scans = 0
    for record in read(flight):
        t_ns, value = plain(record)
        scans += isinstance(value, Scan)
        if isinstance(value, EVENTS):
            recorder.record_event(value)
        elif not isinstance(value, Truth):
            recorder.record_effect(t_ns, value)
        if scans == 10:
            break
    recorder.flush()  # and the process is killed
    code, _, found = replay(tmp_path / "run", "--verify")
    assert (code, found["verified"]) == (0, True)
    assert found["equal"]["/effect/picture/agents"] == 9
    assert "cut off" in found["damage"]["problem"]


def seconds_shown(text: str) -> list[float]:
    """Return the times of the lines about an agent that a replay prints."""
    return [float(seconds) for seconds in re.findall(r"(\d+\.\d\d) s agent \d", text)]


def test_a_window_is_shown_and_compared_alone(flight: Path) -> None:
    code, _, found = replay(flight, "--verify", "--from", 10, "--to", 20)
    assert (code, found["verified"]) == (0, True)
    assert 19.9 < found["seconds"] <= 20.0
    assert found["equal"]["/effect/picture/agents"] == found["equal"]["/effect/picture/targets"] == 11
    _, whole, _ = replay(flight, "--headless")
    for from_s in (10.0, 15.0):  # from the start of the recording, and from a snapshot
        _, text, _ = replay(flight, "--from", from_s, "--to", 22, "--headless")
        shown = [seconds for seconds in seconds_shown(whole) if from_s <= seconds <= 22.0]
        assert seconds_shown(text) == shown != []


def test_the_same_mission_file_changes_nothing(flight: Path) -> None:
    code, text, found = replay(flight, "--config", flight / "mission.toml", "--headless")
    assert code == 0
    assert found["settings"] == []
    assert not any(row["differs"] for row in found["outcome"])
    assert "the results are the same" in text


def test_another_mission_file_shows_what_differs(flight: Path, tmp_path: Path) -> None:
    text = (flight / "mission.toml").read_text(encoding="utf-8")
    assert "\n[planning]\n" in text
    other = tmp_path / "other.toml"
    other.write_text(text.replace("\n[planning]\n", "\n[planning]\naim = 'position'\n"), encoding="utf-8")
    code, _, found = replay(flight, "--config", other, "--headless")
    assert code == 0
    assert found["settings"] == [{"what": "planning.aim", "recorded": "intercept", "replayed": "position"}]
    assert any(row["differs"] for row in found["outcome"])


def test_telemetry_alone_drives_the_picture_of_the_agents(flight: Path, tmp_path: Path) -> None:
    config = load(str(flight / "mission.toml"))
    ids = [agent.system_id for agent in config.agents]
    pictures: list[Picture] = []

    class Keep:
        def event(self, event: object) -> None:
            pass

        def effect(self, t_ns: int, effect: object) -> None:
            if isinstance(effect, Picture) and effect.kind == "agents":
                pictures.append(effect)

    run = Replay(config, 3, telemetry_records(flight / "link.tlog", ids), Window())
    run.sinks.append(Keep())
    asyncio.run(run.run(asyncio.Event(), float("inf")))
    truth = [record.value for record in read(flight) if isinstance(record.value, Truth)][-1]
    seen = np.array([track.mean[:2] for track in pictures[-1].tracks if track.estimated])
    alive = [o for o in truth.objects if o.kind == "agents" and o.alive]
    assert len(seen) == len(alive)
    for one in alive:
        assert np.hypot(*(seen - (one.east_m, one.north_m)).T).min() < 40.0


def test_a_tlog_is_replayed_with_a_mission_file(flight: Path) -> None:
    code, _, found = replay(flight / "link.tlog", "--config", flight / "mission.toml", "--headless")
    assert code == 0
    assert found["events"] > 500
    assert found["effects"] > 50


def test_a_tlog_is_replayed_without_a_mission_file(flight: Path) -> None:
    """The vehicles, their speed and the map come from the log; agents are tracked where they flew."""
    code, text, found = replay(flight / "link.tlog", "--headless")
    assert code == 0
    assert "mission from the log: agents 1, 2, 3, 4, no targets, 15" in text
    assert "gcs init" in text
    assert found["events"] > 500
    assert found["effects"] > 50


def test_a_tlog_without_the_missions_vehicles_names_its_vehicles(flight: Path, tmp_path: Path) -> None:
    text = (flight / "mission.toml").read_text(encoding="utf-8")
    other = tmp_path / "other.toml"
    other.write_text(text.replace("system_id = ", "system_id = 10"), encoding="utf-8")
    code, text, _ = replay(flight / "link.tlog", "--config", other)
    assert code == 2
    assert "its systems are 1, 2, 3, 4, 255" in text


def test_mistakes_are_named(flight: Path, tmp_path: Path) -> None:
    (tmp_path / "text.txt").write_text("no recording at all")
    (tmp_path / "empty").mkdir()
    tlog = flight / "link.tlog"
    for arguments, expected in [
        ((tmp_path / "nothing",), "No such file"),
        ((tmp_path / "empty",), "has no recording"),
        ((tmp_path / "text.txt",), "no MAVLink frame"),
        ((tmp_path / "text.txt", "--config", "prescribed"), "no recording"),
        ((tmp_path / "text.txt", "--headless"), "no MAVLink frame"),
        ((tlog, "--config", "prescribed", "--verify"), "no outputs to verify"),
        ((flight, "--speed", "fast"), "neither a positive number nor"),
        ((flight, "--speed", "0"), "neither a positive number nor"),
        ((flight, "--config", "no-such-scenario"), "no such file or scenario"),
    ]:
        code, text, _ = replay(*arguments)
        assert code == 2, arguments
        assert expected in text, arguments


def test_an_interrupt_ends_it_in_order(flight: Path) -> None:
    process = subprocess.Popen(
        [
            sys.executable,
            "-P",
            "-c",
            "from gcs.cli import main; main()",
            "replay",
            str(flight),
            "--speed",
            "1",
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    try:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "replayed" in rest
    assert "Traceback" not in rest


def test_payloads_equal_the_recorded_ones(flight: Path) -> None:
    """Verification compares them: they must be the bytes that the recorder would write again."""
    for record in read(flight):
        assert not isinstance(record.value, Damage)
        assert encode(record.value) == record.payload
