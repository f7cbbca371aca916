"""Hostile and broken files cost neither memory nor time, and end in one readable line.

Each command runs in a process that may use 1 GB more than it has after its start, and has a minute.
"""

import io
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader

GOLDEN = Path(__file__).parents[1] / "recordings" / "orders.mcap"
WITHIN_S = 60.0
MODEL = """
accel_psd_m2_s3 = 1.0
survival_probability = 0.99
detection_probability = 0.98
clutter_per_scan = 20.0
noise_std_m = 3.2
region_m = [-100.0, -100.0, 2100.0, 2100.0]
"""
SERVER = """
import json, os, resource, sys
import gcs.cli, gcs.cli.analyse.info, gcs.cli.analyse.track_run, gcs.cli.analyse.playback
import gcs.cli.analyse.report_material, gcs.cli.prepare.single_plan, gcs.cli.analyse.info_detections
import gcs.cli.analyse.track, gcs.cli.prepare.check, gcs.cli.prepare.init, gcs.cli.prepare.plan
import gcs.io.recording.reader
try:
    import pydantic.json_schema  # for typer, as of 0.26
except ImportError:
    pass
for line in sys.stdin:
    arguments, out = json.loads(line)
    child = os.fork()
    if child == 0:
        os.setpgid(0, 0)
        target = os.open(out, os.O_WRONLY | os.O_CREAT)
        os.dup2(target, 1)
        os.dup2(target, 2)
        with open("/proc/self/statm") as file:
            used = int(file.read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + 2**30, used + 2**30))
        import signal
        signal.setitimer(signal.ITIMER_REAL, WITHIN)  # ends the process: no handler
        sys.argv = ["gcs", *arguments]
        code = 99
        try:
            gcs.cli.main()
        except SystemExit as end:
            code = end.code
        except BaseException:
            import traceback
            traceback.print_exc()
        sys.stdout.flush()
        os._exit(code or 0)
    print(os.waitpid(child, 0)[1], flush=True)
"""


class Ran(NamedTuple):
    """How a command ended."""

    code: int
    text: str


@pytest.fixture(scope="module")
def gcs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Ran]]:
    """Run `gcs` with arguments, within bounds of memory and time."""
    out = tmp_path_factory.mktemp("out") / "out.txt"
    server = subprocess.Popen(
        [sys.executable, "-c", SERVER.replace("WITHIN", str(WITHIN_S))],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env={**os.environ, "COLUMNS": "500"},
    )  # fmt: skip

    def run(*arguments: object) -> Ran:
        assert server.stdin is not None
        assert server.stdout is not None
        out.unlink(missing_ok=True)
        server.stdin.write(json.dumps([[str(one) for one in arguments], str(out)]) + "\n")
        server.stdin.flush()
        status = int(server.stdout.readline())
        text = out.read_text()
        assert not (os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGALRM), f"hung: {text}"
        assert os.WIFEXITED(status), f"killed by signal {os.WTERMSIG(status)}: {text}"
        assert "Traceback" not in text
        return Ran(os.WEXITSTATUS(status), text)

    yield run
    server.communicate()


def refused(ran: Ran, *words: str) -> None:
    """Check that a command ended with 2 and a line with all the words; a list of mistakes may follow."""
    lines = ran.text.strip().splitlines()
    assert ran.code == 2, ran.text[-2000:]
    assert len([line for line in lines if not line.startswith("  ")]) == 1, ran.text[-2000:]
    assert len(lines[0]) < 1000
    for word in words:
        assert word in lines[0]


def chunk(
    content: bytes, packed: bytes, compression: bytes, claimed: int | None = None, crc: int | None = None
) -> bytes:
    """Return an MCAP chunk."""
    size = len(content) if claimed is None else claimed
    checksum = zlib.crc32(content) if crc is None else crc
    body = struct.pack("<QQQII", 0, 0, size, checksum, len(compression)) + compression
    body += struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", 0x06, len(body)) + body


def recording_with(path: Path, *chunks: bytes) -> Path:
    """Write the first chunk of a good recording, and then others."""
    data = GOLDEN.read_bytes()
    with GOLDEN.open("rb") as file:
        first = make_reader(file).get_summary().chunk_indexes[0]
    path.write_bytes(data[: first.chunk_start_offset + first.chunk_length] + b"".join(chunks))
    return path


