"""Mission upload to one vehicle: upload, download, compare, select, start. Sans-I/O.

Sources: https://mavlink.io/en/services/mission.html, ArduPilot's `MissionItemProtocol`, PX4's
`mavlink_mission`. `gcs.mavlink.autopilots` holds what differs between them. Stages and transitions:
`gcs.mavlink.mission.upload_stages`. Rules:

* An ArduPlane upload is in place. From MISSION_COUNT to the last item the onboard mission is inconsistent.
  The read-back shows the stored mission, also after a lost ACK. A PX4 upload is atomic: the onboard mission
  is always whole, and hold and clear are not needed.
* Over an inconsistent mission the vehicle may stay in AUTO while it flies its cached waypoint. It must not
  take the next item. When that is nearer than `UploadLimits.guard_s` it gets LOITER ("park" before the
  upload, or during it), and AUTO after verification. The same holds between verification and selection: the
  old item number may be beyond the end of the new mission, and the vehicle would return to launch.
* After the last retry: LOITER, then MISSION_CLEAR_ALL (refused in AUTO), then a check.
* What steers waits for a heartbeat, which is requested: a selection or a mode sent after a pilot or a
  failsafe has chosen a mode would undo it. On an override (`gcs.mavlink.fleet.mode_authority`) the upload
  ends at once. A PX4 is told by MISSION_ACK 15 and keeps its old mission. An ArduPlane's mission may then be
  inconsistent: `gcs.core.tasking` repairs it when the vehicle is ours again.
* ACK 13 answers a duplicate and is never final.
* Messages are filtered by vehicle, by our ids and by mission type: other ground stations share the link.

The task never arms, and never sends a mission message without a target.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.frames.codec import Message, is_for
from gcs.mavlink.mission.items import Item
from gcs.mavlink.mission.list_upload import ACCEPTED, result_name
from gcs.mavlink.mission.upload_stages import OnboardState, Stage, TransitionError
from gcs.mavlink.mission.upload_steps import UploadSteps
from gcs.mavlink.services.command_sender import SET_MODE
from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, Parameter, UploadReport


class UploadTask(UploadSteps):
    """Upload of one mission to one vehicle. Parameters: see `UploadSteps`."""

    # ------------------------------------------------------------ the caller's side

    def start(self, t_ns: int) -> list[bytes]:
        """Start the upload; return the frames to send."""
        self.state.began_t_ns = t_ns
        flies = self._authority.mode in ("", AUTO)
        if flies and not self._profile.atomic and self._is_near_next_item(t_ns):
            self._enter_park(t_ns)
        else:
            self._start_upload(t_ns)
        return self._take_due_frames(t_ns)

    def start_clearing(self, t_ns: int) -> list[bytes]:
        """Start without an upload: remove a possibly inconsistent mission."""
        self.state.began_t_ns = t_ns
        self.state.reason = "the onboard mission may be inconsistent"
        self._hold_and_clear(t_ns)
        return self._take_due_frames(t_ns)

    def poll(self, t_ns: int) -> list[bytes]:
        """Advance the timers; return the frames to send."""
        if self.stage in (Stage.NEW, Stage.DONE):
            return []
        if self._is_stopped(t_ns):
            return self._take_due_frames(t_ns)
        self._guard_next_item(t_ns)
        transferring = self.stage in (Stage.UPLOAD, Stage.VERIFY)
        if transferring and t_ns - self.state.began_t_ns > ns(self._limits.transfer_timeout_s):
            before = self.state.reason or self.stage
            self.state.reason = f"no end after {self._limits.transfer_timeout_s:.0f} s: {before}"
            self._hold_and_clear(t_ns)
        else:
            self._run_timers(t_ns)
        return self._take_due_frames(t_ns)

    def _is_stopped(self, t_ns: int) -> bool:
        """Stop, or wait for the cause of an unexplained mode; return True if nothing else is to be done."""
        if self._authority.taken_by:
            self._on_override(t_ns)
            return True
        if self.state.unexplained_mode_t_ns is not None:
            self._start_verify(t_ns)  # it is ours again
        return False

    def restart(self, t_ns: int) -> list[bytes]:
        """Start again after a reboot of the vehicle: its onboard mission and mode are unknown."""
        if self.stage in (Stage.NEW, Stage.DONE):
            return []
        self.state.current = self.state.mode_t_ns = None
        if self.stage in (Stage.HOLD, Stage.CLEAR):
            self._hold_and_clear(t_ns)
        elif self.stage is Stage.PARK:
            self.state.reason = "the vehicle rebooted"
            self._finish(ok=False, t_ns=t_ns)
        else:
            self._retry_upload("the vehicle rebooted", t_ns)
        return self._take_due_frames(t_ns)

    def resume(self, t_ns: int) -> list[bytes]:
        """Continue after an outage of the service, which counts for no timeout.

        The onboard mission is read back first: the upload may have gone on after the state was saved, and the
        vehicle may have flown on since its first item was selected. Its mode is waited for.
        """
        self.state.began_t_ns, self.state.mode_t_ns = t_ns, None
        if self.stage in (Stage.UPLOAD, Stage.VERIFY, Stage.SELECT, Stage.MODE):
            self._start_verify(t_ns)
        return self._take_due_frames(t_ns)

    def abandon(self, reason: str, t_ns: int, *, mode: str = LOITER) -> list[bytes]:
        """Stop the upload for an order to another mode.

        For LOITER the vehicle keeps a whole mission, or holds and is cleared. For any other mode nothing is
        sent that could undo it. Nothing is started here.
        """
        self.state.may_resume = False
        if mode != LOITER:
            self._outbox += self._cancel_messages()
            self.state.reason = reason
            if self.stage is not Stage.DONE:
                self._finish(ok=False, t_ns=t_ns)
            return self._take_due_frames(t_ns)
        if self.stage in (Stage.UPLOAD, Stage.VERIFY):
            self.state.reason = reason
            self._hold_and_clear(t_ns)
        elif self.stage in (Stage.NEW, Stage.PARK, Stage.SELECT, Stage.MODE):
            self.state.reason = reason
            self._finish(ok=False, t_ns=t_ns)
        return self._take_due_frames(t_ns)

    def supersede(self, t_ns: int) -> list[bytes]:
        """End at once for another task; return the frames to send before it."""
        if self.stage is not Stage.DONE:
            self._outbox += self._cancel_messages()
            self.state.reason = "superseded"
            self._finish(ok=False, t_ns=t_ns)
        return self._take_due_frames(t_ns)

    def end_after_error(self, error: TransitionError, t_ns: int) -> list[bytes]:
        """End at once after a programming error; return the frames to send.

        After the begin of an upload the onboard mission counts as unknown, whatever was verified.
        """
        self._outbox.clear()
        if self.stage is Stage.DONE:
            return []
        self.state.onboard = OnboardState.UNKNOWN if self.state.uploads else self.state.onboard
        self.state.reason = f"program error in its upload ({error})"
        self._outbox += self._cancel_messages()
        self._finish(ok=False, t_ns=t_ns)
        return self._take_due_frames(t_ns)

    def report(self) -> UploadReport:
        """Return the result as an `UploadReport`.

        Raises
        ------
        ValueError
            The task has not ended.
        """
        if self.result is None:
            raise ValueError("the task has not ended")
        end = self.result
        return UploadReport(
            t_ns=end.t_ns,
            vehicle=self.state.vehicle,
            mission_id=self.state.mission_id,
            items=len(self.items),
            ok=end.ok,
            detail=end.detail,
            duration_s=end.duration_s,
            retries=end.retries,
        )

    # ------------------------------------------------------------ time

    def _on_upload_timeout(self, t_ns: int) -> None:
        if self.state.sending.is_all_sent:
            self._start_verify(t_ns)
        else:
            self._retry_upload(f"no request for item {self.state.sending.sent_count}", t_ns)

    def _on_tries_exhausted(self, t_ns: int) -> None:
        match self.stage:
            case Stage.PARK:
                unchanged = ", so nothing was changed" if self.state.onboard is OnboardState.OLD else ""
                self.state.reason = f"LOITER was not confirmed{unchanged}"
                self._finish(ok=False, t_ns=t_ns)
            case Stage.UPLOAD | Stage.VERIFY if self._is_stalled(t_ns):
                self._on_stall(t_ns)
            case Stage.UPLOAD:
                heard = self._has_heard_mode(self._limits.min_answer_s, t_ns)
                self.state.reason = "no answer to MISSION_COUNT" if heard else "no heartbeat of the vehicle"
                self._hold_and_clear(t_ns)
            case Stage.VERIFY:
                self._retry_upload("no answer to the read-back", t_ns)
            case Stage.SELECT:
                self.state.reason = "the first item could not be selected"
                self._finish(ok=False, t_ns=t_ns)
            case Stage.MODE:
                self.state.reason = self.state.reason or "AUTO was not confirmed"
                self._finish(ok=False, t_ns=t_ns)
            case Stage.HOLD:
                self.state.reason += "; LOITER was not confirmed"
                self._start_clear(t_ns)
            case Stage.CLEAR:
                self.state.reason += "; the clearing was not confirmed"
                self._finish(ok=False, t_ns=t_ns)

    def _on_stall(self, t_ns: int) -> None:
        """Upload again after the first transfer without progress; end after the last."""
        self.state.stalls += 1
        what, items = "its read-back goes on", self.state.most_items
        if self.stage is Stage.UPLOAD:
            what = "it requests items again and again"
        what += f" at {items} of {len(self.items)} items"
        reason = f"{what} for {self._limits.stall_s:.0f} s"
        if self.state.stalls < self._limits.max_stalls:
            self._retry_upload(reason, t_ns)
        else:
            self._disobeys(reason, t_ns)

    def slowness(self, t_ns: int) -> dict[str, Parameter]:
        """Return what an upload waits for, once it takes long, at growing intervals; else nothing.

        These are the parameters of `NoticeCode.UPLOAD_SLOW`.
        """
        took_s = (t_ns - self.state.began_t_ns) / NS_PER_S
        if self.stage is Stage.DONE or took_s < max(self._limits.slow_s, 3.0 * self.state.told_s):
            return {}
        self.state.told_s, items = took_s, len(self.items)
        waits_for = {
            Stage.PARK: "LOITER",
            Stage.UPLOAD: f"{self.state.most_items} of {items} items requested",
            Stage.VERIFY: f"{self.state.most_items} of {items} items read back",
            Stage.SELECT: "the selection of its first item",
            Stage.MODE: "AUTO",
            Stage.HOLD: "LOITER, to clear its mission",
            Stage.CLEAR: "the clearing of its mission",
        }.get(self.stage, self.stage)
        heard = self._has_heard_mode(self._limits.slow_s, t_ns)
        silence = "" if heard else ", no heartbeat heard"
        return {"took_s": took_s, "waits_for": f"{waits_for}{silence}", "before": self.state.reason}

    def _guard_next_item(self, t_ns: int) -> None:
        """Command LOITER before the vehicle flies to the next item of the wrong mission."""
        is_inconsistent = self.is_inconsistent and self.stage in (
            Stage.UPLOAD,
            Stage.VERIFY,
            Stage.CLEAR,
        )
        unselected = self.stage is Stage.SELECT and not self.state.is_selected
        if not (is_inconsistent or unselected) or self._authority.mode != AUTO:
            return
        near = self._is_near_next_item(t_ns)
        if unselected:
            if near:
                self._enter_park(t_ns)
            return
        moved_on = self.state.current is not None and self.state.current != self.state.current_before
        again = self.state.loiter_t_ns is None or t_ns - self.state.loiter_t_ns >= ns(
            self._limits.loiter_repeat_s
        )
        again = again and self._has_heard_mode(self._limits.max_hold_age_s, t_ns)
        if (near or moved_on or self.state.loiter_t_ns is not None) and again:
            self.state.loiter_t_ns = t_ns
            self._outbox.append(self._mode_command(LOITER))

    # ------------------------------------------------------------ messages of the vehicle

    def _handle(self, message: Message, t_ns: int) -> bool:
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self.state.mode_t_ns, self.state.mode_tries = t_ns, 0
            at_end = self._is_at_mission_end()
            self._authority.observe_heartbeat(message, self._profile, t_ns, at_end=at_end)
        is_explained = kind == "MISSION_CURRENT" and self.state.unexplained_mode_t_ns is not None
        if not is_explained and self._is_stopped(t_ns):
            return True
        match kind:
            case "MISSION_CURRENT":
                self._on_current(message, t_ns)
            case "COMMAND_ACK":
                self._on_command_ack(message, t_ns)
            case "HEARTBEAT":
                self._on_mode(t_ns)
            case _:
                return super()._handle(message, t_ns)
        return True

    def _on_request(self, message: Message, t_ns: int) -> None:
        is_last = self._profile.atomic and message.seq == len(self.items) - 1
        self.state.waits_for_mode = is_last and self.stage is Stage.UPLOAD
        if is_last and not self._may_send(t_ns):
            self.state.deadline_t_ns = t_ns + ns(self._limits.request_timeout_s)
            return
        super()._on_request(message, t_ns)
        self.state.waits_for_mode = False
        self.state.may_be_stored |= self.state.sending.is_all_sent
        asks_late = t_ns - self.state.stage_t_ns > ns(self._limits.settle_s)
        if asks_late and self.stage in (Stage.VERIFY, Stage.SELECT, Stage.MODE):
            self._retry_upload("the vehicle requests items again", t_ns)

    def _on_ack(self, message: Message, t_ns: int) -> None:
        if self.stage is Stage.CLEAR:
            if message.type == ACCEPTED and not self.state.is_cleared and not self._is_pausing():
                self.state.is_cleared = True
                self.state.clearings += 1
                self._start_download(t_ns)
        else:
            super()._on_ack(message, t_ns)

    def _on_refusal(self, message: Message, t_ns: int) -> None:
        answer, sent = result_name("MAV_MISSION_RESULT", message.type), self.state.sending.sent_count
        self._note_failure(f"the vehicle answered {answer}, {sent} of {len(self.items)} items sent", t_ns)

    def _on_count(self, message: Message, t_ns: int) -> None:
        if self.stage is not Stage.CLEAR or not self.state.is_cleared:
            super()._on_count(message, t_ns)
        elif message.count <= self._profile.home_items:
            self.state.onboard = OnboardState.CLEARED
            if self._profile.atomic:  # Without it PX4 accepts no upload for 5 s.
                self._outbox.append(self._ack(ACCEPTED))
            self._finish(ok=False, t_ns=t_ns)
        elif self.state.clearings < self._limits.max_clearings:
            self._start_clear(t_ns)
        else:
            left = message.count - self._profile.home_items
            self.state.reason += f"; {left} items left by {self.state.clearings} acknowledged clearings: "
            self.state.reason += "the vehicle does not obey"
            self._finish(ok=False, t_ns=t_ns)

    def _on_read_back(self, items: Sequence[Item], t_ns: int) -> None:
        difference = self._profile.difference(self.items, items)
        is_old = self.state.old is not None and not self._profile.difference(self.state.old, items)
        self.state.is_rejected = bool(difference) and not is_old
        if not difference:
            self.state.onboard = OnboardState.EQUAL
            if self.state.loiter_t_ns is not None and self._authority.mode == AUTO:
                self._enter_park(t_ns)
            else:
                self._start_select(t_ns)
        elif self.state.uploads_exhausted and is_old:
            self.state.onboard = OnboardState.OLD
            self._resume_old_mission(t_ns)
        else:
            self._on_difference(difference, t_ns)

    def _on_difference(self, difference: str, t_ns: int) -> None:
        """Upload again, unless the same difference shows that more uploads would not help."""
        is_same = difference == self.state.difference
        self.state.same_differences = self.state.same_differences + 1 if is_same else 1
        self.state.difference = difference
        reason = f"read-back differs: {difference}"
        if self.state.same_differences < self._limits.max_same_differences:
            self._retry_upload(reason, t_ns)
        else:
            self._disobeys(f"{reason}, {self.state.same_differences} times", t_ns)

    def _on_current(self, message: Message, t_ns: int) -> None:
        self.state.has_no_mission = message.mission_state == dialect.MISSION_STATE_NO_MISSION
        if self.state.current_before is None:
            self.state.current_before = message.seq
        is_echo = self.stage is Stage.SELECT and self.state.first_seq == self._profile.home_items
        is_echo = is_echo and message.seq == 0 != self.state.current_before
        self.state.current = self.state.first_seq if is_echo else message.seq
        if self.state.unexplained_mode_t_ns is not None:
            if self.state.has_no_mission:
                self._reject(t_ns)
            elif t_ns - self.state.unexplained_mode_t_ns > ns(self._limits.settle_s):
                self._end_overridden(t_ns)
        elif (
            self.stage is Stage.SELECT
            and self.state.current == self.state.first_seq
            and self._is_selection_answer(message.seq, t_ns)
        ):
            self._start_mode(t_ns)

    def _is_selection_answer(self, seq: int, t_ns: int) -> bool:
        """Return True if a MISSION_CURRENT with the first item's number answers its selection.

        The vehicle may have flown to an item of this number before. With atomic uploads it has begun the new
        mission there already.
        """
        is_late = t_ns - self.state.stage_t_ns > ns(self._limits.settle_s)
        return self._profile.atomic or seq != self.state.current_before or is_late

    def _on_command_ack(self, message: Message, t_ns: int) -> None:
        if not is_for(message, self._own) or self.stage is not Stage.MODE or message.command != SET_MODE:
            return
        if message.result in (dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_IN_PROGRESS):
            return
        self.state.refusals += 1
        self.state.reason = f"AUTO refused: {result_name('MAV_RESULT', message.result)}"
        is_settled = t_ns - self.state.stage_t_ns >= ns(self._limits.settle_s)
        if self.state.refusals >= self._limits.max_refusals and is_settled:
            if self.state.has_no_mission and self._profile.atomic:
                self._reject(t_ns)
            else:
                self._finish(ok=False, t_ns=t_ns)

    def _on_mode(self, t_ns: int) -> None:
        """Continue by the mode of a heartbeat, which is ours."""
        mode = self._authority.mode
        if self.state.waits_for_mode and self.stage is Stage.UPLOAD:
            last = len(self.items) - 1
            self._on_request(dialect.MAVLink_mission_request_int_message(*self._own, last, 0), t_ns)
        elif self.stage is Stage.PARK and mode != AUTO:
            if self.state.onboard is OnboardState.EQUAL:
                self._start_select(t_ns)
            else:
                self._start_upload(t_ns)
        elif self.stage is Stage.MODE and mode == AUTO and self._is_auto_new():
            self._finish(ok=self.state.onboard is OnboardState.EQUAL, t_ns=t_ns)
        elif self.stage is Stage.HOLD and mode != AUTO:
            self._start_clear(t_ns)

    def _is_auto_new(self) -> bool:
        """Return True unless a heartbeat in AUTO may be older than a LOITER that was commanded."""
        is_sent = self.state.timer is not None and self.state.timer.sent > 0
        return is_sent or self.state.loiter_t_ns is None

    def _is_at_mission_end(self) -> bool:
        """Return True if the vehicle would be at its mission's end."""
        flown = self.state.old if self.state.onboard is OnboardState.OLD else self.items
        last = math.inf if flown is None else len(flown) - 1
        return self._profile.ends_in == LOITER and self.state.current == last
