"""Guards of an upload's rules: questions about its state, the vehicle, and the message being processed."""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.mission.upload import Upload
from gcs.mavlink.mission.upload_stages import OnboardState, Stage
from gcs.mavlink.services.command_sender import SET_MODE
from gcs.mavlink.services.retry import ns

_COMPLETE: Final = (dialect.MAV_MISSION_ACCEPTED, dialect.MAV_MISSION_ERROR)
_NOT_FINAL: Final = (dialect.MAV_MISSION_ACCEPTED, dialect.MAV_MISSION_INVALID_SEQUENCE)
_UNSUPPORTED: Final = (dialect.MAV_MISSION_UNSUPPORTED, dialect.MAV_MISSION_UNSUPPORTED_FRAME)
_OBEYED: Final = (dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_IN_PROGRESS)


# ---------------------------------------------------------------- what may be sent


def has_recent_heartbeat(upload: Upload, t_ns: int) -> bool:
    return upload.state.heartbeats.is_heard(upload.limits.max_mode_age_s, t_ns)


def has_new_heartbeat(upload: Upload, t_ns: int) -> bool:
    """Return True right after a heartbeat that is newer than the stage and the last try of its request."""
    request = upload.state.now.request
    since_t_ns = upload.state.now.since_t_ns
    if request is not None and request.sent:
        since_t_ns = request.sent_t_ns + 1
    return (upload.state.heartbeats.heard_t_ns or 0) >= since_t_ns and has_recent_heartbeat(upload, t_ns)


def may_transfer(upload: Upload, t_ns: int) -> bool:
    """Return True unless MISSION_COUNT, or the last item of an atomic upload, waits for a heartbeat."""
    transfer = upload.state.transfer
    is_last = transfer.holds_last_item or transfer.sending.requested_seq == len(upload.items) - 1
    changes = upload.state.now.request is not None or (upload.is_atomic and is_last)
    return not changes or has_recent_heartbeat(upload, t_ns)


def has_heartbeat(upload: Upload, t_ns: int) -> bool:
    return upload.state.heartbeats.is_heard(upload.limits.max_hold_age_s, t_ns)


# ---------------------------------------------------------------- the vehicle


def is_in_auto(upload: Upload, _t_ns: int) -> bool:
    return upload.mode == AUTO


def is_waiting(upload: Upload, _t_ns: int) -> bool:
    """Return True if the last heartbeat showed a mode of ours other than AUTO."""
    return upload.mode not in ("", AUTO)


def is_near_next_item(upload: Upload, t_ns: int) -> bool:
    return upload.flight.policy.time_to_next_s(upload.state.vehicle, t_ns) < upload.limits.guard_s


def must_wait_first(upload: Upload, t_ns: int) -> bool:
    """Return True if an upload in place would begin right before the vehicle takes its next item."""
    return not upload.is_atomic and not is_waiting(upload, t_ns) and is_near_next_item(upload, t_ns)


def would_jump(upload: Upload, t_ns: int) -> bool:
    return not upload.state.activation.is_selected and is_near_next_item(upload, t_ns)


def is_loiter_due(upload: Upload, t_ns: int) -> bool:
    """Return True if LOITER is due: near the next item, after it, or after an earlier LOITER command."""
    activation = upload.state.activation
    loiter_t_ns = upload.state.heartbeats.loiter_t_ns
    if not upload.is_inconsistent or not has_heartbeat(upload, t_ns):
        return False
    if loiter_t_ns is not None:
        return t_ns - loiter_t_ns >= ns(upload.limits.loiter_repeat_s)
    moved_on = activation.current is not None and activation.current != activation.current_before
    return moved_on or is_near_next_item(upload, t_ns)


def is_silent(upload: Upload, t_ns: int) -> bool:
    return not upload.state.heartbeats.is_heard(upload.limits.min_answer_s, t_ns)


def may_be_rejection(upload: Upload, _t_ns: int) -> bool:
    """Return True if the vehicle may be in Hold because its navigator rejects the mission just stored."""
    authority = upload.flight.authority
    is_stored = upload.is_atomic and upload.state.transfer.may_be_stored
    return is_stored and authority.taken_by == LOITER and not authority.record.in_failsafe


