"""`gcs info` shows the content of any recording, also of a damaged one."""

import json
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v10 import ardupilotmega as mavlink1
from pymavlink.dialects.v20 import ardupilotmega as mavlink2
from typer.testing import CliRunner

from gcs.cli import app

T0_US = 1_436_056_003_000_000


class Writer:
    """A log of several senders, one packer for each."""

    def __init__(self) -> None:
        self.entries: list[bytes] = []
        self._packers: dict[tuple[int, int], Any] = {}

    def say(self, at_s: float, message: Any, system: int, component: int = 1, skip: int = 0) -> None:
        dialect = mavlink1 if type(message).__module__ == mavlink1.__name__ else mavlink2
        packer = self._packers.setdefault((system, component), dialect.MAVLink(None, system, component))
        packer.seq = (packer.seq + skip) % 256
        stamp = (T0_US + int(at_s * 1e6)).to_bytes(8, "big")
        self.entries.append(stamp + message.pack(packer))
        packer.seq = (packer.seq + 1) % 256


def heartbeat(dialect: Any = mavlink2, *, ground: bool = False) -> Any:
    if ground:
        return dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    return dialect.MAVLink_heartbeat_message(1, 3, 81, 10, 4, 3)


def a_log() -> list[bytes]:
    """Two vehicles at 1 Hz for a minute, one MAVLink 1, lossy and silent for a while; a ground station."""
    log = Writer()
    version = mavlink2.MAVLink_autopilot_version_message
    log.say(
        0.0,
        version(0, (4 << 24) | (6 << 16) | (3 << 8) | 255, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0),
        1,
    )
    for second in range(60):
        log.say(second, heartbeat(), 1)
        if not 20 <= second < 30:
            log.say(second + 0.1, heartbeat(mavlink1), 2, skip=3 if second == 40 else 0)
        log.say(second + 0.2, heartbeat(ground=True), 255, 190)
        log.say(second + 0.25, mavlink2.MAVLink_attitude_message(second, 0, 0, 0, 0, 0, 0), 1)
    log.say(60.0, mavlink2.MAVLink_mission_count_message(1, 1, 2), 255, 190)
    log.say(60.1, mavlink2.MAVLink_mission_count_message(1, 1, 2), 255, 190)
    for seq in range(2):
        item = mavlink2.MAVLink_mission_item_int_message(1, 1, seq, 3, 16, 0, 1, 0, 0, 0, 0, 1, 2, 3.0)
        log.say(60.2 + seq / 10, item, 255, 190)
        log.say(
            60.25 + seq / 10, mavlink2.MAVLink_mission_ack_message(255, 190, 13), 1
        )  # ArduPilot: a repeated item
    log.say(60.5, mavlink2.MAVLink_mission_ack_message(255, 190, 0), 1)
    return log.entries


def info(path: Path) -> tuple[int, str, dict[str, Any]]:
    result = CliRunner().invoke(app, ["info", str(path), "--json"], catch_exceptions=False)
    found = json.loads(result.stdout.strip().splitlines()[-1]) if result.exit_code == 0 else {}
    return result.exit_code, " ".join(result.output.split()), found


@pytest.fixture
def log(tmp_path: Path) -> dict[str, Any]:
    (tmp_path / "a.tlog").write_bytes(b"".join(a_log()))
    code, _, found = info(tmp_path / "a.tlog")
    assert code == 0
    return found


def test_who_is_in_it_and_for_how_long(log: dict[str, Any]) -> None:
    assert (log["kind"], log["seconds"]) == ("tlog", 60.5)
    first, second = log["vehicles"]
    assert (first["system"], first["component"], first["type"]) == (1, 1, "fixed_wing")
    assert (first["autopilot"], first["firmware"], first["mavlink"]) == ("ardupilotmega", "4.6.3", "2")
    assert (second["system"], second["mavlink"], second["firmware"]) == (2, "1", "")
    assert [station["system"] for station in log["ground_stations"]] == [255]
    assert log["damage"] == []


def test_rates_loss_and_gaps(log: dict[str, Any]) -> None:
    first, second = log["vehicles"]
    assert first["messages"]["ATTITUDE"] == {"count": 60, "rate_hz": 1.0}
    assert (first["lost"], first["gap_count"]) == (0, 0)
    assert second["lost"] == 3
    assert second["gaps"] == [{"t_ns": (T0_US + 19_100_000) * 1000, "seconds": 11.0}]
    assert log["ground_stations"][0]["lost"] is None


def test_missions_and_how_they_ended(log: dict[str, Any]) -> None:
    (mission,) = log["missions"]
    assert (mission["from"], mission["to"], mission["items"], mission["items_seen"]) == (255, 1, 2, 2)
    assert mission["result"] == "ACCEPTED"


