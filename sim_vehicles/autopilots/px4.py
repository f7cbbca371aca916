"""PX4's autopilot, where it differs from ArduPlane's.

Observed on PX4 1.17-dev (SIH airplane), and read in its navigator:

- A mission is checked when it is stored, by MIS_TKO_LAND_REQ, also in the air; the MISSION_ACK does not show
  it. A mission rejected in flight leads to "No valid mission available, loitering", Hold, and
  ``mission_state`` NO_MISSION. AUTO is TEMPORARILY_REJECTED then, and arming in AUTO is refused.
- Armed on the ground in AUTO, it takes off with its stored mission from item 0, even after a landing.
- A mission that is stored in AUTO is flown at once, from the present position.
- A take-off flies towards its place while it climbs.
- It returns at RTL_RETURN_ALT above its rally point or home, and no lower than it is.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicles.autopilots.arduplane import Autopilot
from sim_vehicles.autopilots.base import Mode
from sim_vehicles.autopilots.failsafe import Px4Failsafe
from sim_vehicles.autopilots.mission_protocol import Item
from sim_vehicles.autopilots.records import MissionState
from sim_vehicles.vehicle.guidance import Goal

_TAKE_OFF, _LANDING, _BOTH, _BOTH_OR_NEITHER, _LANDING_IN_AIR = 1, 2, 3, 4, 5


class Px4Autopilot(Autopilot):
    """One vehicle's autopilot; see the base class."""

    _widens_circles = False
    _failsafe = Px4Failsafe

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
        return MissionState.NO_MISSION if self.mission_problem else super().mission_state

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
        if not was_armed and not self.flying and self.mode is Mode.AUTO:
            self.notify(mavlink.MAV_SEVERITY_INFO, "Executing Mission")
            self._mission_complete = True
            self._resume_mission()
        return True

    def _climb_goal(self, item: Item) -> Goal:
        return self.legs.begin(*self._place(item), 0.0)

    def _is_launching(self) -> bool:
        return self.mode is Mode.TAKEOFF or (self.mode is Mode.AUTO and self._mission_running)

    def _return(self) -> None:
        rally = self.fence.return_point((self.airframe.east_m, self.airframe.north_m))
        east_m, north_m, height_m = rally or (self.home.east_m, self.home.north_m, 0.0)
        alt_m = self.home.alt_m + height_m + self.parameters["RTL_RETURN_ALT"]
        self._fly(self._circle(east_m, north_m), max(self.airframe.alt_rel_m, alt_m))
