"""Missions over real terrain on virtual time: heights above ground and distances of the vehicles flown.

Vehicles start in rows along a valley floor and fly to targets that lie in valleys: places whose ground is
lower than the mean around them. One vehicle is lost on the way. After the last arrival the vehicles fly on
in their circles for a minute. Direction of the wind, the vehicle that is lost, and the time of its loss are
drawn from the seed; the places are the same for all seeds.
"""

from __future__ import annotations

import itertools
import math
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from helpers.hills import terrain_table
from scipy import ndimage

from gcs.geo import LocalFrame
from gcs.model import AgentStatus, Effect, Event, FloatArray, Notice, Tick, UploadReport
from gcs.terrain.elevation_file import read_elevation_model
from gcs.terrain.elevation_grid import Elevation
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import parse_scenario

MIN_AGL_M, MAX_AGL_M = 50.0, 120.0
ALLOWED_M = 10.0
"""Distance by which a sample may lie outside the band."""
SEPARATION_M = 60.0
LAYER_STEP_M = 20.0
SAMPLE_TICKS = 4
"""Ticks from one sample to the next: 0.2 s."""
AFTER_END_S = 60.0
_VALLEY_M = 500.0
"""Radius within which the mean ground is higher than that of a valley."""
_DEPTH_M = 20.0
_CIRCLE_M = 150.0
_RELIEF_M = 80.0
"""Most difference of the ground within `_CIRCLE_M` of a target: a circle there fits into the band."""
_APART_M = 350.0
"""Distance of targets from each other."""
_MISSION = """
name = "terrain-{vehicles}"
[frame]
lat_deg = {site.lat_deg}
lon_deg = {site.lon_deg}
alt_msl_m = {site.alt_msl_m}
[map]
width_m = {site.width_m}
height_m = {site.height_m}
nodes_east = {nodes_east}
nodes_north = {nodes_north}
{terrain}
[planning]
shape = "flyable"
clearance_m = 0.0
separation_m = {separation}
[mission]
altitude_rel_m = 70.0
layer_step_m = {layer_step}
layers = 3
loiter_radius_m = 60.0
max_duration_s = {site.max_duration_s}
[takeoff]
heading_deg = {site.course_deg}
[airframe]
speed_m_s = {site.speed_m_s}
bank_deg = 35.0
climb_m_s = 4.0
sink_m_s = 3.0
wind_m_s = {wind}
[simulation]
forward_speed_m_s = {site.speed_m_s}
airframe = "banked"
[simulation.wind]
east_m_s = {wind_east:.3f}
north_m_s = {wind_north:.3f}
[simulation.death]
prescribed = [{{ system_id = {lost}, at_s = {lost_s:.1f} }}]
[simulation.sensor]
clutter_per_scan = 5.0
"""
_AGENT = "[[agents]]\nsystem_id = {}\neast_m = {:.1f}\nnorth_m = {:.1f}\ncourse_deg = {}\n"
_TARGET = "[[{}]]\neast_m = {:.1f}\nnorth_m = {:.1f}\n"


@dataclass(frozen=True)
class Site:
    """Where a mission is flown: its map, and the first of its rows of vehicles."""

    lat_deg: float
    lon_deg: float
    alt_msl_m: float
    width_m: float
    height_m: float
    start_m: tuple[float, float]
    """Westernmost vehicle of the southern row."""
    steps_m: tuple[float, float]
    """Distance of vehicles in a row (east), and of rows (north)."""
    course_deg: float
    speed_m_s: float = 15.0
    max_duration_s: float = 900.0
    per_row: int = 5


DAVOS = Site(46.7985, 9.793, 1548.0, 5100.0, 4300.0, (3100.0, 230.0), (200.0, 180.0), 75.0)


@dataclass(frozen=True)
class Sample:
    """Sample of one vehicle outside the band by more than `ALLOWED_M`."""

    t_s: float
    vehicle: int
    east_m: float
    north_m: float
    agl_m: float