def test_damage_is_reported_and_skipped(tmp_path: Path) -> None:
    entries = a_log()
    data = b"".join(entries[:100]) + b"\x00\xfd\xfe junk" * 10 + b"".join(entries[100:])
    (tmp_path / "a.tlog").write_bytes(data + entries[-1][:9])
    code, text, found = info(tmp_path / "a.tlog")
    assert code == 0
    assert found["frames"] == len(entries)
    assert found["damage"] == [
        {"offset": len(b"".join(entries[:100])), "bytes": 80},
        {"offset": len(data), "bytes": 9},
    ]
    assert "89 bytes are damaged" in text


def test_a_bad_checksum_is_counted_by_sender(tmp_path: Path) -> None:
    entries = a_log()
    entries[4] = entries[4][:-1] + bytes([entries[4][-1] ^ 0xFF])
    (tmp_path / "a.tlog").write_bytes(b"".join(entries))
    _, text, found = info(tmp_path / "a.tlog")
    assert found["bad_checksums"] == [{"system": 1, "component": 1, "message_id": 30, "count": 1}]
    assert found["vehicles"][0]["lost"] == 1
    assert "bad checksum" in text


def test_a_recording_of_ours(flight: Path) -> None:
    code, text, found = info(flight)
    assert (code, found["kind"], found["scenario"], found["seed"]) == (0, "recording", "random-obstacles", 3)
    assert found["records"]["/event/scan"] == {"count": 26, "rate_hz": 1.0}
    assert found["sensors"]["radar"]["scans"] == 26
    assert [vehicle["system"] for vehicle in found["vehicles"]] == [1, 2, 3, 4]
    assert found["missions"][0]["result"] == "ACCEPTED"
    assert found["damage"] == []
    assert "seed 3" in text


def test_its_own_tlog_holds_the_same_traffic(flight: Path) -> None:
    ours, log = info(flight)[2], info(flight / "link.tlog")[2]
    assert log["frames"] == ours["frames"]
    assert log["vehicles"][0]["messages"].keys() == ours["vehicles"][0]["messages"].keys()


def test_a_truncated_recording_is_shown_up_to_its_end(flight: Path, tmp_path: Path) -> None:
    data = (flight / "run.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) * 9 // 10])
    code, text, found = info(tmp_path / "cut.mcap")
    assert (code, found["seed"]) == (0, 3)
    assert len(found["damage"]) == 1
    assert "ends early" in text


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, "No such file"),
        (b"", "is empty"),
        (b"Dear diary, today we flew. " * 1000, "no MAVLink frame"),
        (b"\x89MCAP0\r\n", "cut off"),
    ],
)
def test_a_file_of_another_kind_is_refused(tmp_path: Path, content: bytes | None, expected: str) -> None:
    if content is not None:
        (tmp_path / "file").write_bytes(content)
    code, text, _ = info(tmp_path / "file")
    assert code == (0 if expected == "cut off" else 2)
    assert expected in text


def test_detections_are_shown_with_rate_gaps_and_disorder(tmp_path: Path) -> None:
    times = [0.5 * k for k in range(40)] + [60.0, 30.0]
    text = "t_s,x,y\n" + "".join(f"{t},{10 * t},2.0\n{t},inf,1.0\n" for t in times) + "61.0,,\n62.0,"
    (tmp_path / "radar.csv").write_text(text)
    code, text, found = info(tmp_path / "radar.csv")
    assert (code, found["kind"], found["scans"], found["detections"]) == (0, "detections", 43, 42)
    assert (found["rate_hz"], found["gap_count"], found["not_finite"]) == (2.0, 2, 42)
    assert found["gaps"][0] == {"at": 19.5, "length": 10.5}
    assert found["out_of_order"] == 1
    assert "43 scans at 2 Hz" in text
    assert "not finite" in text
    (tmp_path / "no.csv").write_text("dear reader\nhow are you\n")
    result = CliRunner().invoke(app, ["info", str(tmp_path / "no.csv")])
    assert result.exit_code == 2
    assert "found dear reader: rename the columns" in " ".join(result.output.split())


def test_a_large_file_of_something_else_is_refused_at_once(tmp_path: Path) -> None:
    with (tmp_path / "disk.img").open("wb") as file:
        file.truncate(3_000_000_000)  # sparse: zeros that take no space
    result = CliRunner().invoke(app, ["info", str(tmp_path / "disk.img")])
    assert result.exit_code == 2
    assert "no MAVLink frame is in its first 16 MB" in " ".join(result.output.split())
