"""A user would trust a simulated fence that stops no vehicle."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.fence import Area, Fence, Rally
from gcs.mavlink.mission.geofence_rally import FENCE, RALLY, fence_items, rally_items
from sim_vehicles.autopilots.autopilot_traits import Mode

EAST_300 = (33.2, -87.596785)
"""About 300 m east of the origin."""


def load(pen, mission_type, items):
    messages = [item.message(n, 7, 1, mission_type=mission_type) for n, item in enumerate(items)]
    assert pen.upload(*messages, mission_type=mission_type) == mavlink.MAV_MISSION_ACCEPTED


def test_a_vehicle_that_leaves_its_fence_returns_with_a_message(ground):
    pen = ground(parameters={"FENCE_ENABLE": 1})
    load(pen, FENCE, fence_items(Fence((Area(True, (), (33.2, -87.6), 400.0),))))
    pen.vehicle.autopilot.set_mode(Mode.FBWA)  # straight on, to the east
    heard = pen.until(lambda: pen.mode == Mode.RTL, 60.0)
    assert 395.0 < pen.vehicle.east_m < 425.0
    texts = [m.text for m in [*heard, *pen.fly(1.0)] if m.get_type() == "STATUSTEXT"]
    assert "Polygon fence breached" in texts
    heard = pen.fly(60.0)
    assert "Fence breach cleared" in [m.text for m in heard if m.get_type() == "STATUSTEXT"]
    assert pen.vehicle.east_m < 400.0


@pytest.mark.parametrize(
    ("parameters", "breached"),
    [
        ({"FENCE_ENABLE": 0}, False),
        ({"FENCE_ENABLE": 1, "FENCE_ACTION": 0}, False),
        ({"FENCE_ENABLE": 1, "FENCE_TYPE": 1, "FENCE_ALT_MAX": 90}, True),
        ({"FENCE_ENABLE": 1, "FENCE_TYPE": 2, "FENCE_RADIUS": 50}, True),
        ({"FENCE_ENABLE": 1, "FENCE_TYPE": 4}, False),
    ],
)
def test_each_kind_of_fence_holds_when_it_is_on(ground, parameters, breached):
    pen = ground(parameters=parameters)
    pen.fly(15.0)
    assert (pen.mode == Mode.RTL) is breached


def test_it_returns_to_the_nearest_rally_point_when_there_is_one(ground):
    pen = ground()
    load(pen, RALLY, rally_items([Rally(*EAST_300, 60), Rally(33.21, -87.6, 60)]))
    pen.vehicle.autopilot.set_mode(Mode.RTL)
    pen.fly(90.0)
    assert abs(pen.vehicle.east_m - 300.0) < 90.0
    assert abs(pen.vehicle.north_m) < 90.0
    assert pen.vehicle.alt_rel_m == pytest.approx(60.0, abs=2.0)
