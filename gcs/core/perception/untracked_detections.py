"""Detections of one sensor that persist without a track.

An alarm tells of an object where no birth is expected. Where births are expected, such detections give birth
with the greatest probability: else misses of another sensor, which is blind or lies, could end each new track
before its second detection.
"""

from __future__ import annotations

import numpy as np

from gcs.config import Config
from gcs.core.perception.perception_state import UntrackedState
from gcs.model import NS_PER_S, BoolArray, FloatArray, Notice, NoticeCode, Parameter, Sensor
from gcs.tracking.models.persistent_detections import PersistentDetections

_SAME_M = 50.0
"""Distance between chains of two sensors that an alarm tells as one."""
_SENSOR_TIMEOUT_NS = 60 * NS_PER_S
"""The chains of a sensor without a scan for so long no longer count."""
_MAX_SENSORS = 100
"""Number of sensors with chains; the one whose last scan is oldest goes first."""
_REPEAT_NS = 10 * NS_PER_S
_MAX_NAMED = 3


class UntrackedDetections:
    """Alarms about detections that persist where no birth component is declared."""

    def __init__(self, config: Config, state: UntrackedState) -> None:
        self._frame = config.local_frame
        rate = "raise" if config.tracking.targets.anywhere.per_s > 0.0 else "set"
        self._remedy = f"add [[births]] there, or {rate} tracking.targets.anywhere.per_s"
        self._state = state

    def add_scan(self, t_ns: int, z_m: FloatArray, sensor: Sensor, explained: FloatArray) -> BoolArray:
        """Add the detections measured at `t_ns`; return (m,) True for those that persist without a track.

        `explained` (m,) in [0, 1] is the part that tracks explain.
        """
        chains = self._state.chains
        for name in [name for name, one in chains.items() if t_ns - one.t_ns > _SENSOR_TIMEOUT_NS]:
            del chains[name]
        if sensor.name not in chains:
            if len(chains) == _MAX_SENSORS:
                del chains[min(chains, key=lambda name: chains[name].t_ns)]
            chains[sensor.name] = PersistentDetections()
        own = chains[sensor.name]
        new_m, is_persistent = own.process_scan(t_ns, z_m, sensor, explained)
        others_m = np.concatenate([np.empty((0, 2)), *(o.places_m for o in chains.values() if o is not own)])
        for east_m, north_m in new_m.tolist():
            if not (np.hypot(*(others_m - (east_m, north_m)).T) < _SAME_M).any():
                self._state.new_m.append((east_m, north_m))
        return is_persistent

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
        if state.is_raised and not state.new_m and not any(len(o.places_m) for o in state.chains.values()):
            state.is_raised = False
            return [Notice(t_ns, NoticeCode.UNTRACKED_OVER)]
        return []

    def _words(self, position_m: tuple[float, float]) -> str:
        lat_deg, lon_deg = self._frame.to_geodetic(*position_m)
        return f"east {position_m[0]:.0f} m, north {position_m[1]:.0f} m ({lat_deg:.5f}, {lon_deg:.5f})"
