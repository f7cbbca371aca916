"""A user with a slow radio would lose every mission to too many at once."""

from gcs.core.tasking.upload_window import UploadWindow

S = 10**9


def test_a_good_link_opens_to_its_bound():
    window = UploadWindow.first(12)
    for n in range(20):
        window.note_end(n * S, (n + 1) * S, 0.01, 0.0)
    assert window.window == 12


def test_long_round_trips_halve_it_once_for_those_under_way_together():
    window = UploadWindow.first(32)
    window.note_end(0, S, 0.2, 0.0)
    before = window.window
    for _ in range(before):
        window.note_end(S, 5 * S, 2.0, 0.0)
    assert window.window == before // 2
    window.note_end(6 * S, 9 * S, 2.0, 0.0)
    assert window.window == before // 4


def test_repeated_messages_narrow_it_but_one_always_goes():
    window = UploadWindow.first(4)
    for n in range(10):
        window.note_end(10 * n * S, (10 * n + 9) * S, None, 1.0)
    assert window.window == 1
