"""A field box would fail at the first flight for what could have been seen at home."""

import json
import shutil
import socket
import time
from collections import namedtuple

import pytest
from typer.testing import CliRunner

from gcs.cli import app
from gcs.config import parse
from gcs.io import machine_checks
from gcs.io.machine_checks import check_links, check_machine

MISSION = """
name = "m"
[frame]
lat_deg = 46.8
lon_deg = 9.8
alt_msl_m = 1560.0
[[agents]]
system_id = 1
east_m = 100.0
north_m = 100.0
[links]
"""


def levels(links):
    return {one.check: one for one in check_links(parse(MISSION + links, "m.toml"))}


def machine(tmp_path):
    return {one.check: one for one in check_machine(tmp_path / "runs", 200.0)}


@pytest.mark.parametrize(("kind", "prefix"), [(socket.SOCK_DGRAM, "udpin"), (socket.SOCK_STREAM, "tcpin")])
def test_a_port_that_another_program_has_is_a_problem(kind, prefix):
    with socket.socket(socket.AF_INET, kind) as other:
        other.bind(("127.0.0.1", 0))
        if kind is socket.SOCK_STREAM:
            other.listen()
        endpoint = f"{prefix}:127.0.0.1:{other.getsockname()[1]}"
        found = levels(f'mavlink = "{endpoint}"\nzenoh = "tcp/127.0.0.1:0"\n')
        assert found[endpoint].level == "problem"
        assert "end the program" in found[endpoint].remedy
        assert found["zenoh tcp/127.0.0.1:0"].level == "ok"
    assert levels(f'mavlink = "{endpoint}"\nzenoh = "tcp/127.0.0.1:0"\n')[endpoint].level == "ok"


def test_a_serial_port_is_there_and_may_be_opened(tmp_path):
    missing = next(check_links(parse(MISSION + 'mavlink = "/dev/ttyNONE:57600"\n', "m.toml")))
    assert (missing.level, missing.found) == ("problem", "does not exist")
    device = tmp_path / "ttyUSB0"
    device.touch()
    assert next(check_links(parse(MISSION + f'mavlink = "{device}:57600"\n', "m.toml"))).level == "ok"


def test_endpoints_of_bridges_on_other_machines_are_left_out():
    links = """
mavlink = [{ endpoint = "serial:/dev/ttyNONE:57600", bridge = "hill" }]
[[links.bridges]]
name = "hill"
zenoh = "tcp/127.0.0.1:7449"
"""
    assert not [name for name in levels(links) if "ttyNONE" in name]


def test_an_address_of_another_machine_is_no_taken_port():
    endpoint = "udpin:192.0.2.1:14550"
    found = levels(f'mavlink = "{endpoint}"\nzenoh = "tcp/127.0.0.1:0"\n')[endpoint]
    assert (found.level, "end the program" in found.remedy) == ("problem", False)


def test_a_host_without_an_address_is_no_taken_port():
    endpoint = "udpin:radio.invalid:14550"
    found = levels(f'mavlink = "{endpoint}"\nzenoh = "tcp/127.0.0.1:0"\n')[endpoint]
    assert (found.level, "end the program" in found.remedy) == ("problem", False)


def test_a_standby_and_a_bridge_pass_where_the_other_nodes_are_elsewhere():
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        taken = f"tls/127.0.0.1:{other.getsockname()[1]}"
        links = f"""
mavlink = "udpin:127.0.0.1:0"
zenoh = "tls/192.0.2.6:7447"
standby = "{taken}"
zenoh_tls = "keys"
[[links.bridges]]
name = "main"
zenoh = "tls/192.0.2.5:7449"
"""
        found = {name: one.level for name, one in levels(links).items()}
    assert found == {
        "udpin:127.0.0.1:0": "ok",
        "zenoh tls/192.0.2.6:7447": "ok",
        f"zenoh {taken}": "problem",
        "zenoh tls/192.0.2.5:7449": "ok",
    }


def test_a_machine_that_has_none_of_the_addresses_of_the_nodes_is_told():
    """Before, all was well."""
    links = """
zenoh = "tls/192.0.2.6:7447"
standby = "tls/192.0.2.7:7447"
zenoh_tls = "keys"
"""
    assert levels(links)["zenoh"].level == "problem"


def test_an_unset_clock_is_a_problem(tmp_path, monkeypatch):
    assert machine(tmp_path)["clock"].level != "problem"
    monkeypatch.setattr(time, "time", lambda: 86_400.0)
    assert machine(tmp_path)["clock"].level == "problem"


@pytest.mark.parametrize(("answer", "level"), [("yes", "ok"), ("no", "warning"), ("", "ok")])
def test_a_clock_that_is_not_synchronised_is_told(tmp_path, monkeypatch, answer, level):
    monkeypatch.setattr(machine_checks, "_output", lambda _command: answer)
    assert machine(tmp_path)["clock"].level == level


@pytest.mark.parametrize(("free", "level"), [(100e6, "problem"), (1e9, "warning"), (9e9, "ok")])
def test_a_full_disk_is_told(tmp_path, monkeypatch, free, level):
    usage = namedtuple("usage", "total used free")(1e12, 0, free)
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: usage)
    assert machine(tmp_path)["disk"].level == level


def test_scripts_get_one_json_object_and_an_exit_code(tmp_path):
    file = tmp_path / "m.toml"
    file.write_text(MISSION + 'mavlink = "/dev/ttyNONE:57600"\nzenoh = "tcp/127.0.0.1:0"\n')
    done = CliRunner().invoke(app, ["doctor", str(file), "--json"])
    result = json.loads(done.stdout.splitlines()[-1])
    assert (done.exit_code, result["ok"], result["problems"]) == (1, False, 1)
    assert {"versions", "clock", "disk", "kernels"} <= {one["check"] for one in result["findings"]}
