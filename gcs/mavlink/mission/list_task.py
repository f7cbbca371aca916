"""Upload or download of a fence or rally points of one vehicle. Sans-I/O.

An upload succeeds when the list reads back equal. Unlike a mission, it needs no change of mode. ArduPilot and
PX4 store a fence as a whole, at its end. A failed upload is repeated as a whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, GCS_COMPONENT_ID, GCS_SYSTEM_ID, Message, is_for
from gcs.mavlink.mission.geofence_rally import LIST_NAMES, list_difference
from gcs.mavlink.mission.items import Item
from gcs.mavlink.mission.protocol import MissionDownload, MissionUpload
from gcs.mavlink.services.retry import RetryTimer, ns
from gcs.mavlink.services.rtt import RttEstimator
from gcs.model import system_of

Stage: TypeAlias = Literal["clear", "upload", "read", "done"]

_ACCEPTED: Final = dialect.MAV_MISSION_ACCEPTED
_UNSUPPORTED: Final = (dialect.MAV_MISSION_UNSUPPORTED, dialect.MAV_MISSION_UNSUPPORTED_FRAME)

# Timeouts and bounds, as in `gcs.mavlink.mission.upload_timing.UploadTiming`.
_MAX_TRIES: Final = 6
_MIN_ANSWER_S: Final = 6.0
_REQUEST_TIMEOUT_S: Final = 8.5
_ACK_TIMEOUT_S: Final = 2.5
_SETTLE_S: Final = 1.2
_MAX_UPLOADS: Final = 4


@dataclass(frozen=True, slots=True)
class ListResult:
    """Result of a list task."""

    ok: bool
    detail: str
    items: tuple[Item, ...] | None
    """Items on the vehicle by the last download; None if unknown."""
    retries: int


class ListTask:
    """One list of one vehicle.

    Parameters
    ----------
    mission_type : int
        MAV_MISSION_TYPE_FENCE or _RALLY.
    items : sequence of Item or None
        Items to upload; an empty sequence clears the list, None downloads only.
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
        own: tuple[int, int] = (GCS_SYSTEM_ID, GCS_COMPONENT_ID),
    ) -> None:
        self.result: ListResult | None = None
        self.vehicle, self.mission_type = vehicle, mission_type
        self._items, self._encode, self._own = items, encode, own
        self._to = (system_of(vehicle), AUTOPILOT_COMPONENT_ID)
        self._rtt = RttEstimator()
        self._mission_upload = MissionUpload(items or (), self._to, self._rtt, mission_type)
        self._download: MissionDownload | None = None
        self._uploads = 0
        self._onboard_items: tuple[Item, ...] | None = None
        self._pending_failure: tuple[int, str] | None = None
        self._deadline_t_ns: int | None = None
        self._timer: RetryTimer | None = None
        self._outbox: list[Message] = []
        if items is None:
            self._start_download(t_ns)
        else:
            self._start(t_ns)

    # ------------------------------------------------------------ the caller's side

    def poll(self, t_ns: int) -> list[bytes]:
        """Advance the timers; return the frames to send."""
        if self.stage == "done":
            return []
        if self._pending_failure is not None and t_ns >= self._pending_failure[0]:
            self._retry_upload(self._pending_failure[1], t_ns)
        elif self._deadline_t_ns is not None and t_ns >= self._deadline_t_ns:
            if self._mission_upload.is_all_sent:
                self._start_download(t_ns)
            else:
                self._retry_upload(f"it stopped asking at item {self._mission_upload.sent_count}", t_ns)
        elif any(one is not None and one.is_exhausted(t_ns) for one in (self._timer, self._download)):
            if self.stage == "read" and self._items is not None:
                self._retry_upload("no answer to the read-back", t_ns)
            else:
                self._end(False, f"no answer: does it take a {LIST_NAMES[self.mission_type]}?")
        elif self.stage == "upload":
            self._outbox += self._mission_upload.poll(t_ns)
        return self._take_due_frames(t_ns)

    def receive(self, message: Message, t_ns: int) -> list[bytes]:
        """Process a message of the vehicle; return the frames to send."""
        handler = _HANDLERS.get(message.get_type())
        from_it = (message.get_srcSystem(), message.get_srcComponent()) == self._to
        if handler is None or self.stage == "done" or not from_it or not is_for(message, self._own):
            return []
        handler(self, message, t_ns)
        return self._take_due_frames(t_ns)

    # ------------------------------------------------------------ steps

    def _start(self, t_ns: int) -> None:
        self._uploads += 1
        self._pending_failure = self._deadline_t_ns = self._download = None
        self._mission_upload.restart()
        if self._items:
            self.stage: Stage = "upload"
            self._start_request(self._mission_upload.count_message(), t_ns)
        else:
            self.stage = "clear"
            clear = dialect.MAVLink_mission_clear_all_message(*self._to, self.mission_type)
            self._start_request(clear, t_ns)

    def _start_download(self, t_ns: int) -> None:
        self.stage = "read"
        self._pending_failure = self._deadline_t_ns = self._timer = None
        self._download = MissionDownload(self._to, self._rtt, t_ns, self.mission_type)

    def _start_request(self, request: Message, t_ns: int) -> None:
        self._timer = RetryTimer(request, self._rtt.retry_policy(_MAX_TRIES, _MIN_ANSWER_S), t_ns)

    def _retry_upload(self, reason: str, t_ns: int) -> None:
        if self._uploads >= _MAX_UPLOADS:
            self._end(False, f"{reason}, {self._uploads} uploads failed; the stored list is unknown")
        else:
            self._rtt.retransmissions += 1
            cancelled = dialect.MAV_MISSION_OPERATION_CANCELLED  # PX4 refuses a COUNT during a transfer.
            self._outbox.append(dialect.MAVLink_mission_ack_message(*self._to, cancelled, self.mission_type))
            self._start(t_ns)

    def _end(self, ok: bool, detail: str) -> None:
        self.stage = "done"
        self._pending_failure = self._deadline_t_ns = self._timer = self._download = None
        self.result = ListResult(ok, detail, self._onboard_items, self._rtt.retransmissions)

    # ------------------------------------------------------------ messages of the vehicle

    def _on_request(self, message: Message, t_ns: int) -> None:
        download = self._download
        if download is not None and self._items and not self._mission_upload.acked and download.count is None:
            self.stage, self._download = "upload", None  # It lacks the last item: continue.
        if self.stage != "upload" or (self._timer is not None and not self._timer.sent):
            return
        items = self._mission_upload.answer_request(message.seq, t_ns)
        if not items:
            return
        if self._timer is not None:
            self._rtt.add_sample(self._timer.round_trip_s(t_ns))
        self._timer = self._pending_failure = None
        wait_s = _ACK_TIMEOUT_S if self._mission_upload.is_all_sent else _REQUEST_TIMEOUT_S
        self._deadline_t_ns = t_ns + ns(wait_s)
        self._outbox += items

    def _on_ack(self, message: Message, t_ns: int) -> None:
        if self._download is not None and message.type == dialect.MAV_MISSION_ERROR:
            self._download.restart_if_in_order(t_ns)
        if self.stage not in ("upload", "clear"):
            return
        is_all_sent = self.stage == "upload" and self._mission_upload.is_all_sent
        if is_all_sent and message.type == dialect.MAV_MISSION_ERROR:
            self._start_download(t_ns)  # It has all items.
        elif message.type == _ACCEPTED:
            if self.stage == "clear" or is_all_sent:
                self._mission_upload.acked = True
                self._start_download(t_ns)
        elif message.type != dialect.MAV_MISSION_INVALID_SEQUENCE and self._pending_failure is None:
            entry = dialect.enums["MAV_MISSION_RESULT"].get(message.type)
            said = str(message.type) if entry is None else entry.name.removeprefix("MAV_MISSION_")
            if message.type in _UNSUPPORTED:
                self._end(False, f"the vehicle does not support it: {said}")
            else:
                self._pending_failure = (t_ns + ns(_SETTLE_S), f"the vehicle answered {said}")

    def _on_count(self, message: Message, t_ns: int) -> None:
        if self._download is not None:
            self._download.add_count(message, t_ns)
            self._compare_download(t_ns)

    def _on_item(self, message: Message, t_ns: int) -> None:
        if self._download is not None:
            self._download.add_item(message, t_ns)
            self._compare_download(t_ns)

    def _compare_download(self, t_ns: int) -> None:
        download = self._download
        if download is None or not download.is_complete:
            return
        self._outbox.append(download.ack_message())
        self._onboard_items = tuple(download.items)
        if self._items is None:
            self._end(True, f"{len(self._onboard_items)} items")
            return
        difference = list_difference(self.mission_type, self._items, self._onboard_items)
        if difference:
            self._retry_upload(f"read-back differs: {difference}", t_ns)
        else:
            self._end(True, "read back equal" if self._items else "cleared")

    def _take_due_frames(self, t_ns: int) -> list[bytes]:
        if self._timer is not None and self._timer.start_try(t_ns):
            self._rtt.retransmissions += self._timer.sent > 1
            self._outbox.append(self._timer.request)
        if self._download is not None:
            self._outbox += self._download.poll(t_ns)
        out, self._outbox = self._outbox, []
        return [self._encode(message) for message in out]


_HANDLERS: Final[dict[str, Callable[[ListTask, Message, int], None]]] = {
    "MISSION_REQUEST": ListTask._on_request,
    "MISSION_REQUEST_INT": ListTask._on_request,
    "MISSION_ACK": ListTask._on_ack,
    "MISSION_COUNT": ListTask._on_count,
    "MISSION_ITEM_INT": ListTask._on_item,
}
