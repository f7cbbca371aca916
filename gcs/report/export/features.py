"""GeoJSON (RFC 7946) of a run's map.

The third coordinate is metres above mean sea level, as everywhere in this project. RFC 7946 counts heights
from the WGS84 ellipsoid; each feature says so by its property `altitude_reference`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import msgspec

from gcs.model import target_name, vehicle_name
from gcs.report.export.mission_frame import Place
from gcs.report.export.run_map import RunMap, utc_text
from gcs.report.export.target_ellipse import TargetEstimate


def geojson_text(run: RunMap) -> str:
    """Return the map of a run as a feature collection."""
    features = [*_paths(run), *_routes(run), *_targets(run), *_losses(run)]
    collection = {"type": "FeatureCollection", "features": features}
    return msgspec.json.format(msgspec.json.encode(collection), indent=1).decode() + "\n"


def _paths(run: RunMap) -> Iterable[dict[str, Any]]:
    for path in run.paths:
        times = [utc_text(t_ns) for t_ns in path.t_ns.tolist()]
        for piece in path.pieces():
            shape = line([path.places[n] for n in piece])
            stamps = [times[n] for n in piece]
            yield feature(
                "flown path", path.name, shape, vehicle=vehicle_name(path.vehicle), coordTimes=stamps
            )


def _routes(run: RunMap) -> Iterable[dict[str, Any]]:
    for route in run.routes:
        yield feature(
            "planned route",
            route.name,
            line(route.places),
            vehicle=vehicle_name(route.vehicle),
            target=target_name(route.target),
            time=utc_text(route.t_ns),
            replaced=None if route.replaced_t_ns is None else utc_text(route.replaced_t_ns),
        )


def _targets(run: RunMap) -> Iterable[dict[str, Any]]:
    for target in run.targets:
        yield from target_features(target)


def target_features(target: TargetEstimate) -> Iterable[dict[str, Any]]:
    """Return a target as a point, and its 95 % ellipse as a polygon."""
    yield feature(
        "target",
        target.name,
        point(target.place),
        target=target_name(target.label),
        time=utc_text(target.t_ns),
        existence=round(target.existence, 6),
        ellipse_95_m=[round(axis_m, 2) for axis_m in target.semi_axes_m],
        ellipse_azimuth_deg=round(target.azimuth_deg, 1),
    )
    shape = {"type": "Polygon", "coordinates": [[_position(place) for place in target.outline]]}
    yield feature("target ellipse", target.uncertainty, shape, target=target_name(target.label))


def _losses(run: RunMap) -> Iterable[dict[str, Any]]:
    for loss in run.losses:
        yield feature(
            "loss",
            loss.name,
            point(loss.place),
            vehicle=vehicle_name(loss.vehicle),
            status=loss.status,
            time=utc_text(loss.t_ns),
        )


def feature(kind: str, name: str, geometry: dict[str, Any], **properties: object) -> dict[str, Any]:
    """Return a feature with its kind and name; properties that are None are left out."""
    known = {key: value for key, value in properties.items() if value is not None}
    texts = {"kind": kind, "name": name, "altitude_reference": "mean sea level"}
    return {"type": "Feature", "geometry": geometry, "properties": texts | known}


def line(places: Iterable[Place]) -> dict[str, Any]:
    """Return a line; a point for a single position."""
    positions = [_position(place) for place in places]
    if len(positions) == 1:
        return {"type": "Point", "coordinates": positions[0]}
    return {"type": "LineString", "coordinates": positions}


def point(place: Place) -> dict[str, Any]:
    """Return a point."""
    return {"type": "Point", "coordinates": _position(place)}


def _position(place: Place) -> list[float]:
    return [round(place.lon_deg, 7), round(place.lat_deg, 7), round(place.alt_msl_m, 2)]
