"""Simulated ArduPlane: modes, arming, mission execution, landing, and coming down.

Behaviour of ArduPlane that ground stations must handle:

- The active item is cached. A replaced item is flown as it was, until the next item, a new entry into
  AUTO, or ``DO_SET_MISSION_CURRENT``.
- ``set_current(0)`` means item 1; an index outside the mission is refused.
- A mission that ends goes to RTL, and so does AUTO without a mission.
- Entering AUTO resumes at the current item (from the first, when the mission had been completed or
  shortened below it).
- A leg begins at the waypoint before, and its line is followed (`sim_vehicles.vehicle.guidance.Legs`). An
  item that ``DO_SET_MISSION_CURRENT`` selects in flight begins at the OLD waypoint; after the second such
  command, or after ``MISSION_SET_CURRENT``, it begins at the vehicle.
- A waypoint is passed within its radius, or beyond the finish line of its leg.
- Altitude is linear along a leg that rises or falls by ALT_SLOPE_MIN or more (0: along none). On other legs,
  and on a leg that begins less than 20 m above home and rises, the command is the item's altitude at once. A
  return descends along its leg and climbs at once.
- A take-off holds the heading of the runway up to its altitude.
- Arming is refused for a while after boot, while a pre-arm check fails, and in RTL.

Guidance and checks run at 10 Hz, as ArduPlane's do; the airframe runs at 100 Hz.

Emergencies: without thrust it glides down and stays in its mode, armed. Without a GPS fix it flies on, 10
s later by dead reckoning. A jump of the GPS position reaches the guidance after 4 s. A wreck stays armed
for 48 s, as one that was recorded; 10 s after the impact the state is no longer "active".

The ground is the elevation model's, and a vehicle that flies into it is a wreck. Without a model it is level
at home, and only landings and falling vehicles touch it.

Not simulated: stick input (MANUAL, FBWA and similar modes hold heading and altitude), and items other than
waypoint, unlimited and timed loiter, take-off, landing and return.

Positions are local east/north metres; altitudes are metres above the local frame's origin.
"""

from __future__ import annotations

import math
from collections import deque

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.geo import wrap_pi
from gcs.model import NS_PER_S
from sim_vehicles.autopilots.announcements import Announcer
from sim_vehicles.autopilots.autopilot_states import ITEM_NAMES, Home, ItemReached, MissionState, StatusText
from sim_vehicles.autopilots.autopilot_traits import ARDUPLANE, AutopilotTraits, Mode
from sim_vehicles.autopilots.failsafe import Failsafe, PlaneFailsafe
from sim_vehicles.autopilots.fence import FenceGuard
from sim_vehicles.autopilots.mission_protocol import MISSION, Item, MissionStore
from sim_vehicles.autopilots.parameters import Parameters
from sim_vehicles.vehicle.battery import Battery
from sim_vehicles.vehicle.faults import FaultKind, Faults
from sim_vehicles.vehicle.geodesy import Geodesy
from sim_vehicles.vehicle.guidance import Circle, Goal, Legs, Straight, ToPoint, Tuning, density_ratio
from sim_vehicles.vehicle.paper_airframe import Airframe

_CHECK_NS = NS_PER_S // 10
_GLIDE_SLOPE = 0.1
_TOUCHDOWN_M = 0.5
_CLEAR_M = 5.0
"""Above the ground, a vehicle that takes off rolls no more."""
_SHORT_M = 100.0
"""A landing that touches the ground within this distance of its point is one."""
_MIN_CLIMB_SLOPE_M = 20.0
"""Above home; lower, a vehicle climbs at once."""
_ALT_REACHED_M = 1.0
_ON_CIRCLE = 1.3
"""A timed loiter begins within this many radii of its centre."""
_OUTSIDE_CIRCLE = 1.05
"""Distance of the next item from the centre of a circle, in radii, from which a vehicle can head for it."""
_LINED_UP_RAD = math.radians(10.0)
_TURN_RAD = 2.0 * math.pi
_GLIDE_SPEED = 0.5
"""Of the cruising speed, without thrust."""
_DIVE_M_S = 18.0
"""Sink rate of a crash."""
_GLITCH_M = 200.0
_GLITCH_TRUSTED_S = 3.9
_STILL_ACTIVE_S = 10.0
_WRECK_DISARMED_NS = 48 * NS_PER_S

