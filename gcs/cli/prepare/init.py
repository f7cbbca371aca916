"""`gcs init`: a first mission file, from a plan, a map, a log, or the vehicles that are heard."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rich.console import Console

from gcs.cli.prepare.sketch import MAX_PLACES, FenceArea, Place, Sketch, Start
from gcs.cli.prepare.sketch_files import read_kml, read_plan
from gcs.cli.prepare.sketch_heard import listen, read_heard
from gcs.config import parse
from gcs.errors import ConfigError
from gcs.fence import fence_of
from gcs.geo import LocalFrame
from gcs.io.recording.reader import is_recording, read_info

_MARGIN_M: Final = 500.0
"""Around all places: vehicles turn, climb and wait there."""
_MAX_EXTENT_M: Final = 50_000.0
_MAX_NODES: Final = 100
_MIN_CELL_M: Final = 20.0
_MAX_AGENTS: Final = 250
_LINK: Final = "udpin:0.0.0.0:14550"
_NO_TARGETS: Final = (
    "# No target is in the source. Where they may appear, a table for each place:",
    "# [[births]]",
    "# lat_deg = ...",
    "# lon_deg = ...",
    "# std_m = 50.0",
)


@dataclass(frozen=True, slots=True)
class InitOptions:
    """What the command line says."""

    source: Path | None
    listen: str | None
    wait_s: float
    name: str | None
    out: Path | None
    force: bool


def run_init(options: InitOptions, console: Console) -> Path:
    """Write a mission file that `gcs check` takes; return its path.

    Raises
    ------
    ConfigError, LinkError, RecordingError
        When the source cannot be used, or the file exists already.
    """
    if (options.source is None) == (options.listen is None):
        raise ConfigError("gcs init", "", "expected a file, or --listen ENDPOINT")
    name = options.name or _name(options.source.stem if options.source else "mission")
    path = options.out or Path(f"{name}.toml")
    if path.exists() and not options.force:
        raise ConfigError(str(path), "", "exists already; --force replaces it, --out names another")
    text = _text(options, name, console)
    config = parse(text, str(path))
    fence_of(config, str(path))
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(str(path), "", f"cannot be written: {error.strerror}") from None
    console.print(
        f"{path}: {len(config.agents)} agents, {len(config.births)} places of birth, "
        f"{len(config.fence.areas)} fence areas; read it through, then: gcs check {path}",
        highlight=False,
        soft_wrap=True,
    )
    return path


def _name(stem: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "-", stem).strip("-")[:64] or "mission"


def _text(options: InitOptions, name: str, console: Console) -> str:
    source = options.source
    if source is None:
        assert options.listen is not None
        console.print(f"listening on {options.listen} for {options.wait_s:g} s", highlight=False)
        sketch, of = listen(options.listen, options.wait_s), f"the vehicles heard on {options.listen}"
        return _told(sketch, name, of, console, options.listen)
    if not source.exists():
        raise ConfigError(str(source), "", "no such file")
    if source.suffix.lower() == ".plan":
        sketch = read_plan(source)
    elif source.suffix.lower() in (".kml", ".kmz"):
        sketch = read_kml(source)
    elif is_recording(source):
        text = read_info(source).config_text
        if not text:
            raise ConfigError(str(source), "", "the recording does not hold its mission file")
        return f"# The mission file of the recording {_line(source.name)}.\n\n{text}"
    else:
        sketch = read_heard(source)
    return _told(sketch, name, source.name, console)


def _told(sketch: Sketch, name: str, of: str, console: Console, link: str = _LINK) -> str:
    """Return the mission file's text, and print what was left out of it."""
    for note in sketch.notes:
        console.print(f"note: {note}", style="yellow", highlight=False, markup=False)
    return mission_text(sketch, name, of, link)


