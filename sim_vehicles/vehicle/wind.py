"""Wind: a steady part, and gusts of each vehicle.

Gusts are a first-order Gauss-Markov process on each of east and north: ``g+ = a g + s sqrt(1 - a^2) n``,
with ``a = exp(-dt / T)``; s is their standard deviation and T their correlation time. This is Dryden's
longitudinal spectrum (MIL-F-8785C) at a fixed airspeed. They are stepped at 10 Hz.

The wind grows linearly with height up to 60 m, as in ArduPlane's simulation.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.model import NS_PER_S
from sim_vehicles.vehicle.paper_airframe import Airframe

_STEP_NS = NS_PER_S // 10
_DRAWN = 256
_WHOLE_ABOVE_M = 60.0


class Wind:
    """Wind at one vehicle.

    Parameters
    ----------
    east_m_s, north_m_s : float
        Steady velocity of the air.
    gust_std_m_s, gust_time_s : float
        Standard deviation and correlation time of the gusts.
    rng : Generator
    start_t_ns : int
    """

    def __init__(
        self,
        east_m_s: float,
        north_m_s: float,
        gust_std_m_s: float,
        gust_time_s: float,
        rng: np.random.Generator,
        start_t_ns: int,
    ) -> None:
        self._steady = (east_m_s, north_m_s)
        self._decay = math.exp(-_STEP_NS / NS_PER_S / gust_time_s)
        self._kick = gust_std_m_s * math.sqrt(1.0 - self._decay**2)
        self._gust = [gust_std_m_s * float(x) for x in rng.standard_normal(2)]
        self._rng = rng
        self._drawn: list[float] = []
        self._next_ns = start_t_ns

    def blow(self, airframe: Airframe, t_ns: int, height_agl_m: float) -> None:
        """Set the airframe's wind at `t_ns`, which never decreases, and at a height above the ground."""
        while t_ns >= self._next_ns:
            self._next_ns += _STEP_NS
            if len(self._drawn) < 2:
                self._drawn = self._rng.standard_normal(_DRAWN).tolist()
            for axis in range(2):
                self._gust[axis] = self._decay * self._gust[axis] + self._kick * self._drawn.pop()
            share = min(max(height_agl_m / _WHOLE_ABOVE_M, 0.0), 1.0)
            airframe.wind_east_m_s = share * (self._steady[0] + self._gust[0])
            airframe.wind_north_m_s = share * (self._steady[1] + self._gust[1])
