"""The vehicle flies its mission as ArduPlane would."""

from __future__ import annotations

import math

import pytest

from gcs.geo import LocalFrame
from sim_vehicles.autopilots.arduplane import Autopilot
from sim_vehicles.autopilots.autopilot_states import ItemReached, StatusText
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.autopilots.mission_protocol import Item
from sim_vehicles.autopilots.parameters import Parameters
from sim_vehicles.vehicle.banked_airframe import BankedAirframe
from sim_vehicles.vehicle.geodesy import Geodesy
from sim_vehicles.vehicle.guidance import Circle
from sim_vehicles.vehicle.paper_airframe import Airframe

STEP_NS = 10_000_000
FRAME = LocalFrame(33.2, -87.6, 70.0)


def waypoint(east_m: float, north_m: float, command: int = 16, z: float = 100.0, **fields: float) -> Item:
    lat, lon = FRAME.to_geodetic(east_m, north_m)
    return Item(command, x=round(lat * 1e7), y=round(lon * 1e7), z=z, **fields)


class Pilot:
    """An autopilot with its airframe and a clock, and all its notices."""

    def __init__(
        self,
        *items: Item,
        airborne: bool = True,
        speed: float = 15.0,
        airframe: type[Airframe] = Airframe,
        **parameters: float,
    ) -> None:
        self.airframe = airframe(0, 0, 100.0 if airborne else 0.0, math.pi / 2, speed if airborne else 0.0)
        self.autopilot = Autopilot(
            self.airframe, Parameters(**parameters), Geodesy(FRAME), speed, 0, airborne
        )
        self.t_ns = 0
        self.notices: list[ItemReached | StatusText] = []
        self.store(*items)

    def store(self, *items: Item) -> None:
        self.autopilot.mission.truncate(0)
        for index, item in enumerate([Item(16), *items] if items else []):
            self.autopilot.mission.put(index, item)

    def fly(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.t_ns += STEP_NS
            self.autopilot.step(self.t_ns)
            self.notices += self.autopilot.notices
            self.autopilot.notices.clear()

    def until(self, condition, seconds: float = 300.0) -> float:
        for step in range(round(seconds * 100)):
            if condition():
                return step / 100
            self.fly(0.01)
        pytest.fail(f"nothing of the kind within {seconds} s")

    @property
    def reached(self) -> list[int]:
        return [n.seq for n in self.notices if isinstance(n, ItemReached)]

    def distance_m(self, east_m: float, north_m: float) -> float:
        return math.dist((self.airframe.east_m, self.airframe.north_m), (east_m, north_m))


def test_items_are_flown_in_order_and_the_mission_ends_in_rtl():
    pilot = Pilot(waypoint(300, 0), waypoint(500, 100), waypoint(700, 0))
    pilot.autopilot.set_mode(Mode.AUTO)
    pilot.until(lambda: pilot.autopilot.mode is Mode.RTL)
    assert pilot.reached == [1, 2, 3]
    assert pilot.distance_m(700, 0) < 11.0


@pytest.mark.parametrize(("radius", "expected"), [(0.0, 10.0), (40.0, 40.0)])
def test_a_waypoint_is_switched_at_its_acceptance_radius(radius, expected):
    pilot = Pilot(waypoint(400, 0, param2=radius), waypoint(400, 400))
    pilot.autopilot.set_mode(Mode.AUTO)
    pilot.until(lambda: pilot.autopilot.seq == 2)
    assert expected - 1.7 < pilot.distance_m(400, 0) <= expected


def test_a_missed_waypoint_is_passed_at_its_finish_line_not_orbited():
    pilot = Pilot(waypoint(400, 0), waypoint(420, 30), waypoint(420, 600))
    pilot.autopilot.set_mode(Mode.AUTO)
    pilot.until(lambda: pilot.autopilot.seq == 3, seconds=60)
    assert pilot.reached == [1, 2]
    assert any(isinstance(n, StatusText) and n.text.startswith("Passed waypoint #2") for n in pilot.notices)


def test_an_item_replaced_while_flown_is_flown_as_it_was_until_set_current():
    pilot = Pilot(waypoint(800, 0), waypoint(800, 800))
    pilot.autopilot.set_mode(Mode.AUTO)
    pilot.fly(5)
    pilot.store(waypoint(0, 800), waypoint(0, 900))
    pilot.fly(10)
    assert pilot.airframe.course_rad == pytest.approx(math.pi / 2, abs=0.05)
    pilot.autopilot.set_mode(Mode.AUTO)  # already in it: changes nothing
    pilot.fly(1)
    assert pilot.airframe.course_rad == pytest.approx(math.pi / 2, abs=0.05)
    assert pilot.autopilot.set_current(1)
    pilot.until(lambda: pilot.autopilot.seq == 2, seconds=120)
    assert pilot.distance_m(0, 800) <= 10.0


def test_a_mission_shortened_below_the_flown_item_keeps_its_number_then_ends():
    pilot = Pilot(*(waypoint(100 * k, 0) for k in range(1, 8)))
    pilot.autopilot.set_mode(Mode.AUTO)
    pilot.until(lambda: pilot.autopilot.seq == 6)
    pilot.store(waypoint(0, 500))
    pilot.fly(0.5)
    assert (pilot.autopilot.seq, len(pilot.autopilot.mission) - 1) == (6, 1)
    pilot.until(lambda: pilot.autopilot.mode is Mode.RTL, seconds=30)


def test_set_current_accepts_zero_for_one_and_refuses_missing_items():
    pilot = Pilot(waypoint(800, 0), waypoint(800, 800))
    assert pilot.autopilot.set_current(0)
    assert pilot.autopilot.seq == 1
    assert pilot.autopilot.set_current(2)
    assert not pilot.autopilot.set_current(3)
    assert pilot.autopilot.seq == 2


def test_auto_resumes_where_it_was_left_and_starts_anew_after_the_end():
    pilot = Pilot(waypoint(200, 0), waypoint(400, 0), waypoint(600, 0))
    pilot.autopilot.set_mode(Mode.AUTO)
    pilot.until(lambda: pilot.autopilot.seq == 2)
    pilot.autopilot.set_mode(Mode.LOITER)
    pilot.fly(10)
    pilot.autopilot.set_mode(Mode.AUTO)
    assert pilot.autopilot.seq == 2
    pilot.until(lambda: pilot.autopilot.mode is Mode.RTL)
    pilot.autopilot.set_mode(Mode.AUTO)
    assert pilot.autopilot.seq == 1


def test_auto_without_a_mission_returns():
    pilot = Pilot()
    pilot.autopilot.set_mode(Mode.AUTO)
    assert pilot.autopilot.mode is Mode.RTL


@pytest.mark.parametrize("speed", [5.0, 15.0, 30.0])
@pytest.mark.parametrize("radius", [-60.0, 100.0, 20.0])
def test_a_circle_is_held_at_its_radius_whichever_way_it_was_entered(speed, radius):
    tightest = 1.89 * speed
    for start in ((0.0, 0.0, 0.3), (300.0, 0.0, 0.0), (60.0, 0.0, 2.0)):
        airframe, circle = Airframe(start[0], start[1], 100.0, start[2], speed), Circle(0.0, 0.0, radius)
        turned = airframe.heading_rad
        for step in range(14_000):
            airframe.step(circle.heading_error_rad(airframe), 100.0, speed)
            if step == 13_000:
                turned = airframe.heading_rad
        wanted = max(abs(radius), tightest)
        assert circle.distance_m(airframe) == pytest.approx(wanted, rel=0.03)
        assert math.copysign(1.0, airframe.heading_rad - turned) == math.copysign(1.0, radius)


def test_loiter_stays_where_it_was_entered():
    pilot = Pilot()
    pilot.fly(60)
    assert pilot.distance_m(0, 0) == pytest.approx(60.0, abs=2.0)


def test_an_item_to_loiter_at_holds_its_own_radius_and_never_ends():
    pilot = Pilot(waypoint(300, 0), waypoint(600, 0, command=17, param3=-80.0))
    pilot.autopilot.set_mode(Mode.AUTO)
    pilot.fly(240)
    assert pilot.autopilot.mode is Mode.AUTO
    assert pilot.distance_m(600, 0) == pytest.approx(80.0, abs=2.0)


def test_rtl_circles_home_at_its_altitude():
    pilot = Pilot(waypoint(600, 0), RTL_ALTITUDE=150)
    pilot.autopilot.set_mode(Mode.AUTO)
    pilot.fly(30)
    pilot.autopilot.set_mode(Mode.RTL)
    pilot.fly(120)
    assert pilot.distance_m(0, 0) == pytest.approx(60.0, abs=3.0)
    assert pilot.airframe.alt_rel_m == pytest.approx(150.0, abs=1.0)


def test_guided_goes_to_its_target_and_only_in_guided():
    pilot = Pilot()
    assert not pilot.autopilot.guide_to(500, 500, 120)
    pilot.autopilot.set_mode(Mode.GUIDED)
    assert pilot.autopilot.guide_to(500, 500, 120)
    pilot.fly(120)
    assert pilot.distance_m(500, 500) == pytest.approx(60.0, abs=3.0)
    assert pilot.airframe.alt_rel_m == pytest.approx(120.0, abs=0.5)


def test_from_the_ground_it_arms_late_takes_off_flies_and_lands():
    pilot = Pilot(
        waypoint(0, 0, command=22, z=60.0),
        waypoint(500, 200),
        waypoint(0, 300, command=21, z=0.0),
        airborne=False,
    )
    assert not pilot.autopilot.arm(pilot.t_ns)
    pilot.fly(10)
    assert not pilot.autopilot.arm(pilot.t_ns)
    pilot.fly(10)
    assert pilot.autopilot.arm(pilot.t_ns)
    pilot.fly(5)
    assert pilot.distance_m(0, 0) == 0.0  # armed in MANUAL it stays where it is
    pilot.autopilot.set_mode(Mode.AUTO)
    pilot.until(lambda: pilot.autopilot.seq == 2)
    assert pilot.airframe.alt_rel_m > 58.0
    pilot.until(lambda: pilot.autopilot.seq == 3)
    pilot.until(lambda: not pilot.autopilot.armed)
    assert pilot.distance_m(0, 300) < 100.0
    assert pilot.airframe.speed_m_s == 0.0
    assert pilot.reached == [1, 2, 3]


def test_a_refused_arming_has_a_reason_and_force_goes_through():
    pilot = Pilot(airborne=False)
    pilot.autopilot.arm(pilot.t_ns)
    pilot.fly(0.01)
    assert any(isinstance(n, StatusText) and "PreArm" in n.text for n in pilot.notices)
    assert pilot.autopilot.arm(pilot.t_ns, force=True)


def test_disarming_in_the_air_is_refused():
    assert not Pilot().autopilot.disarm()


@pytest.mark.parametrize(
    ("mode", "action", "expected"),
    [
        (Mode.AUTO, 0, Mode.AUTO), (Mode.GUIDED, 0, Mode.GUIDED), (Mode.AUTO, 1, Mode.RTL),
        (Mode.GUIDED, 1, Mode.RTL), (Mode.LOITER, 0, Mode.RTL), (Mode.CRUISE, 0, Mode.RTL),
        (Mode.FBWA, 0, Mode.RTL), (Mode.MANUAL, 0, Mode.RTL),
    ],
)  # fmt: skip
def test_losing_the_ground_station_goes_by_the_mode(mode, action, expected):
    pilot = Pilot(waypoint(5000, 0), FS_GCS_ENABL=1, FS_LONG_ACTN=action)
    pilot.autopilot.set_mode(mode)
    pilot.fly(10)
    assert pilot.autopilot.mode is mode  # one that was never heard cannot be lost
    for _ in range(8):
        pilot.autopilot.note_gcs_heartbeat(255, pilot.t_ns)
        pilot.fly(1)
    pilot.fly(3.5)
    assert pilot.autopilot.mode is mode
    pilot.fly(1)
    assert pilot.autopilot.mode is expected


def test_without_the_failsafe_a_loss_of_the_ground_station_changes_nothing():
    pilot = Pilot(FS_GCS_ENABL=0, FS_LONG_ACTN=1)
    pilot.autopilot.note_gcs_heartbeat(255, pilot.t_ns)
    pilot.fly(20)
    assert pilot.autopilot.mode is Mode.LOITER


def test_a_lost_link_on_the_ground_leaves_a_vehicle_in_rtl_and_so_unarmable():
    """The field guide's commands, a minute apart, end here: arming fails until the mode is changed."""
    pilot = Pilot(airborne=False, FS_GCS_ENABL=1, ARMING_DELAY_S=0)
    pilot.autopilot.note_gcs_heartbeat(255, pilot.t_ns)
    pilot.fly(6)
    assert pilot.autopilot.mode is Mode.RTL
    assert not pilot.autopilot.arm(pilot.t_ns)
    pilot.fly(0.01)
    assert any(isinstance(n, StatusText) and "RTL mode not armable" in n.text for n in pilot.notices)
    pilot.autopilot.set_mode(Mode.LOITER)
    assert pilot.autopilot.arm(pilot.t_ns)


@pytest.mark.parametrize("airframe", [Airframe, BankedAirframe])
@pytest.mark.parametrize(
    ("how", "far_off"), [(["command"], True), (["command", "command"], False), (["message"], False)]
)
def test_how_an_item_is_selected_in_flight_decides_where_its_leg_begins(airframe, how, far_off):
    """`select_current.txt`: -1130 m off at once by the command sent once, nothing otherwise."""
    pilot = Pilot(waypoint(0, 400, param2=30.0), waypoint(0, 1500), airframe=airframe)
    pilot.autopilot.set_mode(Mode.AUTO)
    pilot.until(lambda: pilot.autopilot.seq == 2)
    pilot.store(waypoint(800, 1200), waypoint(800, 3000))
    for way in how:
        assert pilot.autopilot.set_current(1, by_message=way == "message")
    pilot.fly(1)
    off_m = pilot.autopilot.goal.cross_track_m(pilot.airframe)
    assert off_m < -900.0 if far_off else off_m == 0.0
    pilot.until(lambda: pilot.autopilot.seq == 2)
    passed_m = pilot.distance_m(800, 1200)
    assert passed_m > 200.0 if far_off else passed_m <= 11.0
    pilot.fly(5)
    if how == ["command"]:  # the flag that was cleared too late: this leg begins where the vehicle is
        assert pilot.autopilot.goal.cross_track_m(pilot.airframe) == 0.0


@pytest.mark.parametrize(("airframe", "most_m"), [(Airframe, 4.0), (BankedAirframe, 3.0)])
def test_a_leg_s_line_is_followed_from_the_waypoint_before(airframe, most_m):
    pilot = Pilot(waypoint(400, 0, param2=40.0), waypoint(800, 400, param2=40.0), airframe=airframe)
    pilot.autopilot.set_mode(Mode.AUTO)
    pilot.until(lambda: pilot.autopilot.seq == 2)
    pilot.fly(18)
    assert abs(pilot.autopilot.goal.cross_track_m(pilot.airframe)) < most_m
    assert pilot.autopilot.goal.is_tracked


def test_a_take_off_holds_its_heading_to_its_altitude_then_turns():
    pilot = Pilot(
        waypoint(0, 0, command=22, z=90.0), waypoint(-500, 0), airborne=False, ARMING_DELAY_S=0,
        airframe=BankedAirframe, speed=23.5,
    )  # fmt: skip
    pilot.autopilot.arm(pilot.t_ns)
    pilot.autopilot.set_mode(Mode.AUTO)
    pilot.until(lambda: pilot.autopilot.seq == 2)
    assert pilot.airframe.east_m == pytest.approx(270.0, abs=30.0)
    assert abs(pilot.airframe.north_m) < 1.0


def test_a_landed_vehicle_that_is_armed_in_auto_stays_on_the_ground():
    pilot = Pilot(waypoint(300, 0), waypoint(600, 0, command=21, z=0.0))
    pilot.autopilot.set_mode(Mode.AUTO)
    pilot.until(lambda: not pilot.autopilot.armed)
    assert pilot.autopilot.arm(pilot.t_ns)
    pilot.fly(20)
    assert pilot.airframe.alt_rel_m < 1.0


def test_another_ground_station_s_heartbeat_does_not_feed_the_failsafe():
    pilot = Pilot(waypoint(5000, 0), FS_GCS_ENABL=1, FS_LONG_ACTN=1)
    pilot.autopilot.set_mode(Mode.AUTO)
    pilot.autopilot.note_gcs_heartbeat(255, pilot.t_ns)
    for _ in range(7):
        pilot.fly(1)
        pilot.autopilot.note_gcs_heartbeat(254, pilot.t_ns)
    assert pilot.autopilot.mode is Mode.RTL
