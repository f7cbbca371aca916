"""Map of a run: flown paths, planned routes, targets with uncertainty, and losses.

Positions are latitude and longitude in degrees on WGS84, and metres above mean sea level. Targets are on the
ground: that of the elevation model, or level ground at the height of the mission's origin.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import Final

import numpy as np

from gcs.config import Config
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    IntArray,
    Label,
    Picture,
    Plan,
    Track,
    vehicle_name,
)
from gcs.report.export.mission_frame import MissionFrame, Place, PlannedRoute
from gcs.report.export.target_ellipse import TargetEstimate, target_estimate
from gcs.report.telemetry.flights import Reports

_GAP_NS: Final = 10 * NS_PER_S
"""Time between two reports above which the path between them is not known."""


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
        self._frame = MissionFrame.of(config)
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
                self._routes.append(self._frame.route(routes[vehicle], plan.t_ns))

    def build(self, name: str, reports: Mapping[int, Reports]) -> RunMap:
        """Return the map of the values so far, and of the reported positions of vehicles."""
        labels = sorted(label for label in self._tracks if label in self._planned or label in self._shown)
        paths = flown_paths(reports)
        flown = {path.vehicle: path for path in paths}
        return RunMap(
            name,
            paths,
            tuple(_from_vehicle(route, flown.get(route.vehicle)) for route in self._routes),
            tuple(target_estimate(self._frame, *self._tracks[label]) for label in labels),
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
        place = self._frame.place(*change.position_m)
        return place if reported is None else place._replace(alt_msl_m=reported.alt_msl_m)


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
