"""A scripted ArduPlane and a lossy channel: the other end of the link, in memory, on the test's time.

It does what ArduPlane 4.7 was seen to do with missions: item 0 is home, uploads are in place, it asks with
MISSION_REQUEST each second and gives up after 8 s with ACK 15, a duplicate gets ACK 13 and the transfer
goes on, what it sends back is normalised, it refuses to clear while armed in AUTO, denies a read-back and a
clearing while it receives, flies on to the waypoint that it has cached, and goes to RTL at the mission's end.
A leg begins at the waypoint before, unless the message MISSION_SET_CURRENT selected its item, or the command
DO_SET_MISSION_CURRENT a second time (`Plane::set_next_WP`).
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import ARDUPLANE
from gcs.mavlink.autopilots.modes import LOITER as LOITER_NAME
from gcs.mavlink.fleet.mode_authority import ModeAuthority
from gcs.mavlink.frames.codec import GCS_COMPONENT_ID, GCS_SYSTEM_ID, Encoder, decode
from gcs.mavlink.mission.upload import Upload
from gcs.mavlink.mission.upload_limits import UploadLimits, UploadPolicy
from gcs.mavlink.mission.upload_rules import MISSION_RULES
from gcs.mavlink.mission.upload_stages import Event
from gcs.mavlink.mission.upload_state import Flight, UploadState

S = 1_000_000_000
HOME = (-353632621, 1491652370, 584.09)
MANUAL, AUTO, RTL, LOITER = 0, 10, 11, 12
GCS = (GCS_SYSTEM_ID, GCS_COMPONENT_ID)


def authority_in(mode):
    """Return the authority over a vehicle whose first heartbeat shows a mode."""
    authority = ModeAuthority()
    authority.observe_mode(mode, 0)
    return authority


@dataclass(frozen=True)
class Stored:
    command: int
    frame: int
    x: int
    y: int
    z_cm: int
    param2: float
    param3: float


def stored(message) -> Stored:
    waypoint = message.command == 16
    return Stored(
        message.command,
        {5: 0, 6: 3}.get(message.frame, message.frame),
        message.x,
        message.y,
        round(message.z * 100),
        float(min(255, int(message.param2))) if waypoint else 0.0,
        0.0 if math.isnan(message.param3) else message.param3,
    )


class Plane:
    """One ArduPlane, `leg_s` seconds from waypoint to waypoint."""

    def __init__(self, system_id=1, *, mode=LOITER, armed=True, leg_s=math.inf, home=HOME, boot_t_ns=0):
        self.system_id, self.home = system_id, home
        self.mode, self.armed, self.leg_s = mode, armed, leg_s
        self.store: list[Stored | None] = []
        self.whole: list[list[Stored]] = []
        """Complete missions that were uploaded: anything else in the store is inconsistent."""
        self.mixed_legs: list[int] = []
        self.current, self.cached = 0, None
        self.accepts: Callable[[object], int] = lambda message: 0
        self.uploader: tuple[int, int] | None = None
        self.boot_t_ns = boot_t_ns
        self.silent = False
        self.ignores: set[str] = set()
        self.commands: list[int] = []
        self.requests: list[int] = []
        self.first_wait_s = 1.0
        self._encode = Encoder(system_id, 1)
        self._count = self._want = 0
        self._asked_t_ns = self._item_t_ns = 0
        self._beat_t_ns, self._leg_t_ns = -(10**18), 0
        self.cached_mixed = False
        """Whether it flies to an item that it took from a mixed store."""
        self.leg_starts_here = True
        """Whether the leg being flown starts where the plane was, not at the waypoint before."""
        self._next_leg_tracks = True

    # -- what the test checks

    def holds(self, items) -> bool:
        """Whether the store is exactly these items, home aside."""
        want = [stored(item.message(seq, 1, 1)) for seq, item in enumerate(items)]
        return self.store[1:] == want[1:] and len(self.store) == len(want)

    def mixed(self) -> bool:
        return len(self.store) > 1 and all(self.store[1:] != mission[1:] for mission in self.whole)

    def mean(self, items) -> None:
        self.whole.append([stored(item.message(seq, 1, 1)) for seq, item in enumerate(items)])

    def load(self, items, current=1) -> None:
        """Hold a mission from before, and fly item `current` of it."""
        self.mean(items)
        self.store = list(self.whole[-1])
        self._fly_to(current)

    def time_to_next_s(self, t_ns) -> float:
        """What a ground station can work out from position and speed."""
        if self.mode != AUTO or self.cached is None or self.cached.command == 17:
            return math.inf
        return self.leg_s - (t_ns - self._leg_t_ns) / S

    def reboot(self, t_ns) -> None:
        self.uploader, self.mode, self.boot_t_ns, self.current = None, MANUAL, t_ns, 0
        self._encode = Encoder(self.system_id, 1)

    # -- bytes in, bytes out

    def receive(self, data: bytes, t_ns: int) -> list[bytes]:
        out = []
        for message in decode(data)[0]:
            if self.silent or message.get_type() in self.ignores:
                continue
            sender = (message.get_srcSystem(), message.get_srcComponent())
            target = getattr(message, "target_system", None)
            handler = getattr(self, f"_on_{message.get_type().lower()}", None)
            if handler is not None and target in (0, self.system_id):
                out += handler(message, sender, t_ns)
        return [self._encode(message) for message in out]

    def poll(self, t_ns: int) -> list[bytes]:
        if self.silent:
            return []
        out = []
        if self.uploader is not None and t_ns - self._item_t_ns >= 8 * S:
            out.append(self._ack(15, self.uploader))
            self.uploader = None
        elif self.uploader is not None and t_ns - self._asked_t_ns >= S:
            out.append(self._request(t_ns))
        if t_ns - self._beat_t_ns >= S:
            self._beat_t_ns = t_ns
            out.append(self._heartbeat())
            out.append(self.mission_current(self.current))
        self._fly(t_ns)
        return [self._encode(message) for message in out]

    def _heartbeat(self):
        return dialect.MAVLink_heartbeat_message(1, 3, 1 | (128 if self.armed else 0), self.mode, 4, 3)

    # -- flight

    def _fly(self, t_ns):
        if self.mode != AUTO:
            self._leg_t_ns = t_ns
        elif t_ns - self._leg_t_ns >= self.leg_s * S and (self.cached is None or self.cached.command != 17):
            self._leg_t_ns = t_ns
            if self.current + 1 < len(self.store):
                mixed = self.mixed()
                if mixed:
                    self.mixed_legs.append(t_ns)
                self._fly_to(self.current + 1)
                self.cached_mixed = mixed
            else:
                self.mode = RTL

    def _fly_to(self, seq):
        self.current, self.cached, self.cached_mixed = seq, self.store[seq], False
        self.leg_starts_here, self._next_leg_tracks = not self._next_leg_tracks, True

    def mission_current(self, seq):
        return dialect.MAVLink_mission_current_message(seq, max(0, len(self.store) - 1))

    # -- missions

    def _request(self, t_ns):
        self._asked_t_ns = t_ns
        self.requests.append(self._want)
        return dialect.MAVLink_mission_request_message(*self.uploader, self._want, 0)

    def _ack(self, result, sender):
        return dialect.MAVLink_mission_ack_message(*sender, result, 0)

    def _on_mission_count(self, message, sender, t_ns):
        if self.uploader not in (None, sender):
            return [self._ack(14, sender)]
        self.uploader, self._count, self._want, self._item_t_ns = sender, message.count, 0, t_ns
        del self.store[message.count :]
        return [self._request(t_ns)]

    def _on_mission_item_int(self, message, sender, t_ns):
        if self.uploader is None:
            return [self._ack(1, sender)]
        if message.seq != self._want:
            return [self._ack(13, sender)]
        if self.uploader != sender:
            return [self._ack(14, sender)]
        result = self.accepts(message)
        if result:
            self.uploader = None
            return [self._ack(result, sender)]
        item = stored(message)
        if self._want < len(self.store):
            self.store[self._want] = item
        else:
            self.store.append(item)
        self._want += 1
        self._item_t_ns = t_ns
        if self._want < self._count:
            return [self._request(t_ns)]
        self.uploader = None
        return [self._ack(0, sender)]

    def _on_mission_request_list(self, message, sender, t_ns):
        if self.uploader is not None:
            return [self._ack(14, sender)]
        return [dialect.MAVLink_mission_count_message(*sender, len(self.store), 0)]

    def _on_mission_request_int(self, message, sender, t_ns):
        seq = message.seq
        if self.uploader is not None:
            return [self._ack(14, sender)]
        if seq >= len(self.store):
            return [
                dialect.MAVLink_mission_count_message(*sender, len(self.store), 0),
                self._ack(1, sender),
            ]
        if seq == 0:
            lat, lon, alt = self.home
            fields = (0, 16, 0, 1, 0.0, 0.0, 0.0, 0.0, lat, lon, alt)
        else:
            it = self.store[seq]
            now = int(seq == self.current)
            fields = (it.frame, it.command, now, 1, 0.0, it.param2, it.param3, 0.0, it.x, it.y, it.z_cm / 100)
        return [dialect.MAVLink_mission_item_int_message(*sender, seq, *fields, 0)]

    def _on_mission_clear_all(self, message, sender, t_ns):
        if self.uploader is not None or (self.armed and self.mode == AUTO):
            return [self._ack(1, sender)]
        self.store = []
        return [self._ack(0, sender)]

    def _on_mission_set_current(self, message, sender, t_ns):
        if message.seq >= len(self.store):
            return []
        self._next_leg_tracks = False
        self._fly_to(max(1, message.seq))
        return [self.mission_current(message.seq)]

    def _on_command_long(self, message, sender, t_ns):
        self.commands.append(message.command)
        result, extra = 3, []
        if message.command == 224:
            seq = max(1, int(message.param1))
            result = 0 if seq < len(self.store) else 2
            if result == 0:
                self._fly_to(seq)
                self._next_leg_tracks = False
        elif message.command == 176:
            result = 2 if message.param2 == AUTO and len(self.store) < 2 else 0
            if result == 0:
                self.mode = int(message.param2)
        elif message.command == 511:
            result = 0
        elif message.command == 512 and message.param1 == 242:
            result = 0
            lat, lon, alt = self.home
            nan4 = [math.nan] * 4
            extra = [
                dialect.MAVLink_home_position_message(lat, lon, round(alt * 1000), 0, 0, 0, nan4, 0, 0, 0)
            ]
        elif message.command == 512 and message.param1 == 42:
            result, extra = 0, [self.mission_current(self.current)]
        elif message.command == 512 and message.param1 == 0:
            result, extra = 0, [self._heartbeat()]
        elif message.command == 512 and message.param1 == 148:
            result = 0
            extra = [dialect.MAVLink_autopilot_version_message(4, 0, 0, 0, 0, *[[0] * 8] * 3, 0, 0, 0)]
        return [dialect.MAVLink_command_ack_message(message.command, result, 0, 0, *sender), *extra]


class UploadTask(Upload):
    """An upload of a mission, with a method for each order."""

    def __init__(self, state, encode, profile, authority, policy, limits):
        limits = limits or UploadLimits().for_round_trip(state.rtt.earlier_s)
        super().__init__(MISSION_RULES, state, encode, limits, Flight(profile, authority, policy))

    def start(self, t_ns):
        return self.order(Event.START, t_ns)

    def start_clearing(self, t_ns):
        return self.order(Event.START_CLEARING, t_ns)

    def restart(self, t_ns):
        return self.order(Event.REBOOT, t_ns)

    def resume(self, t_ns):
        return self.order(Event.RESTART, t_ns)

    def abandon(self, reason, t_ns, *, mode=LOITER_NAME):
        return self.order(Event.ABANDON if mode == LOITER_NAME else Event.STOP, t_ns, reason)

    def supersede(self, t_ns):
        return self.order(Event.STOP, t_ns, "superseded")


def upload_task(
    mission,
    home,
    encode,
    profile=ARDUPLANE,
    *,
    authority=None,
    policy=None,
    limits=None,
    kind=UploadTask,
    **known,
):
    """Return a task before its begin; without a policy its flight is unknown."""
    state = UploadState.of_mission(mission, home, profile, **known)
    return kind(state, encode, profile, authority or ModeAuthority(), policy or UploadPolicy(), limits)


class OfPlane(UploadPolicy):
    """An upload's policy that knows when the plane reaches its next item."""

    def __init__(self, plane: Plane) -> None:
        self._plane = plane

    def time_to_next_s(self, vehicle: int, t_ns: int) -> float:
        return self._plane.time_to_next_s(t_ns)


