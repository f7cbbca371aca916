"""Vehicles would lose their ground station, and go to RTL on the ground, while an operator prepares them."""

import pytest

from gcs.config import parse, read_text
from gcs.config.key_overrides import override_keys
from gcs.errors import LinkError
from gcs.io.vehicles.vehicle_access import vehicle_access
from gcs.io.zenoh.discovery import announced

FORWARDS = """links.forward=[{endpoint="udpin:0.0.0.0:14551", access="read-only"},
    {endpoint="tcpin:127.0.0.1:5771", access="full"}, {endpoint="udpout:10.0.0.9:14550", access="full"}]"""


@pytest.fixture
def mission(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return lambda *settings: parse(override_keys(read_text("prescribed")[0], settings, "m"), "m")


def test_without_a_service_the_mission_file_s_links_are_used_as_central_command(mission):
    config = mission('links.mavlink="udpin:127.0.0.1:14580"', FORWARDS)
    entrance = vehicle_access(config, None, writes=True)
    assert [link.name for link in entrance.links] == ["udpin:127.0.0.1:14580"]
    assert entrance.own[0] == 255
    assert not entrance.description


def test_while_the_service_runs_its_forward_endpoint_is_used_under_another_id(mission):
    config = mission(FORWARDS)
    with announced(config.name, "tcp/127.0.0.1:7447"):
        for writes in (True, False):
            entrance = vehicle_access(config, None, writes=writes)
            assert [link.name for link in entrance.links] == ["tcp:127.0.0.1:5771"]
            assert entrance.own[0] != 255  # the service's own: what speaks with it is kept out
        assert "through gcs run" in entrance.description
        assert vehicle_access(mission('name="other"'), None, writes=True).service is None


def test_a_service_that_permits_no_writes_is_named_with_the_remedy(mission):
    config = mission('links.forward=[{endpoint="udpin:0.0.0.0:14551", access="read-only"}]')
    with announced(config.name, "tcp/127.0.0.1:7447"):
        (link,) = vehicle_access(config, None, writes=False).links
        assert link.name == "udpout:127.0.0.1:14551"
        with pytest.raises(LinkError, match='access = "full"'):
            vehicle_access(config, None, writes=True)


def test_a_network_without_agents_needs_no_forward_endpoint(mission):
    links = 'links.mavlink=["udpin:0.0.0.0:14550", {endpoint="tcp:192.168.1.20:5760", network=1}]'
    config = mission(links, FORWARDS)
    with announced(config.name, "tcp/127.0.0.1:7447"):
        (link,) = vehicle_access(config, None, writes=True).links
        assert link.name == "tcp:127.0.0.1:5771"
