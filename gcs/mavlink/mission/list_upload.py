"""Upload of a list of items with its read-back: the part that missions, fences and rally points share.

A vehicle requests items. A failure ACK counts after a pause without requests: the transfer may go on. Only
the read-back shows the onboard list, also after a lost ACK.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, Message
from gcs.mavlink.mission.items import Item
from gcs.mavlink.mission.protocol import MissionDownload, MissionUpload
from gcs.mavlink.mission.upload_stages import Stage, TransitionError
from gcs.mavlink.mission.upload_timing import UploadTiming
from gcs.mavlink.services.retry import RetryPolicy, RetryTimer, ns
from gcs.mavlink.services.rtt import RttEstimator
from gcs.model import system_of

ACCEPTED: Final = dialect.MAV_MISSION_ACCEPTED
_ERROR: Final = dialect.MAV_MISSION_ERROR


class ListUpload(ABC):
    """State of the upload of one list to one vehicle, and its common steps.

    Parameters
    ----------
    in_order : bool
        True if the vehicle answers the requests of a download in order only.
    own : (int, int)
        Our system and component id.
    """

    transitions: ClassVar[Mapping[Stage, frozenset[Stage]]]

    def __init__(
        self,
        vehicle: int,
        mission_type: int,
        items: Sequence[Item],
        encode: Callable[[Message], bytes],
        timing: UploadTiming,
        rtt: RttEstimator,
        own: tuple[int, int],
        *,
        in_order: bool = True,
    ) -> None:
        self.mission_type = mission_type
        self.stage = Stage.NEW
        self.uploads = 0
        self._encode, self._timing, self._rtt, self._own = encode, timing, rtt, own
        self._to = (system_of(vehicle), AUTOPILOT_COMPONENT_ID)
        self._in_order = in_order
        self._mission_upload = MissionUpload(
            items, self._to, rtt, mission_type, last_on_request_only=in_order
        )
        self._download: MissionDownload | None = None
        self._outbox: list[Message] = []
        self._stage_t_ns = 0
        self._timer: RetryTimer | None = None
        self._deadline_t_ns: int | None = None
        self._pending_failure: tuple[int, str] | None = None
        self._start_seq = -1
        """Item to mark as the first to fly; -1 for none."""

    @property
    def retries(self) -> int:
        """Messages resent and uploads restarted."""
        return self._rtt.retransmissions

    def receive(self, message: Message, t_ns: int) -> list[bytes]:
        """Process a message of the vehicle; return the frames to send."""
        if self.stage in (Stage.NEW, Stage.DONE):
            return []
        if (message.get_srcSystem(), message.get_srcComponent()) != self._to:
            return []
        return self._take_due_frames(t_ns) if self._handle(message, t_ns) else []

    # ------------------------------------------------------------ stages

    def _set_stage(self, stage: Stage) -> None:
        if stage not in self.transitions[self.stage]:
            raise TransitionError(self.stage, stage)
        self.stage = stage

    def _enter_stage(
        self,
        stage: Stage,
        t_ns: int,
        request: Message | None = None,
        *,
        pause_s: float = 0.0,
        policy: RetryPolicy | None = None,
    ) -> None:
        self._set_stage(stage)
        self._stage_t_ns = t_ns
        self._deadline_t_ns = self._pending_failure = self._download = None
        policy = policy or self._rtt.retry_policy(self._timing.max_tries, self._timing.min_answer_s)
        self._timer = RetryTimer(request, policy, t_ns + ns(pause_s)) if request is not None else None

    def _start_verify(self, t_ns: int) -> None:
        self._enter_stage(Stage.VERIFY, t_ns)
        self._start_download(t_ns)

    def _start_download(self, t_ns: int) -> None:
        self._timer = None
        self._download = MissionDownload(
            self._to, self._rtt, t_ns, self.mission_type, in_order=self._in_order
        )

    def _window(self) -> int:
        """Return the number of items or requests that may be in flight."""
        return 1

    def _is_pausing(self) -> bool:
        """Return True if the stage's request has not been sent: messages still belong to the stage before."""
        return self._timer is not None and not self._timer.sent

    def _run_timers(self, t_ns: int) -> None:
        if self._pending_failure is not None and t_ns >= self._pending_failure[0]:
            self._retry_upload(self._pending_failure[1], t_ns)
        elif self._deadline_t_ns is not None and t_ns >= self._deadline_t_ns:
            self._on_upload_timeout(t_ns)
        elif any(one is not None and one.is_exhausted(t_ns) for one in (self._timer, self._download)):
            self._on_tries_exhausted(t_ns)
        elif self.stage is Stage.UPLOAD and self._pending_failure is None:
            self._outbox += self._mission_upload.poll(t_ns, self._start_seq, self._window())

    @abstractmethod
    def _retry_upload(self, reason: str, t_ns: int) -> None:
        """Upload again, or end after the last upload."""

    @abstractmethod
    def _on_upload_timeout(self, t_ns: int) -> None:
        """Handle missing requests: verify after the last item, since the ACK may be lost; retry before it."""

    @abstractmethod
    def _on_tries_exhausted(self, t_ns: int) -> None:
        """Handle a request without an answer."""

    @abstractmethod
    def _on_refusal(self, message: Message, t_ns: int) -> None:
        """Handle a failure ACK during an upload."""

    @abstractmethod
    def _on_read_back(self, items: Sequence[Item], t_ns: int) -> None:
        """Compare the downloaded list with the uploaded one."""

    # ------------------------------------------------------------ messages of the vehicle

    def _is_for_us(self, message: Message, *, broadcast: bool = False) -> bool:
        target = (message.target_system, message.target_component)
        is_ours = all(
            got == own or (broadcast and got == 0) for got, own in zip(target, self._own, strict=True)
        )
        return is_ours and message.mission_type == self.mission_type

    def _handle(self, message: Message, t_ns: int) -> bool:
        """Process a message; return True if it is of a known type."""
        match message.get_type():
            case "MISSION_REQUEST" | "MISSION_REQUEST_INT":
                if self._is_for_us(message):
                    self._on_request(message, t_ns)
            case "MISSION_ACK":
                if self._is_for_us(message, broadcast=True):
                    self._on_ack(message, t_ns)
            case "MISSION_COUNT":
                if self._is_for_us(message):
                    self._on_count(message, t_ns)
            case "MISSION_ITEM_INT":
                if self.stage is Stage.VERIFY and self._download is not None and self._is_for_us(message):
                    self._download.add_item(message, t_ns)
                    self._check_download(t_ns)
            case _:
                return False
        return True

    def _on_request(self, message: Message, t_ns: int) -> None:
        upload, seq = self._mission_upload, message.seq
        if self.stage is Stage.VERIFY and not upload.acked and seq < upload.sent_count:
            self._set_stage(Stage.UPLOAD)  # It lacks the last item: continue.
            self._download = None
        if self.stage is not Stage.UPLOAD or self._is_pausing():
            return
        items = upload.answer_request(seq, t_ns, self._start_seq)
        if not items:
            return
        if self._timer is not None:
            self._rtt.add_sample(self._timer.round_trip_s(t_ns))
        self._timer = self._pending_failure = None
        wait_s = self._timing.ack_timeout_s if upload.is_all_sent else self._timing.request_timeout_s
        self._deadline_t_ns = t_ns + ns(wait_s)
        self._outbox += items

    def _on_ack(self, message: Message, t_ns: int) -> None:
        upload = self._mission_upload
        if self.stage is Stage.UPLOAD and upload.is_all_sent and message.type in (ACCEPTED, _ERROR):
            upload.acked = message.type == ACCEPTED  # On an error it has all items.
            self._start_verify(t_ns)
        elif self.stage in (Stage.UPLOAD, Stage.CLEAR):
            is_final = message.type not in (ACCEPTED, dialect.MAV_MISSION_INVALID_SEQUENCE)
            if is_final and not self._is_pausing():
                self._on_refusal(message, t_ns)
        elif self.stage is Stage.VERIFY and message.type == _ERROR and self._download is not None:
            self._download.restart_if_in_order(t_ns)

    def _on_count(self, message: Message, t_ns: int) -> None:
        if self.stage is Stage.VERIFY and self._download is not None:
            self._download.add_count(message, t_ns)
            self._check_download(t_ns)

    def _check_download(self, t_ns: int) -> None:
        if self._download is not None and self._download.is_complete:
            self._outbox.append(self._download.ack_message())
            self._on_read_back(self._download.items, t_ns)

    def _note_failure(self, reason: str, t_ns: int) -> None:
        """Retry after a pause, unless the vehicle requests an item before."""
        self._pending_failure = self._pending_failure or (t_ns + ns(self._timing.settle_s), reason)

    # ------------------------------------------------------------ frames

    def _ack(self, result: int) -> Message:
        return dialect.MAVLink_mission_ack_message(*self._to, result, self.mission_type)

    def _request_messages(self, request: Message, copies: int) -> list[Message]:
        """Return the messages of one try of the stage's request."""
        return [request] * copies

    def _due_messages(self, t_ns: int) -> list[Message]:
        if self._timer is not None and self._timer.start_try(t_ns):
            is_repeat = self._timer.sent > 1
            self._rtt.retransmissions += is_repeat
            copies = self._rtt.copies if is_repeat else 1
            self._outbox += self._request_messages(self._timer.request, copies)
        if self._download is not None:
            self._outbox += self._download.poll(t_ns, self._window())
        out, self._outbox = self._outbox, []
        return out

    def _take_due_frames(self, t_ns: int) -> list[bytes]:
        """Return the frames that are due."""
        return [self._encode(message) for message in self._due_messages(t_ns)]


def result_name(enum: str, value: int) -> str:
    """Return the name of a value of a MAVLink enum, without its prefix; the number if it is unknown."""
    entry = dialect.enums[enum].get(value)
    return entry.name.removeprefix(f"{enum}_").removeprefix("MAV_") if entry is not None else str(value)
