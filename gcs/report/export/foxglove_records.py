"""Records with the names and fields of Foxglove's well-known schemas.

Source: https://docs.foxglove.dev/docs/sdk/schemas. Primitives of kinds that are not used have no fields;
their lists stay empty.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from gcs.model import NS_PER_S

MAP_FRAME: Final = "map"
"""Local frame of the mission: x east, y north, z above the origin's height."""


@dataclass(frozen=True, slots=True)
class Time:
    """Time since the Unix epoch, or a duration."""

    sec: int
    nsec: int

    @classmethod
    def of(cls, t_ns: int) -> Time:
        """Return a time in nanoseconds; one before the epoch is the epoch."""
        return cls(*divmod(max(t_ns, 0), NS_PER_S))


@dataclass(frozen=True, slots=True)
class Vector3:
    """Vector in metres."""

    x: float
    y: float
    z: float


@dataclass(frozen=True, slots=True)
class Quaternion:
    """Rotation."""

    x: float
    y: float
    z: float
    w: float

    @classmethod
    def about_up(cls, angle_rad: float) -> Quaternion:
        """Return a rotation about the vertical, anticlockwise."""
        return cls(0.0, 0.0, math.sin(0.5 * angle_rad), math.cos(0.5 * angle_rad))


LEVEL: Final = Quaternion(0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Pose:
    """Position and orientation."""

    position: Vector3
    orientation: Quaternion = LEVEL


@dataclass(frozen=True, slots=True)
class Color:
    """Colour, each part in [0, 1]."""

    r: float
    g: float
    b: float
    a: float


@dataclass(frozen=True, slots=True)
class LocationFix:
    """Reported position of a vehicle; the altitude is above mean sea level."""

    timestamp: Time
    frame_id: str
    latitude: float
    longitude: float
    altitude: float
    position_covariance: tuple[float, ...] = (0.0,) * 9
    position_covariance_type: int = 0
    """0: unknown."""


@dataclass(frozen=True, slots=True)
class FrameTransform:
    """Position and course of a vehicle in the local frame."""

    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector3
    rotation: Quaternion


@dataclass(frozen=True, slots=True)
class Log:
    """Notice for the operator."""

    timestamp: Time
    level: int
    """2 info, 3 warning, 4 error."""
    message: str
    name: str
    file: str = ""
    line: int = 0


@dataclass(frozen=True, slots=True)
class GeoJSON:
    """Features for the map, as text."""

    geojson: str


@dataclass(frozen=True, slots=True)
class KeyValuePair:
    """Key and value."""

    key: str
    value: str


@dataclass(frozen=True, slots=True)
class UnusedPrimitive:
    """Primitive of a kind that is not used."""


@dataclass(frozen=True, slots=True)
class SpherePrimitive:
    """Ellipsoid; `size` is its diameters."""

    pose: Pose
    size: Vector3
    color: Color


@dataclass(frozen=True, slots=True)
class LinePrimitive:
    """Line through points."""

    type: int
    """0: from the first to the last point; 1: closed."""
    points: tuple[Vector3, ...]
    color: Color
    pose: Pose = Pose(Vector3(0.0, 0.0, 0.0))
    thickness: float = 2.0
    scale_invariant: bool = True
    """True: `thickness` is in pixels."""
    colors: tuple[Color, ...] = ()
    indices: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class TextPrimitive:
    """Text that faces the camera."""

    pose: Pose
    text: str
    color: Color
    billboard: bool = True
    font_size: float = 14.0
    scale_invariant: bool = True
    """True: `font_size` is in pixels."""


@dataclass(frozen=True, slots=True)
class SceneEntity:
    """Thing in the 3-D scene; it replaces an earlier one of the same topic and id."""

    timestamp: Time
    id: str
    frame_id: str = MAP_FRAME
    lifetime: Time = Time(0, 0)
    """0: until it is replaced or deleted."""
    frame_locked: bool = True
    metadata: tuple[KeyValuePair, ...] = ()
    arrows: tuple[UnusedPrimitive, ...] = ()
    cubes: tuple[UnusedPrimitive, ...] = ()
    spheres: tuple[SpherePrimitive, ...] = ()
    cylinders: tuple[UnusedPrimitive, ...] = ()
    lines: tuple[LinePrimitive, ...] = ()
    triangles: tuple[UnusedPrimitive, ...] = ()
    texts: tuple[TextPrimitive, ...] = ()
    models: tuple[UnusedPrimitive, ...] = ()


@dataclass(frozen=True, slots=True)
class SceneEntityDeletion:
    """Removal of an entity with this id."""

    timestamp: Time
    id: str
    type: int = 0
    """0: by its id."""


@dataclass(frozen=True, slots=True)
class SceneUpdate:
    """Changes of a topic's entities."""

    deletions: tuple[SceneEntityDeletion, ...]
    entities: tuple[SceneEntity, ...]
