"""State of a mission upload, and its steps.

`gcs.mavlink.mission.upload_task` decides which step comes when.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import ARDUPLANE, AutopilotProfile, profile_of
from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.fleet.mode_authority import ModeAuthority
from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, Message
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.item_transfer import MissionUpload
from gcs.mavlink.mission.items import Home, Item
from gcs.mavlink.mission.list_upload import ACCEPTED, ListUpload, ListUploadState
from gcs.mavlink.mission.upload_limits import UploadLimits, UploadPolicy
from gcs.mavlink.mission.upload_stages import TRANSITIONS, OnboardState, Stage, UploadResult
from gcs.mavlink.services.command_sender import (
    REQUEST_MESSAGE,
    SET_MODE,
    command_long,
    set_current_item,
    set_mode,
)
from gcs.mavlink.services.retransmission_timeout import RttEstimator
from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, Mission, system_of

_MAX_PAUSE_S: Final = 4.0
_LIMITS: Final = UploadLimits()


@dataclass(slots=True, kw_only=True)
class UploadState(ListUploadState):
    """State of a mission upload to one vehicle."""

    vehicle: int
    mission_id: int
    autopilot: int
    """MAV_AUTOPILOT."""
    old: tuple[Item, ...] | None = None
    """Onboard mission by the last read-back. A failed task may then end in "old" instead of clearing."""
    was_inconsistent: bool = False
    """True if an earlier task may have left an inconsistent mission."""
    current: int | None = None
    """Current item."""
    current_before: int | None = None
    """Current item before the upload, or before the selection."""
    is_delegated: bool = False
    """True if another program uploads: see `take_external_frames` and `add_external_result`."""
    began_t_ns: int = 0
    is_cleared: bool = False
    """True if the vehicle has acknowledged the clearing, which is read back then."""
    onboard: OnboardState = OnboardState.OLD
    """Onboard mission as far as known."""
    reason: str = ""
    """Reason of the last failure."""
    uploads_exhausted: bool = False
    """True after the last upload: the mission is read back once more."""
    may_resume: bool = True
    """True if a vehicle in LOITER may resume its old mission."""
    refusals: int = 0
    """Refusals of the stage's command."""
    first_seq: int = 0
    """Item at which the mission begins; final once selected."""
    leg_t_ns: int = 0
    """Earliest time at which the vehicle began to fly to that item."""
    is_rejected: bool = False
    """True if a whole mission is stored that must not be flown: it reads back differently, or the vehicle's
    navigator rejects it."""
    has_no_mission: bool = False
    """True if the last MISSION_CURRENT reported no valid mission."""
    unexplained_mode_t_ns: int | None = None
    """Time of a mode change that is either an operator's override or follows from a rejected mission."""
    loiter_t_ns: int | None = None
    """Time of the last LOITER command; None before the first."""
    is_selected: bool = True
    """False while the vehicle counts items of the mission before."""

    @classmethod
    def initial(
        cls,
        mission: Mission,
        home: Home,
        profile: AutopilotProfile = ARDUPLANE,
        *,
        old: tuple[Item, ...] | None = None,
        inconsistent: bool = False,
        current: int | None = None,
        from_ground: bool = False,
        delegated: bool = False,
        round_trip_s: float = 0.0,
    ) -> UploadState:
        """Return the state before the begin.

        Parameters
        ----------
        home : Home
            Item 0 for firmwares that keep home there; the vehicle replaces it.
        from_ground : bool
            True if the mission begins with a take-off.
        round_trip_s : float
            Earlier measurement of its link; 0 for none.
        """
        items = build_items(profile, mission, home, from_ground=from_ground)
        to = (system_of(mission.vehicle), AUTOPILOT_COMPONENT_ID)
        return cls(
            sending=MissionUpload(items, to, in_order=profile.in_order),
            rtt=RttEstimator(round_trip_s),
            start_seq=profile.home_items,
            vehicle=mission.vehicle,
            mission_id=mission.mission_id,
            autopilot=profile.autopilot,
            old=old,
            was_inconsistent=inconsistent,
            current=current,
            current_before=current,
            is_delegated=delegated,
            onboard=OnboardState.UNKNOWN if inconsistent else OnboardState.OLD,
            first_seq=profile.home_items,
        )


