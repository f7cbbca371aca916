"""Path following along a leg, round a circle, or on a heading: one law for each kind of airframe.

A tracked leg runs from its start to its point, and its line is followed. Another leg is flown straight to its
point. A point is passed within its acceptance radius, or beyond the finish line: the line through the point,
across the leg. ArduPlane does the same.

**Heading** (the paper's airframe). The heading command is the bearing of the waypoint, as in the paper, or on
a tracked leg of the reference point, `REFERENCE_S` ahead. In wind the course is turned to the bearing. Round
a circle: a vector field. At distance d from the centre of a circle of radius R the desired course is the
tangent, turned inwards by ``atan((d - R) / (u tau))``. The heading loop lags: a turn at rate w needs a
heading error of ``TURN_TIME_S * w``. So the turn rate of the field along the flight path is fed forward.

**Lateral acceleration** (`sim_vehicles.vehicle.banked_airframe`). L1 guidance as in ArduPlane (S. Park, J.
Deyst and J. How, "A new nonlinear guidance logic for trajectory tracking", AIAA 2004; NAVL1_PERIOD,
NAVL1_DAMPING). The ground velocity is turned to a reference point ``L1 = damping period speed / pi`` ahead. A
circle is a damped oscillator in the distance from it, with the centripetal acceleration fed forward. From
outside, the vehicle flies to the centre until the circle needs more acceleration.

Both laws meet a path at no more than 45 degrees.

A leg has an altitude at each end, and the altitude between them is linear along it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from sim_vehicles.vehicle.paper_airframe import TURN_TIME_S, Airframe

REFERENCE_S = 6.0
"""Reference point of the heading law, in seconds of flight: its loop is then damped at 0.7."""
CONVERGENCE_S = 5.0
"""tau: time constant of the approach to the circle."""
MAX_LEAD_RAD = 1.6
MIN_RADIUS_PER_SPEED_S = TURN_TIME_S / 1.5
"""Least radius of the paper's airframe, in metres per m/s: 28 m at 15 m/s."""

_PI = math.pi
_TAU = 2.0 * math.pi
_CATCHING = math.sqrt(0.5)
"""Sine of the greatest angle to a path."""
_LONG_PAST_S = 3.0
"""Time beyond a tracked leg's end after which a vehicle turns back to its point."""
_TRACKS_FROM_RADII = 3.0
"""A circle within this many radii is flown to straight, as in ArduPlane."""
_MIN_SPEED_M_S = 1.0


@dataclass(frozen=True, slots=True)
class Tuning:
    """NAVL1_PERIOD and NAVL1_DAMPING."""

    period_s: float = 15.0
    damping: float = 0.75

    def l1_m(self, speed_m_s: float) -> float:
        """Return the distance to the reference point."""
        return self.damping * self.period_s / _PI * speed_m_s

    def lateral_m_s2(self, speed_m_s: float, error_rad: float) -> float:
        """Return the lateral acceleration that turns the velocity by an angle of at most 90 degrees."""
        error_rad = min(max(error_rad, -_PI / 2.0), _PI / 2.0)
        gain = 4.0 * self.damping * self.damping
        return gain * speed_m_s * speed_m_s / self.l1_m(speed_m_s) * math.sin(error_rad)


def density_ratio(alt_msl_m: float) -> float:
    """Return the air density relative to sea level, in the standard atmosphere below 11 km."""
    return math.pow(1.0 - 2.25577e-5 * alt_msl_m, 4.25588)


def _ground_velocity(airframe: Airframe) -> tuple[float, float, float]:
    """Return east, north and speed over ground; along the heading when nearly at rest."""
    east, north = airframe.velocity_m_s
    speed = math.hypot(east, north)
    sin_heading = math.sin(airframe.heading_rad)
    cos_heading = math.cos(airframe.heading_rad)
    if speed >= _MIN_SPEED_M_S and east * sin_heading + north * cos_heading > 0.0:
        return east, north, speed
    return sin_heading * _MIN_SPEED_M_S, cos_heading * _MIN_SPEED_M_S, _MIN_SPEED_M_S


def _angle(east_1: float, north_1: float, east_2: float, north_2: float) -> float:
    """Return the angle from the first direction to the second, positive to the right."""
    return math.atan2(north_1 * east_2 - east_1 * north_2, north_1 * north_2 + east_1 * east_2)


