"""Messages for Foxglove from the records of a run: positions, map, 3-D scene and log.

| topic | schema | content |
|---|---|---|
| `/vehicle/N/fix` | LocationFix | reported position |
| `/tf` | FrameTransform | frame `vehicle-N` in the frame `map` |
| `/map/areas`, `/map/routes`, `/map/targets` | GeoJSON | fence and no-fly zones, present routes, targets |
| `/scene/areas`, `/scene/routes`, `/scene/targets` | SceneUpdate | the same in 3-D, with names |
| `/notices` | Log | notices for the operator |
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import Any, Final, NamedTuple

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.geo import LocalFrame
from gcs.mavlink.fleet.checks.position_checks import position_problem
from gcs.mavlink.frames.codec import Frame
from gcs.model import AgentRecord, Label, Notice, Picture, Plan, Route, target_name, vehicle_name
from gcs.report.export.features import feature, line, target_features
from gcs.report.export.foxglove_records import (
    MAP_FRAME,
    Color,
    FrameTransform,
    GeoJSON,
    LinePrimitive,
    LocationFix,
    Log,
    Pose,
    Quaternion,
    SceneEntity,
    SceneEntityDeletion,
    SceneUpdate,
    SpherePrimitive,
    TextPrimitive,
    Time,
    Vector3,
)
from gcs.report.export.mission_frame import MissionFrame, Place, PlannedRoute
from gcs.report.export.target_ellipse import TargetEstimate, target_estimate

SCHEMAS: Final = (LocationFix, FrameTransform, GeoJSON, SceneUpdate, Log)
_LEVELS: Final = {"info": 2, "warning": 3, "alarm": 4}
_ROUTE: Final = Color(0.8, 0.47, 0.65, 1.0)
_TARGET: Final = Color(0.84, 0.37, 0.0, 0.5)
_AREA: Final = {True: Color(0.0, 0.62, 0.45, 1.0), False: Color(0.84, 0.1, 0.11, 1.0)}
"""Colour of inclusion and exclusion areas."""
_MAX_DISTANCE_M: Final = 200_000.0
_UNKNOWN_COURSE: Final = 65535
_LINE_STRIP: Final = 0
_LINE_LOOP: Final = 1
_FLAT_M: Final = 2.0
"""Height of a target's ellipsoid."""


class Outline(NamedTuple):
    """Area of the fence, or no-fly zone."""

    stay_in: bool
    corners_m: Sequence[tuple[float, float]]
    """East and north, in order."""
    heights: str = ""
    """Floor and ceiling in words; empty: from the ground to the sky."""

    @property
    def name(self) -> str:
        """Name for a display."""
        kind = "inclusion area" if self.stay_in else "exclusion area or no-fly zone"
        return f"{kind}, {self.heights}" if self.heights else kind


class Message(NamedTuple):
    """Message of a topic."""

    topic: str
    t_ns: int
    value: LocationFix | FrameTransform | GeoJSON | SceneUpdate | Log


