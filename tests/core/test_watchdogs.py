"""An operator would trust an old picture: sensors and vehicles without messages are named."""

import itertools
from collections.abc import Callable
from dataclasses import replace

from helpers.staging import RADAR, at, scan

from gcs.core.perception.input_errors import InputErrors
from gcs.core.perception.never_heard import check_never_heard
from gcs.core.perception.scan_timing import ScanTiming
from gcs.core.perception.sensor_watchdog import SensorWatchdog
from gcs.core.state import State
from gcs.model import BadInput, Notice, NoticeCode


def notices_of(step: Callable[[float], list], until_s: float) -> list[tuple[float, Notice]]:
    """Run a step twice a second; return the notices and when they came."""
    times = [0.5 * k for k in range(int(until_s * 2) + 1)]
    return [(t_s, notice) for t_s in times for notice in step(t_s)]


def codes(found: list[tuple[float, Notice]]) -> list[tuple[float, NoticeCode]]:
    return [(t_s, notice.code) for t_s, notice in found]


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
    assert codes(found) == [
        (5.0, NoticeCode.NO_SENSOR),
        (20.0, NoticeCode.SCANS_AGAIN),
        (26.0, NoticeCode.SENSOR_SILENT),
    ]
    assert [notice.parameters["silence_s"] for _, notice in found] == [5.0, 20.0, 5.0]


def test_a_sensor_whose_scans_are_processed_gets_no_notice() -> None:
    assert notices_of(watched(lambda t_s: t_s % 1.0 == 0.0), 20.0) == []


def test_a_slow_sensor_is_given_three_of_its_periods() -> None:
    found = notices_of(watched(lambda t_s: t_s % 4.0 == 0.0 and t_s <= 40.0), 60.0)
    assert codes(found) == [(52.0, NoticeCode.SENSOR_SILENT)]


def test_scans_that_are_all_refused_are_an_alarm_that_names_the_reason() -> None:
    found = notices_of(watched(lambda t_s: t_s <= 3.0, lambda _: "measured 900.0 s ago by its clock"), 12.0)
    assert codes(found) == [(8.0, NoticeCode.SCANS_REFUSED)]
    ((_, notice),) = found
    assert (notice.subject, notice.parameters["count"]) == ("radar", 9)
    assert notice.parameters["reason"] == "measured 900.0 s ago by its clock"


def test_one_sensor_of_two_that_falls_silent_is_named() -> None:
    watchdog = SensorWatchdog()

    def step(t_s: float) -> list[Notice]:
        effects = watchdog.poll(at(t_s)) + watchdog.processed("radar", at(t_s))
        return effects + (watchdog.processed("camera", at(t_s)) if t_s < 4.0 else [])

    ((t_s, notice),) = notices_of(step, 12.0)
    assert (t_s, notice.code, notice.subject) == (8.5, NoticeCode.SENSOR_SILENT, "camera")


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
    assert [t_s for t_s, notice in found if notice.subject == "radar"] == [9.0]
    assert len(found) == 2
    assert [t_s for t_s, notice in found if notice.subject == "camera"] == [205.0]


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
    assert codes(found) == [(10.0, NoticeCode.NO_ASSOCIATION), (15.5, NoticeCode.ASSOCIATED_AGAIN)]


def test_vehicles_that_were_never_heard_are_named_once() -> None:
    state = State.initial([1, 2, 3])
    state.agents[2].link.address = ("udp", "10.0.0.2:14550")

    def step(t_s: float) -> list[Notice]:
        for vehicle in (1, 3) if t_s == 20.0 else ():
            state.agents[vehicle].link.address = ("udp", "10.0.0.1:14550")
        return check_never_heard(state.agents, state.perception, at(t_s))

    found = notices_of(step, 40.0)
    assert codes(found) == [(10.0, NoticeCode.NOT_HEARD_YET), (20.0, NoticeCode.ALL_HEARD)]
    assert found[0][1].parameters["vehicles"] == (1, 3)


def test_repeated_errors_are_summarised_and_never_silenced() -> None:
    errors = InputErrors()
    found = notices_of(
        lambda t_s: errors.add(BadInput(at(t_s), "key", "no JSON")) + errors.poll(at(t_s)), 100.0
    )
    assert errors.count == 201
    assert codes(found[:3]) == [(t_s, NoticeCode.BAD_INPUT) for t_s in (0.0, 0.5, 1.0)]
    assert codes(found[3:]) == [(11.0 + 10.0 * k, NoticeCode.BAD_INPUT_MORE) for k in range(9)]
    summary = {"count": 20, "source": "key", "seconds": 10.0, "problem": "no JSON"}
    assert found[3][1].parameters == summary


def test_invented_sources_of_errors_are_summed_up_together() -> None:
    errors = InputErrors()
    first = [n for k in range(10_000) for n in errors.add(BadInput(at(0.0), f"k{k}", "noise"))]
    assert len(first) <= 70
    others = [n for n in errors.poll(at(10.0)) if n.parameters["source"] == "other sources"]
    assert [n.parameters["count"] > 9000 for n in others] == [True]
