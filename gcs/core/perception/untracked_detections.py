"""Alarms about detections that persist without a track: an object where no birth is expected."""

from __future__ import annotations

from gcs.config import Config
from gcs.core.perception.perception_state import UntrackedState
from gcs.model import NS_PER_S, FloatArray, Notice, NoticeCode, Parameter, Sensor

_REPEAT_NS = 10 * NS_PER_S
_MAX_NAMED = 3


class UntrackedDetections:
    """Alarms about detections that persist where no birth component is declared."""

    def __init__(self, config: Config, state: UntrackedState) -> None:
        self._frame = config.local_frame
        rate = "raise" if config.tracking.targets.anywhere.per_s > 0.0 else "set"
        self._remedy = f"add [[births]] there, or {rate} tracking.targets.anywhere.per_s"
        self._state = state

    def add_scan(self, t_ns: int, z_m: FloatArray, sensor: Sensor, explained: FloatArray) -> None:
        """Add the detections measured at `t_ns`; `explained` in [0, 1] is the part that tracks explain."""
        for east_m, north_m in self._state.chains.process_scan(t_ns, z_m, sensor, explained).tolist():
            self._state.new_m.append((east_m, north_m))

    def notices(self, t_ns: int) -> list[Notice]:
        """Return an alarm with the new positions, at most every 10 s, or its all-clear."""
        state = self._state
        if state.new_m and (state.notice_t_ns is None or t_ns - state.notice_t_ns >= _REPEAT_NS):
            positions = state.new_m
            state.new_m = []
            state.notice_t_ns = t_ns
            state.is_raised = True
            named = "; ".join(self._words(position) for position in positions[:_MAX_NAMED])
            more = f" and at {len(positions) - _MAX_NAMED} more places" if len(positions) > _MAX_NAMED else ""
            found: dict[str, Parameter] = {"places": named + more, "remedy": self._remedy}
            return [Notice(t_ns, NoticeCode.UNTRACKED_DETECTIONS, None, found)]
        if state.is_raised and not state.new_m and not len(state.chains.places_m):
            state.is_raised = False
            return [Notice(t_ns, NoticeCode.UNTRACKED_OVER)]
        return []

    def _words(self, position_m: tuple[float, float]) -> str:
        lat_deg, lon_deg = self._frame.to_geodetic(*position_m)
        return f"east {position_m[0]:.0f} m, north {position_m[1]:.0f} m ({lat_deg:.5f}, {lon_deg:.5f})"
