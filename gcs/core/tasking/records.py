"""State of tasking: queued and active uploads, onboard missions."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class AgentTasking:
    """Missions of one vehicle: queued, uploading, on board."""

    usual_upload_s: float | None = None
    """Estimated duration of an upload; None before the first one."""


@dataclass(slots=True)
class TaskingState:
    """Uploads over each link."""
