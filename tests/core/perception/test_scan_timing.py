"""What a sensor's clock may do without blinding the picture, or placing it where nothing is."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.staging import at

from gcs.core.perception.perception_state import PerceptionState
from gcs.core.perception.report_history import ReportHistory
from gcs.core.perception.scan_timing import ScanTiming
from gcs.core.state import State
from gcs.model import NS_PER_S, ClockStep, NoticeCode, Scan, Sensor, VehicleState

SENSOR = Sensor("radar", 0.98, 1e-6, np.eye(2), (0.0, 0.0, 1.0, 1.0))


def scan(t_s: float, lag_s: float = 0.1) -> Scan:
    return Scan(at(t_s), at(t_s) - round(lag_s * NS_PER_S), SENSOR, np.zeros((0, 2)))


def run(timing: ScanTiming, lags_s: list[float], start_s: float = 0.0) -> list[float | None]:
    """Feed a scan a second; return the lag with which each is worked, None for those refused."""
    worked: list[float | None] = []
    for k, lag_s in enumerate(lags_s):
        corrected, refusal, _ = timing.corrected(scan(start_s + k, lag_s))
        lag = round((corrected.t_ns - corrected.measured_t_ns) / NS_PER_S, 3)
        worked.append(None if refusal else lag)
    return worked


@pytest.mark.parametrize("lag_s", [0.0, 1.5, 3.0, 4.9])
def test_an_honest_latency_is_accepted_as_it_is(lag_s: float) -> None:
    assert run(ScanTiming(), [lag_s] * 10) == [lag_s] * 10


@pytest.mark.parametrize("off_s", [20.0, -20.0, 3600.0, 86400.0])
def test_a_clock_that_is_off_by_a_constant_is_corrected_once_it_has_shown_itself(off_s: float) -> None:
    timing = ScanTiming()
    assert run(timing, [0.2] * 3) == [0.2] * 3
    assert run(timing, [0.2 + off_s] * 8, 3.0) == [None] * 4 + [0.2] * 4
    assert run(timing, [0.2] * 8, 11.0) == [None] * 4 + [0.2] * 4  # set right again


def test_a_corrected_clock_is_reported_to_the_operator() -> None:
    timing = ScanTiming()
    notices = [n for k in range(6) for n in timing.corrected(scan(float(k), 600.0))[2]]
    (notice,) = notices
    assert (notice.code, notice.subject) == (NoticeCode.SENSOR_CLOCK_OFF, "radar")
    assert notice.parameters["off_s"] == pytest.approx(600.0, abs=0.05)
    assert notice.parameters["side"] == "behind"


def test_old_scans_that_arrive_all_at_once_are_refused() -> None:
    timing = ScanTiming()
    run(timing, [0.1] * 5)
    backlog = [replace(scan(30.0), measured_t_ns=at(5.0 + k)) for k in range(20)]
    assert all(timing.corrected(one)[1] for one in backlog)


def test_a_jumping_clock_is_never_confirmed() -> None:
    assert run(ScanTiming(), [100.0 * (k % 7 + 1) for k in range(50)]) == [None] * 50


@pytest.mark.parametrize("step_s", [0.5, -0.5, 1.5, -1.5, 20.0, -20.0, 600.0, -3600.0])
@pytest.mark.parametrize("same_machine", [True, False])
def test_no_scan_is_lost_when_the_wall_clock_is_set(step_s: float, same_machine: bool) -> None:
    timing = ScanTiming()
    run(timing, [0.3] * 5)
    timing.step(ClockStep(at(4.5), round(step_s * NS_PER_S)))
    after_s = 0.3 - step_s if same_machine else 0.3
    assert run(timing, [after_s] * 10, 5.0) == [0.3] * 10


def test_invented_sensors_leave_the_memory_bounded() -> None:
    timing = ScanTiming()
    for k in range(5000):
        timing.corrected(replace(scan(0.0), sensor=replace(SENSOR, name=f"s{k}")))
    assert len(timing.clocks) <= 256


def state(t_s: float, east_m: float, mode: str = "AUTO") -> VehicleState:
    return VehicleState(1, at(t_s), east_m, 0.0, 100.0, 15.0, 1.57, mode, True, 1)


def test_a_vehicle_is_compared_at_the_epoch_of_the_scan() -> None:
    history = ReportHistory(State.initial([1]).agents, PerceptionState())
    for k in range(40):
        history.add(at(0.25 * k), [state(0.25 * k, 3.75 * k)])
    newest = state(9.75, 146.25, "RTL")
    (then,) = history.at(at(6.6), [newest])
    assert then.east_m == pytest.approx(15.0 * 6.6)
    assert (then.t_ns, then.mode) == (at(6.6), "RTL")
    assert history.at(at(9.8), [newest]) == [newest]


def test_reports_with_a_gap_are_not_interpolated() -> None:
    history = ReportHistory(State.initial([1]).agents, PerceptionState())
    history.add(at(0.0), [state(0.0, 0.0)])
    newest = state(5.0, 75.0)
    history.add(at(5.0), [newest])
    assert history.at(at(1.0), [newest])[0].t_ns == at(0.0)
    assert history.at(at(4.0), [newest])[0].t_ns == at(5.0)
