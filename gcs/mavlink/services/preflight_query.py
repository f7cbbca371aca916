"""Questions to one vehicle for the preflight check, and its answers. Sans-I/O. Nothing on it is changed.

Messages are requested one by one (MAV_CMD_REQUEST_MESSAGE; most are streamed anyway), then parameters, then
fence and rally points: never two transfers of the mission protocol at a time. A vehicle whose prearm check
fails gets the command to repeat it, and reports the reasons.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import AutopilotProfile, profile_of
from gcs.mavlink.autopilots.preflight_parameters import Envelope
from gcs.mavlink.frames.codec import OWN_IDS, Message
from gcs.mavlink.mission.geofence_rally import FENCE, RALLY
from gcs.mavlink.mission.items import Item
from gcs.mavlink.mission.upload import Upload
from gcs.mavlink.mission.upload_kinds import list_upload
from gcs.mavlink.services.command_sender import REQUEST_MESSAGE, command_long
from gcs.mavlink.services.parameter_protocol import ParameterReader, is_bytewise
from gcs.mavlink.services.retry import RetryPolicy, RetryTimer
from gcs.safe_text import printable

_REQUESTED_MESSAGES: Final = {
    "AUTOPILOT_VERSION": dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION,
    "GPS_RAW_INT": dialect.MAVLINK_MSG_ID_GPS_RAW_INT,
    "SYS_STATUS": dialect.MAVLINK_MSG_ID_SYS_STATUS,
    "SYSTEM_TIME": dialect.MAVLINK_MSG_ID_SYSTEM_TIME,
    "HOME_POSITION": dialect.MAVLINK_MSG_ID_HOME_POSITION,
}
_ESTIMATORS: Final = {
    dialect.MAV_AUTOPILOT_ARDUPILOTMEGA: ("EKF_STATUS_REPORT", dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT),
    dialect.MAV_AUTOPILOT_PX4: ("ESTIMATOR_STATUS", dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS),
}
PREFLIGHT_MESSAGE_IDS: Final = frozenset(
    {
        *_REQUESTED_MESSAGES.values(),
        *(number for _, number in _ESTIMATORS.values()),
        dialect.MAVLINK_MSG_ID_PARAM_VALUE,
    }
)
"""Message ids that `Fleet` must return besides its own."""

_RETRY_POLICY: Final = RetryPolicy(wait_s=0.7, max_wait_s=2.0, max_tries=6)
_REASONS: Final = "reasons"
"""Key of the request for prearm reasons. ArduPilot reports them every 30 s, and on request."""
_REASONS_RETRY_POLICY: Final = RetryPolicy(wait_s=1.0, max_wait_s=1.0, max_tries=3)
_PREARM: Final = dialect.MAV_SYS_STATUS_PREARM_CHECK
_WARNING: Final = dialect.MAV_SEVERITY_WARNING
_MAX_TEXTS: Final = 8


class PreflightQuery:
    """Query of one vehicle.

    Attributes
    ----------
    messages : dict of str to (int, Message)
        Arrival time and newest message of each type.
    profile : AutopilotProfile or None
        Of its firmware, known from its first heartbeat.
    texts : dict of str to None
        STATUSTEXTs of severity WARNING and above, newest last.
    values : dict of str to float
        Parameters received.
    onboard_lists : dict of int to tuple of Item, or None
        Fence and rally points by MAV_MISSION_TYPE; None if the vehicle did not answer.
    """

    def __init__(
        self,
        vehicle: int,
        envelope: Envelope,
        encode: Callable[[Message], bytes],
        own: tuple[int, int] = OWN_IDS,
    ) -> None:
        self.vehicle = vehicle
        self.messages: dict[str, tuple[int, Message]] = {}
        self.profile: AutopilotProfile | None = None
        self.texts: dict[str, None] = {}
        self.values: dict[str, float] = {}
        self.onboard_lists: dict[int, tuple[Item, ...] | None] = {}
        self._envelope = envelope
        self._encode = encode
        self._own = own
        self._timers: dict[str, RetryTimer] | None = None
        self._reading: ParameterReader | None = None
        self._list: Upload | None = None
        self._has_run_prearm_checks = False

    @property
    def is_done(self) -> bool:
        """True if everything was answered or its tries are used up."""
        if self._timers is None:
            return False
        return self.profile is None or (self._reading is not None and RALLY in self.onboard_lists)

    @property
    def stage(self) -> str:
        """Present stage, for display."""
        if self._timers is None:
            return "not heard yet"
        if self._reading is None:
            return "state"
        if self.is_done:
            return "done"
        return "fence and rally" if self._reading.is_done else "parameters"

    def poll(self, t_ns: int) -> list[bytes]:
        """Advance the timers; return the frames to send, none before the vehicle was heard."""
        if self._timers is None or self.is_done:
            return []
        waiting = {name: a for name, a in self._timers.items() if not a.is_exhausted(t_ns)}
        self._timers = waiting
        if waiting:
            return [self._encode(a.request) for a in waiting.values() if a.start_try(t_ns)]
        if self.profile is None:
            return []
        if self._reading is None:
            self._reading = ParameterReader(self.vehicle, self._names(), self._is_bytewise(), self._encode)
        if not self._reading.is_done:
            return self._reading.poll(t_ns)
        self.values = self._reading.values
        if self._list is None or self._list.result is not None:
            kind = FENCE if FENCE not in self.onboard_lists else RALLY
            self._list = list_upload(self.vehicle, kind, None, self._encode, t_ns, own=self._own)
        return self._note_result(self._list.poll(t_ns))

    def receive(self, message: Message, t_ns: int) -> list[bytes]:
        """Process a message of the vehicle; return the frames to send."""
        name = message.get_type()
        self.messages[name] = (t_ns, message)
        if name == "HEARTBEAT" and self._timers is None:
            self._begin(message, t_ns)
        if name == "STATUSTEXT" and message.severity <= _WARNING:
            self._note(printable(str(message.text)))
        if self._timers is not None:
            self._timers.pop(name, None)
            if name == "SYS_STATUS" and not self._has_run_prearm_checks and self._fails_prearm_check(message):
                self._has_run_prearm_checks = True
                request = command_long(self.vehicle, dialect.MAV_CMD_RUN_PREARM_CHECKS)
                self._timers[_REASONS] = RetryTimer(request, _REASONS_RETRY_POLICY, t_ns)
        if self._reading is not None:
            self._reading.receive(message)
        return [] if self._list is None else self._note_result(self._list.receive(message, t_ns))

    def _note(self, text: str) -> None:
        self.texts.pop(text, None)
        self.texts[text] = None
        while len(self.texts) > _MAX_TEXTS:
            del self.texts[next(iter(self.texts))]
        if self._timers is not None:
            self._timers.pop(_REASONS, None)

    @staticmethod
    def _fails_prearm_check(status: Message) -> bool:
        enabled = status.onboard_control_sensors_present & status.onboard_control_sensors_enabled
        return bool(enabled & _PREARM & ~status.onboard_control_sensors_health)

    def _begin(self, heartbeat: Message, t_ns: int) -> None:
        self.profile = profile_of(heartbeat.autopilot, heartbeat.type)
        asked = dict(_REQUESTED_MESSAGES)
        if heartbeat.autopilot in _ESTIMATORS:
            asked.update([_ESTIMATORS[heartbeat.autopilot]])
        self._timers = {
            name: RetryTimer(command_long(self.vehicle, REQUEST_MESSAGE, number), _RETRY_POLICY, t_ns)
            for name, number in asked.items()
            if name not in self.messages
        }

    def _note_result(self, frames: list[bytes]) -> list[bytes]:
        task = self._list
        if task is not None and task.result is not None and task.mission_type not in self.onboard_lists:
            self.onboard_lists[task.mission_type] = task.result.items
        return frames

    def _names(self) -> Iterator[tuple[str, ...]]:
        assert self.profile is not None
        wishes = [*self.profile.parameters, *self.profile.fits(self._envelope)]
        yield from (wish.all_names for wish in wishes)
        known = {name for wish in wishes for name in wish.all_names}
        more = [*self.profile.fence_parameters, self.profile.altitude_reference_parameter]
        more += [self.profile.return_circle_parameter, *self.profile.radius_parameters]
        yield from ((name,) for name in more if name and name not in known)

    def _is_bytewise(self) -> bool:
        assert self.profile is not None
        version = self.messages.get("AUTOPILOT_VERSION")
        return is_bytewise(self.profile.autopilot, None if version is None else version[1].capabilities)
