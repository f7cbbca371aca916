"""Position reports of the last seconds, interpolated to the measurement times of scans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from gcs.core.perception.perception_state import PerceptionState, PositionReport
from gcs.core.state import Agent
from gcs.model import NS_PER_S, VehicleState

KEEP_NS = 8 * NS_PER_S
"""More than the maximum age of scans (`gcs.core.perception.scan_timing`)."""
SAMPLE_NS = NS_PER_S // 4
"""Minimum time between kept reports: a turn deviates by 0.2 m in it."""
_MAX_GAP_NS = 2 * NS_PER_S
"""Reports farther apart than this are not interpolated."""


class ReportHistory:
    """The last reports of each vehicle."""

    def __init__(self, agents: Mapping[int, Agent], state: PerceptionState) -> None:
        self._agents = agents
        self._state = state

    def add(self, t_ns: int, states: Sequence[VehicleState]) -> None:
        """Add the newest reports."""
        self._state.sampled_t_ns = t_ns
        for state in states:
            reports = self._agents[state.system_id].perception.reports
            if not reports or state.t_ns > reports[-1].t_ns:
                reports.append(_report(state))
            while reports[0].t_ns < t_ns - KEEP_NS and len(reports) > 1:
                del reports[0]

    def is_due(self, t_ns: int) -> bool:
        """Return True if reports should be added again."""
        return t_ns - self._state.sampled_t_ns >= SAMPLE_NS

    def at(self, t_ns: int, states: Sequence[VehicleState]) -> list[VehicleState]:
        """Return the state of each vehicle at `t_ns`.

        Position and altitude are interpolated; mode and mission item are current. A vehicle that has not
        reported since then keeps its newest report. With a gap in the reports, the nearer one is returned
        with its own time.
        """
        return [state if state.t_ns <= t_ns else self._before(t_ns, state) for state in states]

    def _before(self, t_ns: int, newest: VehicleState) -> VehicleState:
        later = _report(newest)
        for earlier in reversed(self._agents[newest.system_id].perception.reports):
            if earlier.t_ns <= t_ns:
                return _as_of(_between(earlier, later, t_ns), newest)
            later = earlier
        return _as_of(later, newest)


def _report(state: VehicleState) -> PositionReport:
    return PositionReport(
        state.t_ns, state.east_m, state.north_m, state.alt_msl_m, state.ground_speed_m_s, state.course_rad
    )


def _between(earlier: PositionReport, later: PositionReport, t_ns: int) -> PositionReport:
    gap_ns = later.t_ns - earlier.t_ns
    fraction = (t_ns - earlier.t_ns) / gap_ns
    if gap_ns > _MAX_GAP_NS:
        return earlier if fraction < 0.5 else later
    return PositionReport(
        t_ns,
        earlier.east_m + fraction * (later.east_m - earlier.east_m),
        earlier.north_m + fraction * (later.north_m - earlier.north_m),
        earlier.alt_msl_m + fraction * (later.alt_msl_m - earlier.alt_msl_m),
        later.ground_speed_m_s,
        later.course_rad,
    )


def _as_of(report: PositionReport, newest: VehicleState) -> VehicleState:
    """Return a past state with the current mode, arming state and mission item."""
    return replace(newest, **report._asdict())
