"""Actions of an upload's rules: what is sent, and what is noted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.mission.geofence_rally import list_difference
from gcs.mavlink.mission.item_transfer import MissionDownload
from gcs.mavlink.mission.items import Item
from gcs.mavlink.mission.upload import Upload
from gcs.mavlink.mission.upload_stages import OnboardState, Stage
from gcs.mavlink.services.command_sender import set_current_item
from gcs.mavlink.services.retry import ns

_CANCELLED: Final = dialect.MAV_MISSION_OPERATION_CANCELLED


# ---------------------------------------------------------------- entering a stage


def command_loiter(upload: Upload, t_ns: int) -> None:
    upload.state.heartbeats.loiter_t_ns = t_ns
    upload.ask(upload.mode_command(LOITER), t_ns, policy=upload.limits.loiter_retry)


def begin_upload(upload: Upload, t_ns: int) -> None:
    """Send MISSION_COUNT; or go on with an upload of which the vehicle lacks the last items."""
    transfer = upload.state.transfer
    if transfer.sending.sent_count:
        _send_item(upload, upload.message.seq, t_ns)
        return
    pause_s = upload.limits.pause_s(transfer.uploads)
    transfer.uploads += 1
    if upload.is_mission:
        transfer.first_seq = _first_item(upload) if upload.flight.profile.marks_current else -1
    upload.ask(transfer.sending.count_message(), t_ns, pause_s=pause_s)


def read_back(upload: Upload, t_ns: int) -> None:
    in_order = upload.state.transfer.sending.in_order
    upload.state.now.request = None
    upload.state.now.download = MissionDownload.begin(
        upload.to, upload.state.rtt, t_ns, upload.mission_type, in_order=in_order
    )


def select_first_item(upload: Upload, t_ns: int) -> None:
    activation = upload.state.activation
    activation.current_before = activation.current
    activation.first_seq = _first_item(upload)
    activation.leg_t_ns = t_ns
    upload.ask(set_current_item(upload.state.vehicle, upload.flight.profile, activation.first_seq), t_ns)


def command_auto(upload: Upload, t_ns: int) -> None:
    upload.ask(upload.mode_command(AUTO), t_ns)


def request_state(upload: Upload, _t_ns: int) -> None:
    upload.outbox.append(upload.message_request(dialect.MAVLINK_MSG_ID_MISSION_CURRENT))


def clear_mission(upload: Upload, t_ns: int) -> None:
    clearing = upload.state.clearing
    clearing.has_begun = True
    upload.state.verification.onboard = OnboardState.UNKNOWN  # the answer may be lost
    pause_s = upload.limits.pause_s(clearing.acknowledged + 1) if clearing.acknowledged else 0.0
    upload.ask(
        dialect.MAVLink_mission_clear_all_message(*upload.to, upload.mission_type), t_ns, pause_s=pause_s
    )


def clear_list(upload: Upload, t_ns: int) -> None:
    """Send MISSION_CLEAR_ALL in place of an empty list, as one upload."""
    upload.state.transfer.uploads += 1
    clear_mission(upload, t_ns)


# ---------------------------------------------------------------- the transfer


def send_item(upload: Upload, t_ns: int) -> None:
    _send_item(upload, upload.message.seq, t_ns)


def send_last_item(upload: Upload, t_ns: int) -> None:
    _send_item(upload, len(upload.items) - 1, t_ns)


def _send_item(upload: Upload, seq: int, t_ns: int) -> None:
    state = upload.state
    limits = upload.limits
    now = state.now
    transfer = state.transfer
    transfer.holds_last_item = False
    items = transfer.sending.answer_request(seq, t_ns, state.rtt, transfer.first_seq)
    if not items:
        return
    now.note_items(seq + 1, t_ns)
    if now.request is not None:
        state.rtt.add_sample(now.request.round_trip_s(t_ns))
    now.request = now.failure = None
    is_all_sent = transfer.sending.is_all_sent
    now.deadline_t_ns = t_ns + ns(limits.ack_timeout_s if is_all_sent else limits.request_timeout_s)
    transfer.may_be_stored |= is_all_sent
    upload.outbox += items


def hold_last_item(upload: Upload, t_ns: int) -> None:
    upload.state.transfer.holds_last_item = True
    upload.state.now.deadline_t_ns = t_ns + ns(upload.limits.request_timeout_s)


def resend_items(upload: Upload, t_ns: int) -> None:
    transfer = upload.state.transfer
    upload.outbox += transfer.sending.poll(t_ns, upload.state.rtt, transfer.first_seq, upload.window)


def note_acked(upload: Upload, _t_ns: int) -> None:
    upload.state.transfer.sending.acked = upload.message.type == dialect.MAV_MISSION_ACCEPTED


def await_request(upload: Upload, t_ns: int) -> None:
    """Note a failure ACK, which counts unless the vehicle requests an item soon."""
    sent = upload.state.transfer.sending.sent_count
    total = len(upload.items)
    answer = result_name("MAV_MISSION_RESULT", upload.message.type)
    failure = (
        t_ns + ns(upload.limits.settle_s),
        f"the vehicle answered {answer}, {sent} of {total} items sent",
    )
    upload.state.now.failure = upload.state.now.failure or failure


def note_unsupported(upload: Upload, _t_ns: int) -> None:
    answer = result_name("MAV_MISSION_RESULT", upload.message.type).removeprefix("MISSION_")
    upload.state.reason = f"the vehicle does not support it: {answer}"


def count_stall(upload: Upload, _t_ns: int) -> None:
    upload.state.transfer.stalls += 1


def restart_transfer(upload: Upload, t_ns: int) -> None:
    cancel_transfer(upload, t_ns)
    upload.state.rtt.retransmissions += 1
    upload.state.transfer.sending.restart()
    upload.state.transfer.holds_last_item = False


def note_last_upload(upload: Upload, _t_ns: int) -> None:
    upload.state.transfer.is_exhausted = True


def cancel_transfer(upload: Upload, _t_ns: int) -> None:
    """Send the ACK that ends a transfer early, for firmwares where MISSION_COUNT does not."""
    is_cut = upload.stage is Stage.DIAGNOSE and upload.state.verification.onboard is OnboardState.UNKNOWN
    if upload.is_atomic and (is_cut or upload.stage in (Stage.UPLOAD, Stage.VERIFY)):
        upload.outbox.append(upload.ack(_CANCELLED))


# ---------------------------------------------------------------- the read-back


def add_count(upload: Upload, t_ns: int) -> None:
    assert upload.state.now.download is not None
    upload.state.now.download.add_count(upload.message, t_ns, upload.state.rtt)
    _compare_if_complete(upload, upload.state.now.download)


def add_item(upload: Upload, t_ns: int) -> None:
    download = upload.state.now.download
    assert download is not None
    download.add_item(upload.message, t_ns, upload.state.rtt)
    upload.state.now.note_items(len(download.received), t_ns)
    _compare_if_complete(upload, download)


def _compare_if_complete(upload: Upload, download: MissionDownload) -> None:
    if not download.is_complete:
        return
    upload.outbox.append(download.ack_message())
    upload.downloaded = tuple(download.items)
    verification = upload.state.verification
    difference = _difference(upload, upload.items, upload.downloaded)
    is_old = verification.old is not None and not _difference(upload, verification.old, upload.downloaded)
    verification.is_rejected = bool(difference) and not is_old
    verification.onboard = OnboardState.OLD if is_old else OnboardState.UNKNOWN
    if not difference:
        verification.onboard = OnboardState.EQUAL
    is_same = difference == verification.difference
    verification.same_differences = verification.same_differences + 1 if is_same else 1
    verification.difference = difference


def _difference(upload: Upload, wanted: Sequence[Item], found: Sequence[Item]) -> str:
    if not upload.is_mission:
        return list_difference(upload.mission_type, wanted, found)
    return upload.flight.profile.difference(wanted, found)


def restart_download(upload: Upload, t_ns: int) -> None:
    assert upload.state.now.download is not None
    upload.state.now.download.restart_if_in_order(t_ns, upload.state.rtt)


# ---------------------------------------------------------------- selection and mode


def command_loiter_once(upload: Upload, t_ns: int) -> None:
    upload.state.heartbeats.loiter_t_ns = t_ns
    upload.outbox.append(upload.mode_command(LOITER))


def note_selected(upload: Upload, t_ns: int) -> None:
    """Note that the vehicle flies its stored mission, in AUTO since its selection."""
    if upload.mode != AUTO:
        upload.state.activation.leg_t_ns = t_ns
    upload.state.activation.is_selected = True


def note_refusal(upload: Upload, _t_ns: int) -> None:
    upload.state.now.refusals += 1
    upload.state.reason = f"AUTO refused: {result_name('MAV_RESULT', upload.message.result)}"


def reject(upload: Upload, t_ns: int) -> None:
    """Note that the vehicle's navigator rejects the mission: the mode is not an override."""
    upload.flight.authority.note_rejection(t_ns)
    upload.state.verification.is_rejected = True
    upload.state.activation.is_unflyable = True


