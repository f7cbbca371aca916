"""Simulated PX4, where it differs from ArduPlane.

Observed on PX4 1.17-dev (SIH airplane), and read in its navigator:

- A mission is checked when it is stored, by MIS_TKO_LAND_REQ, also in the air; the MISSION_ACK does not
  show it. A mission rejected in flight leads to "No valid mission available, loitering", Hold, and
  ``mission_state`` NO_MISSION. AUTO is TEMPORARILY_REJECTED then, and arming in AUTO is refused.
- Armed on the ground in AUTO, it takes off with its stored mission from item 0, even after a landing.
- A mission that is stored in AUTO is flown at once, from the present position.
- A take-off flies towards its place while it climbs. When a mission is begun in the air, and its first point
  is more than NAV_FW_ALT_RAD higher, it climbs in a circle where it is, to within NAV_FW_ALT_RAD.
- It leaves a timed loiter towards the next item if the item asks for that heading (param2), else at once.
- Set to Hold on a circle it keeps that circle, and its height.
- Altitude is linear along a leg that begins at an item (first-order hold), up to NAV_LOITER_RAD before its
  end. Elsewhere the command is the item's altitude at once.
- It returns at RTL_RETURN_ALT above its rally point or home, and no lower than it is, and descends there in a
  circle to RTL_DESCEND_ALT. With RTL_TYPE 1 and a landing in its mission it climbs to RTL_RETURN_ALT where it
  is, and flies the mission from its landing on. A mission that is stored meanwhile, or an item that is
  selected, is flown at once, in RTL.
- In LAND it circles down where it is. It detects the landing 2.5 s after it came to rest, disarms 2 s
  after that, and shows the mode again that it had before the failsafe. Without thrust it comes down in
  its mode and stays armed.
"""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.model import NS_PER_S
from sim_vehicles.autopilots.arduplane import Autopilot
from sim_vehicles.autopilots.autopilot_states import ItemReached, MissionState
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.autopilots.failsafe import Px4Failsafe
from sim_vehicles.autopilots.mission_protocol import Item
from sim_vehicles.vehicle.guidance import Circle, Goal, ToPoint

_LAND_SINK_M_S = 0.9
_LAND_SPEED = 0.82
"""Of the cruising speed, in LAND."""
_DETECTED_NS = 2_500_000_000
_DISARMED_NS = 2 * NS_PER_S
_MISSION_LANDING = 1
_ALT_REACHED_M = 1.0
_ALT_RADIUS_M = 10.0
"""NAV_FW_ALT_RAD."""
_ON_CIRCLE = 1.3
"""Distance from the centre of a circle, in radii, within which a vehicle has reached it."""
_LINED_UP_RAD = math.radians(5.0)
_TAKE_OFF = 1
_LANDING = 2
_BOTH = 3
_BOTH_OR_NEITHER = 4
_LANDING_IN_AIR = 5


