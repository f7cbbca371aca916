"""A user of the MAVLink parts imports them from one place; a short command does not wait for the dialect."""

from __future__ import annotations

import subprocess
import sys

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

import gcs.mavlink
from gcs.mavlink import Encoder, Link, Router, decode, parse_endpoint, scan

PUBLIC = """ARDUPLANE PX4 AutopilotProfile Encoder Event Frame FrameStream FrameTable Home Item Link Mission
ModeAuthority OnboardState Routed Router Upload UploadPolicy UploadResult UploadState Waypoint build_items
decode item_of list_upload mission_upload parse_endpoint scan target_of"""


def test_the_public_names_are_these():
    assert sorted(gcs.mavlink.__all__) == sorted(PUBLIC.split())
    assert all(getattr(gcs.mavlink, name) is not None for name in gcs.mavlink.__all__)
    with pytest.raises(AttributeError, match="no attribute 'upload'"):
        _ = gcs.mavlink.upload


def test_importing_the_package_loads_no_dialect():
    code = "import sys, gcs.mavlink; print([m for m in ('pymavlink', 'numpy', 'numba') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_frames_are_packed_scanned_and_routed_with_the_public_names_alone():
    heartbeat = dialect.MAVLink_heartbeat_message(1, 3, 1, 12, 4, 3)
    data = Encoder(1, 1)(heartbeat)
    (message,), table = decode(data)
    assert message.custom_mode == 12
    assert (table.count, scan(data).bad_bytes) == (1, 0)
    links = [
        Link(parse_endpoint("udpin:127.0.0.1:14550")),
        Link(parse_endpoint("udpout:127.0.0.1:14560"), role="full"),
    ]
    router = Router(links, [1])
    routed = router.route_frame(0, (links[0].name, "127.0.0.1:5000"), table.frame(0))
    assert routed.to == ((links[1].name, "127.0.0.1:14560"),)
