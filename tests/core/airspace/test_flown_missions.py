"""A vehicle would be sent through its fence by a circle, a turn, a climb or a landing between two items."""

import math

import numpy as np
import pytest
from helpers.fenced_field import FRAME, NARROW, WIDE, field
from helpers.hills import elevation_of, hill, terrain_table
from helpers.noticed import alarms, noticed

from gcs.config import parse
from gcs.core.airspace.airspace_state import AirspaceState
from gcs.core.airspace.mission_bounds import MissionBoundsCheck
from gcs.core.airspace.no_fly_zones import NoFlyZones
from gcs.core.airspace.obstacle_map import mission_map
from gcs.mavlink.autopilots import ARDUPLANE
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.model import (
    UNLIMITED,
    Mission,
    NoFlyZone,
    Notice,
    NoticeCode,
    Plan,
    UploadReport,
    VerticalLimits,
    Waypoint,
)
from gcs.planning.forward_simulation import Motion
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import parse_scenario


class Flight:
    """A virtual flight of one vehicle."""

    def __init__(self, text, end_s):
        self.effects, places_m = [], []
        run = VirtualRun(
            parse_scenario(text, "fenced.toml"), 1, None, lambda _, effect: self.effects.append(effect)
        )
        plane = run.vehicles["vehicle:1"]
        run.on_event = lambda _: places_m.append((plane.east_m, plane.north_m))
        run.run(end_s)
        self.places_m = np.array(places_m)

    def of(self, kind):
        return [effect for effect in self.effects if isinstance(effect, kind)]

    def outside_m(self, fence_m):
        """Return how far it was outside a fence."""
        west, south, east, north = fence_m
        x, y = self.places_m.T
        return np.maximum.reduce([west - x, x - east, south - y, y - north]).max()


@pytest.mark.parametrize("clearance_m", [60.0, 0.0])
def test_a_vehicle_does_not_circle_through_the_fence_near_a_target_outside(clearance_m):
    """A circle of 80 m, 40 m from the fence, leaves it by 40 m."""
    flight = Flight(field((1450.0, 1000.0), clearance_m=clearance_m), 100.0)
    assert flight.places_m[:, 0].max() > 1250.0, "it flies near the target"
    assert flight.outside_m(WIDE) < 0.0


def test_a_target_without_a_clear_circle_gets_no_vehicle_and_the_operator_reads_why():
    """Where the fence leaves 200 m, no circle of 80 m keeps clear of it."""
    flight = Flight(field((1300.0, 760.0), NARROW), 90.0)
    assert not [report for report in flight.of(UploadReport) if report.ok]
    assert flight.of(Plan)[0].unassigned_targets == ((0, 0),)
    notes = noticed(flight.of(Notice), NoticeCode.NO_CLEAR_LOITER)
    assert {note.parameters["target"] for note in notes} == {"T0.0"}


CONFIG = parse(field((1450.0, 1000.0)), "fenced.toml")
HOME = Home(*FRAME.to_geodetic(700.0, 700.0), 70.0)


def problem(
    *points_m, course_deg=90.0, place_m=(400.0, 700.0), radius_m=80.0, end="loiter", config=CONFIG, **more
):
    """Return the problem of a flight along points."""
    zones = NoFlyZones(AirspaceState(), mission_map(CONFIG, 0))
    if more.get("disc_m"):
        zones.change(NoFlyZone("z", more["disc_m"], limits=more.get("limits", UNLIMITED)))
    heights_m = more.get("heights_m", (100.0,) * len(points_m))
    waypoints = tuple(
        Waypoint(*FRAME.to_geodetic(*point), height_m, 30.0)
        for point, height_m in zip(points_m, heights_m, strict=True)
    )
    takeoff = more.get("takeoff_m")
    climb = None if takeoff is None else Waypoint(*FRAME.to_geodetic(*takeoff), 100.0, 30.0)
    mission = Mission(1, 1, waypoints, radius_m, end, None, climb)
    items = build_items(ARDUPLANE, mission, more.get("home", HOME), from_ground=climb is not None)
    motion = Motion(*place_m, 22.0, math.radians(course_deg))
    items = items[ARDUPLANE.home_items :]
    check = MissionBoundsCheck(config, zones)
    height_msl_m = 170.0 if takeoff is None else 70.0
    heights = height_msl_m, HOME.alt_msl_m
    found = check.flight_problem(items, 1, motion, 0.0, *heights, more.get("wind_m_s"))
    return "" if found is None else found.text


