"""Take-off sequence: who may take off next, who waits, and when a climb counts as finished.

Below the altitude layers nothing separates vehicles. A take-off waits while another vehicle nearby is about
to take off, is below the lowest layer, or lands. Nearby means: within the climb to the lowest layer plus the
separation of routes. It also waits while a vehicle in a layer that the climb crosses is, or will be, near the
climb (`gcs.core.separation.climb_traffic`). Meanwhile orders to arm are refused, and missions for armed
vehicles on the ground wait.

A vehicle whose link is down blocks no take-off. Vehicles that were armed elsewhere are not stopped: an alarm
names two that climb near each other.
"""

from __future__ import annotations

import math
from collections.abc import Container
from typing import Final

from gcs.config import Config
from gcs.core.separation.climb_traffic import ClimbTraffic
from gcs.core.state import State
from gcs.core.tasking.onboard_missions import OnboardMissions
from gcs.mavlink.autopilots.modes import AUTO
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.on_ground import LOW_M, is_on_ground
from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, Effect, Notice, NoticeCode, Parameter, VehicleState, vehicle_name

SELF_LAUNCHING: Final = frozenset({AUTO, "TAKEOFF"})
"""Modes in which an armed vehicle on the ground takes off at once."""
_ALTITUDE_TOLERANCE_M: Final = 10.0
"""A vehicle this little below the lowest layer has reached it."""
_HYSTERESIS: Final = 1.1
"""Multiple of the distance that ends an alarm of two climbing vehicles."""
_PERIOD_NS: Final = ns(1.0)
_STUCK_NS: Final = ns(30.0)
"""Time below `LOW_M` after which a vehicle in its take-off does not lift off."""