@dataclass(frozen=True)
class NearPair:
    """Interval in which two vehicles were near each other."""

    vehicles: tuple[int, int]
    begin_s: float
    end_s: float
    distance_m: float
    """Least distance in it, and height at that time."""
    height_m: float
    place_m: tuple[float, float]


@dataclass
class Flight:
    """What one flown mission showed."""

    arrived: int = 0
    lost: int = 0
    uploads: int = 0
    failed_uploads: int = 0
    duration_s: float = 0.0
    cpu_s: float = 0.0
    least_agl_m: float = math.inf
    greatest_agl_m: float = -math.inf
    outside: list[Sample] = field(default_factory=list)
    near: list[NearPair] = field(default_factory=list)
    notices: list[tuple[float, str, int | None, str]] = field(default_factory=list)
    """Warnings and alarms: time, code, vehicle, text."""


def mission_text(site: Site, elevation: Elevation, vehicles: int, wind_m_s: float, seed: int) -> str:
    """Return the mission file."""
    rng = np.random.default_rng([seed, vehicles, 28])
    wind_to_rad = rng.uniform(0.0, 2.0 * math.pi)
    text = _MISSION.format(
        site=site,
        vehicles=vehicles,
        nodes_east=round(site.width_m / 50.0) + 1,
        nodes_north=round(site.height_m / 50.0) + 1,
        terrain=terrain_table(elevation, MIN_AGL_M, MAX_AGL_M),
        separation=SEPARATION_M,
        layer_step=LAYER_STEP_M,
        wind=wind_m_s,
        wind_east=wind_m_s * math.sin(wind_to_rad),
        wind_north=wind_m_s * math.cos(wind_to_rad),
        lost=int(rng.integers(1, vehicles + 1)),
        lost_s=rng.uniform(30.0, 90.0),
    )
    for number in range(vehicles):
        row, place = divmod(number, site.per_row)
        east_m = site.start_m[0] + site.steps_m[0] * place
        text += _AGENT.format(number + 1, east_m, site.start_m[1] + site.steps_m[1] * row, site.course_deg)
    for east_m, north_m in valley_places(elevation, site, vehicles):
        text += _TARGET.format("births", east_m, north_m) + _TARGET.format(
            "simulation.targets", east_m, north_m
        )
    return text


def valley_places(elevation: Elevation, site: Site, count: int) -> list[tuple[float, float]]:
    """Return places in valleys, in random order, the same at each call."""
    ground = elevation.heights_msl_m
    spacing_m = elevation.spacing_m
    mean = ndimage.uniform_filter(ground, size=round(2.0 * _VALLEY_M / spacing_m), mode="nearest")
    width = round(2.0 * _CIRCLE_M / spacing_m)
    relief = ndimage.maximum_filter(ground, width) - ndimage.minimum_filter(ground, width)
    rows, cols = np.nonzero((ground < mean - _DEPTH_M) & (relief <= _RELIEF_M))
    places = np.stack((cols, rows), axis=1) * spacing_m + np.array(elevation.origin_m)
    margin_m = 0.6 * _APART_M
    inside = (places >= margin_m) & (places <= np.array([site.width_m, site.height_m]) - margin_m)
    places = places[inside.all(axis=1)]
    found: list[tuple[float, float]] = []
    for place in np.random.default_rng(28).permutation(places):
        if all(math.dist(place, other) >= _APART_M for other in found):
            found.append((float(place[0]), float(place[1])))
        if len(found) == count:
            return found
    raise ValueError(f"the ground has only {len(found)} of {count} valleys {_APART_M:g} m apart")


def read_site(site: Site, path: Path) -> Elevation:
    """Return the elevation of a site from a file."""
    frame = LocalFrame(site.lat_deg, site.lon_deg, site.alt_msl_m)
    return read_elevation_model(path, frame, (site.width_m, site.height_m), "msl").elevation


