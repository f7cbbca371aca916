"""Charts of a long run would fill the memory, or show wrong rates, or show clutter instead of tracks."""

import numpy as np
import pytest

from gcs.console.view.chart_data import BINS, MAX_TRACKS, ChartData
from gcs.mavlink.fleet.telemetry_table import BATTERY_PERCENT, FRAMES, LOST, new_table
from gcs.model import Picture, Track, Truth, TruthObject


def picture(t_ns, existences, cardinality=(0.0, 1.0)):
    tracks = tuple(
        Track((0, number), np.array([100.0 * number, 0, 0, 0]), np.eye(4), existence, existence > 0.5)
        for number, existence in existences.items()
    )
    return Picture(t_ns, t_ns, "targets", tracks, np.array(cardinality))


def test_a_day_fits_into_the_bins_of_a_minute():
    charts = ChartData()
    for t_s in range(0, 86_400, 20):
        charts.add_work(t_s, "scan", 1.0 if t_s != 40_000 else 9.0)
    built = charts.build(is_complete=True)
    assert built.bins <= BINS
    assert built.bins * built.width_s == pytest.approx(86_400, rel=0.02)
    assert built.work["scan"][int(40_000 / built.width_s)] == 9.0
    assert all(value is not None for value in built.work["scan"])


def test_rates_and_losses_are_those_between_two_counts():
    charts, table = ChartData(), new_table(2)
    for second in range(0, 30, 10):
        table[0, [FRAMES, LOST, BATTERY_PERCENT]] = 1 + 12 * second, 3 * second, 80
        charts.add_telemetry(second, (7, 8), table)
    built = charts.build(is_complete=True)
    assert [value for value in built.rate["7"] if value is not None] == [12.0, 12.0]
    assert [value for value in built.loss["7"] if value is not None] == [20.0, 20.0]
    assert [value for value in built.battery["7"] if value is not None] == [80.0] * 3
    assert "8" not in built.rate


def test_the_tracks_that_existed_most_are_shown():
    charts = ChartData()
    for second in range(90):
        clutter = {100 + second: 0.9, 1000 + second: 0.1}
        charts.add_picture(second, picture(second, {0: 1.0, 1: 0.8} | clutter))
    shown = charts.build(is_complete=True).existence["targets"]
    assert len(shown) == MAX_TRACKS
    assert {"T0.0", "T0.1"} <= shown.keys()
    assert not {name for name in shown if name.startswith("T0.10") and len(name) > 6}


def test_number_spread_and_ospa_are_compared_with_the_truth():
    charts = ChartData()
    places_m = {0: 0.0, 1: 103.0}
    objects = tuple(TruthObject("targets", number, east_m, 0.0, True) for number, east_m in places_m.items())
    charts.add_truth(Truth(5, objects))
    charts.add_picture(1.0, picture(5, {0: 1.0, 1: 0.9}, (0.0, 0.5, 0.5)))
    built = charts.build(is_complete=True)
    at = int(1.0 / built.width_s)
    assert built.objects["targets"][at] == 1.5
    assert built.spread["targets"][at] == 0.5
    assert built.true["targets"][at] == 2.0
    assert built.ospa["targets"][at] == pytest.approx(1.5)