_NOT_ARMABLE = frozenset({Mode.RTL})
_MANUAL_LIKE = frozenset(
    {Mode.MANUAL, Mode.STABILIZE, Mode.TRAINING, Mode.ACRO, Mode.FBWA, Mode.FBWB, Mode.CRUISE}
)


class Autopilot:
    """One vehicle's autopilot.

    Parameters
    ----------
    airframe : Airframe
    airborne : bool
        True to start armed and circling; False to start disarmed on the ground.
    boot_t_ns : int
    """

    _widens_circles = True
    _failsafe: type[Failsafe] = PlaneFailsafe
    _disarmed_text = "Throttle disarmed"
    _armed_text = "Throttle armed"
    _fence_severity = mavlink.MAV_SEVERITY_NOTICE

    def __init__(
        self,
        airframe: Airframe,
        parameters: Parameters,
        geodesy: Geodesy,
        forward_speed_m_s: float,
        boot_t_ns: int,
        airborne: bool,
        traits: AutopilotTraits = ARDUPLANE,
    ) -> None:
        self.airframe = airframe
        self.parameters = parameters
        self.geodesy = geodesy
        self.forward_speed_m_s = forward_speed_m_s
        self.boot_t_ns = boot_t_ns
        self.traits = traits
        self._first = traits.home_items
        self.mission = MissionStore(MISSION, self.mission_home if self._first else None)
        self.fence = FenceGuard(parameters, geodesy, px4=traits.atomic)
        self.notices: deque[StatusText | ItemReached] = deque()
        self.home = Home(airframe.east_m, airframe.north_m, self._ground_below_m(0.0))
        self.mode = Mode.MANUAL
        self.armed = self.flying = airborne
        self.seq = 0
        """Current item, 0 before the first; as in ArduPlane, maybe beyond a shortened mission."""
        self.goal: Goal = Straight(airframe.heading_rad)
        self.alt_command_m = airframe.alt_rel_m
        self._slope: ToPoint | None = None
        """Leg with linear altitude; None: the command is that of the item."""
        self._item_alt_m = airframe.alt_rel_m
        self._ground_m = self.home.alt_m
        """Height of the ground below."""
        self._is_clear = airborne
        """True if it has been clear of the ground since it began to take off."""
        self._command = 0.0
        self.legs = Legs(airframe)
        self.faults = Faults()
        self.battery = Battery(self.faults, boot_t_ns)
        self._announcer = Announcer(self.faults, px4=traits.atomic)
        self.is_down = False
        """True after it came down elsewhere than by a landing of its mission, until it flies again."""
        self.is_wreck = False
        self._touched_ns: int | None = None
        """Time when it came down; None in the air and after a landing of its mission."""
        self._disarms_ns: int | None = None
        self.failsafe = self._failsafe(self)
        self._mission_running = False
        self._circled_checks = 0
        self._mission_complete = False
        self._item: Item | None = None
        self._landing = False
        self._check_ns = boot_t_ns
        # An airborne start has passed the ground checks.
        self._checks_done_ns = (
            boot_t_ns if airborne else boot_t_ns + int(parameters["ARMING_DELAY_S"] * NS_PER_S)
        )
        if airborne:
            self.set_mode(Mode.LOITER)

    # ------------------------------------------------------------ requests of the ground station

    def set_mode(self, mode: Mode) -> None:
        """Change the mode, if it is another one."""
        if mode is self.mode:
            return
        self._mission_running = False
        self._landing = False
        self.mode = mode
        airframe = self.airframe
        airframe.is_climbing_out = False
        self.legs.leave()
        if mode is Mode.AUTO:
            self._resume_mission()
        elif mode is Mode.RTL:
            self._return()
        elif mode in _MANUAL_LIKE:
            self._fly(Straight(airframe.heading_rad), airframe.alt_rel_m)
        elif mode is Mode.TAKEOFF:
            airframe.is_climbing_out = True
            self._fly(
                Straight(airframe.heading_rad),
                max(self.home.alt_m + self.parameters["TKOFF_ALT"], airframe.alt_rel_m),
            )
        else:  # LOITER, CIRCLE, GUIDED without a target.
            self._circle_here()

    def prearm_failure(self, t_ns: int) -> str | None:
        """Return the reason against arming, as ArduPilot's text; None if it may arm."""
        if self.mode in _NOT_ARMABLE:
            return f"{self.mode.name} mode not armable"
        if int(self.parameters["ARMING_CHECK"]) == 0 or t_ns >= self._checks_done_ns:
            return None
        return "Gyros inconsistent"

    def report_prearm_failure(self, t_ns: int) -> bool:
        """Send the reason against arming as a status text; return True if there is one."""
        failure = self.prearm_failure(t_ns)
        if failure is not None:
            self.notify(mavlink.MAV_SEVERITY_CRITICAL, f"PreArm: {failure}")
        return failure is not None

    def is_position_known(self, t_ns: int) -> bool:
        """Return True from half the start-up checks on: there is a fix and an origin."""
        return t_ns >= (self.boot_t_ns + self._checks_done_ns) // 2

    def arm(self, t_ns: int, force: bool = False) -> bool:
        """Arm if the checks pass; send the reason of a refusal as a status text."""
        if self.armed:
            return True
        if not force and self.report_prearm_failure(t_ns):
            return False
        self.armed = True
        self._touched_ns = None
        self.home = Home(self.airframe.east_m, self.airframe.north_m, self.airframe.alt_rel_m)
        self.notify(mavlink.MAV_SEVERITY_INFO, self._armed_text)
        return True

    def disarm(self, text: str = "") -> bool:
        """Disarm; refused in the air."""
        if self.flying:
            return False
        self._disarms_ns = None
        if self.armed:
            self.armed = False
            self.notify(mavlink.MAV_SEVERITY_INFO, text or self._disarmed_text)
        return True

    def set_current(self, seq: int, by_message: bool = False) -> bool:
        """Select item `seq` as it is stored now; return False if there is none.

        Parameters
        ----------
        by_message : bool
            True for ``MISSION_SET_CURRENT``, False for ``DO_SET_MISSION_CURRENT`` (see the module).
        """
        seq = max(seq, self._first)
        if by_message:
            self.legs.do_join = False
        if seq >= len(self.mission):
            return False
        self._mission_complete = False
        if self._mission_running:
            self._start_item(seq)
        else:
            self.seq = seq
        self.legs.do_join = self.legs.do_join and by_message
        return True

    def mission_cleared(self) -> None:
        """Reset the mission state after MISSION_CLEAR_ALL."""
        self.seq = 0
        self._item = None
        self._mission_complete = False

    def mission_replaced(self, first: int | None) -> None:
        """Begin a mission that was replaced as a whole at item `first`; None keeps the number."""
        self._mission_complete = False
        if first is not None:
            self.seq = first
        elif self.seq >= len(self.mission):
            self.seq = self._first
        if self._mission_running:
            self.legs.leave()
            self._start_item(self.seq)

    def guide_to(self, east_m: float, north_m: float, alt_m: float | None, radius_m: float = 0.0) -> bool:
        """Fly to a place and circle it; return False in other modes than GUIDED."""
        if self.mode is not Mode.GUIDED:
            return False
        self._fly(self._circle(east_m, north_m, radius_m), self.alt_command_m if alt_m is None else alt_m)
        return True

    def note_gcs_heartbeat(self, system_id: int, t_ns: int) -> None:
        """Pass the heartbeat of the own ground station to the failsafe."""
        if system_id == int(self.parameters["SYSID_MYGCS"]):
            self.failsafe.note_heartbeat(t_ns)

    @property
    def is_landing(self) -> bool:
        """True if the current item is a landing."""
        item = self._item
        return self._mission_running and item is not None and item.command == mavlink.MAV_CMD_NAV_LAND

    @property
    def height_agl_m(self) -> float:
        """Height above the ground below."""
        return self.airframe.alt_rel_m - self._ground_m

    def is_active(self, t_ns: int) -> bool:
        """Return True if HEARTBEAT shows MAV_STATE_ACTIVE: while it believes that it flies."""
        touched_ns = self._touched_ns
        return self.flying or (touched_ns is not None and t_ns - touched_ns < _STILL_ACTIVE_S * NS_PER_S)

    def landed_state(self, t_ns: int) -> int:
        """Return MAV_LANDED_STATE."""
        if self.is_active(t_ns):
            return int(mavlink.MAV_LANDED_STATE_IN_AIR)
        return int(mavlink.MAV_LANDED_STATE_ON_GROUND)

    def position_error_m(self, t_ns: int) -> tuple[float, float]:
        """Return east and north from the true position to the estimated one."""
        if self.faults.has_lasted(FaultKind.GLITCH, _GLITCH_TRUSTED_S, t_ns):
            return 0.0, _GLITCH_M
        return 0.0, 0.0

    def receiver_error_m(self) -> tuple[float, float]:
        """Return east and north from the true position to that of the GPS receiver."""
        return (0.0, _GLITCH_M) if FaultKind.GLITCH in self.faults else (0.0, 0.0)

    def fly_landing(self) -> bool:
        """Fly to the landing of the mission, in AUTO; return False without one."""
        seq = self._landing_seq()
        if seq is None:
            return False
        self.set_mode(Mode.AUTO)
        return self.set_current(seq, by_message=True)

    def _landing_seq(self) -> int | None:
        commands = [item.command for item in self.mission]
        return commands.index(mavlink.MAV_CMD_NAV_LAND) if mavlink.MAV_CMD_NAV_LAND in commands else None

    @property
    def mission_state(self) -> MissionState:
        """Return the mission state for MISSION_CURRENT."""
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
            self._check(t_ns)
        if not self.flying:
            return
        airframe = self.airframe
        speed = self.forward_speed_m_s
        if self._touched_ns is not None:
            self._slide()
            return
        sinking_m_s = self._sink()
        if sinking_m_s is not None:
            speed = sinking_m_s
            if airframe.alt_rel_m <= self._ground_m:
                self._come_down(t_ns, is_wreck=FaultKind.CRASH in self.faults)
                return
        elif self.is_landing:
            speed *= self._approach_fraction()
            if self._landing and airframe.alt_rel_m <= self._ground_m + _TOUCHDOWN_M:
                speed = 0.0
                if airframe.speed_m_s == 0.0:
                    self._landed()
                    return
        airframe.step(self._command, self.alt_command_m, speed)
        if self.geodesy.elevation is not None and airframe.alt_rel_m < self._ground_m:
            self._touch_ground(t_ns)

    def _touch_ground(self, t_ns: int) -> None:
        """Roll on at a take-off or landing; else be a wreck."""
        airframe = self.airframe
        goal = self.goal
        is_short = self.is_landing and isinstance(goal, ToPoint) and goal.distance_m(airframe) <= _SHORT_M
        if not self._is_clear or self._landing or is_short:
            airframe.alt_rel_m = self._ground_m
        elif self._sink() is None:
            self._come_down(t_ns, is_wreck=True)

    def _ground_below_m(self, level_m: float) -> float:
        """Return the height of the ground below; `level_m` without elevation."""
        return self.geodesy.ground_rel_m(self.airframe.east_m, self.airframe.north_m, level_m)

    def _sink(self) -> float | None:
        """Set the rate of sinking without thrust or of a dive; return the speed to fly, or None."""
        airframe = self.airframe
        if FaultKind.CRASH in self.faults:
            self._command = 0.0
            airframe.descent_m_s = _DIVE_M_S
            return self.forward_speed_m_s
        if FaultKind.ENGINE in self.faults:
            airframe.descent_m_s = airframe.speed_m_s / self.traits.glide_ratio
            return _GLIDE_SPEED * self.forward_speed_m_s
        airframe.descent_m_s = 0.0
        return None

    def _come_down(self, t_ns: int, *, is_wreck: bool) -> None:
        """Touch the ground where no landing was meant."""
        airframe = self.airframe
        self._touched_ns = t_ns
        self.is_down = True
        airframe.descent_m_s = 0.0
        airframe.alt_rel_m = self._ground_m
        if is_wreck:
            self.is_wreck = True
            self._disarms_ns = self._wreck_disarms_ns(t_ns)
            airframe.rest()
            self.flying = False

    def _wreck_disarms_ns(self, t_ns: int) -> int | None:
        return t_ns + _WRECK_DISARMED_NS

    def _slide(self) -> None:
        """Slow down on the ground to a standstill."""
        airframe = self.airframe
        airframe.is_climbing_out = False
        airframe.step(0.0, self._ground_m, 0.0)
        airframe.alt_rel_m = self._ground_m
        if airframe.speed_m_s == 0.0:
            airframe.rest()
            self.flying = False

    def _check(self, t_ns: int) -> None:
        """Run the 10 Hz tasks: failsafes, fence, mission, guidance."""
        self.failsafe.check(t_ns)
        self.notices += self._announcer.due(t_ns)
        if self._disarms_ns is not None and t_ns >= self._disarms_ns:
            self.disarm()
        if not self.flying:
            if not (self.armed and self._may_launch() and self._is_launching()):
                return
            self.flying = True
            self.is_down = self._is_clear = False
        self._ground_m = self._ground_below_m(self.home.alt_m)
        if self._touched_ns is not None:
            return
        self._is_clear |= self.airframe.alt_rel_m > self._ground_m + _CLEAR_M
        self._check_fence(t_ns)
        # It guides by the estimated position.
        airframe = self.airframe
        east_m, north_m = self.position_error_m(t_ns)
        airframe.east_m += east_m
        airframe.north_m += north_m
        self._guide()
        airframe.east_m -= east_m
        airframe.north_m -= north_m

    def _guide(self) -> None:
        if self._mission_running:
            self._watch_item()
        elif self.mode is Mode.TAKEOFF and isinstance(self.goal, Straight) and self._is_alt_reached():
            self._circle_here()
        self._follow_slope()
        parameters = self.parameters
        tuning = Tuning(parameters["NAVL1_PERIOD"], parameters["NAVL1_DAMPING"])
        self._command = self.airframe.command_for(self.goal, tuning)

    def _follow_slope(self) -> None:
        """Set the altitude command along the leg, up to the circle at its end."""
        leg = self._slope
        goal = self.goal
        if leg is None:
            return
        if isinstance(goal, Circle) and goal.distance_m(self.airframe) <= _ON_CIRCLE * abs(goal.radius_m):
            self._slope = None
            self.alt_command_m = self._item_alt_m
        else:
            self.alt_command_m = self._item_alt_m - leg.rise_ahead_m(self.airframe, self._slope_ends_m())

    def _slope_ends_m(self) -> float:
        """Return the distance from an item at which its altitude is commanded."""
        return 0.0

    def _has_slope(self, leg: ToPoint) -> bool:
        """Return True if altitude is linear along a leg."""
        if leg.rise_m > 0.0:
            is_high = self.airframe.alt_rel_m - self.home.alt_m > _MIN_CLIMB_SLOPE_M
            if self.mode is not Mode.AUTO or not is_high:
                return False
        min_rise_m = self.parameters["ALT_SLOPE_MIN"]
        return min_rise_m > 0.0 and abs(leg.rise_m) >= min_rise_m

    def _may_launch(self) -> bool:
        """Return True if it can fly: a vehicle that came down has to be armed again first."""
        return self._touched_ns is None and not self.is_wreck and FaultKind.ENGINE not in self.faults

    def _is_launching(self) -> bool:
        """Return True if an armed vehicle takes off by itself."""
        if self.mode is Mode.TAKEOFF:
            return True
        if self.mode is not Mode.AUTO or self._item is None:
            return False
        return bool(self._item.command == mavlink.MAV_CMD_NAV_TAKEOFF)

    def _approach_fraction(self) -> float:
        """Return ArduPlane's approach speed as a fraction of the cruising speed."""
        return 0.5 + 0.5 * min(self.parameters["AIRSPEED_MIN"] / self.parameters["AIRSPEED_CRUISE"], 1.0)

    def _is_alt_reached(self) -> bool:
        return self.airframe.alt_rel_m >= self.alt_command_m - _ALT_REACHED_M

    def _watch_item(self) -> None:
        item = self._item
        goal = self.goal
        airframe = self.airframe
        if item is None:
            return
        if self._landing:  # The flare ends at the ground, wherever that is.
            self.alt_command_m = self._ground_m
            return
        if item.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            if self._is_alt_reached():
                self.notify(mavlink.MAV_SEVERITY_INFO, f"Takeoff complete at {airframe.alt_rel_m:.2f}m")
                airframe.is_climbing_out = False
                self.legs.leave()
                self._next_item()
        elif item.command == mavlink.MAV_CMD_NAV_LOITER_TIME and isinstance(goal, Circle):
            is_there = goal.distance_m(airframe) <= _ON_CIRCLE * abs(goal.radius_m)
            self._circled_checks += is_there or self._circled_checks > 0
            over_s = self._circled_checks * _CHECK_NS / NS_PER_S - item.param1
            turns = over_s * airframe.speed_m_s / (_TURN_RAD * abs(goal.radius_m))
            if over_s >= 0.0 and self._is_lined_up(goal, self._exit_tolerance_rad(turns)):
                self._next_item()
        elif isinstance(goal, ToPoint):
            if item.command == mavlink.MAV_CMD_NAV_LAND:
                is_flat = self.geodesy.elevation is None
                end_m = self.home.alt_m if is_flat else self._alt_m(item)
                glide_m = end_m + _GLIDE_SLOPE * goal.distance_m(airframe)
                self.alt_command_m = min(self.alt_command_m, glide_m)
            if goal.is_reached(airframe):
                self._waypoint_reached(item, goal)

    def _exit_tolerance_rad(self, turns: float) -> float:
        """Return the course error up to which a timed circle is left (`ModeLoiter::isHeadingLinedUp`)."""
        return _LINED_UP_RAD * (1 + int(turns))

    def _is_lined_up(self, circle: Circle, tolerance_rad: float) -> bool:
        """Return True if the course leads to the next item, or if that is inside the circle."""
        if self.seq + 1 >= len(self.mission):
            return True
        airframe = self.airframe
        east_m, north_m = self._place(self.mission[self.seq + 1])
        away_m = math.hypot(east_m - circle.east_m, north_m - circle.north_m)
        if away_m <= _OUTSIDE_CIRCLE * abs(circle.radius_m):
            return True
        bearing = math.atan2(east_m - airframe.east_m, north_m - airframe.north_m)
        return abs(wrap_pi(bearing - airframe.course_rad)) <= tolerance_rad

    def _waypoint_reached(self, item: Item, goal: ToPoint) -> None:
        distance_m = goal.distance_m(self.airframe)
        if item.command == mavlink.MAV_CMD_NAV_LAND:
            self._landing = True
            self._fly(Straight(self.airframe.heading_rad), self._ground_m)
            return
        word = "Reached" if distance_m <= goal.accept_radius_m else "Passed"
        self.notify(mavlink.MAV_SEVERITY_INFO, f"{word} waypoint #{self.seq} dist {distance_m:.0f}m")
        self._next_item()

    def _landed(self) -> None:
        self.airframe.rest()
        self.flying = self._landing = False
        self.notices.append(ItemReached(self.seq))
        self._mission_running = False
        self._mission_complete = True
        self.disarm()

    def _next_item(self) -> None:
        self.notices.append(ItemReached(self.seq))
        if self.seq + 1 < len(self.mission):
            self._start_item(self.seq + 1)
        else:
            self._end_mission()

    def _end_mission(self) -> None:
        self._mission_complete = True
        mode = self.traits.ends_in
        self.notify(mavlink.MAV_SEVERITY_INFO, f"Mission complete, changing mode to {mode.name}")
        self.set_mode(mode)

    def _resume_mission(self) -> None:
        if len(self.mission) <= self._first:
            self._end_mission()
            return
        first = self._mission_complete or not self._first <= self.seq < len(self.mission)
        self._mission_running = True
        self._mission_complete = False
        self._start_item(self._first if first else self.seq)

    def _start_item(self, seq: int) -> None:
        item = self.mission[seq]
        self.seq = seq
        self._item = item
        self._landing = False
        airframe = self.airframe
        east_m, north_m = self._place(item)
        alt_m = self._alt_m(item)
        self.notify(mavlink.MAV_SEVERITY_INFO, f"Mission: {seq} {ITEM_NAMES[item.command]}")
        if item.command == mavlink.MAV_CMD_NAV_LOITER_UNLIM:
            leg = self.legs.begin(east_m, north_m, alt_m, 0.0)
            self._fly(self._circle(east_m, north_m, item.param3, leg), alt_m, leg)
        elif item.command == mavlink.MAV_CMD_NAV_LOITER_TIME:
            self._circled_checks = 0
            leg = self.legs.begin(east_m, north_m, alt_m, 0.0)
            radius_m = 0.0 if self._widens_circles else item.param3  # ArduPlane keeps its sign only
            self._fly(self._circle(east_m, north_m, radius_m, leg), alt_m, leg)
        elif item.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            airframe.is_climbing_out = True
            self._fly(self._climb_goal(item), alt_m)
        elif item.command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            self.set_mode(Mode.RTL)
        else:
            # A landing starts its glide at the present height.
            is_landing = item.command == mavlink.MAV_CMD_NAV_LAND
            radius_m = (0.0 if is_landing else item.param2) or self.parameters["WP_RADIUS"]
            leg = self.legs.begin(east_m, north_m, alt_m, radius_m)
            if is_landing:
                self._fly(leg, airframe.alt_rel_m)
            else:
                self._fly(leg, alt_m, leg)

    def _climb_goal(self, _item: Item) -> Goal:
        """Return the goal of a take-off: the heading of the runway."""
        return Straight(self.airframe.heading_rad)

    def _place(self, item: Item) -> tuple[float, float]:
        if item.x == 0 and item.y == 0:  # ArduPilot: the present position.
            return self.airframe.east_m, self.airframe.north_m
        return self.geodesy.to_local(item.x * 1e-7, item.y * 1e-7)

    def _alt_m(self, item: Item) -> float:
        if item.frame in (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT):
            return item.z - self.geodesy.frame.alt_msl_m
        return self.home.alt_m + item.z

    def mission_home(self) -> Item:
        """Return home as item 0 of the mission, with its altitude above sea level."""
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
        radius_m = self.parameters["RTL_RADIUS"]
        rally = self.fence.return_point((self.airframe.east_m, self.airframe.north_m))
        alt_m = self.airframe.alt_rel_m if altitude_m < 0.0 else self.home.alt_m + altitude_m
        place = self.home.east_m, self.home.north_m
        if rally is not None:
            place = rally[:2]
            alt_m = self.home.alt_m + rally[2]
        leg = self.legs.begin(*place, alt_m, 0.0)
        self._fly(self._circle(*place, radius_m), alt_m, leg)

    def _circle_here(self) -> None:
        airframe = self.airframe
        airframe.is_climbing_out = False
        self._fly(self._circle(airframe.east_m, airframe.north_m), airframe.alt_rel_m)

    def _loiter_radius_m(self) -> float:
        return self.parameters["WP_LOITER_RAD"]

    def _circle(
        self, east_m: float, north_m: float, radius_m: float = 0.0, leg: ToPoint | None = None
    ) -> Circle:
        """Return a circle; ArduPlane widens its radius in thin air."""
        radius_m = radius_m or self._loiter_radius_m()
        if self._widens_circles:
            radius_m /= density_ratio(self.geodesy.frame.alt_msl_m + self.airframe.alt_rel_m)
        return Circle(east_m, north_m, radius_m, leg)

    def _fly(self, goal: Goal, alt_m: float, leg: ToPoint | None = None) -> None:
        """Fly to a goal and an altitude: at once, or along a leg."""
        self.goal = goal
        self.alt_command_m = self._item_alt_m = alt_m
        self._slope = leg if leg is not None and self._has_slope(leg) else None

    def _check_fence(self, t_ns: int) -> None:
        airframe = self.airframe
        home = self.home
        place = (airframe.east_m, airframe.north_m)
        home_m = (home.east_m, home.north_m)
        fence = self.fence
        text = fence.check(place, home_m, airframe.alt_rel_m - home.alt_m)
        reaction = fence.reaction
        if text:
            self.notify(self._fence_severity, text)
            if fence.is_breached and reaction is not None:
                self.failsafe.breach(reaction, t_ns)

    def notify(self, severity: int, text: str) -> None:
        """Queue a status text."""
        self.notices.append(StatusText(severity, text))
