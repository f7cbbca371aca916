"""The autopilot: modes, arming, mission execution and failsafe, after ArduPlane.

What it shares with ArduPlane, because ground stations trip over it:

- The active item is cached. An item that is replaced while it is flown keeps being flown as it was, until the
  mission moves on, AUTO is entered anew, or ``DO_SET_MISSION_CURRENT`` reads it again.
- ``set_current(0)`` means item 1; an index outside the mission is refused.
- A mission that ends goes to RTL, and so does AUTO without a mission.
- Entering AUTO resumes at the current item (from the first, when the mission had been completed or shortened
  below it).
- Arming is refused for a while after boot, and while a pre-arm check fails.

What it leaves out: stick input (MANUAL, FBWA and their like hold heading and altitude), glide slopes between
items, and any item but waypoint, unlimited loiter, take-off, landing and
return.

Positions are local east/north metres; altitudes are metres above the local frame's origin.
"""

from __future__ import annotations

from collections import deque

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.model import NS_PER_S
from sim_vehicles.airframe import Airframe
from sim_vehicles.autopilot_state import ITEM_NAMES, Home, ItemReached, MissionState, StatusText
from sim_vehicles.fence import FenceGuard
from sim_vehicles.geodesy import Geodesy
from sim_vehicles.guidance import Circle, Goal, Straight, ToPoint
from sim_vehicles.missions import MISSION, Item, MissionStore
from sim_vehicles.parameters import Parameters
from sim_vehicles.personality import ARDUPLANE, Mode, Personality

_CHECK_NS = NS_PER_S // 10
_FENCE_RTL = 1
_GLIDE_SLOPE = 0.1
_TOUCHDOWN_M = 0.5
_ALT_REACHED_M = 1.0


_LAUNCHING = frozenset({Mode.AUTO, Mode.TAKEOFF})
_MANUAL_LIKE = frozenset(
    {Mode.MANUAL, Mode.STABILIZE, Mode.TRAINING, Mode.ACRO, Mode.FBWA, Mode.FBWB, Mode.CRUISE}
)


