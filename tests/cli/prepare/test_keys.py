"""A user would lose keys, or show them: `gcs keys` as it is typed, over real sockets to a real process."""

from __future__ import annotations

import json
import socket
import subprocess
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gcs.cli import app
from gcs.geo import LocalFrame
from gcs.io.signing.keystore import read_keys
from gcs.mavlink.frames.signing import fingerprint, passphrase_key
from sim_vehicles.process_start import Start, VehicleArguments, process_command
from sim_vehicles.vehicle.vehicle import VehicleSpec


def keys(*arguments: object, words: str | None = None):
    return CliRunner().invoke(app, ["keys", *map(str, arguments)], input=words)


def free_port() -> int:
    with socket.socket(type=socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def plane():
    """A vehicle on the ground in a process of its own; gives the endpoint where it is heard."""
    port = free_port()
    spec = VehicleSpec(3, 0.0, 0.0, 0.0, 0.0, 15.0, airborne=False)
    arguments = VehicleArguments(LocalFrame(33.2, -87.6, 70.0), [spec])
    command = process_command("vehicle.vehicle_process", arguments)
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        t_ns = time.time_ns()
        process.stdin.write(Start(t_ns, t_ns, 1.0, ("127.0.0.1", port)).line())
        process.stdin.flush()
        yield f"udpin:127.0.0.1:{port}"
        process.stdin.close()


def test_new_keys_are_random_and_none_is_shown(tmp_path: Path):
    file = tmp_path / "keys.toml"
    made = keys("new", file, "--vehicle", 3, "-v", "2:4", "--link", "udp:0.0.0.0:14560")
    assert made.exit_code == 0, made.output
    found = read_keys(file)
    secrets = [*found.vehicles.values(), *found.links.values()]
    assert list(found.links) == ["udpin:0.0.0.0:14560"]
    assert len(set(secrets)) == 3
    shown = keys("show", file)
    assert all(fingerprint(key) in shown.output for key in secrets)
    assert not any(key.hex() in made.output + shown.output for key in secrets)
    assert all(key.hex() in keys("show", file, "--secret").output for key in secrets)
    rows = json.loads(keys("show", file, "--json").output)["keys"]
    assert [row["of"] for row in rows] == ["udpin:0.0.0.0:14560", "vehicle 3", "vehicle 2:4"]
    assert "key" not in rows[0]


def test_a_key_that_is_there_is_not_overwritten(tmp_path: Path):
    file = tmp_path / "keys.toml"
    made = keys("new", file)
    assert made.exit_code == 0
    assert "ENDPOINT -v ID" in made.output  # install sends a shared key to named vehicles only
    before = read_keys(file).default
    again = keys("new", file)
    assert again.exit_code == 2
    assert "rotate" in again.output
    assert read_keys(file).default == before


def test_a_passphrase_makes_the_key_that_other_ground_stations_make(tmp_path: Path):
    made = keys("new", tmp_path / "keys.toml", "--passphrase", words="four good words\nfour good words\n")
    assert made.exit_code == 0
    assert read_keys(tmp_path / "keys.toml").default == passphrase_key("four good words")
    assert "four" not in made.output


def test_no_key_is_sent_over_a_link_that_is_not_marked_secure(tmp_path: Path):
    file = tmp_path / "keys.toml"
    keys("new", file, "-v", 3)
    refused = keys("install", file, f"udpin:127.0.0.1:{free_port()}")
    assert refused.exit_code == 2
    assert "in the clear" in refused.output
    assert "--yes" in refused.output


def test_a_rotation_that_sent_nothing_changes_nothing(tmp_path: Path):
    """The vehicle was said to have either key, and a service rejected its frames."""
    file = tmp_path / "keys.toml"
    keys("new", file, "-v", 3)
    before = file.read_text()
    unheard = keys("rotate", file, f"udpin:127.0.0.1:{free_port()}", "--yes", "--timeout", 0.5)
    assert unheard.exit_code == 1
    assert "not finished" not in unheard.output
    assert file.read_text() == before


@pytest.mark.real_time
def test_a_vehicle_gets_its_key_and_another_even_when_that_broke_off_before(tmp_path: Path, plane: str):
    file = tmp_path / "keys.toml"
    keys("new", file, "-v", 3)
    first = read_keys(file).vehicles[3]
    given = keys("install", file, plane, "--yes", "--json")
    assert given.exit_code == 0, given.output
    assert json.loads(given.stdout.splitlines()[-1])["vehicles"][0]["ok"] is True
    broken_off = read_keys(file)
    second = broken_off.pending[3] = bytes(range(32))
    broken_off.save()
    nowhere = f"udpin:127.0.0.1:{free_port()}"
    again = keys("rotate", file, nowhere, "--yes", "--timeout", 0.5)
    assert again.exit_code == 1
    assert "not finished" in again.output
    assert read_keys(file).pending == {3: second}, "the vehicle may have it from before"
    assert keys("install", file, plane, "--yes").exit_code == 2, "it says what to do first"
    rotated = keys("rotate", file, plane, "--yes")
    assert rotated.exit_code == 0, rotated.output
    found = read_keys(file)
    assert (found.vehicles, found.pending) == ({3: second}, {})
    assert second != first
    assert not any(key.hex() in given.output + rotated.output for key in (first, second))
