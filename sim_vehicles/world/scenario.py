"""Simulation part of a mission file: keys and defaults of `[simulation]`, and random generators by seed.

Central command never reads this table, which has the ground truth. Generators are seeded by (seed, purpose),
so that a seed gives the same world in every process and at every speed.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from gcs.config import Config, Table, convert, local_places, parse, read_text
from gcs.config.schema import Box, NotNegative, Positive, Probability, SystemId
from gcs.errors import ConfigError
from gcs.geo import LocalFrame
from gcs.mistake_codes import MistakeCode
from sim_vehicles.autopilots.parameters import Parameters
from sim_vehicles.vehicle.faults import parse_fault


class SensorTable(Table, frozen=True, kw_only=True):
    """One sensor of the world."""

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,32}$")] = "radar"
    kind: Literal["position", "range_bearing"] = "position"
    period_s: Annotated[float, Meta(ge=0.05, le=60.0)] = 1.0
    offset_s: NotNegative = 0.0
    delay_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    detection_probability: Probability = 0.98
    clutter_per_scan: NotNegative = 20.0
    # kind = "position"
    noise_std_m: Positive = 3.16
    field_margin_m: NotNegative = 100.0
    field_m: Box | None = None
    # Place; with a height above the ground, terrain is in its way.
    east_m: float = 0.0
    north_m: float = 0.0
    height_agl_m: NotNegative | None = None
    # kind = "range_bearing"
    range: Literal["ground", "slant"] = "ground"
    range_std_m: Positive = 5.0
    bearing_std_deg: Annotated[float, Meta(gt=0.0, le=30.0)] = 0.5
    least_range_m: NotNegative = 0.0
    most_range_m: Positive = 3000.0
    sector_centre_deg: Annotated[float, Meta(ge=-360.0, le=360.0)] = 0.0
    sector_width_deg: Annotated[float, Meta(gt=0.0, le=360.0)] = 360.0


class PrescribedDeath(Table, frozen=True, kw_only=True):
    """Loss of an agent at a prescribed time."""

    system_id: SystemId
    at_s: NotNegative


class DeathTable(Table, frozen=True, kw_only=True):
    """Losses of agents."""

    survival_probability: Probability = 1.0
    check_period_s: Annotated[float, Meta(ge=0.01)] = 1.0
    prescribed: list[PrescribedDeath] = []


class FaultTable(Table, frozen=True, kw_only=True):
    """One fault of an agent's vehicle."""

    system_id: SystemId
    at_s: NotNegative
    kind: Literal["crash", "engine", "gps", "glitch", "battery", "rc", "airspeed", "fence", "radio"]
    lasts_s: NotNegative = 0.0


class TargetTable(Table, frozen=True, kw_only=True):
    """One target with prescribed motion."""

    east_m: float
    north_m: float
    v_east_m_s: float = 0.0
    v_north_m_s: float = 0.0
    appears_s: NotNegative = 0.0


class GaussianTargets(Table, frozen=True, kw_only=True):
    """Targets with random positions (target i by `births[i]`) and Gaussian velocities.

    A velocity that leads off the map within `inside_for_s` is drawn again.
    """

    speed_std_m_s: NotNegative
    max_speed_m_s: Positive
    appear_by_s: NotNegative = 0.0
    inside_for_s: NotNegative = 240.0


class WindTable(Table, frozen=True, kw_only=True):
    """Wind: a steady part and gusts (`sim_vehicles.vehicle.wind`)."""

    east_m_s: Annotated[float, Meta(ge=-30.0, le=30.0)] = 0.0
    north_m_s: Annotated[float, Meta(ge=-30.0, le=30.0)] = 0.0
    gust_std_m_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    gust_time_s: Annotated[float, Meta(ge=0.1, le=600.0)] = 5.0


class Simulation(Table, frozen=True, kw_only=True):
    """The `[simulation]` table."""

    forward_speed_m_s: Positive
    airframe: Literal["paper", "banked"] = "paper"
    gps_noise_std_m: NotNegative = 1.0
    px4: list[SystemId] = []
    parameters: dict[str, float] = {}
    sensor: SensorTable = SensorTable()
    more_sensors: list[SensorTable] = []
    death: DeathTable = DeathTable()
    faults: list[FaultTable] = []
    wind: WindTable = WindTable()
    targets: list[TargetTable] = []
    gaussian_targets: GaussianTargets | None = None


@dataclass(frozen=True, slots=True)
class Scenario:
    """A mission file with its simulated world."""

    config: Config
    simulation: Simulation
    source: str
    text: str
    """Text of the file, for recordings."""

    @property
    def sensors(self) -> list[SensorTable]:
        """All sensors of the world."""
        return [self.simulation.sensor, *self.simulation.more_sensors]

    @property
    def frame(self) -> LocalFrame:
        """The mission's local frame."""
        return self.config.local_frame