def may_still_be_rejection(upload: Upload, t_ns: int) -> bool:
    is_early = t_ns - upload.state.now.since_t_ns <= ns(upload.limits.rejection_s)
    return is_early and may_be_rejection(upload, t_ns)


def has_no_mission(upload: Upload, _t_ns: int) -> bool:
    """Return True if the vehicle's navigator rejects the mission, so that none is valid."""
    return upload.is_atomic and upload.state.activation.has_no_mission


# ---------------------------------------------------------------- the transfer


def is_pausing(upload: Upload, _t_ns: int) -> bool:
    """Return True if the message still belongs to the stage before."""
    return upload.state.now.request is not None and not upload.state.now.request.sent


def must_hold_last_item(upload: Upload, t_ns: int) -> bool:
    is_last = upload.message.seq == len(upload.items) - 1
    return is_last and upload.is_mission and upload.is_atomic and not has_recent_heartbeat(upload, t_ns)


def holds_last_item(upload: Upload, _t_ns: int) -> bool:
    return upload.state.transfer.holds_last_item


def is_all_acked(upload: Upload, _t_ns: int) -> bool:
    """Return True if the vehicle has all items: it says ACCEPTED, or ERROR of an item too many."""
    return upload.state.transfer.sending.is_all_sent and upload.message.type in _COMPLETE


def is_failure(upload: Upload, t_ns: int) -> bool:
    """Return True if an ACK ends the transfer, unless a request follows. 13 only answers a duplicate."""
    return upload.message.type not in _NOT_FINAL and not is_pausing(upload, t_ns)


def is_unsupported(upload: Upload, t_ns: int) -> bool:
    return is_failure(upload, t_ns) and upload.message.type in _UNSUPPORTED


def is_all_sent(upload: Upload, _t_ns: int) -> bool:
    return upload.state.transfer.sending.is_all_sent


def may_resend(upload: Upload, t_ns: int) -> bool:
    return upload.state.now.failure is None and upload.may_send(t_ns)


def may_stall_again(upload: Upload, _t_ns: int) -> bool:
    return upload.state.transfer.stalls + 1 < upload.limits.max_stalls


def has_uploads_left(upload: Upload, _t_ns: int) -> bool:
    return upload.state.transfer.uploads < upload.limits.max_uploads


def has_clearings_left(upload: Upload, t_ns: int) -> bool:
    return is_list_empty(upload, t_ns) and has_uploads_left(upload, t_ns)


def is_exhausted(upload: Upload, _t_ns: int) -> bool:
    return upload.state.transfer.is_exhausted


def is_uploading(upload: Upload, _t_ns: int) -> bool:
    return upload.stage is Stage.UPLOAD


# ---------------------------------------------------------------- the read-back


def lacks_items(upload: Upload, _t_ns: int) -> bool:
    sending = upload.state.transfer.sending
    return not sending.acked and upload.message.seq < sending.sent_count


def is_settled(upload: Upload, t_ns: int) -> bool:
    return t_ns - upload.state.now.since_t_ns > ns(upload.limits.settle_s)


def is_error(upload: Upload, _t_ns: int) -> bool:
    return upload.message.type == dialect.MAV_MISSION_ERROR


def is_incomplete(upload: Upload, _t_ns: int) -> bool:
    download = upload.state.now.download
    return download is None or not download.is_complete


def is_equal(upload: Upload, _t_ns: int) -> bool:
    return not upload.state.verification.difference


def is_equal_in_auto(upload: Upload, t_ns: int) -> bool:
    """Return True if the list reads back equal while a LOITER command may be on its way."""
    is_commanded = upload.state.heartbeats.loiter_t_ns is not None
    return is_equal(upload, t_ns) and is_commanded and is_in_auto(upload, t_ns)


def is_old_at_last(upload: Upload, t_ns: int) -> bool:
    """Return True if the mission before reads back equal after the last upload."""
    return is_exhausted(upload, t_ns) and is_old(upload, t_ns)


