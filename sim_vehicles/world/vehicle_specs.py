"""Types, homes and rates of the simulated vehicles of a scenario, for a seed.

Over terrain a vehicle climbs and sinks no faster than its airframe's rates, by which routes are planned. Over
flat ground it has the rates of the simulated airframe. Beside a hill it is launched higher, so that its first
circle is above the floor of the flight band.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from gcs.config.airframe import NamedAirframeTable
from sim_vehicles.vehicle.faults import Fault, FaultKind
from sim_vehicles.vehicle.vehicle import VehicleSpec
from sim_vehicles.world.scenario import Scenario

_AROUND: Final = 2.0
"""Radius of the ground below a launch, in loiter radii: circles are joined from outside, and wide in wind."""


def vehicle_specs(scenario: Scenario, seed: int) -> list[VehicleSpec]:
    """Return a specification for each agent of the mission file, in order."""
    simulation = scenario.simulation
    elevation = scenario.config.elevation
    origin_msl_m = scenario.frame.alt_msl_m
    shared = scenario.config.airframe
    dies_at_s = {death.system_id: death.at_s for death in simulation.death.prescribed}
    return [
        VehicleSpec(
            system_id=agent.system_id,
            east_m=agent.east_m,
            north_m=agent.north_m,
            course_rad=math.radians(agent.course_deg),
            alt_rel_m=_launch_height_m(scenario, agent.east_m, agent.north_m),
            forward_speed_m_s=agent.speed_m_s or own.speed_m_s or simulation.forward_speed_m_s,
            max_bank_deg=own.bank_deg,
            climb_deg=own.climb_deg,
            climb_m_s=None if elevation is None else own.climb_m_s or shared.climb_m_s,
            sink_m_s=None if elevation is None else own.sink_m_s or shared.sink_m_s,
            home_rel_m=0.0
            if elevation is None
            else elevation.height_msl_m(agent.east_m, agent.north_m) - origin_msl_m,
            airborne=True,
            airframe=simulation.airframe,
            autopilot="px4" if agent.system_id in simulation.px4 else "ardupilot",
            survival_probability=simulation.death.survival_probability,
            death_check_period_s=simulation.death.check_period_s,
            dies_at_s=dies_at_s.get(agent.system_id),
            faults=tuple(
                Fault(FaultKind(fault.kind), fault.at_s, fault.lasts_s)
                for fault in simulation.faults
                if fault.system_id == agent.system_id
            ),
            seed=seed,
            parameters=simulation.parameters,
            gps_noise_std_m=simulation.gps_noise_std_m,
            key_file=str(scenario.config.links.key_file(scenario.source) or ""),
            wind_east_m_s=simulation.wind.east_m_s,
            wind_north_m_s=simulation.wind.north_m_s,
            gust_std_m_s=simulation.wind.gust_std_m_s,
            gust_time_s=simulation.wind.gust_time_s,
        )
        for agent in scenario.config.agents
        for own in (scenario.config.airframes.get(agent.airframe, NamedAirframeTable()),)
    ]


def in_launch_layers(specs: Sequence[VehicleSpec], scenario: Scenario) -> list[VehicleSpec]:
    """Return specifications of vehicles that are launched at once: neighbours circle a layer apart.

    They return a layer apart, too.
    """
    config = scenario.config
    layers = config.mission.layers
    max_m = math.inf if config.terrain is None else config.terrain.max_agl_m
    heights_m = [
        spec.alt_rel_m + number % layers * config.mission.layer_step_m for number, spec in enumerate(specs)
    ]
    return [
        replace(spec, alt_rel_m=max(spec.alt_rel_m, min(height_m, max_m)))
        for spec, height_m in zip(specs, heights_m, strict=True)
    ]


def _launch_height_m(scenario: Scenario, east_m: float, north_m: float) -> float:
    """Return the height above its home at which a vehicle circles before its first mission."""
    config = scenario.config
    height_m = config.mission.altitude_rel_m
    if config.elevation is None or config.terrain is None:
        return height_m
    around_m = np.arange(-1.0, 1.01, 0.1) * _AROUND * config.mission.loiter_radius_m
    places_m = np.stack(np.meshgrid(east_m + around_m, north_m + around_m), axis=-1).reshape(-1, 2)
    places_m = places_m[np.hypot(*(places_m - (east_m, north_m)).T) <= around_m[-1]]
    rise_m = np.nanmax(config.elevation.heights_at(places_m)) - config.elevation.height_msl_m(east_m, north_m)
    return max(height_m, config.terrain.min_agl_m + float(rise_m))
