"""Uploads of missions, of fences and of rally points: the same machine with other rules and limits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from gcs.mavlink.autopilots import profile_of
from gcs.mavlink.fleet.mode_authority import ModeAuthority
from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, OWN_IDS, Message
from gcs.mavlink.mission.item_transfer import MissionUpload
from gcs.mavlink.mission.items import Item
from gcs.mavlink.mission.upload import Upload
from gcs.mavlink.mission.upload_limits import UploadLimits, UploadPolicy
from gcs.mavlink.mission.upload_rules import LIST_RULES, MISSION_RULES
from gcs.mavlink.mission.upload_stages import Event
from gcs.mavlink.mission.upload_state import Flight, Transfer, UploadState
from gcs.mavlink.services.retransmission_timeout import RttEstimator
from gcs.model import system_of

_MISSION_LIMITS: Final = UploadLimits()
_LIST_LIMITS: Final = UploadLimits(
    max_tries=6, min_answer_s=6.0, max_uploads=4, first_pause_s=0.0, transfer_timeout_s=1800.0
)


def mission_upload(
    state: UploadState,
    encode: Callable[[Message], bytes],
    authority: ModeAuthority,
    policy: UploadPolicy,
) -> Upload:
    """Return the upload of a mission: before its begin, or in progress as its state says.

    Parameters
    ----------
    encode : callable
        Message to frame for this vehicle, such as `Fleet.encoder`.
    authority : ModeAuthority
        Of this vehicle.
    policy : UploadPolicy
        Shared by all uploads.
    """
    profile = profile_of(state.autopilot)
    assert profile is not None  # it had one at the begin
    limits = _MISSION_LIMITS.for_round_trip(state.rtt.earlier_s)
    return Upload(MISSION_RULES, state, encode, limits, Flight(profile, authority, policy))


def list_upload(
    vehicle: int,
    mission_type: int,
    items: Sequence[Item] | None,
    encode: Callable[[Message], bytes],
    t_ns: int,
    own: tuple[int, int] = OWN_IDS,
) -> Upload:
    """Begin the upload or download of a fence or of rally points.

    It succeeds when the list reads back equal. A failed upload is repeated as a whole.

    Parameters
    ----------
    mission_type : int
        MAV_MISSION_TYPE_FENCE or _RALLY.
    items : sequence of Item or None
        Items to upload; an empty sequence clears the list, None downloads only.
    own : (int, int)
        Our system and component id.
    """
    to = (system_of(vehicle), AUTOPILOT_COMPONENT_ID)
    sending = MissionUpload(tuple(items or ()), to, mission_type, in_order=True)
    state = UploadState(vehicle, Transfer(sending), RttEstimator())
    upload = Upload(LIST_RULES, state, encode, _LIST_LIMITS, own=own)
    upload.fire(Event.DOWNLOAD if items is None else Event.START, t_ns)
    return upload
