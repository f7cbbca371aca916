"""A program without a certificate, with a wrong one or with another role would reach a swarm, or would not be
told why not: real zenoh sessions over TLS on the loopback address."""

from __future__ import annotations

import contextlib
import datetime
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
from zenoh import ext

from gcs.errors import ConfigError, LinkError
from gcs.io.zenoh import certificate_authority
from gcs.io.zenoh.access_control import RIGHTS, ROLES, Role, may
from gcs.io.zenoh.certificate_authority import make_certificate_authority, make_node
from gcs.io.zenoh.session import ZenohSession, free_endpoint

MISSION = "swarm/m"
TIMEOUT_S = 20.0
QUIET_S = 0.7
NODES: dict[str, Role] = {
    "hub": "command", "spare": "command", "radar-1": "sensor", "radar-2": "sensor", "vic": "viewer",
    "anna": "operator", "mast": "bridge", "hill": "bridge",
}  # fmt: skip
KEYS = (
    "sensor/radar-1/scan", "sensor/radar-2/scan", "order", "status_request", "answer", "status", "notice",
    "picture/agents", "plan", "truth", "events", "bridge/mast/up", "bridge/mast/down", "bridge/hill/up",
    "bridge/hill/down",
)  # fmt: skip
READ = {"answer", "status", "notice", "picture/agents", "plan", "truth"}
SENDS: dict[str, set[str]] = {
    "radar-1": {"sensor/radar-1/scan"},
    "vic": {"status_request"},
    "anna": {"order", "status_request"},
    "mast": {"bridge/mast/up"},
    "spare": {*KEYS},
}
HEARS: dict[str, set[str]] = {
    "radar-1": set(),
    "vic": READ,
    "anna": READ,
    "mast": {"bridge/mast/down"},
    "spare": {*KEYS},
}


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders of certificates, by node."""
    return make_keys(tmp_path_factory.mktemp("keys"))


def make_keys(folder: Path) -> dict[str, Path]:
    make_certificate_authority(folder, 30)
    return {name: make_node(folder, name, role, [], 30) for name, role in NODES.items()}


@pytest.fixture(scope="module")
def hub(keys: dict[str, Path]) -> Iterator[ZenohSession]:
    """Central command, listening."""
    with ZenohSession(listen=free_endpoint("tls"), tls=keys["hub"]) as session:
        yield session


@contextlib.contextmanager
def hostile(hub: ZenohSession, tls: Path) -> Iterator[zenoh.Session]:
    """Connect with a program that does not check its own rights."""
    with ZenohSession(connect=hub.endpoint, tls=tls) as session:
        session.node = None
        wait_until(lambda: bool(session.names_connected()))
        yield session._session


def wait_until(condition: Any) -> None:
    give_up = time.monotonic() + TIMEOUT_S
    while not condition():
        assert time.monotonic() < give_up
        time.sleep(0.02)


def heard(session: zenoh.Session, keys: tuple[str, ...]) -> set[str]:
    """Subscribe to each key by itself and to all; return the set that fills with heard keys."""
    found: set[str] = set()

    def add(sample: zenoh.Sample) -> None:
        found.add(str(sample.key_expr).removeprefix(MISSION + "/"))

    for key in (*keys, "**"):
        session.declare_subscriber(f"{MISSION}/{key}", add, allowed_origin=zenoh.Locality.REMOTE)
    return found


def publish_until(session: zenoh.Session, found: set[str], expected: set[str]) -> None:
    """Publish on every key until the expected ones were heard, and for a while after that."""
    give_up, end = time.monotonic() + TIMEOUT_S, 0.0
    while time.monotonic() < (end or give_up):
        for key in KEYS:
            session.put(f"{MISSION}/{key}", b"x")
        if expected <= found and not end:
            end = time.monotonic() + QUIET_S
        time.sleep(0.05)


@pytest.mark.parametrize("name", SENDS)
def test_a_node_is_heard_on_the_keys_of_its_role_and_name_alone(
    name: str, keys: dict[str, Path], hub: ZenohSession
) -> None:
    found = heard(hub._session, KEYS)
    with hostile(hub, keys[name]) as node:
        publish_until(node, found, SENDS[name])
    assert found == SENDS[name]


@pytest.mark.parametrize("name", HEARS)
def test_a_node_hears_the_keys_of_its_role_and_name_alone(
    name: str, keys: dict[str, Path], hub: ZenohSession
) -> None:
    with hostile(hub, keys[name]) as node:
        found = heard(node, KEYS)
        publish_until(hub._session, found, HEARS[name])
    assert found == HEARS[name]


def test_a_program_without_a_certificate_reaches_nothing(hub: ZenohSession) -> None:
    found = heard(hub._session, KEYS)
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("connect/endpoints", f'["{hub.endpoint}"]')
    config.insert_json5("connect/exit_on_failure", "false")
    ca_pem = hub.node.folder / "ca.pem" if hub.node else ""
    config.insert_json5("transport/link/tls", f'{{"root_ca_certificate": "{ca_pem}"}}')
    with zenoh.open(config) as session:
        publish_until(session, found, set())
        assert session.info.links() == []
    assert found == set()


def foreign(tmp_path: Path, name: str) -> Path:
    """Return a certificate of the same name from another CA, with the public part of ours."""
    return make_keys(tmp_path)[name]


def expired(keys: dict[str, Path], name: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a certificate of our CA that has expired."""
    home = keys[name].parent
    monkeypatch.setattr(certificate_authority, "_CLOCK_TOLERANCE", datetime.timedelta(days=9))
    kept = keys[name].rename(home / "kept")
    folder = make_node(home, name, NODES[name], [], -2).rename(home / "expired")
    kept.rename(keys[name])
    return folder


