"""The paper's airframe (the usual one): lateral model under LQR heading control, plain altitude hold.

Theory. The state is ``x = (v, p, r, phi, psi)``: sideslip velocity, roll rate, yaw rate, bank and heading;
the inputs are aileron and rudder. ``x' = A x + B w`` is discretised by zero-order hold at 100 Hz to ``x+ = F
x + G w``. The regulator minimises the sum of ``x'Qx + w'Rw`` with Q and R identities, so ``K = (R + G'PG)^-1
G'PF`` where P solves the discrete algebraic Riccati equation. With the desired state ``(0, 0, 0, 0, heading
command)`` the loop closes to ``x+ = (F - GK) x + GK x_des``. ``docs/airframe.md`` describes its turns.

F, G and P are computed from A and B with numpy alone (a Taylor series with scaling and squaring; the
structured doubling algorithm of Chu, Fan and Lin, 2005), since scipy would slow the start of each vehicle
process. The tests compare them with scipy's.

The model is linear and unlimited, as in the paper: no control surface and no bank saturates.

Source: Hill, Thomas and Larson, "Autonomous Situational Awareness for Robotic Swarms in High-Risk
Environments", and the first author's public simulation (arXiv:2104.08904) for the matrices.
"""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from gcs.model import FloatArray, read_only

if TYPE_CHECKING:
    from sim_vehicles.vehicle.guidance import Goal, Tuning

STEP_NS = 10_000_000
STEP_S = 0.01

# Rows: v, p, r, phi, psi.
A = read_only(
    [
        [-2.382, 0.0, -30.1, 65.49, 0.0],
        [-0.702, -16.06, 0.872, 0.0, 0.0],
        [0.817, -16.65, -3.54, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0, 0.0],
    ]
)
# Columns: aileron, rudder.
B = read_only([[0.0, -7.41], [-36.3, -688.0], [-0.673, -68.0], [0.0, 0.0], [0.0, 0.0]])

TURN_TIME_S = 2.8347
"""Heading error per turn rate in a steady turn."""

ALT_TIME_S = 2.0
"""Time constant of the altitude hold."""
CLIMB_LIMIT_M_S = 5.0
"""Greatest climb and sink rate of an airframe without its own."""
CLIMB_GRADIENT = 0.355
MAX_BANK_RAD = math.radians(65.0)
ACCELERATION_M_S2 = 5.0
"""Rate at which the forward speed follows its command."""

_PI = math.pi
_TAU = 2.0 * math.pi


class ClosedLoop(NamedTuple):
    """The discrete loop ``x+ = transition x + command * heading_command``."""

    F: FloatArray
    """(5, 5) open-loop transition of one step."""
    G: FloatArray
    """(5, 2) open-loop input of one step."""
    gain: FloatArray
    """(2, 5) LQR gain K."""
    transition: FloatArray
    """(5, 5) F - G K."""
    command: FloatArray
    """(5,) last column of G K."""


def discretise(a: FloatArray, b: FloatArray, step_s: float) -> tuple[FloatArray, FloatArray]:
    """Return F and G by zero-order hold: ``exp([[a, b], [0, 0]] step) = [[F, G], [0, I]]``."""
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n] = a * step_s
    block[:n, n:] = b * step_s
    squarings = max(0, math.ceil(math.log2(max(float(np.abs(block).sum(axis=1).max()), 1e-12))) + 4)
    block /= 2.0**squarings
    result = term = np.eye(n + m)
    for order in range(1, 14):
        term = term @ block / order
        result = result + term
    for _ in range(squarings):
        result = result @ result
    return result[:n, :n], result[:n, n:]