def load(scenario: str) -> Scenario:
    """Read a shipped scenario or a file.

    Raises
    ------
    ConfigError
        Also when the file has no usable `[simulation]` table.
    """
    return parse_scenario(*read_text(scenario))


def parse_scenario(text: str, source: str) -> Scenario:
    """Validate the text of a mission file and its world; raises as `load`."""
    config = parse(text, source)
    if not config.simulation:
        raise ConfigError(
            source,
            "simulation",
            MistakeCode.MISSING_KEY,
            "the table is missing: this file has no world to simulate",
        )
    raw = dict(config.simulation)
    if isinstance(raw.get("targets"), list):
        raw["targets"] = local_places(raw["targets"], config.local_frame, source, "simulation.targets")
    simulation = convert(raw, Simulation, source, "simulation")
    _cross_check(config, simulation, source)
    return Scenario(config, simulation, source, text)


def with_faults(scenario: Scenario, texts: Iterable[str]) -> Scenario:
    """Return a scenario with further faults, each as ``KIND:VEHICLE@SECONDS`` or with ``+DURATION``.

    Raises
    ------
    GcsError
        When a text is wrong, or names a vehicle that the scenario does not have.
    """
    faults = [
        FaultTable(system_id=vehicle, at_s=fault.at_s, kind=fault.kind.value, lasts_s=fault.lasts_s)
        for vehicle, fault in map(parse_fault, texts)
    ]
    simulation = msgspec.structs.replace(scenario.simulation, faults=[*scenario.simulation.faults, *faults])
    _cross_check(scenario.config, simulation, "--faults")
    return replace(scenario, simulation=simulation)


def _cross_check(config: Config, simulation: Simulation, source: str) -> None:
    for index, agent in enumerate(config.agents):
        if agent.network:
            raise ConfigError(
                source,
                f"agents[{index}].network",
                MistakeCode.OUT_OF_RANGE,
                "simulated vehicles are on network 0",
            )
    known = {agent.system_id for agent in config.agents}
    named = {f"death.prescribed[{i}]": death.system_id for i, death in enumerate(simulation.death.prescribed)}
    named |= {f"faults[{i}]": fault.system_id for i, fault in enumerate(simulation.faults)}
    for key, system_id in named.items():
        if system_id not in known:
            raise ConfigError(
                source,
                f"simulation.{key}.system_id",
                MistakeCode.UNKNOWN_NAME,
                f"{system_id} is none of the agents",
            )
    known_names = Parameters(px4=True)
    for name in simulation.parameters:
        if name not in known_names:
            raise ConfigError(
                source,
                f"simulation.parameters.{name}",
                MistakeCode.UNKNOWN_KEY,
                "no simulated vehicle has it",
            )
    _check_sensors(simulation, source)
    width_m = config.map.width_m
    height_m = config.map.height_m
    for index, target in enumerate(simulation.targets):
        if not (0.0 <= target.east_m <= width_m and 0.0 <= target.north_m <= height_m):
            raise ConfigError(
                source,
                f"simulation.targets[{index}]",
                MistakeCode.OUTSIDE_MAP,
                f"({target.east_m}, {target.north_m}) lies outside the map: {width_m} m x {height_m} m",
            )
    if simulation.targets and simulation.gaussian_targets:
        raise ConfigError(
            source,
            "simulation",
            MistakeCode.CONFLICT,
            "expected either `targets` or `gaussian_targets`, not both",
        )
    if simulation.gaussian_targets and not config.births:
        raise ConfigError(
            source,
            "simulation.gaussian_targets",
            MistakeCode.MISSING_KEY,
            "needs `[[births]]` to draw the places from",
        )


def _check_sensors(simulation: Simulation, source: str) -> None:
    tables = {"sensor": simulation.sensor}
    tables |= {f"more_sensors[{i}]": table for i, table in enumerate(simulation.more_sensors)}
    names: set[str] = set()
    for where, table in tables.items():
        key = f"simulation.{where}"
        box = table.field_m
        if table.name in names:
            raise ConfigError(
                source,
                f"{key}.name",
                MistakeCode.DUPLICATE,
                f"`{table.name}` is used twice; each sensor needs its own",
            )
        names.add(table.name)
        if box is not None and not (box[0] < box[2] and box[1] < box[3]):
            raise ConfigError(
                source,
                f"{key}.field_m",
                MistakeCode.BAD_SHAPE,
                "expected [east_min, north_min, east_max, north_max] with min < max",
            )
        if table.range == "slant" and table.height_agl_m is None:
            raise ConfigError(source, f"{key}.range", MistakeCode.MISSING_KEY, '"slant" needs height_agl_m')
        if table.least_range_m >= table.most_range_m:
            raise ConfigError(
                source, f"{key}.most_range_m", MistakeCode.CONFLICT, "expected more than least_range_m"
            )


def generator(seed: int, purpose: str, *index: int) -> np.random.Generator:
    """Return the random generator for one purpose of one seed, independent of all others."""
    return np.random.default_rng([seed, zlib.crc32(purpose.encode()), *index])
