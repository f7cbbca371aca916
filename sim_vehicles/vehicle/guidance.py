"""Path following: along a leg, round a circle, on a heading. Two laws, one for each kind of airframe.

A leg that is tracked runs from where it began to its point, and its line is followed. One that is not is
flown straight to its point, from wherever the vehicle is. A point is passed within its acceptance radius, or
beyond the finish line: the line through the point, across the leg, however far off. ArduPlane does the same.

**Heading** (the paper's airframe). The heading command is the bearing of a point: the waypoint itself, as in
the paper, or on a tracked leg the reference point, `REFERENCE_S` ahead. In wind it is the course that is
brought on to the bearing. Round a circle: a vector field. At distance d from the centre of a circle of radius
R the wanted course is the tangent, turned inwards by ``atan((d - R) / (u tau))``. The heading loop follows a
turning command only with a lag: a turn at rate w takes a heading error of ``TURN_TIME_S * w``. So the rate at
which the field itself turns along the flight path is fed forward, and the circle is held at R, not outside.

**Lateral acceleration** (`sim_vehicles.vehicle.banked_airframe`). L1 guidance as ArduPlane flies it (S. Park,
J. Deyst and J. How, "A new nonlinear guidance logic for trajectory tracking", AIAA 2004; NAVL1_PERIOD,
NAVL1_DAMPING). The ground velocity is turned on to a reference point ``L1 = damping period speed / pi``
ahead. A circle is a damped oscillator in the distance from it, with the centripetal acceleration fed forward;
from outside, the centre is headed for until the circle asks for more.

Both catch a path at no more than 45 degrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_vehicles.vehicle.airframe import TURN_TIME_S, Airframe

REFERENCE_S = 6.0
"""Reference point of the heading law, in seconds of flight: its loop is then damped at 0.7."""
CONVERGENCE_S = 5.0
"""tau: how fast the field brings a vehicle onto the circle."""
MAX_LEAD_RAD = 1.6
MIN_RADIUS_PER_SPEED_S = TURN_TIME_S / 1.5
"""The tightest circle asked of the paper's airframe, in metres per m/s: 28 m at 15 m/s."""

_PI = math.pi
_TAU = 2.0 * math.pi
_CATCHING = math.sqrt(0.5)
"""Sine of the greatest angle at which a path is caught."""
_LONG_PAST_S = 3.0
"""Flown beyond a tracked leg's end for so long, a vehicle turns back to its point."""
_TRACKS_FROM_RADII = 3.0
"""A circle nearer than this many radii is flown to straight; ArduPlane's number."""
_MIN_SPEED_M_S = 1.0


@dataclass(frozen=True, slots=True)
class Tuning:
    """NAVL1_PERIOD and NAVL1_DAMPING."""

    period_s: float = 15.0
    damping: float = 0.75

    def l1_m(self, speed_m_s: float) -> float:
        """Distance to the reference point."""
        return self.damping * self.period_s / _PI * speed_m_s

    def lateral_m_s2(self, speed_m_s: float, error_rad: float) -> float:
        """Lateral acceleration that turns the velocity by an angle; the angle is cut off at 90 degrees."""
        error_rad = min(max(error_rad, -_PI / 2.0), _PI / 2.0)
        gain = 4.0 * self.damping * self.damping
        return gain * speed_m_s * speed_m_s / self.l1_m(speed_m_s) * math.sin(error_rad)


def density_ratio(alt_msl_m: float) -> float:
    """Density of the air relative to that at sea level, in the standard atmosphere below 11 km."""
    return math.pow(1.0 - 2.25577e-5 * alt_msl_m, 4.25588)


def _ground_velocity(airframe: Airframe) -> tuple[float, float, float]:
    """East, north and speed over ground; along the heading while there is next to none."""
    east, north = airframe.velocity_m_s
    speed = math.hypot(east, north)
    sin_heading, cos_heading = math.sin(airframe.heading_rad), math.cos(airframe.heading_rad)
    if speed >= _MIN_SPEED_M_S and east * sin_heading + north * cos_heading > 0.0:
        return east, north, speed
    return sin_heading * _MIN_SPEED_M_S, cos_heading * _MIN_SPEED_M_S, _MIN_SPEED_M_S


