"""A user would lose control: a mission meant for one vehicle goes to another, or to none."""

import math

import numpy as np
import pytest
from helpers.staging import at, confirmed, picture, state, track
from hypothesis import given
from hypothesis import strategies as st

from gcs.core.perception.track_to_vehicle import TrackVehicleAssociation
from gcs.core.state import State

GATE = 32.2
A, B = (0, 0), (0, 1)
EAST, WEST = (1000.0, 0.0), (0.0, 0.0)


def new_association():
    agents = State.initial(range(1, 10)).agents
    return TrackVehicleAssociation(agents, gate_chi2=GATE, noise_std_m=3.0, max_age_s=1.0)


def associated_pair():
    """Vehicle 1 at A in the west, vehicle 2 at B in the east."""
    association = new_association()
    association.update(confirmed(track(A, WEST), track(B, EAST)), at(0), [state(1, WEST), state(2, EAST)])
    assert association.labels == {1: A, 2: B}
    return association


def test_vehicles_are_associated_so_that_the_whole_lies_nearest_not_one_after_the_other():
    # Vehicle 1 is nearest to B, but so is vehicle 2, which is in no other gate.
    association = new_association()
    confirmation = confirmed(track(A, (0.0, 0.0)), track(B, (20.0, 0.0)))
    association.update(confirmation, at(0), [state(1, (11.0, 0.0)), state(2, (40.0, 0.0))])
    assert association.labels == {1: A, 2: B}


def test_a_report_far_from_every_track_is_associated_to_none():
    association = new_association()
    reach_m = math.sqrt(GATE * (9.0 + 9.0))
    association.update(confirmed(track(A, WEST)), at(0), [state(1, (0.0, reach_m + 0.1))])
    assert association.labels == {}
    association.update(confirmed(track(A, WEST)), at(0), [state(1, (0.0, reach_m - 0.1))])
    assert association.labels == {1: A}


def test_a_track_that_is_not_confirmed_gets_no_vehicle():
    association = new_association()
    confirmation = confirmed(track(A, WEST))
    confirmation.update(picture(track(A, WEST), track(B, EAST)))
    association.update(confirmation, at(0), [state(1, WEST), state(2, EAST)])
    assert association.labels == {1: A}


def test_a_report_is_compared_at_the_time_of_the_scan():
    association = new_association()
    northward = state(1, (0.0, 0.0), t_s=9.2, speed_m_s=50.0, course_rad=0.0)
    association.update(confirmed(track(A, (0.0, 40.0))), at(10.0), [northward])
    assert association.labels == {1: A}


def test_an_old_report_is_not_used():
    association = new_association()
    association.update(confirmed(track(A, WEST)), at(10), [state(1, WEST, t_s=8.9)])
    assert association.labels == {}


def test_an_association_holds_while_the_vehicles_link_is_silent():
    association = associated_pair()
    for t_s in range(1, 120):
        moved = confirmed(track(A, (15.0 * t_s, 0.0)), track(B, EAST))
        association.update(moved, at(t_s), [state(1, WEST, 0.0), state(2, EAST, t_s)])
    assert association.labels == {1: A, 2: B}


def test_one_or_two_reports_outside_the_gate_do_not_break_an_association():
    association = associated_pair()
    confirmation = confirmed(track(A, WEST), track(B, EAST))
    for t_s in range(1, 30):
        place = WEST if t_s % 3 == 0 else (300.0, 300.0)
        association.update(confirmation, at(t_s), [state(1, place, t_s), state(2, EAST, t_s)])
        assert association.labels == {1: A, 2: B}


def test_three_sensors_at_one_epoch_do_not_break_an_association_as_three_epochs_do():
    association = associated_pair()
    confirmation = confirmed(track(A, WEST), track(B, EAST))
    for t_s in (1, 1, 1, 2, 2, 2):
        association.update(confirmation, at(t_s), [state(1, (300.0, 300.0), t_s)])
        assert association.labels == {1: A, 2: B}
    association.update(confirmation, at(3), [state(1, (300.0, 300.0), 3)])
    assert association.labels == {2: B}


def test_vehicles_side_by_side_keep_their_tracks_though_reports_stray_to_the_neighbours():
    association, places = new_association(), {1: (0.0, 0.0), 2: (8.0, 0.0)}
    confirmation = confirmed(track(A, places[1]), track(B, places[2]))
    association.update(confirmation, at(0), [state(v, place) for v, place in places.items()])
    for t_s in range(1, 12):
        association.update(confirmation, at(t_s), [state(1, places[2], t_s), state(2, places[1], t_s)])
        assert association.labels == {1: A, 2: B}


def test_tracks_that_swapped_their_vehicles_are_associated_again_after_three_scans():
    association = associated_pair()
    swapped = confirmed(track(A, EAST), track(B, WEST))
    for t_s in (1, 2):
        association.update(swapped, at(t_s), [state(1, WEST, t_s), state(2, EAST, t_s)])
        assert association.labels == {1: A, 2: B}
    association.update(swapped, at(3), [state(1, WEST, 3), state(2, EAST, 3)])
    assert association.labels == {1: B, 2: A}


def test_a_lost_label_keeps_its_vehicle_until_the_loss_is_called():
    association = associated_pair()
    confirmation = confirmed(track(A, WEST), track(B, EAST))
    confirmation.update(picture(track(A, WEST, existence=0.001, estimated=False), track(B, EAST)))
    association.update(confirmation, at(1), [state(2, EAST, 1)])
    assert association.labels == {1: A, 2: B}
    confirmation.update(picture(track(B, EAST)))
    association.update(confirmation, at(2), [state(2, EAST, 2)])
    assert association.labels == {1: A, 2: B}
    association.forget(1)
    assert association.labels == {2: B}