TINY = struct.pack("<BQ", 0x77, 0)


def zstd(content: bytes) -> bytes:
    return zstandard.ZstdCompressor(1).compress(content)


CHUNKS: dict[str, Callable[[], list[bytes]]] = {
    # A few kilobytes or megabytes that unpack to much more than they claim.
    "lz4 bomb": lambda: [chunk(b"", lz4.frame.compress(TINY * 20_000_000), b"lz4", 1000, 0)] * 15,
    "zstd bomb": lambda: [chunk(b"", zstd(bytes(500_000_000)), b"zstd", 1000, 0)],
    # What they claim is true, and each is small enough; all together are not.
    "many chunks": lambda: [chunk(TINY * 7_000_000, zstd(TINY * 7_000_000), b"zstd")] * 40,
    "lz4 garbage": lambda: [chunk(b"", b"no lz4", b"lz4", 1000, 0)],
    "zstd garbage": lambda: [chunk(b"", b"no zstd", b"zstd", 1000, 0)],
    "unknown": lambda: [chunk(b"", b"????", b"brotli", 1000, 0)],
}


@pytest.mark.parametrize("kind", CHUNKS)
def test_a_recording_is_read_up_to_a_hostile_chunk(
    gcs: Callable[..., Ran], tmp_path: Path, kind: str
) -> None:
    path = recording_with(tmp_path / "run.mcap", *CHUNKS[kind]())
    ran = gcs("info", path, "--json")
    assert ran.code == 0, ran.text[-2000:]
    contents = json.loads(ran.text.strip().splitlines()[-1])
    assert sum(topic["count"] for topic in contents["records"].values()) > 100
    (damage,) = contents["damage"]
    assert "chunk" in damage["problem"] or "damaged" in damage["problem"]


def npz(path: Path, *arrays: bytes, method: int = zipfile.ZIP_DEFLATED) -> Path:
    """Write an NPZ whose first array is `meas`."""
    with zipfile.ZipFile(path, "w", method) as archive:
        for number, array in enumerate(arrays):
            archive.writestr("meas.npy" if number == 0 else f"{number}.npy", array)
    return path


def npy(header: str, content: bytes = b"") -> bytes:
    """Return an array with a header as it is given."""
    line = header.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(line)) + line + content


def saved(array: object) -> bytes:
    """Return an array as numpy saves it."""
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


MEAS = saved(np.array([[1.0, 2.0, 3.0], [2.0, 3.0, 4.0]]))
HEADERS = {
    "shape of terabytes": "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 3)}",
    "shape below zero": "{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 3)}",
    "shape beyond integers": f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({10**40}, 0)}}",
    "no dictionary": "[",
    "nested": "(" * 300 + ")" * 300,
    "nested deeper": "[" * 9000,
    "no kind": "{'descr': 'nonsense', 'fortran_order': False, 'shape': (1, 3)}",
    "void": "{'descr': '|V1000000000', 'fortran_order': False, 'shape': (0, 3)}",
    "fields": "{'descr': [('x', '<f8')], 'fortran_order': False, 'shape': (1,)}",
    "objects": "{'descr': '|O', 'fortran_order': False, 'shape': (1, 3)}",
    "null bytes": "\0" * 100,
}


@pytest.mark.parametrize("name", HEADERS)
def test_headers_of_arrays_are_refused(gcs: Callable[..., Ran], tmp_path: Path, name: str) -> None:
    path = npz(tmp_path / "radar.npz", npy(HEADERS[name], bytes(24)))
    refused(gcs("info", path), "radar.npz", "expected an NPZ of numbers")
    refused(gcs("track", path), "radar.npz", "expected an NPZ of numbers")


