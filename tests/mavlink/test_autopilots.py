"""A user would lose the aircraft to an item that means something else on another autopilot."""

import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import ARDUPLANE, PROFILES, PX4, mode_name, profile_of
from gcs.mavlink.autopilots.modes import AUTO, LOITER, RTL
from gcs.mavlink.frames.codec import Encoder, decode
from gcs.mavlink.mission.item_builder import build_items, first_flown_item
from gcs.mavlink.mission.items import Home, item_of
from gcs.model import Mission, Waypoint

HOME = Home(33.2, -87.6, 70.0)
ROUTE = (Waypoint(33.21, -87.6, 100.0, 10.7), Waypoint(33.22, -87.59, 120.0, 10.0))
WP, LOITER_UNLIM, LAND, TAKEOFF = 16, 17, 21, 22
GLOBAL, RELATIVE = 0, 3  # MAV_FRAME


def mission(end="loiter"):
    return Mission(1, 1, ROUTE, 30.0, end)


def commands(profile, **options):
    return [
        item.command for item in build_items(profile, mission(**options.pop("mission", {})), HOME, **options)
    ]


def test_home_comes_first_on_ardupilot_alone():
    assert commands(ARDUPLANE) == [WP, WP, WP, LOITER_UNLIM]
    assert commands(PX4) == [WP, WP, LOITER_UNLIM]


@pytest.mark.parametrize("profile", PROFILES, ids=lambda p: p.name)
def test_from_the_ground_it_takes_off_first_and_begins_there_while_it_stands(profile):
    assert commands(profile, from_ground=True)[profile.home_items :] == [TAKEOFF, WP, WP, LOITER_UNLIM]
    first = first_flown_item(profile, 0, from_ground=True, still_on_ground=True)
    assert commands(profile, from_ground=True)[first] == TAKEOFF
    later = first_flown_item(profile, 1, from_ground=True, still_on_ground=False)
    assert build_items(profile, mission(), HOME, from_ground=True)[later].x == 332200000


@pytest.mark.parametrize("profile", PROFILES, ids=lambda p: p.name)
def test_a_landing_is_at_home_behind_an_approach_that_both_autopilots_take(profile):
    *_, last, approach, touch_down = build_items(profile, mission("land"), HOME)
    assert (touch_down.command, touch_down.x, touch_down.y, touch_down.z_m) == (
        LAND,
        332000000,
        -876000000,
        0.0,
    )
    metres = (
        math.hypot(approach.x - 332000000, (approach.y + 876000000) * math.cos(math.radians(33.2)))
        * 0.0111195
    )
    assert metres == pytest.approx(500.0, rel=0.01)
    assert math.degrees(math.atan2(approach.z_m, metres)) < 5.0
    assert last.command == WP


def test_what_has_no_meaning_is_nan_for_px4_and_0_for_ardupilot():
    assert all(math.isnan(item.param4) for item in build_items(PX4, mission(), HOME))
    assert all(item.param4 == 0.0 for item in build_items(ARDUPLANE, mission(), HOME))


def over_the_wire(items):
    encode = Encoder(1, 1)
    return [item_of(decode(encode(item.message(seq, 255, 190)))[0][0]) for seq, item in enumerate(items)]


def test_px4_keeps_radii_that_ardupilot_rounds():
    for profile, equal in ((ARDUPLANE, True), (PX4, False)):
        sent = build_items(profile, mission(), HOME)
        held = over_the_wire(sent)
        at = profile.home_items
        assert profile.difference(sent, held) == ""
        held[at] = held[at]._replace(param2=10.0)
        assert (profile.difference(sent, held) == "") is equal


def test_item_0_is_compared_where_it_is_flown():
    for profile, ignored in ((ARDUPLANE, True), (PX4, False)):
        sent = build_items(profile, mission(), HOME)
        held = [sent[0]._replace(x=1), *sent[1:]]
        assert (profile.difference(sent, held) == "") is ignored


@pytest.mark.parametrize("profile", PROFILES, ids=lambda p: p.name)
def test_every_mode_has_a_name_and_back(profile):
    for numbers, name in profile.modes.items():
        custom = numbers[0] if profile is ARDUPLANE else numbers[0] << 16 | numbers[1] << 24
        assert profile.mode_name(custom) == name
        assert profile.mode_numbers(name) == numbers
    assert {AUTO, LOITER, RTL} <= set(profile.modes.values())
    assert profile.mode_name(99 << 16) == f"MODE({99 << 16})"


def test_px4s_sub_modes_of_a_manual_mode_keep_its_name():
    assert PX4.mode_name(3 << 16 | 2 << 24) == "POSCTL"


