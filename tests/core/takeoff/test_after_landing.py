"""A vehicle on the ground would be launched into its old mission, or keep a target that it cannot reach."""

import pytest
from helpers.sky import Sky, fly_on, give
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.model import FlightPhase, NoticeCode
from sim_vehicles.autopilots.autopilot_traits import Mode


def land(plane):
    """Let a vehicle come to the ground where it is, and disarm, as after a failsafe: it shows AUTO."""
    plane.airframe.alt_rel_m = 0.0
    plane.airframe.rest()
    plane.autopilot.flying = plane.autopilot.armed = False
    plane.autopilot.set_mode(Mode.AUTO)


def begins_with_a_take_off(plane):
    commands = [item.command for item in plane.autopilot.mission]
    return dialect.MAV_CMD_NAV_TAKEOFF in commands[:2]


@pytest.mark.parametrize("px4", [(), (1, 2)], ids=["ArduPlane", "PX4"])
@pytest.mark.parametrize("waits_s", [0.2, 20.0])
def test_what_has_landed_takes_off_only_with_a_verified_take_off_from_there(px4, waits_s):
    """Armed in AUTO, a PX4 flies its stored mission at once: it had been verified for a flight."""
    sky = Sky((1000.0, 500.0, 60.0), (2500.0, 500.0, 80.0), px4=px4).fly(20.0)
    plane = sky.planes[1]
    assert plane.autopilot.mode is Mode.AUTO
    assert not begins_with_a_take_off(plane)
    land(plane)
    fly_on(sky, 6.0)
    assert sky.run_.engine.state.agents[1].flight.phase in (FlightPhase.DOWN, FlightPhase.LANDED)
    for action in ("arm", "resume", "arm"):
        give(sky, action, 1)
        fly_on(sky, 5.0)
        assert not plane.autopilot.armed
    give(sky, "ready", 1)
    fly_on(sky, waits_s)
    give(sky, "arm", 1)
    for _ in range(200):
        fly_on(sky, 0.4)
        if plane.alt_rel_m > 1.0:
            break
        if not plane.autopilot.armed:
            give(sky, "arm", 1)
    assert plane.alt_rel_m > 1.0
    assert begins_with_a_take_off(plane)
    onboard = sky.run_.engine.state.agents[1].tasking.onboard
    assert onboard is not None
    assert [item.command for item in onboard.items] == [item.command for item in plane.autopilot.mission]


@pytest.mark.parametrize("px4", [(), (1, 2, 3)], ids=["ArduPlane", "PX4"])
def test_the_target_of_a_wreck_goes_to_the_spare_in_the_air_and_stays_there(px4):
    """`resume --all` gave the wreck a mission with a take-off, and its target; the spare had none."""
    sky = Sky((2500.0, 2000.0, 60.0), (500.0, 2000.0, 80.0), (1500.0, 300.0, 100.0), px4=px4).fly(20.0)
    agents = sky.run_.engine.state.agents
    flown = {vehicle: agent.routes.flown.target for vehicle, agent in agents.items() if agent.routes.flown}
    assert set(flown) == {1, 2}
    wreck = sky.planes[1]
    land(wreck)
    fly_on(sky, 8.0)
    ((_, alarm),) = sky.told(NoticeCode.CAME_DOWN)
    assert alarm.vehicle == 1
    assert agents[3].routes.flown.target == flown[1]
    stored = list(wreck.autopilot.mission)
    give(sky, "resume")
    fly_on(sky, 20.0)
    assert list(wreck.autopilot.mission) == stored
    assert wreck.autopilot.mode is not Mode.AUTO
    assert agents[1].routes.flown is None
    assert (agents[3].routes.flown.target, sky.planes[3].autopilot.mode) == (flown[1], Mode.AUTO)


def test_a_vehicle_that_has_landed_is_resumed_and_gets_no_mission_until_it_is_ready():
    """Before, it got a mission with a take-off, was set to LOITER and lost it, again and again."""
    sky = Sky((1000.0, 500.0, 60.0), (2500.0, 500.0, 80.0)).fly(20.0)
    give(sky, "return", 1)
    fly_on(sky, 3.0)
    plane = sky.planes[1]
    plane.airframe.alt_rel_m = 0.0
    plane.airframe.rest()
    plane.autopilot.flying = plane.autopilot.armed = False
    fly_on(sky, 6.0)
    assert sky.told(NoticeCode.LANDED)
    give(sky, "resume", 1)
    fly_on(sky, 15.0)
    assert not begins_with_a_take_off(plane)
    assert not sky.told(NoticeCode.LOITER_ON_GROUND)
    give(sky, "ready", 1)
    fly_on(sky, 8.0)
    assert begins_with_a_take_off(plane)
