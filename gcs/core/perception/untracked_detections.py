"""Tell the operator where detections persist that no track takes, and what to do."""

from __future__ import annotations

from gcs.config import Config
from gcs.model import NS_PER_S, FloatArray, Notice, Sensor
from gcs.tracking.models.persistent_detections import PersistentDetections

_AGAIN_AFTER_NS = 10 * NS_PER_S
_MAX_NAMED = 3


class Untracked:
    """Notices about objects that are seen and not tracked."""

    def __init__(self, config: Config) -> None:
        self._frame = config.local_frame
        rate = "raise" if config.tracking.targets.anywhere.per_s > 0.0 else "set"
        self._remedy = f"add [[births]] there, or {rate} tracking.targets.anywhere.per_s"
        self._persistent = PersistentDetections()
        self._new: list[tuple[float, float]] = []
        self._told_t_ns: int | None = None
        self._is_raised = False

    def take(self, t_ns: int, z_m: FloatArray, sensor: Sensor, explained: FloatArray) -> None:
        """Take a scan measured at `t_ns`, and how far tracks explain each of its detections, 0 to 1."""
        for east_m, north_m in self._persistent.process_scan(t_ns, z_m, sensor, explained).tolist():
            self._new.append((east_m, north_m))

    def notices(self, t_ns: int) -> list[Notice]:
        """Return what is to be said now: an alarm with the places every 10 s at most, and its all-clear."""
        if self._new and (self._told_t_ns is None or t_ns - self._told_t_ns >= _AGAIN_AFTER_NS):
            places, self._new, self._told_t_ns, self._is_raised = self._new, [], t_ns, True
            named = "; ".join(self._place(place) for place in places[:_MAX_NAMED])
            more = f" and at {len(places) - _MAX_NAMED} more places" if len(places) > _MAX_NAMED else ""
            text = f"detections persist at {named}{more} where no births are declared: no track takes them"
            return [Notice(t_ns, "alarm", f"{text}; {self._remedy}")]
        if self._is_raised and not self._new and not len(self._persistent.places_m):
            self._is_raised = False
            return [Notice(t_ns, "info", "no detections persist without a track any more")]
        return []

    def _place(self, place: tuple[float, float]) -> str:
        lat_deg, lon_deg = self._frame.to_geodetic(*place)
        return f"east {place[0]:.0f} m, north {place[1]:.0f} m ({lat_deg:.5f}, {lon_deg:.5f})"