def _angle(east_1: float, north_1: float, east_2: float, north_2: float) -> float:
    """Angle from the first direction to the second, positive to the right."""
    return math.atan2(north_1 * east_2 - east_1 * north_2, north_1 * north_2 + east_1 * east_2)


@dataclass(frozen=True, slots=True)
class Straight:
    """Keep a heading."""

    heading_rad: float

    def heading_error_rad(self, airframe: Airframe) -> float:
        """Heading error, any size."""
        return self.heading_rad - airframe.heading_rad

    def lateral_m_s2(self, airframe: Airframe, tuning: Tuning) -> float:
        """Lateral acceleration, positive to the right."""
        _, _, speed = _ground_velocity(airframe)
        error = (self.heading_rad - airframe.heading_rad + _PI) % _TAU - _PI
        error = min(max(error, -_PI / 2.0), _PI / 2.0)
        return 2.0 * math.sqrt(2.0) * _PI / tuning.period_s * speed * math.sin(error)


@dataclass(frozen=True, slots=True)
class ToPoint:
    """Fly to a point; `leg_east_m`, `leg_north_m` lead from where the leg began to the point."""

    east_m: float
    north_m: float
    leg_east_m: float
    leg_north_m: float
    accept_radius_m: float
    is_tracked: bool = False
    """True if the vehicle follows the leg's line; otherwise it flies straight to the point."""

    def heading_error_rad(self, airframe: Airframe) -> float:
        """Heading error, any size."""
        bearing = self.bearing_rad(airframe, REFERENCE_S * airframe.speed_m_s)
        return bearing - airframe.heading_rad - airframe.drift_rad

    def lateral_m_s2(self, airframe: Airframe, tuning: Tuning) -> float:
        """Lateral acceleration, positive to the right."""
        v_east, v_north, speed = _ground_velocity(airframe)
        error, line_rad = self._aim(airframe, v_east, v_north, speed, tuning.l1_m(speed))
        return tuning.lateral_m_s2(speed, error + line_rad)

    def bearing_rad(self, airframe: Airframe, reference_m: float) -> float:
        """Wanted course over ground."""
        error, line_rad = self._aim(airframe, 0.0, 1.0, airframe.speed_m_s, reference_m)
        return error + line_rad

    def _aim(
        self, airframe: Airframe, v_east: float, v_north: float, speed: float, reference_m: float
    ) -> tuple[float, float]:
        """Angle from a direction to the line or point that is flown, and from that to the reference point."""
        east, north = self.east_m - airframe.east_m, self.north_m - airframe.north_m
        leg_east, leg_north = self.leg_east_m, self.leg_north_m
        length = math.hypot(leg_east, leg_north)
        if not self.is_tracked or length == 0.0:
            return _angle(v_east, v_north, east, north), 0.0
        along_m = length - (east * leg_east + north * leg_north) / length
        from_east, from_north = east - leg_east, north - leg_north
        from_m = math.hypot(from_east, from_north)
        if from_m > reference_m and along_m < -_CATCHING * from_m:
            return _angle(v_east, v_north, from_east, from_north), 0.0
        if along_m > length + _LONG_PAST_S * speed:
            return _angle(v_east, v_north, east, north), 0.0
        sine = self.cross_track_m(airframe) / max(reference_m, 1.0)
        sine = min(max(sine, -_CATCHING), _CATCHING)
        return _angle(v_east, v_north, leg_east, leg_north), math.asin(sine)

    def cross_track_m(self, airframe: Airframe) -> float:
        """Distance off the leg's line, positive to the left of it; 0 for a leg that is not tracked."""
        length = math.hypot(self.leg_east_m, self.leg_north_m)
        if not self.is_tracked or length == 0.0:
            return 0.0
        east, north = airframe.east_m - self.east_m, airframe.north_m - self.north_m
        return (north * self.leg_east_m - east * self.leg_north_m) / length

    def distance_m(self, airframe: Airframe) -> float:
        """Distance left to the point."""
        return math.hypot(self.east_m - airframe.east_m, self.north_m - airframe.north_m)

    def is_reached(self, airframe: Airframe) -> bool:
        """True if within the acceptance radius, or past the finish line (at once, for a leg of no length)."""
        east, north = self.east_m - airframe.east_m, self.north_m - airframe.north_m
        if east * east + north * north <= self.accept_radius_m * self.accept_radius_m:
            return True
        return self.is_past(airframe)

    def is_past(self, airframe: Airframe) -> bool:
        """True if past the finish line."""
        east, north = self.east_m - airframe.east_m, self.north_m - airframe.north_m
        return east * self.leg_east_m + north * self.leg_north_m <= 0.0


