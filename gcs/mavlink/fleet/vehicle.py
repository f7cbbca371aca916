"""One vehicle as its messages tell it: position, mode, mission item, health, and how its link does.

Which fields mean what: https://mavlink.io/en/messages/common.html. Position and ground speed come from
GLOBAL_POSITION_INT (1e-7 degrees, millimetres, cm/s), mode and arming from HEARTBEAT, the item that it
flies to from MISSION_CURRENT. Loss is counted from gaps in the frame sequence of its autopilot; a frame
that comes late is taken off again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.geo import LocalFrame
from gcs.mavlink.autopilots import AutopilotProfile, mode_name, profile_of
from gcs.mavlink.fleet.heartbeat import as_number
from gcs.mavlink.fleet.position_checks import BootClock, position_problem
from gcs.mavlink.fleet.position_plausibility import DuplicateIdDetector, Motion, Report
from gcs.mavlink.fleet.statustext import TextChunks
from gcs.mavlink.fleet.stream_requests import StreamRequests
from gcs.mavlink.fleet.telemetry_table import (
    ADDRESS,
    BATTERY_PERCENT,
    BEAT,
    BEST_FIX,
    BOOT_MS,
    DUE_NS,
    FIX_TYPE,
    FRAMES,
    HEARD_NS,
    LAST_SEQUENCE,
    LOST,
    NONE,
    PLACE_NS,
    PLACES,
    SIGNS,
    WATCHED,
    Row,
    new_row,
)
from gcs.mavlink.frames.codec import Encoder, Message
from gcs.mavlink.mission.items import Home
from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, Level, VehicleState

Address: TypeAlias = tuple[str, str]
"""(link, peer)."""
Liveness: TypeAlias = Literal["waiting", "alive", "stale", "down"]
"""Not heard yet, heard, silent for a moment, silent for so long that it may be heard from elsewhere."""
Tell: TypeAlias = Callable[[Level, str], None]
"""Takes a notice about this vehicle."""

_ARMED: Final = dialect.MAV_MODE_FLAG_SAFETY_ARMED
_UNKNOWN_HEADING: Final = 65535
_SLOW_M_S: Final = 0.5
_UNPLACED_NS: Final = ns(5.0)


@dataclass(frozen=True, slots=True)
class Health:
    """A vehicle's link and equipment, to be shown."""

    system_id: int
    liveness: Liveness
    heard_t_ns: int
    address: Address | None
    autopilot: int
    """MAV_AUTOPILOT."""
    home: Home | None
    fix_type: int | None
    """GPS_FIX_TYPE now, None when it reports none."""
    battery_percent: int | None
    boots: int
    """Reboots seen."""
    frames: int
    lost: int
    conflicts: int
    """Frames that claimed its id from another address."""
    refused: dict[str, int]
    """Position reports not believed, by reason."""
    signed: bool
    """Whether its last frame carried a signature; checked, where there is a key, before it came here."""


