"""Two vehicles that fly missions of this service meet at one height; before, they were warned of only."""

import numpy as np
import pytest
from helpers.sky import FIELD, Sky, fly_on

from gcs.model import NoticeCode, Order
from sim_vehicles.autopilots.base import Mode

CROSSING = FIELD.replace("layers = 8", "layers = 1").replace(
    "2900.0\nnorth_m = 2900.0", "2600.0\nnorth_m = 1500.0"
)
CROSSING = CROSSING.replace("100.0\nnorth_m = 2900.0", "1500.0\nnorth_m = 2600.0")
WARNING = CROSSING.replace("[planning]", '[planning]\navoidance = "warn"')


def crossing(field=CROSSING, px4=()):
    """Return two that are pinned to targets behind their crossing; with one layer, they meet there."""
    sky = Sky((500.0, 1500.0, 60.0), (1500.0, 500.0, 60.0), courses_deg=[90.0, 0.0], field=field, px4=px4)
    fly_on(sky, 8.0)
    for vehicle in (1, 2):
        labels = sky.run_.engine.stages.trackers.targets.confirmation.tracks
        ends = {label: (track.mean[0], track.mean[1]) for label, track in labels.items()}
        target = max(ends, key=lambda label: ends[label][vehicle - 1])
        sky.run_.order(Order(sky.run_.t_ns, f"pin-{vehicle}", "pin", (vehicle,), target=target))
    return fly_on(sky, 4.0)


def apart_m(sky):
    one, other = sky.planes[1], sky.planes[2]
    return np.hypot(one.east_m - other.east_m, one.north_m - other.north_m)


def least_m(sky, for_s):
    least = np.inf
    for _ in range(round(for_s / 0.4)):
        fly_on(sky, 0.4)
        least = min(least, apart_m(sky))
    return least


@pytest.mark.parametrize("px4", [(), (1, 2)])
def test_one_of_two_that_would_meet_holds_and_flies_on_when_they_are_apart(px4):
    sky = crossing(px4=px4)
    assert least_m(sky, 90.0) > 60.0
    ((begin_s, notice),) = sky.told(NoticeCode.AVOIDS)
    ((end_s, over),) = sky.told(NoticeCode.AVOIDS_NO_LONGER)
    assert notice.key in over.ended
    assert end_s - begin_s < 40.0
    agents = sky.run_.engine.state.agents
    assert [plane.autopilot.mode for plane in sky.planes.values()] == [Mode.AUTO, Mode.AUTO]
    assert all(agent.control.is_ours for agent in agents.values())
    assert not sky.told(NoticeCode.SEPARATION_LOST)
    fly_on(sky, 120.0)
    assert sorted(agent.perception.status.status for agent in agents.values()) == ["arrived", "arrived"]


def test_without_it_they_meet_and_are_told():
    sky = crossing(WARNING)
    assert least_m(sky, 90.0) < 30.0
    assert sky.told(NoticeCode.COMES_NEAR)
    assert not sky.told(NoticeCode.AVOIDS)
