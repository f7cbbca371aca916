"""State of an upload: plain records, one for each part.

`StageState` is new with each stage. The others last as long as the upload: `Transfer` (of the items to the
vehicle), `Verification` (what it stores), `Activation` (what it flies), `Clearing`, and `Heartbeats` (its
mode). Uploads of fences and rally points use the first two only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from gcs.mavlink.autopilots import ARDUPLANE, AutopilotProfile
from gcs.mavlink.fleet.mode_authority import ModeAuthority
from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID
from gcs.mavlink.mission.item_transfer import MissionDownload, MissionUpload
from gcs.mavlink.mission.items import Item
from gcs.mavlink.mission.upload_limits import UploadPolicy
from gcs.mavlink.mission.upload_stages import OnboardState, Stage
from gcs.mavlink.services.retransmission_timeout import RttEstimator
from gcs.mavlink.services.retry import RetryTimer, ns
from gcs.model import Mission, system_of


@dataclass(slots=True)
class StageState:
    """State of the present stage."""

    stage: Stage = Stage.NEW
    since_t_ns: int = 0
    request: RetryTimer | None = None
    """Request of the stage, until it is answered."""
    download: MissionDownload | None = None
    """Read-back in progress."""
    deadline_t_ns: int | None = None
    """End of the wait for a request of the vehicle, or for its ACK."""
    failure: tuple[int, str] | None = None
    """Time at which a failure counts unless the vehicle requests an item before, and its reason."""
    most_items: int = 0
    """Largest number of items that were requested or received."""
    progress_t_ns: int = 0
    """Time at which that number grew."""
    refusals: int = 0

    def note_items(self, items: int, t_ns: int) -> None:
        """Note how many items of the transfer were requested or received."""
        if items > self.most_items:
            self.most_items = items
            self.progress_t_ns = t_ns

    def is_stalled(self, max_s: float, t_ns: int) -> bool:
        """Return True if a transfer goes on without a further item."""
        is_transfer = self.download is not None or (self.stage is Stage.UPLOAD and self.request is None)
        return is_transfer and t_ns - self.progress_t_ns > ns(max_s)

    def is_exhausted(self, t_ns: int) -> bool:
        """Return True if all tries of the request, or of the read-back, are used up."""
        requests = (self.request, self.download)
        return any(one is not None and one.is_exhausted(t_ns) for one in requests)


@dataclass(slots=True)
class Transfer:
    """Transfer of the items to the vehicle."""

    sending: MissionUpload
    uploads: int = 0
    is_exhausted: bool = False
    """True after the last upload: the list is read back once more."""
    stalls: int = 0
    """Transfers and read-backs that went on without a further item."""
    first_seq: int = -1
    """Item to mark as the first to fly; -1 for none."""
    holds_last_item: bool = False
    """True if the vehicle has requested the last item of an atomic upload, which waits for a heartbeat."""
    may_be_stored: bool = False
    """True if the last item was sent: an atomic upload may have replaced the mission."""


@dataclass(slots=True)
class Verification:
    """What the vehicle stores, by its read-back."""

    onboard: OnboardState = OnboardState.OLD
    old: tuple[Item, ...] | None = None
    """Onboard mission before, by the last read-back; None if it is unknown."""
    difference: str = ""
    """Difference of the last read-back; empty if there is none."""
    same_differences: int = 0
    """Read-backs in a row with this difference."""
    is_rejected: bool = False
    """True if a mission is stored that must not be flown, though it may be whole: it reads back differently,
    the vehicle's navigator rejects it, or another service may have mixed it with its own."""


@dataclass(slots=True)
class Activation:
    """What the vehicle flies."""

    current: int | None = None
    current_before: int | None = None
    """Current item before the upload, or before the selection."""
    first_seq: int = 0
    """Item at which the mission begins; final once selected."""
    leg_t_ns: int = 0
    """Earliest time at which the vehicle began to fly to that item."""
    is_selected: bool = True
    """False while the vehicle counts items of the mission before."""
    has_no_mission: bool = False
    """True if the last MISSION_CURRENT reported no valid mission."""
    is_unflyable: bool = False
    """True if the vehicle's navigator rejects the mission."""


@dataclass(slots=True)
class Clearing:
    """Removal of the onboard mission."""

    has_begun: bool = False
    acknowledged: int = 0
    """Times that MISSION_CLEAR_ALL was acknowledged."""


@dataclass(slots=True)
class Heartbeats:
    """Heartbeats of the vehicle, which show its mode, and our LOITER commands."""

    heard_t_ns: int | None = None
    """Time of the last one; None before the first."""
    asked_t_ns: int | None = None
    """Time of the last request for one; None before the first."""
    tries: int = 0
    """Requests since the last one."""
    loiter_t_ns: int | None = None
    """Time of the last LOITER command; None before the first."""

    def is_heard(self, max_age_s: float, t_ns: int) -> bool:
        """Return True if the last heartbeat is at most so old."""
        return self.heard_t_ns is not None and t_ns - self.heard_t_ns <= ns(max_age_s)


class Flight(NamedTuple):
    """What the upload of a mission knows of its vehicle; there is none for fences and rally points."""

    profile: AutopilotProfile
    authority: ModeAuthority
    policy: UploadPolicy


@dataclass(slots=True)
class UploadState:
    """State of the upload of one list to one vehicle."""

    vehicle: int
    transfer: Transfer
    rtt: RttEstimator
    mission_id: int = 0
    autopilot: int = 0
    """MAV_AUTOPILOT; 0 for fences and rally points."""
    began_t_ns: int = 0
    told_s: float = 0.0
    """Duration at which the operator was told last what the upload waits for."""
    reason: str = ""
    """Reason of the last failure, or of the end."""
    now: StageState = field(default_factory=StageState)
    verification: Verification = field(default_factory=Verification)
    activation: Activation = field(default_factory=Activation)
    clearing: Clearing = field(default_factory=Clearing)
    heartbeats: Heartbeats = field(default_factory=Heartbeats)

    def is_silent(self, max_s: float, t_ns: int) -> bool:
        """Return True if a request has waited so long for a heartbeat."""
        since_t_ns = max(self.now.since_t_ns, self.heartbeats.heard_t_ns or 0)
        return self.now.request is not None and t_ns - since_t_ns > ns(max_s)

    @classmethod
    def of_mission(
        cls,
        mission: Mission,
        items: Sequence[Item],
        profile: AutopilotProfile = ARDUPLANE,
        *,
        old: tuple[Item, ...] | None = None,
        inconsistent: bool = False,
        current: int | None = None,
        round_trip_s: float = 0.0,
    ) -> UploadState:
        """Return the state before the begin.

        Parameters
        ----------
        items : sequence of Item
            Those of the mission (`gcs.mavlink.mission.item_builder`).
        old : tuple of Item or None
            Onboard mission by the last read-back. A failed upload may then end in "old" instead of clearing.
        inconsistent : bool
            True if an earlier upload may have left an inconsistent mission.
        round_trip_s : float
            Earlier measurement of its link; 0 for none.
        """
        to = (system_of(mission.vehicle), AUTOPILOT_COMPONENT_ID)
        onboard = OnboardState.UNKNOWN if inconsistent else OnboardState.OLD
        return cls(
            vehicle=mission.vehicle,
            transfer=Transfer(MissionUpload(tuple(items), to, in_order=profile.in_order)),
            rtt=RttEstimator(round_trip_s),
            mission_id=mission.mission_id,
            autopilot=profile.autopilot,
            verification=Verification(onboard, old),
            activation=Activation(current, current, profile.home_items),
        )
