"""Banked airframe, fitted to ArduPlane's plane: bank, turn, throttle and take-off run, climb, sink.

Commands are bank angles. Bank follows its command as a first-order lag with a limited rate. The plane turns
at ``efficiency (g + climb acceleration) tan(bank) / airspeed``; the efficiency is below 1 since it slips
outwards. Take-off is at full power: the plane rolls, rotates, climbs steeply, and slows to cruising speed
once level.

Altitude is held as ArduPlane's TECS holds it. The demanded altitude follows its command no faster than the
greatest climb or sink rate, and the plane follows the demand with a lag of `ALT_LAG_S`: in a climb of 2 m/s
it flies 6 m below the line. Thrust keeps the airspeed in climbs and descents.

Constants are fits to the flights of `tests/helpers/recorded_flights.py` and, of the altitude, to
`tests/sim_vehicles/data/arduplane_climbs.csv`. Speeds are fractions of the cruising speed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

from sim_vehicles.vehicle.paper_airframe import STEP_S, Airframe

if TYPE_CHECKING:
    from sim_vehicles.vehicle.guidance import Goal, Tuning

G_M_S2 = 9.80665
TURN_EFFICIENCY = 0.75
STEEP_RAD = 0.65
STEEP_LOSS_PER_RAD = 0.12
"""Decrease of the efficiency beyond a bank of STEEP_RAD."""
BANK_TIME_S = 0.35
MAX_BANK_RATE_RAD_S = math.radians(90.0)

FULL_POWER_SPEED = 1.25
"""Airspeed at full power in the climb."""
FULL_POWER_TIME_S = 2.3
ROTATION_SPEED = 0.8
STARTING_S = 0.75
"""Time from full power to the first movement."""
ROTATION_TIME_S = 0.4
ALT_LAG_S = 3.0
CLIMB_TIME_S = 0.7
CLIMB_ACCELERATION_M_S2 = 4.0
SLOWING_M_S2 = 1.85
_LEVEL_M_S = 3.0
"""Climb rate above which the plane does not slow down."""


class BankedAirframe(Airframe):
    """One vehicle's motion; the command is a bank angle in radians, positive to the right."""

    __slots__ = ("_alt_demand_m", "_power_s")

    estimates_calm: ClassVar[bool] = True

    def __init__(
        self, east_m: float, north_m: float, alt_rel_m: float, heading_rad: float, speed_m_s: float
    ) -> None:
        super().__init__(east_m, north_m, alt_rel_m, heading_rad, speed_m_s)
        self._alt_demand_m = alt_rel_m
        self._power_s = 0.0

    def command_for(self, goal: Goal, tuning: Tuning) -> float:
        """Return the bank angle of a balanced turn with the lateral acceleration, within the limit."""
        bank = math.atan(goal.lateral_m_s2(self, tuning) / G_M_S2)
        return min(max(bank, -self.max_bank_rad), self.max_bank_rad)

    def step(self, command: float, alt_command_m: float, speed_command_m_s: float) -> None:
        """Advance by 10 ms."""
        u = self.speed_m_s
        heading = self.heading_rad
        climb = self.climb_m_s
        if self.is_climbing_out and not self.descent_m_s:
            is_off = self._climb_out(speed_command_m_s)
            self._alt_demand_m = self.alt_rel_m
        else:
            is_off = True
            self._hold(alt_command_m, speed_command_m_s)
        pull = G_M_S2 + (self.climb_m_s - climb) / STEP_S
        rate = (command - self.roll_rad) / BANK_TIME_S
        self.roll_rate_rad_s = rate = min(max(rate, -MAX_BANK_RATE_RAD_S), MAX_BANK_RATE_RAD_S)
        self.roll_rad += STEP_S * rate
        steep = abs(self.roll_rad) - STEEP_RAD
        efficiency = TURN_EFFICIENCY - STEEP_LOSS_PER_RAD * steep if steep > 0.0 else TURN_EFFICIENCY
        self.yaw_rate_rad_s = efficiency * pull * math.tan(self.roll_rad) / max(u, 1.0)
        self.heading_rad = heading + STEP_S * self.yaw_rate_rad_s
        over_ground = math.sqrt(u * u - climb * climb) if abs(climb) < u else 0.0
        self.north_m += STEP_S * over_ground * math.cos(heading)
        self.east_m += STEP_S * over_ground * math.sin(heading)
        if is_off:
            self.north_m += STEP_S * self.wind_north_m_s
            self.east_m += STEP_S * self.wind_east_m_s

    def _hold(self, alt_command_m: float, speed_command_m_s: float) -> None:
        change = alt_command_m - self._alt_demand_m
        self._alt_demand_m += min(max(change, -STEP_S * self.max_sink_m_s), STEP_S * self.max_climb_m_s)
        climb = (self._alt_demand_m - self.alt_rel_m) / ALT_LAG_S
        if self.descent_m_s:
            climb = -self.descent_m_s
            self._alt_demand_m = self.alt_rel_m
        pull = (climb - self.climb_m_s) / CLIMB_TIME_S
        pull = min(max(pull, -CLIMB_ACCELERATION_M_S2), CLIMB_ACCELERATION_M_S2)
        self.climb_m_s += STEP_S * pull
        self.alt_rel_m += STEP_S * self.climb_m_s
        u = self.speed_m_s
        if u != speed_command_m_s and self.climb_m_s < _LEVEL_M_S:
            change = SLOWING_M_S2 * STEP_S
            self.speed_m_s = min(max(speed_command_m_s, u - change), u + change)

    def _climb_out(self, speed_command_m_s: float) -> bool:
        """Take off and climb at full power; return True once the plane has left the ground."""
        self._power_s += STEP_S
        if self._power_s < STARTING_S:
            return self.speed_m_s > 0.0
        u = self.speed_m_s
        self.speed_m_s += STEP_S * (FULL_POWER_SPEED * speed_command_m_s - u) / FULL_POWER_TIME_S
        if u < ROTATION_SPEED * speed_command_m_s:
            return False
        self.climb_m_s += (self.climb_gradient * u - self.climb_m_s) * STEP_S / ROTATION_TIME_S
        self.alt_rel_m += STEP_S * self.climb_m_s
        return True

    def rest(self) -> None:
        """Stand still on the ground."""
        super().rest()
        self._power_s = 0.0
