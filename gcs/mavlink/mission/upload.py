"""Upload of one list to one vehicle: the machine that `gcs.mavlink.mission.upload_rules` drives. Sans-I/O.

The state is plain data (`upload_state`). An upload keeps nothing between two events but its state, so that it
continues from a snapshot. Messages and time become events in `upload_events`; guards and actions of the rules
are functions of an `Upload` and the time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots.modes import AUTO
from gcs.mavlink.frames.codec import OWN_IDS, Message
from gcs.mavlink.mission.geofence_rally import LIST_NAMES
from gcs.mavlink.mission.items import Item
from gcs.mavlink.mission.upload_events import is_meant, message_event, time_event
from gcs.mavlink.mission.upload_limits import UploadLimits
from gcs.mavlink.mission.upload_stages import Choice, Event, OnboardState, RuleError, Stage, UploadResult
from gcs.mavlink.mission.upload_state import Flight, StageState, UploadState
from gcs.mavlink.services.command_sender import REQUEST_MESSAGE, SET_MODE, command_long, set_mode
from gcs.mavlink.services.retry import RetryPolicy, RetryTimer, ns
from gcs.model import NS_PER_S, Parameter, UploadReport

Guard: TypeAlias = Callable[["Upload", int], bool]
Action: TypeAlias = Callable[["Upload", int], None]
Source: TypeAlias = Stage | Choice

_HEARTBEAT_GROWTH: Final = 1.3
_MAX_HEARTBEAT_WAIT_S: Final = 1.0


class Rule(NamedTuple):
    """One rule: of those of a stage for an event the first one is carried out whose guard holds.

    Without an event it is that of a choice; without a guard it always holds; without a target the stage stays
    as it is. `why` is the reason for the operator, with the facts that it names (`Upload.reason_of`).
    """

    event: Event | None
    guard: Guard | None = None
    target: Source | None = None
    action: Action | None = None
    why: str = ""


class StageRule(NamedTuple):
    """What a stage sends: at its begin; while a guard holds, if there is one; and what it waits for then."""

    enter: Action
    may_send: Guard | None
    waits_for: str


class Rules(NamedTuple):
    """All rules of one kind of upload."""

    stages: Mapping[Stage, StageRule]
    table: Mapping[tuple[Source, Event | None], tuple[Rule, ...]]


class Upload:
    """Upload of one list to one vehicle.

    Parameters
    ----------
    encode : callable
        Message to frame for this vehicle, such as `Fleet.encoder`.
    flight : Flight or None
        The vehicle in flight; None for fences and rally points.
    own : (int, int)
        Our system and component id.

    Attributes
    ----------
    result : UploadResult or None
        None before the end.
    error : RuleError or None
        Programming error that ended the upload.
    outbox : list of Message
        To send.
    message : Message
        Message of the vehicle that is being processed.
    order_text : str
        Reason of the order that is being processed.
    downloaded : tuple of Item or None
        Items of the last read-back; None before the first.
    has_succeeded : bool
        True once the list is stored as wanted, and a mission is flown.
    """

    def __init__(
        self,
        rules: Rules,
        state: UploadState,
        encode: Callable[[Message], bytes],
        limits: UploadLimits,
        flight: Flight | None = None,
        own: tuple[int, int] = OWN_IDS,
    ) -> None:
        self.rules = rules
        self.state = state
        self.limits = limits
        self.to = state.transfer.sending.to
        self.mission_type = state.transfer.sending.mission_type
        self.result: UploadResult | None = None
        self.error: RuleError | None = None
        self.outbox: list[Message] = []
        self.message: Message = None
        self.order_text = ""
        self.downloaded: tuple[Item, ...] | None = None
        self.has_succeeded = False
        self._encode = encode
        self._flight = flight
        self._own = own

    # ------------------------------------------------------------ queries

    @property
    def stage(self) -> Stage:
        """Present stage."""
        return self.state.now.stage

    @property
    def items(self) -> tuple[Item, ...]:
        """Items to upload."""
        return self.state.transfer.sending.items

    @property
    def is_mission(self) -> bool:
        """True for a mission, False for fences and rally points."""
        return self._flight is not None

    @property
    def flight(self) -> Flight:
        """The vehicle in flight, for missions only."""
        assert self._flight is not None
        return self._flight

    @property
    def mode(self) -> str:
        """Mode of the vehicle by its last heartbeat; empty if it is unknown."""
        return "" if self._flight is None else self._flight.authority.mode

    @property
    def is_atomic(self) -> bool:
        """True if the vehicle replaces its list as a whole, at its end, as it does with fences."""
        return self._flight is None or self._flight.profile.atomic

    @property
    def is_inconsistent(self) -> bool:
        """True if the onboard mission may be inconsistent now."""
        return self.state.verification.onboard is OnboardState.UNKNOWN and not self.is_atomic

    @property
    def is_unselected(self) -> bool:
        """True if the new mission is stored, and AUTO would continue it at the old item's number."""
        is_equal = self.state.verification.onboard is OnboardState.EQUAL
        return is_equal and not self.state.activation.is_selected

    @property
    def window(self) -> int:
        """Items or requests that may be in flight."""
        flight = self._flight
        vehicle = self.state.vehicle
        return 1 if flight is None else min(flight.profile.window, flight.policy.max_items_in_flight(vehicle))

    def may_send(self, t_ns: int) -> bool:
        """Return True if the request of the stage, or an item again, may be sent now."""
        guard = self.rules.stages[self.stage].may_send
        return guard is None or guard(self, t_ns)

    def slowness(self, t_ns: int) -> dict[str, Parameter]:
        """Return what an upload waits for, once it takes long, at growing intervals; else nothing.

        These are the parameters of `NoticeCode.UPLOAD_SLOW`.
        """
        state = self.state
        slow_s = self.limits.slow_s
        took_s = (t_ns - state.began_t_ns) / NS_PER_S
        if self.stage in (Stage.NEW, Stage.DONE) or took_s < max(slow_s, 3.0 * state.told_s):
            return {}
        state.told_s = took_s
        waits_for = self.reason_of(self.rules.stages[self.stage].waits_for)
        silence = "" if state.heartbeats.is_heard(slow_s, t_ns) else ", no heartbeat heard"
        return {"took_s": took_s, "waits_for": f"{waits_for}{silence}", "before": state.reason}

    def report(self) -> UploadReport:
        """Return the result of a mission that has ended."""
        assert self.result is not None
        end = self.result
        state = self.state
        return UploadReport(
            t_ns=end.t_ns,
            vehicle=state.vehicle,
            mission_id=state.mission_id,
            items=len(self.items),
            ok=end.ok,
            detail=end.detail,
            duration_s=end.duration_s,
            retries=end.retries,
        )

    def reason_of(self, text: str) -> str:
        """Return a text with the facts that it names."""
        now = self.state.now
        transfer = self.state.transfer
        verification = self.state.verification
        items = f"{now.most_items} of {len(self.items)} items"
        return text.format(
            items=items,
            stall=f" at {items} for {self.limits.stall_s:.0f} s",
            sent=transfer.sending.sent_count,
            failure="" if now.failure is None else now.failure[1],
            uploads=f" after {transfer.uploads} uploads" if transfer.uploads > 1 else "",
            difference=verification.difference,
            times=verification.same_differences,
            limit_s=self.limits.transfer_timeout_s,
            before=self.state.reason or now.stage,
            order=self.order_text,
            list=LIST_NAMES.get(self.mission_type, "mission"),
            count=transfer.uploads,
            repair="; do not choose AUTO before it is repaired",
            takeover=self._flight.authority.takeover if self._flight is not None else "",
            equal="read back equal" if self.items else "cleared",
            found=len(self.downloaded or ()),
        )

    # ------------------------------------------------------------ orders, messages and time

    def order(self, event: Event, t_ns: int, reason: str = "") -> list[bytes]:
        """Carry out an order; return the frames to send."""
        self.order_text = reason
        self.fire(event, t_ns)
        return self._take_frames(t_ns)

    def receive(self, message: Message, t_ns: int) -> list[bytes]:
        """Process a message of the vehicle; return the frames to send."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if self.stage in (Stage.NEW, Stage.DONE) or sender != self.to:
            return []
        event = message_event(self.state, self._flight, message, t_ns)
        if event is None:
            return []
        if event is Event.OVERRIDE or is_meant(message, self.mission_type, self._own):
            self.message = message
            self.fire(event, t_ns)
        return self._take_frames(t_ns)

    def poll(self, t_ns: int) -> list[bytes]:
        """Advance the timers; return the frames to send."""
        if self.stage in (Stage.NEW, Stage.DONE):
            return []
        if self._flight is not None and self._flight.authority.taken_by:
            self.fire(Event.OVERRIDE, t_ns)
            return self._take_frames(t_ns)
        if self.mode == AUTO:
            self.fire(Event.IN_AUTO, t_ns)
        self.fire(time_event(self.state, self.limits, self._flight, t_ns), t_ns)
        return self._take_frames(t_ns)

    # ------------------------------------------------------------ rules

    def fire(self, event: Event, t_ns: int) -> None:
        """Carry out the rule for an event. Without one the upload ends as failed."""
        try:
            self._follow(self.stage, event, t_ns)
        except RuleError as error:
            self.end_after_error(error, t_ns)

    def _follow(self, source: Source, event: Event | None, t_ns: int) -> None:
        for rule in self.rules.table.get((source, event), ()):
            if rule.guard is None or rule.guard(self, t_ns):
                break
        else:
            raise RuleError(source, event)
        # After the last upload its failure stays the reason.
        if rule.why and not (rule.target is Choice.RETRY and self.state.transfer.is_exhausted):
            self.state.reason = self.reason_of(rule.why)
        if rule.action is not None:
            rule.action(self, t_ns)
        if isinstance(rule.target, Choice):
            self._follow(rule.target, None, t_ns)
        elif rule.target is not None:
            self._enter(rule.target, t_ns)

    def _enter(self, stage: Stage, t_ns: int) -> None:
        self.state.now = StageState(stage, t_ns, progress_t_ns=t_ns)
        if stage is Stage.DONE:
            self._end(t_ns)
        else:
            self.rules.stages[stage].enter(self, t_ns)

    def _end(self, t_ns: int) -> None:
        state = self.state
        ok = self.has_succeeded
        self.result = UploadResult(
            t_ns=t_ns,
            ok=ok,
            onboard=state.verification.onboard,
            detail=state.reason,
            duration_s=(t_ns - state.began_t_ns) / NS_PER_S,
            retries=state.rtt.retransmissions,
            was_held=state.heartbeats.loiter_t_ns is not None and (ok or self.mode != AUTO),
            selected=state.activation.is_selected,
            items=self.downloaded,
        )

    def end_after_error(self, error: RuleError, t_ns: int) -> None:
        """End at once after a programming error: what is stored counts as unknown, whatever was verified."""
        self.error = error
        self.outbox.clear()
        self.downloaded = None
        if self.is_atomic and self.stage in (Stage.UPLOAD, Stage.VERIFY):
            self.outbox.append(self.ack(dialect.MAV_MISSION_OPERATION_CANCELLED))
        if self.state.transfer.uploads:
            self.state.verification.onboard = OnboardState.UNKNOWN
        self.state.reason = f"program error in its upload ({error}); what is stored is unknown"
        self._enter(Stage.DONE, t_ns)

    # ------------------------------------------------------------ messages to the vehicle

    def ask(
        self, request: Message, t_ns: int, *, pause_s: float = 0.0, policy: RetryPolicy | None = None
    ) -> None:
        """Send the request of the stage, after a pause, and again until it is answered."""
        policy = policy or self.state.rtt.retry_policy(self.limits.max_tries, self.limits.min_answer_s)
        self.state.now.request = RetryTimer(request, policy, t_ns + ns(pause_s))

    def ack(self, result: int) -> Message:
        """Return the MISSION_ACK with a result."""
        return dialect.MAVLink_mission_ack_message(*self.to, result, self.mission_type)

    def mode_command(self, name: str) -> Message:
        """Return the command of a mode, and note it as ours."""
        self.flight.authority.note_command(name)
        return set_mode(self.state.vehicle, self.flight.profile.autopilot, name)

    def message_request(self, number: int) -> Message:
        """Return the request for a message that otherwise comes once a second."""
        return command_long(self.state.vehicle, REQUEST_MESSAGE, number)

    def _take_frames(self, t_ns: int) -> list[bytes]:
        """Return the frames that are due."""
        now = self.state.now
        if now.request is not None and self.may_send(t_ns) and now.request.start_try(t_ns):
            self._try_request(now.request)
        if now.download is not None:
            self.outbox += now.download.poll(t_ns, self.state.rtt, self.window)
        messages = list(self.outbox)
        self.outbox.clear()
        if any(one.get_type() == "COMMAND_LONG" and one.command == SET_MODE for one in messages):
            messages.append(self._heartbeat_request(t_ns))
        if self.is_mission and now.stage not in (Stage.NEW, Stage.DIAGNOSE, Stage.DONE):
            messages += self._heartbeat_requests(t_ns)
        return [self._encode(message) for message in messages]

    def _try_request(self, timer: RetryTimer) -> None:
        """Send the request of the stage. A PX4 shows its current item at 1 Hz: no repeat is a resend."""
        is_selection = self.stage is Stage.SELECT
        copies = self.state.rtt.copies if timer.sent > 1 else 1
        self.state.rtt.retransmissions += timer.sent > 1 and not (is_selection and self.is_atomic)
        if is_selection and self.is_atomic:  # Without it PX4 ignores the selection for 5 s.
            self.outbox.append(self.ack(dialect.MAV_MISSION_ACCEPTED))
        self.outbox += [timer.request] * copies
        if is_selection:
            self.outbox += [self.message_request(dialect.MAVLINK_MSG_ID_MISSION_CURRENT)] * copies
        if self.stage is Stage.UPLOAD:
            self._note_upload_begun()

    def _note_upload_begun(self) -> None:
        """Note that the vehicle may have begun to change its onboard mission."""
        self.state.activation.is_selected = self.is_atomic
        if self.state.verification.onboard is not OnboardState.UNKNOWN:
            self.state.verification.onboard = OnboardState.UNKNOWN
            self.state.activation.current_before = self.state.activation.current

    def _heartbeat_requests(self, t_ns: int) -> list[Message]:
        """Return the requests for a heartbeat that are due; it shows the mode, otherwise once a second."""
        heartbeats = self.state.heartbeats
        rtt = self.state.rtt
        if self.may_send(t_ns):
            asked_t_ns: int | None = max(heartbeats.asked_t_ns or 0, heartbeats.heard_t_ns or 0)
            copies = 1
            wait_s = self.limits.mode_period_s
        else:
            asked_t_ns = heartbeats.asked_t_ns
            grown_s = rtt.wait_s * _HEARTBEAT_GROWTH ** max(0, heartbeats.tries - 1)
            copies = rtt.copies
            wait_s = min(grown_s, _MAX_HEARTBEAT_WAIT_S)
        if asked_t_ns is not None and t_ns - asked_t_ns < ns(wait_s):
            return []
        return [self._heartbeat_request(t_ns)] * copies

    def _heartbeat_request(self, t_ns: int) -> Message:
        self.state.heartbeats.asked_t_ns = t_ns
        self.state.heartbeats.tries += 1
        return self.message_request(dialect.MAVLINK_MSG_ID_HEARTBEAT)
