"""One vehicle's task: its mission uploaded, read back, compared, selected and started. Sans-I/O.

Source: https://mavlink.io/en/services/mission.html, ArduPilot's `MissionItemProtocol`, PX4's
`mavlink_mission`, and what both were seen to do; what differs between them stands in
`gcs.mavlink.autopilots`. Stages::

    [park] --> upload --all items, ACK--> verify --equal--> select --> mode --> done
                 ^                          |
                 +-- differs, refused ------+--bound reached--> hold --> clear --> done (failed)

Why it is shaped like this:

* An ArduPlane upload is in place: from MISSION_COUNT on, the vehicle stores a mix of two missions until the
  last item is in. Only a read-back tells what it holds, so nothing counts before it; it also settles a lost
  ACK. A PX4 upload is atomic: what is stored is whole at any time, and hold and clear are never needed.
* While the store is mixed the vehicle may go on in AUTO as long as it flies the waypoint that it has cached.
  It must not take the next one from the mix: when the next item is nearer than `Timing.guard_s`, it is told
  to LOITER, before the upload begins ("park") or in the midst of it, and to go on when the mission is
  verified. Nor may it take the next one by its old number from a new mission of which nothing has been
  selected yet: that number may be beyond its end, and the vehicle would return to launch.
* When repairs are used up: LOITER, then MISSION_CLEAR_ALL (refused while in AUTO), checked. The report says
  what the vehicle holds; a mix is never left to be flown.
* Somebody else may choose another mode meanwhile (`gcs.mavlink.fleet.mode_authority`). Then the store is
brought to a good
  end all the same, selected item and all, but no mode is commanded.
* The vehicle leads the upload. A failure ACK is believed after a pause without requests; ACK 13 answers a
  duplicate and is never final.
* Every message is filtered by the vehicle's id, our id and the mission type: another ground station on the
  same link asks and acknowledges too.

It never arms, and never sends a mission message without a target.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.mission.upload_steps import UploadSteps
from gcs.mavlink.services.command_messages import SET_MODE
from gcs.mavlink.services.retry import ns
from gcs.model import UploadReport

_ACCEPTED: Final = dialect.MAV_MISSION_ACCEPTED
_ERROR: Final = dialect.MAV_MISSION_ERROR
_INVALID_SEQUENCE: Final = dialect.MAV_MISSION_INVALID_SEQUENCE


class UploadTask(UploadSteps):
    """Bring one mission to one vehicle. Bytes out, messages of that vehicle in, time an argument.

    Its parameters are those of `UploadSteps`.
    """

    # ------------------------------------------------------------ the caller's side

    @property
    def round_trip_s(self) -> float | None:
        """From a question to its answer, None before it has been measured."""
        return self._pace.round_trip_s

    def start(self, t_ns: int) -> list[bytes]:
        """Begin; returns the frames to send."""
        self._began_t_ns = t_ns
        flies = self._custody.mode in ("", AUTO)
        if flies and not self._profile.atomic and self._time_to_next_s(t_ns) < self._timing.guard_s:
            self._park(t_ns)
        else:
            self._upload(t_ns)
        return self._sent(t_ns)

    def clean(self, t_ns: int) -> list[bytes]:
        """Begin, not with an upload: only leave no mix behind."""
        self._began_t_ns = t_ns
        self._reason = "what the vehicle stored was not known to be whole"
        self._hold(t_ns)
        return self._sent(t_ns)

    def receive(self, message: Message, t_ns: int) -> list[bytes]:
        """Take one message that came from the vehicle; others' are ignored."""
        handler = _HANDLERS.get(message.get_type())
        if self.stage in ("new", "done") or handler is None:
            return []
        if (message.get_srcSystem(), message.get_srcComponent()) != self._to:
            return []
        handler(self, message, t_ns)
        return self._sent(t_ns)

    def poll(self, t_ns: int) -> list[bytes]:
        """Let time pass."""
        if self.stage in ("new", "done"):
            return []
        self._guard(t_ns)
        if self._in_doubt_t_ns is not None and t_ns - self._in_doubt_t_ns > ns(self._timing.settle_s):
            self._leave(t_ns)
            return self._sent(t_ns)
        transferring = self.stage in ("upload", "verify")
        if transferring and t_ns - self._began_t_ns > ns(self._timing.give_up_s):
            self._reason = f"no end after {self._timing.give_up_s:.0f} s: {self._reason or self.stage}"
            self._hold(t_ns)
        elif self._verdict is not None and t_ns >= self._verdict[0]:
            self._again(self._verdict[1], t_ns)
        elif self._deadline_t_ns is not None and t_ns >= self._deadline_t_ns:
            self._silent(t_ns)
        elif any(one is not None and one.unanswered(t_ns) for one in (self._asking, self._reading)):
            self._unanswered(t_ns)
        elif self.stage == "upload" and self._verdict is None:
            self._out += self._sending.due(t_ns, self._mark)
        return self._sent(t_ns)

    def restart(self, t_ns: int) -> list[bytes]:
        """Begin again: the vehicle has rebooted, and what it stores or flies must be learned anew."""
        if self.stage in ("new", "done"):
            return []
        self._current = None
        if self.stage in ("hold", "clear"):
            self._hold(t_ns)
        elif self.stage == "park":
            self._reason = "the vehicle rebooted"
            self._finish(ok=False, t_ns=t_ns)
        else:
            self._again("the vehicle rebooted", t_ns)
        return self._sent(t_ns)

    def abandon(self, reason: str, t_ns: int) -> list[bytes]:
        """Give the mission up safely: the vehicle keeps a whole mission, or holds and is cleared.

        Whoever wants that says what the vehicle is to do then: nothing is started here.
        """
        self._may_start = False
        if self.stage in ("upload", "verify"):
            self._reason = reason
            self._hold(t_ns)
        elif self.stage in ("new", "park", "select", "mode"):
            self._reason = reason
            self._finish(ok=False, t_ns=t_ns)
        return self._sent(t_ns)

    def supersede(self, t_ns: int) -> list[bytes]:
        """End at once: another task takes over; returns the frames to send first."""
        if self.stage != "done":
            self._out += self._cancelling()
            self._reason = "superseded"
            self._finish(ok=False, t_ns=t_ns)
        return self._sent(t_ns)

    def report(self) -> UploadReport:
        """Return the result as the record that flows on.

        Raises
        ------
        ValueError
            The task has not ended.
        """
        if self.result is None:
            raise ValueError("the task has not ended")
        end, mission = self.result, self.mission
        return UploadReport(
            t_ns=end.t_ns,
            vehicle=mission.vehicle,
            mission_id=mission.mission_id,
            items=len(self.items),
            ok=end.ok,
            detail=end.detail,
            duration_s=end.duration_s,
            retries=end.retries,
        )

    def handover(self) -> bytes:
        """Return, once for each upload, the MISSION_ITEM_INT frames that another program is to upload."""
        frames, self._handover = self._handover, b""
        return frames

    def delivered(self, ok: bool, begun: bool, detail: str, t_ns: int) -> list[bytes]:
        """Take the other program's word on the upload; the read-back decides all the same.

        When it failed before the vehicle could change anything, that keeps its mission. When it left a mix
        behind, we upload ourselves.
        """
        if self.stage == "upload" and self._delegated:
            if ok:
                self._verify(t_ns)
            elif begun or self._was_mixed:
                self._delegated = False
                self._again(detail, t_ns)
            else:
                self._holds, self._reason = "old", detail
                self._give_back(t_ns)
        return self._sent(t_ns)

    # ------------------------------------------------------------ time

    def _pausing(self) -> bool:
        """Whether the stage's question has not been sent yet: what arrives belongs to what went before."""
        return self._asking is not None and not self._asking.sent

    def _silent(self, t_ns: int) -> None:
        """No request came: after the last item the ACK was lost perhaps; before it, it has given up."""
        if self._delegated or self._sending.is_whole:
            self._verify(t_ns)
        else:
            self._again(f"no request for item {self._sending.next}", t_ns)

    def _unanswered(self, t_ns: int) -> None:
        match self.stage:
            case "park":
                unchanged = ", so nothing was changed" if self._holds == "old" else ""
                self._reason = f"LOITER was not confirmed{unchanged}"
                self._finish(ok=False, t_ns=t_ns)
            case "upload":
                self._reason = "no answer to MISSION_COUNT"
                self._hold(t_ns)
            case "verify":
                self._again("no answer to the read-back", t_ns)
            case "select":
                self._reason = "the first item could not be selected"
                self._finish(ok=False, t_ns=t_ns)
            case "mode":
                self._reason = self._reason or "AUTO was not confirmed"
                self._finish(ok=False, t_ns=t_ns)
            case "hold":
                self._reason += "; LOITER was not confirmed"
                self._clear(t_ns)
            case "clear":
                self._reason += "; the clearing was not confirmed"
                self._finish(ok=False, t_ns=t_ns)

    def _guard(self, t_ns: int) -> None:
        """Tell the vehicle to LOITER before it takes its next item from a mixed store, or from another."""
        mixed = self.is_mixed and self.stage in ("upload", "verify", "clear")
        unselected = self.stage == "select" and not self._selected
        if not (mixed or unselected) or self._custody.mode != AUTO:
            return
        near = self._time_to_next_s(t_ns) < self._timing.guard_s
        if unselected:
            if near:
                self._park(t_ns)
            return
        moved_on = self._current is not None and self._current != self._current_before
        again = self._hold_t_ns is None or t_ns - self._hold_t_ns >= ns(self._timing.hold_again_s)
        if (near or moved_on or self._hold_t_ns is not None) and again:
            self._hold_t_ns = t_ns
            self._out.append(self._mode_command(LOITER))

    # ------------------------------------------------------------ what the vehicle says

    def _on_request(self, message: Message, t_ns: int) -> None:
        if self._delegated or not self._for_us(message):
            return
        sending, seq = self._sending, message.seq
        if self.stage == "verify" and not sending.acked and seq < sending.next:
            self.stage, self._reading = "upload", None  # it never had the last item: the upload goes on
        if self.stage != "upload":
            asks_late = t_ns - self._stage_t_ns > ns(self._timing.settle_s)
            if asks_late and self.stage in ("verify", "select", "mode"):
                self._again("the vehicle asks for items again", t_ns)
            return
        if self._pausing():
            return
        items = sending.answer(seq, t_ns, self._mark)
        if not items:
            return
        if self._asking is not None:
            self._pace.took(self._asking.took_s(t_ns))
        self._asking = self._verdict = None
        wait_s = self._timing.last_ack_s if sending.is_whole else self._timing.silence_s
        self._deadline_t_ns = t_ns + ns(wait_s)
        self._out += items

    def _on_ack(self, message: Message, t_ns: int) -> None:
        if not self._for_us(message, broadcast=True):
            return
        accepted, sending = message.type == _ACCEPTED, self._sending
        if self.stage == "upload" and not self._delegated:
            if sending.is_whole and message.type in (_ACCEPTED, _ERROR):
                sending.acked = accepted  # an error: it receives no more, as when the last item came twice
                self._verify(t_ns)
            elif not accepted and message.type != _INVALID_SEQUENCE and not self._pausing():
                said = _name("MAV_MISSION_RESULT", message.type)
                reason = f"the vehicle answered {said}, {sending.next} of {len(self.items)} items sent"
                self._verdict = self._verdict or (t_ns + ns(self._timing.settle_s), reason)
        elif self.stage == "verify" and message.type == _ERROR and self._reading is not None:
            self._reading.broken_off(t_ns)
        elif self.stage == "clear" and accepted and not self._cleared:
            self._cleared = True
            self._read(t_ns)

    def _on_count(self, message: Message, t_ns: int) -> None:
        if not self._for_us(message):
            return
        if self.stage == "clear" and self._cleared:
            if message.count <= self._profile.home_items:
                self._holds = "cleared"
                self._finish(ok=False, t_ns=t_ns)
            else:
                self._clear(t_ns)
        elif self.stage == "verify" and self._reading is not None:
            self._reading.take_count(message, t_ns)
            self._judge(t_ns)

    def _on_item(self, message: Message, t_ns: int) -> None:
        if self.stage == "verify" and self._reading is not None and self._for_us(message):
            self._reading.take_item(message, t_ns)
            self._judge(t_ns)

    def _judge(self, t_ns: int) -> None:
        """Compare what was read back with what was sent, once all of it has come."""
        reading, profile = self._reading, self._profile
        if reading is None or not reading.is_complete:
            return
        self._out.append(reading.thanks())
        difference = profile.difference(self.items, reading.items)
        is_old = self._old is not None and not profile.difference(self._old, reading.items)
        self._refused = bool(difference) and not is_old
        if not difference:
            self._holds = "equal"
            if self._hold_t_ns is not None and self._custody.mode == AUTO:
                self._park(t_ns)
            else:
                self._select(t_ns)
        elif self._abandoned and is_old:
            self._holds = "old"
            self._give_back(t_ns)
        else:
            self._again(f"read-back differs: {difference}", t_ns)

    def _on_current(self, message: Message, t_ns: int) -> None:
        self._no_mission = message.mission_state == dialect.MISSION_STATE_NO_MISSION
        if self._current_before is None:
            self._current_before = message.seq
        is_echo = self.stage == "select" and self.first == self._profile.home_items
        is_echo = is_echo and message.seq == 0 != self._current_before
        self._current = self.first if is_echo else message.seq
        if self.stage == "mode" and self._no_mission and self._in_doubt_t_ns is not None:
            self._reject(t_ns)
        elif self.stage == "mode" and self._in_doubt_t_ns is not None:
            self._leave(t_ns)
        elif self.stage == "select" and self._current == self.first and self._is_news(message.seq, t_ns):
            self._start_mode(t_ns)

    def _is_news(self, seq: int, t_ns: int) -> bool:
        """Return True if a MISSION_CURRENT with the first item's number answers its selection.

        The vehicle may have flown to an item of this number before. Where an upload is atomic it has begun
        the new mission there already.
        """
        is_late = t_ns - self._stage_t_ns > ns(self._timing.settle_s)
        return self._profile.atomic or seq != self._current_before or is_late

    def _on_command_ack(self, message: Message, t_ns: int) -> None:
        mine = message.target_system in (0, self._own[0]) and message.target_component in (0, self._own[1])
        if not mine or self.stage != "mode" or message.command != SET_MODE:
            return
        if message.result in (dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_IN_PROGRESS):
            return
        self._refusals += 1
        self._reason = f"AUTO refused: {_name('MAV_RESULT', message.result)}"
        is_settled = t_ns - self._stage_t_ns >= ns(self._timing.settle_s)
        if self._refusals >= self._timing.refusals and is_settled:
            if self._no_mission and self._profile.atomic:
                self._reject(t_ns)
            else:
                self._finish(ok=False, t_ns=t_ns)

    def _on_heartbeat(self, message: Message, t_ns: int) -> None:
        self._custody.heard(self._profile.mode_name(message.custom_mode), at_end=self._ended())
        mode, taken = self._custody.mode, bool(self._custody.taken)
        if self.stage == "park" and mode != AUTO:
            if self._holds == "equal":
                self._select(t_ns)
            elif taken:
                self._leave(t_ns)
            else:
                self._upload(t_ns)
        elif self.stage == "mode" and taken and self._profile.atomic and mode == LOITER:
            if self._in_doubt_t_ns is None:  # is it that the mission was rejected?
                self._in_doubt_t_ns = t_ns
                self._out.append(self._current_please())
        elif self.stage == "mode" and taken:
            self._leave(t_ns)
        elif self.stage == "mode" and mode == AUTO and self._asking is not None and self._asking.sent:
            self._finish(ok=self._holds == "equal", t_ns=t_ns)
        elif self.stage == "hold" and mode != AUTO:
            self._clear(t_ns)

    def _ended(self) -> bool:
        """Whether the vehicle would be at its mission's end."""
        flown = self._old if self._holds == "old" else self.items
        last = math.inf if flown is None else len(flown) - 1
        return self._profile.ends_in == LOITER and self._current == last


_HANDLERS: Final[dict[str, Callable[[UploadTask, Message, int], None]]] = {
    "MISSION_REQUEST": UploadTask._on_request,
    "MISSION_REQUEST_INT": UploadTask._on_request,
    "MISSION_ACK": UploadTask._on_ack,
    "MISSION_COUNT": UploadTask._on_count,
    "MISSION_ITEM_INT": UploadTask._on_item,
    "MISSION_CURRENT": UploadTask._on_current,
    "COMMAND_ACK": UploadTask._on_command_ack,
    "HEARTBEAT": UploadTask._on_heartbeat,
}


def _name(enum: str, value: int) -> str:
    entry = dialect.enums[enum].get(value)
    return entry.name.removeprefix(f"{enum}_").removeprefix("MAV_") if entry is not None else str(value)
