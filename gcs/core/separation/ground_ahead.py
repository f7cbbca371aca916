"""Ground ahead: where a predicted flight comes too near to the ground, and how far circles leave the band."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.config import Config
from gcs.core.separation.forward_flight import STEP_S, Flight, simulate_flights
from gcs.model import FloatArray
from gcs.terrain.elevation_grid import Elevation

_RING: Final = 24
_RING_RADII: Final = (0.5, 1.0)
"""Radii of rings that are looked at, by that of the circle."""
_WIND_GAIN: Final = 0.75
"""Growth of the outermost ring, as a share of its radius, by wind and airspeed."""


@dataclass(frozen=True, slots=True)
class GroundEncounter:
    """First place of a flight that is too near to the ground."""

    after_s: float
    agl_m: float
    """Height above ground there."""
    east_m: float
    north_m: float


class GroundAhead:
    """Finds where flights come nearer to the ground than half of `terrain.min_agl_m`; without it nowhere."""

    def __init__(self, config: Config) -> None:
        self._elevation = config.elevation
        self._terrain = config.terrain
        self.least_m = 0.0 if config.terrain is None else config.terrain.flown_min_agl_m

    @property
    def is_known(self) -> bool:
        """True if there is an elevation model."""
        return self._elevation is not None

    def first(self, flight: Flight, ahead_s: float) -> GroundEncounter | None:
        """Return where a flight is first too near to the ground; None if it is not, or no ground is known."""
        if self._elevation is None:
            return None
        places_m, agl_m = _flown(flight, ahead_s, self._elevation)
        near = np.flatnonzero(agl_m < self.least_m)
        if not len(near):
            return None
        at = int(near[0])
        east_m, north_m = places_m[at].tolist()
        return GroundEncounter(at * STEP_S, float(agl_m[at]), east_m, north_m)

    def off_band_m(self, flight: Flight, ahead_s: float, lag_s: float = 0.0) -> tuple[float, float]:
        """Return how far a flight goes below and above the flight band; negative inside.

        Infinitely far inside without a band. With a lag the vehicle climbs as it should later by that.
        """
        if self._elevation is None or self._terrain is None:
            return -math.inf, -math.inf
        _, agl_m = _flown(flight, ahead_s, self._elevation, lag_s)
        below_m = self._terrain.min_agl_m - float(np.nanmin(agl_m))
        return below_m, float(np.nanmax(agl_m)) - self._terrain.max_agl_m

    def departures_m(self, hold: Flight, ahead_s: float) -> tuple[float, float]:
        """Return how far a hold leads a vehicle below and above the flight band; negative inside.

        A vehicle flies through its circle, and beyond it, when it begins: as simulated. In wind it leaves it
        later, too.
        """
        if self._elevation is None or self._terrain is None:
            return -math.inf, -math.inf
        circle = hold.goals[-1]
        angle = np.linspace(0.0, 2.0 * math.pi, _RING, endpoint=False)
        ring = np.stack((np.sin(angle), np.cos(angle)), axis=1)
        in_wind = 1.0 + _WIND_GAIN * math.hypot(*hold.wind_m_s) / hold.airspeed_m_s
        radii_m = abs(circle.radius_m) * np.array((*_RING_RADII, in_wind))
        centre_m = np.array((circle.east_m, circle.north_m))
        places_m = centre_m + (radii_m[:, None, None] * ring).reshape(-1, 2)
        agl_m = circle.height_m - self._elevation.heights_at(places_m)
        below_m = max(float(self._terrain.min_agl_m - agl_m.min()), self.off_band_m(hold, ahead_s)[0])
        return below_m, float(agl_m.max() - self._terrain.max_agl_m)


def _flown(
    flight: Flight, ahead_s: float, elevation: Elevation, lag_s: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return the places of a flight, (k, 2), and its least heights above ground there, (k,)."""
    paths = simulate_flights([flight], ahead_s)
    places_m = np.column_stack((paths.east_m[:, 0], paths.north_m[:, 0]))
    heights_m = paths.low_m[:, 0]
    heights_m[0] = flight.height_m
    steeper_m_s = np.maximum(np.diff(heights_m) / STEP_S - flight.climb_m_s, 0.0)
    late_s = np.minimum(STEP_S * np.arange(1, len(heights_m)), lag_s)
    heights_m[1:] -= late_s * steeper_m_s
    return places_m, heights_m - elevation.heights_at(places_m)