def riccati(f: FloatArray, g: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
    """Return the stabilising solution P of the discrete algebraic Riccati equation, by structured doubling.

    Each pass doubles the horizon of the finite-horizon problem.
    """
    eye = np.eye(f.shape[0])
    transition = f
    reach = g @ np.linalg.solve(r, g.T)
    cost = q
    for _ in range(60):
        inner = np.linalg.solve(eye + reach @ cost, np.hstack([transition, reach]))
        stepped = inner[:, : len(eye)]
        reached = inner[:, len(eye) :]
        increment = transition.T @ cost @ stepped
        reach = reach + transition @ reached @ transition.T
        transition = transition @ stepped
        cost = cost + increment
        if np.abs(increment).max() <= 1e-14 * np.abs(cost).max():
            break
    return (cost + cost.T) / 2.0


@cache
def closed_loop() -> ClosedLoop:
    """Return the closed loop."""
    f, g = discretise(A, B, STEP_S)
    p = riccati(f, g, np.eye(5), np.eye(2))
    gain = np.linalg.solve(np.eye(2) + g.T @ p @ g, g.T @ p @ f)
    gk = g @ gain
    return ClosedLoop(read_only(f), read_only(g), read_only(gain), read_only(f - gk), read_only(gk[:, 4]))


class Airframe:
    """One vehicle's motion.

    The heading enters the closed loop only by its error: psi is an integrator of the open loop, so the last
    columns of ``transition`` and of ``G K`` add up to (0, 0, 0, 0, 1). `step` computes ``x+ = (F - GK) x + GK
    x_des`` with ``psi_des = psi + error``, term by term, in plain floats. The heading is not wrapped; its
    error is, so that the vehicle takes the shorter turn.
    """

    __slots__ = (
        "_coefficients",
        "alt_rel_m",
        "climb_gradient",
        "climb_m_s",
        "descent_m_s",
        "east_m",
        "heading_rad",
        "is_climbing_out",
        "max_bank_rad",
        "max_climb_m_s",
        "max_sink_m_s",
        "north_m",
        "roll_rad",
        "roll_rate_rad_s",
        "sideslip_m_s",
        "speed_m_s",
        "wind_east_m_s",
        "wind_north_m_s",
        "yaw_rate_rad_s",
    )

    estimates_calm: ClassVar[bool] = False
    """True if it reports that there is no wind, as autopilots do."""

    def __init__(
        self, east_m: float, north_m: float, alt_rel_m: float, heading_rad: float, speed_m_s: float
    ) -> None:
        loop = closed_loop()
        rows = loop.transition[:, :4].tolist()
        self._coefficients: tuple[float, ...] = (*(c for row in rows for c in row), *loop.command.tolist())
        self.east_m = east_m
        self.north_m = north_m
        self.alt_rel_m = alt_rel_m
        self.heading_rad = heading_rad
        self.speed_m_s = speed_m_s
        """Forward body velocity u; regulated elsewhere, as in the paper."""
        self.wind_east_m_s = self.wind_north_m_s = 0.0
        """Velocity of the air."""
        self.climb_m_s = 0.0
        self.max_climb_m_s = CLIMB_LIMIT_M_S
        self.max_sink_m_s = CLIMB_LIMIT_M_S
        self.climb_gradient = CLIMB_GRADIENT
        """Climb rate per airspeed at full power."""
        self.max_bank_rad = MAX_BANK_RAD
        """Ignored by the paper's model, as is the climb at full power."""
        self.descent_m_s = 0.0
        """Above 0 it sinks at this rate, whatever altitude is commanded: no thrust, or no control."""
        self.is_climbing_out = False
        """True during a take-off; ignored by the paper's model."""
        self.sideslip_m_s = 0.0
        self.roll_rate_rad_s = 0.0
        self.yaw_rate_rad_s = 0.0
        self.roll_rad = 0.0

    def step(self, heading_error_rad: float, alt_command_m: float, speed_command_m_s: float) -> None:
        """Advance by 10 ms; a positive heading error (wrapped here) is to the right."""
        (
            vv, vp, vr, vf,
            pv, pp, pr, pf,
            rv, rp, rr, rf,
            fv, fp, fr, ff,
            hv, hp, hr, hf,
            gv, gp, gr, gf, gh,
        ) = self._coefficients  # fmt: skip
        e = (heading_error_rad + _PI) % _TAU - _PI
        v = self.sideslip_m_s
        p = self.roll_rate_rad_s
        r = self.yaw_rate_rad_s
        f = self.roll_rad
        psi = self.heading_rad
        u = self.speed_m_s
        sin_psi = math.sin(psi)
        cos_psi = math.cos(psi)
        self.north_m += STEP_S * (u * cos_psi - v * sin_psi + self.wind_north_m_s)
        self.east_m += STEP_S * (u * sin_psi + v * cos_psi + self.wind_east_m_s)
        self.sideslip_m_s = vv * v + vp * p + vr * r + vf * f + gv * e
        self.roll_rate_rad_s = pv * v + pp * p + pr * r + pf * f + gp * e
        self.yaw_rate_rad_s = rv * v + rp * p + rr * r + rf * f + gr * e
        self.roll_rad = fv * v + fp * p + fr * r + ff * f + gf * e
        self.heading_rad = psi + hv * v + hp * p + hr * r + hf * f + gh * e

        climb = (alt_command_m - self.alt_rel_m) / ALT_TIME_S
        if climb > self.max_climb_m_s:
            climb = self.max_climb_m_s
        elif climb < -self.max_sink_m_s:
            climb = -self.max_sink_m_s
        if self.descent_m_s:
            climb = -self.descent_m_s
        self.climb_m_s = climb
        self.alt_rel_m += STEP_S * climb
        if u != speed_command_m_s:
            change = ACCELERATION_M_S2 * STEP_S
            self.speed_m_s = min(max(speed_command_m_s, u - change), u + change)

    def limit_climb(self, angle_rad: float, speed_m_s: float) -> None:
        """Climb no steeper than an angle, at full power and at a cruising speed."""
        self.climb_gradient = math.sin(angle_rad)
        self.max_climb_m_s = min(self.max_climb_m_s, self.climb_gradient * speed_m_s)

    def command_for(self, goal: Goal, tuning: Tuning) -> float:
        """Return the next command of `step`: here a heading error."""
        del tuning
        return goal.heading_error_rad(self)

    def rest(self) -> None:
        """Stand still on the ground."""
        self.wind_east_m_s = self.wind_north_m_s = 0.0
        self.speed_m_s = self.climb_m_s = self.descent_m_s = 0.0
        self.sideslip_m_s = self.roll_rate_rad_s = self.yaw_rate_rad_s = self.roll_rad = 0.0

    @property
    def velocity_m_s(self) -> tuple[float, float]:
        """(east, north) over ground."""
        sin_psi = math.sin(self.heading_rad)
        cos_psi = math.cos(self.heading_rad)
        u = self.speed_m_s
        v = self.sideslip_m_s
        east = u * sin_psi + v * cos_psi
        north = u * cos_psi - v * sin_psi
        return east + self.wind_east_m_s, north + self.wind_north_m_s

    @property
    def drift_rad(self) -> float:
        """Angle from the heading to the course, caused by wind."""
        if self.wind_east_m_s == 0.0 and self.wind_north_m_s == 0.0:
            return 0.0
        return (self.course_rad - self.heading_rad + _PI) % _TAU - _PI

    @property
    def course_rad(self) -> float:
        """Direction over ground, clockwise from north, in [0, 2 pi); the heading at rest."""
        east, north = self.velocity_m_s
        if east == 0.0 and north == 0.0:
            return self.heading_rad % _TAU
        return math.atan2(east, north) % _TAU
