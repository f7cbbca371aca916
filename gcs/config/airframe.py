"""Airframe of the vehicles: the keys of `[airframe]`, and the turn radius that routes are made for."""

from __future__ import annotations

import math
from typing import Annotated

from msgspec import Meta

from gcs.config.schema import Positive
from gcs.config.validation import Table

_G_M_S2 = 9.80665
_STRONG_WIND_M_S = 30.0


class AirframeTable(Table, frozen=True, kw_only=True):
    """Turning flight of vehicles, for routes and acceptance radii."""

    speed_m_s: Positive = 15.0
    bank_deg: Annotated[float, Meta(ge=5.0, le=70.0)] = 30.0
    turn_lag_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 1.0
    wind_m_s: Annotated[float, Meta(ge=0.0, le=30.0)] = 0.0

    @property
    def turn_radius_m(self) -> float:
        """Maximum radius over ground of a level turn: V^2 / (g tan bank), downwind."""
        return (self.speed_m_s + self.wind_m_s) ** 2 / (_G_M_S2 * math.tan(math.radians(self.bank_deg)))

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
