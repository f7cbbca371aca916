"""Map of a run: flown paths, planned routes, targets with uncertainty, and losses.

Positions are latitude and longitude in degrees on WGS84, and metres above mean sea level. Targets are on the
ground: that of the elevation model, or level ground at the height of the mission's origin.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import Final, NamedTuple

import numpy as np

from gcs.config import Config
from gcs.core.tasking.mission_builder import route_heights_msl_m
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    IntArray,
    Label,
    Picture,
    Plan,
    Route,
    Track,
    target_name,
    vehicle_name,
)
from gcs.model.names import is_place
from gcs.report.telemetry.flights import Reports

CHI2_95: Final = -2.0 * math.log(0.05)
"""95 % quantile of chi-square with two degrees of freedom."""
_OUTLINE_POINTS: Final = 36
_GAP_NS: Final = 10 * NS_PER_S
"""Time between two reports above which the path between them is not known."""


class Place(NamedTuple):
    """Position on a map."""

    lat_deg: float
    lon_deg: float
    alt_msl_m: float


@dataclass(frozen=True, slots=True)
class FlownPath:
    """Reported positions of one vehicle."""

    vehicle: int
    t_ns: IntArray
    """(n,)."""
    places: tuple[Place, ...]

    @property
    def name(self) -> str:
        """Name for a display."""
        return f"vehicle {vehicle_name(self.vehicle)}"

    def place_at(self, t_ns: int) -> Place | None:
        """Return the last reported position at a time; None before the first one."""
        count = int(np.searchsorted(self.t_ns, t_ns, side="right"))
        return self.places[count - 1] if count else None

    def pieces(self) -> list[range]:
        """Return the reports between gaps of telemetry; a piece has at least one report."""
        ends = [*(np.flatnonzero(np.diff(self.t_ns) > _GAP_NS) + 1).tolist(), len(self.t_ns)]
        return [range(first, end) for first, end in zip([0, *ends], ends, strict=False) if end > first]


@dataclass(frozen=True, slots=True)
class PlannedRoute:
    """Route that a plan gave to a vehicle."""

    vehicle: int
    target: Label
    t_ns: int
    places: tuple[Place, ...]
    """From the vehicle's position at that time, if it is known, to the end."""
    replaced_t_ns: int | None = None
    """Time of the plan that gave the vehicle another route, or none; None: it was the last one."""

    @property
    def name(self) -> str:
        """Name for a display."""
        aim = target_name(self.target)
        aim = aim if is_place(self.target) else f"target {aim}"
        return f"route of vehicle {vehicle_name(self.vehicle)} to {aim}"


@dataclass(frozen=True, slots=True)
class TargetEstimate:
    """Last estimate of a target."""

    label: Label
    t_ns: int
    place: Place
    existence: float
    semi_axes_m: tuple[float, float]
    """Larger and smaller semi-axis of the ellipse that has the target with a probability of 95 %."""
    azimuth_deg: float
    """Direction of the larger semi-axis, clockwise from north, in [0, 180)."""
    outline: tuple[Place, ...]
    """Vertices of the ellipse, anticlockwise, the first one repeated."""

    @property
    def name(self) -> str:
        """Name for a display."""
        return f"target {target_name(self.label)}"

    @property
    def uncertainty(self) -> str:
        """Uncertainty in words."""
        larger_m, smaller_m = self.semi_axes_m
        return f"95 % ellipse {larger_m:.0f} m by {smaller_m:.0f} m towards {self.azimuth_deg:.0f} degrees"


@dataclass(frozen=True, slots=True)
class Loss:
    """Vehicle that was lost, or down, to the end of the run."""

    vehicle: int
    status: str
    """"lost" or "down"."""
    t_ns: int
    place: Place

    @property
    def name(self) -> str:
        """Name for a display."""
        return f"vehicle {vehicle_name(self.vehicle)} {self.status}"


@dataclass(frozen=True, slots=True)
class RunMap:
    """What a map shows of a run."""

    name: str
    paths: tuple[FlownPath, ...]
    routes: tuple[PlannedRoute, ...] = ()
    targets: tuple[TargetEstimate, ...] = ()
    losses: tuple[Loss, ...] = ()

    @property
    def is_empty(self) -> bool:
        """True if there is nothing to show."""
        return not (self.paths or self.routes or self.targets or self.losses)


