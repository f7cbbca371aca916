"""An engineer would convert an autopilot's own log before our commands read it, or be misled by it."""

import re
import struct
from contextlib import suppress

import numpy as np
import pytest

from gcs.errors import RecordingError
from gcs.io.onboard_logs import log_kind, open_telemetry
from gcs.io.recording.tlog import LogFrame, read_log
from gcs.mavlink.frames.codec import decode

# ------------------------------------------------------------ a DataFlash log


FORMATS = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns", "<BB4s16s64s"),
    "PARM": (64, "QNff", "TimeUS,Name,Value,Default", "<Q16sff"),
    "MSG": (65, "QZ", "TimeUS,Message", "<Q64s"),
    "ORGN": (66, "QBLLf", "TimeUS,Type,Lat,Lng,Alt", "<QBiif"),
    "MODE": (67, "QMBB", "TimeUS,Mode,ModeNum,Rsn", "<QBBB"),
    "ARM": (68, "QBI", "TimeUS,ArmState,ArmChecks", "<QBI"),
    "XKF1": (69, "QBfff", "TimeUS,C,VN,VE,VD", "<QBfff"),
    "POS": (70, "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt", "<Qiifff"),
    "BAT": (71, "QBfffB", "TimeUS,Inst,Volt,Curr,CurrTot,RemPct", "<QBfffB"),
    "MISE": (72, "QHHH", "TimeUS,CTot,CNum,CId", "<QHHH"),
}


def record(name, *values):
    number, _, _, packing = FORMATS[name]
    return b"\xa3\x95" + bytes([number]) + struct.pack(packing, *values)


def dataflash(samples=50):
    data = b""
    for name, (number, kinds, columns, packing) in FORMATS.items():
        length = 3 + struct.calcsize(packing)
        data += record("FMT", number, length, name.encode(), kinds.encode(), columns.encode())
    data += record("PARM", 1_000_000, b"MAV_SYSID", 7.0, 1.0)
    data += record("MSG", 1_000_000, b"ArduPlane V4.7.0")
    data += record("ORGN", 1_000_000, 1, 467_000_000, 98_000_000, 1560.0)
    data += record("MODE", 1_000_000, 10, 10, 1)
    data += record("ARM", 1_500_000, 1, 0)
    for k in range(samples):
        t_us = 2_000_000 + 40_000 * k
        data += record("XKF1", t_us, 0, 15.0, 0.5, -1.0)
        data += record("POS", t_us, 467_000_000 + 60 * k, 98_000_000, 1600.0 + k, 40.0 + k, 40.0 + k)
        data += record("BAT", t_us, 0, 12.1, 8.0, 100.0, 83)
    return data + record("MISE", 2_500_000, 5, 3, 16)


# ------------------------------------------------------------ a ULog


def part(kind, content):
    return struct.pack("<HB", len(content), ord(kind)) + content


TOPICS = {
    "vehicle_global_position": ("double lat;double lon;float alt", "<Qddf"),
    "vehicle_local_position": ("float vx;float vy;float vz", "<Qfff"),
    "vehicle_status": ("uint8_t nav_state;uint8_t arming_state", "<QBB"),
    "home_position": ("double lat;double lon;float alt", "<Qddf"),
    "battery_status": ("float voltage_v;float current_a;float remaining", "<Qfff"),
    "mission_result": ("uint16_t seq_current", "<QH"),
    "vehicle_gps_position": ("uint64_t time_utc_usec", "<QQ"),
}
UTC_US = 1_795_000_000_000_000


def ulog(samples=50, utc_us=UTC_US):
    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000)
    data += part("B", bytes(40))
    for name, (fields, _) in TOPICS.items():
        data += part("F", f"{name}:uint64_t timestamp;{fields};".encode())
    key = b"int32_t MAV_SYS_ID"
    data += part("P", bytes([len(key)]) + key + struct.pack("<i", 9))
    numbers = {name: number for number, name in enumerate(TOPICS)}
    for name, number in numbers.items():
        data += part("A", struct.pack("<BH", 0, number) + name.encode())

    def sample(name, *values):
        return part("D", struct.pack("<H", numbers[name]) + struct.pack(TOPICS[name][1], *values))

    data += sample("vehicle_gps_position", 1_000_000, utc_us)
    data += sample("home_position", 1_000_000, 46.7, 9.8, 1560.0)
    data += sample("vehicle_status", 1_000_000, 3, 2)
    data += sample("mission_result", 1_200_000, 3)
    data += part("L", b"6" + struct.pack("<Q", 1_300_000) + b"Takeoff detected")
    for k in range(samples):
        t_us = 2_000_000 + 40_000 * k
        data += sample("vehicle_local_position", t_us, 15.0, 0.5, -1.0)
        data += sample("vehicle_global_position", t_us, 46.7 + 6e-6 * k, 9.8, 1600.0 + k)
        data += sample("battery_status", t_us, 12.1, 8.0, 0.83)
    return data


