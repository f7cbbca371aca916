"""One vehicle's task: its mission uploaded, read back, compared, selected and started. Sans-I/O.

Source: https://mavlink.io/en/services/mission.html, ArduPilot's `MissionItemProtocol`, PX4's `mavlink_mission`,
and what both were seen to do; what differs between them stands in `gcs.mavlink.profiles`. Stages::

    [park] --> upload --all items, ACK--> verify --equal--> select --> mode --> done
                 ^                          |
                 +-- differs, refused ------+--bound reached--> hold --> clear --> done (failed)

Why it is shaped like this:

* An ArduPlane upload is in place: from MISSION_COUNT on, the vehicle stores a mix of two missions until the
  last item is in. Only a read-back tells what it holds, so nothing counts before it; it also settles a lost
  ACK. A PX4 upload is atomic: what is stored is whole at any time, and hold and clear are never needed.
* While the store is mixed the vehicle may go on in AUTO as long as it flies the waypoint that it has cached.
  It must not take the next one from the mix: when the next item is nearer than `Timing.guard_s`, it is told to
  LOITER, before the upload begins ("park") or in the midst of it, and to go on when the mission is verified.
* When repairs are used up: LOITER, then MISSION_CLEAR_ALL (refused while in AUTO), checked. The report says
  what the vehicle holds; a mix is never left to be flown.
* Somebody else may choose another mode meanwhile (`gcs.mavlink.custody`). Then the store is brought to a good
  end all the same, selected item and all, but no mode is commanded.
* The vehicle leads the upload. A failure ACK is believed after a pause without requests; ACK 13 answers a
  duplicate and is never final.
* Every message is filtered by the vehicle's id, our id and the mission type: another ground station on the
  same link asks and acknowledges too.

It never arms, and never sends a mission message without a target.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.asking import Asking, Patience, ns
from gcs.mavlink.codec import AUTOPILOT_COMPONENT_ID, GCS_COMPONENT_ID, GCS_SYSTEM_ID, Message
from gcs.mavlink.commands import REQUEST_MESSAGE, SET_CURRENT, SET_MODE, command, set_mode
from gcs.mavlink.conversations import ReadBack, Sending
from gcs.mavlink.custody import Custody
from gcs.mavlink.items import Home, Item
from gcs.mavlink.modes import AUTO, LOITER
from gcs.mavlink.profiles import ARDUPLANE, Profile
from gcs.mavlink.task import Holds, Stage, TaskResult, Timing
from gcs.model import NS_PER_S, Mission, UploadReport

_MISSION: Final = dialect.MAV_MISSION_TYPE_MISSION
_ACCEPTED: Final = dialect.MAV_MISSION_ACCEPTED
_INVALID_SEQUENCE: Final = dialect.MAV_MISSION_INVALID_SEQUENCE
_MAX_PAUSE_S: Final = 4.0


class MissionTask:
    """Bring one mission to one vehicle. Bytes out, messages of that vehicle in, time an argument.

    Parameters
    ----------
    mission : Mission
        What to fly.
    home : Home
        Sent as item 0 where the firmware keeps one; the vehicle replaces it by its own.
    encode : callable
        Message to frame for this vehicle, such as `Fleet.encoder`.
    profile : Profile
        Of its firmware.
    custody : Custody, optional
        Who chose the mode that it is in; shared by all tasks of a vehicle.
    old : sequence of Item, optional
        What the vehicle holds when the task begins, if a read-back has shown it: a failed task may then end
        in "old" rather than clear the vehicle.
    mixed : bool
        Whether a task before this one may have left a mix.
    current : int, optional
        Item that the vehicle flies to now.
    time_to_next_s : callable
        Time (ns) to the least number of seconds before the vehicle could take its next item from the store;
        0 when it is not known, infinite when it does not fly a mission.
    first_item : callable, optional
        Number of the item to begin with, asked when the mission is verified: on a slow link the vehicle has
        flown on meanwhile, and must not turn back for waypoints behind it.
    from_ground : bool
        Whether the mission begins with a take-off.
    delegated : bool
        Whether another program uploads: see `handover` and `delivered`.
    own : (int, int)
        Our system and component id.
    """

    def __init__(
        self,
        mission: Mission,
        home: Home,
        encode: Callable[[Message], bytes],
        *,
        profile: Profile = ARDUPLANE,
        custody: Custody | None = None,
        old: Sequence[Item] | None = None,
        mixed: bool = False,
        current: int | None = None,
        time_to_next_s: Callable[[int], float] = lambda _t_ns: 0.0,
        first_item: Callable[[], int] | None = None,
        from_ground: bool = False,
        delegated: bool = False,
        timing: Timing | None = None,
        own: tuple[int, int] = (GCS_SYSTEM_ID, GCS_COMPONENT_ID),
    ) -> None:
        self.mission = mission
        self.items = profile.items(mission, home, from_ground=from_ground)
        self.stage: Stage = "new"
        self.retries = 0
        self.uploads = 0
        self.result: TaskResult | None = None
        self._encode = encode
        self._profile = profile
        self._custody = custody or Custody()
        self._old = old
        self._time_to_next_s = time_to_next_s
        self._first_item = first_item or (lambda: profile.home_items)
        self._delegated = delegated
        self._handover = b""
        self._timing = timing or Timing()
        self._own = own
        self._to = (mission.vehicle, AUTOPILOT_COMPONENT_ID)
        self._out: list[Message] = []
        self._began_t_ns = self._stage_t_ns = 0
        self._asking: Asking | None = None
        self._deadline_t_ns: int | None = None
        self._verdict: tuple[int, str] | None = None
        self._sending = Sending(self.items, self._to)
        self._reading = ReadBack(self._to)
        self._cleared = False
        self._holds: Holds = "unknown" if mixed else "old"
        self._reason = ""
        self._abandoned = False
        self._may_start = True
        self._current = current
        self._current_before = current
        self._refusals = 0
        self._by_message = profile.select_by == "message"
        self._first = self._mark = profile.home_items
        self._hold_t_ns: int | None = None
        self._handlers: dict[str, Callable[[Message, int], None]] = {
            "MISSION_REQUEST": self._on_request,
            "MISSION_REQUEST_INT": self._on_request,
            "MISSION_ACK": self._on_ack,
            "MISSION_COUNT": self._on_count,
            "MISSION_ITEM_INT": self._on_item,
            "MISSION_CURRENT": self._on_current,
            "COMMAND_ACK": self._on_command_ack,
            "HEARTBEAT": self._on_heartbeat,
        }

    # ------------------------------------------------------------ the caller's side

    @property
    def is_mixed(self) -> bool:
        """Whether the vehicle may hold a mix of missions now."""
        return self._holds == "unknown" and not self._profile.atomic

    @property
    def round_trip_s(self) -> float | None:
        """From an item to the request for the next one, None before it has been measured."""
        return self._sending.round_trip_s

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
        handler = self._handlers.get(message.get_type())
        if self.stage in ("new", "done") or handler is None:
            return []
        if (message.get_srcSystem(), message.get_srcComponent()) != self._to:
            return []
        handler(message, t_ns)
        return self._sent(t_ns)

    def poll(self, t_ns: int) -> list[bytes]:
        """Let time pass."""
        if self.stage in ("new", "done"):
            return []
        self._guard(t_ns)
        transferring = self.stage in ("upload", "verify")
        if transferring and t_ns - self._began_t_ns > ns(self._timing.give_up_s):
            self._reason = f"no end after {self._timing.give_up_s:.0f} s: {self._reason or self.stage}"
            self._hold(t_ns)
        elif self._verdict is not None and t_ns >= self._verdict[0]:
            self._again(self._verdict[1], t_ns)
        elif self._deadline_t_ns is not None and t_ns >= self._deadline_t_ns:
            self._silent(t_ns)
        elif self._asking is not None and self._asking.unanswered(t_ns):
            self._unanswered(t_ns)
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

    def supersede(self, t_ns: int) -> None:
        """End at once and silently: another task takes over, and its COUNT ends our session."""
        if self.stage != "done":
            self._reason = "superseded"
            self._finish(ok=False, t_ns=t_ns)

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

    def delivered(self, ok: bool, detail: str, t_ns: int) -> list[bytes]:
        """Take the other program's word on the upload; the read-back decides all the same."""
        if self.stage == "upload" and self._delegated:
            if ok:
                self._verify(t_ns)
            else:
                self._again(detail, t_ns)
        return self._sent(t_ns)

    # ------------------------------------------------------------ stages

    def _enter(
        self,
        stage: Stage,
        t_ns: int,
        question: Message | None = None,
        *,
        pause_s: float = 0.0,
        patience: Patience | None = None,
    ) -> None:
        self.stage = stage
        self._stage_t_ns = t_ns
        self._deadline_t_ns = self._verdict = None
        self._refusals = 0
        self._ask(question, t_ns + ns(pause_s), patience)

    def _ask(self, question: Message | None, t_ns: int, patience: Patience | None = None) -> None:
        patience = patience or self._timing.answer
        self._asking = Asking(question, patience, t_ns) if question is not None else None

    def _park(self, t_ns: int) -> None:
        """Have the vehicle wait, and hear that it does: only then can an order that follows be told from it."""
        self._hold_t_ns = t_ns
        self._enter("park", t_ns, self._mode_command(LOITER), patience=self._timing.hold)

    def _upload(self, t_ns: int, pause_s: float = 0.0) -> None:
        self.uploads += 1
        self._sending.begin()
        self._mark = self._begin_at() if self._profile.marks_current else -1
        if not self._delegated:
            self._enter("upload", t_ns, self._sending.count(), pause_s=pause_s)
            return
        self._enter("upload", t_ns)
        self._deadline_t_ns = t_ns + ns(self._timing.delegate_s)
        self._note_upload()
        to, items = self._to, enumerate(self.items)
        messages = (item.message(n, *to, current=n == self._mark) for n, item in items)
        self._handover = b"".join(map(self._encode, messages))

    def _note_upload(self) -> None:
        """From now on the vehicle may have begun to change what it stores."""
        if self._holds != "unknown":
            self._holds = "unknown"
            self._current_before = self._current

    def _verify(self, t_ns: int) -> None:
        self._reading = ReadBack(self._to)
        self._enter("verify", t_ns, self._reading.question())

    def _begin_at(self) -> int:
        return min(max(self._profile.home_items, self._first_item()), len(self.items) - 1)

    def _select(self, t_ns: int) -> None:
        self._current_before = self._current
        self._first = self._begin_at()
        question = command(self.mission.vehicle, SET_CURRENT, self._first)
        if self._by_message:
            question = dialect.MAVLink_mission_set_current_message(*self._to, self._first)
        self._enter("select", t_ns, question)

    def _start_mode(self, t_ns: int) -> None:
        if self._custody.taken:
            self._leave(t_ns)
        else:
            self._enter("mode", t_ns, self._mode_command(AUTO))

    def _leave(self, t_ns: int) -> None:
        """End without commanding a mode: somebody else has chosen one."""
        stored = "read back equal, not started" if self._holds == "equal" else self._reason or "not begun"
        self._reason = f"{stored}: {self._custody.taken} was chosen meanwhile"
        self._finish(ok=False, t_ns=t_ns)

    def _give_back(self, t_ns: int) -> None:
        """End as failed; a vehicle that was held, and still has a whole mission, goes on with it."""
        if self._hold_t_ns is not None and self._holds == "old" and self._may_start:
            self._start_mode(t_ns)
        else:
            self._finish(ok=False, t_ns=t_ns)

    def _hold(self, t_ns: int) -> None:
        """Leave no mix: stop the vehicle where it circles, then clear what it stores."""
        if not self.is_mixed:
            self._holds = "old" if self._holds == "old" else "whole"
            self._give_back(t_ns)
        elif self._custody.mode not in ("", AUTO):
            self._clear(t_ns)
        else:
            self._hold_t_ns = t_ns
            self._enter("hold", t_ns, self._mode_command(LOITER), patience=self._timing.hold)

    def _clear(self, t_ns: int) -> None:
        self._cleared = False
        self._enter("clear", t_ns, dialect.MAVLink_mission_clear_all_message(*self._to, _MISSION))

    def _again(self, reason: str, t_ns: int) -> None:
        """Repair: upload again after a pause; when the bound is reached read back a last time, then clear."""
        self._reason = self._reason if self._abandoned else reason
        if self.uploads < self._timing.uploads:
            self.retries += 1
            self._upload(t_ns, min(_MAX_PAUSE_S, 0.25 * 2.0**self.uploads))
        elif self._abandoned or self.stage != "upload":
            self._hold(t_ns)
        else:
            self._abandoned = True
            self._verify(t_ns)

    def _finish(self, *, ok: bool, t_ns: int) -> None:
        detail = "verified by read-back" if ok else self._reason
        if ok and self.uploads > 1:
            detail += f" after {self.uploads} uploads"
        duration_s = (t_ns - self._began_t_ns) / NS_PER_S
        held = self._hold_t_ns is not None and (ok or self._custody.mode != AUTO)
        self.result = TaskResult(t_ns, ok, self._holds, detail, duration_s, self.retries, held)
        self._enter("done", t_ns)

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
                self._reason = "LOITER was not confirmed, so nothing was changed"
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
        """Tell the vehicle to LOITER before it takes its next item from a mixed store."""
        mixed = self.is_mixed and self.stage in ("upload", "verify", "clear")
        if not mixed or self._custody.mode != AUTO:
            return
        near = self._time_to_next_s(t_ns) < self._timing.guard_s
        moved_on = self._current is not None and self._current != self._current_before
        again = self._hold_t_ns is None or t_ns - self._hold_t_ns >= ns(self._timing.hold_again_s)
        if (near or moved_on or self._hold_t_ns is not None) and again:
            self._hold_t_ns = t_ns
            self._out.append(self._mode_command(LOITER))

    # ------------------------------------------------------------ what the vehicle says

    def _for_us(self, message: Message, *, broadcast: bool = False) -> bool:
        target = (message.target_system, message.target_component)
        mine = all(got == own or (broadcast and got == 0) for got, own in zip(target, self._own, strict=True))
        return mine and message.mission_type == _MISSION

    def _on_request(self, message: Message, t_ns: int) -> None:
        if self._delegated or not self._for_us(message):
            return
        sending, seq = self._sending, message.seq
        if self.stage == "verify" and not sending.acked and seq < sending.next:
            self.stage, self._asking = "upload", None  # it never had the last item: the upload goes on
        if self.stage != "upload":
            asks_late = t_ns - self._stage_t_ns > ns(self._timing.settle_s)
            if asks_late and self.stage in ("verify", "select", "mode"):
                self._again("the vehicle asks for items again", t_ns)
            return
        if self._pausing():
            return
        before = sending.next
        item = sending.answer(seq, t_ns, self._mark)
        if item is None:
            return
        self.retries += sending.next == before
        self._asking = self._verdict = None
        wait_s = self._timing.last_ack_s if sending.is_whole else self._timing.silence_s
        self._deadline_t_ns = t_ns + ns(wait_s)
        self._out.append(item)

    def _on_ack(self, message: Message, t_ns: int) -> None:
        if not self._for_us(message, broadcast=True):
            return
        accepted, sending = message.type == _ACCEPTED, self._sending
        if self.stage == "upload" and not self._delegated:
            if accepted and sending.is_whole:
                sending.acked = True
                self._verify(t_ns)
            elif not accepted and message.type != _INVALID_SEQUENCE and not self._pausing():
                said = _name("MAV_MISSION_RESULT", message.type)
                reason = f"the vehicle answered {said}, {sending.next} of {len(self.items)} items sent"
                self._verdict = self._verdict or (t_ns + ns(self._timing.settle_s), reason)
        elif self.stage == "clear" and accepted and not self._cleared:
            self._cleared = True
            self._ask(ReadBack(self._to).question(), t_ns)

    def _on_count(self, message: Message, t_ns: int) -> None:
        if not self._for_us(message):
            return
        if self.stage == "clear" and self._cleared:
            if message.count <= self._profile.home_items:
                self._holds = "cleared"
                self._finish(ok=False, t_ns=t_ns)
            else:
                self._clear(t_ns)
        elif self.stage == "verify" and self._reading.take_count(message):
            self._read_on(t_ns)

    def _on_item(self, message: Message, t_ns: int) -> None:
        if self.stage == "verify" and self._for_us(message) and self._reading.take_item(message):
            self._read_on(t_ns)

    def _read_on(self, t_ns: int) -> None:
        """Ask for the next item of the read-back, or judge it."""
        reading, profile = self._reading, self._profile
        if not reading.is_complete:
            self._ask(reading.question(), t_ns, self._timing.item)
            return
        self._out.append(reading.thanks())
        difference = profile.difference(self.items, reading.items)
        if not difference:
            self._holds = "equal"
            if self._hold_t_ns is not None and self._custody.mode == AUTO:
                self._park(t_ns)
            else:
                self._select(t_ns)
        elif self._abandoned and self._old is not None and not profile.difference(self._old, reading.items):
            self._holds = "old"
            self._give_back(t_ns)
        else:
            self._again(f"read-back differs: {difference}", t_ns)

    def _on_current(self, message: Message, t_ns: int) -> None:
        self._current = message.seq
        if self._current_before is None:
            self._current_before = message.seq
        news = self._current_before != self._first or (
            self._by_message and t_ns - self._stage_t_ns > ns(self._timing.settle_s)
        )
        if self.stage == "select" and message.seq == self._first and news:
            self._start_mode(t_ns)

    def _on_command_ack(self, message: Message, t_ns: int) -> None:
        mine = message.target_system in (0, self._own[0]) and message.target_component in (0, self._own[1])
        asked = {"select": SET_CURRENT, "mode": SET_MODE}.get(self.stage)
        if not mine or message.command != asked or message.result == dialect.MAV_RESULT_IN_PROGRESS:
            return
        if message.result == dialect.MAV_RESULT_ACCEPTED:
            if self.stage == "select":
                self._start_mode(t_ns)
            return
        self._refusals += 1
        self._reason = f"{self.stage} refused: {_name('MAV_RESULT', message.result)}"
        if self.stage == "select" and not self._by_message:
            self._by_message = True
            self._stage_t_ns = t_ns
            self._ask(dialect.MAVLink_mission_set_current_message(*self._to, self._first), t_ns)
        elif self._refusals >= self._timing.refusals:
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

    # ------------------------------------------------------------ frames

    def _mode_command(self, name: str) -> Message:
        self._custody.ordered(name)
        return set_mode(self.mission.vehicle, self._profile.autopilot, name)

    def _sent(self, t_ns: int) -> list[bytes]:
        """Frames that are due now."""
        if self._asking is not None and self._asking.due(t_ns):
            again = self._asking.sent > 1
            self.retries += again
            if self.stage == "upload":
                self._note_upload()
                self._sending.counted(t_ns, again=again)
            self._out.append(self._asking.question)
        out, self._out = self._out, []
        if any(message.get_type() == "COMMAND_LONG" and message.command == SET_MODE for message in out):
            heartbeat = (
                dialect.MAVLINK_MSG_ID_HEARTBEAT
            )  # which tells the mode, and is due once a second only
            out.append(command(self.mission.vehicle, REQUEST_MESSAGE, heartbeat))
        return [self._encode(message) for message in out]


def _name(enum: str, value: int) -> str:
    entry = dialect.enums[enum].get(value)
    return entry.name.removeprefix(f"{enum}_").removeprefix("MAV_") if entry is not None else str(value)