class Autopilot:
    """One vehicle's autopilot.

    Parameters
    ----------
    airframe : Airframe
        What it flies; `step` moves it.
    airborne : bool
        True: armed, circling where it is, ready at once. False: disarmed on the ground, as after switching
        on.
    boot_t_ns : int
        When it was switched on.
    """

    def __init__(
        self,
        airframe: Airframe,
        parameters: Parameters,
        geodesy: Geodesy,
        forward_speed_m_s: float,
        boot_t_ns: int,
        airborne: bool,
        personality: Personality = ARDUPLANE,
    ) -> None:
        self.airframe = airframe
        self.parameters = parameters
        self.geodesy = geodesy
        self.forward_speed_m_s = forward_speed_m_s
        self.boot_t_ns = boot_t_ns
        self.personality = personality
        self._first = personality.home_items
        self.mission = MissionStore(MISSION, self.mission_home if self._first else None)
        self.fence = FenceGuard(parameters, geodesy)
        self._breached = False
        self.notices: deque[StatusText | ItemReached] = deque()
        self.home = Home(airframe.east_m, airframe.north_m, 0.0)
        self.mode = Mode.MANUAL
        self.armed = self.flying = airborne
        self.seq = 0
        """Item that is flown, 0 before any; as ArduPlane reports it, even beyond a shortened mission."""
        self.goal: Goal = Straight(airframe.heading_rad)
        self.alt_command_m = airframe.alt_rel_m
        self.failsafe = False
        self._mission_running = False
        self._mission_complete = False
        self._item: Item | None = None
        self._landing = False
        self._gcs_heard_ns: int | None = None
        self._check_ns = boot_t_ns
        # An airborne start has its ground checks behind it.
        self._checks_done_ns = (
            boot_t_ns if airborne else boot_t_ns + int(parameters["ARMING_DELAY_S"] * NS_PER_S)
        )
        if airborne:
            self.set_mode(Mode.LOITER)

    # ------------------------------------------------------------ what the ground may ask

    def set_mode(self, mode: Mode) -> None:
        """Change mode; nothing happens when it is the present one."""
        if mode is self.mode:
            return
        self._mission_running = False
        self._landing = False
        self.mode = mode
        airframe = self.airframe
        if mode is Mode.AUTO:
            self._resume_mission()
        elif mode is Mode.RTL:
            self._return()
        elif mode in _MANUAL_LIKE:
            self._fly(Straight(airframe.heading_rad), airframe.alt_rel_m)
        elif mode is Mode.TAKEOFF:
            self._fly(
                Straight(airframe.heading_rad),
                max(self.home.alt_m + self.parameters["TKOFF_ALT"], airframe.alt_rel_m),
            )
        else:  # LOITER, CIRCLE, GUIDED without a target: round the place where it was entered
            self._circle_here()

    def prearm_failure(self, t_ns: int) -> str | None:
        """Why it cannot arm now, in ArduPilot's words."""
        if int(self.parameters["ARMING_CHECK"]) == 0 or t_ns >= self._checks_done_ns:
            return None
        return "Gyros inconsistent"

    def report_prearm_failure(self, t_ns: int) -> bool:
        """Say as a status text why it cannot arm now; return True if there is a reason."""
        failure = self.prearm_failure(t_ns)
        if failure is not None:
            self._tell(mavlink.MAV_SEVERITY_CRITICAL, f"PreArm: {failure}")
        return failure is not None

    def is_position_known(self, t_ns: int) -> bool:
        """Whether there is a fix and an origin: half-way through the start-up checks."""
        return t_ns >= (self.boot_t_ns + self._checks_done_ns) // 2

    def arm(self, t_ns: int, force: bool = False) -> bool:
        """Arm, if the checks let it; the reason of a refusal is told as a status text."""
        if self.armed:
            return True
        if not force and self.report_prearm_failure(t_ns):
            return False
        self.armed = True
        self.home = Home(self.airframe.east_m, self.airframe.north_m, self.airframe.alt_rel_m)
        self._tell(mavlink.MAV_SEVERITY_INFO, "Throttle armed")
        return True

    def disarm(self) -> bool:
        """Disarm; refused in the air."""
        if self.flying:
            return False
        if self.armed:
            self.armed = False
            self._tell(mavlink.MAV_SEVERITY_INFO, "Throttle disarmed")
        return True

    def set_current(self, seq: int) -> bool:
        """Fly item `seq` as it is stored now (in AUTO at once, else next time); False when there is none."""
        seq = max(seq, self._first)
        if seq >= len(self.mission):
            return False
        self._mission_complete = False
        if self._mission_running:
            self._start_item(seq, (self.airframe.east_m, self.airframe.north_m))
        else:
            self.seq = seq
        return True

    def mission_cleared(self) -> None:
        """The mission was cleared: nothing of it is remembered."""
        self.seq = 0
        self._item = None
        self._mission_complete = False

    def mission_replaced(self, first: int | None) -> None:
        """Another mission is stored as a whole: begin at item `first`, or go on with the same number."""
        self._mission_complete = False
        self.seq = first if first is not None else self.seq if self.seq < len(self.mission) else self._first
        if self._mission_running:
            self._start_item(self.seq, (self.airframe.east_m, self.airframe.north_m))

    def guide_to(self, east_m: float, north_m: float, alt_m: float | None, radius_m: float = 0.0) -> bool:
        """In GUIDED: go to a place and circle it. False in any other mode."""
        if self.mode is not Mode.GUIDED:
            return False
        self._fly(
            Circle(east_m, north_m, radius_m or self.parameters["WP_LOITER_RAD"]),
            self.alt_command_m if alt_m is None else alt_m,
        )
        return True

    def heard_gcs(self, system_id: int, t_ns: int) -> None:
        """A ground station's heartbeat arrived."""
        if system_id == int(self.parameters["SYSID_MYGCS"]):
            self._gcs_heard_ns = t_ns
            self.failsafe = False

    @property
    def mission_state(self) -> MissionState:
        """What MISSION_CURRENT says of the mission."""
        if len(self.mission) <= self._first:
            return MissionState.NO_MISSION
        if self._mission_running:
            return MissionState.ACTIVE
        return MissionState.COMPLETE if self._mission_complete else MissionState.NOT_STARTED

    # ------------------------------------------------------------ flying

    def step(self, t_ns: int) -> None:
        """Guide and move the airframe by one step of 10 ms; `t_ns` is its end."""
        if t_ns >= self._check_ns:
            self._check_ns = t_ns + _CHECK_NS
            self._check_failsafe(t_ns)
            self._check_fence()
        airframe = self.airframe
        if not self.flying:
            if not (self.armed and self.mode in _LAUNCHING):
                return
            self.flying = True
        if self._mission_running:
            self._watch_item()
        elif self.mode is Mode.TAKEOFF and isinstance(self.goal, Straight) and self._is_alt_reached():
            self._circle_here()
        speed = self.forward_speed_m_s
        if self._landing and airframe.alt_rel_m <= self.home.alt_m + _TOUCHDOWN_M:
            speed = 0.0
            if airframe.speed_m_s == 0.0:
                self._landed()
                return
        airframe.step(self.goal.heading_error_rad(airframe), self.alt_command_m, speed)

    def _is_alt_reached(self) -> bool:
        return self.airframe.alt_rel_m >= self.alt_command_m - _ALT_REACHED_M

    def _watch_item(self) -> None:
        item, goal, airframe = self._item, self.goal, self.airframe
        if item is None or self._landing:
            return
        if isinstance(goal, ToPoint):
            if item.command == mavlink.MAV_CMD_NAV_LAND:
                glide_m = self.home.alt_m + _GLIDE_SLOPE * goal.distance_m(airframe)
                self.alt_command_m = min(self.alt_command_m, glide_m)
            if goal.is_reached(airframe):
                self._waypoint_reached(item, goal)
        elif item.command == mavlink.MAV_CMD_NAV_TAKEOFF and self._is_alt_reached():
            self._tell(mavlink.MAV_SEVERITY_INFO, f"Takeoff complete at {airframe.alt_rel_m:.2f}m")
            self._next_item((airframe.east_m, airframe.north_m))

    def _waypoint_reached(self, item: Item, goal: ToPoint) -> None:
        distance_m = goal.distance_m(self.airframe)
        if item.command == mavlink.MAV_CMD_NAV_LAND:
            self._landing = True
            self._fly(Straight(self.airframe.heading_rad), self.home.alt_m)
            return
        word = "Reached" if distance_m <= goal.accept_radius_m else "Passed"
        self._tell(mavlink.MAV_SEVERITY_INFO, f"{word} waypoint #{self.seq} dist {distance_m:.0f}m")
        self._next_item((goal.east_m, goal.north_m))

    def _landed(self) -> None:
        self.airframe.rest()
        self.flying = self._landing = False
        self.notices.append(ItemReached(self.seq))
        self._mission_running, self._mission_complete = False, True
        self.disarm()

    def _next_item(self, leg_from_m: tuple[float, float]) -> None:
        self.notices.append(ItemReached(self.seq))
        if self.seq + 1 < len(self.mission):
            self._start_item(self.seq + 1, leg_from_m)
        else:
            self._end_mission()

    def _end_mission(self) -> None:
        self._mission_complete = True
        mode = self.personality.ends_in
        self._tell(mavlink.MAV_SEVERITY_INFO, f"Mission complete, changing mode to {mode.name}")
        self.set_mode(mode)

    def _resume_mission(self) -> None:
        if len(self.mission) <= self._first:
            self._end_mission()
            return
        first = self._mission_complete or not self._first <= self.seq < len(self.mission)
        self._mission_running, self._mission_complete = True, False
        self._start_item(self._first if first else self.seq, (self.airframe.east_m, self.airframe.north_m))

    def _start_item(self, seq: int, leg_from_m: tuple[float, float]) -> None:
        item = self.mission[seq]
        self.seq, self._item, self._landing = seq, item, False
        airframe = self.airframe
        east_m, north_m = self._place(item)
        alt_m = self._alt_m(item)
        self._tell(mavlink.MAV_SEVERITY_INFO, f"Mission: {seq} {ITEM_NAMES[item.command]}")
        if item.command == mavlink.MAV_CMD_NAV_LOITER_UNLIM:
            self._fly(Circle(east_m, north_m, item.param3 or self.parameters["WP_LOITER_RAD"]), alt_m)
        elif item.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            self._fly(Straight(airframe.heading_rad), alt_m)
        elif item.command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            self.set_mode(Mode.RTL)
        else:
            # A landing glides down from wherever it is.
            is_landing = item.command == mavlink.MAV_CMD_NAV_LAND
            radius_m = 0.0 if is_landing else item.param2
            leg = ToPoint(
                east_m, north_m, east_m - leg_from_m[0], north_m - leg_from_m[1],
                radius_m or self.parameters["WP_RADIUS"],
            )  # fmt: skip
            self._fly(leg, airframe.alt_rel_m if is_landing else alt_m)

    def _place(self, item: Item) -> tuple[float, float]:
        if item.x == 0 and item.y == 0:  # ArduPilot takes this as "here"
            return self.airframe.east_m, self.airframe.north_m
        return self.geodesy.to_local(item.x * 1e-7, item.y * 1e-7)

    def _alt_m(self, item: Item) -> float:
        if item.frame in (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT):
            return item.z - self.geodesy.frame.alt_msl_m
        return self.home.alt_m + item.z

    def mission_home(self) -> Item:
        """Home as item 0 of the mission: latitude, longitude, altitude above sea level."""
        lat_deg, lon_deg = self.geodesy.to_geodetic(self.home.east_m, self.home.north_m)
        alt_msl_m = round(self.geodesy.frame.alt_msl_m + self.home.alt_m, 2)
        return Item(
            mavlink.MAV_CMD_NAV_WAYPOINT,
            mavlink.MAV_FRAME_GLOBAL,
            x=round(lat_deg * 1e7),
            y=round(lon_deg * 1e7),
            z=alt_msl_m,
        )

    def _return(self) -> None:
        altitude_m = self.parameters["RTL_ALTITUDE"]
        radius_m = self.parameters["RTL_RADIUS"] or self.parameters["WP_LOITER_RAD"]
        rally = self.fence.returns_to((self.airframe.east_m, self.airframe.north_m))
        if rally is not None:
            self._fly(Circle(rally[0], rally[1], radius_m), self.home.alt_m + rally[2])
            return
        self._fly(
            Circle(self.home.east_m, self.home.north_m, radius_m),
            self.airframe.alt_rel_m if altitude_m < 0.0 else self.home.alt_m + altitude_m,
        )

    def _circle_here(self) -> None:
        airframe = self.airframe
        self._fly(
            Circle(airframe.east_m, airframe.north_m, self.parameters["WP_LOITER_RAD"]), airframe.alt_rel_m
        )

    def _fly(self, goal: Goal, alt_m: float) -> None:
        self.goal, self.alt_command_m = goal, alt_m

    def _check_failsafe(self, t_ns: int) -> None:
        if self.failsafe or self._gcs_heard_ns is None or int(self.parameters["FS_GCS_ENABL"]) == 0:
            return
        if not self.flying or t_ns - self._gcs_heard_ns < self.parameters["FS_LONG_TIMEOUT"] * NS_PER_S:
            return
        self.failsafe = True
        self._tell(mavlink.MAV_SEVERITY_WARNING, "GCS failsafe")
        keeps_on = (
            self.mode in (Mode.AUTO, Mode.GUIDED, Mode.LOITER) and int(self.parameters["FS_LONG_ACTN"]) == 0
        )
        if not keeps_on:
            self.set_mode(Mode.RTL)

    def _check_fence(self) -> None:
        if not self.flying or int(self.parameters["FENCE_ACTION"]) != _FENCE_RTL:
            return
        airframe, home = self.airframe, self.home
        place, home_m = (airframe.east_m, airframe.north_m), (home.east_m, home.north_m)
        kind = self.fence.breach(place, home_m, airframe.alt_rel_m - home.alt_m)
        if kind and not self._breached:
            self._tell(mavlink.MAV_SEVERITY_WARNING, f"{kind} fence breached")
            self.set_mode(Mode.RTL)
        elif self._breached and not kind:
            self._tell(mavlink.MAV_SEVERITY_INFO, "Fence breach cleared")
        self._breached = bool(kind)

    def _tell(self, severity: int, text: str) -> None:
        self.notices.append(StatusText(severity, text))