def config_of(hub: ZenohSession, folder: Path) -> zenoh.Config:
    """Return the configuration of a program that uses a certificate whatever it is."""
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("connect/endpoints", f'["{hub.endpoint}"]')
    config.insert_json5("connect/exit_on_failure", "false")
    config.insert_json5(
        "transport/link/tls",
        f'{{"root_ca_certificate": "{folder}/ca.pem", "enable_mtls": true, '
        f'"connect_certificate": "{folder}/node.pem", "connect_private_key": "{folder}/node.key"}}',
    )
    return config


@pytest.mark.parametrize(
    "name", ["radar-1", *(pytest.param(one, marks=pytest.mark.real_time) for one in ("vic", "anna", "mast"))]
)
@pytest.mark.parametrize("kind", ["foreign", "expired"])
def test_a_wrong_or_expired_certificate_reaches_nothing_and_is_told_why(
    kind: str,
    name: str,
    keys: dict[str, Path],
    hub: ZenohSession,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if kind == "foreign":
        folder = foreign(tmp_path, name)
        shutil.copy(keys[name] / "ca.pem", folder / "ca.pem")
    else:
        folder = expired(keys, name, monkeypatch)
    found = heard(hub._session, KEYS)
    with zenoh.open(config_of(hub, folder)) as node:
        publish_until(node, found, set())
        assert node.info.links() == []
    assert found == set()
    if kind == "expired":
        with pytest.raises(ConfigError, match=r"node\.pem: expired on 20.* UTC"):
            ZenohSession(connect=hub.endpoint, tls=folder)
    else:
        with ZenohSession(connect=hub.endpoint, tls=folder) as session:
            assert "of another CA" in session.why_unanswered()
    shutil.rmtree(folder)


def test_central_command_of_another_authority_is_refused(hub: ZenohSession, tmp_path: Path) -> None:
    with ZenohSession(connect=hub.endpoint, tls=foreign(tmp_path, "anna")) as session:
        assert "the certificate there is not valid" in session.why_unanswered()
        assert session.names_connected() == []


@pytest.mark.real_time
def test_a_node_cannot_pose_as_central_command(keys: dict[str, Path]) -> None:
    endpoint = free_endpoint("tls")
    for name in ("radar-1", "vic", "anna", "mast"):
        with (
            ZenohSession(listen=endpoint, tls=keys[name]) as impostor,
            ZenohSession(connect=endpoint, tls=keys["anna"]) as operator,
        ):
            time.sleep(QUIET_S)
            assert operator.names_connected() == []
            assert impostor.names_connected() == []


def test_a_bridge_that_listens_obeys_command_alone(tmp_path: Path) -> None:
    make_certificate_authority(tmp_path, 30)
    command = make_node(tmp_path, "hub", "command", [], 30)
    anna = make_node(tmp_path, "anna", "operator", [], 30)
    mast = make_node(tmp_path, "mast", "bridge", ["localhost"], 30)
    endpoint = free_endpoint("tls")
    listed = mast / "nodes.toml"
    text = listed.read_text()
    listed.unlink()
    with pytest.raises(ConfigError, match=r"nodes\.toml"):
        ZenohSession(listen=endpoint, tls=mast)
    listed.write_text(text)
    with ZenohSession(listen=endpoint, tls=mast) as bridge, hostile(bridge, anna) as operator:
        found = heard(bridge._session, KEYS)
        for _ in range(5):
            operator.put(f"{MISSION}/bridge/mast/down", b"anna")
            time.sleep(0.1)
        assert not found
        with ZenohSession(connect=endpoint, tls=command) as hub:
            publish_until(hub._session, found, {"bridge/mast/down"})


def test_central_command_does_not_obey_a_sensor_that_it_connects_to(tmp_path: Path) -> None:
    """`zenoh_role = "connect"`: the rights are those of the certificate, not of the side that connects."""
    make_certificate_authority(tmp_path, 30)
    command = make_node(tmp_path, "hub", "command", [], 30)
    radar = make_node(tmp_path, "radar-1", "sensor", ["localhost"], 30)
    endpoint = free_endpoint("tls")
    with (
        ZenohSession(listen=endpoint, tls=radar) as sensor,
        ZenohSession(listen=free_endpoint("tls"), connect=endpoint, tls=command) as hub,
    ):
        found = heard(hub._session, KEYS)
        sensor.node = None
        publish_until(sensor._session, found, {"sensor/radar-1/scan"})
        assert found == {"sensor/radar-1/scan"}


def test_a_certificate_without_a_line_in_nodes_toml_has_no_rights_and_is_told_so(tmp_path: Path) -> None:
    folders = make_keys(tmp_path)
    listed = folders["hub"] / "nodes.toml"
    lines = listed.read_text().splitlines(keepends=True)
    listed.write_text("".join(line for line in lines if not line.startswith("anna")))
    with ZenohSession(listen=free_endpoint("tls"), tls=folders["hub"]) as hub:
        found = heard(hub._session, KEYS)
        with hostile(hub, folders["anna"]) as anna:
            publish_until(anna, found, set())
        assert found == set()
        with ZenohSession(connect=hub.endpoint, tls=folders["anna"]) as anna_told:
            wait_until(lambda: bool(anna_told.names_connected()))
            assert anna_told.why_unanswered() == (
                "command.hub is connected and does not answer: is operator.anna in its nodes.toml?"
            )


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("vic", "order"),
        ("radar-1", "order"),
        ("radar-1", "sensor/radar-2/scan"),
        ("mast", "bridge/hill/up"),
        ("anna", "bridge/mast/down"),
    ],
)
def test_a_node_is_told_at_once_what_it_may_not_publish(
    name: str, key: str, keys: dict[str, Path], hub: ZenohSession
) -> None:
    with (
        ZenohSession(connect=hub.endpoint, tls=keys[name]) as node,
        pytest.raises(LinkError, match=rf"\.{name} may not publish on `swarm/m/{key}`: its role is"),
    ):
        node.publish(f"{MISSION}/{key}", b"")


