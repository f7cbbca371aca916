"""Simulated vehicle: airframe, autopilot and link on one clock.

It flies in virtual time and in a process of its own alike: time and bytes are arguments.

Loss: at each check (`death_check_period_s`) a uniform number is drawn. The vehicle is lost if it exceeds the
survival probability: it sends no telemetry and no answers, and its position stays.

Faults begin and end at their times (`sim_vehicles.vehicle.faults`), or by `begin_fault` and `end_fault`.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.geo import LocalFrame
from gcs.model import NS_PER_S
from gcs.terrain.elevation_grid import Elevation
from sim_vehicles.autopilots.arduplane import Autopilot
from sim_vehicles.autopilots.autopilot_traits import TRAITS
from sim_vehicles.autopilots.mission_protocol import NEVER_NS
from sim_vehicles.autopilots.parameters import Parameters
from sim_vehicles.autopilots.px4 import Px4Autopilot
from sim_vehicles.vehicle.banked_airframe import BankedAirframe
from sim_vehicles.vehicle.faults import Fault, FaultChange, FaultKind, fault_changes
from sim_vehicles.vehicle.geodesy import Geodesy
from sim_vehicles.vehicle.message_handlers import VehicleLink
from sim_vehicles.vehicle.paper_airframe import STEP_NS, Airframe
from sim_vehicles.vehicle.wind import Wind
from sim_vehicles.world.first_contact import GroundContact

AIRFRAMES: dict[str, type[Airframe]] = {"paper": Airframe, "banked": BankedAirframe}


@dataclass(frozen=True, slots=True)
class VehicleSpec:
    """Type and start of a vehicle."""

    system_id: int
    east_m: float
    north_m: float
    course_rad: float
    """Clockwise from north."""
    alt_rel_m: float
    """Above home; a vehicle that starts on the ground climbs to it."""
    forward_speed_m_s: float
    home_rel_m: float = 0.0
    """Height of the ground at its start above the local frame's origin."""
    airborne: bool = True
    """True if it starts armed and circling; False if disarmed on the ground."""
    survival_probability: float = 1.0
    """At each check."""
    death_check_period_s: float = 1.0
    dies_at_s: float | None = None
    """Seconds from the start, or from ground contact; None for a random loss."""
    faults: tuple[Fault, ...] = ()
    waits_for_ground: bool = False
    """True if losses and faults start with ground contact (`GroundContact`), not at the start."""
    seed: int = 0
    accept_radius_m: float = 10.0
    """Of waypoints without an own radius."""
    gps_noise_std_m: float = 1.0
    airframe: str = "paper"
    """Airframe: "paper" (`sim_vehicles.vehicle.paper_airframe`) or "banked" (`banked_airframe`)."""
    max_bank_deg: float | None = None
    """Greatest bank; None: that of the airframe. The paper's model has no limit."""
    climb_deg: float | None = None
    """Angle of the steepest climb; None: that of the airframe."""
    climb_m_s: float | None = None
    """Greatest climb rate; None: that of the airframe."""
    sink_m_s: float | None = None
    """Greatest sink rate; None: that of the airframe."""
    autopilot: str = "ardupilot"
    """Simulated autopilot: "ardupilot" or "px4"."""
    wind_east_m_s: float = 0.0
    """Direction to which the air moves."""
    wind_north_m_s: float = 0.0
    gust_std_m_s: float = 0.0
    gust_time_s: float = 5.0
    arming_delay_s: float = 20.0
    """Time after a start on the ground in which arming is refused."""
    key_file: str = ""
    """File of signing keys; empty for none."""
    parameters: dict[str, float] = field(default_factory=dict)
    """Values other than the defaults."""


_LOW_CEILING_M = 5.0
"""Above home, of a vehicle that a fault puts beyond its fence."""


def _generator(spec: VehicleSpec, purpose: str) -> np.random.Generator:
    return np.random.default_rng([spec.seed, zlib.crc32(purpose.encode()), spec.system_id])