def _first_item(upload: Upload) -> int:
    first = upload.flight.policy.first_item(upload.state.vehicle)
    return min(max(upload.flight.profile.home_items, first), len(upload.items) - 1)


def note_success(upload: Upload, _t_ns: int) -> None:
    upload.has_succeeded = True


def start_clock(upload: Upload, t_ns: int) -> None:
    """Begin all waits: an outage of the service counts for none. The mode is waited for."""
    upload.state.began_t_ns = t_ns
    upload.state.now.since_t_ns = upload.state.now.progress_t_ns = t_ns
    upload.state.heartbeats.heard_t_ns = None


def note_reboot(upload: Upload, _t_ns: int) -> None:
    """Forget the current item, and what was read back: the vehicle may have lost it by its reboot."""
    if upload.state.verification.onboard is OnboardState.EQUAL:
        upload.state.verification.onboard = OnboardState.UNKNOWN
    upload.state.activation.current = None
    upload.state.heartbeats.heard_t_ns = None


# ---------------------------------------------------------------- the end without the new mission


def distrust(upload: Upload, t_ns: int) -> None:
    """Note that the onboard mission must not be flown, whole or not."""
    cancel_transfer(upload, t_ns)
    upload.state.verification.is_rejected = True


def keep_mission(upload: Upload, t_ns: int) -> None:
    cancel_transfer(upload, t_ns)
    verification = upload.state.verification
    verification.onboard = (
        OnboardState.OLD if verification.onboard is OnboardState.OLD else OnboardState.WHOLE
    )


