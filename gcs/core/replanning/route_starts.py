"""Inputs of a plan: where and how agents begin their routes, and where their targets will be."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Final

from gcs.config import Config
from gcs.core.airspace.no_fly_zones import NoFlyZones
from gcs.core.airspace.obstacle_map import LowFlight
from gcs.core.replanning.inputs import PlanningInputs
from gcs.core.replanning.mission_inputs import mission_inputs, terrain_of
from gcs.core.replanning.plan_targets import PlanTargets, vehicle_options
from gcs.core.replanning.planned_flights import AltitudeLayers, begin_m
from gcs.core.replanning.replanning_state import ReplanningState
from gcs.core.state import Agent
from gcs.core.tasking.upload_latency import DELIVERY_S
from gcs.mavlink.mission.upload_limits import UploadLimits
from gcs.model import NS_PER_S, Label, VehicleState
from gcs.planning.forward_simulation import Motion, predict_motion
from gcs.planning.planner_inputs import AgentState, MissionInputs

_LOW_M: Final = 10.0
"""Height below the lowest layer from which a vehicle counts as below the layers."""
_CLIMB_SLOPE: Final = 0.1
"""Slope at which a vehicle below the layers climbs at least."""
_CLIMB_LAG_S: Final = 1.5
"""Half the time constant with which autopilots change the vertical speed (TECS)."""
_MAX_CLIMB_S: Final = 4.0
"""Time for which a vehicle climbs or descends on at most, until it flies by a new route."""
_MAX_CLIMB_M_S: Final = 10.0
"""Vertical speed of which no more counts: reports are not checked for it."""


def begin_height_msl_m(state: VehicleState, delivery_s: float) -> float:
    """Return the height above sea level at which a vehicle in flight begins a route that it gets later.

    It climbs or descends on until then, and autopilots change the vertical speed with a lag. A long climb may
    end before, so no more than a few seconds of it count.
    """
    climb_m_s = min(max(state.climb_m_s, -_MAX_CLIMB_M_S), _MAX_CLIMB_M_S)
    return state.alt_msl_m + climb_m_s * min(delivery_s + _CLIMB_LAG_S, _MAX_CLIMB_S)


class RouteStarts:
    """Makes the planner's inputs from the picture of a mission.

    Attributes
    ----------
    mission : MissionInputs
        What does not change during the mission.
    plan_targets : PlanTargets
    layers : AltitudeLayers
    """

    def __init__(
        self, config: Config, zones: NoFlyZones, agents: Mapping[int, Agent], state: ReplanningState
    ) -> None:
        self._config = config
        self._zones = zones
        self._agents = agents
        self.mission = mission_inputs(config, zones.obstacles)
        self.plan_targets = PlanTargets(config)
        self.layers = AltitudeLayers(config, self.mission, agents, state)
        self._turn_lags_s = {v: one.turn_lag_s for v, one in vehicle_options(config).items()}
        self._radii_m = {v: one.still_air_radius_m for v, one in config.airframes_of_agents.items()}
        self._lag_s = min(self._turn_lags_s.values())
        self._ahead_s = DELIVERY_S + 0.5 * self._lag_s

    def mission_inputs(
        self,
        vehicles: Iterable[int],
        labels: Iterable[Label],
        flown: Mapping[int, Label],
        inputs: PlanningInputs,
        *,
        fixed: bool = False,
    ) -> MissionInputs:
        """Return the planner's inputs for some agents and targets; `fixed`: agents keep those in `flown`."""
        agents = {vehicle: self._start(vehicle, inputs) for vehicle in vehicles}
        targets = {label: inputs.targets[label] for label in labels}
        counts = Counter(flown.values())
        demands = {
            label: self.plan_targets.demand(
                label, track, inputs.at_targets.get(label, 0), inputs.priorities.get(label)
            )
            for label, track in targets.items()
        }
        pinned = flown if fixed else {vehicle: self._agents[vehicle].orders.pinned for vehicle in agents}
        agents = {vehicle: replace(agent, pinned=pinned.get(vehicle)) for vehicle, agent in agents.items()}
        if fixed:
            demands = {label: replace(one, agents=counts[label]) for label, one in demands.items()}
        ahead_s = (inputs.t_ns - inputs.picture_t_ns) / NS_PER_S + self._ahead_s  # begin of the routes
        return replace(
            self.mission,
            grid=self._zones.obstacles.below_layers(self._low_flights(agents, inputs)),
            agents=agents,
            targets={label: self.plan_targets.position(track, ahead_s) for label, track in targets.items()},
            preferred_layers={vehicle: self.layers.of(vehicle) for vehicle in agents},
            begins_m={vehicle: begin_m(vehicle, inputs) for vehicle in agents},
            flown_to=flown,
            demands=demands,
            terrain=terrain_of(self._config, self._zones.obstacles),
        )

    def _low_flights(self, vehicles: Iterable[int], inputs: PlanningInputs) -> Iterator[LowFlight]:
        """Yield the climbs of vehicles that are below the layers in flight."""
        layers = self._zones.obstacles.layers
        for vehicle in vehicles:
            state = self._agents[vehicle].perception.motion.state
            if state is None or vehicle in inputs.climbs or vehicle in inputs.grounded:
                continue
            height_m = state.alt_msl_m - layers.ground_msl_m
            if height_m < layers.lowest_m - _LOW_M:
                yield LowFlight((state.east_m, state.north_m), 0.0, height_m, _CLIMB_SLOPE)

    def _start(self, vehicle: int, inputs: PlanningInputs) -> AgentState:
        """Return where and how an agent begins a route that is planned now."""
        lag_s = self._turn_lags_s[vehicle]
        turns = self._expected(vehicle, inputs, 0.5 * lag_s)
        takes_up = self._expected(vehicle, inputs, 0.0)
        late_s = inputs.late_s.get(vehicle, 0.0) + 0.5 * (lag_s - self._lag_s)
        if vehicle in inputs.climbs:
            late_s += inputs.climbs[vehicle].duration_s
        home_m, range_m = inputs.ranges.get(vehicle, ((0.0, 0.0), math.inf))
        east_m, north_m = turns.place_m
        return replace(
            self.mission.agents[vehicle],
            east_m=east_m,
            north_m=north_m,
            course_rad=turns.course_rad,
            start_delay_s=late_s,
            motion=takes_up,
            height_msl_m=self._begin_height_msl_m(vehicle, inputs),
            wind_m_s=self.layers.wind_m_s(vehicle) or (0.0, 0.0),
            climbs_first=vehicle in inputs.climbing_first and vehicle not in inputs.climbs,
            is_grounded=vehicle in inputs.grounded,
            is_unfit=vehicle in inputs.unfit,
            is_doubtful=vehicle in inputs.doubtful,
            home_m=home_m,
            range_m=range_m,
        )

    def _begin_height_msl_m(self, vehicle: int, inputs: PlanningInputs) -> float:
        """Return the height at which an agent begins a route that is planned now."""
        state = self._agents[vehicle].perception.motion.state
        if state is None or vehicle in inputs.climbs or vehicle in inputs.grounded:
            return inputs.heights_msl_m.get(vehicle, self.mission.agents[vehicle].height_msl_m)
        return begin_height_msl_m(state, self.delivery_s(vehicle, inputs))

    def _expected(self, vehicle: int, inputs: PlanningInputs, more_s: float) -> Motion:
        """Return an agent's motion `more_s` after it got a route that is planned now, or after its climb."""
        lag_s = self._turn_lags_s[vehicle]
        motion = inputs.motion(vehicle)
        if vehicle in inputs.climbs:
            return predict_motion(self._zones.grid, motion, more_s, lag_s)
        ahead_s = self.delivery_s(vehicle, inputs) + more_s
        wind_m_s = self.layers.wind_m_s(vehicle)
        return predict_motion(self._zones.grid, motion, ahead_s, lag_s, wind_m_s, self._radii_m[vehicle])

    def delivery_s(self, vehicle: int, inputs: PlanningInputs) -> float:
        """Return the time until an agent in flight gets a route that is planned now."""
        ahead = inputs.motion(vehicle).ahead
        late_s = inputs.late_s.get(vehicle, 0.0)
        until_hold_s = max(0.0, ahead.next_s - UploadLimits().guard_s)
        return DELIVERY_S + ahead.wait_s + min(late_s, until_hold_s)