@dataclass(frozen=True, slots=True)
class Straight:
    """Keep a heading."""

    heading_rad: float

    def heading_error_rad(self, airframe: Airframe) -> float:
        """Return the heading error, not wrapped."""
        return self.heading_rad - airframe.heading_rad

    def lateral_m_s2(self, airframe: Airframe, tuning: Tuning) -> float:
        """Return the lateral acceleration, positive to the right."""
        _, _, speed = _ground_velocity(airframe)
        error = (self.heading_rad - airframe.heading_rad + _PI) % _TAU - _PI
        error = min(max(error, -_PI / 2.0), _PI / 2.0)
        return 2.0 * math.sqrt(2.0) * _PI / tuning.period_s * speed * math.sin(error)


@dataclass(frozen=True, slots=True)
class ToPoint:
    """Fly to a point; `leg_east_m`, `leg_north_m` lead from the leg's start to the point."""

    east_m: float
    north_m: float
    leg_east_m: float
    leg_north_m: float
    accept_radius_m: float
    is_tracked: bool = False
    """True if the vehicle follows the leg's line; otherwise it flies straight to the point."""
    rise_m: float = 0.0
    """Altitude of the point above the leg's start."""

    def heading_error_rad(self, airframe: Airframe) -> float:
        """Return the heading error, not wrapped."""
        bearing = self.bearing_rad(airframe, REFERENCE_S * airframe.speed_m_s)
        return bearing - airframe.heading_rad - airframe.drift_rad

    def lateral_m_s2(self, airframe: Airframe, tuning: Tuning) -> float:
        """Return the lateral acceleration, positive to the right."""
        v_east, v_north, speed = _ground_velocity(airframe)
        error, line_rad = self._aim(airframe, v_east, v_north, speed, tuning.l1_m(speed))
        return tuning.lateral_m_s2(speed, error + line_rad)

    def bearing_rad(self, airframe: Airframe, reference_m: float) -> float:
        """Return the desired course over ground."""
        error, line_rad = self._aim(airframe, 0.0, 1.0, airframe.speed_m_s, reference_m)
        return error + line_rad

    def _aim(
        self, airframe: Airframe, v_east: float, v_north: float, speed: float, reference_m: float
    ) -> tuple[float, float]:
        """Return the angle from a direction to the line or point, and from there to the reference point."""
        east = self.east_m - airframe.east_m
        north = self.north_m - airframe.north_m
        leg_east = self.leg_east_m
        leg_north = self.leg_north_m
        length = math.hypot(leg_east, leg_north)
        if not self.is_tracked or length == 0.0:
            return _angle(v_east, v_north, east, north), 0.0
        along_m = length - (east * leg_east + north * leg_north) / length
        from_east = east - leg_east
        from_north = north - leg_north
        from_m = math.hypot(from_east, from_north)
        if from_m > reference_m and along_m < -_CATCHING * from_m:
            return _angle(v_east, v_north, from_east, from_north), 0.0
        if along_m > length + _LONG_PAST_S * speed:
            return _angle(v_east, v_north, east, north), 0.0
        sine = self.cross_track_m(airframe) / max(reference_m, 1.0)
        sine = min(max(sine, -_CATCHING), _CATCHING)
        return _angle(v_east, v_north, leg_east, leg_north), math.asin(sine)

    def cross_track_m(self, airframe: Airframe) -> float:
        """Return the distance from the leg's line, positive to its left; 0 for an untracked leg."""
        length = math.hypot(self.leg_east_m, self.leg_north_m)
        if not self.is_tracked or length == 0.0:
            return 0.0
        east = airframe.east_m - self.east_m
        north = airframe.north_m - self.north_m
        return (north * self.leg_east_m - east * self.leg_north_m) / length

    def distance_m(self, airframe: Airframe) -> float:
        """Return the distance to the point."""
        return math.hypot(self.east_m - airframe.east_m, self.north_m - airframe.north_m)

    def is_reached(self, airframe: Airframe) -> bool:
        """Return True within the acceptance radius, or past the finish line."""
        east = self.east_m - airframe.east_m
        north = self.north_m - airframe.north_m
        if east * east + north * north <= self.accept_radius_m * self.accept_radius_m:
            return True
        return self.is_past(airframe)

    def is_past(self, airframe: Airframe) -> bool:
        """Return True past the finish line."""
        east = self.east_m - airframe.east_m
        north = self.north_m - airframe.north_m
        return east * self.leg_east_m + north * self.leg_north_m <= 0.0

    def rise_ahead_m(self, airframe: Airframe, ends_m: float = 0.0) -> float:
        """Return the part of the rise that lies ahead, if it is linear and ends `ends_m` before the point."""
        length = math.hypot(self.leg_east_m, self.leg_north_m)
        if length <= ends_m:
            return 0.0
        east = self.east_m - airframe.east_m
        north = self.north_m - airframe.north_m
        ahead_m = (east * self.leg_east_m + north * self.leg_north_m) / length
        return self.rise_m * min(max((ahead_m - ends_m) / (length - ends_m), 0.0), 1.0)


