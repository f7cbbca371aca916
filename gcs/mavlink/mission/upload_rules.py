"""Rules of an upload: what follows on what, also after a restart of the service or a reboot of the vehicle.

These tables drive `gcs.mavlink.mission.upload.Upload`.
Of the rules of a stage for an event the first one is carried out whose guard holds: its action, then the next
stage. A choice is a branch between two stages (`gcs.mavlink.mission.upload_stages`). `docs/missions.md` draws
both tables.

Sources: https://mavlink.io/en/services/mission.html, ArduPilot's `MissionItemProtocol`, PX4's
`mavlink_mission`. `gcs.mavlink.autopilots` holds what differs between the firmwares.

A mission without disturbance passes through

    ArduPlane   new -> upload -> verify -> select -> mode -> done, or
                new -> park -> upload -> verify -> select -> mode -> done near its next waypoint
    PX4         new -> upload -> verify -> select -> mode -> done

and a fence or rally points through new -> upload -> verify -> done. Rules of the protocol and of safety:

* An ArduPlane upload is in place. From MISSION_COUNT to the last item the onboard mission is inconsistent.
  A PX4 upload is atomic: the onboard mission is always whole. Both store fences as a whole.
* The read-back alone shows what is stored, also after a lost ACK. A failure ACK counts after a pause without
  requests: the transfer may go on. ACK 13 answers a duplicate and is never final.
* Over an inconsistent mission the vehicle may stay in AUTO while it flies its cached waypoint. It must not
  take the next item. When that is nearer than `UploadLimits.guard_s` it gets LOITER (`park` before the
  upload, `in AUTO` during it), and AUTO after verification. The same holds between verification and
  selection: the old item number may be beyond the end of the new mission, and the vehicle would return to
  launch. So `mode` follows only on the selection of a mission that was read back, or on the old mission.
* After the last upload a mission that must not be flown is removed (`remove`): LOITER, then
  MISSION_CLEAR_ALL, which ArduPlane refuses in AUTO, then its number of items.
* What steers waits for a heartbeat, which is requested (second column of `_STAGES`): a selection or a mode
  sent after a pilot or a failsafe has chosen a mode would undo it. From an override on (`mode_authority`)
  every message and tick is the event `override`, which ends the upload. A PX4 is told by MISSION_ACK 15 and
  keeps its old mission. An ArduPlane's mission may then be inconsistent: `gcs.core.tasking` repairs it when
  the vehicle is ours again.
* PX4 is also in Hold after its navigator has rejected a mission that it has stored: `diagnose`.
* Every stage that waits has a rule for `unanswered` (`diagnose`: for `override` and `tick`), and transfers
  have others for `overdue`, `stalled` and `overtime`.

No rule arms the vehicle. No message goes without a target.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from gcs.mavlink.mission import _upload_actions as do
from gcs.mavlink.mission import _upload_guards as when
from gcs.mavlink.mission.upload import Rule as On
from gcs.mavlink.mission.upload import Rules, Source, StageRule
from gcs.mavlink.mission.upload_stages import Choice, Event, Stage

# fmt: off
(NEW, PARK, UPLOAD, VERIFY, SELECT, MODE, DIAGNOSE, HOLD, CLEAR, DONE) = Stage
(COMPARE, RETRY, REMOVE, RESUME, ACTIVATE, OVERRIDDEN) = Choice
(START, DOWNLOAD, START_CLEARING, ABANDON, STOP, YIELD, REBOOT, RESTART,
 OVERRIDE, HEARTBEAT, MISSION_REQUEST, MISSION_ACK, MISSION_COUNT, MISSION_ITEM, MISSION_CURRENT, COMMAND_ACK,
 IN_AUTO, OVERTIME, FAILED, OVERDUE, STALLED, UNANSWERED, TICK) = Event
RUNNING: Final = (PARK, UPLOAD, VERIFY, SELECT, MODE, DIAGNOSE, HOLD, CLEAR)
AT_ONCE: Final = None
"""Event of a choice."""
ALWAYS: Final = None
STAY: Final = None
_REJECTED: Final = "the vehicle's navigator rejects the mission"


def at(*sources: Source, rules: Iterable[On]) -> Iterator[tuple[Source, On]]:
    """Return the rules of some stages, or of a choice."""
    return ((source, rule) for rule in rules for source in sources)


_STAGES: Final = {
    #                   on entry              its messages are sent       it waits for
    PARK:     StageRule(do.command_loiter,    when.has_new_heartbeat,     "LOITER"),
    UPLOAD:   StageRule(do.begin_upload,      when.may_transfer,          "{items} requested"),
    VERIFY:   StageRule(do.read_back,         ALWAYS,                     "{items} read back"),
    SELECT:   StageRule(do.select_first_item, when.has_new_heartbeat,     "the selection of its first item"),
    MODE:     StageRule(do.command_auto,      when.has_new_heartbeat,     "AUTO"),
    DIAGNOSE: StageRule(do.request_state,     ALWAYS,                     "the cause of its Hold"),
    HOLD:     StageRule(do.command_loiter,    when.has_heartbeat,         "LOITER, to clear its mission"),
    CLEAR:    StageRule(do.clear_mission,     when.has_recent_heartbeat,  "the clearing of its mission"),
}

_TRANSFER: Final = (
    # The vehicle requests the items. Its ACK after the last one may be lost.
    *at(UPLOAD, rules=(
        #  event            if                           next        do, or why
        On(MISSION_REQUEST, when.is_pausing,             STAY),
        On(MISSION_REQUEST, when.must_hold_last_item,    STAY,       do.hold_last_item),
        On(MISSION_REQUEST, ALWAYS,                      STAY,       do.send_item),
        On(HEARTBEAT,       when.holds_last_item,        STAY,       do.send_last_item),
        On(MISSION_ACK,     when.is_all_acked,           VERIFY,     do.note_acked),
        On(OVERDUE,         when.is_all_sent,            VERIFY),
        On(OVERDUE,         ALWAYS,                      RETRY,      why="no request for item {sent}"),
        On(FAILED,          ALWAYS,                      RETRY,      why="{failure}"),
        On(TICK,            when.may_resend,             STAY,       do.resend_items))),
    # The onboard list is downloaded, unless the vehicle lacks the last items.
    *at(VERIFY, rules=(
        On(MISSION_REQUEST, when.lacks_items,            UPLOAD),
        On(MISSION_COUNT,   ALWAYS,                      COMPARE,    do.add_count),
        On(MISSION_ITEM,    ALWAYS,                      COMPARE,    do.add_item),
        On(MISSION_ACK,     when.is_error,               STAY,       do.restart_download))),
    *at(COMPARE, rules=(
        On(AT_ONCE,         when.is_incomplete,          STAY),)),
)
"""Transfer and read-back of any list; the rules of its kind follow on these."""

_MISSION: Final = (
    *at(NEW, rules=(
        #  event            if                           next        do, or why
        On(START,           when.must_wait_first,        PARK,       do.start_clock),
        On(START,           ALWAYS,                      UPLOAD,     do.start_clock),
        On(START_CLEARING,  ALWAYS,                      REMOVE,     do.start_clock,
           why="the onboard mission may be inconsistent"))),
    # LOITER before an upload, or before the selection of a mission that was read back equal.
    *at(PARK, rules=(
        On(HEARTBEAT,       when.is_in_auto,             STAY),
        On(HEARTBEAT,       when.is_verified,            SELECT),
        On(HEARTBEAT,       ALWAYS,                      UPLOAD),
        On(UNANSWERED,      when.is_old,                 DONE,
           why="LOITER was not confirmed, so nothing was changed"),
        On(UNANSWERED,      ALWAYS,                      DONE,       why="LOITER was not confirmed"),
        On(REBOOT,          ALWAYS,                      DONE,       why="the vehicle rebooted"))),
    *_TRANSFER,
    *at(UPLOAD, rules=(
        On(MISSION_ACK,     when.is_failure,             STAY,       do.await_request),
        On(STALLED,         when.may_stall_again,        RETRY,
           do.count_stall, why="it requests items again and again{stall}"),
        On(STALLED,         ALWAYS,                      REMOVE,
           why="it requests items again and again{stall}: the vehicle does not obey"),
        On(UNANSWERED,      when.is_silent,              REMOVE,     why="no heartbeat of the vehicle"),
        On(UNANSWERED,      ALWAYS,                      REMOVE,     why="no answer to MISSION_COUNT"))),
    *at(VERIFY, rules=(
        On(STALLED,         when.may_stall_again,        RETRY,
           do.count_stall, why="its read-back goes on{stall}"),
        On(STALLED,         ALWAYS,                      REMOVE,
           why="its read-back goes on{stall}: the vehicle does not obey"),
        On(UNANSWERED,      ALWAYS,                      RETRY,      why="no answer to the read-back"))),
    *at(UPLOAD, VERIFY, rules=(
        On(OVERTIME,        ALWAYS,                      REMOVE,
           why="no end after {limit_s:.0f} s: {before}"),
        On(ABANDON,         when.is_whole,               DONE,       do.keep_mission, why="{order}"),
        On(ABANDON,         ALWAYS,                      REMOVE,     why="{order}"))),
    *at(COMPARE, rules=(
        On(AT_ONCE,         when.is_equal_in_auto,       PARK),
        On(AT_ONCE,         when.is_equal,               SELECT),
        On(AT_ONCE,         when.is_old_at_last,         RESUME),
        On(AT_ONCE,         when.may_differ_again,       RETRY,      why="read-back differs: {difference}"),
        On(AT_ONCE,         ALWAYS,                      REMOVE,
           why="read-back differs: {difference}, {times} times: the vehicle does not obey"))),
    *at(RETRY, rules=(
        On(AT_ONCE,         when.has_uploads_left,       UPLOAD,     do.restart_transfer),
        On(AT_ONCE,         when.is_exhausted,           REMOVE),
        On(AT_ONCE,         when.is_uploading,           VERIFY,     do.note_last_upload),
        On(AT_ONCE,         ALWAYS,                      REMOVE))),
    # A mission that was read back is selected and flown. In AUTO the vehicle must not count on before.
    *at(SELECT, rules=(
        On(IN_AUTO,         when.would_jump,             PARK),
        On(MISSION_CURRENT, when.is_selected,            ACTIVATE),
        On(UNANSWERED,      ALWAYS,                      DONE,
           why="the first item could not be selected"))),
    *at(ACTIVATE, rules=(
        On(AT_ONCE,         when.has_no_mission,         REMOVE,     do.reject, why=_REJECTED),
        On(AT_ONCE,         ALWAYS,                      MODE,       do.note_selected))),
    *at(MODE, rules=(
        On(HEARTBEAT,       when.lacks_auto,             STAY),
        On(HEARTBEAT,       when.is_old,                 DONE),
        On(HEARTBEAT,       ALWAYS,                      DONE,
           do.note_success, why="verified by read-back{uploads}"),
        On(COMMAND_ACK,     when.is_obeyed,              STAY),
        On(COMMAND_ACK,     when.may_refuse_again,       STAY,       do.note_refusal),
        On(COMMAND_ACK,     when.has_no_mission,         REMOVE,     do.reject, why=_REJECTED),
        On(COMMAND_ACK,     ALWAYS,                      DONE,       do.note_refusal),
        On(UNANSWERED,      ALWAYS,                      DONE,       why="AUTO was not confirmed"))),
    *at(VERIFY, SELECT, MODE, rules=(
        On(MISSION_REQUEST, when.is_settled,             RETRY,
           why="the vehicle requests items again"),)),
    # A whole mission is kept, and flown again after a LOITER of ours. Any other is removed.
    *at(REMOVE, rules=(
        On(AT_ONCE,         when.is_whole,               RESUME,     do.keep_mission),
        On(AT_ONCE,         when.is_waiting,             CLEAR),
        On(AT_ONCE,         ALWAYS,                      HOLD))),
    *at(RESUME, rules=(
        On(AT_ONCE,         when.may_resume,             ACTIVATE),
        On(AT_ONCE,         ALWAYS,                      DONE))),
    *at(HOLD, rules=(
        On(HEARTBEAT,       when.is_in_auto,             STAY),
        On(HEARTBEAT,       ALWAYS,                      CLEAR),
        On(UNANSWERED,      ALWAYS,                      CLEAR,
           why="{before}; LOITER was not confirmed"))),
    *at(CLEAR, rules=(
        On(MISSION_ACK,     when.is_clearing_acked,      STAY,       do.count_items_left),
        On(MISSION_COUNT,   when.is_clearing_unacked,    STAY),
        On(MISSION_COUNT,   when.is_cleared,             DONE,       do.note_cleared),
        On(MISSION_COUNT,   when.may_clear_again,        CLEAR),
        On(MISSION_COUNT,   ALWAYS,                      DONE,       do.note_items_left),
        On(STALLED,         ALWAYS,                      DONE,
           why="{before}; the clearing was not confirmed"),
        On(UNANSWERED,      ALWAYS,                      DONE,
           why="{before}; the clearing was not confirmed"))),
    # In AUTO over an inconsistent mission LOITER is commanded before the vehicle takes the next item.
    *at(UPLOAD, VERIFY, CLEAR, rules=(
        On(IN_AUTO,         when.is_loiter_due,          STAY,       do.command_loiter_once),)),
    # Another mode is chosen or commanded. A PX4 may also be in Hold because it rejects its mission.
    *at(UPLOAD, VERIFY, SELECT, MODE, CLEAR, rules=(
        On(OVERRIDE,        when.may_be_rejection,       DIAGNOSE),)),
    *at(DIAGNOSE, rules=(
        On(OVERRIDE,        when.may_still_be_rejection, STAY),
        On(MISSION_CURRENT, when.has_no_mission,         REMOVE,     do.reject, why=_REJECTED),
        On(MISSION_CURRENT, when.is_settled,             OVERRIDDEN, do.stop_overridden),
        On(HEARTBEAT,       ALWAYS,                      VERIFY),
        On(TICK,            ALWAYS,                      VERIFY),
        On(ABANDON,         when.is_verified,            DONE,       why="{order}"),
        On(ABANDON,         ALWAYS,                      DONE,       do.keep_mission, why="{order}"))),
    *at(*RUNNING, rules=(
        On(OVERRIDE,        ALWAYS,                      OVERRIDDEN, do.stop_overridden),)),
    *at(OVERRIDDEN, rules=(
        On(AT_ONCE,         when.is_inconsistent,        DONE,
           why="{takeover}: its onboard mission may be inconsistent{repair}"),
        On(AT_ONCE,         when.is_old,                 DONE,
           why="{takeover}: its upload is stopped, and it keeps its mission"),
        On(AT_ONCE,         when.is_unselected,          DONE,
           why="{takeover}: read back equal, its first item not selected{repair}"),
        On(AT_ONCE,         when.is_verified,            DONE,
           why="{takeover}: read back equal, not started"),
        On(AT_ONCE,         ALWAYS,                      DONE,
           why="{takeover}: its upload is stopped; the old or the new mission is stored"))),
    # Orders to the vehicle, its reboots, and outages of this service.
    *at(NEW, *RUNNING, rules=(
        On(STOP,            ALWAYS,                      DONE,       do.cancel_transfer, why="{order}"),)),
    *at(PARK, UPLOAD, VERIFY, SELECT, MODE, DIAGNOSE, rules=(
        On(YIELD,           when.must_be_removed,        REMOVE,     do.distrust, why="{order}"),
        On(YIELD,           ALWAYS,                      DONE,       do.cancel_transfer, why="{order}"))),
    *at(UPLOAD, VERIFY, SELECT, MODE, DIAGNOSE, rules=(
        On(REBOOT,          ALWAYS,                      RETRY,
           do.note_reboot, why="the vehicle rebooted"),
        On(RESTART,         ALWAYS,                      VERIFY,     do.start_clock))),
    *at(NEW, PARK, SELECT, MODE, rules=(
        On(ABANDON,         ALWAYS,                      DONE,       why="{order}"),)),
    *at(HOLD, CLEAR, rules=(
        On(REBOOT,          ALWAYS,                      REMOVE,     do.note_reboot),)),
    *at(PARK, HOLD, CLEAR, rules=(
        On(RESTART,         ALWAYS,                      STAY,       do.start_clock),)),
)

_LIST: Final = (
    *at(NEW, rules=(
        #  event            if                           next        do, or why
        On(START,           when.is_list_empty,          CLEAR,      do.start_clock),
        On(START,           ALWAYS,                      UPLOAD,     do.start_clock),
        On(DOWNLOAD,        ALWAYS,                      VERIFY,     do.start_clock))),
    *_TRANSFER,
    *at(UPLOAD, CLEAR, rules=(
        On(MISSION_ACK,     when.is_unsupported,         DONE,       do.note_unsupported),
        On(MISSION_ACK,     when.is_failure,             STAY,       do.await_request),
        On(STALLED,         ALWAYS,                      DONE,       why="no answer: does it take a {list}?"),
        On(UNANSWERED,      ALWAYS,                      DONE,
           why="no answer: does it take a {list}?"))),
    *at(CLEAR, rules=(
        On(MISSION_ACK,     when.is_clearing_acked,      VERIFY),
        On(FAILED,          ALWAYS,                      RETRY,      why="{failure}"))),
    *at(VERIFY, rules=(
        On(STALLED,         when.is_download,            DONE,       why="no answer: does it take a {list}?"),
        On(STALLED,         ALWAYS,                      RETRY,      why="no answer to the read-back"),
        On(UNANSWERED,      when.is_download,            DONE,       why="no answer: does it take a {list}?"),
        On(UNANSWERED,      ALWAYS,                      RETRY,      why="no answer to the read-back"))),
    *at(UPLOAD, VERIFY, rules=(
        On(OVERTIME,        ALWAYS,                      DONE,
           why="no end after {limit_s:.0f} s: {before}"),)),
    *at(COMPARE, rules=(
        On(AT_ONCE,         when.is_download,            DONE,       do.note_success, why="{found} items"),
        On(AT_ONCE,         when.is_equal,               DONE,       do.note_success, why="{equal}"),
        On(AT_ONCE,         ALWAYS,                      RETRY,      why="read-back differs: {difference}"))),
    *at(RETRY, rules=(
        On(AT_ONCE,         when.has_clearings_left,     CLEAR,      do.restart_transfer),
        On(AT_ONCE,         when.has_uploads_left,       UPLOAD,     do.restart_transfer),
        On(AT_ONCE,         ALWAYS,                      DONE,
           why="{before}, {count} uploads failed; the stored list is unknown"))),
)

_MESSAGES: Final = (
    MISSION_REQUEST, MISSION_ACK, MISSION_COUNT, MISSION_ITEM, MISSION_CURRENT, COMMAND_ACK, HEARTBEAT)

_IGNORED_BY_MISSIONS: Final = (
    # What belongs to a stage before, comes again, or says nothing new.
    *at(*Stage, rules=map(On, (*_MESSAGES, IN_AUTO, TICK))),
    *at(HOLD, CLEAR, rules=(On(ABANDON), On(YIELD))),
    # What cannot be: the stage waits for nothing of the kind.
    *at(NEW, *RUNNING, rules=map(On, (START, START_CLEARING, DOWNLOAD, OVERTIME, STALLED, OVERDUE, FAILED))),
    *at(NEW, rules=map(On, (YIELD, OVERRIDE, REBOOT, RESTART, UNANSWERED))),
    *at(DIAGNOSE, rules=(On(UNANSWERED),)),
    *at(DONE, rules=map(On, Event)),
)

_IGNORED_BY_LISTS: Final = (
    *at(NEW, UPLOAD, VERIFY, CLEAR, rules=map(On, (*_MESSAGES, TICK))),
    # What cannot be: a list needs no mode, and no order but the first.
    *at(NEW, UPLOAD, VERIFY, CLEAR, rules=map(On, (START_CLEARING, ABANDON, STOP, YIELD, REBOOT, RESTART))),
    *at(NEW, UPLOAD, VERIFY, CLEAR, rules=map(On, (OVERRIDE, IN_AUTO))),
    *at(UPLOAD, VERIFY, CLEAR, rules=map(On, (START, DOWNLOAD))),
    *at(NEW, rules=map(On, (OVERTIME, FAILED, OVERDUE, STALLED, UNANSWERED))),
    *at(VERIFY, CLEAR, rules=(On(OVERDUE),)),
    *at(VERIFY, rules=(On(FAILED),)),
    *at(CLEAR, rules=(On(OVERTIME),)),
    *at(DONE, rules=map(On, Event)),
)
# fmt: on


def _rules_of(
    stages: Mapping[Stage, StageRule],
    rules: Iterable[tuple[Source, On]],
    ignored: Iterable[tuple[Source, On]],
) -> Rules:
    """Return the rules by source and event; events are ignored where no guard holds."""
    table: dict[tuple[Source, Event | None], tuple[On, ...]] = {}
    for source, rule in (*rules, *ignored):
        known = table.get((source, rule.event), ())
        if not known or known[-1].guard is not ALWAYS:
            table[source, rule.event] = (*known, rule)
    return Rules(stages, table)


MISSION_RULES: Final = _rules_of(_STAGES, _MISSION, _IGNORED_BY_MISSIONS)
LIST_RULES: Final = _rules_of(
    {stage: _STAGES[stage]._replace(may_send=ALWAYS) for stage in (UPLOAD, VERIFY)}
    | {CLEAR: StageRule(do.clear_list, ALWAYS, "the clearing of its list")},
    _LIST,
    _IGNORED_BY_LISTS,
)