class RunMapBuilder:
    """Collects plans, target tracks and agent statuses of a run.

    Parameters
    ----------
    config : Config
        Mission of the run: frame, altitude layers and elevation of the ground.
    """

    def __init__(self, config: Config) -> None:
        self.ground = Ground(config)
        self._config = config
        self._routes: list[PlannedRoute] = []
        self._tasked: dict[int, int] = {}
        """Index of the present route of each vehicle."""
        self._tracks: dict[Label, tuple[int, Track]] = {}
        """Time of the scan and track of the last estimate of each target."""
        self._planned: set[Label] = set()
        """Targets that plans knew."""
        self._shown: frozenset[Label] = frozenset()
        """Targets of the last picture's estimate."""
        self._statuses: dict[int, AgentStatus] = {}

    def add(self, value: object) -> None:
        """Add an effect of the engine; other values are ignored."""
        match value:
            case Plan():
                self._add_plan(value)
            case Picture(kind="targets"):
                shown = {track.label: track for track in value.tracks if track.estimated}
                self._shown = frozenset(shown)
                self._tracks |= {label: (value.scan_t_ns, track) for label, track in shown.items()}
            case AgentStatus():
                self._statuses[value.vehicle] = value

    def _add_plan(self, plan: Plan) -> None:
        routes = {route.vehicle: route for route in plan.routes}
        self._planned.update(plan.unassigned_targets, (route.target for route in plan.routes))
        for vehicle in {*plan.changed, *(self._tasked.keys() - routes.keys())}:
            if (index := self._tasked.pop(vehicle, None)) is not None:
                self._routes[index] = replace(self._routes[index], replaced_t_ns=plan.t_ns)
        for vehicle in plan.changed:
            if vehicle in routes:
                self._tasked[vehicle] = len(self._routes)
                self._routes.append(planned_route(self._config, routes[vehicle], plan.t_ns))

    def build(self, name: str, reports: Mapping[int, Reports]) -> RunMap:
        """Return the map of the values so far, and of the reported positions of vehicles."""
        labels = sorted(label for label in self._tracks if label in self._planned or label in self._shown)
        paths = flown_paths(reports)
        flown = {path.vehicle: path for path in paths}
        return RunMap(
            name,
            paths,
            tuple(_from_vehicle(route, flown.get(route.vehicle)) for route in self._routes),
            tuple(self.ground.target(*self._tracks[label]) for label in labels),
            tuple(self._losses(flown)),
        )

    def _losses(self, paths: Mapping[int, FlownPath]) -> list[Loss]:
        found = []
        for vehicle, change in sorted(self._statuses.items()):
            if change.status in ("lost", "down"):
                place = self._last_place(change, paths.get(vehicle))
                if place is not None:
                    found.append(Loss(vehicle, change.status, change.t_ns, place))
        return found

    def _last_place(self, change: AgentStatus, path: FlownPath | None) -> Place | None:
        """Return where a vehicle was lost: the position of its status, the height of its last report."""
        reported = None if path is None else path.place_at(change.t_ns)
        if change.position_m is None:
            return reported
        place = self.ground.place(*change.position_m)
        return place if reported is None else place._replace(alt_msl_m=reported.alt_msl_m)


class Ground:
    """Positions on the ground of a mission."""

    def __init__(self, config: Config) -> None:
        self._frame = config.local_frame
        self._elevation = config.elevation

    def place(self, east_m: float, north_m: float) -> Place:
        """Return the position on the ground at a point of the local frame."""
        height_m = math.nan if self._elevation is None else self._elevation.height_msl_m(east_m, north_m)
        known_m = self._frame.alt_msl_m if math.isnan(height_m) else height_m
        return Place(*self._frame.to_geodetic(east_m, north_m), known_m)

    def to_local(self, place: Place) -> tuple[float, float, float]:
        """Return a position east, north and above the origin, in metres."""
        east_m, north_m = self._frame.to_local(place.lat_deg, place.lon_deg)
        return east_m, north_m, place.alt_msl_m - self._frame.alt_msl_m

    def target(self, t_ns: int, track: Track) -> TargetEstimate:
        """Return a track of a target with its ellipse."""
        centre_m = track.mean[:2]
        variances, axes = np.linalg.eigh(track.cov[:2, :2])
        semi_m = np.sqrt(CHI2_95 * np.maximum(variances, 0.0))
        east, north = axes[:, 1].tolist()
        turns = np.linspace(0.0, math.tau, _OUTLINE_POINTS + 1)
        handed = 1.0 if np.linalg.det(axes) < 0.0 else -1.0
        outline_m = (
            centre_m
            + np.outer(np.cos(turns), semi_m[1] * axes[:, 1])
            + np.outer(handed * np.sin(turns), semi_m[0] * axes[:, 0])
        )
        outline = [self.place(*point) for point in outline_m[:-1].tolist()]
        return TargetEstimate(
            track.label,
            t_ns,
            self.place(*centre_m.tolist()),
            track.existence,
            (float(semi_m[1]), float(semi_m[0])),
            math.degrees(math.atan2(east, north)) % 180.0,
            (*outline, outline[0]),
        )


def planned_route(config: Config, route: Route, t_ns: int) -> PlannedRoute:
    """Return a route with its heights, from its first point on."""
    heights_m = route_heights_msl_m(route, config.frame.alt_msl_m, config.mission)
    places = tuple(
        Place(*config.local_frame.to_geodetic(east_m, north_m), height_m)
        for (east_m, north_m), height_m in zip(route.flown_m.tolist(), heights_m.tolist(), strict=True)
    )
    return PlannedRoute(route.vehicle, route.target, t_ns, places)


def flown_paths(reports: Mapping[int, Reports]) -> tuple[FlownPath, ...]:
    """Return the flown paths of reported positions."""
    return tuple(
        FlownPath(vehicle, report.t_ns, tuple(Place(*place) for place in report.places.tolist()))
        for vehicle, report in reports.items()
        if len(report.t_ns)
    )


def utc_text(t_ns: int) -> str:
    """Return a time since the Unix epoch as RFC 3339 text, in milliseconds."""
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=t_ns // 1000)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _from_vehicle(route: PlannedRoute, path: FlownPath | None) -> PlannedRoute:
    """Return a route that begins at the position that its vehicle reported when it was planned."""
    start = None if path is None else path.place_at(route.t_ns)
    return route if start is None else replace(route, places=(start, *route.places))