class Channel:
    """One way of a bad radio: loses, delays, doubles and so reorders, from a seed."""

    def __init__(self, seed, *, loss=0.0, delay_s=(0.005, 0.03), doubles=0.0):
        self._rng = np.random.default_rng(seed)
        self.loss, self._delay_s, self._doubles = loss, delay_s, doubles
        self._queue: list[tuple[int, int, bytes]] = []
        self._sent = 0

    def put(self, frames: list[bytes], t_ns: int) -> None:
        for frame in frames:
            for _ in range(1 + (self._rng.random() < self._doubles)):
                delay_s = self._rng.uniform(*self._delay_s)
                if self._rng.random() >= self.loss:
                    self._sent += 1
                    heapq.heappush(self._queue, (t_ns + round(delay_s * S), self._sent, frame))

    def get(self, t_ns: int) -> list[bytes]:
        out = []
        while self._queue and self._queue[0][0] <= t_ns:
            out.append(heapq.heappop(self._queue)[2])
        return out


@dataclass
class Joined:
    """A task and a plane over two channels."""

    task: object
    plane: Plane
    up: Channel
    down: Channel
    t_ns: int = 0
    each_step: Callable[[Joined], None] | None = None

    def run(self, limit_s=400.0, extra_s=0.0, step_s=0.05):
        """Let time pass until the task ends (and `extra_s` more); returns its result."""
        end = self.t_ns + round(limit_s * S)
        if self.task.stage == "new":
            self.up.put(self.task.start(self.t_ns), self.t_ns)
        while self.t_ns < end and self.task.result is None:
            self.step(step_s)
        for _ in range(round(extra_s / step_s)):
            self.step(step_s)
        return self.task.result

    def step(self, step_s=0.05):
        sub_ns = round(step_s * S / 5)
        for _ in range(5):
            self.t_ns += sub_ns
            for frame in self.up.get(self.t_ns):
                self.down.put(self.plane.receive(frame, self.t_ns), self.t_ns)
            for frame in self.down.get(self.t_ns):
                for message in decode(frame)[0]:
                    self.up.put(self.task.receive(message, self.t_ns), self.t_ns)
        self.down.put(self.plane.poll(self.t_ns), self.t_ns)
        self.up.put(self.task.poll(self.t_ns), self.t_ns)
        if self.each_step is not None:
            self.each_step(self)


__all__ = [
    "AUTO",
    "GCS",
    "HOME",
    "LOITER",
    "MANUAL",
    "RTL",
    "Channel",
    "Joined",
    "OfPlane",
    "Plane",
    "S",
    "replace",
    "stored",
]
