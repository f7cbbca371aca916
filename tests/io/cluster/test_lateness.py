"""What was delayed between two processes is known as late, whatever their clocks show."""

from hypothesis import given
from hypothesis import strategies as st

from gcs.io.cluster.lateness import MAX_LATE_NS, Lateness
from gcs.model import NS_PER_S

MS = 1_000_000
offsets = st.integers(-(10**18), 10**18)


@given(offsets, st.lists(st.integers(0, 20 * MS), min_size=1, max_size=50))
def test_messages_with_usual_delays_are_not_late_whatever_the_clocks_show(
    offset: int, delays: list[int]
) -> None:
    lateness = Lateness()
    for number, delay in enumerate(delays):
        sent = number * NS_PER_S
        assert lateness.of(1, sent, offset + sent + delay) <= 21 * MS


@given(offsets)
def test_what_waited_while_the_receiver_was_stopped_is_late_and_what_follows_is_not(offset: int) -> None:
    lateness = Lateness()
    for t in range(0, 5 * NS_PER_S, NS_PER_S // 10):
        lateness.of(1, t, offset + t + MS)
    goes_on = offset + 15 * NS_PER_S
    late = [lateness.of(1, t, goes_on) for t in range(5 * NS_PER_S, 15 * NS_PER_S, NS_PER_S // 10)]
    assert all(one > MAX_LATE_NS for one in late[:90])
    assert all(one < MAX_LATE_NS for one in late[-9:])
    assert lateness.of(1, 15 * NS_PER_S, goes_on + MS) < 10 * MS


def test_clocks_that_drift_apart_for_a_day_make_nothing_late() -> None:
    lateness = Lateness()
    for t in range(0, 86_400 * NS_PER_S, NS_PER_S):
        assert lateness.of(1, t, t + t // 10_000) < 10 * MS


def test_a_sender_that_starts_again_with_another_clock_is_not_late() -> None:
    lateness = Lateness()
    lateness.of(1, 100 * NS_PER_S, 200 * NS_PER_S)
    assert lateness.of(2, 5 * NS_PER_S, 201 * NS_PER_S) == 0
