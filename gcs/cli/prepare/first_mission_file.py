"""First mission file of `gcs init`: map, cells and altitudes around a sketch of vehicles and targets."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rich.console import Console

from gcs.cli.prepare.sketch.plan_and_kml import read_kml, read_plan
from gcs.cli.prepare.sketch.sketch import MAX_PLACES, FenceArea, Place, Sketch, Start
from gcs.cli.prepare.sketch.telemetry import listen_for_vehicles, read_vehicles
from gcs.config import parse
from gcs.errors import ConfigError
from gcs.fence import fence_of
from gcs.geo import LocalFrame
from gcs.io.recording.reader import is_recording, read_info
from gcs.mistake_codes import MistakeCode

_MARGIN_M: Final = 500.0
"""Margin of the map around all positions, for turns, climbs and loiters."""
_MAX_EXTENT_M: Final = 50_000.0
_MAX_NODES: Final = 100
_MIN_CELL_M: Final = 20.0
_MAX_AGENTS: Final = 250
_LINK: Final = "udpin:0.0.0.0:14550"
_NO_TARGETS: Final = (
    "# The source has no targets. For each place where targets may appear, add a table:",
    "# [[births]]",
    "# lat_deg = ...",
    "# lon_deg = ...",
    "# std_m = 50.0",
)


def write_mission_file(
    source: Path | None,
    endpoint: str | None,
    console: Console,
    *,
    wait_s: float,
    name: str | None,
    out: Path | None,
    force: bool,
) -> None:
    """Write a valid mission file from a file or from the vehicles on an endpoint.

    Raises
    ------
    ConfigError, LinkError, RecordingError
        When the source cannot be used, or the mission file exists already.
    """
    if (source is None) == (endpoint is None):
        raise ConfigError("gcs init", "", MistakeCode.MISSING_KEY, "expected a file, or --listen ENDPOINT")
    name = name or mission_name(source.stem if source else "mission")
    path = out or Path(f"{name}.toml")
    if path.exists() and not force:
        raise ConfigError(
            str(path), "", MistakeCode.EXISTS, "exists already; --force replaces it, --out names another"
        )
    if endpoint is not None:
        console.print(f"listening on {endpoint} for {wait_s:g} s", highlight=False)
        sketch = listen_for_vehicles(endpoint, wait_s)
        text = _sketch_text(sketch, name, f"the vehicles heard on {endpoint}", console, endpoint)
    else:
        assert source is not None
        text = _text_from_file(source, name, console)
    config = parse(text, str(path))
    fence_of(config, str(path))
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(
            str(path), "", MistakeCode.NO_ACCESS, f"cannot be written: {error.strerror}"
        ) from None
    console.print(
        f"{path}: {len(config.agents)} agents, {len(config.births)} target births, "
        f"{len(config.fence.areas)} fence areas; read it through, then: gcs check {path}",
        highlight=False,
        soft_wrap=True,
    )


def mission_name(stem: str) -> str:
    """Return a valid mission name for the name of a file."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", stem).strip("-")[:64] or "mission"


def _text_from_file(source: Path, name: str, console: Console) -> str:
    if not source.exists():
        raise ConfigError(str(source), "", MistakeCode.NOT_FOUND, "no such file")
    if source.suffix.lower() == ".plan":
        sketch = read_plan(source)
    elif source.suffix.lower() in (".kml", ".kmz"):
        sketch = read_kml(source)
    elif is_recording(source):
        text = read_info(source).config_text
        if not text:
            raise ConfigError(
                str(source), "", MistakeCode.MISSING_KEY, "the recording does not hold its mission file"
            )
        return f"# The mission file of the recording {_line(source.name)}.\n\n{text}"
    else:
        sketch = read_vehicles(source)
    return _sketch_text(sketch, name, source.name, console)


def _sketch_text(sketch: Sketch, name: str, of: str, console: Console, link: str = _LINK) -> str:
    """Return the text of the mission file, and print the notes."""
    for note in sketch.notes:
        console.print(f"note: {note}", style="yellow", highlight=False, markup=False)
    return mission_text(sketch, name, of, link)


