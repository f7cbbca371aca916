"""A user would lose a CA, hand out a wrong certificate, or show a key: `gcs keys ca|node`."""

from __future__ import annotations

import ipaddress
import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID
from typer.testing import CliRunner

from gcs.cli import app
from gcs.errors import ConfigError
from gcs.io.zenoh.certificates import read_node, read_nodes

_MISSION = """
name = "m"
[frame]
lat_deg = 33.2
lon_deg = -87.6
alt_msl_m = 70.0
[[agents]]
system_id = 1
east_m = 200.0
north_m = 200.0
"""


def keys(*arguments: object):
    return CliRunner(env={"COLUMNS": "200"}).invoke(app, ["keys", *map(str, arguments)])


@pytest.fixture
def ca(tmp_path: Path) -> Path:
    folder = tmp_path / "ca"
    assert keys("ca", folder).exit_code == 0
    return folder


def node(ca: Path, name: str, role: str, *more: object) -> Path:
    made = keys("node", name, "--role", role, "--ca", ca, *more)
    assert made.exit_code == 0, made.output
    return ca / f"{role}.{name}"


def certificate_in(folder: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate((folder / "node.pem").read_bytes())


def test_keys_are_for_their_owner_alone_and_never_printed(ca: Path) -> None:
    made = keys("node", "radar-1", "--role", "sensor", "--ca", ca)
    files = [ca / "ca.key", ca / "sensor.radar-1" / "node.key"]
    assert [stat.S_IMODE(file.stat().st_mode) for file in files] == [0o600, 0o600]
    assert [stat.S_IMODE(file.parent.stat().st_mode) for file in files] == [0o700, 0o700]
    secret_lines = [line for file in files for line in file.read_text().splitlines() if "-----" not in line]
    assert secret_lines
    assert not any(line in made.output for line in secret_lines)
    assert "copy" in made.output.lower()


def test_a_certificate_says_role_name_hosts_and_time(ca: Path) -> None:
    before = datetime.now(tz=UTC)
    folder = node(ca, "hub", "command", "--host", "10.0.0.5", "--host", "hub.example", "--days", 30)
    found = read_node(folder)
    assert (found.role, found.name, found.common_name) == ("command", "hub", "command.hub")
    assert timedelta(days=29) < found.expires - before < timedelta(days=31)
    names = certificate_in(folder).extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["localhost", "hub.example"]
    assert ipaddress.ip_address("10.0.0.5") in names.get_values_for_type(x509.IPAddress)


def test_who_accepts_no_connections_cannot_be_a_server(ca: Path) -> None:
    for role, hosts, is_server in (
        ("sensor", [], False),
        ("operator", [], False),
        ("sensor", ["--host", "radar"], True),
        ("command", [], True),
    ):
        folder = node(ca, f"n{role}{len(hosts)}", role, *hosts)
        uses = certificate_in(folder).extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
        assert (ExtendedKeyUsageOID.SERVER_AUTH in uses) == is_server


def test_a_command_node_gets_the_list_of_nodes_and_later_ones(ca: Path) -> None:
    hub = node(ca, "hub", "command")
    node(ca, "radar-1", "sensor")
    expected = {"hub": "command", "radar-1": "sensor"}
    assert read_nodes(ca / "nodes.toml") == expected
    assert read_nodes(hub / "nodes.toml") == expected
    assert not (ca / "sensor.radar-1" / "nodes.toml").exists()


def test_nothing_is_overwritten(ca: Path) -> None:
    folder = node(ca, "anna", "operator")
    kept = {file: file.read_bytes() for file in (*ca.glob("*.*"), *folder.iterdir()) if file.is_file()}
    assert keys("ca", ca).exit_code == 2
    assert keys("node", "anna", "--role", "operator", "--ca", ca).exit_code == 2
    other_role = keys("node", "anna", "--role", "viewer", "--ca", ca)
    assert other_role.exit_code == 2
    assert "nodes.anna: is listed with the role operator" in other_role.output
    assert kept == {file: file.read_bytes() for file in kept}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("node", "a b", "--role", "viewer"), "letters, digits"),
        (("node", "x" * 49, "--role", "viewer"), "1 to 48"),
        (("node", "x", "--role", "boss"), "boss"),
        (("node", "x", "--role", "command", "--host", "käse"), "--host"),
        (("node", "x", "--role", "viewer", "--days", "0"), "--days"),
    ],
)
def test_mistakes_are_named(ca: Path, arguments: tuple[str, ...], words: str) -> None:
    done = keys(*arguments, "--ca", ca)
    assert done.exit_code == 2
    assert words in done.output


def test_without_an_authority_the_remedy_is_named(tmp_path: Path) -> None:
    done = keys("node", "x", "--role", "viewer", "--ca", tmp_path)
    assert done.exit_code == 2
    assert "gcs keys ca" in done.output


def test_a_damaged_or_open_folder_is_refused_without_its_key(ca: Path) -> None:
    folder, other = node(ca, "anna", "operator"), node(ca, "bob", "operator")
    secret = (folder / "node.key").read_text()

    def problem() -> str:
        with pytest.raises(ConfigError) as caught:
            read_node(folder)
        assert not any(line in str(caught.value) for line in secret.splitlines())
        return str(caught.value)

    (folder / "node.key").chmod(0o644)
    assert "chmod 600" in problem()
    (folder / "node.key").chmod(0o600)
    (folder / "node.key").write_bytes((other / "node.key").read_bytes())
    assert "is not the key of node.pem" in problem()
    (folder / "node.key").write_text(secret[:100])
    assert "expected a private key" in problem()
    (folder / "node.pem").write_text("x")
    assert "expected a certificate" in problem()
    (folder / "ca.pem").unlink()
    assert f"{folder / 'ca.pem'}: is missing" in problem()


def test_a_certificate_without_a_role_is_refused(ca: Path) -> None:
    """Such as one of another CA, for another purpose."""
    folder = node(ca, "anna", "operator")
    for name in ("node.pem", "node.key"):
        (folder / name).write_bytes((ca / name.replace("node", "ca")).read_bytes())
    with pytest.raises(ConfigError, match=r"expected a common name such as sensor.radar-1"):
        read_node(folder)


def test_a_list_of_nodes_that_others_may_change_is_refused(ca: Path) -> None:
    node(ca, "anna", "operator")
    (ca / "nodes.toml").chmod(0o664)
    with pytest.raises(ConfigError, match="chmod go-w"):
        read_nodes(ca / "nodes.toml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[nodes]\nanna = "boss"\n', "nodes.anna"),
        ('[nodes]\n"a.b" = "viewer"\n', "letters, digits"),
        ('[node]\nanna = "viewer"\n', "unknown key `node`"),
        ("[nodes", "nodes.toml"),
    ],
)
def test_mistakes_in_the_list_of_nodes_are_named(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "nodes.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_nodes(path)
    assert words in str(caught.value)


def test_a_check_refuses_a_certificate_with_which_the_service_does_not_start(
    ca: Path, tmp_path: Path
) -> None:
    node(ca, "anna", "operator")
    node(ca, "hub", "command")
    file = tmp_path / "m.toml"

    def check(folder: str):
        tls = f'[links]\nzenoh = "tls/0.0.0.0:7447"\nzenoh_tls = "ca/{folder}"\n'
        file.write_text(_MISSION + tls)
        return CliRunner(env={"COLUMNS": "200"}).invoke(app, ["check", str(file)])

    assert check("command.hub").exit_code == 0
    refused = check("operator.anna")
    assert refused.exit_code == 2
    assert "links.zenoh_tls: operator.anna may not command vehicles" in refused.output
