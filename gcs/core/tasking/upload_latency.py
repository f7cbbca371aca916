"""Upload latency: estimated time from a plan until its vehicle flies it.

A good link takes a second or two, a poor radio half a minute, during which the target moves on. The estimate
follows the uploads of each vehicle, and intercepts are planned with it.
"""

from __future__ import annotations

from collections.abc import Mapping

from gcs.core.state import Agent

DELIVERY_S = 1.0
"""Latency on a good link."""
_GAIN = 0.5


class UploadLatency:
    """Estimated upload time of each vehicle."""

    def __init__(self, agents: Mapping[int, Agent]) -> None:
        self._agents = agents

    def _usual_s(self, vehicle: int) -> float:
        usual_s = self._agents[vehicle].tasking.usual_upload_s
        return DELIVERY_S if usual_s is None else usual_s

    def note_success(self, vehicle: int, duration_s: float) -> None:
        """Update the estimate with a successful upload."""
        usual_s = self._usual_s(vehicle)
        self._agents[vehicle].tasking.usual_upload_s = usual_s + _GAIN * (duration_s - usual_s)

    def note_failure(self, vehicle: int, after_s: float) -> None:
        """Update the estimate with an upload that ended early: it would have taken longer."""
        if after_s > self._usual_s(vehicle):
            self.note_success(vehicle, after_s)

    def late_s(self, vehicle: int) -> float:
        """Return the latency of an upload that starts now, beyond that of a good link."""
        return max(0.0, self._usual_s(vehicle) - DELIVERY_S)

    def left_s(self, vehicle: int, elapsed_s: float) -> float:
        """Return the remaining time of an upload that began `elapsed_s` ago; at least that of a good link."""
        return max(DELIVERY_S, self._usual_s(vehicle) - elapsed_s)
