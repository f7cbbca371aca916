"""A user would lose missions: agents sent after clutter, targets given up after one missed detection."""

from dataclasses import replace

from helpers.staging import RADAR, confirmation_of, picture, track
from hypothesis import given
from hypothesis import strategies as st

from gcs.core.perception.track_lifecycle import CONFIRMATION_EPOCHS

HERE = (0.0, 0.0)
LOST_EXISTENCE = 0.01


def seen(label=(0, 0), existence=1.0):
    return track(label, HERE, existence=existence)


def missed(label=(0, 0), existence=0.3):
    return track(label, HERE, existence=existence, estimated=False)


def after(*pictures):
    """Which labels are confirmed after each of the pictures."""
    confirmation = confirmation_of(LOST_EXISTENCE)
    found = []
    for tracks in pictures:
        confirmation.update(picture(*tracks))
        found.append(set(confirmation.tracks))
    return found


def test_a_clutter_point_is_in_the_estimate_for_a_scan_or_two_and_is_never_confirmed():
    assert after([seen()], [], [seen()], [seen()], [], []) == [set()] * 6
    assert after([seen()], [seen()], [missed()], [seen()], [seen()], [missed()]) == [set()] * 6


def test_a_track_is_confirmed_at_its_third_scan_in_a_row():
    assert after([seen()], [seen()], [seen()], [seen()]) == [set(), set(), {(0, 0)}, {(0, 0)}]


def test_a_target_missed_for_two_scans_keeps_its_agent():
    confirmed = after(*[[seen()]] * 3, [missed()], [missed()], [seen()], [missed()], [missed()], [seen()])
    assert confirmed[2:] == [{(0, 0)}] * 7


def test_a_track_out_of_the_estimate_for_three_scans_is_another_labels_by_now():
    confirmed = after(*[[seen()]] * 3, *[[missed()]] * 3, [seen()])
    assert confirmed[4:] == [{(0, 0)}, set(), set()]


def test_a_track_below_lost_existence_is_given_up_at_once():
    assert after(*[[seen()]] * 3, [missed(existence=0.9 * LOST_EXISTENCE)])[-1] == set()
    assert after(*[[seen()]] * 3, [missed(existence=LOST_EXISTENCE)])[-1] == {(0, 0)}


def test_a_track_that_left_the_picture_must_be_confirmed_again():
    assert after(*[[seen()]] * 3, [], [seen()], [seen()], [seen()])[3:] == [set(), set(), set(), {(0, 0)}]


def test_what_is_confirmed_is_shown_where_it_is_now():
    confirmation = confirmation_of(LOST_EXISTENCE)
    for east_m in range(4):
        confirmation.update(picture(track((0, 0), (float(east_m), 5.0))))
    assert confirmation.tracks[(0, 0)].mean[0] == 3.0


def test_a_label_is_lost_when_it_hardly_exists_or_is_gone_and_not_when_it_was_only_missed():
    confirmation = confirmation_of(LOST_EXISTENCE)
    confirmation.update(picture(missed((0, 0), 0.02), missed((0, 1), 0.009)))
    assert [confirmation.is_lost(label) for label in [(0, 0), (0, 1), (7, 7)]] == [False, True, True]


def test_sensors_that_measure_at_one_epoch_count_once():
    confirmation = confirmation_of(LOST_EXISTENCE)
    for t_s in (0.0, 0.0, 0.0, 1.0, 1.0):
        confirmation.update(picture(seen(), t_s=t_s))
    assert not confirmation.tracks
    confirmation.update(picture(seen(), t_s=2.0))
    assert set(confirmation.tracks) == {(0, 0)}
    for t_s in (3.0, 3.0, 3.0, 4.0, 4.0):
        confirmation.update(picture(missed(), t_s=t_s))
    assert set(confirmation.tracks) == {(0, 0)}
    confirmation.update(picture(missed(), t_s=5.0))
    assert not confirmation.tracks


def test_a_sensor_that_covers_another_area_changes_no_confirmation():
    confirmation = confirmation_of(LOST_EXISTENCE)
    elsewhere = replace(RADAR, field_of_view_m=(500.0, 500.0, 900.0, 900.0))
    for _ in range(4):
        confirmation.update(picture(seen()), elsewhere)
    assert not confirmation.tracks
    for _ in range(3):
        confirmation.update(picture(seen()), RADAR)
        confirmation.update(picture(seen()), elsewhere)
    assert set(confirmation.tracks) == {(0, 0)}
    for _ in range(4):
        confirmation.update(picture(missed()), elsewhere)
    assert set(confirmation.tracks) == {(0, 0)}


@given(st.lists(st.booleans(), max_size=40))
def test_two_labels_of_one_object_are_never_both_confirmed_for_long(first_has_it):
    """The estimate holds one of the two; both are confirmed only until the other is out for three scans."""
    labels = {True: (0, 0), False: (1, 0)}
    both_in_a_row = 0
    confirmation = confirmation_of(LOST_EXISTENCE)
    for first in first_has_it:
        confirmation.update(picture(seen(labels[first], 0.55), missed(labels[not first], 0.45)))
        both_in_a_row = both_in_a_row + 1 if len(confirmation.tracks) == 2 else 0
        assert both_in_a_row < CONFIRMATION_EPOCHS


@given(st.lists(st.tuples(st.booleans(), st.floats(0.0, 1.0)), max_size=30))
def test_confirmation_follows_from_the_last_three_scans_and_the_former_confirmation(history):
    """No track enters without three scans in a row, none stays when lost, none leaves for two misses."""
    confirmation, was_confirmed, recent = confirmation_of(LOST_EXISTENCE), False, []
    for estimated, existence in history:
        one = track((0, 0), HERE, existence=existence, estimated=estimated)
        confirmation.update(picture(one))
        recent = [*recent, estimated][-3:]
        is_confirmed = (0, 0) in confirmation.tracks
        if was_confirmed:
            assert is_confirmed == (existence >= LOST_EXISTENCE and any(recent))
        else:
            assert is_confirmed == (recent == [True] * 3)
        was_confirmed = is_confirmed
