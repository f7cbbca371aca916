"""A user would lose missions: agents sent after clutter, targets given up after one missed detection."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
from staging import RADAR, picture, track

from gcs.core.perception.confirmation import CONFIRMATION_EPOCHS, TrackConfirmation

HERE = (0.0, 0.0)
DEAD = 0.01


def seen(label=(0, 0), existence=1.0):
    return track(label, HERE, existence=existence)


def missed(label=(0, 0), existence=0.3):
    return track(label, HERE, existence=existence, estimated=False)


def after(*pictures):
    """Which labels are believed after each of the pictures."""
    beliefs = TrackConfirmation(DEAD)
    found = []
    for tracks in pictures:
        beliefs.update(picture(*tracks))
        found.append(set(beliefs.tracks))
    return found


def test_a_clutter_point_is_in_the_estimate_for_a_scan_or_two_and_is_never_believed():
    assert after([seen()], [], [seen()], [seen()], [], []) == [set()] * 6
    assert after([seen()], [seen()], [missed()], [seen()], [seen()], [missed()]) == [set()] * 6


def test_a_track_is_believed_at_its_third_scan_in_a_row():
    assert after([seen()], [seen()], [seen()], [seen()]) == [set(), set(), {(0, 0)}, {(0, 0)}]


def test_a_target_missed_for_two_scans_keeps_its_agent():
    believed = after(*[[seen()]] * 3, [missed()], [missed()], [seen()], [missed()], [missed()], [seen()])
    assert believed[2:] == [{(0, 0)}] * 7


def test_a_track_out_of_the_estimate_for_three_scans_is_another_labels_by_now():
    believed = after(*[[seen()]] * 3, *[[missed()]] * 3, [seen()])
    assert believed[4:] == [{(0, 0)}, set(), set()]


def test_a_track_below_dead_existence_is_given_up_at_once():
    assert after(*[[seen()]] * 3, [missed(existence=0.9 * DEAD)])[-1] == set()
    assert after(*[[seen()]] * 3, [missed(existence=DEAD)])[-1] == {(0, 0)}


def test_a_track_that_left_the_picture_is_given_up_and_must_earn_belief_again():
    assert after(*[[seen()]] * 3, [], [seen()], [seen()], [seen()])[3:] == [set(), set(), set(), {(0, 0)}]


def test_what_is_believed_is_shown_where_it_is_now():
    beliefs = TrackConfirmation(DEAD)
    for east_m in range(4):
        beliefs.update(picture(track((0, 0), (float(east_m), 5.0))))
    assert beliefs.tracks[(0, 0)].mean[0] == 3.0


def test_a_label_is_dead_when_it_hardly_exists_or_is_gone_and_not_when_it_was_only_missed():
    beliefs = TrackConfirmation(DEAD)
    beliefs.update(picture(missed((0, 0), 0.02), missed((0, 1), 0.009)))
    assert [beliefs.is_lost(label) for label in [(0, 0), (0, 1), (7, 7)]] == [False, True, True]


def test_sensors_that_measure_at_the_same_moment_count_once():
    beliefs = TrackConfirmation(DEAD)
    for t_s in (0.0, 0.0, 0.0, 1.0, 1.0):
        beliefs.update(picture(seen(), t_s=t_s))
    assert not beliefs.tracks
    beliefs.update(picture(seen(), t_s=2.0))
    assert set(beliefs.tracks) == {(0, 0)}
    for t_s in (3.0, 3.0, 3.0, 4.0, 4.0):
        beliefs.update(picture(missed(), t_s=t_s))
    assert set(beliefs.tracks) == {(0, 0)}
    beliefs.update(picture(missed(), t_s=5.0))
    assert not beliefs.tracks


def test_a_sensor_that_looks_elsewhere_neither_earns_nor_costs_belief():
    beliefs = TrackConfirmation(DEAD)
    elsewhere = replace(RADAR, field_of_view_m=(500.0, 500.0, 900.0, 900.0))
    for _ in range(4):
        beliefs.update(picture(seen()), elsewhere)
    assert not beliefs.tracks
    for _ in range(3):
        beliefs.update(picture(seen()), RADAR)
        beliefs.update(picture(seen()), elsewhere)
    assert set(beliefs.tracks) == {(0, 0)}
    for _ in range(4):
        beliefs.update(picture(missed()), elsewhere)
    assert set(beliefs.tracks) == {(0, 0)}


@given(st.lists(st.booleans(), max_size=40))
def test_two_labels_of_one_object_are_never_both_believed_for_long(first_has_it):
    """The estimate holds one of the two; both are believed only until the other is out for three scans."""
    labels = {True: (0, 0), False: (1, 0)}
    both_in_a_row = 0
    beliefs = TrackConfirmation(DEAD)
    for first in first_has_it:
        beliefs.update(picture(seen(labels[first], 0.55), missed(labels[not first], 0.45)))
        both_in_a_row = both_in_a_row + 1 if len(beliefs.tracks) == 2 else 0
        assert both_in_a_row < CONFIRMATION_EPOCHS


@given(st.lists(st.tuples(st.booleans(), st.floats(0.0, 1.0)), max_size=30))
def test_belief_follows_from_the_last_three_scans_and_what_was_believed_before(history):
    """Nothing enters without three scans in a row, nothing stays dead, nothing leaves for two misses."""
    beliefs, was_believed, recent = TrackConfirmation(DEAD), False, []
    for estimated, existence in history:
        one = track((0, 0), HERE, existence=existence, estimated=estimated)
        beliefs.update(picture(one))
        recent = [*recent, estimated][-3:]
        is_believed = (0, 0) in beliefs.tracks
        if was_believed:
            assert is_believed == (existence >= DEAD and any(recent))
        else:
            assert is_believed == (recent == [True] * 3)
        was_believed = is_believed
