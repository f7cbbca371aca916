"""Upload of a list of items with its read-back: the part that missions, fences and rally points share.

A vehicle requests items. A failure ACK counts after a pause without requests: the transfer may go on. Only
the read-back shows the onboard list, also after a lost ACK.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import GCS_COMPONENT_ID, GCS_SYSTEM_ID, Message
from gcs.mavlink.mission.item_transfer import MissionDownload, MissionUpload
from gcs.mavlink.mission.items import Item
from gcs.mavlink.mission.upload_limits import UploadLimits
from gcs.mavlink.mission.upload_stages import Stage, TransitionError
from gcs.mavlink.services.retransmission_timeout import RttEstimator
from gcs.mavlink.services.retry import RetryPolicy, RetryTimer, ns

ACCEPTED: Final = dialect.MAV_MISSION_ACCEPTED
_ERROR: Final = dialect.MAV_MISSION_ERROR


@dataclass(slots=True, kw_only=True)
class ListUploadState:
    """State of the upload of one list to one vehicle."""

    sending: MissionUpload
    rtt: RttEstimator
    stage: Stage = Stage.NEW
    uploads: int = 0
    download: MissionDownload | None = None
    stage_t_ns: int = 0
    """Begin of the stage."""
    timer: RetryTimer | None = None
    """Timer of the stage's request."""
    deadline_t_ns: int | None = None
    """End of the wait for a request of the vehicle, or for its ACK."""
    pending_failure: tuple[int, str] | None = None
    """Time at which a failure counts unless the vehicle requests an item before, and its reason."""
    start_seq: int = -1
    """Item to mark as the first to fly; -1 for none."""
    most_items: int = 0
    """Largest number of items of the stage's transfer that were requested or received."""
    progress_t_ns: int = 0
    """Time at which that number grew."""