class TakeoffSequence:
    """Separation of take-offs."""

    def __init__(
        self,
        config: Config,
        fleet: Fleet,
        onboard_missions: OnboardMissions,
        state: State,
        traffic: ClimbTraffic,
    ) -> None:
        self._traffic = traffic
        self._config = config
        self._fleet = fleet
        self._missions = onboard_missions
        self._agents = state.agents
        self._state = state.takeoff
        self._uploads = state.tasking
        self._low_m = config.mission.altitude_rel_m - _ALTITUDE_TOLERANCE_M
        climb_m = max(
            one.climb_length_m(config.mission.altitude_rel_m) for one in config.airframes_of_agents.values()
        )
        self.distance_m = climb_m + config.planning.separation_m
        """Distance within which two vehicles must not take off together."""

    def blocked_by(self, vehicle: int, starting: Container[int], t_ns: int) -> str:
        """Return which vehicle blocks a take-off, and how long to wait; empty if none does.

        Parameters
        ----------
        vehicle : int
            Vehicle on the ground.
        starting : container of int
            Vehicles that are being armed and will take off at once.
        """
        state = self._fleet.state(vehicle)
        if state is None:
            return ""
        found = []
        for health in self._fleet.health():
            other = self._fleet.state(health.system_id)
            if health.system_id == vehicle or health.liveness == "down" or other is None:
                continue
            away_m = _distance_m(state, other)
            activity, until = self._obstructs(other, is_starting=health.system_id in starting)
            if self._missions.terminal_phase(health.system_id) == "landing" and health.home is not None:
                home_m = self._config.local_frame.to_local(health.home.lat_deg, health.home.lon_deg)
                away_m = min(away_m, math.dist(home_m, (state.east_m, state.north_m)))
            if activity and away_m <= self.distance_m:
                found.append(
                    (away_m, f"agent {vehicle_name(health.system_id)} {activity}, {away_m:.0f} m away", until)
                )
        if not found:
            return self._crossing(vehicle, t_ns)
        _, nearest, until = min(found)
        more = f", and {len(found) - 1} more" if len(found) > 1 else ""
        return f"{nearest}{more}: wait until it {until}"

    def _crossing(self, vehicle: int, t_ns: int) -> str:
        """Return which vehicle the climb would meet, at most a second ago."""
        takeoff = self._agents[vehicle].takeoff
        if t_ns - takeoff.traffic_t_ns >= _PERIOD_NS:
            takeoff.traffic = ""
            takeoff.traffic_t_ns = t_ns
            crossing = self._traffic.crossing(vehicle, t_ns)
            if crossing is not None:
                other, height_m, away_m = crossing
                takeoff.traffic = (
                    f"its climb meets agent {vehicle_name(other)}, {height_m:.0f} m above home and "
                    f"{away_m:.0f} m away: wait until it has passed, or move it"
                )
        return takeoff.traffic

    def launching(self) -> set[int]:
        """Return the vehicles on the ground whose orders make them take off."""
        commands = {vehicle: agent.orders.command for vehicle, agent in self._agents.items()}
        return {v for v, one in commands.items() if one is not None and self.launches(v, one.action)}

    def launches(self, vehicle: int, action: str) -> bool:
        """Return True if an order lets a vehicle on the ground take off at once."""
        state = self._fleet.state(vehicle)
        if state is None or not is_on_ground(state, self._fleet.home(vehicle)):
            return False
        if action == "resume":
            return state.armed and self._agents[vehicle].tasking.onboard is not None
        return action == "arm" and (state.mode in SELF_LAUNCHING or self._uploads.is_uploading(vehicle))

    def holds_back(self, vehicle: int, t_ns: int) -> str:
        """Return why an armed vehicle on the ground must not start yet; empty if it may."""
        state = self._fleet.state(vehicle)
        if state is None or not state.armed or not is_on_ground(state, self._fleet.home(vehicle)):
            return ""
        return self.blocked_by(vehicle, self.launching(), t_ns)

    def _obstructs(self, state: VehicleState, *, is_starting: bool) -> tuple[str, str]:
        """Return why a vehicle blocks take-offs, and what ends that; both empty if it does not."""
        if not (state.armed or is_starting):
            return "", ""
        vehicle = state.system_id
        home = self._fleet.home(vehicle)
        above = f"is {max(self._low_m, 0.0):.0f} m above home or {self.distance_m:.0f} m away"
        if is_on_ground(state, home):
            is_loaded = state.mode in SELF_LAUNCHING or self._uploads.is_uploading(vehicle)
            if is_starting or is_loaded:
                return "is about to take off", f"{above}, or is disarmed"
            return "", ""
        ending = self._missions.terminal_phase(vehicle)
        if ending in ("return route", "landing"):
            return "flies its landing", "has landed and is disarmed"
        height_m = self._fleet.height_m(state)
        if height_m >= self._low_m:
            return "", ""
        if self._climbs(vehicle):
            return f"climbs out, {height_m:.0f} m above home", above
        return f"is low, {height_m:.0f} m above home in {state.mode}", f"{above}, or is disarmed"

    def check(self, t_ns: int) -> list[Effect]:
        """Check once a second which take-offs wait, and which vehicles climb near each other."""
        if t_ns < self._state.next_check_t_ns:
            return []
        self._state.next_check_t_ns = t_ns + _PERIOD_NS
        return self._check_waiting(t_ns) + self._check_stuck(t_ns) + self._check_climbs(t_ns)

    def _check_waiting(self, t_ns: int) -> list[Effect]:
        effects: list[Effect] = []
        stages = self._uploads.stages
        for vehicle, agent in sorted(self._agents.items()):
            is_queued = stages.get(vehicle) == "waiting"
            was_waiting = agent.takeoff.is_waiting
            reason = self.holds_back(vehicle, t_ns) if is_queued else ""
            agent.takeoff.is_waiting = bool(reason)
            if reason and not was_waiting:
                effects.append(Notice(t_ns, NoticeCode.TAKEOFF_WAITS, vehicle, {"reason": reason}))
        return effects

    def _check_stuck(self, t_ns: int) -> list[Effect]:
        effects: list[Effect] = []
        for state in self._fleet.states():
            vehicle = state.system_id
            takeoff = self._agents[vehicle].takeoff
            if not self._missions.is_in_takeoff(vehicle) or self._fleet.height_m(state) >= LOW_M:
                takeoff.low_since_t_ns = None
                if takeoff.is_stuck:
                    effects.append(Notice(t_ns, NoticeCode.TAKEOFF_STUCK_NO_LONGER, vehicle))
                takeoff.is_stuck = False
                continue
            if takeoff.low_since_t_ns is None:
                takeoff.low_since_t_ns = t_ns
            since_ns = t_ns - takeoff.low_since_t_ns
            if since_ns >= _STUCK_NS and not takeoff.is_stuck:
                takeoff.is_stuck = True
                about: dict[str, Parameter] = {"since_s": since_ns / NS_PER_S}
                effects.append(Notice(t_ns, NoticeCode.TAKEOFF_STUCK, vehicle, about))
        return effects

    def _check_climbs(self, t_ns: int) -> list[Effect]:
        climbing = []
        for state in self._fleet.states():
            takeoff = self._agents[state.system_id].takeoff
            was_grounded = takeoff.is_grounded
            is_low = self._fleet.height_m(state) < self._low_m
            takeoff.is_grounded = is_on_ground(state, self._fleet.home(state.system_id))
            takeoff.is_climbing = not takeoff.is_grounded and (was_grounded or takeoff.is_climbing) and is_low
            if not takeoff.is_grounded and self._climbs(state.system_id):
                climbing.append(state)
        near = {
            (one.system_id, other.system_id): _distance_m(one, other)
            for i, one in enumerate(climbing)
            for other in climbing[i + 1 :]
        }
        before = set(self._state.close_pairs)
        still = {pair for pair in before if near.get(pair, math.inf) <= _HYSTERESIS * self.distance_m}
        new = {pair for pair, away_m in near.items() if away_m <= self.distance_m} - still
        effects: list[Effect] = []
        for first, second in sorted(new):
            about: dict[str, Parameter] = {"other": second, "distance_m": near[first, second]}
            effects.append(Notice(t_ns, NoticeCode.CLIMBS_NEAR, first, about))
        for first, second in sorted(before - still):
            effects.append(Notice(t_ns, NoticeCode.CLIMBS_APART, first, {"other": second}))
        self._state.close_pairs = sorted(still | new)
        return effects

    def _climbs(self, vehicle: int) -> bool:
        state = self._fleet.state(vehicle)
        if state is None or not state.armed or self._fleet.height_m(state) >= self._low_m:
            return False
        is_climbing = self._agents[vehicle].takeoff.is_climbing or state.mode == "TAKEOFF"
        return is_climbing or self._missions.is_in_takeoff(vehicle)


def _distance_m(one: VehicleState, other: VehicleState) -> float:
    return math.hypot(one.east_m - other.east_m, one.north_m - other.north_m)
