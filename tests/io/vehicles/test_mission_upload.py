"""A user uploads a mission in one call: it is stored and flown, or the call says why not."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.field_vehicles import free_port, vehicle_process
from helpers.plane_double import AUTO, LOITER, Plane, S
from pymavlink import mavutil

from gcs.errors import LinkError
from gcs.geo import LocalFrame
from gcs.io.vehicles import upload_mission
from gcs.io.vehicles.missions import MissionTask
from gcs.mavlink import Encoder, Mission, Waypoint, decode
from sim_vehicles.vehicle.vehicle import VehicleSpec

FRAME = LocalFrame(33.2, -87.6, 60.0)
WAYPOINTS = np.array([[33.203, -87.599, 100.0], [33.206, -87.596, 110.0], [33.203, -87.593, 120.0]])
MISSION = Mission(1, 1, tuple(Waypoint(*row, 40.0) for row in WAYPOINTS.tolist()))


def read_with_pymavlink(port: int) -> list[tuple[int, float, float, float]]:
    """Return command, latitude, longitude and height of the stored items, by another ground station."""
    link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=250)
    link.wait_heartbeat(timeout=10)
    link.mav.mission_request_list_send(1, 1)
    count = link.recv_match(type="MISSION_COUNT", blocking=True, timeout=10).count
    items = []
    for seq in range(count):
        link.mav.mission_request_int_send(1, 1, seq)
        item = link.recv_match(
            type="MISSION_ITEM_INT", condition=f"MISSION_ITEM_INT.seq=={seq}", blocking=True, timeout=10
        )
        items.append((item.command, item.x * 1e-7, item.y * 1e-7, item.z))
    link.close()
    return items


def test_a_mission_is_stored_and_flown_by_a_vehicle_on_udp() -> None:
    port = free_port()
    with vehicle_process([VehicleSpec(1, 100.0, 100.0, 0.0, 100.0, 15.0)], FRAME, port):
        result = upload_mission(f"udpin:127.0.0.1:{port}", 1, WAYPOINTS)
        assert (result.ok, result.onboard, result.selected) == (True, "equal", True)
        assert result.items is not None
        stored = read_with_pymavlink(port)
    assert len(stored) == len(result.items) == 5  # home, three waypoints, the loiter at the last one
    np.testing.assert_allclose([row[1:] for row in stored[1:4]], WAYPOINTS, atol=1e-6)
    assert [row[0] for row in stored[1:]] == [16, 16, 16, 17]


def test_a_vehicle_that_is_not_there_is_named() -> None:
    endpoint = f"udpin:127.0.0.1:{free_port()}"
    with pytest.raises(LinkError, match="vehicle 7 not heard: is it on, with this system id"):
        upload_mission(endpoint, 7, WAYPOINTS, heard_within_s=0.2)


@pytest.mark.parametrize(
    ("waypoints", "said"),
    [
        (WAYPOINTS[:, :2], r"waypoints: expected shape \(k, 3\).*got \(3, 2\)"),
        ([], r"waypoints: expected shape \(k, 3\) with at least one row"),
        ([[91.0, 0.0, 10.0]], "expected latitudes of -90 to 90"),
        ([[1.0, 0.0, math.nan]], "finite heights"),
    ],
)
def test_waypoints_of_another_shape_are_refused_in_words(waypoints, said) -> None:
    with pytest.raises(ValueError, match=said):
        upload_mission("udpin:127.0.0.1:0", 1, waypoints)


def run_in_memory(plane: Plane, task: MissionTask) -> None:
    """Join both ends without a link for two minutes at most."""
    for t_ns in range(0, 120 * S, S // 20):
        for data in plane.poll(t_ns):
            for message in decode(data)[0]:
                for frame in task.receive(message, t_ns):
                    for answer in plane.receive(frame, t_ns):
                        for reply in decode(answer)[0]:
                            task.receive(reply, t_ns)
        for frame in task.poll(t_ns):
            for answer in plane.receive(frame, t_ns):
                for message in decode(answer)[0]:
                    for more in task.receive(message, t_ns):
                        plane.receive(more, t_ns)
        if task.is_done:
            return


MANUAL = 0


def test_a_vehicle_in_another_mode_keeps_its_pilot_unless_resume_is_given() -> None:
    plane = Plane(mode=MANUAL, armed=False)
    refused = MissionTask(MISSION, Encoder(), resume=False)
    run_in_memory(plane, refused)
    assert refused.problem == "is in MANUAL: expected AUTO or LOITER; resume=True uploads all the same"
    assert (plane.mode, plane.commands, len(plane.store)) == (MANUAL, [], 0)
    taken = MissionTask(MISSION, Encoder(), resume=True)
    run_in_memory(plane, taken)
    assert taken.result is not None
    assert taken.result.ok, taken.result.detail
    assert plane.mode == AUTO
    assert len(plane.store) == 5


def test_a_vehicle_in_auto_gets_loiter_before_its_mission_is_replaced() -> None:
    plane = Plane(mode=LOITER)
    task = MissionTask(MISSION, Encoder(), resume=False)
    run_in_memory(plane, task)
    plane.mean(list(task.result.items))
    again = MissionTask(MISSION, Encoder(), resume=False)
    run_in_memory(plane, again)
    assert again.result.ok
    assert again.result.was_held
    assert plane.mixed_legs == []
