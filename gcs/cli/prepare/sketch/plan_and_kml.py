"""Reader of missions from other programs: `.plan` of QGroundControl, and KML.

Plan: https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html. KML:
https://developers.google.com/kml/documentation/kmlreference. The files are untrusted: their size and depth
are limited, and XML with a document type is refused, since its entities can expand.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree as ET

import msgspec
import numpy as np

from gcs.cli.prepare.sketch.sketch import MAX_PLACES, FenceArea, Place, Sketch, Start, is_place
from gcs.errors import ConfigError
from gcs.fence import Area
from gcs.files import read_bytes
from gcs.geo import LocalFrame, corner_error
from gcs.mistake_codes import MistakeCode

_MAX_BYTES: Final = 4_000_000
_MAX_DEPTH: Final = 40
_TARGET_COMMANDS: Final = (16, 17, 18, 19, 31, 82)
"""NAV_WAYPOINT, the three loiters, LOITER_TO_ALT and SPLINE_WAYPOINT."""
_MAX_SPEED_M_S: Final = 100.0
_MAX_NUMBER: Final = 1e9
_BOUNDARY_WORDS: Final = ("fence", "boundary", "border", "perimeter")


def _text(path: Path) -> str:
    try:
        return read_bytes(path, _MAX_BYTES).decode("utf-8-sig")
    except OSError as error:
        raise ConfigError(str(path), "", MistakeCode.NO_ACCESS, f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigError(
            str(path), "", MistakeCode.INVALID_FILE, "is not text in UTF-8; a KMZ must be unzipped first"
        ) from None


# ---------------------------------------------------------------- .plan


def read_plan(path: Path) -> Sketch:
    """Read a `.plan` of QGroundControl: waypoints become targets, the planned home becomes a start.

    Raises
    ------
    ConfigError
        When the file has another format, or a position in it is invalid.
    """
    source = str(path)
    try:
        raw = msgspec.json.decode(_text(path))
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise ConfigError(source, "", MistakeCode.INVALID_FILE, f"is not JSON: {error}") from None
    if not isinstance(raw, dict) or raw.get("fileType") != "Plan":
        raise ConfigError(
            source, "fileType", MistakeCode.INVALID_FILE, 'expected "Plan": a plan file of QGroundControl'
        )
    mission = _table(raw, "mission")
    sketch = Sketch()
    home = mission.get("plannedHomePosition")
    if home is not None:
        lat_deg, lon_deg, alt_m = _numbers(home, 3, source, "mission.plannedHomePosition")
        note = "a .plan is for one vehicle: add the others, and set system ids"
        sketch.starts.append(
            Start(_place(lat_deg, lon_deg, source, "mission.plannedHomePosition"), note=note)
        )
        sketch.ground_msl_m = alt_m
    speed = mission.get("cruiseSpeed")
    if isinstance(speed, int | float) and 0.0 < speed <= _MAX_SPEED_M_S:
        sketch.speed_m_s = float(speed)
    _plan_items(_list(mission, "items"), sketch, source)
    _plan_fence(_table(raw, "geoFence"), sketch, source)
    for index, point in enumerate(_list(_table(raw, "rallyPoints"), "points")):
        key = f"rallyPoints.points[{index}]"
        lat_deg, lon_deg, alt_m = _numbers(point, 3, source, key)
        sketch.rally.append((*_place(lat_deg, lon_deg, source, key), alt_m))
    return sketch


def _plan_items(items: list[Any], sketch: Sketch, source: str) -> None:
    left_out = 0
    for index, item in enumerate(items):
        key = f"mission.items[{index}]"
        if not isinstance(item, dict) or item.get("type") != "SimpleItem":
            left_out += 1
            continue
        if item.get("command") not in _TARGET_COMMANDS:
            continue
        params = item.get("params")
        if not isinstance(params, list) or len(params) < 6:
            raise ConfigError(
                source, f"{key}.params", MistakeCode.WRONG_TYPE, "expected a list of seven parameters"
            )
        lat_deg, lon_deg = _numbers(params[4:6], 2, source, f"{key}.params[4:6]")
        place = _place(lat_deg, lon_deg, source, key)
        if all(other != place for other, _ in sketch.targets):  # a waypoint and a loiter may be at one place
            sketch.targets.append((place, f"item {index + 1} of the plan"))
    if left_out:
        sketch.notes.append(f"{left_out} surveys and other patterns of the plan are left out")


def _plan_fence(fence: dict[str, Any], sketch: Sketch, source: str) -> None:
    for index, row in enumerate(_list(fence, "polygons")):
        key = f"geoFence.polygons[{index}]"
        corners = _list(_dict(row, source, key), "polygon")
        places = [_numbers(corner, 2, source, f"{key}.polygon[{n}]") for n, corner in enumerate(corners)]
        polygon = tuple(_place(lat_deg, lon_deg, source, key) for lat_deg, lon_deg in places)
        if error := corner_error(polygon):
            raise ConfigError(source, key, MistakeCode.BAD_SHAPE, error)
        sketch.areas.append(FenceArea(row.get("inclusion") is True, polygon))
    for index, row in enumerate(_list(fence, "circles")):
        key = f"geoFence.circles[{index}]"
        circle = _dict(_dict(row, source, key).get("circle"), source, f"{key}.circle")
        lat_deg, lon_deg = _numbers(circle.get("center"), 2, source, f"{key}.circle.center")
        (radius_m,) = _numbers([circle.get("radius")], 1, source, f"{key}.circle.radius")
        if not 0.0 < radius_m <= 100_000.0:
            raise ConfigError(
                source, f"{key}.circle.radius", MistakeCode.OUT_OF_RANGE, "expected metres, above 0"
            )
        place = _place(lat_deg, lon_deg, source, key)
        sketch.areas.append(FenceArea(row.get("inclusion") is True, (), (*place, radius_m)))


def _table(raw: dict[str, Any], name: str) -> dict[str, Any]:
    value = raw.get(name)
    return value if isinstance(value, dict) else {}


def _dict(value: Any, source: str, key: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ConfigError(source, key, MistakeCode.WRONG_TYPE, "expected an object")
    return value


def _list(raw: dict[str, Any], name: str) -> list[Any]:
    value = raw.get(name)
    return value if isinstance(value, list) else []


def _numbers(value: Any, count: int, source: str, key: str) -> tuple[float, ...]:
    if isinstance(value, list) and len(value) >= count:
        numbers = value[:count]
        if all(isinstance(one, int | float) and abs(one) < _MAX_NUMBER for one in numbers):
            return tuple(float(one) for one in numbers)
    raise ConfigError(source, key, MistakeCode.WRONG_TYPE, f"expected {count} numbers")


def _place(lat_deg: float, lon_deg: float, source: str, key: str) -> Place:
    if not is_place(lat_deg, lon_deg):
        raise ConfigError(
            source, key, MistakeCode.OUT_OF_RANGE, f"{lat_deg}, {lon_deg} is no latitude and longitude"
        )
    return lat_deg, lon_deg


# ---------------------------------------------------------------- KML


def read_kml(path: Path) -> Sketch:
    """Read KML: points become targets, or starts when their name begins with "agent" or "vehicle".

    One polygon becomes the inclusion area (`_choose_boundary`), the others become exclusion areas. Losses of
    `gcs export`, and its ellipses of targets, are left out.

    Raises
    ------
    ConfigError
        When the file has another format, or a position in it is invalid.
    """
    source = str(path)
    text = _text(path)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ConfigError(
            source, "", MistakeCode.INVALID_FILE, "has a document type, which KML does not need: not read"
        )
    try:
        # The size is limited, and without a DOCTYPE nothing expands.
        root = ET.fromstring(text, ET.XMLParser(target=_Tree(source)))  # noqa: S314
    except (ET.ParseError, ValueError) as error:
        raise ConfigError(source, "", MistakeCode.INVALID_FILE, f"is not XML: {error}") from None
    if _tag(root) != "kml":
        raise ConfigError(source, "", MistakeCode.INVALID_FILE, f"expected KML, got <{_tag(root)[:40]}>")
    sketch = Sketch()
    paths = 0
    for placemark in (one for one in root.iter() if _tag(one) == "Placemark"):
        name = _text_in(placemark, "name")[:60]
        style = _text_in(placemark, "styleUrl")
        for shape in placemark.iter():
            match _tag(shape):
                case "Point" if style == "#loss":
                    sketch.notes.append(f"{name!r} is left out: it is no start")
                case "Polygon" if style == "#target":
                    sketch.notes.append(f"the ellipse of {name!r} is left out: it is no area of a fence")
                case "Point":
                    _add_point(name, _coordinates(shape, name, source), sketch, source)
                case "Polygon":
                    _add_polygon(name, shape, sketch, source)
                case "LineString" | "Track":
                    paths += 1
    _choose_boundary(sketch)
    if paths:
        sketch.notes.append(f"{paths} paths of the KML are left out: routes are planned")
    return sketch


class _Tree(ET.TreeBuilder):
    """Builds a tree of limited depth: iteration over a deep one would take too long."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self._source = source
        self._depth = 0

    def start(self, tag: str, attrs: dict[str, str]) -> ET.Element:
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise ConfigError(
                self._source, "", MistakeCode.INVALID_FILE, f"is nested deeper than {_MAX_DEPTH} elements"
            )
        return super().start(tag, attrs)

    def end(self, tag: str) -> ET.Element:
        self._depth -= 1
        return super().end(tag)


