"""An operator would trust an old picture: sensors and vehicles without messages are named."""

import itertools
from collections.abc import Callable
from dataclasses import replace

from staging import RADAR, at, scan

from gcs.core.perception.input_errors import InputErrors
from gcs.core.perception.never_heard import check_never_heard
from gcs.core.perception.scan_timing import ScanTiming
from gcs.core.perception.sensor_watchdog import SensorWatchdog
from gcs.core.state import State
from gcs.model import BadInput, Notice


def notices_of(step: Callable[[float], list], until_s: float) -> list[tuple[float, str, str]]:
    """Run a step twice a second; return the notices and when they came."""
    times = [0.5 * k for k in range(int(until_s * 2) + 1)]
    return [(t_s, notice.level, notice.text) for t_s in times for notice in step(t_s)]


def watched(processed: Callable[[float], bool], refused: Callable[[float], str] = lambda _: "") -> Callable:
    watchdog = SensorWatchdog()

    def step(t_s: float) -> list[Notice]:
        effects = watchdog.poll(at(t_s))
        if processed(t_s):
            effects += watchdog.processed("radar", at(t_s))
        elif reason := refused(t_s):
            watchdog.refused("radar", at(t_s), reason)
        return effects

    return step


def test_a_sensor_that_never_comes_is_an_alarm_and_its_first_scan_the_all_clear() -> None:
    found = notices_of(watched(lambda t_s: t_s in (20.0, 21.0)), 30.0)
    assert [(t_s, level) for t_s, level, _ in found] == [(5.0, "alarm"), (20.0, "info"), (26.0, "alarm")]
    assert found[1][2] == "scans are processed after 20 s without one"
    assert found[2][2] == "no scan of sensor radar for 5 s: is the sensor there?"


def test_a_sensor_whose_scans_are_processed_gets_no_notice() -> None:
    assert notices_of(watched(lambda t_s: t_s % 1.0 == 0.0), 20.0) == []


def test_a_slow_sensor_is_given_three_of_its_periods() -> None:
    found = notices_of(watched(lambda t_s: t_s % 4.0 == 0.0 and t_s <= 40.0), 60.0)
    assert [(t_s, level) for t_s, level, _ in found] == [(52.0, "alarm")]


def test_scans_that_are_all_refused_are_an_alarm_that_names_the_reason() -> None:
    found = notices_of(watched(lambda t_s: t_s <= 3.0, lambda _: "measured 900.0 s ago by its clock"), 12.0)
    ((t_s, level, text),) = found
    assert (t_s, level) == (8.0, "alarm")
    assert text.startswith(
        "no scan of sensor radar was processed for 5 s, 9 were refused: measured 900.0 s ago"
    )


def test_one_sensor_of_two_that_falls_silent_is_named() -> None:
    watchdog = SensorWatchdog()

    def step(t_s: float) -> list[Notice]:
        effects = watchdog.poll(at(t_s)) + watchdog.processed("radar", at(t_s))
        return effects + (watchdog.processed("camera", at(t_s)) if t_s < 4.0 else [])

    ((t_s, level, text),) = notices_of(step, 12.0)
    assert (t_s, level, text) == (8.5, "alarm", "no scan of sensor camera for 5 s: is the sensor there?")


def test_invented_sensor_names_leave_the_memory_bounded() -> None:
    watchdog = SensorWatchdog()
    for k in range(10_000):
        watchdog.refused(f"s{k}", at(0.0), "no reason")
    assert len(watchdog.sensors) <= 256


def test_refused_scans_under_ever_new_names_do_not_hide_that_the_radar_fell_silent() -> None:
    """Sixty names a second, and a radar that ends after four seconds; then one sensor with a bad clock."""
    watchdog, numbers = SensorWatchdog(), itertools.count()

    def step(t_s: float) -> list[Notice]:
        effects = watchdog.poll(at(t_s))
        if t_s <= 4.0:
            effects += watchdog.processed("radar", at(t_s))
        for _ in range(30 if t_s < 100.0 else 0):
            watchdog.refused(f"s{next(numbers)}", at(t_s), "no reason")
        if t_s >= 200.0:
            watchdog.refused("camera", at(t_s), "measured 900.0 s ago")
        return effects

    found = notices_of(step, 210.0)
    assert [t_s for t_s, _, text in found if "sensor radar" in text] == [9.0]
    assert len(found) == 2
    assert [t_s for t_s, _, text in found if "sensor camera" in text] == [205.0]


def test_refused_scans_under_ever_new_names_do_not_lose_the_clock_of_the_radar() -> None:
    timing = ScanTiming()
    for k in range(10):
        timing.corrected(scan(k - 20.0, arrives_s=float(k)))  # its clock is 20 s behind
    offset_ns = timing.clocks["radar"].offset_ns
    assert offset_ns > 0
    for k in range(1000):
        timing.corrected(scan(-900.0, arrives_s=20.0, sensor=replace(RADAR, name=f"s{k}")))
    assert timing.clocks["radar"].offset_ns == offset_ns
    assert len(timing.clocks) <= 256


def test_vehicles_that_report_and_are_never_associated_are_an_alarm() -> None:
    watchdog = SensorWatchdog()
    found = notices_of(
        lambda t_s: watchdog.associated(at(t_s), {1, 2}, {1: "track"} if t_s > 15.0 else {}), 20.0
    )
    assert [(t_s, level) for t_s, level, _ in found] == [(10.0, "alarm"), (15.5, "info")]
    assert "nothing is planned" in found[0][2]


def test_vehicles_that_were_never_heard_are_named_once() -> None:
    state = State.initial([1, 2, 3])
    state.agents[2].link.address = ("udp", "10.0.0.2:14550")
    ((t_s, level, text),) = notices_of(
        lambda t_s: check_never_heard(state.agents, state.perception, at(t_s)), 40.0
    )
    assert (t_s, level) == (10.0, "warning")
    assert text.startswith("agents 1, 3 not heard yet")


def test_repeated_errors_are_summarised_and_never_silenced() -> None:
    errors = InputErrors()
    found = notices_of(
        lambda t_s: errors.add(BadInput(at(t_s), "key", "no JSON")) + errors.poll(at(t_s)), 100.0
    )
    assert errors.count == 201
    assert [t_s for t_s, _, _ in found[:3]] == [0.0, 0.5, 1.0]
    assert [t_s for t_s, _, _ in found[3:]] == [11.0 + 10.0 * k for k in range(9)]
    assert found[3][2] == "bad input: 20 more of key in 10 s, the last: no JSON"


def test_invented_sources_of_errors_are_summed_up_together() -> None:
    errors = InputErrors()
    first = [n for k in range(10_000) for n in errors.add(BadInput(at(0.0), f"k{k}", "noise"))]
    assert len(first) <= 70
    (summary,) = [n for n in errors.poll(at(10.0)) if "other sources" in n.text]
    assert "9" in summary.text
