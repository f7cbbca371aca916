"""Vehicles that land by their missions would come down on each other: four did so within 66 s."""

import msgspec
import numpy as np
import pytest
from helpers.sky import LANDING, NEAR_HEIGHT_M, NEAR_M, Sky
from helpers.staging import S

from gcs.core.preflight.check_codes import CheckCode
from gcs.core.preflight.mission_checks import mission_checks, rehearse
from gcs.core.separation.landing_order import LandingOrder
from gcs.planning.map.grid import free_grid
from sim_vehicles.campaign.virtual_run import START_T_NS

MIN_APART_S = 50.0
STRIP = [(1480.0 + 9.0 * k, 900.0, 60.0 + 20.0 * k) for k in range(3)]


def fly_on_alone(sky, until_s):
    """Fly without a service or a link; return when each vehicle landed, and the pairs that came near."""
    landed, near = {}, set()
    t_s = (sky.run_.t_ns - START_T_NS) / S
    while t_s < until_s and len(landed) < len(sky.planes):
        t_s += 0.5
        for number, plane in sky.planes.items():
            plane.advance(START_T_NS + round(t_s * S))
            plane.datagrams_to_send(START_T_NS + round(t_s * S))
            if not plane.autopilot.flying:
                landed.setdefault(number, t_s)
        flying = [plane for plane in sky.planes.values() if plane.autopilot.flying]
        for k, one in enumerate(flying):
            for other in flying[k + 1 :]:
                away_m = np.hypot(one.east_m - other.east_m, one.north_m - other.north_m)
                if away_m < NEAR_M and abs(one.alt_rel_m - other.alt_rel_m) < NEAR_HEIGHT_M:
                    near.add((one.system_id, other.system_id))
    return landed, near


@pytest.mark.parametrize("px4", [(), (1, 2, 3)])
def test_vehicles_land_one_after_the_other_even_if_the_link_is_lost_after_the_uploads(px4):
    sky = Sky(*STRIP, px4=px4, field=LANDING).fly(30.0)
    assert all(plane.autopilot.mode.name == "AUTO" for plane in sky.planes.values())
    landed, near = fly_on_alone(sky, 700.0)
    times_s = sorted(landed.values())
    assert len(times_s) == 3
    assert min(np.diff(times_s)) >= MIN_APART_S
    assert not near


def test_a_wait_needs_more_room_in_wind():
    """A circle of 30 m was flown up to 106 m from its centre, in wind of 30 % of the airspeed."""
    config = Sky(STRIP[0], field=LANDING).run_.scenario.config
    airframe = msgspec.structs.replace(config.airframe, wind_m_s=5.6)
    return_m = np.array([(0.0, 0.0), (600.0, 0.0), (1200.0, 0.0), (1700.0, 0.0)])
    room_m = LandingOrder(config, None, {})._airframes[1].loiter_radius_m + 70.0
    grid = free_grid((200, 100), 20.0, (-1000.0, -1000.0)).with_obstacles(
        discs_m=[(0.0, room_m + 20.0, 20.0)]
    )
    assert LandingOrder(config, None, {})._corner(1, return_m, grid, []) == -1
    config = msgspec.structs.replace(config, airframe=airframe)
    assert LandingOrder(config, None, {})._corner(1, return_m, grid, []) == 0


def test_a_vehicle_that_lands_alone_does_not_wait():
    sky = Sky(STRIP[0], field=LANDING).fly(30.0)
    commands = [item.command for item in sky.planes[1].autopilot.mission]
    assert 19 not in commands


def test_preflight_names_vehicles_that_would_land_beside_each_other():
    config = Sky(*STRIP, field=LANDING).run_.scenario.config
    rows = mission_checks(config, rehearse(config, 1, {}))
    (row,) = [row for row in rows if row.code is CheckCode.LANDINGS_NEAR]
    assert row.parameters["vehicles"] == (1, 2, 3)
    assert round(row.parameters["distance_m"]) == 9