class FoxgloveMessages:
    """Turns the records of a run into messages, one after another.

    Parameters
    ----------
    mission : MissionFrame, optional
        Frame of the mission; without one there are positions only, in a frame at the first of them.
    """

    def __init__(self, mission: MissionFrame | None = None) -> None:
        self._mission = mission
        self._origin: LocalFrame | None = None if mission is None else mission.local
        self._routes: dict[int, PlannedRoute] = {}
        self._shown: set[Label] = set()
        self._areas = 0
        """Number of areas that are shown."""

    def areas(self, t_ns: int, areas: Sequence[Outline]) -> Iterator[Message]:
        """Yield all areas: fence and no-fly zones."""
        mission = self._mission
        gone = range(len(areas), self._areas)
        self._areas = len(areas)
        if mission is None or not (areas or gone):
            return
        rings = [
            [Place(*mission.local.to_geodetic(*point), 0.0) for point in area.corners_m] for area in areas
        ]
        yield _features(
            "/map/areas",
            t_ns,
            (
                feature("area", area.name, line([*ring, ring[0]]))
                for area, ring in zip(areas, rings, strict=True)
            ),
        )
        entities = [
            SceneEntity(
                Time.of(t_ns),
                _area_id(number),
                lines=(
                    LinePrimitive(
                        _LINE_LOOP,
                        tuple(Vector3(east_m, north_m, 0.0) for east_m, north_m in area.corners_m),
                        _AREA[area.stay_in],
                    ),
                ),
            )
            for number, area in enumerate(areas)
        ]
        deletions = [SceneEntityDeletion(Time.of(t_ns), _area_id(number)) for number in gone]
        yield Message("/scene/areas", t_ns, SceneUpdate(tuple(deletions), tuple(entities)))

    def frame(self, t_ns: int, frame: Frame) -> Iterator[Message]:
        """Yield the position of a GLOBAL_POSITION_INT; nothing for other frames and impossible positions."""
        if frame.message_id != dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT:
            return
        report = frame.message()
        if report is None:
            return
        lat_deg = report.lat * 1e-7
        lon_deg = report.lon * 1e-7
        alt_msl_m = report.alt * 1e-3
        origin = self._origin or LocalFrame(lat_deg, lon_deg, alt_msl_m)
        if position_problem(lat_deg, lon_deg, alt_msl_m, origin, _MAX_DISTANCE_M):
            return
        self._origin = origin
        course_deg = 90.0 if report.hdg == _UNKNOWN_COURSE else report.hdg * 0.01
        place = Place(lat_deg, lon_deg, alt_msl_m)
        yield from _position(t_ns, frame.system_id, place, origin, math.radians(course_deg))

    def agent(self, t_ns: int, agent: AgentRecord) -> Iterator[Message]:
        """Yield the reported position of an agent; nothing before its first one."""
        mission = self._mission
        if mission is None or agent.position_m is None or agent.alt_msl_m is None:
            return
        place = Place(*mission.local.to_geodetic(*agent.position_m), agent.alt_msl_m)
        course_rad = 0.5 * math.pi if agent.course_rad is None else agent.course_rad
        yield from _position(t_ns, agent.vehicle, place, mission.local, course_rad)

    def effect(self, t_ns: int, value: object) -> Iterator[Message]:
        """Yield the messages of an effect of the engine; nothing for those without one."""
        match value:
            case Plan():
                yield from self.routes(t_ns, value.routes, value.changed)
            case Picture(kind="targets"):
                yield from self._targets(t_ns, value)
            case Notice():
                level = _LEVELS[value.level]
                name = "swarm" if value.vehicle is None else f"vehicle {vehicle_name(value.vehicle)}"
                yield Message("/notices", t_ns, Log(Time.of(t_ns), level, value.line, name))

    def routes(self, t_ns: int, routes: Iterable[Route], changed: Collection[int]) -> Iterator[Message]:
        """Yield the present routes, if one is gone or changed.

        Parameters
        ----------
        changed : collection of int
            Vehicles with another route than before.
        """
        mission = self._mission
        if mission is None:
            return
        present = {route.vehicle: route for route in routes}
        gone = self._routes.keys() - present.keys()
        new = [present[vehicle] for vehicle in changed if vehicle in present]
        if not gone and not new:
            return
        self._routes = {vehicle: one for vehicle, one in self._routes.items() if vehicle in present}
        self._routes |= {route.vehicle: mission.route(route, t_ns) for route in new}
        shown = self._routes.values()
        yield _features("/map/routes", t_ns, (feature("route", r.name, line(r.places)) for r in shown))
        deletions = [SceneEntityDeletion(Time.of(t_ns), _route_id(vehicle)) for vehicle in sorted(gone)]
        entities = [self._route_entity(t_ns, route, mission.local) for route in new]
        yield Message("/scene/routes", t_ns, SceneUpdate(tuple(deletions), tuple(entities)))

    def _route_entity(self, t_ns: int, route: Route, frame: LocalFrame) -> SceneEntity:
        places = self._routes[route.vehicle].places
        points = [
            Vector3(east_m, north_m, place.alt_msl_m - frame.alt_msl_m)
            for (east_m, north_m), place in zip(route.flown_m.tolist(), places, strict=True)
        ]
        return SceneEntity(
            Time.of(t_ns),
            _route_id(route.vehicle),
            lines=(LinePrimitive(_LINE_STRIP, tuple(points), _ROUTE),),
            texts=(TextPrimitive(Pose(points[0]), vehicle_name(route.vehicle), _ROUTE),),
        )

    def _targets(self, t_ns: int, picture: Picture) -> Iterator[Message]:
        mission = self._mission
        if mission is None:
            return
        found = [
            target_estimate(mission, picture.scan_t_ns, track) for track in picture.tracks if track.estimated
        ]
        features = (one for target in found for one in target_features(target))
        yield _features("/map/targets", t_ns, features)
        labels = {target.label for target in found}
        gone = sorted(self._shown - labels)
        self._shown = labels
        deletions = [SceneEntityDeletion(Time.of(t_ns), target_name(label)) for label in gone]
        entities = [_target_entity(t_ns, target, mission.to_local) for target in found]
        yield Message("/scene/targets", t_ns, SceneUpdate(tuple(deletions), tuple(entities)))


def _position(
    t_ns: int, vehicle: int, place: Place, origin: LocalFrame, course_rad: float
) -> Iterator[Message]:
    time = Time.of(t_ns)
    name = vehicle_name(vehicle)
    frame_id = f"vehicle-{name}"
    lat_deg, lon_deg, alt_msl_m = place
    moved = Vector3(*origin.to_local(lat_deg, lon_deg), alt_msl_m - origin.alt_msl_m)
    rotation = Quaternion.about_up(0.5 * math.pi - course_rad)
    yield Message(f"/vehicle/{name}/fix", t_ns, LocationFix(time, frame_id, lat_deg, lon_deg, alt_msl_m))
    yield Message("/tf", t_ns, FrameTransform(time, MAP_FRAME, frame_id, moved, rotation))


def _target_entity(
    t_ns: int, target: TargetEstimate, to_local: Callable[[Place], tuple[float, float, float]]
) -> SceneEntity:
    centre = Vector3(*to_local(target.place))
    pose = Pose(centre, Quaternion.about_up(math.radians(90.0 - target.azimuth_deg)))
    larger_m, smaller_m = target.semi_axes_m
    name = target_name(target.label)
    return SceneEntity(
        Time.of(t_ns),
        name,
        spheres=(SpherePrimitive(pose, Vector3(2.0 * larger_m, 2.0 * smaller_m, _FLAT_M), _TARGET),),
        texts=(TextPrimitive(Pose(centre), name, _TARGET),),
    )


def _features(topic: str, t_ns: int, features: Iterable[dict[str, Any]]) -> Message:
    collection = {"type": "FeatureCollection", "features": list(features)}
    return Message(topic, t_ns, GeoJSON(msgspec.json.encode(collection).decode()))


def _area_id(number: int) -> str:
    return f"area {number}"


def _route_id(vehicle: int) -> str:
    return f"route {vehicle_name(vehicle)}"
