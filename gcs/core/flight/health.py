"""Health of vehicles in flight: when GPS, battery and others count as bad, so that one is unfit for targets.

Sources (https://mavlink.io/en/messages/common.html): GPS_RAW_INT.fix_type, SYS_STATUS sensor bits, the flags
of EKF_STATUS_REPORT (ArduPilot) or ESTIMATOR_STATUS (PX4), VFR_HUD.throttle with the vertical speed,
WIND or WIND_COV. The charge of the battery has alarms of its own (`gcs.mavlink.fleet.checks.battery_alarm`).

A problem is told once it was seen for `_TELL_NS`, and ends after `_END_NS` without it. Some make a vehicle
unfit: it gets no other target, and its own goes to another vehicle if there is one. Its onboard mission
stays.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import Config
from gcs.core.flight.flight_state import AgentFlight, FlightState, HealthProblem
from gcs.core.state import Agent
from gcs.mavlink.fleet.checks.battery_alarm import CRITICAL_PERCENT
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.vehicle import Readings
from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, Effect, FlightPhase, HealthItem, Notice, NoticeCode, VehicleState

_PERIOD_NS: Final = ns(0.5)
_TELL_NS: Final = {item: ns(1.0) for item in HealthItem} | {
    HealthItem.PROPULSION: ns(2.5),
    HealthItem.WIND: ns(10.0),
}
_END_NS: Final = {item: ns(3.0) for item in HealthItem} | {HealthItem.PROPULSION: ns(6.0)}
"""Without thrust an aeroplane sinks in waves: for some seconds it holds its height."""
_UNFIT_NS: Final = {
    HealthItem.GPS: ns(5.0),
    HealthItem.GPS_POSITION: ns(5.0),
    HealthItem.ESTIMATE: ns(2.0),
    HealthItem.PROPULSION: ns(3.0),
    HealthItem.BATTERY: ns(1.0),
}
"""Time after which a problem makes a vehicle unfit; the other problems do not."""
_CODES: Final[dict[HealthItem, tuple[NoticeCode, NoticeCode]]] = {
    HealthItem.GPS: (NoticeCode.GPS_PROBLEM, NoticeCode.GPS_GOOD),
    HealthItem.GPS_POSITION: (NoticeCode.GPS_POSITION_PROBLEM, NoticeCode.GPS_POSITION_GOOD),
    HealthItem.ESTIMATE: (NoticeCode.ESTIMATE_PROBLEM, NoticeCode.ESTIMATE_GOOD),
    HealthItem.AIRSPEED: (NoticeCode.AIRSPEED_PROBLEM, NoticeCode.AIRSPEED_GOOD),
    HealthItem.PROPULSION: (NoticeCode.PROPULSION_PROBLEM, NoticeCode.PROPULSION_GOOD),
    HealthItem.BATTERY: (NoticeCode.BATTERY_PROBLEM, NoticeCode.BATTERY_GOOD),
    HealthItem.RC: (NoticeCode.RC_PROBLEM, NoticeCode.RC_GOOD),
    HealthItem.FENCE: (NoticeCode.FENCE_PROBLEM, NoticeCode.FENCE_GOOD),
    HealthItem.WIND: (NoticeCode.WIND_PROBLEM, NoticeCode.WIND_GOOD),
}
"""Begin and end of each problem."""
_SENSOR_BITS: Final = {
    HealthItem.AIRSPEED: dialect.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE,
    HealthItem.RC: dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER,
    HealthItem.FENCE: dialect.MAV_SYS_STATUS_GEOFENCE,
}
_SENSOR_TEXTS: Final = {
    HealthItem.AIRSPEED: "its airspeed sensor is unhealthy",
    HealthItem.RC: "its RC receiver hears no transmitter",
    HealthItem.FENCE: "it has breached its fence",
}
_PROPULSION_BIT: Final[int] = dialect.MAV_SYS_STATUS_SENSOR_PROPULSION
_BATTERY_BIT: Final[int] = dialect.MAV_SYS_STATUS_SENSOR_BATTERY
_ESTIMATE_BITS: Final[int] = dialect.MAV_SYS_STATUS_AHRS | dialect.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
_GLITCH_FLAGS: Final = {
    dialect.MAV_AUTOPILOT_ARDUPILOTMEGA: 0x8000,  # EKF_GPS_GLITCHING, which this dialect does not name
    dialect.MAV_AUTOPILOT_PX4: dialect.ESTIMATOR_GPS_GLITCH,
}
"""Flag of a GPS position that the estimator rejects, by MAV_AUTOPILOT."""
_FULL_THROTTLE_PERCENT: Final = 90
_FALL_M_S: Final = 1.5
"""Sink rate at full throttle that means a failed engine or propeller."""
_AIRSPEED_DIVE_NS: Final = ns(15.0)
"""Time after an airspeed sensor has failed in which it means nothing: the autopilot dives for the speed that
it does not see, until it flies without the sensor. A PX4 1.17 dived for 9 s.
"""
_WIND_FRACTION: Final = 0.3
"""Wind speed, as a fraction of the airspeed, that raises the alarm where the mission file states no wind."""
_MIN_USE_S: Final = 60.0
_MIN_USE_PERCENT: Final = 3
"""The use of the battery is known after this time and charge."""


class HealthMonitor:
    """Health of all vehicles in flight."""

    def __init__(self, config: Config, fleet: Fleet, agents: Mapping[int, Agent], state: FlightState) -> None:
        self._config = config
        self._fleet = fleet
        self._agents = agents
        self._state = state
        self._max_wind_m_s = {
            agent.vehicle: airframe.wind_m_s or _WIND_FRACTION * airframe.speed_m_s
            for agent in config.agents
            for airframe in [config.airframe_of(agent.vehicle)]
        }

    def is_due(self, t_ns: int) -> bool:
        """Return True twice a second."""
        return t_ns >= self._state.next_health_t_ns

    def check(self, t_ns: int) -> list[Effect]:
        """Check all vehicles."""
        self._state.next_health_t_ns = t_ns + _PERIOD_NS
        effects: list[Effect] = []
        for state in self._fleet.states():
            agent = self._agents[state.system_id]
            if not agent.flight.phase.is_in_air:
                is_told = any(problem.is_told for problem in agent.flight.problems.values())
                if is_told and agent.flight.phase is FlightPhase.ON_GROUND:  # without a landing
                    effects.append(Notice(t_ns, NoticeCode.TAKEOFF_ENDED, state.system_id))
                agent.flight.problems.clear()
                agent.flight.sensors_good = 0
                agent.flight.battery_begin = agent.flight.endurance_s = None
                agent.flight.unfit = ""
            elif agent.link.liveness == "alive" and agent.flight.grounded_since_t_ns is None:
                effects += self._check(state, agent, t_ns)
        return effects

    def _check(self, state: VehicleState, agent: Agent, t_ns: int) -> list[Effect]:
        flight = agent.flight
        effects = list[Effect]()
        found = dict(self._problems(state, agent, t_ns))
        for item, cause in found.items():
            problem = flight.problems.setdefault(item, HealthProblem(cause, t_ns))
            problem.good_since_t_ns = None
            problem.seen_ns += _PERIOD_NS
            problem.cause = cause
            if not problem.is_told and problem.seen_ns > _TELL_NS[item]:
                problem.is_told = True
                begins, _ = _CODES[item]
                effects.append(Notice(t_ns, begins, state.system_id, {"cause": cause}))
        for item in [item for item in flight.problems if item not in found]:
            problem = flight.problems[item]
            if problem.good_since_t_ns is None:
                problem.good_since_t_ns = t_ns
            if t_ns - problem.good_since_t_ns >= _END_NS[item]:
                del flight.problems[item]
                if problem.is_told:
                    _, ends = _CODES[item]
                    effects.append(Notice(t_ns, ends, state.system_id))
        agent.flight.unfit = _unfit(agent.flight, t_ns)
        return effects

    # ------------------------------------------------------------ problems

    def _problems(self, state: VehicleState, agent: Agent, t_ns: int) -> Iterator[tuple[HealthItem, str]]:
        """Yield the problems that the newest telemetry shows, each with its cause."""
        flight = agent.flight
        now = self._fleet.readings(state.system_id)
        if now.fix_type is not None and now.fix_type < dialect.GPS_FIX_TYPE_3D_FIX:
            yield HealthItem.GPS, "no 3D fix; it flies by its inertial estimate, and its position drifts"
        if (now.estimator_flags or 0) & _GLITCH_FLAGS.get(agent.link.autopilot, 0):
            yield HealthItem.GPS_POSITION, "it jumps: the estimator rejects it, and may follow it later"
        if problem := _estimate_problem(now):
            yield HealthItem.ESTIMATE, problem
        failed = now.sensors_failed or 0
        good = now.sensors_good or 0
        flight.sensors_good |= good
        for item, bit in _SENSOR_BITS.items():
            if failed & bit and (item is not HealthItem.RC or flight.sensors_good & bit):
                yield item, _SENSOR_TEXTS[item]
        airspeed = _SENSOR_BITS[HealthItem.AIRSPEED]
        if flight.sensors_good & airspeed & ~(good | failed):
            yield HealthItem.AIRSPEED, "its autopilot has disabled its airspeed sensor"
        sinks = (now.throttle_percent or 0) >= _FULL_THROTTLE_PERCENT and state.climb_m_s < -_FALL_M_S
        if failed & _PROPULSION_BIT:
            yield HealthItem.PROPULSION, "the autopilot reports a failed engine"
        elif sinks and not _dives_for_airspeed(flight, t_ns):
            yield HealthItem.PROPULSION, "it sinks at full throttle: engine or propeller has failed"
        if problem := self._battery_problem(state, agent, now, t_ns):
            yield HealthItem.BATTERY, problem
        wind_m_s = math.hypot(*(agent.link.wind_m_s or (0.0, 0.0)))
        max_m_s = self._max_wind_m_s[state.system_id]
        if wind_m_s > max_m_s:
            allowed = f"{max_m_s:.0f} m/s that the plan allows (airframe.wind_m_s)"
            yield HealthItem.WIND, f"{wind_m_s:.0f} m/s, above the {allowed}"

    def _battery_problem(self, state: VehicleState, agent: Agent, now: Readings, t_ns: int) -> str:
        if now.sensors_failed is not None and now.sensors_failed & _BATTERY_BIT:
            return "the autopilot reports that it is empty or faulty"
        if now.battery_percent is None:
            return ""
        if now.battery_percent < CRITICAL_PERCENT:
            return f"{CRITICAL_PERCENT} % is not enough for another target"
        agent.flight.endurance_s = _endurance_s(agent.flight, now.battery_percent, t_ns)
        endurance_s = agent.flight.endurance_s
        needed_s = self._needed_s(state, agent)
        if endurance_s is None or endurance_s >= needed_s:
            return ""
        text = f"enough for {endurance_s:.0f} s of flight, but its route and the way back to its home take"
        return f"{text} {needed_s:.0f} s"

    def _needed_s(self, state: VehicleState, agent: Agent) -> float:
        """Return the flight time of the straight way to the end of its route and from there to its home."""
        home = self._fleet.home(state.system_id)
        if home is None or agent.routes.flown is None:
            return 0.0
        home_m = self._config.local_frame.to_local(home.lat_deg, home.lon_deg)
        end_m = agent.routes.flown.flown_m[-1]
        place_m = (state.east_m, state.north_m)
        length_m = math.dist(place_m, end_m) + math.dist(end_m, home_m)
        return length_m / self._config.speeds_m_s[state.system_id]


def _dives_for_airspeed(flight: AgentFlight, t_ns: int) -> bool:
    problem = flight.problems.get(HealthItem.AIRSPEED)
    return problem is not None and t_ns - problem.since_t_ns < _AIRSPEED_DIVE_NS


def _unfit(flight: AgentFlight, t_ns: int) -> str:
    """Return the problems that do not allow a vehicle another target, in words."""
    causes = [
        problem.cause
        for item, problem in flight.problems.items()
        if problem.is_told and item in _UNFIT_NS and t_ns - problem.since_t_ns >= _UNFIT_NS[item]
    ]
    if flight.is_sinking:
        causes.append("it sinks below its planned height")
    return "; ".join(causes)


def _endurance_s(flight: AgentFlight, percent: int, t_ns: int) -> float | None:
    """Return how long a vehicle can fly until its battery is critical, as it was used in this flight."""
    if flight.battery_begin is None:
        flight.battery_begin = (t_ns, percent)
    since_t_ns, begin_percent = flight.battery_begin
    flown_s = (t_ns - since_t_ns) / NS_PER_S
    used_percent = begin_percent - percent
    if flown_s < _MIN_USE_S or used_percent < _MIN_USE_PERCENT:
        return None
    return max(percent - CRITICAL_PERCENT, 0) * flown_s / used_percent


def _estimate_problem(now: Readings) -> str:
    """Return what is wrong with the estimate of attitude and position; empty if nothing is."""
    if now.estimator_flags is not None:
        if not now.estimator_flags & dialect.EKF_ATTITUDE:
            return "the attitude estimate is bad"
        if not now.estimator_flags & dialect.EKF_POS_HORIZ_ABS:
            return "it has no absolute position and flies by dead reckoning"
    if now.sensors_failed is not None and now.sensors_failed & _ESTIMATE_BITS:
        return "the autopilot reports it as unhealthy"
    return ""
