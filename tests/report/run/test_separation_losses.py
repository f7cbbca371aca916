"""A loss of separation was one line among all alarms of a report, and its end was not in it."""

from gcs.model import Notice, NoticeCode, Tick
from gcs.report.run import tables
from gcs.report.run.timeline import gather

S = 1_000_000_000
PLACE = {"after_s": 0.0, "east_m": 120.0, "north_m": 340.0, "place_height_m": 80.0}


def lost(t_s, vehicle, other, distance_m=41.0):
    about = {"other": other, "distance_m": distance_m, "height_m": 3.0, **PLACE}
    return Notice(t_s * S, NoticeCode.SEPARATION_LOST, vehicle, about)


def test_a_report_lists_who_was_near_whom_when_and_how_near():
    apart = Notice(
        42 * S, NoticeCode.APART_AGAIN, 1, {"other": 3, "nearest_m": 17.4, "nearest_height_m": 8.0}
    )
    timeline = gather([Tick(0), lost(30, 1, 3), lost(31, 1, 3), apart, lost(50, 2, 3), Tick(60 * S)])
    table = tables.losses(timeline)
    assert table.rows == (
        ("1 and 3", "30.0", "42.0", "17", "8", "120, 340"),
        ("2 and 3", "50.0", "–", "41", "3", "120, 340"),
    )


def test_an_approach_that_stayed_apart_is_no_loss():
    apart = Notice(42 * S, NoticeCode.APART_AGAIN, 1, {"other": 3})
    assert not gather([Tick(0), apart, Tick(60 * S)]).losses
