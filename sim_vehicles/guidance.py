"""Which way to fly: straight on, to a point, or round a circle. Answers are heading errors.

To a point (the paper's law): the heading command is the bearing from the vehicle to the point. The point is
reached within its acceptance radius, or when the finish line is passed: the line through the point, across
the leg that leads to it. ArduPlane does the same; without it, this airframe would orbit a missed point for
ever.

In wind it is the course that is brought on to the bearing, not the heading: the vehicle crabs.

Round a circle: a vector field. At distance d from the centre of a circle of radius R the wanted course is the
tangent, turned inwards by ``atan((d - R) / (u tau))``. The heading loop follows a turning command only with a
lag: a turn at rate w takes a heading error of ``TURN_TIME_S * w``. So the rate at which the field itself
turns along the flight path is fed forward, and the circle is held at R, not outside it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_vehicles.airframe import TURN_TIME_S, Airframe

CONVERGENCE_S = 5.0
"""tau: how fast the field brings a vehicle onto the circle."""
MAX_LEAD_RAD = 1.6
MIN_RADIUS_PER_SPEED_S = TURN_TIME_S / 1.5
"""The tightest circle asked of the airframe, in metres per m/s: 28 m at 15 m/s."""


@dataclass(frozen=True, slots=True)
class Straight:
    """Keep a heading."""

    heading_rad: float

    def heading_error_rad(self, airframe: Airframe) -> float:
        """Heading error, any size."""
        return self.heading_rad - airframe.heading_rad


@dataclass(frozen=True, slots=True)
class ToPoint:
    """Fly to a point; `leg_east_m`, `leg_north_m` lead from where the leg began to the point."""

    east_m: float
    north_m: float
    leg_east_m: float
    leg_north_m: float
    accept_radius_m: float

    def heading_error_rad(self, airframe: Airframe) -> float:
        """Heading error, any size."""
        return (
            math.atan2(self.east_m - airframe.east_m, self.north_m - airframe.north_m)
            - airframe.heading_rad
            - airframe.drift_rad
        )

    def distance_m(self, airframe: Airframe) -> float:
        """Distance left to the point."""
        return math.hypot(self.east_m - airframe.east_m, self.north_m - airframe.north_m)

    def is_reached(self, airframe: Airframe) -> bool:
        """Within the acceptance radius, or past the finish line (at once, for a leg of no length)."""
        east, north = self.east_m - airframe.east_m, self.north_m - airframe.north_m
        if east * east + north * north <= self.accept_radius_m * self.accept_radius_m:
            return True
        return east * self.leg_east_m + north * self.leg_north_m <= 0.0


@dataclass(frozen=True, slots=True)
class Circle:
    """Fly round a centre; a negative radius turns left."""

    east_m: float
    north_m: float
    radius_m: float

    def distance_m(self, airframe: Airframe) -> float:
        """Distance from the centre."""
        return math.hypot(airframe.east_m - self.east_m, airframe.north_m - self.north_m)

    def heading_error_rad(self, airframe: Airframe) -> float:
        """Heading error, any size."""
        u = airframe.speed_m_s
        side = -1.0 if self.radius_m < 0.0 else 1.0
        radius = max(abs(self.radius_m), MIN_RADIUS_PER_SPEED_S * u, 1.0)
        east, north = airframe.east_m - self.east_m, airframe.north_m - self.north_m
        d = math.hypot(east, north)
        # Over the centre there is no bearing: fly straight on, outwards.
        bearing = math.atan2(east, north) if d > 1.0 else airframe.heading_rad
        reach = max(u * CONVERGENCE_S, 1.0)
        inwards = math.atan((d - radius) / reach)
        cos_in = math.cos(inwards)
        round_rate = u * cos_in / max(d, radius / 2.0)
        field_rate = u * math.sin(inwards) * cos_in * cos_in / reach
        lead = min(max(TURN_TIME_S * (round_rate - field_rate), -MAX_LEAD_RAD), MAX_LEAD_RAD)
        error = bearing + side * (math.pi / 2.0 + inwards) - airframe.heading_rad - airframe.drift_rad
        # Flying against the field, a lead would wrap the error over 180 degrees and hold the wrong way round.
        return error + side * lead * max(0.0, math.cos(error))


Goal = Straight | ToPoint | Circle