def test_a_firmware_or_a_copter_that_is_not_known_has_no_profile():
    assert profile_of(3) is ARDUPLANE
    assert profile_of(12) is PX4
    assert profile_of(3, dialect.MAV_TYPE_QUADROTOR) is None
    assert profile_of(13) is None
    assert mode_name(dialect.MAVLink_heartbeat_message(2, 3, 0, 10, 4, 3)) == "MODE(10)"


@pytest.mark.parametrize("profile", PROFILES, ids=lambda p: p.name)
def test_wishes_for_parameters_are_ranges_with_a_reason(profile):
    names = [name for wish in profile.parameters for name in wish.names]
    assert len(names) == len(set(names))
    for wish in profile.parameters:
        assert wish.low <= wish.high
        assert wish.why
        assert all(len(name) <= 16 for name in wish.names)


@pytest.mark.parametrize("profile", PROFILES, ids=lambda p: p.name)
def test_a_vehicle_on_its_way_home_stays_in_its_layer_until_its_descent(profile):
    """Both autopilots lost height from the target on, through the layers of the others."""
    *_, target, descent, approach, _ = build_items(profile, mission("land"), HOME)
    assert (target.z_m, descent.z_m, approach.z_m) == (120.0, 120.0, 30.0)
    north_m = (descent.x - approach.x) * 0.0111195
    east_m = (descent.y - approach.y) * 0.0111195 * math.cos(math.radians(33.2))
    assert math.hypot(north_m, east_m) == pytest.approx((120.0 - 30.0) / 0.15, rel=0.01)
    on_leg = (descent.x - approach.x) * (target.y - approach.y)
    assert (descent.y - approach.y) * (target.x - approach.x) == pytest.approx(on_leg, rel=0.01)


@pytest.mark.parametrize("profile", PROFILES, ids=lambda p: p.name)
def test_a_circle_elsewhere_comes_after_the_last_waypoint(profile):
    wait = Waypoint(33.225, -87.585, 120.0, 10.0)
    *_, last, circle = build_items(profile, Mission(1, 1, ROUTE, 30.0, wait=wait), HOME)
    assert (last.command, last.x, last.y) == (WP, 332200000, -875900000)
    assert (circle.command, circle.x, circle.y) == (LOITER_UNLIM, 332250000, -875850000)
    assert (circle.z_m, circle.param3) == (120.0, 30.0)


@pytest.mark.parametrize("profile", PROFILES, ids=lambda p: p.name)
def test_a_way_home_stands_between_the_route_and_the_landing_and_reads_back_equal(profile):
    return_waypoints = (Waypoint(33.215, -87.61, 120.0, 58.6), Waypoint(33.2, -87.605, 120.0, 40.0))
    sent = build_items(profile, replace(mission("land"), return_waypoints=return_waypoints), HOME)
    *flown, corner, descent, approach, touch_down = sent
    assert tuple(flown) == build_items(profile, mission("land"), HOME)[:-3]
    assert (descent.command, descent.z_m) == (WP, 120.0)
    assert (corner.command, corner.x, corner.y, corner.z_m) == (WP, 332150000, -876100000, 120.0)
    assert (approach.command, approach.x, approach.y) == (WP, 332000000, -876050000)
    assert (approach.z_m, approach.param2) == (30.0, 40.0)
    assert (touch_down.command, touch_down.x, touch_down.y) == (LAND, 332000000, -876000000)
    assert profile.difference(sent, over_the_wire(sent)) == ""


@pytest.mark.parametrize("profile", PROFILES, ids=lambda p: p.name)
def test_a_mission_above_sea_level_lands_at_a_home_above_sea_level(profile):
    msl_m = HOME.alt_msl_m
    above = [replace(point, alt_m=point.alt_m + msl_m, reference="msl") for point in ROUTE]
    return_waypoints = (Waypoint(33.2, -87.605, 120.0 + msl_m, 40.0, "msl"),)
    sent = build_items(profile, Mission(1, 1, tuple(above), 30.0, "land", None, None, return_waypoints), HOME)
    *_, first, second, descent, approach, touch_down = sent
    assert (first.frame, first.z_m) == (GLOBAL, 100.0 + msl_m)
    assert (second.frame, second.z_m) == (GLOBAL, 120.0 + msl_m)
    assert (descent.frame, descent.z_m) == (RELATIVE, pytest.approx(120.0))
    assert (approach.frame, approach.z_m) == (RELATIVE, 30.0)
    assert (touch_down.frame, touch_down.z_m) == (RELATIVE, 0.0)
    assert profile.difference(sent, over_the_wire(sent)) == ""
    wait = Waypoint(33.225, -87.585, 150.0 + msl_m, 10.0, "msl")
    *_, circle = build_items(profile, Mission(1, 1, tuple(above), 30.0, wait=wait), HOME)
    assert (circle.command, circle.frame, circle.z_m) == (LOITER_UNLIM, GLOBAL, 150.0 + msl_m)
