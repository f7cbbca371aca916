"""Sensors publish at their own pace: a scan that comes a little late must count, in its place."""

from helpers.noticed import noticed
from helpers.staging import RADAR, at, mission, scan
from hypothesis import given
from hypothesis import strategies as st

from gcs.core.engine import Engine
from gcs.core.perception.out_of_sequence_buffer import OutOfSequenceBuffer
from gcs.model import Notice, NoticeCode, Picture, Tick

GOAL = (1500.0, 200.0)
WAITS = "[tracking]\nreorder_window_s = 0.5\n"


def measured(scans):
    return [one.measured_t_ns for one in scans]


def test_without_a_window_every_scan_goes_at_once_in_the_order_of_arrival():
    order = OutOfSequenceBuffer()
    for t_s in (2.0, 1.0):
        one = scan(t_s, arrives_s=3.0)
        order.add(one)
        assert order.due(at(3.0), 0.0) == [one]


def test_a_scan_waits_for_the_window_and_then_goes_even_if_nothing_else_comes():
    order = OutOfSequenceBuffer()
    order.add(scan(1.0, arrives_s=1.2))
    assert order.due(at(1.4), 0.5) == []
    (one,) = order.due(at(1.5), 0.5)
    assert (one.measured_t_ns, one.t_ns) == (at(1.0), at(1.5))


@given(
    st.lists(st.tuples(st.integers(0, 200), st.integers(0, 120)), max_size=30),
    st.integers(0, 100),
)
def test_scans_within_the_window_come_out_in_the_order_of_measurement(measurements, window):
    """Times in hundredths of a second; each scan arrives after its delay."""
    order, out = OutOfSequenceBuffer(), []
    arrivals = sorted((t + delay, t, delay) for t, delay in measurements)
    for arrival, t, _ in arrivals:
        order.add(scan(t / 100.0, arrives_s=arrival / 100.0))
        out += order.due(at(arrival / 100.0), window / 100.0)
    out += order.due(at(10.0), window / 100.0)
    assert len(out) == len(measurements)
    if all(delay <= window for _, delay in measurements) and window:
        assert measured(out) == sorted(measured(out))


def pictures(effects):
    return [e.scan_t_ns for e in effects if isinstance(e, Picture) and e.kind == "targets"]


def test_a_late_scan_is_processed_in_its_place_and_a_later_one_is_refused_with_a_notice():
    engine, effects = Engine(mission(births=[GOAL], tables=WAITS), 0), []
    for t_s, arrives_s in [(1.0, 1.1), (2.0, 2.1), (1.8, 2.2), (1.2, 2.9)]:
        for tick in range(10):
            effects += engine.step(Tick(at(arrives_s - 0.05 + tick / 1000)))
        effects += engine.step(scan(t_s, GOAL, arrives_s=arrives_s))
    effects += engine.step(Tick(at(3.5)))
    assert pictures(effects) == [at(1.0), at(1.8), at(2.0)]
    (warning,) = noticed(effects, NoticeCode.BAD_INPUT)
    assert "before the last one" in warning.parameters["problem"]
    assert engine.stages.input_errors.count == 1


def test_the_same_scan_twice_within_the_window_counts_once():
    engine, effects = Engine(mission(births=[GOAL], tables=WAITS), 0), []
    for arrives_s in (1.1, 1.2):
        effects += engine.step(scan(1.0, GOAL, arrives_s=arrives_s))
    effects += engine.step(Tick(at(2.0)))
    assert pictures(effects) == [at(1.0)]
    assert any("twice" in one.parameters["problem"] for one in noticed(effects, NoticeCode.BAD_INPUT))


def test_a_sensor_that_contradicts_its_model_is_reported_to_the_operator():
    engine, found = Engine(mission(births=[GOAL]), 0), []
    for k in range(40):
        clutter = [(100.0 + 37.0 * i, 50.0 + 45.0 * ((7 * i + 11 * k) % 40)) for i in range(50)]
        effects = engine.step(scan(float(k), *clutter, sensor=RADAR))
        found += [e for e in effects if isinstance(e, Notice) and e.code is NoticeCode.CLUTTER_WRONG]
    assert [notice.subject for notice in found] == ["radar"]