class Vehicle:
    """The record of one expected vehicle. Only frames of its own autopilot reach it."""

    def __init__(
        self,
        system_id: int,
        frame: LocalFrame,
        encoder: Encoder,
        wants: StreamRequests,
        max_distance_m: float,
        max_speed_m_s: float,
        row: Row | None = None,
    ) -> None:
        self.system_id = system_id
        self.row = new_row() if row is None else row
        """What quiet frames change, here or in the kernel."""
        self.address: Address | None = None
        self.signed_lead_ns: int | None = None
        """Signing time less ours of the heartbeat that showed its address; None when that was not signed."""
        self.liveness: Liveness = "waiting"
        self.conflicts = self.boots = self.returns = 0
        self.autopilot = dialect.MAV_AUTOPILOT_INVALID
        self.profile: AutopilotProfile | None = None
        """Of its firmware; None before its first heartbeat, or when it is not known here."""
        self.home: Home | None = None
        self.wants = wants
        self.encoder = encoder
        self.texts = TextChunks()
        self.refused: dict[str, int] = {}
        self._frame, self._max_distance_m = frame, max_distance_m
        self._clock = BootClock(self.row)
        self._motion, self._voices = Motion(max_speed_m_s), DuplicateIdDetector(max_speed_m_s)
        self._judged_places = 0
        """`PLACES` when these two had seen all of them."""
        self._unplaced = False
        self._mode, self._armed, self._mission_seq = "", False, -1
        self._state: VehicleState | None = None
        self._state_places = 0
        """`PLACES` when the state was made."""
        self._handlers: dict[str, Callable[[Message, int, Tell], None]] = {
            "HEARTBEAT": self._on_heartbeat,
            "GLOBAL_POSITION_INT": self._on_position,
            "MISSION_CURRENT": self._on_mission_current,
            "HOME_POSITION": self._on_home,
            "SYS_STATUS": self._on_sys_status,
            "GPS_RAW_INT": self._on_gps,
            "COMMAND_ACK": self._on_command_ack,
        }

    @property
    def heard_t_ns(self) -> int:
        """When its autopilot was last heard."""
        return self.row.item(HEARD_NS)

    @property
    def signed(self) -> bool:
        """Whether its last frame was signed."""
        return bool(self.row[SIGNS])

    @property
    def lost(self) -> int:
        """Frames missing in the sequence."""
        return self.row.item(LOST)

    def contact(self, address: Address, number: int) -> None:
        """Begin, or begin again, to hear the vehicle at this address, which the ledger calls `number`."""
        self.address = address
        self.row[ADDRESS], self.row[LAST_SEQUENCE], self.row[DUE_NS] = number, NONE, 0
        self.row[BEAT] = NONE
        self.wants.begin()

    def count(self, sequence: int, t_ns: int) -> None:
        """Count one frame of its autopilot and the gap before it."""
        row = self.row
        row[FRAMES] += 1
        row[HEARD_NS] = t_ns
        if row[LAST_SEQUENCE] == NONE:
            row[LAST_SEQUENCE] = sequence
            return
        ahead = (sequence - row.item(LAST_SEQUENCE)) % 256
        if 0 < ahead < 128:
            row[LOST] += ahead - 1
            row[LAST_SEQUENCE] = sequence
        elif ahead >= 128:
            row[LOST] = max(0, self.lost - 1)

    def attend(self) -> None:
        """Have its next heartbeat seen, even if it says what the last one said."""
        self.row[BEAT] = NONE

    def poll(self, t_ns: int) -> list[Message]:
        """Return the questions to it that are due."""
        if t_ns >= self.wants.idle_until_ns and self.row[PLACES]:
            self.wants.heard("GLOBAL_POSITION_INT", self.row.item(PLACE_NS))  # the kernel tells nobody
        return self.wants.poll(t_ns)

    def take(self, message: Message, t_ns: int, tell: Tell) -> None:
        """Fold one message into the record."""
        name = message.get_type()
        if name != "HOME_POSITION":  # met by one that can be believed
            self.wants.heard(name, t_ns)
        handler = self._handlers.get(name)
        if handler is not None:
            handler(message, t_ns, tell)

    def state(self) -> VehicleState | None:
        """Return what it last said of itself; None before its first position that can be believed."""
        places = self.row.item(PLACES)
        if places and (self._state is None or places != self._state_places):
            self._state_places = places
            self._state = VehicleState(
                self.system_id, *self._place(), self._mode, self._armed, self._mission_seq
            )
        return self._state

    def _place(self) -> tuple[int, float, float, float, float, float]:
        """Time, east, north, height above sea level, ground speed and course of the last position."""
        t_ns, lat, lon, alt_mm, v_north_cm_s, v_east_cm_s, heading_cdeg = self.row[PLACE_NS:PLACES].tolist()
        east_m, north_m = self._frame.to_local(lat * 1e-7, lon * 1e-7)
        v_north_m_s, v_east_m_s = v_north_cm_s * 0.01, v_east_cm_s * 0.01
        speed_m_s = math.hypot(v_east_m_s, v_north_m_s)
        if speed_m_s < _SLOW_M_S and heading_cdeg != _UNKNOWN_HEADING:
            course_rad = math.radians(heading_cdeg * 0.01)
            course_rad = math.atan2(math.sin(course_rad), math.cos(course_rad))
        else:
            course_rad = math.atan2(v_east_m_s, v_north_m_s)
        return t_ns, east_m, north_m, alt_mm * 1e-3, speed_m_s, course_rad

    def health(self) -> Health:
        """Return its link and equipment."""
        return Health(
            system_id=self.system_id,
            liveness=self.liveness,
            heard_t_ns=self.heard_t_ns,
            address=self.address,
            autopilot=self.autopilot,
            home=self.home,
            fix_type=self._known(FIX_TYPE),
            battery_percent=self._known(BATTERY_PERCENT),
            boots=self.boots,
            frames=self.row.item(FRAMES),
            lost=self.lost,
            conflicts=self.conflicts,
            refused=dict(self.refused),
            signed=self.signed,
        )

    def _known(self, column: int) -> int | None:
        value = self.row.item(column)
        return None if value == NONE else value

    # ------------------------------------------------------------ messages

    def _on_heartbeat(self, message: Message, _t_ns: int, tell: Tell) -> None:
        if message.autopilot != self.autopilot:
            self._meet(message, tell)
        mode, armed = mode_name(message), bool(message.base_mode & _ARMED)
        if self._mode and mode != self._mode:
            tell("info", f"mode {self._mode} -> {mode}")
        if self._mode and armed != self._armed:
            tell("info", "armed" if armed else "disarmed")
        if (mode, armed) != (self._mode, self._armed):
            self._mode, self._armed, self._state = mode, armed, None
        self.row[BEAT] = as_number(message)

    def _meet(self, heartbeat: Message, tell: Tell) -> None:
        """Note whose firmware it is."""
        self.autopilot = heartbeat.autopilot
        self.profile = profile_of(heartbeat.autopilot, heartbeat.type)
        if self.profile is None:
            text = (
                f"MAV_AUTOPILOT {heartbeat.autopilot} on MAV_TYPE {heartbeat.type}: a firmware not known here"
            )
            tell("alarm", f"{text}; it is tracked and never tasked")

    def _on_position(self, message: Message, t_ns: int, tell: Tell) -> None:
        self._catch_up()
        verdict = self._clock.judge(message.time_boot_ms, t_ns)
        if verdict == "rebooted":
            self._reboot(tell)
        problem = self._refusal(message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
        if verdict == "late" and problem:
            problem = "late"
        elif not problem:
            report = self._report(
                t_ns, message.time_boot_ms, message.lat, message.lon, message.vx, message.vy
            )
            problem = self._contradiction(report, tell, late=verdict == "late")
        if problem:
            self.refused[problem] = self.refused.get(problem, 0) + 1
            return
        self.row[PLACE_NS:PLACES] = (
            t_ns, message.lat, message.lon, message.alt, message.vx, message.vy, message.hdg
        )  # fmt: skip
        self.row[PLACES] += 1
        self._judged_places = self.row.item(PLACES)

    def _report(
        self, t_ns: int, boot_ms: int, lat: int, lon: int, v_north_cm_s: int, v_east_cm_s: int
    ) -> Report:
        east_m, north_m = self._frame.to_local(lat * 1e-7, lon * 1e-7)
        return Report(t_ns, boot_ms, east_m, north_m, math.hypot(v_east_cm_s, v_north_cm_s) * 0.01)

    def _catch_up(self) -> None:
        """Go on from the last position that the kernel took: each of those was in order."""
        if self.row.item(PLACES) == self._judged_places:
            return
        self._judged_places = self.row.item(PLACES)
        t_ns, lat, lon, _, v_north_cm_s, v_east_cm_s, _ = self.row[PLACE_NS:PLACES].tolist()
        last = self._report(t_ns, self.row.item(BOOT_MS), lat, lon, v_north_cm_s, v_east_cm_s)
        self._motion.resume(last)
        self._voices.resume(last)

    def _contradiction(self, report: Report, tell: Tell, *, late: bool) -> str:
        """Hold a report against those before it, and say what comes of it; return why it is not believed."""
        self._voices.take(report)
        problem = "late" if late else self._motion.judge(report)
        for level, text in (*self._voices.news, *([] if late else self._motion.news)):
            tell(level, text)
        self.row[WATCHED] = bool(problem) or self._voices.is_watching
        return problem

    def watch(self, t_ns: int, tell: Tell) -> None:
        """Say when it is heard and gives no position that can be believed, and when it does again."""
        if not self.row[PLACES]:
            return
        silent_ns = t_ns - self.row.item(PLACE_NS)
        if not self._unplaced and silent_ns > _UNPLACED_NS:
            self._unplaced = True
            why = ", ".join(f"{count} {reason}" for reason, count in self.refused.items())
            text = f"no position that can be believed for {silent_ns / NS_PER_S:.0f} s"
            tell("alarm", f"{text}; refused so far: {why}" if why else text)
        elif self._unplaced and silent_ns <= _UNPLACED_NS:
            self._unplaced = False
            tell("info", "its positions are believed again")

    def _refusal(self, lat_deg: float, lon_deg: float, alt_msl_m: float) -> str:
        if NONE < self.row[BEST_FIX] < dialect.GPS_FIX_TYPE_3D_FIX:
            return "no fix"
        return position_problem(lat_deg, lon_deg, alt_msl_m, self._frame, self._max_distance_m)

    def _reboot(self, tell: Tell) -> None:
        """Forget what a boot changes; mode and arming come with the next heartbeat."""
        self.boots += 1
        self._mission_seq, self.home = -1, None
        self.row[BEST_FIX] = self.row[LAST_SEQUENCE] = self.row[BEAT] = NONE
        self._motion.begin()
        self.wants.begin()
        tell("alarm", "rebooted")

    def _on_mission_current(self, message: Message, _t_ns: int, _tell: Tell) -> None:
        if message.seq != self._mission_seq:
            self._mission_seq, self._state = message.seq, None

    def _on_home(self, message: Message, t_ns: int, _tell: Tell) -> None:
        home = Home(message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3)
        if not position_problem(*home, self._frame, self._max_distance_m):
            self.home = home
            self.wants.heard("HOME_POSITION", t_ns)

    def _on_sys_status(self, message: Message, _t_ns: int, _tell: Tell) -> None:
        percent = message.battery_remaining
        self.row[BATTERY_PERCENT] = percent if 0 <= percent <= 100 else NONE

    def _on_gps(self, message: Message, _t_ns: int, _tell: Tell) -> None:
        self.row[FIX_TYPE] = message.fix_type
        self.row[BEST_FIX] = max(message.fix_type, self.row.item(BEST_FIX))

    def _on_command_ack(self, message: Message, t_ns: int, tell: Tell) -> None:
        refused = self.wants.acknowledged(message, t_ns)
        if refused:
            tell("warning", f"does not give {refused}")
