"""Bring a fence or rally points to one vehicle, or read what it holds. Sans-I/O, as a mission's task.

A list counts when it has been read back the same. It differs from a mission in what may go wrong meanwhile:
nobody flies along a fence, so nothing is parked, selected or started here. ArduPilot and PX4 take a fence as
a whole, at its end; what becomes of rally points half-way is told, and the whole is tried again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, GCS_COMPONENT_ID, GCS_SYSTEM_ID, Message
from gcs.mavlink.mission.geofence_rally import LIST_NAMES, list_difference
from gcs.mavlink.mission.items import Item
from gcs.mavlink.mission.protocol import MissionDownload, MissionUpload
from gcs.mavlink.services.retry import RetryTimer, ns
from gcs.mavlink.services.rtt import RttEstimator
from gcs.model import system_of

Stage: TypeAlias = Literal["clear", "upload", "read", "done"]

_ACCEPTED: Final = dialect.MAV_MISSION_ACCEPTED
_UNSUPPORTED: Final = (dialect.MAV_MISSION_UNSUPPORTED, dialect.MAV_MISSION_UNSUPPORTED_FRAME)


@dataclass(frozen=True, slots=True)
class ListTiming:
    """Bounds of each step, as `gcs.mavlink.mission.task_terms.Timing`."""

    tries: int = 6
    answer_s: float = 6.0
    """For at least so long a question is repeated."""
    silence_s: float = 8.5
    last_ack_s: float = 2.5
    settle_s: float = 1.2
    uploads: int = 4


@dataclass(frozen=True, slots=True)
class ListResult:
    """How it ended."""

    ok: bool
    detail: str
    held: tuple[Item, ...] | None
    """What the vehicle holds by the last read-back; None when that is not known."""
    retries: int


class ListTask:
    """One list of one vehicle.

    Parameters
    ----------
    mission_type : int
        MAV_MISSION_TYPE_FENCE or _RALLY.
    items : sequence of Item or None
        What it is to hold: none of them clears the list. None only reads.
    encode : callable
        Message to frame for this vehicle, such as `Fleet.encoder`.
    """

    def __init__(
        self,
        vehicle: int,
        mission_type: int,
        items: Sequence[Item] | None,
        encode: Callable[[Message], bytes],
        t_ns: int,
        timing: ListTiming | None = None,
        own: tuple[int, int] = (GCS_SYSTEM_ID, GCS_COMPONENT_ID),
    ) -> None:
        self.result: ListResult | None = None
        self.vehicle, self.mission_type = vehicle, mission_type
        self._items, self._encode, self._own = items, encode, own
        self._timing = timing or ListTiming()
        self._to = (system_of(vehicle), AUTOPILOT_COMPONENT_ID)
        self._pace = RttEstimator()
        self._sending = MissionUpload(items or (), self._to, self._pace, mission_type=mission_type)
        self._reading: MissionDownload | None = None
        self._uploads = 0
        self._held: tuple[Item, ...] | None = None
        self._verdict: tuple[int, str] | None = None
        self._deadline_t_ns: int | None = None
        self._asking: RetryTimer | None = None
        self._out: list[Message] = []
        if items is None:
            self._read(t_ns)
        else:
            self._begin(t_ns)

    # ------------------------------------------------------------ the caller's side

    def poll(self, t_ns: int) -> list[bytes]:
        """Let time pass; returns the frames to send."""
        if self.stage == "done":
            return []
        if self._verdict is not None and t_ns >= self._verdict[0]:
            self._again(self._verdict[1], t_ns)
        elif self._deadline_t_ns is not None and t_ns >= self._deadline_t_ns:
            if self._sending.is_whole:
                self._read(t_ns)
            else:
                self._again(f"it stopped asking at item {self._sending.next}", t_ns)
        elif any(one is not None and one.unanswered(t_ns) for one in (self._asking, self._reading)):
            if self.stage == "read" and self._items is not None:
                self._again("no answer to the read-back", t_ns)
            else:
                self._end(False, f"no answer: does it take a {LIST_NAMES[self.mission_type]}?")
        elif self.stage == "upload":
            self._out += self._sending.due(t_ns)
        return self._sent(t_ns)

    def receive(self, message: Message, t_ns: int) -> list[bytes]:
        """Take a message of the vehicle; others' are ignored."""
        handler = _HANDLERS.get(message.get_type())
        from_it = (message.get_srcSystem(), message.get_srcComponent()) == self._to
        if handler is None or self.stage == "done" or not from_it or not self._is_for_us(message):
            return []
        handler(self, message, t_ns)
        return self._sent(t_ns)

    # ------------------------------------------------------------ steps

    def _begin(self, t_ns: int) -> None:
        self._uploads += 1
        self._verdict = self._deadline_t_ns = self._reading = None
        self._sending.begin()
        if self._items:
            self.stage: Stage = "upload"
            self._ask(self._sending.count(), t_ns)
        else:
            self.stage = "clear"
            clear = dialect.MAVLink_mission_clear_all_message(*self._to, self.mission_type)
            self._ask(clear, t_ns)

    def _read(self, t_ns: int) -> None:
        self.stage = "read"
        self._verdict = self._deadline_t_ns = self._asking = None
        self._reading = MissionDownload(self._to, self._pace, t_ns, mission_type=self.mission_type)

    def _ask(self, question: Message, t_ns: int) -> None:
        self._asking = RetryTimer(
            question, self._pace.patience(self._timing.tries, self._timing.answer_s), t_ns
        )

    def _again(self, reason: str, t_ns: int) -> None:
        if self._uploads >= self._timing.uploads:
            self._end(False, f"{reason}, {self._uploads} uploads tried; what it holds now is not known")
        else:
            self._pace.repeats += 1
            cancelled = dialect.MAV_MISSION_OPERATION_CANCELLED  # PX4 takes no COUNT while it receives a list
            self._out.append(dialect.MAVLink_mission_ack_message(*self._to, cancelled, self.mission_type))
            self._begin(t_ns)

    def _end(self, ok: bool, detail: str) -> None:
        self.stage = "done"
        self._verdict = self._deadline_t_ns = self._asking = self._reading = None
        self.result = ListResult(ok, detail, self._held, self._pace.repeats)

    # ------------------------------------------------------------ what the vehicle says

    def _is_for_us(self, message: Message) -> bool:
        target = (message.target_system, message.target_component)
        mine = all(got in (0, own) for got, own in zip(target, self._own, strict=True))
        return mine and message.mission_type == self.mission_type

    def _on_request(self, message: Message, t_ns: int) -> None:
        reading = self._reading
        if reading is not None and self._items and not self._sending.acked and reading.count is None:
            self.stage, self._reading = "upload", None  # it never had the last item: the upload goes on
        if self.stage != "upload" or (self._asking is not None and not self._asking.sent):
            return
        items = self._sending.answer(message.seq, t_ns)
        if not items:
            return
        if self._asking is not None:
            self._pace.took(self._asking.took_s(t_ns))
        self._asking = self._verdict = None
        wait_s = self._timing.last_ack_s if self._sending.is_whole else self._timing.silence_s
        self._deadline_t_ns = t_ns + ns(wait_s)
        self._out += items

    def _on_ack(self, message: Message, t_ns: int) -> None:
        if self._reading is not None and message.type == dialect.MAV_MISSION_ERROR:
            self._reading.broken_off(t_ns)
        if self.stage not in ("upload", "clear"):
            return
        is_whole = self.stage == "upload" and self._sending.is_whole
        if is_whole and message.type == dialect.MAV_MISSION_ERROR:
            self._read(t_ns)  # it receives no more, as when the last item came twice
        elif message.type == _ACCEPTED:
            if self.stage == "clear" or is_whole:
                self._sending.acked = True
                self._read(t_ns)
        elif message.type != dialect.MAV_MISSION_INVALID_SEQUENCE and self._verdict is None:
            entry = dialect.enums["MAV_MISSION_RESULT"].get(message.type)
            said = str(message.type) if entry is None else entry.name.removeprefix("MAV_MISSION_")
            if message.type in _UNSUPPORTED:
                self._end(False, f"the vehicle does not take it: {said}")
            else:
                self._verdict = (t_ns + ns(self._timing.settle_s), f"the vehicle answered {said}")

    def _on_count(self, message: Message, t_ns: int) -> None:
        if self._reading is not None:
            self._reading.take_count(message, t_ns)
            self._judge(t_ns)

    def _on_item(self, message: Message, t_ns: int) -> None:
        if self._reading is not None:
            self._reading.take_item(message, t_ns)
            self._judge(t_ns)

    def _judge(self, t_ns: int) -> None:
        reading = self._reading
        if reading is None or not reading.is_complete:
            return
        self._out.append(reading.thanks())
        self._held = tuple(reading.items)
        if self._items is None:
            self._end(True, f"{len(self._held)} items")
            return
        difference = list_difference(self.mission_type, self._items, self._held)
        if difference:
            self._again(f"read-back differs: {difference}", t_ns)
        else:
            self._end(True, "read back equal" if self._items else "cleared")

    def _sent(self, t_ns: int) -> list[bytes]:
        if self._asking is not None and self._asking.due(t_ns):
            self._pace.repeats += self._asking.sent > 1
            self._out.append(self._asking.question)
        if self._reading is not None:
            self._out += self._reading.due(t_ns)
        out, self._out = self._out, []
        return [self._encode(message) for message in out]


_HANDLERS: Final[dict[str, Callable[[ListTask, Message, int], None]]] = {
    "MISSION_REQUEST": ListTask._on_request,
    "MISSION_REQUEST_INT": ListTask._on_request,
    "MISSION_ACK": ListTask._on_ack,
    "MISSION_COUNT": ListTask._on_count,
    "MISSION_ITEM_INT": ListTask._on_item,
}