def count_items_left(upload: Upload, t_ns: int) -> None:
    upload.state.clearing.acknowledged += 1
    read_back(upload, t_ns)


def note_cleared(upload: Upload, _t_ns: int) -> None:
    upload.state.verification.onboard = OnboardState.CLEARED
    if upload.is_atomic:  # Without it PX4 accepts no upload for 5 s.
        upload.outbox.append(upload.ack(dialect.MAV_MISSION_ACCEPTED))


def note_items_left(upload: Upload, _t_ns: int) -> None:
    left = upload.message.count - upload.flight.profile.home_items
    clearings = upload.state.clearing.acknowledged
    upload.state.reason += (
        f"; {left} items left by {clearings} acknowledged clearings: the vehicle does not obey"
    )


def stop_overridden(upload: Upload, t_ns: int) -> None:
    """Send nothing any more. Only a PX4 is told, so that its old mission stays."""
    upload.outbox.clear()
    cancel_transfer(upload, t_ns)
    verification = upload.state.verification
    if upload.is_atomic and verification.onboard is OnboardState.UNKNOWN:
        may_be_new = upload.state.transfer.may_be_stored
        verification.onboard = OnboardState.WHOLE if may_be_new else OnboardState.OLD


def result_name(enum: str, value: int) -> str:
    """Return the name of a value of a MAVLink enum, without its prefix; the number if it is unknown."""
    entry = dialect.enums[enum].get(value)
    return entry.name.removeprefix(f"{enum}_").removeprefix("MAV_") if entry is not None else str(value)
