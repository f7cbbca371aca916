"""Airframes: the keys of `[airframe]` and `[airframes.NAME]`, and what one agent flies with.

`[airframe]` holds for every agent. An agent that names an airframe of `[airframes]` takes the keys of that
table instead, each one that is there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

from msgspec import Meta

from gcs.config.schema import (
    AcceptRadius,
    ClimbAngle,
    LoiterRadius,
    MissionEnd,
    NotNegative,
    Positive,
)
from gcs.config.validation import Table

BankAngle = Annotated[float, Meta(ge=5.0, le=70.0)]
TurnLag = Annotated[float, Meta(ge=0.0, le=10.0)]
WindSpeed = Annotated[float, Meta(ge=0.0, le=30.0)]
VerticalRate = Annotated[float, Meta(gt=0.0, le=50.0)]

UNKNOWN_LOITER_RADIUS_M = 80.0
"""Loiter radius that the autopilot sets: PX4's NAV_LOITER_RAD; ArduPlane's WP_LOITER_RAD is 60."""
_G_M_S2 = 9.80665
_STRONG_WIND_M_S = 30.0
_PLANNED_SHARE = 0.85
"""Share of the sustained rates that routes use: a vehicle that is late must catch up, and autopilots climb
at these rates at most. ArduPlane in SITL kept 2.34 of 2.5 m/s through turns: it was 32 m late in 140 s."""


class AirframeTable(Table, frozen=True, kw_only=True):
    """Flight of vehicles in turns, climbs and descents, for routes and acceptance radii."""

    speed_m_s: Positive = 15.0
    bank_deg: BankAngle = 30.0
    turn_lag_s: TurnLag = 1.0
    wind_m_s: WindSpeed = 0.0
    climb_m_s: VerticalRate = 2.5
    sink_m_s: VerticalRate = 2.0


class NamedAirframeTable(Table, frozen=True, kw_only=True):
    """Airframe of the agents that name it. None: as in `[airframe]`, `[takeoff]` or `[mission]`."""

    speed_m_s: Positive | None = None
    bank_deg: BankAngle | None = None
    turn_lag_s: TurnLag | None = None
    wind_m_s: WindSpeed | None = None
    climb_m_s: VerticalRate | None = None
    sink_m_s: VerticalRate | None = None
    climb_deg: ClimbAngle | None = None
    ground_run_m: NotNegative | None = None
    accept_radius_m: AcceptRadius | None = None
    loiter_radius_m: LoiterRadius | None = None
    end: MissionEnd | None = None


def density_ratio(height_msl_m: float) -> float:
    """Return the density of the air relative to sea level, in the standard atmosphere below 11 km."""
    return float((1.0 - 2.25577e-5 * height_msl_m) ** 4.25588)


@dataclass(frozen=True, slots=True)
class AgentAirframe:
    """Flight of one agent: cruise, turns, climb after take-off and end of its missions."""

    speed_m_s: float
    """Airspeed; over terrain the true one at the greatest height of flight (`at_height`)."""
    bank_deg: float
    turn_lag_s: float
    wind_m_s: float
    climb_deg: float
    ground_run_m: float
    accept_radius_m: float
    loiter_radius_m: float
    """0: the autopilot's own."""
    end: MissionEnd
    climb_m_s: float = AirframeTable().climb_m_s
    sink_m_s: float = AirframeTable().sink_m_s
    air_density: float = 1.0
    """Relative to sea level."""

    def at_height(self, height_msl_m: float) -> AgentAirframe:
        """Return the airframe with the true airspeed at a height.

        Autopilots hold the indicated airspeed. So at 2,500 m it flies 13 % faster, its turns are 28 % wider,
        and its climbs are less steep.
        """
        density = density_ratio(height_msl_m)
        return replace(self, speed_m_s=self.speed_m_s / math.sqrt(density), air_density=density)

    @property
    def turn_radius_m(self) -> float:
        """Maximum radius over ground of a level turn: V^2 / (g tan bank), downwind."""
        return (self.speed_m_s + self.wind_m_s) ** 2 / (_G_M_S2 * math.tan(math.radians(self.bank_deg)))

    @property
    def still_air_radius_m(self) -> float:
        """Radius of a level turn in still air: V^2 / (g tan bank)."""
        return self.speed_m_s**2 / (_G_M_S2 * math.tan(math.radians(self.bank_deg)))

    @property
    def circle_radius_m(self) -> float:
        """Greatest radius of the flown loiter circle: in thin air ArduPlane widens it, PX4 does not."""
        widest_m = self.loiter_radius_m / self.air_density or UNKNOWN_LOITER_RADIUS_M
        return max(widest_m, self.turn_radius_m)

    @property
    def max_ground_speed_m_s(self) -> float:
        """Maximum plausible ground speed: a dive at three times the airspeed, downwind in strong wind."""
        return 3.0 * self.speed_m_s + max(self.wind_m_s, _STRONG_WIND_M_S)

    @property
    def turn_lag_m(self) -> float:
        """Distance flown before a turn begins."""
        return (self.speed_m_s + self.wind_m_s) * self.turn_lag_s

    @property
    def planned_radius_m(self) -> float:
        """Turn radius of planned routes: with the lag."""
        return math.hypot(self.turn_radius_m, self.turn_lag_m)

    @property
    def climb_gradient(self) -> float:
        """Height gained for each metre over ground in a planned climb, downwind."""
        return _PLANNED_SHARE * self.climb_m_s / (self.speed_m_s + self.wind_m_s)

    @property
    def sink_gradient(self) -> float:
        """Height lost for each metre over ground in a planned descent, downwind."""
        return _PLANNED_SHARE * self.sink_m_s / (self.speed_m_s + self.wind_m_s)

    def climb_length_m(self, altitude_rel_m: float) -> float:
        """Return the distance over ground of a take-off, from the start to an altitude above home."""
        return self.ground_run_m + altitude_rel_m / math.tan(math.radians(self.climb_deg))
