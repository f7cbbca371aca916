"""What the console needs of a run: a service in another process, or a replay in this one."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path

from gcs.console.view.news import News, NewsRequest
from gcs.console.view.page_records import MissionInfo, VehicleDetail
from gcs.console.web.playback_control import Playback


class UnknownVehicleError(LookupError):
    """The mission has no such vehicle."""


@dataclass(frozen=True, slots=True)
class Source:
    """The run that a console shows, and how to act on it. Its functions are called on the console's loop."""

    mission: MissionInfo
    pull: Callable[[NewsRequest], Awaitable[News | None]]
    """Returns what is new; None if the run does not answer."""
    detail: Callable[[int, tuple[int, int]], Awaitable[VehicleDetail | None]]
    """Returns the details of a vehicle, given the number and time of its last verified mission; None if the
    run does not answer. Raises `UnknownVehicleError`."""
    submit: Callable[[bytes], None] | None = None
    """Passes the JSON of an order to the service, or raises `LinkError`; None in a replay."""
    playback: Playback | None = None
    """Position and speed of a replay; None for a live service."""
    call: Callable[[Callable[[], None]], object] = lambda function: function()
    """Runs a function on the loop of a replay."""
    recording: Path | None = None
    """Recording that is replayed; None: a log, or a live service."""
    has_other_settings: bool = False
    """True if the recording is replayed with other settings: only the truth in it is that of the replay."""
    mission_file: str | None = None
    """Mission file of a service whose vehicles `gcs preflight` can check; else None."""