@dataclass(frozen=True, slots=True)
class Circle:
    """Fly round a centre; a negative radius turns left."""

    east_m: float
    north_m: float
    radius_m: float
    leg: ToPoint | None = None
    """Leg to the centre, followed from afar."""

    def distance_m(self, airframe: Airframe) -> float:
        """Return the distance from the centre."""
        return math.hypot(airframe.east_m - self.east_m, airframe.north_m - self.north_m)

    def cross_track_m(self, airframe: Airframe) -> float:
        """Return the distance from the circle; negative inside."""
        return self.distance_m(airframe) - abs(self.radius_m)

    def bearing_rad(self, airframe: Airframe, reference_m: float) -> float:
        """Return the bearing of the centre, or of the reference point on the leg to it."""
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
        """Return the heading error, not wrapped."""
        leg = self._followed(airframe)
        if leg is not None:
            return leg.heading_error_rad(airframe)
        u = airframe.speed_m_s
        side = -1.0 if self.radius_m < 0.0 else 1.0
        radius = max(abs(self.radius_m), MIN_RADIUS_PER_SPEED_S * u, 1.0)
        east = airframe.east_m - self.east_m
        north = airframe.north_m - self.north_m
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
        # Against the field, a lead would wrap the error over 180 degrees and keep the wrong direction.
        return error + side * lead * max(0.0, math.cos(error))

    def lateral_m_s2(self, airframe: Airframe, tuning: Tuning) -> float:
        """Return the lateral acceleration, positive to the right."""
        leg = self._followed(airframe)
        if leg is not None:
            return leg.lateral_m_s2(airframe, tuning)
        v_east, v_north, speed = _ground_velocity(airframe)
        side = -1.0 if self.radius_m < 0.0 else 1.0
        radius = max(abs(self.radius_m), 1.0)
        east = airframe.east_m - self.east_m
        north = airframe.north_m - self.north_m
        distance = math.hypot(east, north)
        if distance > 0.1:
            east = east / distance
            north = north / distance
        else:  # Over the centre: fly straight on, outwards.
            east = v_east / speed
            north = v_north / speed
        outwards = v_east * east + v_north * north
        round_m_s = side * (v_east * north - v_north * east)
        heading_in = tuning.lateral_m_s2(speed, math.atan2(side * round_m_s, -outwards))
        rate = _TAU / tuning.period_s
        correction = (distance - radius) * rate * rate + outwards * 2.0 * tuning.damping * rate
        if outwards > 0.0 and round_m_s < 0.0:
            correction = max(correction, 0.0)  # In the wrong direction it would turn away.
        circling = side * (correction + round_m_s * round_m_s / max(0.5 * radius, distance))
        if distance > radius and side * heading_in < side * circling:
            return heading_in
        return circling


Goal = Straight | ToPoint | Circle


class Legs:
    """Starts of legs, as ArduPlane chooses them.

    Usually a leg starts where the last one ended, and its line is tracked. After a mode change or a take-off
    it starts at the vehicle. Each new leg sets the flag `do_join` again. ``DO_SET_MISSION_CURRENT`` clears it
    after it has started the item, ``MISSION_SET_CURRENT`` before.
    """

    def __init__(self, airframe: Airframe) -> None:
        self._airframe = airframe
        self._point = (airframe.east_m, airframe.north_m)
        self._alt_m = airframe.alt_rel_m
        self.do_join = False
        """True if the next leg starts where the last one ended; False if at the vehicle."""

    def begin(self, east_m: float, north_m: float, alt_m: float, accept_radius_m: float) -> ToPoint:
        """Return the leg to a point."""
        airframe = self._airframe
        here = airframe.east_m, airframe.north_m
        is_tracked = self.do_join
        self.do_join = True
        begin = self._point if is_tracked else here
        rise_m = alt_m - (self._alt_m if is_tracked else airframe.alt_rel_m)
        leg = ToPoint(
            east_m, north_m, east_m - begin[0], north_m - begin[1], accept_radius_m, is_tracked, rise_m
        )
        if leg.is_past(airframe):  # It would end at once.
            leg = replace(
                leg,
                leg_east_m=east_m - here[0],
                leg_north_m=north_m - here[1],
                rise_m=alt_m - airframe.alt_rel_m,
            )
        self._point = east_m, north_m
        self._alt_m = alt_m
        return leg

    def leave(self) -> None:
        """Start the next leg at the vehicle."""
        self._point = (self._airframe.east_m, self._airframe.north_m)
        self._alt_m = self._airframe.alt_rel_m
        self.do_join = False
