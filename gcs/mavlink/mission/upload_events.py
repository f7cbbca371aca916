"""Events of an upload: which one a message of the vehicle is, and which one the time brings."""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots.modes import LOITER
from gcs.mavlink.frames.codec import Message, is_for
from gcs.mavlink.mission.upload_limits import UploadLimits
from gcs.mavlink.mission.upload_stages import Event, OnboardState, Stage
from gcs.mavlink.mission.upload_state import Flight, UploadState
from gcs.mavlink.services.retry import ns

_EVENTS: Final = {
    "HEARTBEAT": Event.HEARTBEAT,
    "MISSION_REQUEST": Event.MISSION_REQUEST,
    "MISSION_REQUEST_INT": Event.MISSION_REQUEST,
    "MISSION_ACK": Event.MISSION_ACK,
    "MISSION_COUNT": Event.MISSION_COUNT,
    "MISSION_ITEM_INT": Event.MISSION_ITEM,
    "MISSION_CURRENT": Event.MISSION_CURRENT,
    "COMMAND_ACK": Event.COMMAND_ACK,
}


def message_event(state: UploadState, flight: Flight | None, message: Message, t_ns: int) -> Event | None:
    """Return the event of a message, and note the mode or the current item that it shows.

    While another mode was chosen, or is commanded, all are the event `override`; but MISSION_CURRENT may
    show that the vehicle has chosen the mode itself.
    """
    event = _EVENTS.get(message.get_type())
    if flight is None:
        return event
    if event is Event.HEARTBEAT:
        _observe_heartbeat(state, flight, message, t_ns)
    is_cause = event is Event.MISSION_CURRENT and state.now.stage is Stage.DIAGNOSE
    if flight.authority.taken_by and not is_cause:
        return Event.OVERRIDE
    if event is Event.MISSION_CURRENT:
        _observe_current(state, flight, message)
    return event


def time_event(state: UploadState, limits: UploadLimits, flight: Flight | None, t_ns: int) -> Event:
    """Return the wait that is over; else the event `tick`."""
    now = state.now
    is_transfer = now.stage in (Stage.UPLOAD, Stage.VERIFY)
    is_silent = flight is not None and state.is_silent(limits.min_answer_s, t_ns)
    waits = (
        (Event.OVERTIME, is_transfer and t_ns - state.began_t_ns > ns(limits.transfer_timeout_s)),
        (Event.FAILED, now.failure is not None and t_ns >= now.failure[0]),
        (Event.OVERDUE, now.deadline_t_ns is not None and t_ns >= now.deadline_t_ns),
        (Event.STALLED, now.is_stalled(limits.stall_s, t_ns)),
        (Event.UNANSWERED, is_silent or now.is_exhausted(t_ns)),
    )
    return next((event for event, is_over in waits if is_over), Event.TICK)


def is_meant(message: Message, mission_type: int, own: tuple[int, int]) -> bool:
    """Return True unless a message is for another station, or about another list; an ACK may be for all."""
    name = message.get_type()
    if name in ("HEARTBEAT", "MISSION_CURRENT"):
        return True
    is_ours = (message.target_system, message.target_component) == own
    if name in ("MISSION_ACK", "COMMAND_ACK"):
        is_ours = is_for(message, own)
    return bool(is_ours and getattr(message, "mission_type", mission_type) == mission_type)


def _observe_heartbeat(state: UploadState, flight: Flight, message: Message, t_ns: int) -> None:
    state.heartbeats.heard_t_ns = t_ns
    state.heartbeats.tries = 0
    at_end = flight.profile.ends_in == LOITER and _is_at_old_end(state)
    flight.authority.observe_heartbeat(message, flight.profile, t_ns, at_end=at_end)


def _is_at_old_end(state: UploadState) -> bool:
    """Return True if a vehicle flies the last item of its old mission.

    From MISSION_COUNT on it is not known whether a number is that of an old or of a new item.
    """
    old = state.verification.old
    onboard = state.verification.onboard
    return old is not None and onboard is OnboardState.OLD and state.activation.current == len(old) - 1


def _observe_current(state: UploadState, flight: Flight, message: Message) -> None:
    """Note the current item. ArduPlane answers the selection of its first item with 0."""
    activation = state.activation
    activation.has_no_mission = message.mission_state == dialect.MISSION_STATE_NO_MISSION
    if activation.current_before is None:
        activation.current_before = message.seq
    is_selection = state.now.stage is Stage.SELECT and activation.first_seq == flight.profile.home_items
    is_echo = is_selection and message.seq == 0 and activation.current_before != 0
    activation.current = activation.first_seq if is_echo else message.seq