@dataclass(frozen=True, slots=True)
class Circle:
    """Fly round a centre; a negative radius turns left."""

    east_m: float
    north_m: float
    radius_m: float
    leg: ToPoint | None = None
    """Leg to the centre, followed from afar."""

    def distance_m(self, airframe: Airframe) -> float:
        """Distance from the centre."""
        return math.hypot(airframe.east_m - self.east_m, airframe.north_m - self.north_m)

    def cross_track_m(self, airframe: Airframe) -> float:
        """Distance outside the circle; negative inside."""
        return self.distance_m(airframe) - abs(self.radius_m)

    def bearing_rad(self, airframe: Airframe, reference_m: float) -> float:
        """Bearing of the centre, or of the reference point on the leg to it."""
        leg = self._followed(airframe)
        if leg is not None:
            return leg.bearing_rad(airframe, reference_m)
        return math.atan2(self.east_m - airframe.east_m, self.north_m - airframe.north_m)

    def _followed(self, airframe: Airframe) -> ToPoint | None:
        leg = self.leg
        if leg is None or not leg.is_tracked or leg.is_past(airframe):
            return None
        return leg if self.distance_m(airframe) > _TRACKS_FROM_RADII * abs(self.radius_m) else None

    def heading_error_rad(self, airframe: Airframe) -> float:
        """Heading error, any size."""
        leg = self._followed(airframe)
        if leg is not None:
            return leg.heading_error_rad(airframe)
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

    def lateral_m_s2(self, airframe: Airframe, tuning: Tuning) -> float:
        """Lateral acceleration, positive to the right."""
        leg = self._followed(airframe)
        if leg is not None:
            return leg.lateral_m_s2(airframe, tuning)
        v_east, v_north, speed = _ground_velocity(airframe)
        side = -1.0 if self.radius_m < 0.0 else 1.0
        radius = max(abs(self.radius_m), 1.0)
        east, north = airframe.east_m - self.east_m, airframe.north_m - self.north_m
        distance = math.hypot(east, north)
        if distance > 0.1:
            east, north = east / distance, north / distance
        else:  # over the centre there is no bearing: fly straight on, outwards
            east, north = v_east / speed, v_north / speed
        outwards = v_east * east + v_north * north
        round_m_s = side * (v_east * north - v_north * east)
        heading_in = tuning.lateral_m_s2(speed, math.atan2(side * round_m_s, -outwards))
        rate = _TAU / tuning.period_s
        correction = (distance - radius) * rate * rate + outwards * 2.0 * tuning.damping * rate
        if outwards > 0.0 and round_m_s < 0.0:
            correction = max(correction, 0.0)  # flying the wrong way round, it would turn away
        circling = side * (correction + round_m_s * round_m_s / max(0.5 * radius, distance))
        if distance > radius and side * heading_in < side * circling:
            return heading_in
        return circling


Goal = Straight | ToPoint | Circle