def mission_text(sketch: Sketch, name: str, of: str, link: str = _LINK) -> str:
    """Return the text of a mission file with what a sketch says and comments on the rest.

    Raises
    ------
    ConfigError
        When there are no places, too many, or they lie too far apart.
    """
    stay_in = [area for area in sketch.areas if area.stay_in]
    if len(stay_in) > 1:
        raise ConfigError(of, "fence", "there are several areas to stay in: draw a single one")
    if len(sketch.starts) > _MAX_AGENTS or max(len(sketch.targets), len(sketch.areas)) > MAX_PLACES:
        raise ConfigError(of, "", f"has more than {_MAX_AGENTS} vehicles or {MAX_PLACES} targets or areas")
    box = _Box.around(_places(sketch), of)
    starts = sketch.starts or [Start(box.centre, note="NOT in the source: put where it starts")]
    note = "" if sketch.ground_msl_m is not None else "; NOT in the source: look it up"
    speed = f"{sketch.speed_m_s:g}" if sketch.speed_m_s else "15.0"
    parts = [
        f"# Made by `gcs init` from {_line(of)}. Read it through: the source does not tell everything.",
        "# What is not here has its default; config/scenarios/prescribed.toml explains every key.",
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
        '# geojson = "zones.geojson"  # keep-out zones and boundary, beside this file',
        *(line for start in starts for line in _agent(start)),
        *(line for place, label in sketch.targets for line in _birth(place, label)),
        *([] if sketch.targets else ["", *_NO_TARGETS]),
        "",
        "[tracking.targets]",
        "accel_std_m_s2 = 0.5  # m/s2: targets keep their velocity",
        "",
        "[tracking.targets.anywhere]  # births at detections that nothing explains, away from [[births]]",
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
        "lane_step_m = 20.0  # metres between layers",
        f"lanes = {min(len(starts), 5)}",
        "accept_radius_m = 30.0  # metres: a waypoint is reached this near to it",
        "loiter_radius_m = 80.0  # metres, at a route's end",
        "",
        "[links]",
        f"mavlink = {_quoted(link)}  # where vehicles are heard: docs/links.md",
        'zenoh = "tcp/127.0.0.1:7447"  # sensors publish here: docs/sensors.md',
        "",
        "[fence]  # `gcs fence upload` brings it to the vehicles",
        "max_alt_rel_m = 0.0  # metres above home; 0: no ceiling. Set one above the highest layer",
        *(line for area in sketch.areas for line in _area(area)),
        *(line for point in sketch.rally for line in _rally(point)),
    ]
    return "\n".join(parts) + "\n"


# ---------------------------------------------------------------- the map


@dataclass(frozen=True, slots=True)
class _Box:
    """A map around places, with square cells."""

    south_west: Place
    centre: Place
    cell_m: float
    nodes_east: int
    nodes_north: int

    @property
    def width_m(self) -> float:
        """East."""
        return (self.nodes_east - 1) * self.cell_m

    @property
    def height_m(self) -> float:
        """North."""
        return (self.nodes_north - 1) * self.cell_m

    @classmethod
    def around(cls, places: list[tuple[Place, float]], of: str) -> _Box:
        """Return the map that holds places (degrees), each with so many metres around it."""
        if not places:
            raise ConfigError(of, "", "no place in it: no vehicle, waypoint, point or area")
        frame = LocalFrame(*places[0][0], 0.0)
        if abs(frame.lat_deg) > 85.0:
            raise ConfigError(of, "", "lies nearer to a pole than latitude 85°")
        spots = [(frame.to_local(*place), radius_m) for place, radius_m in places]
        far_m = max(math.hypot(*spot) + radius_m for spot, radius_m in spots)
        opposite = any(math.cos(math.radians(p[1] - frame.lon_deg)) < 0.0 for p, _ in places)
        if far_m > _MAX_EXTENT_M or opposite:
            raise ConfigError(of, "", f"its places lie more than {_MAX_EXTENT_M / 1000:g} km apart")
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
    rows = [f"[[fence.areas]]  # {'stay in' if area.stay_in else 'stay out'}", f'kind = "{kind}"']
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
    """Return text of others as a part of one line."""
    return "".join(one if one.isprintable() else " " for one in text)[:100].strip()


def _quoted(text: str) -> str:
    """Return a TOML string: a JSON string of one line without control characters is one."""
    return json.dumps(text, ensure_ascii=False)
