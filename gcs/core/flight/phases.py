"""Flight phases: on the ground, climbing, en route, landed; and whether a vehicle came down, or sinks.

Each observation of the telemetry gives one event of `gcs.model.flight_phase`. The evidence, in this order:

* On the ground (`gcs.mavlink.fleet.on_ground`) for `_SETTLE_NS`: it stands, if it has not been higher than
  `LOW_M` since it last stood; else it has landed, or came down.
* A touchdown is planned in RTL or on the mission's landing, and under a pilot, within `_HOME_RADIUS_M` of
  home; in RTL also elsewhere if it is gentle (a rally point).
* In the air: its mode and the item of its verified mission.

A vehicle that came down, or has landed, gets no mission and is not armed until an operator orders that it is
ready (`Authority.DOWN`, `Authority.LANDED`). Its onboard mission counts as unknown: it was not made for a
take-off from there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import Config
from gcs.core.flight.flight_state import AgentFlight, FlightState
from gcs.core.state import Agent
from gcs.core.tasking.onboard_missions import OnboardMissions
from gcs.geo import LocalFrame
from gcs.mavlink.autopilots.modes import AUTO, LOITER, RTL
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.on_ground import LOW_M, is_on_ground
from gcs.mavlink.services.retry import ns
from gcs.model import (
    PHASE_TRANSITIONS,
    AgentStatus,
    ControlEvent,
    Effect,
    FlightEvent,
    FlightPhase,
    HealthItem,
    Notice,
    NoticeCode,
    Parameter,
    VehicleState,
    target_name,
)
from gcs.model.vehicle_ids import home_label
from gcs.planning.map.grid import Point

_PERIOD_NS: Final = ns(0.25)
_MAX_AGE_NS: Final = ns(2.0)
"""An older position gives no event."""
_SETTLE_NS: Final = ns(1.0)
"""Time on the ground, or in the air after a landing, before it counts."""
_HOME_RADIUS_M: Final = 200.0
"""A landing at home touches down within this distance of it."""
_GENTLE_M_S: Final = 2.0
"""Sink rate of a controlled landing away from home."""
_OUR_MODES: Final = frozenset({"", AUTO, LOITER, "TAKEOFF"})
_LANDING_MODES: Final = frozenset({"LAND", "PRECLAND", "QLAND", "AUTOLAND"})
_CAUSES: Final = frozenset(HealthItem) - {HealthItem.WIND, HealthItem.RC, HealthItem.FENCE}
"""Problems that make a vehicle come down."""
_ABOVE_GROUND_M: Final = 30.0
"""Above an elevation model, a vehicle that is so high flies: more than models are off."""
_SINK_M: Final = 15.0
"""Height below the planned one at which a sinking vehicle is reported."""
_SINK_M_S: Final = 1.0
_SINK_NS: Final = ns(1.5)
_DIVE_M_S: Final = 8.0
"""Sink rate that no autopilot commands (ArduPlane TECS_SINK_MAX, PX4 FW_T_SINK_MAX: 5 m/s)."""
_STEERED_MODES: Final = frozenset({AUTO, LOITER, RTL, "TAKEOFF", "CIRCLE", "GUIDED"})
"""Modes in which the autopilot controls the height."""
_END_NS: Final = ns(6.0)
"""Without thrust an aeroplane sinks in waves: for some seconds it holds its height."""


class FlightPhases:
    """Flight phases of all vehicles."""

    def __init__(
        self,
        config: Config,
        fleet: Fleet,
        agents: Mapping[int, Agent],
        missions: OnboardMissions,
        state: FlightState,
    ) -> None:
        self._fleet = fleet
        self._agents = agents
        self._missions = missions
        self._state = state
        self._frame: LocalFrame = config.local_frame
        self._lowest_m = config.mission.altitude_rel_m
        self._elevation = config.elevation

    def is_due(self, t_ns: int) -> bool:
        """Return True four times a second."""
        return t_ns >= self._state.next_check_t_ns

    def check(self, t_ns: int) -> list[Effect]:
        """Check all vehicles; return notices, and the new statuses of vehicles that came down."""
        self._state.next_check_t_ns = t_ns + _PERIOD_NS
        effects: list[Effect] = []
        for state in self._fleet.states():
            if t_ns - state.t_ns <= _MAX_AGE_NS:
                effects += self._observe(state, t_ns)
        return effects

    def declare_ready(self, vehicle: int, t_ns: int) -> list[Effect]:
        """Carry out the order that a vehicle on the ground is ready to fly again."""
        agent = self._agents[vehicle]
        self._enter(vehicle, FlightEvent.READY, t_ns)
        agent.claims.apply(ControlEvent.READY, t_ns)
        agent.flight.highest_m = 0.0
        status = agent.perception.status
        if status.status != "down":
            return []
        return [AgentStatus(t_ns, vehicle, "active", None, status.position_m)]

    # ------------------------------------------------------------ events

    def _observe(self, state: VehicleState, t_ns: int) -> list[Effect]:
        vehicle = state.system_id
        flight = self._agents[vehicle].flight
        if is_on_ground(state, self._fleet.home(vehicle)):
            flight.airborne_since_t_ns = None
            if flight.grounded_since_t_ns is None:
                flight.grounded_since_t_ns = t_ns
            if t_ns - flight.grounded_since_t_ns < _SETTLE_NS and flight.phase is not FlightPhase.UNKNOWN:
                return []
            return self._ground(state, t_ns)
        if not state.mode:
            return []
        flight.grounded_since_t_ns = None
        if flight.airborne_since_t_ns is None:
            flight.airborne_since_t_ns = t_ns
        if flight.phase.has_flown and not self._flies_again(state, flight, t_ns):
            return []
        height_m = self._fleet.height_m(state)
        flight.highest_m = max(flight.highest_m, height_m)
        flight.is_landing_planned = self._is_landing_planned(state)
        had_flown = flight.phase.has_flown
        self._enter(vehicle, self._event_in_air(state, height_m), t_ns)
        effects = self._fly_again(vehicle, t_ns) if had_flown else []
        return effects + self._check_sinking(state, height_m, t_ns)

    def _enter(self, vehicle: int, event: FlightEvent, t_ns: int) -> bool:
        """Enter the phase after an event; return True if it is a new one."""
        flight = self._agents[vehicle].flight
        after = PHASE_TRANSITIONS[flight.phase].get(event, flight.phase)
        if after is flight.phase:
            return False
        flight.phase = after
        flight.since_t_ns = t_ns
        return True

    def _flies_again(self, state: VehicleState, flight: AgentFlight, t_ns: int) -> bool:
        """Return True if a vehicle that has landed, or is down, is in the air: not carried, not bumped."""
        since_ns = t_ns - (flight.airborne_since_t_ns or t_ns)
        if not state.armed or since_ns < _SETTLE_NS:
            return False
        return self._fleet.height_m(state) >= LOW_M or self._agl_m(state) >= _ABOVE_GROUND_M

    def _agl_m(self, state: VehicleState) -> float:
        """Return the height of a vehicle above the elevation model; negative infinity without one."""
        if self._elevation is None:
            return -math.inf
        return state.alt_msl_m - self._elevation.height_msl_m(state.east_m, state.north_m)

    def _event_in_air(self, state: VehicleState, height_m: float) -> FlightEvent:
        vehicle = state.system_id
        phase = self._agents[vehicle].flight.phase
        ending = self._missions.terminal_phase(vehicle)
        if state.mode in _LANDING_MODES or state.is_landing or ending == "landing":
            return FlightEvent.LANDS
        stacked = self._agents[vehicle].routes.stacked
        is_sent_home = state.mode == AUTO and stacked is not None and stacked.target == home_label(vehicle)
        if state.mode == RTL or is_sent_home or ending in ("return route", "return"):
            return FlightEvent.RETURNS
        is_new = phase in (FlightPhase.ON_GROUND, FlightPhase.TAKING_OFF)
        if self._missions.is_in_takeoff(vehicle) or state.mode == "TAKEOFF" or (is_new and height_m < LOW_M):
            return FlightEvent.CLIMBS
        has_arrived = self._agents[vehicle].perception.status.status == "arrived"
        is_at_target = ending == "circle" or (ending == "circle elsewhere" and has_arrived)
        return FlightEvent.CIRCLES if is_at_target else FlightEvent.FLIES

    def _is_landing_planned(self, state: VehicleState) -> bool:
        home = self._fleet.home(state.system_id)
        ending = self._missions.terminal_phase(state.system_id)
        lands = state.mode == RTL or ending in ("return route", "landing", "return")
        if state.mode == AUTO and state.is_landing:
            return True
        if home is None:
            return lands
        east_m, north_m = self._frame.to_local(home.lat_deg, home.lon_deg)
        if math.hypot(state.east_m - east_m, state.north_m - north_m) > _HOME_RADIUS_M:
            return state.mode == RTL and state.climb_m_s > -_GENTLE_M_S
        return lands or state.mode not in _OUR_MODES

    # ------------------------------------------------------------ on the ground

    def _ground(self, state: VehicleState, t_ns: int) -> list[Effect]:
        vehicle = state.system_id
        flight = self._agents[vehicle].flight
        was_in_air = flight.phase.is_in_air
        before = flight.phase
        if not was_in_air or flight.highest_m < LOW_M:
            event = FlightEvent.STANDS
        else:
            event = FlightEvent.TOUCHED_DOWN if flight.is_landing_planned else FlightEvent.CAME_DOWN
        self._enter(vehicle, event, t_ns)
        flight.highest_m = 0.0
        flight.is_sinking = False
        flight.sinks_since_t_ns = None
        if not (was_in_air and flight.phase.has_flown):
            return []
        agent = self._agents[vehicle]
        place_m = (state.east_m, state.north_m)
        if flight.phase is FlightPhase.LANDED:
            agent.claims.apply(ControlEvent.TOUCHED_DOWN, t_ns)
            return [Notice(t_ns, NoticeCode.LANDED, vehicle)]
        agent.claims.apply(ControlEvent.CAME_DOWN, t_ns)
        reached = agent.perception.status.target if agent.perception.status.status == "arrived" else None
        status = AgentStatus(t_ns, vehicle, "down", reached, place_m)
        return [self._alarm(t_ns, vehicle, before, place_m), status]

    def _alarm(self, t_ns: int, vehicle: int, before: FlightPhase, place_m: Point) -> Notice:
        agent = self._agents[vehicle]
        lat_deg, lon_deg = self._frame.to_geodetic(*place_m)
        told = [one.cause for item, one in agent.flight.problems.items() if one.is_told and item in _CAUSES]
        flown = agent.routes.flown
        parameters: dict[str, Parameter] = {
            "phase": before.value,
            "causes": "; ".join(told),
            "lat_deg": lat_deg,
            "lon_deg": lon_deg,
            "target": "" if flown is None else target_name(flown.target),
        }
        return Notice(t_ns, NoticeCode.CAME_DOWN, vehicle, parameters)

    def _fly_again(self, vehicle: int, t_ns: int) -> list[Effect]:
        """End the claims on a vehicle that landed, or came down, and is in the air again."""
        agent = self._agents[vehicle]
        agent.claims.apply(ControlEvent.AIRBORNE_AGAIN, t_ns)
        status = agent.perception.status
        if status.status != "down":
            return []
        notice = Notice(t_ns, NoticeCode.IN_AIR_AFTER_ALL, vehicle)
        return [notice, AgentStatus(t_ns, vehicle, "active")]

    # ------------------------------------------------------------ sinking

    def _check_sinking(self, state: VehicleState, height_m: float, t_ns: int) -> list[Effect]:
        """Notify when a vehicle sinks below its planned height without having been told to."""
        vehicle = state.system_id
        flight = self._agents[vehicle].flight
        planned_m = self._planned_height_m(state)
        is_low = planned_m is not None and height_m < planned_m - _SINK_M
        dives = state.mode in _STEERED_MODES and state.climb_m_s < -_DIVE_M_S
        if not dives and (not is_low or state.climb_m_s > -_SINK_M_S):
            flight.sinks_since_t_ns = None
            if not flight.is_sinking or (is_low and t_ns - flight.sank_t_ns < _END_NS):
                return []
            flight.is_sinking = False
            return [Notice(t_ns, NoticeCode.SINKS_NO_LONGER, vehicle, {"height_m": height_m})]
        flight.sank_t_ns = t_ns
        if flight.sinks_since_t_ns is None:
            flight.sinks_since_t_ns = t_ns
        if flight.is_sinking or t_ns - flight.sinks_since_t_ns < _SINK_NS:
            return []
        flight.is_sinking = True
        parameters: dict[str, Parameter] = {
            "sink_m_s": -state.climb_m_s,
            "height_m": height_m,
            "planned_m": "" if planned_m is None else planned_m,
            "down_s": max(height_m, 0.0) / -state.climb_m_s,
        }
        return [Notice(t_ns, NoticeCode.SINKS, vehicle, parameters)]

    def _planned_height_m(self, state: VehicleState) -> float | None:
        """Return the height above home that a vehicle should keep; None where none is known."""
        phase = self._agents[state.system_id].flight.phase
        mode = state.mode
        if phase not in (FlightPhase.EN_ROUTE, FlightPhase.AT_TARGET) or mode not in (AUTO, LOITER):
            return None
        if mode == LOITER:
            return self._lowest_m
        onboard = self._agents[state.system_id].tasking.onboard
        if onboard is None or not 0 <= state.mission_seq < len(onboard.items):
            return None
        item = onboard.items[state.mission_seq]
        relative = dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        return item.z_m if item.frame in relative else None