class Px4Autopilot(Autopilot):
    """One vehicle's autopilot; see the base class."""

    _widens_circles = False
    _failsafe = Px4Failsafe
    _armed_text = "Armed by external command"
    _disarmed_text = "Disarmed by external command"
    _fence_severity = mavlink.MAV_SEVERITY_CRITICAL
    _is_landing_detected = False
    _descent_m = 0.0
    """Height above home of the circle in which its return ends."""

    @property
    def mission_problem(self) -> str:
        """Reason of the navigator to reject the stored mission; empty if it is valid."""
        if not len(self.mission):
            return "no mission"
        commands = [item.command for item in self.mission]
        takes_off = mavlink.MAV_CMD_NAV_TAKEOFF in commands
        lands = mavlink.MAV_CMD_NAV_LAND in commands
        required = int(self.parameters["MIS_TKO_LAND_REQ"])
        if required == _LANDING_IN_AIR:
            required = _LANDING if self.flying else _BOTH_OR_NEITHER
        if required == _TAKE_OFF and not takes_off:
            return "Takeoff waypoint required."
        if required == _LANDING and not lands:
            return "Landing waypoint/pattern required."
        if required == _BOTH and not (takes_off and lands):
            return "Takeoff or Landing item missing."
        if required == _BOTH_OR_NEITHER and takes_off != lands:
            return "Add Takeoff and Landing or remove both."
        return ""

    @property
    def mission_state(self) -> MissionState:
        """Return the mission state for MISSION_CURRENT."""
        if self.mission_problem:
            return MissionState.NO_MISSION
        state = super().mission_state
        if state is MissionState.ACTIVE and self.mode is Mode.RTL:
            state = MissionState.NOT_STARTED
        return MissionState.PAUSED if state is MissionState.NOT_STARTED and self.seq else state

    def set_mode(self, mode: Mode) -> None:
        """Change the mode, if it is another one."""
        was = self.mode
        goal = self.goal
        alt_m = self.alt_command_m
        super().set_mode(mode)
        if mode is Mode.LOITER and mode is not was and self._is_on(goal):
            self._fly(goal, alt_m)
        if mode is Mode.AUTO and was is not Mode.AUTO and self.flying:
            self.notify(mavlink.MAV_SEVERITY_INFO, "Executing Mission")

    def _is_on(self, goal: Goal) -> bool:
        """Return True if the goal is a circle that it flies on now."""
        radius_m = self.parameters["NAV_ACC_RAD"]
        return isinstance(goal, Circle) and goal.distance_m(self.airframe) <= abs(goal.radius_m) + radius_m

    def is_active(self, t_ns: int) -> bool:
        """Return True if HEARTBEAT shows MAV_STATE_ACTIVE: while it is armed."""
        del t_ns
        return self.armed

    def landed_state(self, t_ns: int) -> int:
        """Return MAV_LANDED_STATE."""
        del t_ns
        item = self._item
        if not self.flying and (self._touched_ns is None or self._is_landing_detected):
            return int(mavlink.MAV_LANDED_STATE_ON_GROUND)
        if self.is_landing or self.mode is Mode.LAND:
            return int(mavlink.MAV_LANDED_STATE_LANDING)
        is_takeoff = (
            self._mission_running and item is not None and item.command == mavlink.MAV_CMD_NAV_TAKEOFF
        )
        return int(mavlink.MAV_LANDED_STATE_TAKEOFF if is_takeoff else mavlink.MAV_LANDED_STATE_IN_AIR)

    def step(self, t_ns: int) -> None:
        """Guide and move the airframe by one step of 10 ms."""
        super().step(t_ns)
        if self.mode is Mode.RTL and not self._mission_running:
            self._descend()
        touched_ns = self._touched_ns
        if touched_ns is None or self.flying or self._is_landing_detected:
            return
        if t_ns - touched_ns >= _DETECTED_NS:
            self._is_landing_detected = True
            self.notify(mavlink.MAV_SEVERITY_INFO, "Landing detected")
            if self.mode is Mode.LAND:
                self._disarms_ns = t_ns + _DISARMED_NS

    def _sink(self) -> float | None:
        speed = super()._sink()
        if speed is None and self.mode is Mode.LAND:
            self.airframe.descent_m_s = _LAND_SINK_M_S
            speed = _LAND_SPEED * self.forward_speed_m_s
        return speed

    def _wreck_disarms_ns(self, t_ns: int) -> int | None:
        del t_ns
        return None  # It stays armed.

    def _landed(self) -> None:
        self.airframe.rest()
        self.flying = self._landing = False
        self.notify(mavlink.MAV_SEVERITY_INFO, "Landing detected")
        self.notices.append(ItemReached(self.seq))
        self.notify(mavlink.MAV_SEVERITY_INFO, "Mission finished, landed")
        self._mission_running = False
        self._mission_complete = True
        self._disarms_ns = self._check_ns + _DISARMED_NS

    def disarm(self, text: str = "") -> bool:
        """Disarm; after a failsafe it shows the mode that it had before."""
        if self._disarms_ns is not None:
            text = "Disarmed by landing"
        was_armed = self.armed
        if not super().disarm(text):
            return False
        if was_armed and self.mode is Mode.LAND:
            assert isinstance(self.failsafe, Px4Failsafe)
            self.mode = self.failsafe.intended
            self._mission_complete = True
        return True

    def mission_replaced(self, first: int | None) -> None:
        """Check a stored mission as a whole; in AUTO, fly it at once, or hold."""
        problem = self.mission_problem
        if problem:
            self.notify(mavlink.MAV_SEVERITY_CRITICAL, f"Mission rejected: {problem}")
        if self.flying and self.mode is Mode.AUTO and problem:
            self.notify(mavlink.MAV_SEVERITY_CRITICAL, "No valid mission available, loitering")
            self.set_mode(Mode.LOITER)
        super().mission_replaced(first)

    def mission_cleared(self) -> None:
        """Reset the mission state; in AUTO, hold."""
        super().mission_cleared()
        if self.flying and self.mode is Mode.AUTO:
            self.notify(mavlink.MAV_SEVERITY_CRITICAL, "No valid mission available, loitering")
            self.set_mode(Mode.LOITER)

    def prearm_failure(self, t_ns: int) -> str | None:
        """Return the reason against arming."""
        if self.mode is Mode.AUTO and self.mission_problem:
            return "No valid mission available"
        return super().prearm_failure(t_ns)

    def arm(self, t_ns: int, force: bool = False) -> bool:
        """Arm; on the ground in AUTO, restart the mission."""
        was_armed = self.armed
        if not super().arm(t_ns, force):
            return False
        self._is_landing_detected = False
        if not was_armed and not self.flying and self.mode is Mode.AUTO:
            self.notify(mavlink.MAV_SEVERITY_INFO, "Executing Mission")
            # Where a landing interrupted the mission, it goes on there.
            self._mission_complete = not self.is_down
            self._resume_mission()
        return True

    def _climb_goal(self, item: Item) -> Goal:
        return self.legs.begin(*self._place(item), self._alt_m(item), 0.0)

    def _has_slope(self, leg: ToPoint) -> bool:
        return leg.is_tracked and self._mission_running

    def _loiter_radius_m(self) -> float:
        return self.parameters["NAV_LOITER_RAD"]

    def _slope_ends_m(self) -> float:
        return self.parameters["NAV_LOITER_RAD"]

    def _is_launching(self) -> bool:
        return self.mode is Mode.TAKEOFF or (self.mode is Mode.AUTO and self._mission_running)

    def _return(self) -> None:
        landing = self._landing_seq()
        if landing is not None and int(self.parameters["RTL_TYPE"]) == _MISSION_LANDING:
            self._return_to_landing(landing)
            return
        rally = self.fence.return_point((self.airframe.east_m, self.airframe.north_m))
        east_m, north_m, height_m = rally or (self.home.east_m, self.home.north_m, 0.0)
        ground_m = self.home.alt_m + height_m
        self._descent_m = ground_m + self.parameters["RTL_DESCEND_ALT"]
        alt_m = ground_m + self.parameters["RTL_RETURN_ALT"]
        circle = self._circle(east_m, north_m, self.parameters["RTL_LOITER_RAD"])
        self._fly(circle, max(self.airframe.alt_rel_m, alt_m))

    def _descend(self) -> None:
        """Descend in the circle at the end of a return, once it is reached."""
        goal = self.goal
        if not isinstance(goal, Circle) or not self._is_alt_reached():
            return
        if goal.distance_m(self.airframe) <= _ON_CIRCLE * abs(goal.radius_m):
            self.alt_command_m = min(self.alt_command_m, self._descent_m)

    def _return_to_landing(self, seq: int) -> None:
        """Climb where it is, then fly the mission from its landing on."""
        self._mission_running = True
        self._mission_complete = False
        self.notify(mavlink.MAV_SEVERITY_INFO, "Executing Mission")
        alt_m = self.home.alt_m + self.parameters["RTL_RETURN_ALT"]
        if self.airframe.alt_rel_m >= alt_m - _ALT_REACHED_M:
            self._start_item(seq)
            return
        alt_msl_m = math.ceil(self.geodesy.frame.alt_msl_m + alt_m)
        self.notify(mavlink.MAV_SEVERITY_INFO, f"RTL Mission land: climb to {alt_msl_m} m")
        self.seq = seq
        self._item = None
        self._circle_here()
        self.alt_command_m = alt_m

    def _resume_mission(self) -> None:
        super()._resume_mission()
        item = self._item
        if not self.flying or not self._mission_running or item is None:
            return
        alt_m = self._alt_m(item)
        if item.command == mavlink.MAV_CMD_NAV_TAKEOFF or alt_m <= self.airframe.alt_rel_m + _ALT_RADIUS_M:
            return
        self.notify(mavlink.MAV_SEVERITY_INFO, f"Climb to {alt_m - self.home.alt_m:.1f} meters above home")
        self.legs.leave()
        self._item = None
        self._circle_here()
        self.alt_command_m = alt_m

    def _exit_tolerance_rad(self, _turns: float) -> float:
        is_asked_for = self._item is not None and self._item.param2 > 0.0
        return _LINED_UP_RAD if is_asked_for else math.inf

    def _watch_item(self) -> None:
        within_m = _ALT_RADIUS_M if self.mode is Mode.AUTO else _ALT_REACHED_M
        if self._item is None and self.airframe.alt_rel_m >= self.alt_command_m - within_m:
            self._start_item(self.seq)
        super()._watch_item()