class FlownMission:
    """One mission flown on virtual time, with the true positions of its vehicles."""

    def __init__(self, site: Site, elevation: Elevation, vehicles: int, wind_m_s: float, seed: int) -> None:
        text = mission_text(site, elevation, vehicles, wind_m_s, seed)
        scenario = parse_scenario(text, f"terrain-{vehicles}")
        self._elevation = elevation
        self.flight = Flight()
        self.times_s: list[float] = []
        self.places: list[list[tuple[float, float, float]]] = []
        """East, north and height above mean sea level of each vehicle; NaN once it is down or lost."""
        self._ticks = 0
        self.run = VirtualRun(scenario, seed, on_event=self._on_event, on_effect=self._on_effect)

    def fly(self) -> Flight:
        """Fly the mission and the circles after it; return what it showed."""
        began_s = time.process_time()
        flight = self.flight
        flight.duration_s = self.run.run()
        self.run.ended = False
        self.run.run(flight.duration_s + AFTER_END_S)
        flight.cpu_s = time.process_time() - began_s
        self.look()
        return flight

    def look(self) -> None:
        """Note samples outside the band and near pairs among the positions flown."""
        self._look_at_heights()
        self._look_at_pairs()

    def _on_event(self, event: Event) -> None:
        if not isinstance(event, Tick):
            return
        self._ticks += 1
        if self._ticks % SAMPLE_TICKS == 0:
            self.times_s.append((event.t_ns - START_T_NS) / 1e9)
            self.places.append(
                [
                    (one.east_m, one.north_m, one.alt_msl_m)
                    if one.alive and not one.is_down
                    else (math.nan, math.nan, math.nan)
                    for one in self.run.vehicles.values()
                ]
            )

    def _on_effect(self, t_ns: int, effect: Effect) -> None:
        flight = self.flight
        if isinstance(effect, UploadReport):
            flight.uploads += 1
            flight.failed_uploads += not effect.ok
        elif isinstance(effect, AgentStatus):
            flight.arrived += effect.status == "arrived"
            flight.lost += effect.status == "lost"
        elif isinstance(effect, Notice) and effect.level != "info":
            t_s = (t_ns - START_T_NS) / 1e9
            flight.notices.append((t_s, effect.code.value, effect.vehicle, effect.text))

    def _look_at_heights(self) -> None:
        flight = self.flight
        at = np.array(self.places)
        for k, vehicle in enumerate(self.run.vehicles.values()):
            agl_m: FloatArray = at[:, k, 2] - self._elevation.heights_at(at[:, k, :2])
            flight.least_agl_m = min(flight.least_agl_m, float(np.nanmin(agl_m)))
            flight.greatest_agl_m = max(flight.greatest_agl_m, float(np.nanmax(agl_m)))
            is_outside = (agl_m < MIN_AGL_M - ALLOWED_M) | (agl_m > MAX_AGL_M + ALLOWED_M)
            for i in np.flatnonzero(is_outside).tolist():
                east_m, north_m, _ = at[i, k].tolist()
                flight.outside.append(
                    Sample(self.times_s[i], vehicle.system_id, east_m, north_m, float(agl_m[i]))
                )

    def _look_at_pairs(self) -> None:
        at = np.array(self.places)
        vehicles = [one.system_id for one in self.run.vehicles.values()]
        for j, k in itertools.combinations(range(len(vehicles)), 2):
            apart_m = np.hypot(*(at[:, j, :2] - at[:, k, :2]).T)
            height_m = np.abs(at[:, j, 2] - at[:, k, 2])
            is_near = (apart_m < SEPARATION_M) & (height_m < 0.5 * LAYER_STEP_M)
            marks = np.flatnonzero(np.diff(np.concatenate(([0], is_near.astype(np.int8), [0])))).tolist()
            for begin, end in zip(marks[::2], marks[1::2], strict=True):
                i = begin + int(np.argmin(apart_m[begin:end]))
                east_m, north_m, _ = at[i, j].tolist()
                self.flight.near.append(
                    NearPair(
                        (vehicles[j], vehicles[k]),
                        self.times_s[begin],
                        self.times_s[end - 1],
                        float(apart_m[i]),
                        float(height_m[i]),
                        (east_m, north_m),
                    )
                )
