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
_MODE_GROWTH: Final = 1.3
_MAX_MODE_WAIT_S: Final = 1.0
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
    is_unflyable: bool = False
    """True if the vehicle's navigator rejects the mission."""
    has_no_mission: bool = False
    """True if the last MISSION_CURRENT reported no valid mission."""
    unexplained_mode_t_ns: int | None = None
    """Time of a mode change that is either an operator's override or follows from a rejected mission."""
    loiter_t_ns: int | None = None
    """Time of the last LOITER command; None before the first."""
    mode_t_ns: int | None = None
    """Time of the last heartbeat; None before the first."""
    mode_asked_t_ns: int | None = None
    """Time of the last request for a heartbeat; None before the first."""
    mode_tries: int = 0
    """Requests since the last heartbeat."""
    waits_for_mode: bool = False
    """True if the vehicle has requested the last item of an atomic upload, which waits for a heartbeat."""
    stalls: int = 0
    """Transfers that went on without a further item."""
    difference: str = ""
    """Difference of the last read-back; empty if there was none."""
    same_differences: int = 0
    """Read-backs in a row with this difference."""
    has_tried_clearing: bool = False
    """True after the begin of a clearing."""
    clearings: int = 0
    """Clearings that were acknowledged."""
    told_s: float = 0.0
    """Duration at which the operator was told last what the upload waits for."""
    may_be_stored: bool = False
    """True if an atomic upload may have replaced the mission: its last item was sent."""
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

    @property
    def is_inconsistent(self) -> bool:
        """True if the onboard mission may be inconsistent now."""
        return self.state.onboard is OnboardState.UNKNOWN and not self._profile.atomic

    @property
    def is_unselected(self) -> bool:
        """True if the new mission is stored, and AUTO would continue it at the old item's number."""
        return self.state.onboard is OnboardState.EQUAL and not self.state.is_selected

    # ------------------------------------------------------------ stages

    def _set_stage(self, stage: Stage) -> None:
        super()._set_stage(stage)
        self.state.unexplained_mode_t_ns, self.state.refusals = None, 0

    # ------------------------------------------------------------ the vehicle's mode

    def _has_heard_mode(self, max_age_s: float, t_ns: int) -> bool:
        heard_t_ns = self.state.mode_t_ns
        return heard_t_ns is not None and t_ns - heard_t_ns <= ns(max_age_s)

    def _may_send(self, t_ns: int) -> bool:
        """Return True unless the request of the stage, or the last item of an atomic upload, has to wait.

        What steers is sent only right after a heartbeat: the mode may have changed since the one before.
        """
        limits, timer = self._limits, self.state.timer
        is_recent = self._has_heard_mode(limits.max_mode_age_s, t_ns)
        match self.stage:
            case Stage.VERIFY:
                return True
            case Stage.HOLD:
                return self._has_heard_mode(limits.max_hold_age_s, t_ns)
            case Stage.UPLOAD:
                return is_recent or (timer is None and not self._is_last_requested())
            case Stage.CLEAR:
                return is_recent
        last_t_ns = self.state.stage_t_ns - 1 if timer is None or not timer.sent else timer.sent_t_ns
        return is_recent and (self.state.mode_t_ns or 0) > last_t_ns

    def _is_last_requested(self) -> bool:
        """Return True if the next item would replace the onboard mission."""
        is_last = self.state.sending.requested_seq == len(self.items) - 1
        return self._profile.atomic and (self.state.waits_for_mode or is_last)

    def _is_unanswered(self, t_ns: int) -> bool:
        since_t_ns = max(self.state.stage_t_ns, self.state.mode_t_ns or 0)
        is_unheard = self.state.timer is not None and t_ns - since_t_ns > ns(self._limits.min_answer_s)
        return is_unheard or super()._is_unanswered(t_ns)

    def _mode_requests(self, t_ns: int) -> list[Message]:
        """Return the requests for a heartbeat that are due."""
        asked_t_ns, rtt = self.state.mode_asked_t_ns, self.state.rtt
        if self._may_send(t_ns):
            asked_t_ns = max(asked_t_ns or 0, self.state.mode_t_ns or 0)
            wait_s, copies = self._limits.mode_period_s, 1
        else:
            grown_s = rtt.wait_s * _MODE_GROWTH ** max(0, self.state.mode_tries - 1)
            wait_s, copies = min(grown_s, _MAX_MODE_WAIT_S), rtt.copies
        if self.stage is Stage.DONE or (asked_t_ns is not None and t_ns - asked_t_ns < ns(wait_s)):
            return []
        return [self._request_mode(t_ns)] * copies

    def _request_mode(self, t_ns: int) -> Message:
        """Request a heartbeat: it shows the mode, otherwise once a second."""
        self.state.mode_asked_t_ns = t_ns
        self.state.mode_tries += 1
        return command_long(self.state.vehicle, REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_HEARTBEAT)

    def _on_override(self, t_ns: int) -> None:
        """Stop: nothing that steers may be sent any more.

        A PX4 is in Hold also when its navigator rejects the mission, which MISSION_CURRENT shows soon.
        """
        if not self._may_be_rejection():
            self._end_overridden(t_ns)
        elif self.state.unexplained_mode_t_ns is None:
            self.state.unexplained_mode_t_ns = t_ns
            self.state.timer = self.state.download = None
            self.state.deadline_t_ns = self.state.pending_failure = None
            self._outbox.append(self._request_mission_current())
        elif t_ns - self.state.unexplained_mode_t_ns > ns(self._limits.rejection_s):
            self._end_overridden(t_ns)

    def _may_be_rejection(self) -> bool:
        is_stored = self._profile.atomic and self.state.may_be_stored and self.stage is not Stage.PARK
        return is_stored and self._authority.taken_by == LOITER and not self._authority.record.in_failsafe

    # ------------------------------------------------------------ steps

    def _enter_park(self, t_ns: int) -> None:
        """Command LOITER and wait for the heartbeat that shows it."""
        self.state.loiter_t_ns = t_ns
        self._enter_stage(Stage.PARK, t_ns, self._mode_command(LOITER), policy=self._limits.loiter_retry)

    def _start_upload(self, t_ns: int, pause_s: float = 0.0) -> None:
        self.state.uploads += 1
        self.state.sending.restart()
        self.state.start_seq = self._begin_at() if self._profile.marks_current else -1
        self._enter_stage(Stage.UPLOAD, t_ns, self.state.sending.count_message(), pause_s=pause_s)

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

    def _is_answered_at_once(self) -> bool:
        """Return False for the selection on a PX4, which shows its current item at 1 Hz only."""
        return not (self.stage is Stage.SELECT and self._profile.atomic)

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
        if self.state.has_no_mission and self._profile.atomic:
            self._reject(t_ns)
        else:
            self._enter_stage(Stage.MODE, t_ns, self._mode_command(AUTO))

    def _end_overridden(self, t_ns: int) -> None:
        """End at once: a mode was chosen or commanded. Only a PX4 is told, so that its old mission stays."""
        self._outbox = self._cancel_messages()
        if self._profile.atomic and self.state.onboard is OnboardState.UNKNOWN:
            self.state.onboard = OnboardState.WHOLE if self.state.may_be_stored else OnboardState.OLD
        if self.is_inconsistent:
            stored = "its onboard mission may be inconsistent; do not choose AUTO before it is repaired"
        elif self.state.onboard is not OnboardState.EQUAL:
            stored = "its upload is stopped, and it keeps its mission"
            if self.state.onboard is not OnboardState.OLD:
                stored = "its upload is stopped; the old or the new mission is stored"
        elif self.state.is_selected:
            stored = "read back equal, not started"
        else:
            stored = "read back equal, its first item not selected; do not choose AUTO before it is repaired"
        self.state.reason = f"{self._authority.takeover}: {stored}"
        self._finish(ok=False, t_ns=t_ns)

    def _reject(self, t_ns: int) -> None:
        """Note that the vehicle's navigator rejects the mission: the mode is not an override."""
        self._authority.note_rejection(t_ns)
        self.state.reason = "the vehicle's navigator rejects the mission"
        self.state.is_rejected = self.state.is_unflyable = True
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
        self.state.is_cleared, self.state.has_tried_clearing = False, True
        pause_s = 0.5 * 2.0**self.state.clearings if self.state.clearings else 0.0
        request = dialect.MAVLink_mission_clear_all_message(*self._to, self.mission_type)
        self._enter_stage(Stage.CLEAR, t_ns, request, pause_s=pause_s)

    def _disobeys(self, reason: str, t_ns: int) -> None:
        """End the uploads: more of them would not help."""
        self.state.reason = f"{reason}: the vehicle does not obey"
        self._hold_and_clear(t_ns)

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
        if self.state.unexplained_mode_t_ns is not None:
            out, self._outbox = self._outbox, []
            return out
        out = super()._due_messages(t_ns)
        if any(message.get_type() == "COMMAND_LONG" and message.command == SET_MODE for message in out):
            out.append(self._request_mode(t_ns))
        return out + self._mode_requests(t_ns)
