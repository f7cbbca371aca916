"""One vehicle's task: its mission uploaded, read back, compared, selected and started. Sans-I/O.

Source: https://mavlink.io/en/services/mission.html, ArduPilot's `MissionItemProtocol`, and what ArduPlane 4.7
was seen to do. Stages::

    upload --all items, ACK--> verify --equal--> select --> mode --> done
       ^                          |
       +-- differs, refused ------+--bound reached--> hold --> clear --> done (failed)

Why it is shaped like this:

* An ArduPlane upload is in place: from MISSION_COUNT on, the vehicle stores a mix of two missions until the
  last item is in. Only a read-back tells what it holds, so nothing counts before it; it also settles a lost
  ACK.
* While the store is mixed the vehicle may go on in AUTO: it flies the waypoint that it has cached, which is
  what QGroundControl relies on as well, and on a sound link the transfer ends long before it gets there.
  When it does get there (MISSION_CURRENT moves on, or is not heard) it would take the next item from the
  mix: it is told to LOITER at once, and to go on in AUTO when the new mission has been verified.
* When repairs are used up: LOITER, then MISSION_CLEAR_ALL (refused while in AUTO), checked. The report says
  what the vehicle holds; a mix is never left to be flown.
* The vehicle leads the upload. An item is sent when it is asked for and only in order: a request that runs
  ahead belongs to an older session whose MISSION_COUNT was ours too. A failure ACK is believed after a
  pause without requests; ACK 13 answers a duplicate and is never final.
* Every message is filtered by the vehicle's id, our id and the mission type: another ground station on the
  same link asks and acknowledges too.

It never arms, and never sends a mission message without a target.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.asking import Asking, Patience, ns
from gcs.mavlink.codec import AUTOPILOT_COMPONENT_ID, GCS_COMPONENT_ID, GCS_SYSTEM_ID, Message
from gcs.mavlink.commands import SET_CURRENT, SET_MODE, command, set_mode
from gcs.mavlink.items import HOME_ITEMS, Home, Item, first_difference, item_of, items_of
from gcs.mavlink.modes import ARDUPILOT, AUTO, LOITER, mode_name
from gcs.mavlink.task import Holds, Stage, TaskResult, Timing
from gcs.model import NS_PER_S, Mission, UploadReport, VehicleState

_MISSION: Final = dialect.MAV_MISSION_TYPE_MISSION
_ACCEPTED: Final = dialect.MAV_MISSION_ACCEPTED
_INVALID_SEQUENCE: Final = dialect.MAV_MISSION_INVALID_SEQUENCE
_MAX_PAUSE_S: Final = 4.0
_HOLD_AGAIN_S: Final = 0.5


class MissionTask:
    """Bring one mission to one vehicle. Bytes out, messages of that vehicle in, time an argument.

    Parameters
    ----------
    mission : Mission
        What to fly.
    home : Home
        Sent as item 0; the vehicle replaces it by its own.
    encode : callable
        Message to frame for this vehicle, such as `Fleet.encoder`.
    old : sequence of Item, optional
        What the vehicle holds when the task begins, if a read-back has shown it: a failed task may then end
        in "old" rather than clear the vehicle.
    state : VehicleState, optional
        What the vehicle last said of itself: its mode, and the item that it flies to now.
    first_item : callable, optional
        Number of the item to begin with, asked when the mission is verified: on a slow link the vehicle has
        flown on meanwhile, and must not turn back for waypoints behind it.
    autopilot : int
        MAV_AUTOPILOT of the vehicle, for mode numbers.
    own : (int, int)
        Our system and component id.
    """

    def __init__(
        self,
        mission: Mission,
        home: Home,
        encode: Callable[[Message], bytes],
        *,
        old: Sequence[Item] | None = None,
        state: VehicleState | None = None,
        first_item: Callable[[], int] = lambda: HOME_ITEMS,
        autopilot: int = ARDUPILOT,
        timing: Timing | None = None,
        own: tuple[int, int] = (GCS_SYSTEM_ID, GCS_COMPONENT_ID),
    ) -> None:
        self.mission = mission
        self.items = items_of(mission, home)
        self.stage: Stage = "new"
        self.retries = 0
        self.uploads = 0
        self.result: TaskResult | None = None
        self._encode = encode
        self._old = old
        self._first_item = first_item
        self._autopilot = autopilot
        self._timing = timing or Timing()
        self._own = own
        self._to = (mission.vehicle, AUTOPILOT_COMPONENT_ID)
        self._out: list[Message] = []
        self._began_t_ns = self._stage_t_ns = 0
        self._asking: Asking | None = None
        self._deadline_t_ns: int | None = None
        self._verdict: tuple[int, str] | None = None
        self._next = 0
        self._acked = False
        self._count: int | None = None
        self._held_items: list[Item] = []
        self._holds: Holds = "old"
        self._reason = ""
        self._abandoned = False
        self._mode = state.mode if state is not None else ""
        self._current = state.mission_seq if state is not None and state.mission_seq >= 0 else None
        self._current_t_ns = 0
        self._current_before: int | None = None
        self._refusals = 0
        self._legacy_select = False
        self._first = HOME_ITEMS
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

    def start(self, t_ns: int) -> list[bytes]:
        """Begin; returns the frames to send."""
        self._began_t_ns = t_ns
        self._upload(t_ns)
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
        self._hold_over_mix(t_ns)
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
        self._mode, self._current = "", None
        if self.stage in ("hold", "clear"):
            self._hold(t_ns)
        else:
            self._again("the vehicle rebooted", t_ns)
        return self._sent(t_ns)

    def abandon(self, reason: str, t_ns: int) -> list[bytes]:
        """Give the mission up safely: the vehicle keeps a whole mission, or holds and is cleared."""
        if self.stage in ("upload", "verify"):
            self._reason = reason
            if self._holds == "old":
                self._finish(ok=False, t_ns=t_ns)
            else:
                self._hold(t_ns)
        elif self.stage in ("new", "select", "mode"):
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

    # ------------------------------------------------------------ stages

    def _enter(self, stage: Stage, t_ns: int, question: Message | None = None, pause_s: float = 0.0) -> None:
        self.stage = stage
        self._stage_t_ns = t_ns
        self._deadline_t_ns = self._verdict = None
        self._refusals = 0
        self._ask(question, t_ns + ns(pause_s))

    def _ask(self, question: Message | None, t_ns: int, patience: Patience | None = None) -> None:
        patience = patience or self._timing.answer
        self._asking = Asking(question, patience, t_ns) if question is not None else None

    def _upload(self, t_ns: int, pause_s: float = 0.0) -> None:
        self.uploads += 1
        self._next, self._acked = 0, False
        count = dialect.MAVLink_mission_count_message(*self._to, len(self.items), _MISSION)
        self._enter("upload", t_ns, count, pause_s)

    def _verify(self, t_ns: int) -> None:
        self._count, self._held_items = None, []
        self._enter("verify", t_ns, dialect.MAVLink_mission_request_list_message(*self._to, _MISSION))

    def _select(self, t_ns: int) -> None:
        self._holds = "equal"
        self._current_before = self._current
        self._first = min(max(HOME_ITEMS, self._first_item()), len(self.items) - 1)
        self._enter("select", t_ns, command(self.mission.vehicle, SET_CURRENT, self._first))

    def _start_mode(self, t_ns: int) -> None:
        self._enter("mode", t_ns, self._mode_command(AUTO))

    def _hold(self, t_ns: int) -> None:
        if self._mode not in ("", AUTO):
            self._clear(t_ns)
            return
        self._hold_t_ns = t_ns
        self._enter("hold", t_ns, self._mode_command(LOITER))

    def _clear(self, t_ns: int) -> None:
        self._acked = False
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
        held = self._hold_t_ns is not None
        self.result = TaskResult(t_ns, ok, self._holds, detail, duration_s, self.retries, held)
        self._enter("done", t_ns)

    # ------------------------------------------------------------ time

    def _pausing(self) -> bool:
        """Whether the stage's question has not been sent yet: what arrives belongs to what went before."""
        return self._asking is not None and not self._asking.sent

    def _silent(self, t_ns: int) -> None:
        """No request came: after the last item the ACK was lost perhaps; before it, it has given up."""
        if self._next == len(self.items):
            self._verify(t_ns)
        else:
            self._again(f"no request for item {self._next}", t_ns)

    def _unanswered(self, t_ns: int) -> None:
        if self.stage == "upload":
            self._reason = "no answer to MISSION_COUNT"
            self._hold(t_ns)
        elif self.stage == "verify":
            self._again("no answer to the read-back", t_ns)
        elif self.stage == "select":
            self._reason = "the first item could not be selected"
            self._finish(ok=False, t_ns=t_ns)
        elif self.stage == "mode":
            self._reason = self._reason or "AUTO was not confirmed"
            self._finish(ok=False, t_ns=t_ns)
        elif self.stage == "hold":
            self._reason += "; LOITER was not confirmed"
            self._clear(t_ns)
        elif self.stage == "clear":
            self._reason += "; the clearing was not confirmed"
            self._finish(ok=False, t_ns=t_ns)

    def _hold_over_mix(self, t_ns: int) -> None:
        """Tell the vehicle to LOITER when it may take its next item from a mixed store."""
        mixed = self._holds == "unknown" and self.stage in ("upload", "verify", "clear")
        if not mixed or self._mode != AUTO:
            return
        moved_on = self._current is not None and self._current != self._current_before
        unheard = t_ns - max(self._current_t_ns, self._began_t_ns) > ns(self._timing.current_silence_s)
        again = self._hold_t_ns is None or t_ns - self._hold_t_ns >= ns(_HOLD_AGAIN_S)
        if (moved_on or unheard or self._hold_t_ns is not None) and again:
            self._hold_t_ns = t_ns
            self._out.append(self._mode_command(LOITER))

    # ------------------------------------------------------------ what the vehicle says

    def _for_us(self, message: Message, *, broadcast: bool = False) -> bool:
        target = (message.target_system, message.target_component)
        mine = all(got == own or (broadcast and got == 0) for got, own in zip(target, self._own, strict=True))
        return mine and message.mission_type == _MISSION

    def _on_request(self, message: Message, t_ns: int) -> None:
        if not self._for_us(message):
            return
        seq = message.seq
        if self.stage == "verify" and not self._acked and seq < self._next:
            self.stage, self._asking = "upload", None  # it never had the last item: the upload goes on
        if self.stage != "upload":
            asks_late = t_ns - self._stage_t_ns > ns(self._timing.settle_s)
            if asks_late and self.stage in ("verify", "select", "mode"):
                self._again("the vehicle asks for items again", t_ns)
            return
        if seq > self._next or seq >= len(self.items) or self._pausing():
            return
        if seq == self._next:
            self._next += 1
        else:
            self.retries += 1
        self._asking = self._verdict = None
        whole = self._next == len(self.items)
        self._deadline_t_ns = t_ns + ns(self._timing.last_ack_s if whole else self._timing.silence_s)
        self._out.append(self.items[seq].message(seq, *self._to))

    def _on_ack(self, message: Message, t_ns: int) -> None:
        if not self._for_us(message, broadcast=True):
            return
        accepted = message.type == _ACCEPTED
        if self.stage == "upload":
            if accepted and self._next == len(self.items):
                self._acked = True
                self._verify(t_ns)
            elif not accepted and message.type != _INVALID_SEQUENCE and not self._pausing():
                said = _name("MAV_MISSION_RESULT", message.type)
                reason = f"the vehicle answered {said}, {self._next} of {len(self.items)} items sent"
                self._verdict = self._verdict or (t_ns + ns(self._timing.settle_s), reason)
        elif self.stage == "clear" and accepted and not self._acked:
            self._acked = True
            self._ask(dialect.MAVLink_mission_request_list_message(*self._to, _MISSION), t_ns)

    def _on_count(self, message: Message, t_ns: int) -> None:
        if not self._for_us(message):
            return
        if self.stage == "clear" and self._acked:
            if message.count <= HOME_ITEMS:
                self._holds = "cleared"
                self._finish(ok=False, t_ns=t_ns)
            else:
                self._acked = False
                self._ask(dialect.MAVLink_mission_clear_all_message(*self._to, _MISSION), t_ns)
        elif self.stage == "verify" and self._count is None:
            self._count = message.count
            self._read_on(t_ns)

    def _on_item(self, message: Message, t_ns: int) -> None:
        reading = self.stage == "verify" and self._count is not None and self._for_us(message)
        if reading and message.seq == len(self._held_items):
            self._held_items.append(item_of(message))
            self._read_on(t_ns)

    def _read_on(self, t_ns: int) -> None:
        """Ask for the next item of the read-back, or judge it."""
        if len(self._held_items) < (self._count or 0):
            request = dialect.MAVLink_mission_request_int_message(*self._to, len(self._held_items), _MISSION)
            self._ask(request, t_ns, self._timing.item)
            return
        self._out.append(dialect.MAVLink_mission_ack_message(*self._to, _ACCEPTED, _MISSION))
        difference = first_difference(self.items, self._held_items)
        if not difference:
            self._select(t_ns)
        elif self._abandoned and self._old is not None and not first_difference(self._old, self._held_items):
            self._holds = "old"
            self._finish(ok=False, t_ns=t_ns)
        else:
            self._again(f"read-back differs: {difference}", t_ns)

    def _on_current(self, message: Message, t_ns: int) -> None:
        self._current, self._current_t_ns = message.seq, t_ns
        if self._current_before is None:
            self._current_before = message.seq
        news = self._current_before != self._first or (
            self._legacy_select and t_ns - self._stage_t_ns > ns(self._timing.settle_s)
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
        if self.stage == "select" and not self._legacy_select:
            self._legacy_select = True
            self._stage_t_ns = t_ns
            self._ask(dialect.MAVLink_mission_set_current_message(*self._to, self._first), t_ns)
        elif self._refusals >= self._timing.refusals:
            self._finish(ok=False, t_ns=t_ns)

    def _on_heartbeat(self, message: Message, t_ns: int) -> None:
        self._mode = mode_name(message.autopilot, message.custom_mode)
        if self.stage == "mode" and self._mode == AUTO and self._asking is not None and self._asking.sent:
            self._finish(ok=True, t_ns=t_ns)
        elif self.stage == "hold" and self._mode != AUTO:
            self._clear(t_ns)

    # ------------------------------------------------------------ frames

    def _mode_command(self, name: str) -> Message:
        return set_mode(self.mission.vehicle, self._autopilot, name)

    def _sent(self, t_ns: int) -> list[bytes]:
        """Frames that are due now."""
        if self._asking is not None and self._asking.due(t_ns):
            self.retries += self._asking.sent > 1
            if self.stage == "upload" and self._holds != "unknown":
                self._holds = "unknown"
                self._current_before = self._current
            self._out.append(self._asking.question)
        out, self._out = self._out, []
        return [self._encode(message) for message in out]


def _name(enum: str, value: int) -> str:
    entry = dialect.enums[enum].get(value)
    return entry.name.removeprefix(f"{enum}_").removeprefix("MAV_") if entry is not None else str(value)