def test_members_that_numpy_does_not_write_are_refused(gcs: Callable[..., Ran], tmp_path: Path) -> None:
    for method in (zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2):
        path = npz(tmp_path / "radar.npz", MEAS, method=method)
        refused(gcs("info", path), "radar.npz", "neither stored nor deflated")
    data = bytearray(npz(path, MEAS, method=zipfile.ZIP_LZMA).read_bytes())
    at = data.index(b"meas.npy") + len("meas.npy")
    data[at : at + 40] = bytes(range(200, 240))
    path.write_bytes(data)
    refused(gcs("info", path), "radar.npz", "neither stored nor deflated")
    data = bytearray(npz(path, MEAS).read_bytes())
    data[6] |= 1
    data[data.index(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(data)
    refused(gcs("info", path), "radar.npz", "encrypted")
    npz(path, saved(np.array([{"pickled": 1}, None, "x"], dtype=object)))
    refused(gcs("info", path), "radar.npz", "no numbers")


def test_broken_archives_are_refused(gcs: Callable[..., Ran], tmp_path: Path) -> None:
    path = tmp_path / "radar.npz"
    data = npz(path, saved(np.arange(30_000.0).reshape(-1, 3)), method=zipfile.ZIP_DEFLATED).read_bytes()
    hurt = bytearray(data)
    hurt[60:90] = bytes(30)
    for content in (
        b"",
        b"PK",
        data[:1000],
        data[-1000:],
        bytes(hurt),
        b"PK\x06\x07" + bytes(16) + data[-22:],
    ):
        path.write_bytes(content)
        refused(gcs("track", path), "radar.npz")


@pytest.mark.parametrize("count", [5_500_000, 39_000_000])
def test_an_archive_of_a_few_kilobytes_is_no_gigabyte(
    gcs: Callable[..., Ran], tmp_path: Path, count: int
) -> None:
    path = npz(tmp_path / "radar.npz", saved(np.zeros((count // 3, 3), np.float64)))
    assert path.stat().st_size < 500_000
    refused(gcs("track", path), "radar.npz", "more than 200 times its size")


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "model.toml"
    path.write_text(MODEL)
    return path


def test_two_rows_are_no_million_scans(gcs: Callable[..., Ran], tmp_path: Path, model: Path) -> None:
    path = tmp_path / "radar.csv"
    path.write_text("k,x,y\n1,2,3\n900000,4,5\n")
    refused(gcs("track", path, "--model", model), "radar.csv", "900000")


def test_a_line_that_does_not_end_is_refused(gcs: Callable[..., Ran], tmp_path: Path, model: Path) -> None:
    path = tmp_path / "radar.csv"
    for content in ("k,x,y\n" + "1,2,3," * 1_000_000, "1," * 1_000_000, "#" * 1_000_000, '"' * 1_000_000):
        path.write_text(content)
        refused(gcs("track", path, "--model", model), "radar.csv, line", "less than 100000 characters")
        refused(gcs("info", path), "radar.csv, line", "less than 100000 characters")


def test_one_scan_of_a_million_detections_is_refused(
    gcs: Callable[..., Ran], tmp_path: Path, model: Path
) -> None:
    path = tmp_path / "radar.csv"
    path.write_text("k,x,y\n" + "1,2,3\n" * 500_000)
    refused(gcs("track", path, "--model", model), "radar.csv", "20000 detections")


DEEP = 200_000


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = " + "[" * DEEP, ["nested too deeply"]),
        ("a = " + "{b = " * DEEP, ["nested too deeply"]),
        *((f"a = {'[' * depth}{']' * depth}", []) for depth in (200, 300, 330, 400, 480)),
        (".".join("a" * DEEP) + " = 1", ["a key of more than"]),
        ("[" + " . ".join(['"a"'] * DEEP) + "]", ["a key of more than"]),
        ("a = " + "9" * 100_000, ["not valid TOML"]),
        ("# comment\n" * 2_000_000, ["larger than 16 MB"]),
    ],
    ids=["lists", "tables", *"12345", "key", "title", "number", "size"],
)
def test_a_mission_file_or_model_that_is_nested_or_large_is_refused(
    gcs: Callable[..., Ran], tmp_path: Path, text: str, words: list[str]
) -> None:
    path = tmp_path / "mission.toml"
    path.write_text(text)
    refused(gcs("check", path), "mission.toml", *words)
    path.write_text(text[:4_000_000])
    radar = tmp_path / "radar.csv"
    radar.write_text("k,x,y\n1,2,3\n")
    refused(gcs("track", radar, "--model", path), "mission.toml")


@pytest.mark.parametrize(
    "text",
    [
        "[" * DEEP,
        '{"type": "FeatureCollection", "features": ' + "[" * DEEP,
        '{"type": "Polygon", "coordinates": [[' + "[" * 900 + "]" * 900 + "]]}",
        '{"type": "Polygon", "coordinates": [[' + '"' + "x" * 1_000_000 + '"' + "]]}",
        '{"type": "Polygon", "coordinates": ' + '{"a":' * DEEP,
    ],
    ids=["list", "collection", "corner", "long corner", "object"],
)
def test_geojson_that_is_nested_is_refused(gcs: Callable[..., Ran], tmp_path: Path, text: str) -> None:
    (tmp_path / "zones.geojson").write_text(text)
    mission = tmp_path / "mission.toml"
    mission.write_text('[map]\ngeojson = "zones.geojson"\n')
    refused(gcs("check", mission), "zones.geojson")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.kml", "<kml>" + "<Placemark>" * 100_000 + "</Placemark>" * 100_000 + "</kml>"),
        ("a.kml", "<kml>" * 500_000),
        ("a.plan", '{"fileType": "Plan", "mission": ' + "[" * DEEP),
    ],
    ids=["placemarks", "open", "plan"],
)
def test_drawn_missions_that_are_nested_are_refused(
    gcs: Callable[..., Ran], tmp_path: Path, name: str, text: str
) -> None:
    (tmp_path / name).write_text(text)
    refused(gcs("init", tmp_path / name), name, "nested" if name == "a.kml" else "recursion")


READERS = {
    "kml": ("init", "{}"),
    "log": ("init", "{}"),
    "info": ("info", "{}"),
    "replay": ("replay", "{}", "--config", "prescribed"),
    "report": ("report", "{}"),
    "track": ("track", "{}"),
    "check": ("check", "{}"),
    "config": ("replay", GOLDEN, "--config", "{}"),
}
NAMES = {"kml": "x.kml", "track": "x.csv", "check": "x.toml", "config": "x.toml"}


@pytest.mark.parametrize("reader", READERS)
def test_pipes_sockets_and_devices_are_refused_at_once(
    gcs: Callable[..., Ran], tmp_path: Path, reader: str
) -> None:
    path = tmp_path / NAMES.get(reader, "x.tlog")
    arguments = [path if word == "{}" else word for word in READERS[reader]]
    os.mkfifo(path)
    refused(gcs(*arguments), path.name, "a named pipe; expected a regular file")
    path.unlink()
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(os.path.relpath(path))
        refused(gcs(*arguments), path.name, "a socket; expected a regular file")
    path.unlink()
    path.symlink_to("/dev/zero")
    refused(gcs(*arguments), path.name, "a device; expected a regular file")


@pytest.mark.parametrize("name", ["radar.csv", "radar.npz"])
def test_detections_from_a_pipe_are_refused_at_once(
    gcs: Callable[..., Ran], tmp_path: Path, name: str, model: Path
) -> None:
    path = tmp_path / name
    os.mkfifo(path)
    refused(gcs("info", path), name, "a named pipe; expected a regular file")
    refused(gcs("track", path, "--model", model), name, "a named pipe; expected a regular file")
    radar = tmp_path / "other.csv"
    radar.write_text("k,x,y\n1,2,3\n")
    refused(gcs("track", radar, "--model", path), name, "a named pipe; expected a regular file")


def test_folders_are_no_files(gcs: Callable[..., Ran], tmp_path: Path) -> None:
    refused(gcs("check", tmp_path), str(tmp_path), "a folder; expected a regular file")
    (tmp_path / "run.mcap").mkdir()
    refused(gcs("info", tmp_path), "run.mcap", "a folder; expected a regular file")


def test_a_log_of_nothing_but_beginnings_of_frames_is_read(gcs: Callable[..., Ran], tmp_path: Path) -> None:
    path = tmp_path / "link.tlog"
    path.write_bytes(b"\0\1" * 50 + b"\xfe" * 250_000 + bytes(300))
    assert gcs("info", path).code in (0, 2)
