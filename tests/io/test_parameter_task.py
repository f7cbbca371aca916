"""A user would fly with a parameter that was never set, or change one under a vehicle in the air."""

from collections import deque

import pytest

from gcs.geo import LocalFrame
from gcs.io.vehicles.parameters import ParameterTask
from gcs.io.vehicles.session import NOT_HEARD
from gcs.mavlink.frames.codec import Encoder, decode
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

S = 1_000_000_000


def talked(names, value=None, *, autopilot="ardupilot", airborne=False, armed_too=False):
    """Talk to vehicle 7 in memory; returns the talk and the vehicle's parameters."""
    spec = VehicleSpec(7, 0.0, 0.0, 0.0, 100.0, 15.0, autopilot=autopilot, airborne=airborne)
    plane = SimVehicle(spec, LocalFrame(33.2, -87.6, 70.0), 0)
    task = ParameterTask(7, names, value, Encoder(), armed_too=armed_too)
    t_ns, to_plane = S, deque()
    while not task.is_done and t_ns < 60 * S:
        for data in [to_plane.popleft() for _ in range(len(to_plane))]:
            plane.receive_datagram(data, t_ns)
        for data in plane.datagrams_to_send(t_ns):
            for message in decode(data)[0]:
                to_plane += task.receive(message, t_ns)
        to_plane += task.poll(t_ns)
        t_ns += S // 20
    return task, plane.autopilot.parameters


@pytest.mark.parametrize(
    ("autopilot", "name", "value"), [("ardupilot", "FS_LONG_ACTN", 1), ("px4", "NAV_DLL_ACT", 2)]
)
def test_a_parameter_is_set_and_read_back(autopilot, name, value):
    task, parameters = talked([name], value, autopilot=autopilot)
    assert (task.ok, parameters[name]) == (True, value)
    assert task.rows() == [(name, True, value, f"{name} = {value}")]


def test_parameters_are_shown_and_one_that_is_not_there_is_named():
    task, _ = talked(["FS_LONG_ACTN", "NOT_THERE"])
    assert task.rows() == [
        ("FS_LONG_ACTN", True, 0.0, ""),
        ("NOT_THERE", False, None, "no such parameter, or no answer"),
    ]
    assert not task.ok


def test_nothing_is_set_on_an_armed_vehicle_unless_that_is_asked_for():
    task, parameters = talked(["FS_LONG_ACTN"], 1.0, airborne=True)
    assert (task.ok, parameters["FS_LONG_ACTN"]) == (False, 0)
    assert "--armed" in task.rows()[0][3]
    task, parameters = talked(["FS_LONG_ACTN"], 1.0, airborne=True, armed_too=True)
    assert (task.ok, parameters["FS_LONG_ACTN"]) == (True, 1)


def test_a_vehicle_that_is_not_heard_is_named():
    assert ParameterTask(7, ["A"], None, Encoder()).rows() == [("A", False, None, NOT_HEARD)]
