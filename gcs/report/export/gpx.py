"""GPX 1.1 of a run's map (https://www.topografix.com/GPX/1/1): waypoints, routes and tracks with times.

`ele` is metres above mean sea level.
"""

from __future__ import annotations

from typing import Final
from xml.etree import ElementTree as ET

from gcs.report.export.mission_frame import Place
from gcs.report.export.run_map import RunMap, utc_text

_NAMESPACE: Final = "http://www.topografix.com/GPX/1/1"


def gpx_text(run: RunMap) -> str:
    """Return the map of a run as GPX."""
    root = ET.Element("gpx", xmlns=_NAMESPACE, version="1.1", creator="swarm-gcs")
    _add(ET.SubElement(root, "metadata"), "name", run.name)
    for target in run.targets:
        _add_point(root, "wpt", target.place, target.t_ns, target.name, target.uncertainty, "target")
    for loss in run.losses:
        _add_point(root, "wpt", loss.place, loss.t_ns, loss.name, "", loss.status)
    for planned in run.routes:
        route = ET.SubElement(root, "rte")
        _add(route, "name", planned.name)
        begin = f"planned at {utc_text(planned.t_ns)}"
        end = f", replaced at {utc_text(planned.replaced_t_ns)}" if planned.replaced_t_ns is not None else ""
        _add(route, "desc", begin + end)
        for place in planned.places:
            _add_point(route, "rtept", place)
    for path in run.paths:
        track = ET.SubElement(root, "trk")
        _add(track, "name", path.name)
        times = path.t_ns.tolist()
        for piece in path.pieces():
            segment = ET.SubElement(track, "trkseg")
            for n in piece:
                _add_point(segment, "trkpt", path.places[n], times[n])
    ET.indent(root, " ")
    text: bytes = ET.tostring(root, "utf-8", xml_declaration=True)
    return text.decode() + "\n"


def _add_point(
    parent: ET.Element,
    tag: str,
    place: Place,
    t_ns: int | None = None,
    name: str = "",
    text: str = "",
    kind: str = "",
) -> None:
    lon_deg = -180.0 if place.lon_deg == 180.0 else place.lon_deg  # the schema excludes 180
    point = ET.SubElement(parent, tag, lat=f"{place.lat_deg:.7f}", lon=f"{lon_deg:.7f}")
    _add(point, "ele", f"{place.alt_msl_m:.2f}")
    texts = {"time": "" if t_ns is None else utc_text(t_ns), "name": name, "desc": text, "type": kind}
    for child, content in texts.items():
        if content:
            _add(point, child, content)


def _add(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = text
