"""Upload or download of a fence or rally points of one vehicle. Sans-I/O.

An upload succeeds when the list reads back equal. Unlike a mission, it needs no change of mode. ArduPilot and
PX4 store a fence as a whole, at its end. A failed upload is repeated as a whole. After a programming error
the task ends as failed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, GCS_COMPONENT_ID, GCS_SYSTEM_ID, Message
from gcs.mavlink.mission.geofence_rally import LIST_NAMES, list_difference
from gcs.mavlink.mission.item_transfer import MissionUpload
from gcs.mavlink.mission.items import Item
from gcs.mavlink.mission.list_upload import ACCEPTED, ListUpload, ListUploadState, result_name
from gcs.mavlink.mission.upload_limits import UploadLimits
from gcs.mavlink.mission.upload_stages import LIST_TRANSITIONS, Stage, TransitionError
from gcs.mavlink.services.retransmission_timeout import RttEstimator
from gcs.model import system_of

_UNSUPPORTED: Final = (dialect.MAV_MISSION_UNSUPPORTED, dialect.MAV_MISSION_UNSUPPORTED_FRAME)
_LIMITS: Final = UploadLimits(max_tries=6, min_answer_s=6.0, max_uploads=4)


@dataclass(frozen=True, slots=True)
class ListResult:
    """Result of a list task."""

    ok: bool
    detail: str
    items: tuple[Item, ...] | None
    """Items on the vehicle by the last download; None if unknown."""
    retries: int


class ListTask(ListUpload):
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

    transitions = LIST_TRANSITIONS

    def __init__(
        self,
        vehicle: int,
        mission_type: int,
        items: Sequence[Item] | None,
        encode: Callable[[Message], bytes],
        t_ns: int,
        own: tuple[int, int] = (GCS_SYSTEM_ID, GCS_COMPONENT_ID),
    ) -> None:
        to = (system_of(vehicle), AUTOPILOT_COMPONENT_ID)
        sending = MissionUpload(tuple(items or ()), to, mission_type, in_order=True)
        super().__init__(ListUploadState(sending=sending, rtt=RttEstimator()), encode, _LIMITS, own)
        self.result: ListResult | None = None
        self.vehicle = vehicle
        self._items = items
        self._onboard_items: tuple[Item, ...] | None = None
        if items is None:
            self._start_verify(t_ns)
        else:
            self._start(t_ns)

    def poll(self, t_ns: int) -> list[bytes]:
        """Advance the timers; return the frames to send."""
        if self.stage is Stage.DONE:
            return []
        try:
            self._run_timers(t_ns)
        except TransitionError as error:
            self._end_after_error(error, t_ns)
        return self._take_due_frames(t_ns)

    def receive(self, message: Message, t_ns: int) -> list[bytes]:
        """Process a message of the vehicle; return the frames to send."""
        try:
            return super().receive(message, t_ns)
        except TransitionError as error:
            self._end_after_error(error, t_ns)
        return self._take_due_frames(t_ns)

    def _end_after_error(self, error: TransitionError, t_ns: int) -> None:
        """End at once after a programming error: the stored list is unknown."""
        self._outbox, self._onboard_items = [], None
        if self.stage is not Stage.DONE:
            self._outbox.append(self._ack(dialect.MAV_MISSION_OPERATION_CANCELLED))
            self._end(False, f"program error ({error}); the stored list is unknown", t_ns)

    def _start(self, t_ns: int) -> None:
        self.state.uploads += 1
        self.state.sending.restart()
        if self._items:
            self._enter_stage(Stage.UPLOAD, t_ns, self.state.sending.count_message())
        else:
            clear = dialect.MAVLink_mission_clear_all_message(*self._to, self.mission_type)
            self._enter_stage(Stage.CLEAR, t_ns, clear)

    def _retry_upload(self, reason: str, t_ns: int) -> None:
        if self.state.uploads >= self._limits.max_uploads:
            self._end(
                False, f"{reason}, {self.state.uploads} uploads failed; the stored list is unknown", t_ns
            )
        else:
            self.state.rtt.retransmissions += 1
            # PX4 refuses a COUNT during a transfer.
            self._outbox.append(self._ack(dialect.MAV_MISSION_OPERATION_CANCELLED))
            self._start(t_ns)

    def _end(self, ok: bool, detail: str, t_ns: int) -> None:
        self._enter_stage(Stage.DONE, t_ns)
        self.result = ListResult(ok, detail, self._onboard_items, self.retries)

    def _on_upload_timeout(self, t_ns: int) -> None:
        if self.state.sending.is_all_sent:
            self._start_verify(t_ns)
        else:
            self._retry_upload(f"it stopped asking at item {self.state.sending.sent_count}", t_ns)

    def _on_tries_exhausted(self, t_ns: int) -> None:
        if self.stage is Stage.VERIFY and self._items is not None:
            self._retry_upload("no answer to the read-back", t_ns)
        else:
            self._end(False, f"no answer: does it take a {LIST_NAMES[self.mission_type]}?", t_ns)

    def _on_ack(self, message: Message, t_ns: int) -> None:
        if self.stage is Stage.CLEAR and message.type == ACCEPTED:
            self._start_verify(t_ns)
        else:
            super()._on_ack(message, t_ns)

    def _on_refusal(self, message: Message, t_ns: int) -> None:
        answer = result_name("MAV_MISSION_RESULT", message.type).removeprefix("MISSION_")
        if message.type in _UNSUPPORTED:
            self._end(False, f"the vehicle does not support it: {answer}", t_ns)
        else:
            self._note_failure(f"the vehicle answered {answer}", t_ns)

    def _on_read_back(self, items: Sequence[Item], t_ns: int) -> None:
        self._onboard_items = tuple(items)
        if self._items is None:
            self._end(True, f"{len(items)} items", t_ns)
            return
        difference = list_difference(self.mission_type, self._items, items)
        if difference:
            self._retry_upload(f"read-back differs: {difference}", t_ns)
        else:
            self._end(True, "read back equal" if self._items else "cleared", t_ns)
