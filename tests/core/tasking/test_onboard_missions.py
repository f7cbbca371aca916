"""A user would lose track of a vehicle that has its target behind it, or of the circle that it will fly."""

import pytest
from helpers.one_vehicle_fleet import CONFIG, Fleet

from gcs.core.state import State
from gcs.core.tasking.mission_builder import MissionBuilder
from gcs.core.tasking.onboard_missions import OnboardMissions
from gcs.core.tasking.tasking_state import OnboardMission
from gcs.mavlink.autopilots import ARDUPLANE
from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.model import Route, read_only

FRAME = CONFIG.local_frame


def stored(wait_m, seq, mode=AUTO):
    route = Route(1, (0, 0), read_only([[0.0, 500.0], [900.0, 0.0]]), 1.0, wait_m=wait_m)
    planned = MissionBuilder(CONFIG).of(route, 1, None)
    items = build_items(ARDUPLANE, planned, Home(33.2, -87.6, 70.0))
    held = OnboardMissions(Fleet(seq, mode), State.initial([1, 2]).agents)
    held.note(OnboardMission(route, items, first_point=1))
    return held


@pytest.mark.parametrize(("seq", "points"), [(1, 2), (2, 1)])
def test_a_vehicle_flies_to_its_points_and_then_to_its_circle(seq, points):
    ahead = stored((900.0, -200.0), seq).forward_simulation(1, 0.0, 0)
    assert len(ahead.points_m) == points
    assert ahead.circle.centre_m == (900.0, -200.0)
    assert ahead.circle.radius_m == CONFIG.mission.loiter_radius_m
    assert stored(None, seq).forward_simulation(1, 0.0, 0).circle.centre_m == (900.0, 0.0)


def test_a_target_is_passed_when_the_circle_elsewhere_is_flown():
    assert [stored((900.0, -200.0), seq).has_passed_route_end(1) for seq in (1, 2, 3)] == [
        False,
        False,
        True,
    ]
    assert not stored((900.0, -200.0), 3, LOITER).has_passed_route_end(1)
    assert not stored(None, 3).has_passed_route_end(1)
    assert not stored((900.0, -200.0), 3).has_passed_route_end(2)
