"""Steps of a mission upload, and their common state.

`gcs.mavlink.mission.upload_task` decides which step comes when.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import ARDUPLANE, AutopilotProfile
from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.fleet.mode_authority import ModeAuthority
from gcs.mavlink.frames.codec import GCS_COMPONENT_ID, GCS_SYSTEM_ID, Message
from gcs.mavlink.mission.items import Home, Item
from gcs.mavlink.mission.list_upload import ACCEPTED, ListUpload
from gcs.mavlink.mission.upload_stages import TRANSITIONS, OnboardState, Stage, UploadResult
from gcs.mavlink.mission.upload_timing import UploadPolicy, UploadTiming
from gcs.mavlink.services.command_sender import (
    REQUEST_MESSAGE,
    SET_MODE,
    command_long,
    set_current_item,
    set_mode,
)
from gcs.mavlink.services.retry import RetryPolicy, ns
from gcs.mavlink.services.rtt import RttEstimator
from gcs.model import NS_PER_S, Mission

_MAX_PAUSE_S: Final = 4.0


class UploadSteps(ListUpload):
    """State of a mission upload, and its steps.

    Parameters
    ----------
    mission : Mission
        To be flown.
    home : Home
        Item 0 for firmwares that keep home there; the vehicle replaces it.
    encode : callable
        Message to frame for this vehicle, such as `Fleet.encoder`.
    profile : AutopilotProfile
        Of its firmware.
    authority : ModeAuthority, optional
        Shared by all tasks of a vehicle.
    old : sequence of Item, optional
        Onboard mission by the last read-back. A failed task may then end in "old" instead of clearing.
    inconsistent : bool
        True if an earlier task may have left an inconsistent mission.
    current : int, optional
        Current item.
    policy : UploadPolicy, optional
        Shared by all tasks.
    from_ground : bool
        True if the mission begins with a take-off.
    delegated : bool
        True if another program uploads: see `take_external_frames` and `add_external_result`.
    rtt : RttEstimator, optional
        Of its link.
    own : (int, int)
        Our system and component id.
    """

    transitions = TRANSITIONS

    def __init__(
        self,
        mission: Mission,
        home: Home,
        encode: Callable[[Message], bytes],
        *,
        profile: AutopilotProfile = ARDUPLANE,
        authority: ModeAuthority | None = None,
        old: Sequence[Item] | None = None,
        inconsistent: bool = False,
        current: int | None = None,
        policy: UploadPolicy | None = None,
        from_ground: bool = False,
        delegated: bool = False,
        timing: UploadTiming | None = None,
        rtt: RttEstimator | None = None,
        own: tuple[int, int] = (GCS_SYSTEM_ID, GCS_COMPONENT_ID),
    ) -> None:
        self.mission = mission
        self.items = profile.items(mission, home, from_ground=from_ground)
        super().__init__(
            mission.vehicle,
            dialect.MAV_MISSION_TYPE_MISSION,
            self.items,
            encode,
            timing or UploadTiming(),
            rtt or RttEstimator(),
            own,
            in_order=profile.in_order,
        )
        self.result: UploadResult | None = None
        self._profile = profile
        self._authority = authority or ModeAuthority()
        self._old = old
        self._policy = policy or UploadPolicy()
        self._delegated = delegated
        self._external_frames = b""
        self._began_t_ns = 0
        self._is_cleared = False
        self._was_inconsistent = inconsistent
        self._onboard = OnboardState.UNKNOWN if inconsistent else OnboardState.OLD
        self._reason = ""
        self._uploads_exhausted = False
        self._may_resume = True
        self._current = current
        self._current_before = current
        self._refusals = 0
        self.first_seq = self._start_seq = profile.home_items
        """Item at which the mission begins; final once selected."""
        self.leg_t_ns = 0
        """Earliest time at which the vehicle began to fly to that item."""
        self._is_rejected = False
        """True if a whole mission is stored that must not be flown: it reads back differently, or the
        vehicle's navigator rejects it."""
        self._has_no_mission = False
        """True if the last MISSION_CURRENT reported no valid mission."""
        self._unexplained_mode_t_ns: int | None = None
        """Time of a mode change that is either an operator's override or follows from a rejected mission."""
        self._loiter_t_ns: int | None = None
        self._selected = True

    @property
    def is_inconsistent(self) -> bool:
        """True if the onboard mission may be inconsistent now."""
        return self._onboard is OnboardState.UNKNOWN and not self._profile.atomic

    # ------------------------------------------------------------ stages

    def _enter_stage(
        self,
        stage: Stage,
        t_ns: int,
        request: Message | None = None,
        *,
        pause_s: float = 0.0,
        policy: RetryPolicy | None = None,
    ) -> None:
        super()._enter_stage(stage, t_ns, request, pause_s=pause_s, policy=policy)
        self._unexplained_mode_t_ns, self._refusals = None, 0

    def _enter_park(self, t_ns: int) -> None:
        """Command LOITER and wait for the heartbeat that shows it."""
        self._loiter_t_ns = t_ns
        self._enter_stage(Stage.PARK, t_ns, self._mode_command(LOITER), policy=self._timing.loiter_retry)

    def _start_upload(self, t_ns: int, pause_s: float = 0.0) -> None:
        self.uploads += 1
        self._mission_upload.restart()
        self._start_seq = self._begin_at() if self._profile.marks_current else -1
        if not self._delegated:
            self._enter_stage(Stage.UPLOAD, t_ns, self._mission_upload.count_message(), pause_s=pause_s)
            return
        self._enter_stage(Stage.UPLOAD, t_ns)
        self._deadline_t_ns = t_ns + ns(self._timing.external_timeout_s)
        self._note_upload_begun()
        to, items = self._to, enumerate(self.items)
        messages = (item.message(n, *to, current=n == self._start_seq) for n, item in items)
        self._external_frames = b"".join(map(self._encode, messages))

    def _note_upload_begun(self) -> None:
        """Note that the vehicle may have begun to change its onboard mission."""
        self._selected = self._profile.atomic
        if self._onboard is not OnboardState.UNKNOWN:
            self._onboard = OnboardState.UNKNOWN
            self._current_before = self._current

    def _window(self) -> int:
        return min(self._profile.window, self._policy.max_items_in_flight(self.mission.vehicle))

    def _begin_at(self) -> int:
        first = self._policy.first_item(self.mission.vehicle)
        return min(max(self._profile.home_items, first), len(self.items) - 1)

    def _is_near_next_item(self, t_ns: int) -> bool:
        return self._policy.time_to_next_s(self.mission.vehicle, t_ns) < self._timing.guard_s

    def _start_select(self, t_ns: int) -> None:
        self._current_before = self._current
        self.first_seq = self._begin_at()
        self.leg_t_ns = t_ns
        self._enter_stage(
            Stage.SELECT, t_ns, set_current_item(self.mission.vehicle, self._profile, self.first_seq)
        )

    def _start_mode(self, t_ns: int) -> None:
        if self._authority.mode != AUTO:
            self.leg_t_ns = t_ns
        self._selected = True
        if self._authority.override == LOITER and self._has_no_mission and self._profile.atomic:
            self._reject(t_ns)
        elif self._authority.override:
            self._end_overridden(t_ns)
        else:
            self._enter_stage(Stage.MODE, t_ns, self._mode_command(AUTO))

    def _end_overridden(self, t_ns: int) -> None:
        """End without a mode command: an operator has chosen a mode."""
        stored = (
            "read back equal, not started"
            if self._onboard is OnboardState.EQUAL
            else self._reason or "not begun"
        )
        self._reason = f"{stored}: {self._authority.override} was chosen meanwhile"
        self._finish(ok=False, t_ns=t_ns)

    def _reject(self, t_ns: int) -> None:
        """Note that the vehicle's navigator rejects the mission: the mode is not an override."""
        self._authority.note_rejection(t_ns)
        self._reason = "the vehicle's navigator rejects the mission (no valid mission)"
        self._is_rejected = True
        self._hold_and_clear(t_ns)

    def _resume_old_mission(self, t_ns: int) -> None:
        """End as failed. A vehicle in LOITER with a whole mission resumes it."""
        if self._loiter_t_ns is not None and self._onboard is OnboardState.OLD and self._may_resume:
            self._start_mode(t_ns)
        else:
            self._finish(ok=False, t_ns=t_ns)

    def _hold_and_clear(self, t_ns: int) -> None:
        """Remove an inconsistent or rejected mission: LOITER first, then MISSION_CLEAR_ALL."""
        if not (self.is_inconsistent or self._is_rejected):
            self._onboard = OnboardState.OLD if self._onboard is OnboardState.OLD else OnboardState.WHOLE
            self._outbox += self._cancel_messages()
            self._resume_old_mission(t_ns)
        elif self._authority.mode not in ("", AUTO):
            self._start_clear(t_ns)
        else:
            self._loiter_t_ns = t_ns
            self._enter_stage(Stage.HOLD, t_ns, self._mode_command(LOITER), policy=self._timing.loiter_retry)

    def _start_clear(self, t_ns: int) -> None:
        self._is_cleared = False
        self._enter_stage(
            Stage.CLEAR, t_ns, dialect.MAVLink_mission_clear_all_message(*self._to, self.mission_type)
        )

    def _retry_upload(self, reason: str, t_ns: int) -> None:
        """Upload again after a pause. After the last upload, read back once more, then clear."""
        self._reason = self._reason if self._uploads_exhausted else reason
        if self.uploads < self._timing.max_uploads:
            self._rtt.retransmissions += 1
            self._outbox += self._cancel_messages()
            self._start_upload(t_ns, min(_MAX_PAUSE_S, 0.25 * 2.0**self.uploads))
        elif self._uploads_exhausted or self.stage is not Stage.UPLOAD:
            self._hold_and_clear(t_ns)
        else:
            self._uploads_exhausted = True
            self._start_verify(t_ns)

    def _cancel_messages(self) -> list[Message]:
        """Return the ACK that ends a transfer early, for firmwares where MISSION_COUNT does not."""
        if not self._profile.atomic or self.stage not in (Stage.UPLOAD, Stage.VERIFY):
            return []
        return [self._ack(dialect.MAV_MISSION_OPERATION_CANCELLED)]

    def _finish(self, *, ok: bool, t_ns: int) -> None:
        self._enter_stage(Stage.DONE, t_ns)
        detail = "verified by read-back" if ok else self._reason
        if ok and self.uploads > 1:
            detail += f" after {self.uploads} uploads"
        duration_s = (t_ns - self._began_t_ns) / NS_PER_S
        held = self._loiter_t_ns is not None and (ok or self._authority.mode != AUTO)
        self.result = UploadResult(
            t_ns, ok, self._onboard, detail, duration_s, self.retries, held, self._selected
        )

    # ------------------------------------------------------------ frames

    def _request_mission_current(self) -> Message:
        """Request MISSION_CURRENT, which otherwise comes once a second."""
        return command_long(self.mission.vehicle, REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_MISSION_CURRENT)

    def _mode_command(self, name: str) -> Message:
        self._authority.note_command(name)
        return set_mode(self.mission.vehicle, self._profile.autopilot, name)

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
            out.append(command_long(self.mission.vehicle, REQUEST_MESSAGE, heartbeat))
        return out
