"""Parameters that the preflight check reads: their required ranges, for ArduPlane and PX4.

Sources: https://ardupilot.org/plane/docs/parameters.html and
https://docs.px4.io/main/en/advanced_config/parameter_reference.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

_NO_BOUND: Final = 2**24


@dataclass(frozen=True, slots=True)
class WantedParameter:
    """A parameter and its required range, for the preflight check."""

    names: tuple[str, ...]
    """Names, newest firmware first."""
    low: float
    high: float
    """Required: low <= value <= high."""
    why: str
    """Consequence of a value out of range."""
    must: bool = True
    """True if a wrong value fails the preflight check; else it is a warning."""
    older: WantedParameter | None = None
    """Parameter of older firmware with another name, unit or meaning."""
    allowed: tuple[float, ...] = ()
    """The only allowed values between `low` and `high`; empty for all."""
    meanings: Mapping[float, str] = field(default_factory=dict)
    """Effect of a value, where a pilot must know it."""

    def accepts(self, value: float) -> bool:
        """Return True if a value is allowed."""
        return self.low <= value <= self.high and (not self.allowed or value in self.allowed)

    @property
    def wanted(self) -> str:
        """Required values as text."""
        if self.allowed:
            return " or ".join(f"{value:.6g}" for value in self.allowed)
        low = f"{self.low:.6g}"
        high = f"{self.high:.6g}"
        if self.high >= _NO_BOUND:
            return f"{low} and above"
        return low if low == high else f"{low} ... {high}"

    @property
    def all_names(self) -> tuple[str, ...]:
        """All names to read."""
        return self.names + (() if self.older is None else self.older.all_names)

    def found(self, values: Mapping[str, float]) -> tuple[WantedParameter, str] | None:
        """Return the parameter and its name on a vehicle; None if the vehicle has neither."""
        name = next((name for name in self.names if name in values), None)
        if name is not None:
            return self, name
        return None if self.older is None else self.older.found(values)


@dataclass(frozen=True, slots=True)
class Envelope:
    """Performance that a mission requires of its vehicles."""

    speed_m_s: float
    bank_deg: float
    lands: bool = False
    """True if missions end in a landing."""
    table: str = "airframe"
    """Table of the mission file with these keys."""
    follows_terrain: bool = False
    """True if heights of missions change from point to point."""
    climb_m_s: float = 0.0
    """Sustained rates of climb and descent, by which routes over terrain are planned."""
    sink_m_s: float = 0.0


ARDUPLANE_PARAMETERS: Final = (
    WantedParameter(
        ("MAV_GCS_SYSID", "SYSID_MYGCS"),
        255,
        255,
        "the failsafe watches another station's heartbeat, not ours",
    ),
    WantedParameter(
        ("FS_GCS_ENABL",), 1, 3, "a vehicle that loses us is not noticed by its failsafe", must=False
    ),
    WantedParameter(
        ("FS_LONG_ACTN",),
        0,
        1,
        "when the link is lost, 2 glides into the ground, 3 opens a parachute, 4 and 5 begin a mission or a "
        "landing; 1 returns, 0 continues in AUTO and GUIDED",
        meanings={
            0: "AUTO and GUIDED continue; LOITER, MANUAL and all other modes go to RTL",
            1: "every mode goes to RTL",
        },
    ),
    WantedParameter(
        ("FS_LONG_TIMEOUT",), 5, 300, "a few lost heartbeats of ours start the failsafe", must=False
    ),
    WantedParameter(
        ("BATT_FS_LOW_ACT",), 1, 6, "without a link it circles until the battery is empty", must=False
    ),
    WantedParameter(("THR_FAILSAFE",), 1, 1, "a lost remote control is not noticed", must=False),
    WantedParameter(
        ("RTL_ALTITUDE",),
        30,
        500,
        "the return height may be below obstacles",
        must=False,
        older=WantedParameter(
            ("ALT_HOLD_RTL",),
            3000,
            50_000,
            "the return height (in cm) may be below obstacles",
            must=False,
        ),
    ),
    WantedParameter(("FENCE_ENABLE",), 1, 1, "nothing stops a vehicle that leaves the area", must=False),
    WantedParameter(("FENCE_ACTION",), 1, 8, "a breach of the fence is only reported", must=False),
    WantedParameter(("NAVL1_PERIOD",), 8, 30, "turns are too sharp or too wide", must=False),
    WantedParameter(("MIS_RESTART",), 0, 0, "AUTO would begin its mission anew instead of resuming it"),
    WantedParameter(
        ("ARMING_SKIPCHK",),
        0,
        0,
        "it arms without some of its checks",
        older=WantedParameter(("ARMING_CHECK",), 1, 2**24, "it arms without checks"),
    ),
)


_LINEAR_LEGS: Final = WantedParameter(
    ("ALT_SLOPE_MIN",),
    1,
    2,
    "a leg that rises or falls less is not flown linearly but at once, so not at the planned heights",
    older=WantedParameter(("GLIDE_SLOPE_MIN",), 1, 2, "a leg that rises or falls less is not flown linearly"),
)


def arduplane_parameters_for(envelope: Envelope) -> tuple[WantedParameter, ...]:
    """Return the parameters of ArduPlane that must fit a mission."""
    bank = envelope.bank_deg
    slow = 0.75 * envelope.speed_m_s
    fast = 1.25 * envelope.speed_m_s
    wide = f"it turns wider than routes are planned for ({envelope.table}.bank_deg)"
    speed = f"it flies faster or slower than routes are planned for ({envelope.table}.speed_m_s)"
    return (
        WantedParameter(
            ("ROLL_LIMIT_DEG",),
            bank,
            90,
            wide,
            older=WantedParameter(("LIM_ROLL_CD",), 100 * bank, 9000, wide),
        ),
        WantedParameter(
            ("AIRSPEED_CRUISE",),
            slow,
            fast,
            speed,
            must=False,
            older=WantedParameter(("TRIM_ARSPD_CM",), 100 * slow, 100 * fast, speed, must=False),
        ),
        *(_arduplane_over_terrain(envelope) if envelope.follows_terrain else ()),
    )


def _arduplane_over_terrain(envelope: Envelope) -> tuple[WantedParameter, ...]:
    return (_LINEAR_LEGS, *_rates(envelope, "TECS_CLMB_MAX", "TECS_SINK_MAX"))


def _rates(envelope: Envelope, climb: str, sink: str) -> tuple[WantedParameter, WantedParameter]:
    """Return the least rates of climb and descent of an autopilot over terrain."""
    table = envelope.table
    low = f"it climbs slower than routes over terrain are planned for ({table}.climb_m_s): it flies too low"
    high = f"it sinks slower than routes over terrain are planned for ({table}.sink_m_s): it flies too high"
    return (
        WantedParameter((climb,), envelope.climb_m_s, _NO_BOUND, low),
        WantedParameter((sink,), envelope.sink_m_s, _NO_BOUND, high, must=False),
    )


PX4_PARAMETERS: Final = (
    WantedParameter(
        ("NAV_DLL_ACT",), 1, 3, "a vehicle that loses us is not noticed by its failsafe", must=False
    ),
    WantedParameter(
        ("COM_LOW_BAT_ACT",), 2, 3, "without a link it circles until the battery is empty", must=False
    ),
    WantedParameter(
        ("COM_DL_LOSS_T",), 5, 300, "the link is given up sooner than it can recover", must=False
    ),
    WantedParameter(("RTL_RETURN_ALT",), 30, 500, "the return height may be below obstacles", must=False),
    WantedParameter(("GF_ACTION",), 1, 5, "nothing stops a vehicle that leaves the area", must=False),
    WantedParameter(
        ("FW_LND_ANG",), 3.5, 15, "the approach of a mission that ends in a landing is refused", must=False
    ),
)


def _px4_mission_requirement(envelope: Envelope) -> WantedParameter:
    """Return the requirement on MIS_TKO_LAND_REQ, by which the navigator checks missions, also in the air.

    1 requires a take-off item, which no re-task in flight has; 2 a landing; 3 and 4 both.
    """
    name = ("MIS_TKO_LAND_REQ",)
    if envelope.lands:
        why = "1 and 3 to 5 reject missions without a take-off, so every re-task in flight"
        return WantedParameter(name, 0, 2, why, allowed=(0, 2))
    why = 'missions that end in a loiter are rejected, in flight too; or set mission.end = "land" (0 or 2)'
    return WantedParameter(name, 0, 0, why)


def px4_parameters_for(envelope: Envelope) -> tuple[WantedParameter, ...]:
    """Return the parameters of PX4 that must fit a mission."""
    slow = 0.75 * envelope.speed_m_s
    fast = 1.25 * envelope.speed_m_s
    wide = f"it turns wider than routes are planned for ({envelope.table}.bank_deg)"
    speed = f"it flies faster or slower than routes are planned for ({envelope.table}.speed_m_s)"
    return (
        _px4_mission_requirement(envelope),
        WantedParameter(("FW_R_LIM",), envelope.bank_deg, 90, wide),
        WantedParameter(("FW_AIRSPD_TRIM",), slow, fast, speed, must=False),
        *(_px4_over_terrain(envelope) if envelope.follows_terrain else ()),
    )


def _px4_over_terrain(envelope: Envelope) -> tuple[WantedParameter, ...]:
    """Return the requirements on the altitude control of PX4 (`TECSControl::_calcAltitudeControlOutput`).

    In a steady climb it is too low by (1 - FW_T_HRATE_FF) * FW_T_ALT_TC times the rate, in a descent too
    high: with the defaults of 0.3 and 5 s by 3.5 m for each m/s.
    """
    late = "in a climb it is too low by (1 - FW_T_HRATE_FF) x FW_T_ALT_TC x the rate, in a descent too high"
    return (
        *_rates(envelope, "FW_T_CLMB_R_SP", "FW_T_SINK_R_SP"),
        WantedParameter(("FW_T_HRATE_FF",), 0.8, 1, late, must=False),
        WantedParameter(("FW_T_ALT_TC",), 2, 5, late, must=False),
        WantedParameter(
            ("NAV_LOITER_RAD",),
            10,
            60,
            "it ends each climb and descent this far before the waypoint: it flies too high or too low there",
            must=False,
        ),
    )
