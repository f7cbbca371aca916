"""GeoJSON (RFC 7946): no-fly zones and the mission boundary, from WGS84 to the local frame.

Read are features, collections of them, or bare geometries of type

- `Polygon` and `MultiPolygon`, with holes;
- `Point` with a property `radius`: a circle with that radius in metres.

The property `kind` is `"no-fly-zone"` (default) or `"boundary"`, the inclusion area of the mission. There may
be one boundary, and it is not a circle. No-fly zones may have vertical limits: `height_m`, from the ground up
to that height above it, or `floor_m` and `ceiling_m` above their `reference` ("home", "msl" or "ground").
Other properties are ignored. Edges are straight in the local frame.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import msgspec

from gcs.errors import ConfigError
from gcs.geo import LocalFrame, corner_error
from gcs.mistake_codes import MistakeCode
from gcs.model import UNLIMITED, VerticalLimits, vertical_limits

Position: TypeAlias = tuple[float, float]
"""Longitude and latitude in degrees, or east and north in metres."""
Polygon: TypeAlias = tuple[tuple[Position, ...], ...]
"""Outline, then holes."""

_NEAR_DEG = 5.0
"""A feature without a vertex this close to the origin in latitude and longitude belongs to another place."""


@dataclass(frozen=True, slots=True)
class Zone:
    """A no-fly zone: a polygon or a circle, in degrees as read, or in metres of a local frame."""

    polygon: Polygon = ()
    circle: tuple[Position, float] | None = None
    """Centre, and radius in metres."""
    limits: VerticalLimits = UNLIMITED

    @property
    def outline(self) -> tuple[Position, ...]:
        """Outline of the polygon, or the centre of the circle."""
        return (self.circle[0],) if self.circle is not None else self.polygon[0]

    def to_local(self, frame: LocalFrame) -> Zone:
        """Return the zone in metres."""
        if self.circle is None:
            return replace(self, polygon=_local(self.polygon, frame))
        (lon, lat), radius_m = self.circle
        return replace(self, circle=(frame.to_local(lat, lon), radius_m))


@dataclass(frozen=True, slots=True)
class Zones:
    """Zones of a file, in degrees as read, or in metres of a local frame.

    Attributes
    ----------
    no_fly : tuple of Zone
    boundary : tuple
        Polygons of the mission's boundary; empty if there is none.
    """

    no_fly: tuple[Zone, ...] = ()
    boundary: tuple[Polygon, ...] = ()

    def to_local(self, frame: LocalFrame) -> Zones:
        """Return the zones in metres of a local frame, without those of other places."""
        return Zones(
            tuple(zone.to_local(frame) for zone in self.no_fly if _is_near(zone.outline, frame)),
            tuple(_local(polygon, frame) for polygon in self.boundary if _is_near(polygon[0], frame)),
        )


def _local(polygon: Polygon, frame: LocalFrame) -> Polygon:
    return tuple(tuple(frame.to_local(lat, lon) for lon, lat in ring) for ring in polygon)


def _is_near(ring: tuple[Position, ...], frame: LocalFrame) -> bool:
    return any(
        abs(lat - frame.lat_deg) < _NEAR_DEG
        and abs((lon - frame.lon_deg + 180.0) % 360.0 - 180.0) < _NEAR_DEG
        for lon, lat in ring
    )


def read_zones(text: str, source: str) -> Zones:
    """Read GeoJSON text; positions stay in degrees.

    Raises
    ------
    ConfigError
        With `source`, the invalid feature and what was expected there.
    """
    try:
        found = msgspec.json.decode(text)
    except msgspec.DecodeError as error:
        raise ConfigError(source, "", MistakeCode.INVALID_FILE, f"not valid JSON: {error}") from None
    except RecursionError:
        raise ConfigError(
            source, "", MistakeCode.INVALID_FILE, "expected GeoJSON; this is nested too deeply"
        ) from None
    zones: list[Zone] = []
    boundaries: list[tuple[Polygon, ...]] = []
    for key, geometry, properties in _geometries(found, source):
        kind = properties.get("kind", "no-fly-zone")
        if kind not in ("no-fly-zone", "boundary"):
            raise ConfigError(
                source,
                f"{key}.properties.kind",
                MistakeCode.UNKNOWN_NAME,
                f'expected "no-fly-zone" or "boundary", not {kind!r}',
            )
        shape = geometry.get("type")
        where = f"{key}.geometry" if key else ""
        corners = geometry.get("coordinates")
        limits = _limits(properties, kind, source, f"{key}.properties")
        if shape == "Point" and kind == "no-fly-zone":
            radius = properties.get("radius")
            if not isinstance(radius, int | float) or not 0.0 < radius < 1e6:
                raise ConfigError(
                    source,
                    f"{key}.properties.radius",
                    MistakeCode.MISSING_KEY,
                    "a Point needs its radius in metres, above 0",
                )
            zones.append(Zone(circle=(_position(corners, source, where), float(radius)), limits=limits))
        elif shape in ("Polygon", "MultiPolygon"):
            many = corners if shape == "MultiPolygon" else [corners]
            if not isinstance(many, list):
                raise ConfigError(
                    source, where, MistakeCode.WRONG_TYPE, "expected a list of polygons as coordinates"
                )
            read = tuple(_polygon(rings, source, where) for rings in many)
            if kind == "boundary":
                boundaries.append(read)
            else:
                zones += [Zone(polygon, limits=limits) for polygon in read]
        else:
            allowed = "Polygon or MultiPolygon" + (" or Point" if kind == "no-fly-zone" else "")
            raise ConfigError(
                source, where, MistakeCode.WRONG_TYPE, f"a {kind} is a {allowed}, not {shape!r}"
            )
        if len(boundaries) > 1:
            raise ConfigError(
                source,
                key,
                MistakeCode.DUPLICATE,
                "this is the second boundary: there may be one (a MultiPolygon if need be)",
            )
    return Zones(tuple(zones), boundaries[0] if boundaries else ())


def _limits(properties: dict[str, Any], kind: str, source: str, key: str) -> VerticalLimits:
    """Return the vertical limits of a feature; a `reference` without heights is another property."""
    height_m, floor_m, ceiling_m = (properties.get(name) for name in ("height_m", "floor_m", "ceiling_m"))
    is_limited = floor_m is not None or ceiling_m is not None
    reference = properties.get("reference") if is_limited else None
    try:
        limits = vertical_limits(height_m, floor_m, ceiling_m, reference)
    except ValueError as error:
        raise ConfigError(source, key, MistakeCode.CONFLICT, str(error)) from None
    if kind == "boundary" and not limits.are_open:
        raise ConfigError(
            source,
            key,
            MistakeCode.CONFLICT,
            "a boundary has no heights: set fence.max_alt_rel_m or max_alt_msl_m",
        )
    return limits


def _geometries(found: Any, source: str) -> Iterator[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Yield name, geometry and properties of each feature."""
    kind = found.get("type") if isinstance(found, dict) else None
    if kind == "FeatureCollection":
        features = found.get("features")
        if not isinstance(features, list):
            raise ConfigError(source, "features", MistakeCode.WRONG_TYPE, "expected a list of features")
        for index, feature in enumerate(features):
            yield from _feature(feature, source, f"features[{index}]")
    elif kind == "Feature":
        yield from _feature(found, source, "feature")
    elif isinstance(found, dict) and "coordinates" in found:
        yield "", found, {}
    else:
        raise ConfigError(
            source,
            "",
            MistakeCode.INVALID_FILE,
            f"expected GeoJSON: a FeatureCollection, a Feature or a geometry, not {kind!r}",
        )