class SimVehicle:
    """A vehicle from its boot on.

    Parameters
    ----------
    spec : VehicleSpec
    frame : LocalFrame
    start_t_ns : int
        Boot time; telemetry begins.
    key : bytes, optional
        Signing key.
    elevation : Elevation, optional
        Ground below; without it the ground is level, at the height of the frame's origin.
    """

    def __init__(
        self,
        spec: VehicleSpec,
        frame: LocalFrame,
        start_t_ns: int,
        key: bytes | None = None,
        elevation: Elevation | None = None,
    ) -> None:
        self.spec = spec
        self.system_id = spec.system_id
        self.alive = True
        self.geodesy = Geodesy(frame, elevation)
        home_m = spec.home_rel_m
        self.airframe = AIRFRAMES[spec.airframe](
            spec.east_m,
            spec.north_m,
            home_m + spec.alt_rel_m if spec.airborne else home_m,
            spec.course_rad,
            spec.forward_speed_m_s if spec.airborne else 0.0,
        )
        if spec.max_bank_deg is not None:
            self.airframe.max_bank_rad = math.radians(spec.max_bank_deg)
        if spec.climb_m_s is not None:
            self.airframe.max_climb_m_s = spec.climb_m_s
        if spec.sink_m_s is not None:
            self.airframe.max_sink_m_s = spec.sink_m_s
        if spec.climb_deg is not None:
            self.airframe.limit_climb(math.radians(spec.climb_deg), spec.forward_speed_m_s)
        parameters = Parameters(
            px4=spec.autopilot == "px4",
            SYSID_THISMAV=spec.system_id,
            WP_RADIUS=spec.accept_radius_m,
            AIRSPEED_CRUISE=spec.forward_speed_m_s,
            ARMING_DELAY_S=spec.arming_delay_s,
        )
        for name in parameters:
            if name in spec.parameters:
                parameters.store(name, spec.parameters[name])
        self.autopilot = (Px4Autopilot if spec.autopilot == "px4" else Autopilot)(
            self.airframe,
            parameters,
            self.geodesy,
            spec.forward_speed_m_s,
            start_t_ns,
            spec.airborne,
            TRAITS[spec.autopilot],
        )
        self._link = VehicleLink(
            spec.system_id, self.autopilot, start_t_ns, spec.gps_noise_std_m, _generator(spec, "gps"), key
        )
        self._death_rng = _generator(spec, "death")
        self._wind: Wind | None = None
        if spec.wind_east_m_s or spec.wind_north_m_s or spec.gust_std_m_s:
            self._wind = Wind(
                spec.wind_east_m_s,
                spec.wind_north_m_s,
                spec.gust_std_m_s,
                spec.gust_time_s,
                _generator(spec, "wind"),
                start_t_ns,
            )
        self._start_t_ns = start_t_ns
        self.ground = GroundContact()
        self._check_period_ns = max(int(spec.death_check_period_s * NS_PER_S), STEP_NS)
        self._death_check_ns = self._dies_ns = NEVER_NS
        self._fault_changes: list[FaultChange] = []
        if not spec.waits_for_ground:
            self._start_losses(start_t_ns)
        self._stepped_ns = start_t_ns

    def _start_losses(self, t_ns: int) -> None:
        if self.spec.survival_probability < 1.0:
            self._death_check_ns = t_ns + self._check_period_ns
        if self.spec.dies_at_s is not None:
            self._dies_ns = t_ns + int(self.spec.dies_at_s * NS_PER_S)
        self._fault_changes = fault_changes(self.spec.faults, t_ns)

    def begin_fault(self, kind: FaultKind) -> None:
        """Break something now."""
        self.autopilot.faults.begin(kind, self._stepped_ns)
        if kind is FaultKind.FENCE:
            self.autopilot.fence.ceiling_m = _LOW_CEILING_M

    def end_fault(self, kind: FaultKind) -> None:
        """Repair it; a wreck stays one."""
        if kind is FaultKind.CRASH:
            return
        self.autopilot.faults.end(kind)
        if kind is FaultKind.FENCE:
            self.autopilot.fence.ceiling_m = None

    @property
    def is_down(self) -> bool:
        """True after it came down elsewhere than by a landing of its mission, until it flies again."""
        return self.autopilot.is_down

    @property
    def _is_silent(self) -> bool:
        return FaultKind.RADIO in self.autopilot.faults

    @property
    def east_m(self) -> float:
        """True position."""
        return self.airframe.east_m

    @property
    def north_m(self) -> float:
        """True position."""
        return self.airframe.north_m

    @property
    def alt_rel_m(self) -> float:
        """Above the local frame's origin."""
        return self.airframe.alt_rel_m

    @property
    def alt_msl_m(self) -> float:
        """Above mean sea level."""
        return self.geodesy.frame.alt_msl_m + self.airframe.alt_rel_m

    @property
    def course_rad(self) -> float:
        """Direction of motion over ground, clockwise from north, in [0, 2 pi)."""
        return self.airframe.course_rad

    @property
    def speed_m_s(self) -> float:
        """Forward speed."""
        return self.airframe.speed_m_s

    @property
    def due_ns(self) -> int:
        """Time of the next action apart from flight; far in the future for a dead vehicle."""
        if not self.alive:
            return NEVER_NS
        fault_ns = self._fault_changes[-1].t_ns if self._fault_changes else NEVER_NS
        return min(self._link.due_ns, self._death_check_ns, self._dies_ns, fault_ns)

    def advance(self, t_ns: int) -> None:
        """Fly every 10 ms step that ends by `t_ns`, and send the messages due until then."""
        while self.alive and self._stepped_ns <= t_ns:
            due_ns = self.due_ns
            if due_ns <= self._stepped_ns:
                self._handle_due(self._stepped_ns)
                continue
            # Fly up to the next due time.
            until_ns = min(due_ns + STEP_NS - 1, t_ns)
            if self._stepped_ns + STEP_NS > until_ns:
                return
            self._fly(until_ns)

    def _fly(self, until_ns: int) -> None:
        autopilot = self.autopilot
        now_ns = self._stepped_ns
        step = autopilot.step
        notices = autopilot.notices
        wind = self._wind
        while (now_ns := now_ns + STEP_NS) <= until_ns:
            self._stepped_ns = now_ns
            if wind is not None and autopilot.flying:
                wind.blow(self.airframe, now_ns, autopilot.height_agl_m)
            step(now_ns)
            if notices:
                self._link.send_notices(now_ns)

    def _handle_due(self, t_ns: int) -> None:
        if self._dies_ns <= t_ns:
            self.alive = False
            return
        if self._death_check_ns <= t_ns:
            self._death_check_ns += self._check_period_ns
            if self._death_rng.random() > self.spec.survival_probability:
                self.alive = False
                return
        while self._fault_changes and self._fault_changes[-1].t_ns <= t_ns:
            change = self._fault_changes.pop()
            (self.begin_fault if change.begins else self.end_fault)(change.kind)
        self._link.handle_timer(t_ns)

    def receive_datagram(self, data: bytes, t_ns: int) -> None:
        """Process one datagram from the ground, after flying up to `t_ns`; invalid bytes are skipped."""
        self.advance(t_ns)
        if self.alive and t_ns >= self._start_t_ns and not self._is_silent:
            if self.ground.hear(t_ns) and self.spec.waits_for_ground:
                self._start_losses(t_ns)
            self._link.receive_datagram(data, t_ns)
            self._link.send_notices(t_ns)

    def datagrams_to_send(self, t_ns: int) -> list[bytes]:
        """Return the datagrams queued up to `t_ns`: whole frames, at most 1400 bytes each."""
        self.advance(t_ns)
        datagrams = self._link.outbox.pop_datagrams()
        return [] if self._is_silent else datagrams

    def truth_messages(self, t_ns: int) -> tuple[Any, Any]:
        """Return SYSTEM_TIME and SIM_STATE: the true state, for the simulated world only."""
        airframe = self.airframe
        lat_deg, lon_deg = self.geodesy.to_geodetic(airframe.east_m, airframe.north_m)
        east_m_s, north_m_s = airframe.velocity_m_s
        boot_ms = (t_ns - self._start_t_ns) // 1_000_000
        return (
            mavlink.MAVLink_system_time_message(t_ns // 1000, boot_ms & 0xFFFFFFFF),
            mavlink.MAVLink_sim_state_message(
                1.0, 0.0, 0.0, 0.0, airframe.roll_rad, 0.0, airframe.heading_rad, 0.0, 0.0, 0.0,
                airframe.roll_rate_rad_s, 0.0, airframe.yaw_rate_rad_s, lat_deg, lon_deg, self.alt_msl_m, 0.0,
                0.0, north_m_s, east_m_s, -airframe.climb_m_s, round(lat_deg * 1e7), round(lon_deg * 1e7),
            ),
        )  # fmt: skip
