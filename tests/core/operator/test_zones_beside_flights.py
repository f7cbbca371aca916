"""A zone in another height than a vehicle's flight would block it, or one in a part of the band would not.

Over terrain the flight band is 50 m to 120 m above the ground, and 20 m are kept from zones. On a flat map a
zone that leaves any layer less blocks all of them.
"""

from functools import lru_cache

import numpy as np
import pytest
from helpers.hills import elevation_of, terrain_table
from helpers.sky import FIELD, Sky, fly_on, give, with_one_home

from gcs.model import NoFlyZone, NoticeCode, Order, VerticalLimits
from sim_vehicles.autopilots.autopilot_traits import Mode

RISE = 0.02
HOME_M = (1500.0, 1500.0)
FLAT = FIELD.replace("[planning]", "[planning]\nclearance_m = 20.0")
TERRAIN = FLAT + terrain_table(elevation_of(lambda east, north: 70.0 + RISE * east + 0.0 * north, 3000.0))
BELOW = VerticalLimits(None, 20.0, "ground")
ABOVE = VerticalLimits(200.0, None, "ground")
LOW_PART = VerticalLimits(None, 75.0, "ground")
HIGH_PART = VerticalLimits(95.0, None, "ground")
ALL = VerticalLimits(30.0, 300.0, "ground")


def close(sky, disc_m, limits):
    """Close a zone; return the answer."""
    zone = NoFlyZone("fire", disc_m, limits=limits)
    sky.run_.order(Order(sky.run_.t_ns, "fire", "no-fly-zone", None, no_fly_zone=zone))
    fly_on(sky, 0.4)
    (answer,) = [one for one in sky.answers if one.action == "no-fly-zone"]
    return answer.detail


def agl_inside(sky, vehicle, disc_m, for_s, rise=RISE, *, until_home=False):
    """Fly on, at most to its home; return the heights above ground at which a vehicle was over a zone."""
    plane = sky.planes[vehicle]
    found = []
    for _ in range(round(for_s)):
        fly_on(sky, 1.0)
        if np.hypot(plane.east_m - disc_m[0], plane.north_m - disc_m[1]) < disc_m[2]:
            found.append(plane.alt_msl_m - 70.0 - rise * plane.east_m)
        if until_home and np.hypot(plane.east_m - HOME_M[0], plane.north_m - HOME_M[1]) < 150.0:
            break
    return found


def check(limits, detail, heights_m, codes):
    """Check that a vehicle met no zone, and was not led around one that it passes over or under."""
    floor_m, ceiling_m = limits.bounds_m
    assert not any(floor_m < height_m < ceiling_m for height_m in heights_m)
    assert not codes & {NoticeCode.ZONE_ENTERED, NoticeCode.ZONE_AHEAD, NoticeCode.HOLDS_BEFORE_ZONE}
    if limits in (BELOW, ABOVE):
        assert "led around" not in detail
    assert bool(heights_m) is (limits is not ALL)


def returning(field):
    """Return a sky in which vehicle 2 flies home by a mission, and a disc across its way."""
    sky = sent_home(field).copy()
    plane = sky.planes[2]
    return sky, (0.5 * (plane.east_m + HOME_M[0]), 0.5 * (plane.north_m + HOME_M[1]), 80.0)


@lru_cache
def sent_home(field):
    sky = with_one_home(Sky((600.0, 600.0, 60.0), (2600.0, 2600.0, 80.0), field=field))
    give(sky, "return")
    fly_on(sky, 6.0)
    assert sky.run_.engine.state.agents[2].routes.stacked is not None
    return sky


@pytest.mark.parametrize("limits", [BELOW, ABOVE, LOW_PART, HIGH_PART, ALL])
def test_a_return_by_a_mission_over_terrain(limits):
    sky, disc_m = returning(TERRAIN)
    detail = close(sky, disc_m, limits)
    heights_m = agl_inside(sky, 2, disc_m, 120.0, until_home=True)
    check(limits, detail, heights_m, {notice.code for _, notice in sky.notices})
    assert np.hypot(sky.planes[2].east_m - HOME_M[0], sky.planes[2].north_m - HOME_M[1]) < 200.0


@pytest.mark.parametrize("limits", [BELOW, VerticalLimits(240.0, None, "home"), ALL])
def test_a_return_by_a_mission_on_a_flat_map(limits):
    """The layers are 60 m to 200 m above home."""
    sky, disc_m = returning(FLAT)
    detail = close(sky, disc_m, limits)
    heights_m = agl_inside(sky, 2, disc_m, 110.0, rise=0.0, until_home=True)
    check(limits, detail, heights_m, {notice.code for _, notice in sky.notices})
    assert np.hypot(sky.planes[2].east_m - HOME_M[0], sky.planes[2].north_m - HOME_M[1]) < 200.0