@pytest.mark.parametrize(
    ("what", "expected"),
    [
        (problem((1200.0, 700.0)), ""),
        (problem((1360.0, 1000.0)), "its loiter circle leaves the fence at 33.20"),
        (problem((1200.0, 1000.0), radius_m=250.0), "its loiter circle leaves the fence"),
        (problem((1395.0, 700.0), (1395.0, 900.0), (900.0, 900.0)), "its flight to point 2 of 4 leaves"),
        (problem((400.0, 700.0), place_m=(1360.0, 700.0)), "its flight to point 1 of 2 leaves the fence"),
        (problem((900.0, 900.0), takeoff_m=(600.0, 1420.0)), "its climb leaves the fence at"),
        (
            problem((900.0, 900.0), end="land", home=Home(*FRAME.to_geodetic(1500.0, 900.0), 70.0)),
            "its landing approach leaves the fence",
        ),
        (
            problem((900.0, 700.0), disc_m=(1000.0, 700.0, 30.0)),
            "its loiter circle hits an obstacle, a no-fly zone or",
        ),
        (problem((1200.0, 700.0), place_m=(60.0, 700.0)), ""),
    ],
)
def test_the_last_check_sees_what_is_flown_between_the_items(what, expected):
    assert what.startswith(expected) if expected else what == ""


@pytest.mark.parametrize("wind_m_s", [(8.0, 0.0), (0.0, 8.0), (-8.0, 0.0)])
def test_a_turn_that_the_wind_takes_over_the_fence_is_not_uploaded(wind_m_s):
    """The corner is 60 m from the fence, in the east."""
    corner = (1340.0, 700.0), (1340.0, 900.0), (900.0, 900.0)
    assert problem(*corner) == ""
    found = problem(*corner, wind_m_s=wind_m_s)
    assert found.startswith("its flight to point 2 of 4 leaves the fence") == (wind_m_s[0] > 0.0)
    assert problem(*corner, wind_m_s=(90.0, 0.0)) == "", "no aeroplane flies in it: the report is wrong"


LOW = VerticalLimits(None, 40.0)


@pytest.mark.parametrize(
    ("what", "expected"),
    [
        (problem((1200.0, 700.0), disc_m=(800.0, 700.0, 60.0), limits=LOW), ""),
        (
            problem((1200.0, 700.0), disc_m=(800.0, 700.0, 60.0), limits=VerticalLimits(None, 85.0)),
            "its flight",
        ),
        (
            problem((1200.0, 700.0), end="land", disc_m=(900.0, 700.0, 60.0), limits=LOW),
            "its landing approach",
        ),
        (
            problem((1200.0, 700.0), end="land", disc_m=(900.0, 700.0, 60.0), limits=VerticalLimits(90.0)),
            "its",
        ),
        (problem((1200.0, 700.0), end="land", disc_m=(900.0, 700.0, 60.0), limits=VerticalLimits(250.0)), ""),
        (
            problem((1250.0, 700.0), takeoff_m=(900.0, 700.0), disc_m=(500.0, 700.0, 30.0), limits=LOW),
            "its climb",
        ),
        (problem((1250.0, 700.0), takeoff_m=(900.0, 700.0), disc_m=(820.0, 700.0, 30.0), limits=LOW), ""),
    ],
)
def test_the_last_check_sees_at_what_height_an_obstacle_is_passed(what, expected):
    """A climb from 400 m to 900 m east, or an approach to a home 700 m east, at a layer of 100 m."""
    assert what.startswith(expected) if expected else what == ""


def test_a_mission_whose_circle_leaves_the_fence_is_not_sent_and_the_alarm_names_the_circle(monkeypatch):
    """The last check does not rely on the planner: here the planner has forgotten its circles."""
    monkeypatch.setattr("gcs.planning.pair_route._with_terminal_loiter", lambda _grid, route, *_: (route, ""))
    flight = Flight(field((1380.0, 1000.0)), 40.0)
    assert not [report for report in flight.of(UploadReport) if report.ok]
    (alarm,) = alarms(flight.of(Notice))
    assert alarm.code is NoticeCode.MISSION_HELD_BACK
    reason = alarm.parameters["reason"]
    assert reason.startswith("its loiter circle leaves the fence at 33.2")
    assert reason.endswith("; the vehicle keeps its onboard mission")
    assert flight.outside_m(WIDE) < 0.0


HILLY = parse(
    field((1450.0, 1000.0)) + terrain_table(elevation_of(hill(700.0, 700.0, 90.0, 60.0, 70.0), 2000.0)),
    "hilly.toml",
)


def test_a_flight_into_a_hill_between_two_points_is_refused():
    """The points are 100 m above the plain, and the leg is 10 m above the top of the hill."""
    said = problem((500.0, 700.0), (900.0, 700.0), config=HILLY)
    assert "flight to point 2 of 3 comes nearer to the ground than 25 m at 33.2" in said
    assert problem((500.0, 700.0), (900.0, 700.0), heights_m=(130.0, 130.0), config=HILLY) == ""
    assert problem((500.0, 950.0), (900.0, 950.0), config=HILLY) == "", "beside it"


def test_a_descent_that_a_vehicle_ends_before_its_point_counts():
    """At the top of the hill the line is 130 m high; PX4 has the height of the point 80 m before it."""
    points_m = (300.0, 700.0), (780.0, 700.0)
    assert problem(*points_m, heights_m=(200.0, 120.0), config=HILLY) == ""
    assert "point 2" in problem(*points_m, heights_m=(200.0, 85.0), config=HILLY)


def test_the_climb_to_a_mission_is_near_the_ground():
    assert problem((900.0, 950.0), takeoff_m=(500.0, 950.0), config=HILLY) == ""