def test_a_vehicle_that_comes_back_twice_is_associated_to_its_new_track():
    # It was called lost long ago; a track associated since then ended before it was confirmed.
    association = associated_pair()
    confirmation = confirmed(track(A, WEST), track(B, EAST))
    confirmation.update(picture(track(A, WEST, existence=0.001, estimated=False), track(B, EAST)))
    association.update(confirmation, at(1), [state(1, WEST, 1), state(2, EAST, 1)])
    assert association.labels == {1: A, 2: B}, "its status still follows this track"
    successor = (5, 0)
    for t_s in (2, 3, 4):
        confirmation.update(picture(track(B, EAST), track(successor, WEST)))
        association.update(confirmation, at(t_s), [state(1, WEST, t_s), state(2, EAST, t_s)])
    assert association.labels == {1: successor, 2: B}


def test_a_doubted_label_loses_its_vehicle_to_the_label_that_has_the_object_now():
    association = associated_pair()
    successor = (5, 0)
    confirmation = confirmed(track(A, WEST), track(B, EAST))
    for t_s in (1, 2, 3):
        doubted = track(A, WEST, existence=0.3, estimated=False)
        confirmation.update(picture(doubted, track(B, EAST), track(successor, WEST)))
        association.update(confirmation, at(t_s), [state(1, WEST, t_s), state(2, EAST, t_s)])
    assert association.labels == {1: successor, 2: B}


def test_a_vehicle_is_not_associated_to_a_track_that_another_vehicle_has():
    association = associated_pair()
    association.update(
        confirmed(track(A, WEST), track(B, EAST)), at(1), [state(2, EAST, 1), state(3, WEST, 1)]
    )
    assert association.labels == {1: A, 2: B}


def test_tracks_that_changed_their_vehicles_in_a_ring_are_associated_again_one_by_one():
    association, places = new_association(), {1: WEST, 2: EAST, 3: (500.0, 500.0)}
    labels = {1: A, 2: B, 3: (0, 2)}
    confirmation = confirmed(*(track(labels[v], places[v]) for v in places))
    association.update(confirmation, at(0), [state(v, place) for v, place in places.items()])
    turned = confirmed(track(A, places[2]), track(B, places[3]), track((0, 2), places[1]))
    for t_s in (1, 2, 3):  # vehicle 3 is not heard before the last second
        heard = places if t_s == 3 else {1: WEST, 2: EAST}
        association.update(turned, at(t_s), [state(v, place, t_s) for v, place in heard.items()])
    assert association.labels == {1: (0, 2), 2: A, 3: B}


def test_a_vehicle_that_reports_while_its_track_is_lost_takes_the_one_that_has_its_object_now():
    association, successor = associated_pair(), (5, 0)
    confirmation = confirmed(track(A, WEST), track(B, EAST))
    for _ in range(2):
        confirmation.update(picture(track(A, WEST, existence=0.2), track(B, EAST), track(successor, WEST)))
    association.update(confirmation, at(2), [state(1, WEST, 2), state(2, EAST, 2)])
    confirmation.update(picture(track(B, EAST), track(successor, WEST)))
    association.update(confirmation, at(3), [state(1, WEST, 3), state(2, EAST, 3)])
    assert association.labels == {1: successor, 2: B}


def test_a_vehicle_near_an_unconfirmed_track_is_unassociated_and_seen_there():
    association, successor = associated_pair(), (5, 0)
    confirmation = confirmed(track(A, WEST), track(B, EAST))
    confirmation.update(picture(track(B, EAST), track(successor, WEST)))
    association.update(confirmation, at(1), [state(1, WEST, 1), state(2, EAST, 1)])
    assert association.labels == {2: B}
    assert association._of(1).near == successor


def test_of_two_at_one_place_whose_track_was_lost_the_silent_one_is_gone():
    association, nearby = new_association(), (3.0, 0.0)
    confirmation = confirmed(track(A, WEST), track(B, nearby))
    association.update(confirmation, at(0), [state(1, WEST), state(2, nearby)])
    confirmation.update(picture(track(B, nearby)))
    association.update(confirmation, at(2), [state(1, WEST, 2)])
    assert association.labels == {1: B, 2: A}
    assert confirmation.is_lost(A)


@pytest.mark.parametrize("place", [(math.nan, 0.0), (math.inf, 0.0), (1e300, -1e300)])
def test_a_senseless_report_associates_nothing_and_raises_nothing(place):
    association = new_association()
    association.update(confirmed(track(A, WEST)), at(0), [state(1, place), state(2, WEST)])
    assert association.labels == {2: A}


@given(
    st.lists(
        st.tuples(
            st.lists(st.integers(0, 3), max_size=4, unique=True),
            st.lists(st.tuples(st.integers(1, 4), st.integers(0, 60)), max_size=4, unique_by=lambda v: v[0]),
        ),
        max_size=12,
    )
)
def test_no_two_vehicles_ever_have_one_track(scenes):
    association = new_association()
    for t_s, (labels, reports) in enumerate(scenes):
        confirmation = confirmed(*(track((0, index), (15.0 * index, 0.0)) for index in labels))
        association.update(confirmation, at(t_s), [state(v, (float(x), 0.0), t_s) for v, x in reports])
        assert len(set(association.labels.values())) == len(association.labels)
        assert all(np.isfinite(label).all() for label in association.labels.values())