def may_differ_again(upload: Upload, _t_ns: int) -> bool:
    return upload.state.verification.same_differences < upload.limits.max_same_differences


def is_download(upload: Upload, _t_ns: int) -> bool:
    return not upload.state.transfer.uploads


def is_list_empty(upload: Upload, _t_ns: int) -> bool:
    return not upload.items


# ---------------------------------------------------------------- selection and mode


def is_verified(upload: Upload, _t_ns: int) -> bool:
    return upload.state.verification.onboard is OnboardState.EQUAL


def is_old(upload: Upload, _t_ns: int) -> bool:
    return upload.state.verification.onboard is OnboardState.OLD


def is_unselected(upload: Upload, _t_ns: int) -> bool:
    return upload.is_unselected


def is_selected(upload: Upload, t_ns: int) -> bool:
    """Return True if MISSION_CURRENT answers the selection.

    The vehicle may have flown to an item of this number before: that is no answer to what was not sent.
    With atomic uploads it has begun the new mission there already.
    """
    activation = upload.state.activation
    is_answer = is_settled(upload, t_ns) and not is_pausing(upload, t_ns)
    is_new = upload.message.seq != activation.current_before or is_answer
    return activation.current == activation.first_seq and (upload.is_atomic or is_new)


def lacks_auto(upload: Upload, t_ns: int) -> bool:
    """Return True unless the heartbeat shows AUTO, and no older one than a LOITER command of ours."""
    may_be_older = upload.state.heartbeats.loiter_t_ns is not None and is_pausing(upload, t_ns)
    return upload.mode != AUTO or may_be_older


def is_obeyed(upload: Upload, _t_ns: int) -> bool:
    return upload.message.command != SET_MODE or upload.message.result in _OBEYED


def may_refuse_again(upload: Upload, t_ns: int) -> bool:
    is_early = t_ns - upload.state.now.since_t_ns < ns(upload.limits.settle_s)
    return is_early or upload.state.now.refusals + 1 < upload.limits.max_refusals


# ---------------------------------------------------------------- the end without the new mission


def is_inconsistent(upload: Upload, _t_ns: int) -> bool:
    return upload.is_inconsistent


def is_whole(upload: Upload, _t_ns: int) -> bool:
    return not upload.is_inconsistent and not upload.state.verification.is_rejected


def must_be_removed(upload: Upload, _t_ns: int) -> bool:
    """Return True if the onboard mission must not be flown while another service commands the vehicle.

    Both may have written items of one transfer: in place, or up to the last item of an atomic one. A PX4
    counts the items of the service that was first. In another mode than AUTO and LOITER the mission is left
    as it is: an RTL may follow its landing.
    """
    is_written = not upload.is_atomic or upload.state.transfer.may_be_stored
    is_unread = upload.state.verification.onboard is OnboardState.UNKNOWN
    is_others = bool(upload.flight.authority.taken_by) or upload.mode not in ("", AUTO, LOITER)
    return not is_others and (upload.is_unselected or (is_written and is_unread))


def may_resume(upload: Upload, t_ns: int) -> bool:
    return is_old(upload, t_ns) and upload.state.heartbeats.loiter_t_ns is not None


def is_clearing_acked(upload: Upload, t_ns: int) -> bool:
    """Return True if MISSION_CLEAR_ALL is acknowledged, for the first time in this stage."""
    is_accepted = upload.message.type == dialect.MAV_MISSION_ACCEPTED
    return is_accepted and is_clearing_unacked(upload, t_ns) and not is_pausing(upload, t_ns)


def is_clearing_unacked(upload: Upload, _t_ns: int) -> bool:
    return upload.state.now.download is None


def is_cleared(upload: Upload, _t_ns: int) -> bool:
    return bool(upload.message.count <= upload.flight.profile.home_items)


def may_clear_again(upload: Upload, _t_ns: int) -> bool:
    return upload.state.clearing.acknowledged < upload.limits.max_clearings