def _feature(feature: Any, source: str, key: str) -> Iterator[tuple[str, dict[str, Any], dict[str, Any]]]:
    geometry = feature.get("geometry") if isinstance(feature, dict) else None
    if not isinstance(geometry, dict):
        raise ConfigError(source, key, MistakeCode.WRONG_TYPE, "expected a feature with a geometry")
    properties = feature.get("properties")
    yield key, geometry, properties if isinstance(properties, dict) else {}


def _polygon(rings: Any, source: str, where: str) -> Polygon:
    if not isinstance(rings, list) or not rings:
        raise ConfigError(
            source, where, MistakeCode.WRONG_TYPE, "expected a list of rings of [longitude, latitude]"
        )
    polygon = []
    for ring in rings:
        corners = tuple(
            _position(corner, source, where) for corner in (ring if isinstance(ring, list) else [])
        )
        if error := corner_error(set(corners)):
            raise ConfigError(source, where, MistakeCode.BAD_SHAPE, f"a ring: {error}")
        polygon.append(corners)
    return tuple(polygon)


def _position(position: Any, source: str, where: str) -> Position:
    if not isinstance(position, list) or len(position) < 2 or not all(map(_is_number, position[:2])):
        found = reprlib.repr(position)
        raise ConfigError(
            source, where, MistakeCode.WRONG_TYPE, f"expected a position [longitude, latitude], not {found}"
        )
    lon = float(position[0])
    lat = float(position[1])
    if not (abs(lon) <= 180.0 and abs(lat) <= 90.0):
        raise ConfigError(
            source,
            where,
            MistakeCode.OUT_OF_RANGE,
            f"[{lon}, {lat}] is no [longitude, latitude] in degrees (in this order)",
        )
    return lon, lat


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
