"""The steps of a mission task: what each one sends and waits for, and what state they share.

When which step is taken is decided in `gcs.mavlink.mission.upload_task`, where the whole is described.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import ARDUPLANE, AutopilotProfile
from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.fleet.mode_authority import ModeAuthority
from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, GCS_COMPONENT_ID, GCS_SYSTEM_ID, Message
from gcs.mavlink.mission.items import Home, Item
from gcs.mavlink.mission.protocol import MissionDownload, MissionUpload
from gcs.mavlink.mission.task_terms import Holds, Stage, TaskResult, Timing
from gcs.mavlink.services.command_messages import REQUEST_MESSAGE, SET_MODE, command, select, set_mode
from gcs.mavlink.services.retry import RetryPolicy, RetryTimer, ns
from gcs.mavlink.services.rtt import RttEstimator
from gcs.model import NS_PER_S, Mission, system_of

_MISSION: Final = dialect.MAV_MISSION_TYPE_MISSION
_MAX_PAUSE_S: Final = 4.0


class UploadSteps:
    """What a mission task knows, and what it can do next.

    Parameters
    ----------
    mission : Mission
        What to fly.
    home : Home
        Sent as item 0 where the firmware keeps one; the vehicle replaces it by its own.
    encode : callable
        Message to frame for this vehicle, such as `Fleet.encoder`.
    profile : Profile
        Of its firmware.
    custody : Custody, optional
        Who chose the mode that it is in; shared by all tasks of a vehicle.
    old : sequence of Item, optional
        What the vehicle holds when the task begins, if a read-back has shown it: a failed task may then end
        in "old" rather than clear the vehicle.
    mixed : bool
        Whether a task before this one may have left a mix.
    current : int, optional
        Item that the vehicle flies to now.
    time_to_next_s : callable
        Time (ns) to the least number of seconds before the vehicle could take its next item from the store;
        0 when it is not known, infinite when it does not fly a mission.
    first_item : callable, optional
        Number of the item to begin with, asked when the mission is verified: on a slow link the vehicle has
        flown on meanwhile, and must not turn back for waypoints behind it.
    from_ground : bool
        Whether the mission begins with a take-off.
    delegated : bool
        Whether another program uploads: see `handover` and `delivered`.
    pace : Pace, optional
        Of its link, as far as it is known.
    room : callable, optional
        Items of a mission that the link has room for at a time now.
    own : (int, int)
        Our system and component id.
    """

    def __init__(
        self,
        mission: Mission,
        home: Home,
        encode: Callable[[Message], bytes],
        *,
        profile: AutopilotProfile = ARDUPLANE,
        custody: ModeAuthority | None = None,
        old: Sequence[Item] | None = None,
        mixed: bool = False,
        current: int | None = None,
        time_to_next_s: Callable[[int], float] = lambda _t_ns: 0.0,
        first_item: Callable[[], int] | None = None,
        from_ground: bool = False,
        delegated: bool = False,
        timing: Timing | None = None,
        pace: RttEstimator | None = None,
        room: Callable[[], int] = lambda: 1 << 16,
        own: tuple[int, int] = (GCS_SYSTEM_ID, GCS_COMPONENT_ID),
    ) -> None:
        self.mission = mission
        self.items = profile.items(mission, home, from_ground=from_ground)
        self.stage: Stage = "new"
        self.uploads = 0
        self.result: TaskResult | None = None
        self._encode = encode
        self._profile = profile
        self._custody = custody or ModeAuthority()
        self._old = old
        self._time_to_next_s = time_to_next_s
        self._first_item = first_item or (lambda: profile.home_items)
        self._delegated = delegated
        self._handover = b""
        self._timing = timing or Timing()
        self._own = own
        self._to = (system_of(mission.vehicle), AUTOPILOT_COMPONENT_ID)
        self._out: list[Message] = []
        self._began_t_ns = self._stage_t_ns = 0
        self._asking: RetryTimer | None = None
        self._deadline_t_ns: int | None = None
        self._verdict: tuple[int, str] | None = None
        self._pace = pace or RttEstimator()
        self._window = lambda: min(profile.window, room())
        self._sending = MissionUpload(
            self.items, self._to, self._pace, self._window, last_when_asked=profile.in_order
        )
        self._reading: MissionDownload | None = None
        self._cleared = False
        self._was_mixed = mixed
        self._holds: Holds = "unknown" if mixed else "old"
        self._reason = ""
        self._abandoned = False
        self._may_start = True
        self._current = current
        self._current_before = current
        self._refusals = 0
        self.first = self._mark = profile.home_items
        """Item that the mission begins with; final when it was selected."""
        self.leg_t_ns = 0
        """When the vehicle may have begun to fly to that item."""
        self._refused = False
        """True if a whole mission is stored that must not be flown: it reads back differently, or the
        vehicle's navigator rejects it."""
        self._no_mission = False
        """True if MISSION_CURRENT said last that there is no valid mission."""
        self._in_doubt_t_ns: int | None = None
        """When a mode was heard that either somebody chose, or a rejected mission led to."""
        self._hold_t_ns: int | None = None
        self._selected = True

    @property
    def retries(self) -> int:
        """Messages sent again, and uploads begun again."""
        return self._pace.repeats

    @property
    def is_mixed(self) -> bool:
        """Whether the vehicle may hold a mix of missions now."""
        return self._holds == "unknown" and not self._profile.atomic

    # ------------------------------------------------------------ stages

    def _enter(
        self,
        stage: Stage,
        t_ns: int,
        question: Message | None = None,
        *,
        pause_s: float = 0.0,
        patience: RetryPolicy | None = None,
    ) -> None:
        self.stage = stage
        self._stage_t_ns = t_ns
        self._deadline_t_ns = self._verdict = self._reading = self._in_doubt_t_ns = None
        self._refusals = 0
        self._ask(question, t_ns + ns(pause_s), patience)

    def _ask(self, question: Message | None, t_ns: int, patience: RetryPolicy | None = None) -> None:
        patience = patience or self._pace.patience(self._timing.tries, self._timing.answer_s)
        self._asking = RetryTimer(question, patience, t_ns) if question is not None else None

    def _park(self, t_ns: int) -> None:
        """Have the vehicle wait, and hear that it does: only then can a later order be told from this one."""
        self._hold_t_ns = t_ns
        self._enter("park", t_ns, self._mode_command(LOITER), patience=self._timing.hold)

    def _upload(self, t_ns: int, pause_s: float = 0.0) -> None:
        self.uploads += 1
        self._sending.begin()
        self._mark = self._begin_at() if self._profile.marks_current else -1
        if not self._delegated:
            self._enter("upload", t_ns, self._sending.count(), pause_s=pause_s)
            return
        self._enter("upload", t_ns)
        self._deadline_t_ns = t_ns + ns(self._timing.delegate_s)
        self._note_upload()
        to, items = self._to, enumerate(self.items)
        messages = (item.message(n, *to, current=n == self._mark) for n, item in items)
        self._handover = b"".join(map(self._encode, messages))

    def _note_upload(self) -> None:
        """From now on the vehicle may have begun to change what it stores."""
        self._selected = self._profile.atomic
        if self._holds != "unknown":
            self._holds = "unknown"
            self._current_before = self._current

    def _verify(self, t_ns: int) -> None:
        self._enter("verify", t_ns)
        self._read(t_ns)

    def _read(self, t_ns: int) -> None:
        self._asking = None
        window = None if self._profile.in_order else self._window
        self._reading = MissionDownload(self._to, self._pace, t_ns, window)

    def _begin_at(self) -> int:
        return min(max(self._profile.home_items, self._first_item()), len(self.items) - 1)

    def _select(self, t_ns: int) -> None:
        self._current_before = self._current
        self.first = self._begin_at()
        self.leg_t_ns = t_ns
        self._enter("select", t_ns, select(self.mission.vehicle, self._profile, self.first))

    def _start_mode(self, t_ns: int) -> None:
        if self._custody.mode != AUTO:
            self.leg_t_ns = t_ns
        self._selected = True
        if self._custody.taken == LOITER and self._no_mission and self._profile.atomic:
            self._reject(t_ns)
        elif self._custody.taken:
            self._leave(t_ns)
        else:
            self._enter("mode", t_ns, self._mode_command(AUTO))

    def _leave(self, t_ns: int) -> None:
        """End without commanding a mode: somebody else has chosen one."""
        stored = "read back equal, not started" if self._holds == "equal" else self._reason or "not begun"
        self._reason = f"{stored}: {self._custody.taken} was chosen meanwhile"
        self._finish(ok=False, t_ns=t_ns)

    def _reject(self, t_ns: int) -> None:
        """Take note that the vehicle stores the mission, and will not fly it: nobody chose its mode."""
        self._custody.rejected()
        self._reason = "the vehicle's navigator rejects the mission (no valid mission)"
        self._refused = True
        self._hold(t_ns)

    def _give_back(self, t_ns: int) -> None:
        """End as failed; a vehicle that was held, and still has a whole mission, goes on with it."""
        if self._hold_t_ns is not None and self._holds == "old" and self._may_start:
            self._start_mode(t_ns)
        else:
            self._finish(ok=False, t_ns=t_ns)

    def _hold(self, t_ns: int) -> None:
        """Leave no mix and no refused mission: stop the vehicle where it is, then clear what it stores."""
        if not (self.is_mixed or self._refused):
            self._holds = "old" if self._holds == "old" else "whole"
            self._out += self._cancelling()
            self._give_back(t_ns)
        elif self._custody.mode not in ("", AUTO):
            self._clear(t_ns)
        else:
            self._hold_t_ns = t_ns
            self._enter("hold", t_ns, self._mode_command(LOITER), patience=self._timing.hold)

    def _clear(self, t_ns: int) -> None:
        self._cleared = False
        self._enter("clear", t_ns, dialect.MAVLink_mission_clear_all_message(*self._to, _MISSION))

    def _again(self, reason: str, t_ns: int) -> None:
        """Repair: upload again after a pause; when the bound is reached read back a last time, then clear."""
        self._reason = self._reason if self._abandoned else reason
        if self.uploads < self._timing.uploads:
            self._pace.repeats += 1
            self._out += self._cancelling()
            self._upload(t_ns, min(_MAX_PAUSE_S, 0.25 * 2.0**self.uploads))
        elif self._abandoned or self.stage != "upload":
            self._hold(t_ns)
        else:
            self._abandoned = True
            self._verify(t_ns)

    def _cancelling(self) -> list[Message]:
        """Return what ends a conversation before its time, where a MISSION_COUNT would not."""
        if not self._profile.atomic or self.stage not in ("upload", "verify"):
            return []
        return [self._ack(dialect.MAV_MISSION_OPERATION_CANCELLED)]

    def _ack(self, result: int) -> Message:
        return dialect.MAVLink_mission_ack_message(*self._to, result, _MISSION)

    def _finish(self, *, ok: bool, t_ns: int) -> None:
        detail = "verified by read-back" if ok else self._reason
        if ok and self.uploads > 1:
            detail += f" after {self.uploads} uploads"
        duration_s = (t_ns - self._began_t_ns) / NS_PER_S
        held = self._hold_t_ns is not None and (ok or self._custody.mode != AUTO)
        self.result = TaskResult(
            t_ns, ok, self._holds, detail, duration_s, self.retries, held, self._selected
        )
        self._enter("done", t_ns)

    def _for_us(self, message: Message, *, broadcast: bool = False) -> bool:
        target = (message.target_system, message.target_component)
        mine = all(got == own or (broadcast and got == 0) for got, own in zip(target, self._own, strict=True))
        return mine and message.mission_type == _MISSION

    # ------------------------------------------------------------ frames

    def _current_please(self) -> Message:
        """Ask for MISSION_CURRENT, which otherwise comes once a second."""
        return command(self.mission.vehicle, REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_MISSION_CURRENT)

    def _mode_command(self, name: str) -> Message:
        self._custody.ordered(name)
        return set_mode(self.mission.vehicle, self._profile.autopilot, name)

    def _sent(self, t_ns: int) -> list[bytes]:
        """Frames that are due now."""
        if self._asking is not None and self._asking.due(t_ns):
            self._pace.repeats += self._asking.sent > 1
            if self.stage == "upload":
                self._note_upload()
            if self.stage == "select" and self._profile.atomic:
                self._out.append(
                    self._ack(dialect.MAV_MISSION_ACCEPTED)
                )  # without it PX4 would not hear the question for 5 s
            copies = self._pace.copies if self._asking.sent > 1 else 1
            self._out += [self._asking.question] * copies
            if self.stage == "select":
                self._out += [self._current_please()] * copies
        if self._reading is not None:
            self._out += self._reading.due(t_ns)
        out, self._out = self._out, []
        if any(message.get_type() == "COMMAND_LONG" and message.command == SET_MODE for message in out):
            heartbeat = (
                dialect.MAVLINK_MSG_ID_HEARTBEAT
            )  # which tells the mode, and is due once a second only
            out.append(command(self.mission.vehicle, REQUEST_MESSAGE, heartbeat))
        return [self._encode(message) for message in out]