class UploadSteps(ListUpload):
    """Steps of a mission upload.

    Parameters
    ----------
    encode : callable
        Message to frame for this vehicle, such as `Fleet.encoder`.
    authority : ModeAuthority
        Of this vehicle.
    policy : UploadPolicy
        Shared by all uploads.
    limits : UploadLimits, optional
        By default that for the link's round trip.
    """

    transitions = TRANSITIONS
    state: UploadState

    def __init__(
        self,
        state: UploadState,
        encode: Callable[[Message], bytes],
        authority: ModeAuthority,
        policy: UploadPolicy,
        limits: UploadLimits | None = None,
    ) -> None:
        super().__init__(state, encode, limits or _LIMITS.for_round_trip(state.rtt.earlier_s))
        profile = profile_of(state.autopilot)
        assert profile is not None  # it had one at the begin
        self.result: UploadResult | None = None
        self._profile, self._authority, self._policy = profile, authority, policy
        self._external_frames = b""

    @property
    def is_inconsistent(self) -> bool:
        """True if the onboard mission may be inconsistent now."""
        return self.state.onboard is OnboardState.UNKNOWN and not self._profile.atomic

    # ------------------------------------------------------------ stages

    def _set_stage(self, stage: Stage) -> None:
        super()._set_stage(stage)
        self.state.unexplained_mode_t_ns, self.state.refusals = None, 0

    def _enter_park(self, t_ns: int) -> None:
        """Command LOITER and wait for the heartbeat that shows it."""
        self.state.loiter_t_ns = t_ns
        self._enter_stage(Stage.PARK, t_ns, self._mode_command(LOITER), policy=self._limits.loiter_retry)

    def _start_upload(self, t_ns: int, pause_s: float = 0.0) -> None:
        self.state.uploads += 1
        self.state.sending.restart()
        self.state.start_seq = self._begin_at() if self._profile.marks_current else -1
        if not self.state.is_delegated:
            self._enter_stage(Stage.UPLOAD, t_ns, self.state.sending.count_message(), pause_s=pause_s)
            return
        self._enter_stage(Stage.UPLOAD, t_ns)
        self.state.deadline_t_ns = t_ns + ns(self._limits.external_timeout_s)
        self._note_upload_begun()
        to, items = self._to, enumerate(self.items)
        messages = (item.message(n, *to, current=n == self.state.start_seq) for n, item in items)
        self._external_frames = b"".join(map(self._encode, messages))

    def _note_upload_begun(self) -> None:
        """Note that the vehicle may have begun to change its onboard mission."""
        self.state.is_selected = self._profile.atomic
        if self.state.onboard is not OnboardState.UNKNOWN:
            self.state.onboard = OnboardState.UNKNOWN
            self.state.current_before = self.state.current

    def _window(self) -> int:
        return min(self._profile.window, self._policy.max_items_in_flight(self.state.vehicle))

    def _begin_at(self) -> int:
        first = self._policy.first_item(self.state.vehicle)
        return min(max(self._profile.home_items, first), len(self.items) - 1)

    def _is_near_next_item(self, t_ns: int) -> bool:
        return self._policy.time_to_next_s(self.state.vehicle, t_ns) < self._limits.guard_s

    def _start_select(self, t_ns: int) -> None:
        self.state.current_before = self.state.current
        self.state.first_seq = self._begin_at()
        self.state.leg_t_ns = t_ns
        self._enter_stage(
            Stage.SELECT, t_ns, set_current_item(self.state.vehicle, self._profile, self.state.first_seq)
        )

    def _start_mode(self, t_ns: int) -> None:
        if self._authority.mode != AUTO:
            self.state.leg_t_ns = t_ns
        self.state.is_selected = True
        if self._authority.override == LOITER and self.state.has_no_mission and self._profile.atomic:
            self._reject(t_ns)
        elif self._authority.override:
            self._end_overridden(t_ns)
        else:
            self._enter_stage(Stage.MODE, t_ns, self._mode_command(AUTO))

    def _end_overridden(self, t_ns: int) -> None:
        """End without a mode command: an operator has chosen a mode."""
        stored = (
            "read back equal, not started"
            if self.state.onboard is OnboardState.EQUAL
            else self.state.reason or "not begun"
        )
        self.state.reason = f"{stored}: {self._authority.override} was chosen meanwhile"
        self._finish(ok=False, t_ns=t_ns)

    def _reject(self, t_ns: int) -> None:
        """Note that the vehicle's navigator rejects the mission: the mode is not an override."""
        self._authority.note_rejection(t_ns)
        self.state.reason = "the vehicle's navigator rejects the mission (no valid mission)"
        self.state.is_rejected = True
        self._hold_and_clear(t_ns)

    def _resume_old_mission(self, t_ns: int) -> None:
        """End as failed. A vehicle in LOITER with a whole mission resumes it."""
        if (
            self.state.loiter_t_ns is not None
            and self.state.onboard is OnboardState.OLD
            and self.state.may_resume
        ):
            self._start_mode(t_ns)
        else:
            self._finish(ok=False, t_ns=t_ns)

    def _hold_and_clear(self, t_ns: int) -> None:
        """Remove an inconsistent or rejected mission: LOITER first, then MISSION_CLEAR_ALL."""
        if not (self.is_inconsistent or self.state.is_rejected):
            self.state.onboard = (
                OnboardState.OLD if self.state.onboard is OnboardState.OLD else OnboardState.WHOLE
            )
            self._outbox += self._cancel_messages()
            self._resume_old_mission(t_ns)
        elif self._authority.mode not in ("", AUTO):
            self._start_clear(t_ns)
        else:
            self.state.loiter_t_ns = t_ns
            self._enter_stage(Stage.HOLD, t_ns, self._mode_command(LOITER), policy=self._limits.loiter_retry)

    def _start_clear(self, t_ns: int) -> None:
        self.state.is_cleared = False
        self._enter_stage(
            Stage.CLEAR, t_ns, dialect.MAVLink_mission_clear_all_message(*self._to, self.mission_type)
        )

    def _retry_upload(self, reason: str, t_ns: int) -> None:
        """Upload again after a pause. After the last upload, read back once more, then clear."""
        self.state.reason = self.state.reason if self.state.uploads_exhausted else reason
        if self.state.uploads < self._limits.max_uploads:
            self.state.rtt.retransmissions += 1
            self._outbox += self._cancel_messages()
            self._start_upload(t_ns, min(_MAX_PAUSE_S, 0.25 * 2.0**self.state.uploads))
        elif self.state.uploads_exhausted or self.stage is not Stage.UPLOAD:
            self._hold_and_clear(t_ns)
        else:
            self.state.uploads_exhausted = True
            self._start_verify(t_ns)

    def _cancel_messages(self) -> list[Message]:
        """Return the ACK that ends a transfer early, for firmwares where MISSION_COUNT does not."""
        if not self._profile.atomic or self.stage not in (Stage.UPLOAD, Stage.VERIFY):
            return []
        return [self._ack(dialect.MAV_MISSION_OPERATION_CANCELLED)]

    def _finish(self, *, ok: bool, t_ns: int) -> None:
        self._enter_stage(Stage.DONE, t_ns)
        detail = "verified by read-back" if ok else self.state.reason
        if ok and self.state.uploads > 1:
            detail += f" after {self.state.uploads} uploads"
        duration_s = (t_ns - self.state.began_t_ns) / NS_PER_S
        held = self.state.loiter_t_ns is not None and (ok or self._authority.mode != AUTO)
        self.result = UploadResult(
            t_ns, ok, self.state.onboard, detail, duration_s, self.retries, held, self.state.is_selected
        )

    # ------------------------------------------------------------ frames

    def _request_mission_current(self) -> Message:
        """Request MISSION_CURRENT, which otherwise comes once a second."""
        return command_long(self.state.vehicle, REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_MISSION_CURRENT)

    def _mode_command(self, name: str) -> Message:
        self._authority.note_command(name)
        return set_mode(self.state.vehicle, self._profile.autopilot, name)

    def _request_messages(self, request: Message, copies: int) -> list[Message]:
        messages = super()._request_messages(request, copies)
        if self.stage is Stage.UPLOAD:
            self._note_upload_begun()
        if self.stage is Stage.SELECT:
            messages += [self._request_mission_current()] * copies
            if self._profile.atomic:  # Without it PX4 ignores the selection for 5 s.
                messages.insert(0, self._ack(ACCEPTED))
        return messages

    def _due_messages(self, t_ns: int) -> list[Message]:
        out = super()._due_messages(t_ns)
        if any(message.get_type() == "COMMAND_LONG" and message.command == SET_MODE for message in out):
            heartbeat = dialect.MAVLINK_MSG_ID_HEARTBEAT  # Shows the mode; otherwise once a second.
            out.append(command_long(self.state.vehicle, REQUEST_MESSAGE, heartbeat))
        return out
