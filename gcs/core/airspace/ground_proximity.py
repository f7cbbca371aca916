"""Ground proximity: alarms of vehicles that are, or will be, too near to the ground.

Only over an elevation model, once a second, and not in take-off and landing. A vehicle on a verified mission
flies what was checked before its upload (`gcs.core.airspace.mission_bounds`), so only its height now counts.
In every other mode its flight is simulated `LOOK_AHEAD_S` ahead.
"""

from __future__ import annotations

from typing import Final

from gcs.config import Config
from gcs.core.airspace.airspace_state import AirspaceState
from gcs.core.separation.ground_ahead import GroundAhead
from gcs.core.separation.intents import Intents
from gcs.core.state import State
from gcs.mavlink.autopilots.modes import AUTO
from gcs.mavlink.services.retry import ns
from gcs.model import Effect, FlightPhase, Notice, NoticeCode, Parameter, VehicleState

LOOK_AHEAD_S: Final = 20.0
_PERIOD_NS: Final = ns(1.0)
_CLEAR_NS: Final = ns(5.0)
_PHASES: Final = {FlightPhase.EN_ROUTE, FlightPhase.AT_TARGET, FlightPhase.RETURNING}


class GroundProximity:
    """Height above ground of all vehicles in flight."""

    def __init__(self, config: Config, intents: Intents, state: State) -> None:
        self._ground = GroundAhead(config)
        self._intents = intents
        self._agents = state.agents
        self._state: AirspaceState = state.airspace

    def check(self, t_ns: int) -> list[Effect]:
        """Check once a second; return alarms and all-clears."""
        if not self._ground.is_known or t_ns < self._state.next_ground_check_t_ns:
            return []
        self._state.next_ground_check_t_ns = t_ns + _PERIOD_NS
        effects: list[Effect] = []
        for state in self._intents.in_air(t_ns):
            if self._agents[state.system_id].flight.phase in _PHASES:
                effects += self._check(state, t_ns)
        return effects + self._end(t_ns)

    def _check(self, state: VehicleState, t_ns: int) -> list[Effect]:
        """Return the alarm of a vehicle that is, or comes, too near to the ground."""
        ahead_s = 0.0 if state.mode == AUTO else LOOK_AHEAD_S
        found = self._ground.first(self._intents.flight(state, t_ns), ahead_s)
        if found is None:
            return []
        told = self._state.near_ground
        is_news = state.system_id not in told
        told[state.system_id] = t_ns
        if not is_news:
            return []
        parameters: dict[str, Parameter] = {
            "agl_m": found.agl_m,
            "least_m": self._ground.least_m,
            "after_s": found.after_s,
            "east_m": found.east_m,
            "north_m": found.north_m,
        }
        return [Notice(t_ns, NoticeCode.NEAR_GROUND, state.system_id, parameters)]

    def _end(self, t_ns: int) -> list[Effect]:
        told = self._state.near_ground
        clear = [vehicle for vehicle, seen_t_ns in told.items() if t_ns - seen_t_ns >= _CLEAR_NS]
        for vehicle in clear:
            del told[vehicle]
        return [Notice(t_ns, NoticeCode.CLEAR_OF_GROUND, vehicle) for vehicle in sorted(clear)]
