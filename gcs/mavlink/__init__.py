"""MAVLink without I/O: bytes and times in, bytes and notices out. For readers who know pymavlink.

In reading order:

=================================  ======================================================================
`frames.codec`                     frame layout, `scan` (parse_buffer), `Encoder` (pack), `target_of`
`frames.stream`                    frames out of a TCP or serial byte stream
`frames.signing`                   MAVLink 2 message signing: keys, checks, time stamps
`frames.fast_scan`                 `scan` compiled; `fast_verify` and `batches` build on it
`fleet.fleet`                      all vehicles: datagrams in; `Send`, `Notice`, vehicle states out
`fleet.address_learning`           where a vehicle is heard, and when it has moved
`fleet.records`                    the state of one vehicle and of all links, as plain records
`fleet.vehicle`                    one vehicle: position, mode, home, health (mavutil's `messages`)
`fleet.checks.link_timeouts`       when a silent vehicle is stale, and when its link is down
`fleet.stream_requests`            SET_MESSAGE_INTERVAL and REQUEST_MESSAGE, repeated
`fleet.mode_authority`             control authority: our mode, or an operator's override
`fleet.checks.position_checks`     which GLOBAL_POSITION_INT reports to believe
`fleet.fast_telemetry`             routine telemetry, compiled, on the table in `fleet.telemetry_table`
`services.command_sender`          COMMAND_LONG, set_mode, and their repetition
`services.parameter_protocol`      PARAM_REQUEST_READ and PARAM_SET (ParameterReader, ParameterSetter)
`services.retry`                   RetryPolicy, RetryTimer: repetition of a request
`services.retransmission_timeout`  RttEstimator: when to send again, by the round trip
`mission.items`                    MISSION_ITEM_INT as a record
`mission.item_builder`             a mission as the items of a firmware
`mission.item_transfer`            MissionDownload, MissionUpload: the transfers of the mission protocol
`mission.upload_rules`             what follows on what in an upload: the table that drives it
`mission.upload_limits`            timeouts and bounds of an upload
`mission.uploads`                  a mission uploaded, verified, selected and started; a fence or rally points
`autopilots.profile`               profile of each autopilot: modes, formats, limits
`autopilots.preflight_parameters`  parameters that the preflight check reads, and their ranges
`router.router`                    routes between vehicles and other ground stations
=================================  ======================================================================

The names in `__all__` are the public interface (`docs/library.md`), imported at first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from gcs.endpoints import Link, parse_endpoint
    from gcs.mavlink.autopilots import ARDUPLANE, PX4, AutopilotProfile
    from gcs.mavlink.fleet.mode_authority import ModeAuthority
    from gcs.mavlink.frames.codec import Encoder, Frame, FrameTable, decode, scan, target_of
    from gcs.mavlink.frames.stream import FrameStream
    from gcs.mavlink.mission.item_builder import build_items
    from gcs.mavlink.mission.items import Home, Item, item_of
    from gcs.mavlink.mission.upload import Upload
    from gcs.mavlink.mission.upload_kinds import list_upload, mission_upload
    from gcs.mavlink.mission.upload_limits import UploadPolicy
    from gcs.mavlink.mission.upload_stages import Event, OnboardState, UploadResult
    from gcs.mavlink.mission.upload_state import UploadState
    from gcs.mavlink.router.router import Routed, Router
    from gcs.model import Mission, Waypoint

__all__ = [
    "ARDUPLANE",
    "PX4",
    "AutopilotProfile",
    "Encoder",
    "Event",
    "Frame",
    "FrameStream",
    "FrameTable",
    "Home",
    "Item",
    "Link",
    "Mission",
    "ModeAuthority",
    "OnboardState",
    "Routed",
    "Router",
    "Upload",
    "UploadPolicy",
    "UploadResult",
    "UploadState",
    "Waypoint",
    "build_items",
    "decode",
    "item_of",
    "list_upload",
    "mission_upload",
    "parse_endpoint",
    "scan",
    "target_of",
]

_PARTS: Final = {
    "gcs.endpoints": ("Link", "parse_endpoint"),
    "gcs.mavlink.autopilots": ("ARDUPLANE", "PX4", "AutopilotProfile"),
    "gcs.mavlink.fleet.mode_authority": ("ModeAuthority",),
    "gcs.mavlink.frames.codec": ("Encoder", "Frame", "FrameTable", "decode", "scan", "target_of"),
    "gcs.mavlink.frames.stream": ("FrameStream",),
    "gcs.mavlink.mission.item_builder": ("build_items",),
    "gcs.mavlink.mission.items": ("Home", "Item", "item_of"),
    "gcs.mavlink.mission.upload": ("Upload",),
    "gcs.mavlink.mission.upload_limits": ("UploadPolicy",),
    "gcs.mavlink.mission.upload_stages": ("Event", "OnboardState", "UploadResult"),
    "gcs.mavlink.mission.upload_state": ("UploadState",),
    "gcs.mavlink.mission.upload_kinds": ("list_upload", "mission_upload"),
    "gcs.mavlink.router.router": ("Routed", "Router"),
    "gcs.model": ("Mission", "Waypoint"),
}
_MODULES: Final = {name: module for module, names in _PARTS.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a public name at first use (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)
