"""Position reports of the last seconds, interpolated to the measurement times of scans."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

from gcs.model import NS_PER_S, VehicleState

KEEP_NS = 8 * NS_PER_S
"""More than the maximum age of scans (`gcs.core.perception.scan_timing`)."""
SAMPLE_NS = NS_PER_S // 4
"""Minimum time between kept reports: a turn deviates by 0.2 m in it."""
_MAX_GAP_NS = 2 * NS_PER_S
"""Reports farther apart than this are not interpolated."""


class ReportHistory:
    """The last reports of each vehicle."""

    def __init__(self) -> None:
        self._reports: dict[int, deque[VehicleState]] = {}
        self._sampled_t_ns = 0

    def add(self, t_ns: int, states: Sequence[VehicleState]) -> None:
        """Add the newest reports."""
        self._sampled_t_ns = t_ns
        for state in states:
            reports = self._reports.setdefault(state.system_id, deque())
            if not reports or state.t_ns > reports[-1].t_ns:
                reports.append(state)
            while reports[0].t_ns < t_ns - KEEP_NS and len(reports) > 1:
                reports.popleft()

    def is_due(self, t_ns: int) -> bool:
        """Return True if reports should be added again."""
        return t_ns - self._sampled_t_ns >= SAMPLE_NS

    def at(self, t_ns: int, states: Sequence[VehicleState]) -> list[VehicleState]:
        """Return the state of each vehicle at `t_ns`.

        Position and altitude are interpolated; mode and mission item are current. A vehicle that has not
        reported since then keeps its newest report. With a gap in the reports, the nearer one is returned
        with its own time.
        """
        return [state if state.t_ns <= t_ns else self._before(t_ns, state) for state in states]

    def _before(self, t_ns: int, newest: VehicleState) -> VehicleState:
        later = newest
        for earlier in reversed(self._reports.get(newest.system_id, ())):
            if earlier.t_ns <= t_ns:
                return _between(earlier, later, t_ns, newest)
            later = earlier
        return _as_of(later, later.t_ns, newest)


def _between(earlier: VehicleState, later: VehicleState, t_ns: int, newest: VehicleState) -> VehicleState:
    gap_ns = later.t_ns - earlier.t_ns
    fraction = (t_ns - earlier.t_ns) / gap_ns
    if gap_ns > _MAX_GAP_NS:
        nearer = earlier if fraction < 0.5 else later
        return _as_of(nearer, nearer.t_ns, newest)
    between = replace(
        later,
        east_m=earlier.east_m + fraction * (later.east_m - earlier.east_m),
        north_m=earlier.north_m + fraction * (later.north_m - earlier.north_m),
        alt_msl_m=earlier.alt_msl_m + fraction * (later.alt_msl_m - earlier.alt_msl_m),
    )
    return _as_of(between, t_ns, newest)


def _as_of(state: VehicleState, t_ns: int, newest: VehicleState) -> VehicleState:
    """Return a past state with the current mode, arming state and mission item."""
    return replace(state, t_ns=t_ns, mode=newest.mode, armed=newest.armed, mission_seq=newest.mission_seq)
