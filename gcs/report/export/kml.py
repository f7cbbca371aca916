"""KML 2.2 of a run's map (https://developers.google.com/kml/documentation/kmlreference).

Heights are absolute: above mean sea level. Paths are LineStrings, which QGroundControl reads, too. Replaced
routes are there, but not shown at first.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final
from xml.etree import ElementTree as ET

from gcs.report.export.mission_frame import Place
from gcs.report.export.run_map import RunMap, utc_text

_NAMESPACE: Final = "http://www.opengis.net/kml/2.2"
_COLOURS: Final = {"flown": "ffb27200", "route": "ff73009e", "target": "ff005ed5", "loss": "ff1c19d7"}
"""Alpha, blue, green, red."""
_LINE_WIDTH: Final = 2
_FILL_ALPHA: Final = "40"


def kml_text(run: RunMap) -> str:
    """Return the map of a run as KML."""
    root = ET.Element("kml", xmlns=_NAMESPACE)
    document = ET.SubElement(root, "Document")
    _add(document, "name", run.name)
    for name, colour in _COLOURS.items():
        _add_style(document, name, colour)
    folder = _folder(document, "Flown paths", bool(run.paths))
    for path in run.paths:
        first_t_ns, last_t_ns = path.t_ns[[0, -1]].tolist()
        mark = _placemark(folder, path.name, "flown", (first_t_ns, last_t_ns))
        _add_lines(mark, [[path.places[n] for n in piece] for piece in path.pieces()])
    folder = _folder(document, "Planned routes", bool(run.routes))
    for route in run.routes:
        span = (route.t_ns, route.replaced_t_ns)
        mark = _placemark(folder, route.name, "route", span, visible=route.replaced_t_ns is None)
        _add_lines(mark, [route.places])
    folder = _folder(document, "Targets", bool(run.targets))
    for target in run.targets:
        text = f"{target.uncertainty}; existence probability {target.existence:.2f}"
        mark = _placemark(folder, target.name, "target", (target.t_ns, None), text)
        shapes = ET.SubElement(mark, "MultiGeometry")
        _add_point(shapes, target.place)
        _add_polygon(shapes, target.outline)
    folder = _folder(document, "Losses", bool(run.losses))
    for loss in run.losses:
        _add_point(_placemark(folder, loss.name, "loss", (loss.t_ns, None), utc_text(loss.t_ns)), loss.place)
    ET.indent(root, " ")
    content: bytes = ET.tostring(root, "utf-8", xml_declaration=True)
    return content.decode() + "\n"


def _folder(document: ET.Element, name: str, is_needed: bool) -> ET.Element:
    """Return a new folder; one without content is not added to the document."""
    folder = ET.Element("Folder")
    _add(folder, "name", name)
    if is_needed:
        document.append(folder)
    return folder


def _placemark(
    folder: ET.Element,
    name: str,
    style: str,
    span_t_ns: tuple[int, int | None],
    text: str = "",
    *,
    visible: bool = True,
) -> ET.Element:
    mark = ET.SubElement(folder, "Placemark")
    _add(mark, "name", name)
    if not visible:
        _add(mark, "visibility", "0")
    if text:
        _add(mark, "description", text)
    span = ET.SubElement(mark, "TimeSpan")
    begin_t_ns, end_t_ns = span_t_ns
    _add(span, "begin", utc_text(begin_t_ns))
    if end_t_ns is not None:
        _add(span, "end", utc_text(end_t_ns))
    _add(mark, "styleUrl", f"#{style}")
    return mark


def _add_style(document: ET.Element, name: str, colour: str) -> None:
    style = ET.SubElement(document, "Style", id=name)
    _add(ET.SubElement(style, "IconStyle"), "color", colour)
    line = ET.SubElement(style, "LineStyle")
    _add(line, "color", colour)
    _add(line, "width", str(_LINE_WIDTH))
    _add(ET.SubElement(style, "PolyStyle"), "color", _FILL_ALPHA + colour[2:])


def _add_lines(mark: ET.Element, lines: Iterable[Iterable[Place]]) -> None:
    shapes = ET.SubElement(mark, "MultiGeometry")
    for line in lines:
        places = list(line)
        if len(places) == 1:
            _add_point(shapes, places[0])
        else:
            shape = ET.SubElement(shapes, "LineString")
            _add(shape, "altitudeMode", "absolute")
            _add(shape, "coordinates", _coordinates(places))


def _add_point(parent: ET.Element, place: Place) -> None:
    point = ET.SubElement(parent, "Point")
    _add(point, "altitudeMode", "absolute")
    _add(point, "coordinates", _coordinates([place]))


def _add_polygon(parent: ET.Element, outline: Iterable[Place]) -> None:
    polygon = ET.SubElement(parent, "Polygon")
    _add(polygon, "altitudeMode", "clampToGround")
    ring = ET.SubElement(ET.SubElement(polygon, "outerBoundaryIs"), "LinearRing")
    _add(ring, "coordinates", _coordinates(outline))


def _coordinates(places: Iterable[Place]) -> str:
    return " ".join(_words(places))


def _words(places: Iterable[Place]) -> Iterator[str]:
    for place in places:
        yield f"{place.lon_deg:.7f},{place.lat_deg:.7f},{place.alt_msl_m:.2f}"


def _add(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = text
