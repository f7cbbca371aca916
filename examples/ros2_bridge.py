"""Publish each vehicle's position for ROS 2, as sensor_msgs/NavSatFix on /swarm/vehicle_N/fix.

zenoh-bridge-ros2dds -l tcp/127.0.0.1:7448            # on the machine of the ROS 2 nodes
python examples/ros2_bridge.py prescribed tcp/127.0.0.1:7447 tcp/127.0.0.1:7448
"""

import json
import sys
import time

import numpy as np
import zenoh
from rosbags.typesys import Stores, get_typestore

from gcs.config import load

config, ros = load(sys.argv[1]), get_typestore(Stores.ROS2_HUMBLE)
Time, Header = ros.types["builtin_interfaces/msg/Time"], ros.types["std_msgs/msg/Header"]
NavSatFix, NavSatStatus = ros.types["sensor_msgs/msg/NavSatFix"], ros.types["sensor_msgs/msg/NavSatStatus"]


def publish(sample: zenoh.Sample) -> None:
    """Publish the position of each vehicle of a status."""
    status = json.loads(sample.payload.to_bytes())
    for agent in status["agents"]:
        if agent["position_m"] is not None:
            place = (*config.local_frame.to_geodetic(*agent["position_m"]), agent["alt_msl_m"])
            header = Header(Time(*divmod(status["t_ns"], 10**9)), f"vehicle_{agent['vehicle']}")
            fix = NavSatStatus(0 if (agent["fix_type"] or 0) >= 3 else -1, 1)
            cdr = ros.serialize_cdr(NavSatFix(header, fix, *place, np.zeros(9), 0), NavSatFix.__msgtype__)
            session.put(f"swarm/vehicle_{agent['vehicle']}/fix", bytes(cdr))  # the topic, without its slash


settings = {"connect": {"endpoints": sys.argv[2:]}, "scouting": {"multicast": {"enabled": False}}}
with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
    answers = session.declare_subscriber(f"swarm/{config.name}/status", publish)
    while True:
        request = {"order_id": f"ros2-{time.time_ns()}", "action": "status", "origin": "ros2"}
        session.put(f"swarm/{config.name}/status_request", json.dumps(request))
        time.sleep(0.5)