@pytest.mark.real_time
def test_queries_go_where_the_roles_let_them(keys: dict[str, Path], hub: ZenohSession) -> None:
    def answer(query: zenoh.Query) -> None:
        query.reply(query.key_expr, b"yes")

    answerer = hub._session.declare_queryable(f"{MISSION}/**", answer)
    asked = ("console/feed", "console/vehicle/3", "snapshot", "bridge/mast/lease")
    allowed = {"radar-1": set(), "vic": {*asked[:2]}, "anna": {*asked[:2]}, "mast": set(), "spare": {*asked}}
    for name, expected in allowed.items():
        with hostile(hub, keys[name]) as node:
            found: set[str] = set()
            give_up, end = time.monotonic() + TIMEOUT_S, 0.0
            while time.monotonic() < (end or give_up):
                for key in asked:
                    replies = node.get(f"{MISSION}/{key}", timeout=1.0)
                    found |= {key for reply in replies if reply.ok is not None}
                if expected <= found and not end:
                    end = time.monotonic() + QUIET_S
            assert found == expected, name
    answerer.undeclare()


def test_a_bridge_answers_for_itself_alone(keys: dict[str, Path], hub: ZenohSession) -> None:
    with hostile(hub, keys["mast"]) as bridge:
        for key in ("bridge/mast/lease", "bridge/hill/lease", "console/feed", "snapshot"):
            bridge.declare_queryable(f"{MISSION}/{key}", lambda query: query.reply(query.key_expr, b"yes"))
        found: set[str] = set()
        give_up, end = time.monotonic() + TIMEOUT_S, 0.0
        while time.monotonic() < (end or give_up):
            for key in ("bridge/mast/lease", "bridge/hill/lease", "console/feed", "snapshot"):
                replies = hub._session.get(f"{MISSION}/{key}", timeout=1.0)
                found |= {key for reply in replies if reply.ok is not None}
            if found and not end:
                end = time.monotonic() + QUIET_S
    assert found == {"bridge/mast/lease"}


