"""A pilot, or an autopilot that returns, would fly into a hill, and no operator would know."""

from helpers.hills import elevation_of, hill, terrain_table
from helpers.sky import FIELD, Sky, fly_on, give, place
from helpers.staging import S

from gcs.model import NoticeCode
from sim_vehicles.autopilots.arduplane import Mode
from sim_vehicles.campaign.virtual_run import START_T_NS

HILL = hill(1500.0, 1700.0, 150.0, 200.0, 70.0)
HILLS = FIELD + terrain_table(elevation_of(HILL, 3000.0))


def flight(mode, north_m, east_m=1500.0):
    """Return the flight of a vehicle that is put somewhere, 100 m high, with its course north."""
    sky = Sky((400.0, 400.0, 100.0), field=HILLS).fly(6.0)
    plane = sky.planes[1]
    place(plane, east_m, north_m, 100.0)
    plane.autopilot.set_mode(mode)
    return sky, plane


def agl_m(plane):
    return plane.alt_msl_m - elevation_of(HILL, 3000.0).height_msl_m(plane.east_m, plane.north_m)


def test_a_pilot_who_flies_towards_a_hill_is_told_before():
    sky, plane = flight(Mode.FBWA, 700.0)
    while agl_m(plane) > 25.0:
        fly_on(sky, 1.0)
    near_s = (sky.run_.t_ns - START_T_NS) / S
    told = sky.told(NoticeCode.NEAR_GROUND)
    assert len(told) == 1
    t_s, notice = told[0]
    assert near_s - t_s > 12.0
    assert 15.0 < notice.parameters["after_s"] <= 20.0
    assert abs(notice.parameters["east_m"] - 1500.0) < 30.0


def test_a_vehicle_that_turns_away_is_told_to_be_clear():
    sky, plane = flight(Mode.FBWA, 1200.0)
    fly_on(sky, 4.0)
    assert sky.told(NoticeCode.NEAR_GROUND)
    place(plane, 1500.0, 500.0, 100.0, 180.0)
    fly_on(sky, 12.0)
    assert sky.told(NoticeCode.CLEAR_OF_GROUND)


def test_a_mission_that_keeps_above_the_ground_is_not_told():
    sky = Sky((400.0, 400.0, 100.0), (2600.0, 400.0, 100.0), field=HILLS).fly(200.0)
    assert not sky.told(NoticeCode.NEAR_GROUND)
    assert {agent.perception.status.status for agent in sky.run_.engine.state.agents.values()} == {"arrived"}


def test_a_return_that_leads_through_a_hill_is_told():
    sky, _ = flight(Mode.RTL, 2300.0, east_m=2008.0)  # the hill is between it and its home
    fly_on(sky, 30.0)
    assert sky.told(NoticeCode.NEAR_GROUND)


def test_an_order_to_hold_beside_a_hill_waits_until_the_circle_is_clear():
    sky = Sky((900.0, 1560.0, 100.0), courses_deg=[90.0], field=HILLS).fly(6.0)
    plane = sky.planes[1]
    for _ in range(12):  # a jump is believed after some reports
        place(plane, 1225.0, 1700.0, 100.0, 90.0)  # the ground 60 m in front of it is 15 m lower
        fly_on(sky, 0.4)
    give(sky, "hold", 1)
    fly_on(sky, 0.4)
    assert plane.autopilot.mode is Mode.AUTO
    place(plane, 1225.0, 300.0, 100.0, 90.0)
    fly_on(sky, 8.0)
    assert plane.autopilot.mode is Mode.LOITER


def test_a_vehicle_that_left_its_route_is_not_resumed_into_a_hill():
    """An ArduPlane flew 11 m above ground: it was resumed at home, where its mission led on from afar."""
    sky = Sky((400.0, 400.0, 100.0), field=HILLS).fly(6.0)
    plane = sky.planes[1]
    give(sky, "hold", 1)
    fly_on(sky, 2.0)
    for _ in range(12):  # a jump is believed after some reports
        place(plane, 2000.0, 1700.0, 100.0)  # the hill is between it and its target
        fly_on(sky, 0.4)
    give(sky, "resume", 1)
    fly_on(sky, 3.0)
    assert sky.answers[-1].detail == "LOITER, armed: waits for its next mission"
    fly_on(sky, 10.0)
    assert plane.autopilot.mode is Mode.AUTO