# ------------------------------------------------------------ both


@pytest.fixture(params=["bin", "ulg"])
def log(request, tmp_path):
    path = tmp_path / f"flight.{request.param}"
    path.write_bytes(dataflash() if request.param == "bin" else ulog())
    return path


def messages(path):
    with open_telemetry(path) as file:
        parts = list(read_log(file))
    assert all(isinstance(one, LogFrame) and one.validity == "good" for one in parts)
    return [(one.t_ns, decode(one.frame.data)[0][0]) for one in parts]


def of(found, kind):
    return [(t_ns, message) for t_ns, message in found if message.get_type() == kind]


def test_positions_are_those_of_the_log_five_times_a_second(log):
    found = of(messages(log), "GLOBAL_POSITION_INT")
    assert len(found) == 10
    t_ns, first = found[0]
    assert (first.get_srcSystem(), first.lat, first.lon) == (
        7 if log.suffix == ".bin" else 9,
        467_000_000,
        98_000_000,
    )
    assert (first.alt, first.relative_alt) == (1_600_000, 40_000)
    assert (first.vx, first.vy, first.vz) == (1500, 50, -100)
    assert found[-1][1].alt == 1_645_000
    np.testing.assert_allclose(np.diff([t for t, _ in found]), 2e8)
    if log.suffix == ".ulg":
        assert t_ns == (UTC_US + 1_000_000) * 1000


def test_mode_arming_home_item_battery_and_texts_are_there(log):
    found = messages(log)
    beats = [message for _, message in of(found, "HEARTBEAT")]
    auto = 10 if log.suffix == ".bin" else 4 << 16 | 4 << 24
    assert beats[-1].custom_mode == auto
    assert beats[-1].base_mode & 128
    assert of(found, "HOME_POSITION")[0][1].altitude == 1_560_000
    assert of(found, "MISSION_CURRENT")[0][1].seq == 3
    battery = of(found, "SYS_STATUS")[0][1]
    assert (battery.voltage_battery, battery.current_battery, battery.battery_remaining) == (12_100, 800, 83)
    assert of(found, "STATUSTEXT")[0][1].text in ("ArduPlane V4.7.0", "Takeoff detected")


def read_or_refuse(log):
    """Messages of a damaged log; None if it is refused by its name."""
    with suppress(RecordingError):
        return messages(log)
    with pytest.raises(RecordingError, match=re.escape(str(log))):
        messages(log)
    return None


@pytest.mark.parametrize("share", [0.35, 0.6, 0.9])
def test_a_log_that_was_cut_is_read_up_to_there_or_refused(log, share):
    data = log.read_bytes()
    log.write_bytes(data[: int(share * len(data))])
    found = read_or_refuse(log)
    assert found is None or 0 < len(of(found, "GLOBAL_POSITION_INT")) <= 10


def test_random_bytes_never_raise_anything_else(log):
    rng = np.random.default_rng(1)
    data = log.read_bytes()
    for _ in range(40):
        broken = bytearray(data)
        for at in rng.integers(8, len(data), 30):
            broken[at] = int(rng.integers(256))
        log.write_bytes(bytes(broken))
        read_or_refuse(log)


def test_a_log_without_positions_is_refused(tmp_path):
    path = tmp_path / "ground.ulg"
    path.write_bytes(ulog(samples=0))
    with pytest.raises(RecordingError, match="has no positions"):
        messages(path)


def test_a_telemetry_log_stays_as_it_is(tmp_path, log):
    with open_telemetry(log) as file:
        data = file.read()
    tlog = tmp_path / "flight.tlog"
    tlog.write_bytes(data)
    assert log_kind(tlog) == "tlog"
    with open_telemetry(tlog) as file:
        assert file.read() == data
