"""Tracks, pictures, reports and missions to stage a scene with: short to write, plain to read."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from gcs.config import Config, parse
from gcs.core.airspace.airspace_state import AirspaceState
from gcs.core.airspace.no_fly_zones import NoFlyZones
from gcs.core.airspace.obstacle_map import ObstacleMap, mission_map
from gcs.core.engine import Engine
from gcs.core.perception.perception_state import ConfirmationState
from gcs.core.perception.track_lifecycle import TrackConfirmation
from gcs.model import (
    NS_PER_S,
    Kind,
    Label,
    LayerHeights,
    Picture,
    Scan,
    Sensor,
    Suspension,
    Track,
    VehicleState,
    read_only,
)
from gcs.planning.map.grid import Grid

S = NS_PER_S
T0 = 1_767_225_600 * S
Place = tuple[float, float]


def at(t_s: float) -> int:
    return T0 + round(t_s * S)


def track(
    label: Label,
    place: Place,
    velocity: Place = (0.0, 0.0),
    *,
    existence: float = 1.0,
    estimated: bool = True,
    std_m: float = 3.0,
) -> Track:
    cov = np.diag([std_m**2, std_m**2, 4.0, 4.0])
    return Track(label, read_only([*place, *velocity]), read_only(cov), existence, estimated)


_seconds = itertools.count()


def picture(*tracks: Track, t_s: float | None = None, kind: Kind = "agents") -> Picture:
    """A picture of these tracks; by default one second later than the one before."""
    t_s = float(next(_seconds)) if t_s is None else t_s
    ordered = tuple(sorted(tracks, key=lambda one: one.label))
    return Picture(at(t_s), at(t_s), kind, ordered, read_only([1.0]))


def confirmation_of(lost_existence: float = 0.01) -> TrackConfirmation:
    """Return a confirmation before its first picture."""
    return TrackConfirmation(lost_existence, ConfirmationState())


def confirmed(*tracks: Track, lost_existence: float = 0.01) -> TrackConfirmation:
    """Return a confirmation of exactly these tracks."""
    confirmation = confirmation_of(lost_existence)
    for _ in range(3):
        confirmation.update(picture(*tracks))
    assert set(confirmation.tracks) == {one.label for one in tracks}
    return confirmation


def state(
    vehicle: int, place: Place, t_s: float = 0.0, *, speed_m_s: float = 0.0, course_rad: float = 0.0
) -> VehicleState:
    return VehicleState(vehicle, at(t_s), *place, 170.0, speed_m_s, course_rad, "AUTO", True, 1)


PAPER = {"when": "period", "aim": "position"}


def mission(
    agents: Sequence[Place] = ((100.0, 200.0), (100.0, 800.0)),
    births: Sequence[Place] = ((1500.0, 200.0), (1500.0, 800.0)),
    tables: str = "",
) -> Config:
    """A mission of 2 km x 2 km: agents 1, 2, ... start at the places given, targets may appear at theirs.

    Unless the tables say otherwise it is planned as in the paper: every five seconds, to where targets are.
    """
    text = 'name = "staged"\n[frame]\nlat_deg = 33.2\nlon_deg = -87.6\nalt_msl_m = 70.0\n'
    for number, (east_m, north_m) in enumerate(agents, start=1):
        text += f"[[agents]]\nsystem_id = {number}\neast_m = {east_m}\nnorth_m = {north_m}\n"
    for east_m, north_m in births:
        text += f"[[births]]\neast_m = {east_m}\nnorth_m = {north_m}\n"
    config = parse(text + tables, "staged.toml")
    paper = {key: value for key, value in PAPER.items() if f"{key} =" not in tables}
    return replace(config, planning=replace(config.planning, **paper))


def zones(config: Config) -> NoFlyZones:
    """Return the map of a mission, without closed zones."""
    return NoFlyZones(AirspaceState(), mission_map(config, 0))


def zones_on(grid: Grid) -> NoFlyZones:
    """Return a map of cells that are blocked at all heights, without closed zones."""
    return NoFlyZones(AirspaceState(), ObstacleMap(grid, (), LayerHeights(100.0, 180.0, 70.0, 20.0)))


def suspensions(engine: Engine) -> dict[int, Suspension]:
    """Return the suspended vehicles, with the reason."""
    found = {vehicle: agent.control.suspension for vehicle, agent in engine.state.agents.items()}
    return {vehicle: reason for vehicle, reason in found.items() if reason is not None}


RADAR = Sensor("radar", 0.98, 4e-6, read_only(np.eye(2) * 10.0), (-100.0, -100.0, 2100.0, 2100.0))


def scan(t_s: float, *places: Place, sensor: Sensor = RADAR, arrives_s: float | None = None) -> Scan:
    arrival = at(t_s if arrives_s is None else arrives_s)
    return Scan(arrival, at(t_s), sensor, read_only(np.reshape(places, (-1, 2))))


def circle(centre: Place, radius_m: float, speed_m_s: float, t_s: float) -> tuple[Place, float]:
    """Place and course of a vehicle that circles clockwise."""
    angle = speed_m_s / radius_m * t_s
    place = (centre[0] + radius_m * math.sin(angle), centre[1] + radius_m * math.cos(angle))
    return place, angle + math.pi / 2.0
