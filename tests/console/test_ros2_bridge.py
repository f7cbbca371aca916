"""ROS 2 would get no positions, or bytes that are no NavSatFix.

Instead of zenoh-bridge-ros2dds a zenoh session listens. Another CDR library than that of the example reads.
"""

import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

pycdr2 = pytest.importorskip("pycdr2", reason="pip install '.[test]'")
pytest.importorskip("rosbags", reason="pip install '.[ros2]'")

from pycdr2 import IdlStruct  # noqa: E402
from pycdr2.types import array, float64, int8, int32, uint8, uint16, uint32  # noqa: E402

from gcs.config import load  # noqa: E402
from gcs.io.zenoh.session import ZenohSession, free_endpoint  # noqa: E402

EXAMPLE = Path(__file__).parents[2] / "examples" / "ros2_bridge.py"
WAIT_S = 30.0


@dataclass
class Time(IdlStruct):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct):
    stamp: Time
    frame_id: str


@dataclass
class NavSatStatus(IdlStruct):
    status: int8
    service: uint16


@dataclass
class NavSatFix(IdlStruct):
    """sensor_msgs/NavSatFix: https://docs.ros.org/en/humble/p/sensor_msgs/interfaces/msg/NavSatFix.html."""

    header: Header
    status: NavSatStatus
    latitude: float64
    longitude: float64
    altitude: float64
    position_covariance: array[float64, 9]
    position_covariance_type: uint8


def test_each_vehicle_has_a_topic_of_fixes_in_cdr(fly, launch):
    frame = load("prescribed").local_frame
    received: dict[str, bytes] = {}
    with fly() as flight, ZenohSession(listen=(bridge := free_endpoint())) as bus:
        launch(flight)
        bus.subscribe("swarm/*/fix", received.__setitem__)
        command = [sys.executable, str(EXAMPLE), "prescribed", flight.endpoint, bridge]
        with subprocess.Popen(command) as process:
            try:
                until_s = time.monotonic() + WAIT_S
                while len(received) < 2 and time.monotonic() < until_s:
                    assert process.poll() is None
                    time.sleep(0.05)
            finally:
                process.terminate()
    assert received.keys() == {"swarm/vehicle_1/fix", "swarm/vehicle_3/fix"}
    for vehicle in (1, 3):
        fix = NavSatFix.deserialize(received[f"swarm/vehicle_{vehicle}/fix"])
        assert fix.header.frame_id == f"vehicle_{vehicle}"
        assert fix.header.stamp.sec == pytest.approx(time.time(), abs=60.0)
        assert (fix.status.status, fix.status.service) == (0, 1)
        _, north_m = frame.to_local(fix.latitude, fix.longitude)
        assert north_m == pytest.approx(300.0 * vehicle, abs=250.0)  # it circles near where it was launched
        assert fix.altitude == pytest.approx(frame.alt_msl_m + 100.0, abs=50.0)
        assert fix.position_covariance_type == 0
