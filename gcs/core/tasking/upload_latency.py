"""Upload latency: estimated time from a plan until its vehicle flies it.

A good link takes a second or two, a poor radio half a minute, during which the target moves on. The estimate
follows the uploads of each vehicle, and intercepts are planned with it.
"""

from __future__ import annotations

from gcs.core.tasking.tasking_state import AgentTasking

DELIVERY_S = 1.0
"""Latency on a good link."""
_GAIN = 0.5


def _usual_s(tasking: AgentTasking) -> float:
    return DELIVERY_S if tasking.usual_upload_s is None else tasking.usual_upload_s


def note_success(tasking: AgentTasking, duration_s: float) -> None:
    """Update the estimate of a vehicle with a successful upload."""
    usual_s = _usual_s(tasking)
    tasking.usual_upload_s = usual_s + _GAIN * (duration_s - usual_s)


def note_failure(tasking: AgentTasking, after_s: float) -> None:
    """Update the estimate of a vehicle with an upload that ended early: it would have taken longer."""
    if after_s > _usual_s(tasking):
        note_success(tasking, after_s)


def late_s(tasking: AgentTasking) -> float:
    """Return the latency of an upload that starts now, beyond that of a good link."""
    return max(0.0, _usual_s(tasking) - DELIVERY_S)


def left_s(tasking: AgentTasking, elapsed_s: float) -> float:
    """Return the remaining time of an upload that began `elapsed_s` ago; at least that of a good link."""
    return max(DELIVERY_S, _usual_s(tasking) - elapsed_s)