def test_liveliness_is_seen_of_whom_it_is_announced_by_right(
    keys: dict[str, Path], hub: ZenohSession
) -> None:
    seen_by_hub: set[str] = set()
    seen_by_bridge: set[str] = set()
    watcher = hub._session.liveliness().declare_subscriber(
        f"{MISSION}/**", lambda sample: seen_by_hub.add(str(sample.key_expr))
    )
    token = hub._session.liveliness().declare_token(f"{MISSION}/command/hub")
    with hostile(hub, keys["mast"]) as bridge, hostile(hub, keys["hill"]) as hill:
        seen = bridge.liveliness().declare_subscriber(
            f"{MISSION}/command/*", lambda sample: seen_by_bridge.add(str(sample.key_expr)), history=True
        )
        tokens = [
            hill.liveliness().declare_token(f"{MISSION}/{key}")
            for key in ("bridge/mast", "command/spare", "bridge/hill")
        ]
        wait_until(lambda: f"{MISSION}/bridge/hill" in seen_by_hub and bool(seen_by_bridge))
        time.sleep(QUIET_S)
        del seen, tokens
    assert {one for one in seen_by_hub if "hub" not in one} == {f"{MISSION}/bridge/hill"}
    assert seen_by_bridge == {f"{MISSION}/command/hub"}
    watcher.undeclare()
    token.undeclare()


def test_a_standby_gets_the_history_of_events(keys: dict[str, Path], hub: ZenohSession) -> None:
    """zenoh's advanced publisher and subscriber need keys of their own."""
    publisher = ext.declare_advanced_publisher(
        hub._session,
        f"{MISSION}/events",
        cache=ext.CacheConfig(max_samples=100),
        publisher_detection=True,
        sample_miss_detection=ext.MissDetectionConfig(heartbeat=0.2),
    )
    for number in range(50):
        publisher.put(b"%d" % number)
    found: list[int] = []
    with hostile(hub, keys["spare"]) as standby:
        subscriber = ext.declare_advanced_subscriber(
            standby,
            f"{MISSION}/events",
            lambda sample: found.append(int(sample.payload.to_bytes())),
            history=ext.HistoryConfig(detect_late_publishers=True),
            recovery=ext.RecoveryConfig(heartbeat=True),
        )
        wait_until(lambda: len(found) >= 50)
        for number in range(50, 100):
            publisher.put(b"%d" % number)
        wait_until(lambda: len(found) >= 100)
        subscriber.undeclare()
    assert found == list(range(100))


def test_rights_are_checked_for_whole_key_expressions() -> None:
    assert may("viewer", "vic", "subscribe", f"{MISSION}/picture/*")
    assert not may("viewer", "vic", "subscribe", f"{MISSION}/**")
    assert not may("operator", "anna", "put", "other/order")
    assert may("command", "hub", "subscribe", f"{MISSION}/events/@adv/pub/1/2/_")


def test_every_role_is_in_the_table() -> None:
    assert list(RIGHTS) == list(ROLES)


def test_the_page_shows_the_table() -> None:
    """The documentation would promise other rights."""
    page = (Path(__file__).parents[3] / "docs" / "security.md").read_text(encoding="utf-8")
    expected = "\n".join(row_of(role) for role in ROLES)
    assert expected in page, f"docs/security.md needs these rows:\n{expected}"


def row_of(role: Role) -> str:
    rights = RIGHTS[role]
    cells = [keys_text(keys) for keys in (rights.put, rights.subscribe, rights.query, rights.answer)]
    liveliness = [
        f"{verb} {keys_text(keys)}"
        for verb, keys in (("announces", rights.announce), ("watches", rights.watch))
        if keys
    ]
    return f"| {role} | {' | '.join(cells)} | {'; '.join(liveliness)} |"


def keys_text(keys: tuple[str, ...]) -> str:
    return ", ".join(f"`{key.format(name='<name>')}`" for key in keys)