def mission_text(sketch: Sketch, name: str, of: str, link: str = _LINK) -> str:
    """Return the text of a mission file: the values of a sketch, and comments on the rest.

    Raises
    ------
    ConfigError
        When there are no positions, too many, or they are too far apart.
    """
    stay_in = [area for area in sketch.areas if area.stay_in]
    if len(stay_in) > 1:
        raise ConfigError(of, "fence", MistakeCode.CONFLICT, "has several inclusion areas: draw only one")
    if len(sketch.starts) > _MAX_AGENTS or max(len(sketch.targets), len(sketch.areas)) > MAX_PLACES:
        raise ConfigError(
            of,
            "",
            MistakeCode.TOO_LARGE,
            f"has more than {_MAX_AGENTS} vehicles or {MAX_PLACES} targets or areas",
        )
    box = _Box.around(_places(sketch), of)
    starts = sketch.starts or [Start(box.centre, note="NOT in the source: set the position of the start")]
    note = "" if sketch.ground_msl_m is not None else "; NOT in the source: look it up"
    speed = f"{sketch.speed_m_s:g}" if sketch.speed_m_s else "15.0"
    parts = [
        f"# Made by `gcs init` from {_line(of)}. Read it through: the source does not have every value.",
        "# Other keys have their defaults; config/reference.toml explains every key.",
        *(f"# {_line(text)}" for text in sketch.notes),
        "",
        f"name = {_quoted(name)}  # letters, digits, - and _; sensors publish under it",
        f"description = {_quoted(f'Made from {_line(of)}')}",
        "",
        "[frame]  # the map's south-west corner",
        f"lat_deg = {box.south_west[0]:.7f}  # degrees",
        f"lon_deg = {box.south_west[1]:.7f}  # degrees",
        f"alt_msl_m = {sketch.ground_msl_m or 0.0:.1f}  # metres above mean sea level: the ground here{note}",
        "",
        "[map]",
        f"width_m = {box.width_m:.1f}  # metres east",
        f"height_m = {box.height_m:.1f}  # metres north",
        f"nodes_east = {box.nodes_east}  # search-grid nodes; cells are square",
        f"nodes_north = {box.nodes_north}",
        '# geojson = "zones.geojson"  # no-fly zones and boundary, in the same folder',
        *(line for start in starts for line in _agent(start)),
        *(line for place, label in sketch.targets for line in _birth(place, label)),
        *([] if sketch.targets else ["", *_NO_TARGETS]),
        "",
        "[tracking.targets]",
        "accel_psd_m2_s3 = 0.25  # m2/s3: targets keep their velocity",
        "",
        "[tracking.targets.anywhere]  # adaptive births, at detections away from [[births]]",
        "per_s = 0.0005  # 1/s: objects expected to appear in a second; 0: none",
        "",
        "[airframe]  # measure these on your own vehicle",
        f"speed_m_s = {speed}  # m/s, airspeed",
        "bank_deg = 30.0  # degrees, of a turn; below the vehicle's own limit",
        "turn_lag_s = 1.5  # seconds until a turn is taken up",
        "",
        "[planning]",
        "clearance_m = 60.0  # metres kept from obstacles and the fence",
        'shape = "flyable"  # routes with turns that can be flown',
        "switch_gain_m = 100.0  # metres: agents swap targets only for a gain above this",
        'retask = "confirm"  # no mission goes up before `gcs order confirm`',
        "",
        "[mission]",
        "altitude_rel_m = 90.0  # metres above home, of the lowest altitude layer; above everything here?",
        "layer_step_m = 20.0  # metres between layers",
        f"layers = {min(len(starts), 5)}",
        "accept_radius_m = 30.0  # metres: a waypoint is reached this near to it",
        "loiter_radius_m = 80.0  # metres, at a route's end",
        "",
        "[links]",
        f"mavlink = {_quoted(link)}  # where vehicles are heard: docs/links.md",
        'zenoh = "tcp/127.0.0.1:7447"  # sensors publish here: docs/sensors.md',
        "",
        "[fence]  # `gcs fence upload` sends it to the vehicles",
        "max_alt_rel_m = 0.0  # metres above home; 0: no ceiling. Set one above the highest layer",
        *(line for area in sketch.areas for line in _area(area)),
        *(line for point in sketch.rally for line in _rally(point)),
    ]
    return "\n".join(parts) + "\n"


# ---------------------------------------------------------------- the map