def _tag(element: ET.Element) -> str:
    """Return the name of an element without its namespace."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def _text_in(element: ET.Element, tag: str) -> str:
    """Return the text of a part of an element; an empty text if it has none."""
    return next((one.text or "" for one in element if _tag(one) == tag), "").strip()


def _add_point(name: str, places: list[Place], sketch: Sketch, source: str) -> None:
    if len(places) != 1:
        raise ConfigError(
            source, f"Placemark {name!r}", MistakeCode.WRONG_TYPE, "expected one place in a Point"
        )
    if not name.lower().startswith(("agent", "vehicle")):
        sketch.targets.append((places[0], name))
        return
    number = "".join(one for one in name if one in "0123456789")[:4]
    used = {start.system_id for start in sketch.starts}
    free = next((n for n in range(1, 251) if n not in used), 0)
    if not free:
        raise ConfigError(
            source, f"Placemark {name!r}", MistakeCode.TOO_LARGE, "there are more than 250 vehicles"
        )
    wanted = int(number) if number else free
    if not 1 <= wanted <= 250 or wanted in used:
        raise ConfigError(
            source,
            f"Placemark {name!r}",
            MistakeCode.OUT_OF_RANGE,
            "expected a system id of its own, 1 to 250",
        )
    sketch.starts.append(Start(places[0], wanted, note=name))


def _add_polygon(name: str, shape: ET.Element, sketch: Sketch, source: str) -> None:
    rings = [one for one in shape.iter() if _tag(one) == "outerBoundaryIs"]
    corners = _coordinates(rings[0], name, source) if rings else []
    if len(corners) > 1 and corners[0] == corners[-1]:
        corners.pop()
    if error := corner_error(set(corners)):
        raise ConfigError(source, f"Placemark {name!r}", MistakeCode.BAD_SHAPE, f"{error} in a Polygon")
    sketch.areas.append(FenceArea(stay_in=False, corners=tuple(corners), name=name))


def _choose_boundary(sketch: Sketch) -> None:
    """Make one polygon the inclusion area, and note what each polygon becomes.

    It is the one with a name such as "fence"; without such a name the largest around a start, or, in a file
    without starts, the one around everything else. A vehicle cannot start in an exclusion area: another
    polygon around a start is left out.
    """
    areas = sketch.areas
    starts = [start.place for start in sketch.starts]
    marked = [area for area in areas if any(word in area.name.lower() for word in _BOUNDARY_WORDS)]
    around = [area for area in areas if any(_contains(area, place) for place in starts)]
    why = 'by its name: it may have "fence", "boundary", "border" or "perimeter"'
    chosen = marked
    if not marked and starts:
        chosen = sorted(around, key=_extent_deg2)[-1:]
        why = "since a vehicle starts in it"
    elif not marked:
        places = [place for place, _ in sketch.targets]
        chosen = [area for area in areas if _contains_all(area, [*places, *_corners_except(area, areas)])][:1]
        why = "since everything else lies in it"
    sketch.areas = []
    for area in areas:
        name = f"polygon {area.name!r}" if area.name else "a polygon without a name"
        if area in chosen:
            sketch.areas.append(replace(area, stay_in=True))
            sketch.notes.append(f"{name} is the boundary (inclusion area), {why}")
        elif area in around:
            sketch.notes.append(f"{name} is left out: a vehicle starts in it, and it is not the boundary")
        else:
            sketch.areas.append(area)
            sketch.notes.append(f"{name} is an exclusion area")


def _contains(area: FenceArea, place: Place) -> bool:
    frame = LocalFrame(*area.corners[0], 0.0)
    point_m = np.array([frame.to_local(*place)])
    return bool(Area(stay_in=True, corners_deg=area.corners).contains(point_m, frame)[0])


def _contains_all(area: FenceArea, places: Iterable[Place]) -> bool:
    return all(_contains(area, place) for place in places)


def _corners_except(area: FenceArea, areas: list[FenceArea]) -> list[Place]:
    return [corner for one in areas if one is not area for corner in one.corners]


def _extent_deg2(area: FenceArea) -> float:
    """Return the size of the rectangle around an area, for comparisons."""
    lats, lons = zip(*area.corners, strict=True)
    return float((max(lats) - min(lats)) * (max(lons) - min(lons)))


def _coordinates(shape: ET.Element, name: str, source: str) -> list[Place]:
    places = []
    for words in _tuples(shape):
        try:
            lon_deg, lat_deg = (float(word) for word in words.split(",")[:2])
        except ValueError:
            lon_deg = lat_deg = math.nan
        if not is_place(lat_deg, lon_deg):
            expected = f"expected longitude,latitude in degrees, got {words[:60]!r}"
            raise ConfigError(source, f"Placemark {name!r}", MistakeCode.WRONG_TYPE, expected)
        places.append((lat_deg, lon_deg))
        if len(places) > MAX_PLACES:
            raise ConfigError(
                source, f"Placemark {name!r}", MistakeCode.TOO_LARGE, f"has more than {MAX_PLACES} places"
            )
    return places


def _tuples(shape: ET.Element) -> Iterator[str]:
    for element in shape.iter():
        if _tag(element) == "coordinates":
            yield from (element.text or "").split()