def at_target(field, limits=None):
    """Return a sky with a vehicle at its target, a disc round it, and the answer to its closure."""
    sky = (on_its_way if limits else arrived)(field).copy()
    target_m = on_its_way(field).run_.engine.state.agents[1].routes.flown.target_point_m
    disc_m = (*target_m, 250.0)
    detail = "" if limits is None else close(sky, disc_m, limits)
    return until_arrived(sky), disc_m, detail


@lru_cache
def on_its_way(field):
    return fly_on(Sky((2300.0, 2300.0, 70.0), courses_deg=[45.0], field=field), 8.0)


@lru_cache
def arrived(field):
    return until_arrived(on_its_way(field).copy())


def until_arrived(sky):
    agent = sky.run_.engine.state.agents[1]
    for _ in range(200):
        fly_on(sky, 1.0)
        if agent.perception.status.status == "arrived":
            break
    return sky


@pytest.mark.parametrize("is_closed_before", [True, False])
@pytest.mark.parametrize("limits", [BELOW, ABOVE, LOW_PART, HIGH_PART])
def test_the_circle_at_a_target_over_terrain(limits, is_closed_before):
    sky, disc_m, detail = at_target(TERRAIN, limits if is_closed_before else None)
    if not is_closed_before:
        detail = close(sky, disc_m, limits)
        fly_on(sky, 25.0)  # it changes its height
        sky.notices.clear()
    heights_m = agl_inside(sky, 1, disc_m, 30.0)  # once round
    assert len(heights_m) == 30
    check(limits, detail, heights_m, {notice.code for _, notice in sky.notices})
    assert sky.run_.engine.state.agents[1].perception.status.status == "arrived"


@pytest.mark.parametrize("limits", [ALL, VerticalLimits(None, None)])
def test_a_vehicle_that_circles_over_terrain_leaves_a_zone_without_room_over_or_under_it(limits):
    """Before, no route began inside a zone: it circled there on."""
    sky, disc_m, _ = at_target(TERRAIN)
    detail = close(sky, disc_m, limits)
    assert "agent 1 led around it" in detail
    agl_inside(sky, 1, disc_m, 60.0)
    assert not agl_inside(sky, 1, disc_m, 60.0)
    plane = sky.planes[1]
    assert 50.0 < plane.alt_msl_m - 70.0 - RISE * plane.east_m < 120.0


@pytest.mark.parametrize("limits", [BELOW, VerticalLimits(240.0, None, "home")])
def test_the_circle_at_a_target_on_a_flat_map(limits):
    sky, disc_m, _ = at_target(FLAT)
    detail = close(sky, disc_m, limits)
    heights_m = agl_inside(sky, 1, disc_m, 30.0, rise=0.0)
    assert len(heights_m) == 30
    check(limits, detail, heights_m, {notice.code for _, notice in sky.notices})
    assert sky.run_.engine.state.agents[1].perception.status.status == "arrived"


def one_far_from_home(disc_m, limits=ALL, field=FLAT):
    """Return a sky of one vehicle whose straight way home leads through a closed zone, ordered to return."""
    sky = with_one_home(Sky((600.0, 2400.0, 80.0), field=field), (2400.0, 600.0))
    close(sky, disc_m, limits)
    give(sky, "return")
    return sky


@pytest.mark.parametrize(
    ("disc_m", "for_s"), [((1700.0, 1500.0, 200.0), 180.0), ((2400.0, 510.0, 40.0), 250.0)]
)
def test_a_vehicle_that_rtl_would_lead_into_a_zone_returns_by_a_mission_around_it(disc_m, for_s):
    """The second zone meets the circle at home alone. Before, it flew in and out of it each 25 s."""
    sky = one_far_from_home(disc_m)
    assert agl_inside(sky, 1, disc_m, for_s, rise=0.0) == []
    plane = sky.planes[1]
    assert np.hypot(plane.east_m - 2400.0, plane.north_m - 600.0) < 300.0
    assert plane.autopilot.mode is Mode.AUTO
    assert sky.told(NoticeCode.ZONE_AHEAD) == []


def test_one_whose_rtl_leads_over_a_zone_returns_by_rtl():
    sky = one_far_from_home((1700.0, 1500.0, 200.0), VerticalLimits(None, 20.0, "home"))
    fly_on(sky, 3.0)
    assert sky.planes[1].autopilot.mode is Mode.RTL


def test_a_return_by_rtl_through_a_zone_without_another_way_waits_until_it_is_ordered_again():
    sky = one_far_from_home((2400.0, 600.0, 300.0))  # round its home
    fly_on(sky, 3.0)
    assert sky.planes[1].autopilot.mode is Mode.AUTO
    ((_, notice),) = sky.told(NoticeCode.ORDER_WAITS)
    assert notice.parameters["reason"] == "would fly into no-fly zone fire"
    give(sky, "return")
    fly_on(sky, 3.0)
    assert sky.planes[1].autopilot.mode is Mode.RTL