@dataclass(frozen=True, slots=True)
class _Box:
    """A map around positions, with square cells."""

    south_west: Place
    centre: Place
    cell_m: float
    nodes_east: int
    nodes_north: int

    @property
    def width_m(self) -> float:
        """Width from west to east."""
        return (self.nodes_east - 1) * self.cell_m

    @property
    def height_m(self) -> float:
        """Height from south to north."""
        return (self.nodes_north - 1) * self.cell_m

    @classmethod
    def around(cls, places: list[tuple[Place, float]], of: str) -> _Box:
        """Return the map of positions (degrees), each with a radius in metres."""
        if not places:
            raise ConfigError(
                of, "", MistakeCode.MISSING_KEY, "has no position: no vehicle, waypoint, point or area"
            )
        frame = LocalFrame(*places[0][0], 0.0)
        if abs(frame.lat_deg) > 85.0:
            raise ConfigError(of, "", MistakeCode.OUT_OF_RANGE, "has a position beyond latitude 85°")
        spots = [(frame.to_local(*place), radius_m) for place, radius_m in places]
        far_m = max(math.hypot(*spot) + radius_m for spot, radius_m in spots)
        opposite = any(math.cos(math.radians(p[1] - frame.lon_deg)) < 0.0 for p, _ in places)
        if far_m > _MAX_EXTENT_M or opposite:
            raise ConfigError(
                of,
                "",
                MistakeCode.OUTSIDE_MAP,
                f"its positions are more than {_MAX_EXTENT_M / 1000:g} km apart",
            )
        west = min(x - radius_m for (x, _), radius_m in spots) - _MARGIN_M
        east = max(x + radius_m for (x, _), radius_m in spots) + _MARGIN_M
        south = min(y - radius_m for (_, y), radius_m in spots) - _MARGIN_M
        north = max(y + radius_m for (_, y), radius_m in spots) + _MARGIN_M
        cell_m = max(_MIN_CELL_M, math.ceil(max(east - west, north - south) / _MAX_NODES / 10.0) * 10.0)
        return cls(
            frame.to_geodetic(west, south),
            frame.to_geodetic(0.5 * (west + east), 0.5 * (south + north)),
            cell_m,
            math.ceil((east - west) / cell_m) + 1,
            math.ceil((north - south) / cell_m) + 1,
        )


def _places(sketch: Sketch) -> list[tuple[Place, float]]:
    return [
        *((place, 0.0) for place in sketch.extent),
        *((start.place, 0.0) for start in sketch.starts),
        *((place, 0.0) for place, _ in sketch.targets),
        *(((lat, lon), 0.0) for lat, lon, _ in sketch.rally),
        *((place, area.circle[2] if area.circle else 0.0) for area in sketch.areas for place in area.outline),
    ]


# ---------------------------------------------------------------- tables as text


def _agent(start: Start) -> list[str]:
    course = f"course_deg = {start.course_deg:.0f}" if start.course_deg is not None else "# course_deg = 90"
    return [
        "",
        f"[[agents]]{_comment(start.note)}",
        f"system_id = {start.system_id}",
        *_degrees(start.place),
        f"{course}  # of take-off, clockwise from north",
    ]


def _birth(place: Place, label: str) -> list[str]:
    return [
        "",
        f"[[births]]{_comment(label)}",
        *_degrees(place),
        "std_m = 50.0  # metres: how far off a target may appear",
    ]


def _area(area: FenceArea) -> list[str]:
    kind = "inclusion" if area.stay_in else "exclusion"
    comment = f"stay {'in' if area.stay_in else 'out'}{': ' if area.name else ''}{area.name}"
    rows = [f"[[fence.areas]]{_comment(comment)}", f'kind = "{kind}"']
    if area.circle is not None:
        lat, lon, radius_m = area.circle
        return [*rows, f"circle = [{lat:.7f}, {lon:.7f}, {radius_m:.1f}]  # degrees, radius in metres"]
    corners = [f"    [{lat:.7f}, {lon:.7f}]," for lat, lon in area.corners]
    return [*rows, "corners_deg = [  # latitude, longitude", *corners, "]"]


def _rally(point: tuple[float, float, float]) -> list[str]:
    lat, lon, alt_m = point
    height = f"alt_rel_m = {min(max(round(alt_m), 10), 30_000)}  # whole metres above home"
    return ["", "[[rally]]", *_degrees((lat, lon)), height]


def _degrees(place: Place) -> list[str]:
    return [f"lat_deg = {place[0]:.7f}", f"lon_deg = {place[1]:.7f}"]


def _comment(text: str) -> str:
    return f"  # {_line(text)}" if text else ""


def _line(text: str) -> str:
    """Return foreign text as a printable part of one line."""
    return "".join(one if one.isprintable() else " " for one in text)[:100].strip()


def _quoted(text: str) -> str:
    """Return a TOML string. A one-line JSON string without control characters is one."""
    return json.dumps(text, ensure_ascii=False)