class ListUpload(ABC):
    """Common steps of the uploads of lists. It keeps nothing between two events but its state.

    Parameters
    ----------
    encode : callable
        Message to frame for this vehicle, such as `Fleet.encoder`.
    own : (int, int)
        Our system and component id.
    """

    transitions: ClassVar[Mapping[Stage, frozenset[Stage]]]

    def __init__(
        self,
        state: ListUploadState,
        encode: Callable[[Message], bytes],
        limits: UploadLimits,
        own: tuple[int, int] = (GCS_SYSTEM_ID, GCS_COMPONENT_ID),
    ) -> None:
        self.state = state
        self.mission_type = state.sending.mission_type
        self._encode, self._limits, self._own = encode, limits, own
        self._to = state.sending.to
        self._outbox: list[Message] = []

    @property
    def stage(self) -> Stage:
        """Stage of the upload."""
        return self.state.stage

    @property
    def items(self) -> tuple[Item, ...]:
        """Items to upload."""
        return self.state.sending.items

    @property
    def retries(self) -> int:
        """Messages resent and uploads restarted."""
        return self.state.rtt.retransmissions

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
        self.state.stage = stage

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
        self.state.stage_t_ns = self.state.progress_t_ns = t_ns
        self.state.most_items = 0
        self.state.deadline_t_ns = self.state.pending_failure = self.state.download = None
        policy = policy or self.state.rtt.retry_policy(self._limits.max_tries, self._limits.min_answer_s)
        self.state.timer = RetryTimer(request, policy, t_ns + ns(pause_s)) if request is not None else None

    def _start_verify(self, t_ns: int) -> None:
        self._enter_stage(Stage.VERIFY, t_ns)
        self._start_download(t_ns)

    def _start_download(self, t_ns: int) -> None:
        self.state.timer = None
        self.state.download = MissionDownload.begin(
            self._to, self.state.rtt, t_ns, self.mission_type, in_order=self.state.sending.in_order
        )

    def _window(self) -> int:
        """Return the number of items or requests that may be in flight."""
        return 1

    def _is_answered_at_once(self) -> bool:
        """Return True if a missing answer to the stage's request means that a message was lost."""
        return True

    def _is_pausing(self) -> bool:
        """Return True if the stage's request has not been sent: messages still belong to the stage before."""
        return self.state.timer is not None and not self.state.timer.sent

    def _may_send(self, _t_ns: int) -> bool:
        """Return True if the stage's request, or an item again, may be sent now."""
        return True

    def _is_unanswered(self, t_ns: int) -> bool:
        """Return True if the tries of a request are used up."""
        requests = self.state.timer, self.state.download
        return self._is_stalled(t_ns) or any(one is not None and one.is_exhausted(t_ns) for one in requests)

    def _is_stalled(self, t_ns: int) -> bool:
        """Return True if a transfer goes on without a further item."""
        is_transfer = self.stage is Stage.UPLOAD and self.state.timer is None
        is_transfer = is_transfer or self.state.download is not None
        return is_transfer and t_ns - self.state.progress_t_ns > ns(self._limits.stall_s)

    def _note_items(self, items: int, t_ns: int) -> None:
        """Note how many items of the transfer were requested or received."""
        if items > self.state.most_items:
            self.state.most_items, self.state.progress_t_ns = items, t_ns

    def _run_timers(self, t_ns: int) -> None:
        if self.state.pending_failure is not None and t_ns >= self.state.pending_failure[0]:
            self._retry_upload(self.state.pending_failure[1], t_ns)
        elif self.state.deadline_t_ns is not None and t_ns >= self.state.deadline_t_ns:
            self._on_upload_timeout(t_ns)
        elif self._is_unanswered(t_ns):
            self._on_tries_exhausted(t_ns)
        elif self.stage is Stage.UPLOAD and self.state.pending_failure is None and self._may_send(t_ns):
            self._outbox += self.state.sending.poll(
                t_ns, self.state.rtt, self.state.start_seq, self._window()
            )

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
                if (
                    self.stage is Stage.VERIFY
                    and self.state.download is not None
                    and self._is_for_us(message)
                ):
                    self.state.download.add_item(message, t_ns, self.state.rtt)
                    self._note_items(len(self.state.download.received), t_ns)
                    self._check_download(t_ns)
            case _:
                return False
        return True

    def _on_request(self, message: Message, t_ns: int) -> None:
        upload, seq = self.state.sending, message.seq
        if self.stage is Stage.VERIFY and not upload.acked and seq < upload.sent_count:
            self._set_stage(Stage.UPLOAD)  # It lacks the last item: continue.
            self.state.download = None
        if self.stage is not Stage.UPLOAD or self._is_pausing():
            return
        items = upload.answer_request(seq, t_ns, self.state.rtt, self.state.start_seq)
        if not items:
            return
        self._note_items(seq + 1, t_ns)
        if self.state.timer is not None:
            self.state.rtt.add_sample(self.state.timer.round_trip_s(t_ns))
        self.state.timer = self.state.pending_failure = None
        wait_s = self._limits.ack_timeout_s if upload.is_all_sent else self._limits.request_timeout_s
        self.state.deadline_t_ns = t_ns + ns(wait_s)
        self._outbox += items

    def _on_ack(self, message: Message, t_ns: int) -> None:
        upload = self.state.sending
        if self.stage is Stage.UPLOAD and upload.is_all_sent and message.type in (ACCEPTED, _ERROR):
            upload.acked = message.type == ACCEPTED  # On an error it has all items.
            self._start_verify(t_ns)
        elif self.stage in (Stage.UPLOAD, Stage.CLEAR):
            is_final = message.type not in (ACCEPTED, dialect.MAV_MISSION_INVALID_SEQUENCE)
            if is_final and not self._is_pausing():
                self._on_refusal(message, t_ns)
        elif self.stage is Stage.VERIFY and message.type == _ERROR and self.state.download is not None:
            self.state.download.restart_if_in_order(t_ns, self.state.rtt)

    def _on_count(self, message: Message, t_ns: int) -> None:
        if self.stage is Stage.VERIFY and self.state.download is not None:
            self.state.download.add_count(message, t_ns, self.state.rtt)
            self._check_download(t_ns)

    def _check_download(self, t_ns: int) -> None:
        if self.state.download is not None and self.state.download.is_complete:
            self._outbox.append(self.state.download.ack_message())
            self._on_read_back(self.state.download.items, t_ns)

    def _note_failure(self, reason: str, t_ns: int) -> None:
        """Retry after a pause, unless the vehicle requests an item before."""
        self.state.pending_failure = self.state.pending_failure or (
            t_ns + ns(self._limits.settle_s),
            reason,
        )

    # ------------------------------------------------------------ frames

    def _ack(self, result: int) -> Message:
        return dialect.MAVLink_mission_ack_message(*self._to, result, self.mission_type)

    def _request_messages(self, request: Message, copies: int) -> list[Message]:
        """Return the messages of one try of the stage's request."""
        return [request] * copies

    def _due_messages(self, t_ns: int) -> list[Message]:
        timer = self.state.timer
        if timer is not None and self._may_send(t_ns) and timer.start_try(t_ns):
            is_repeat = timer.sent > 1
            self.state.rtt.retransmissions += is_repeat and self._is_answered_at_once()
            copies = self.state.rtt.copies if is_repeat else 1
            self._outbox += self._request_messages(timer.request, copies)
        if self.state.download is not None:
            self._outbox += self.state.download.poll(t_ns, self.state.rtt, self._window())
        out, self._outbox = self._outbox, []
        return out

    def _take_due_frames(self, t_ns: int) -> list[bytes]:
        """Return the frames that are due."""
        return [self._encode(message) for message in self._due_messages(t_ns)]


def result_name(enum: str, value: int) -> str:
    """Return the name of a value of a MAVLink enum, without its prefix; the number if it is unknown."""
    entry = dialect.enums[enum].get(value)
    return entry.name.removeprefix(f"{enum}_").removeprefix("MAV_") if entry is not None else str(value)
