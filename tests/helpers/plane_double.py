"""A scripted ArduPlane and a lossy channel: the other end of the link, in memory, on the test's time.

The mission protocol is that of the simulated vehicles (`sim_vehicles.autopilots.mission_protocol`). The
flight is a script, not an airframe: a leg takes the time that a test says, and a vehicle may be deaf, refuse
items or answer wrongly. As ArduPlane 4.7 it flies on to the waypoint that it has cached, refuses to clear
while armed in AUTO, and goes to RTL at the mission's end. A leg begins at the waypoint before, unless the
message MISSION_SET_CURRENT selected its item, or the command DO_SET_MISSION_CURRENT a second time
(`Plane::set_next_WP`).
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import ARDUPLANE
from gcs.mavlink.autopilots.modes import LOITER as LOITER_NAME
from gcs.mavlink.fleet.mode_authority import ModeAuthority
from gcs.mavlink.frames.codec import GCS_COMPONENT_ID, GCS_SYSTEM_ID, Encoder, decode
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.upload import Upload
from gcs.mavlink.mission.upload_limits import UploadLimits, UploadPolicy
from gcs.mavlink.mission.upload_rules import MISSION_RULES
from gcs.mavlink.mission.upload_stages import Event
from gcs.mavlink.mission.upload_state import Flight, UploadState
from sim_vehicles.autopilots.mission_protocol import (
    MISSION,
    Item,
    MissionServer,
    MissionStore,
    Refused,
    normalised,
)

S = 1_000_000_000
HOME = (-353632621, 1491652370, 584.09)
MANUAL, AUTO, RTL, LOITER = 0, 10, 11, 12
GCS = (GCS_SYSTEM_ID, GCS_COMPONENT_ID)


def authority_in(mode):
    """Return the authority over a vehicle whose first heartbeat shows a mode."""
    authority = ModeAuthority()
    authority.observe_mode(mode, 0)
    return authority


class Store(MissionStore):
    """A plane's mission, which refuses what a test says."""

    def __init__(self, plane):
        lat, lon, alt = plane.home
        super().__init__(MISSION, lambda: Item(16, 0, x=lat, y=lon, z=alt))
        self._plane = plane

    def put(self, index, item):
        if result := self._plane.accepts(index):
            raise Refused(result)
        super().put(index, item)


def normal_form(items):
    """Return items as they are stored."""
    return [normalised(item.message(seq, 1, 1), MISSION) for seq, item in enumerate(items)]


class Plane:
    """One ArduPlane, `leg_s` seconds from waypoint to waypoint."""

    def __init__(self, system_id=1, *, mode=LOITER, armed=True, leg_s=math.inf, home=HOME, boot_t_ns=0):
        self.system_id, self.home = system_id, home
        self.mode, self.armed, self.leg_s = mode, armed, leg_s
        self.accepts: Callable[[int], int] = lambda seq: 0
        """Returns the MAV_MISSION_RESULT for an item that is uploaded."""
        self._missions = Store(self)
        self._out: list = []
        self._server = self._new_server()
        self.whole: list[list[Item]] = []
        """Complete missions that were uploaded: anything else in the store is inconsistent."""
        self.mixed_legs: list[int] = []
        self.current, self.cached = 0, None
        self.boot_t_ns = boot_t_ns
        self.silent = False
        self.ignores: set[str] = set()
        self.commands: list[int] = []
        self.requests: list[int] = []
        self._encode = Encoder(system_id, 1)
        self._beat_t_ns, self._leg_t_ns = -(10**18), 0
        self.cached_mixed = False
        """Whether it flies to an item that it took from a mixed store."""
        self.leg_starts_here = True
        """Whether the leg being flown starts where the plane was, not at the waypoint before."""
        self._next_leg_tracks = True

    def _new_server(self):
        stores, may_clear = {MISSION: self._missions}, lambda: not (self.armed and self.mode == AUTO)
        return MissionServer(stores, self._out.append, may_clear, lambda: None, lambda: self.current)

    # -- what the test checks

    @property
    def store(self) -> list[Item]:
        return list(self._missions)

    def holds(self, items) -> bool:
        """Whether the store is exactly these items, home aside."""
        return len(self.store) == len(items) and self.store[1:] == normal_form(items)[1:]

    def mixed(self) -> bool:
        store = self.store[1:]
        return bool(store) and all(store != mission[1:] for mission in self.whole)

    def mean(self, items) -> None:
        self.whole.append(normal_form(items))

    def load(self, items, current=1) -> None:
        """Hold a mission from before, and fly item `current` of it."""
        self.mean(items)
        self._missions.replace(self.whole[-1])
        self._fly_to(current)

    def time_to_next_s(self, t_ns) -> float:
        """What a ground station can work out from position and speed."""
        if self.mode != AUTO or self.cached is None or self.cached.command == 17:
            return math.inf
        return self.leg_s - (t_ns - self._leg_t_ns) / S

    def reboot(self, t_ns) -> None:
        self._server = self._new_server()
        self.mode, self.boot_t_ns, self.current = MANUAL, t_ns, 0
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
        self._server.handle_timer(t_ns)
        out = self._sent()
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

    def _sent(self):
        """Return the answers of the mission protocol."""
        out = list(self._out)
        self._out.clear()
        self.requests += [message.seq for message in out if message.get_type() == "MISSION_REQUEST"]
        return out

    def _ack(self, result, sender):
        return dialect.MAVLink_mission_ack_message(*sender, result, 0)

    def _on_mission(self, message, sender, t_ns):
        self._server.handle(message, t_ns)
        return self._sent()

    _on_mission_count = _on_mission_item_int = _on_mission
    _on_mission_request_list = _on_mission_request_int = _on_mission_clear_all = _on_mission

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

    def yield_up(self, t_ns):
        return self.order(Event.YIELD, t_ns, "another service")

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
    from_ground=False,
    **known,
):
    """Return a task before its begin; without a policy its flight is unknown."""
    items = build_items(profile, mission, home, from_ground=from_ground)
    state = UploadState.of_mission(mission, items, profile, **known)
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
]
