"""Mission files: TOML in, validated settings out.

One file describes a mission: where it lies on Earth, the map, the agents, where targets may appear, how to
track, plan and link. The same file may carry a `[simulation]` table, which only the simulated world reads:
central command keeps it unread, since it holds the truth.

Every mistake raises `ConfigError` with the file, the dotted key and what was expected. The shipped
scenarios in `gcs/scenarios/` show every key with its unit, range and default.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec
import numpy as np
from msgspec import Meta

from gcs.endpoints import Link, parse_endpoint
from gcs.errors import ConfigError, LinkError
from gcs.geo import LocalFrame
from gcs.geojson import Zones, read_zones
from gcs.model import vehicle_id, vehicle_name

_G_M_S2 = 9.80665
_STRONG_WIND_M_S = 30.0

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Probability = Annotated[float, Meta(ge=0.0, le=1.0)]
InnerProbability = Annotated[float, Meta(gt=0.0, lt=1.0)]
SystemId = Annotated[int, Meta(ge=1, le=250)]
Network = Annotated[int, Meta(ge=0, le=255)]
Point2 = Annotated[list[float], Meta(min_length=2, max_length=2)]
Point3 = Annotated[list[float], Meta(min_length=3, max_length=3)]
Box = Annotated[list[float], Meta(min_length=4, max_length=4)]
Latitude = Annotated[float, Meta(ge=-90.0, le=90.0)]
Longitude = Annotated[float, Meta(ge=-180.0, le=180.0)]
LatLon = tuple[Latitude, Longitude]


class Table(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A TOML table: unknown keys are mistakes."""


class FrameTable(Table, frozen=True, kw_only=True):
    """Origin of the local east/north frame on WGS84."""

    lat_deg: Annotated[float, Meta(ge=-85.0, le=85.0)]
    lon_deg: Annotated[float, Meta(ge=-180.0, le=180.0)]
    alt_msl_m: Annotated[float, Meta(ge=-500.0, le=9000.0)]


class MapTable(Table, frozen=True, kw_only=True):
    """Mission area and its search grid; node (0, 0) lies at the frame's origin."""

    width_m: Positive = 2000.0
    height_m: Positive = 2000.0
    nodes_east: Annotated[int, Meta(ge=2, le=4000)] = 51
    nodes_north: Annotated[int, Meta(ge=2, le=4000)] = 51
    discs_m: list[Point3] = []
    boxes_m: list[Box] = []
    polygons_m: list[Annotated[list[Point2], Meta(min_length=3)]] = []
    geojson: str = ""
    random_threshold: Annotated[float, Meta(ge=0.0, le=0.6)] = 0.0
    keep_clear_m: NotNegative = 120.0


class AgentTable(Table, frozen=True, kw_only=True):
    """One agent: its MAVLink network and system id, and where it starts."""

    system_id: SystemId
    network: Network = 0
    east_m: float
    north_m: float
    course_deg: Annotated[float, Meta(ge=-360.0, le=360.0)] = 90.0
    speed_m_s: Positive | None = None

    @property
    def vehicle(self) -> int:
        """What the vehicle is called everywhere (`gcs.model.vehicle_id`)."""
        return vehicle_id(self.network, self.system_id)


class BirthTable(Table, frozen=True, kw_only=True):
    """A place where targets may appear: a Gaussian on position and on velocity."""

    east_m: float
    north_m: float
    std_m: Positive = 10.0
    v_east_m_s: float = 0.0
    v_north_m_s: float = 0.0
    speed_std_m_s: Positive = 4.5
    priority: int = 0
    agents: Annotated[int, Meta(ge=1, le=100)] = 1


class AnywhereTable(Table, frozen=True, kw_only=True):
    """Births where no place of birth is known: at detections that nothing explains."""

    per_s: NotNegative = 0.0
    speed_std_m_s: Positive = 10.0
    most_probability: InnerProbability = 0.1


class KindTracking(Table, frozen=True, kw_only=True):
    """Tracking of one kind of object."""

    accel_std_m_s2: Positive
    birth_probability: InnerProbability = 0.03
    birth_again_probability: InnerProbability = 1e-4
    turn_rate_std_deg_s: Annotated[float, Meta(ge=0.0, le=180.0)] = 0.0
    turn_time_s: Positive = 10.0
    anywhere: AnywhereTable = AnywhereTable()


class TrackingTable(Table, frozen=True, kw_only=True):
    """The two GLMB filters and how their output is read."""

    agents: KindTracking = KindTracking(accel_std_m_s2=4.0)
    targets: KindTracking = KindTracking(accel_std_m_s2=0.5)
    survival_probability_per_s: InnerProbability = 0.99
    max_hypotheses: Annotated[int, Meta(ge=10, le=100_000)] = 200
    gate_chi2: Annotated[float, Meta(ge=4.0, le=100.0)] = 32.2
    dead_existence: Annotated[float, Meta(gt=0.0, le=0.5)] = 0.01
    lost_std_m: Positive = 500.0
    reorder_window_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    correct_sensors: bool = False
    agent_birth_std_m: Positive = 10.0
    agent_birth_speed_std_m_s: Positive = 10.0
    seed: Annotated[int, Meta(ge=0)] = 0


class TelemetryTable(Table, frozen=True, kw_only=True):
    """MAVLink position reports as a sensor of agents."""

    rate_hz: Annotated[float, Meta(gt=0.0, le=50.0)] = 4.0
    noise_std_m: Positive = 3.0
    detection_probability: InnerProbability = 0.9
    clutter_density_per_m2: Positive = 1e-6
    max_age_s: Positive = 1.0


class AirframeTable(Table, frozen=True, kw_only=True):
    """How the vehicles turn: what routes and waypoints are made for."""

    speed_m_s: Positive = 15.0
    bank_deg: Annotated[float, Meta(ge=5.0, le=70.0)] = 30.0
    turn_lag_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 1.0
    wind_m_s: Annotated[float, Meta(ge=0.0, le=30.0)] = 0.0

    @property
    def turn_radius_m(self) -> float:
        """Radius over ground of a level turn, V^2 / (g tan bank), at its widest: with the wind."""
        return (self.speed_m_s + self.wind_m_s) ** 2 / (_G_M_S2 * math.tan(math.radians(self.bank_deg)))

    @property
    def max_ground_speed_m_s(self) -> float:
        """What a report may say at most: a dive at three times the airspeed, with a strong wind behind."""
        return 3.0 * self.speed_m_s + max(self.wind_m_s, _STRONG_WIND_M_S)

    @property
    def turn_lag_m(self) -> float:
        """How far a vehicle flies before a turn is taken up."""
        return (self.speed_m_s + self.wind_m_s) * self.turn_lag_s

    @property
    def planned_radius_m(self) -> float:
        """Radius that routes are planned for: that of the turn, widened by its lag."""
        return math.hypot(self.turn_radius_m, self.turn_lag_m)


class PlanningTable(Table, frozen=True, kw_only=True):
    """When and how to plan."""

    period_s: Positive = 5.0
    target_moved_m: Positive = 50.0
    capture_radius_m: Positive = 40.0
    clearance_m: NotNegative = 0.0
    shape: Literal["grid", "pulled", "flyable"] = "grid"
    search_cost: Literal["metric", "paper"] = "metric"
    switch_gain_m: NotNegative = 0.0
    retask: Literal["auto", "confirm"] = "auto"
    when: Literal["events", "period"] = "events"
    aim: Literal["intercept", "position"] = "intercept"
    horizon_s: Annotated[float, Meta(gt=0.0, le=3600.0)] = 120.0
    cost: Literal["length", "arrival"] = "length"
    objective: Literal["total", "longest"] = "total"
    spare: Literal["hold", "double"] = "hold"
    separation_m: NotNegative = 60.0


class MissionTable(Table, frozen=True, kw_only=True):
    """What is written into the missions."""

    altitude_rel_m: Positive = 100.0
    lane_step_m: Annotated[float, Meta(ge=0.0, le=200.0)] = 20.0
    lanes: Annotated[int, Meta(ge=1, le=50)] = 5
    accept_radius_m: Annotated[float, Meta(gt=0.0, le=255.0)] = 10.0
    loiter_radius_m: Annotated[float, Meta(ge=0.0, le=255.0)] = 30.0
    end: Literal["loiter", "land"] = "loiter"
    uploader: Literal["own", "mavsdk"] = "own"
    max_duration_s: Positive = 600.0

    @property
    def highest_rel_m(self) -> float:
        """Altitude of the highest lane."""
        return self.altitude_rel_m + (self.lanes - 1) * self.lane_step_m


class FenceAreaTable(Table, frozen=True, kw_only=True):
    """An area of the fence: either corners, or a circle."""

    kind: Literal["inclusion", "exclusion"]
    corners_deg: list[LatLon] = []
    circle: tuple[Latitude, Longitude, Positive] | None = None


class FenceTable(Table, frozen=True, kw_only=True):
    """Where vehicles may be; `gcs fence upload` brings it to them (`gcs.fence`)."""

    from_map: bool = True
    max_alt_rel_m: NotNegative = 0.0
    areas: list[FenceAreaTable] = []


class RallyTable(Table, frozen=True, kw_only=True):
    """A place to return to instead of home."""

    lat_deg: Latitude
    lon_deg: Longitude
    alt_rel_m: Annotated[int, Meta(ge=10, le=30_000)]


class RecordingTable(Table, frozen=True, kw_only=True):
    """How runs are recorded."""

    rotate_mb: Annotated[float, Meta(ge=1.0, le=1e6)] = 500.0


class EndpointTable(Table, frozen=True, kw_only=True):
    """Where vehicles are, of a MAVLink network other than the first."""

    endpoint: str
    network: Network = 0


class ForwardTable(Table, frozen=True, kw_only=True):
    """Where another ground station connects, and what it may do."""

    endpoint: str
    access: Literal["read-only", "full"] = "read-only"
    adsb: bool = True
    network: Network = 0


class LinksTable(Table, frozen=True, kw_only=True):
    """Where central command finds vehicles, sensors and other ground stations."""

    mavlink: str | EndpointTable | Annotated[list[str | EndpointTable], Meta(min_length=1)] = (
        "udpin:0.0.0.0:14550"
    )
    forward: list[ForwardTable] = []
    keys: str = ""
    zenoh: Annotated[str, Meta(pattern=r"^(tcp|udp)/[^/]+:\d{1,5}$")] = "tcp/127.0.0.1:7447"
    zenoh_role: Literal["listen", "connect"] = "listen"
    max_parallel_uploads: Annotated[int, Meta(ge=1, le=1000)] = 32

    def key_file(self, source: str) -> Path | None:
        """Where the signing keys are: beside the mission file `source`; None when nothing is signed."""
        return Path(source).parent / self.keys if self.keys else None

    def entries(self) -> list[tuple[str, str | EndpointTable | ForwardTable]]:
        """Every MAVLink endpoint with its key: those of vehicles first."""
        entries: list[tuple[str, str | EndpointTable | ForwardTable]] = (
            [("links.mavlink", self.mavlink)]
            if not isinstance(self.mavlink, list)
            else [(f"links.mavlink[{index}]", entry) for index, entry in enumerate(self.mavlink)]
        )
        return entries + [(f"links.forward[{index}]", entry) for index, entry in enumerate(self.forward)]


def _link(entry: str | EndpointTable | ForwardTable) -> Link:
    match entry:
        case str():
            return Link(parse_endpoint(entry))
        case EndpointTable():
            return Link(parse_endpoint(entry.endpoint), entry.network)
        case ForwardTable():
            return Link(parse_endpoint(entry.endpoint), entry.network, entry.access, entry.adsb)


class Config(Table, frozen=True, kw_only=True):
    """A whole mission file."""

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
    description: str = ""
    frame: FrameTable
    map: MapTable = MapTable()
    agents: Annotated[list[AgentTable], Meta(min_length=1)]
    births: list[BirthTable] = []
    tracking: TrackingTable = TrackingTable()
    telemetry: TelemetryTable = TelemetryTable()
    airframe: AirframeTable = AirframeTable()
    planning: PlanningTable = PlanningTable()
    mission: MissionTable = MissionTable()
    links: LinksTable = LinksTable()
    recording: RecordingTable = RecordingTable()
    fence: FenceTable = FenceTable()
    rally: list[RallyTable] = []
    simulation: dict[str, Any] = {}

    @property
    def mavlink_links(self) -> tuple[Link, ...]:
        """Every MAVLink endpoint: those of vehicles first, then those of other ground stations."""
        return tuple(_link(entry) for _, entry in self.links.entries())

    @property
    def local_frame(self) -> LocalFrame:
        """The frame that all east/north of this mission refer to."""
        return LocalFrame(self.frame.lat_deg, self.frame.lon_deg, self.frame.alt_msl_m)

    def speed_m_s(self, vehicle: int) -> float:
        """How fast a vehicle flies: its own speed, or that of the airframe."""
        own = next((agent.speed_m_s for agent in self.agents if agent.vehicle == vehicle), None)
        return own or self.airframe.speed_m_s

    @property
    def agents_per_target(self) -> int:
        """How many agents may end at one target."""
        if self.planning.spare == "double":
            return len(self.agents)
        return max((birth.agents for birth in self.births), default=1)

    @property
    def spacing_m(self) -> tuple[float, float]:
        """Grid spacing east and north."""
        return self.map.width_m / (self.map.nodes_east - 1), self.map.height_m / (self.map.nodes_north - 1)

    @property
    def zones(self) -> Zones:
        """Keep-out zones and boundary of the GeoJSON, in metres."""
        return (
            read_zones(self.map.geojson, _ZONES).to_local(self.local_frame) if self.map.geojson else Zones()
        )


T = TypeVar("T")

_ZONES = "the GeoJSON of the map"
_GEOJSON = re.compile(
    r"""^[ \t]*(?:map\.)?geojson[ \t]*=[ \t]*(?P<value>"(?P<basic>[^"\\\n]*)"|'(?P<literal>[^'\n]*)')""",
    re.MULTILINE,
)

_WHERE = re.compile(r"^(?P<problem>.*?)(?: - at `(?P<path>[^`]*)`)?$", re.DOTALL)


def convert(raw: object, to: type[T], source: str, prefix: str = "") -> T:
    """Validate plain data against a table type.

    Raises
    ------
    ConfigError
        With the dotted key at fault and what was expected there.
    """
    try:
        return msgspec.convert(raw, to)
    except msgspec.ValidationError as error:
        match = _WHERE.match(str(error))
        assert match is not None
        path = (match["path"] or "$").removeprefix("$").removeprefix(".")
        key = ".".join(part for part in (prefix, path) if part)
        raise ConfigError(source, key, _plain(match["problem"])) from None


def _plain(problem: str) -> str:
    """Put msgspec's wording into words for somebody who edits TOML."""
    problem = re.sub(r"Object missing required field `(\w+)`", r"the key `\1` is missing here", problem)
    problem = re.sub(
        r"Object contains unknown field `(\w+)`",
        r"unknown key `\1`: misspelt, or in the wrong table?",
        problem,
    )
    return problem.replace("`object`", "a table").replace("Expected", "expected")


def scenario_names() -> list[str]:
    """Names of the shipped scenarios, in the order in which they build on one another."""
    order = ["deterministic", "prescribed", "random-obstacles", "random-targets", "radars", "swarm-50"]
    found = [
        f.name.removesuffix(".toml")
        for f in (resources.files("gcs") / "scenarios").iterdir()
        if f.name.endswith(".toml")
    ]
    return sorted(found, key=lambda name: (order.index(name) if name in order else len(order), name))


def read_text(scenario: str) -> tuple[str, str]:
    """Return (text, source name) of a shipped scenario or of a file.

    A GeoJSON file that the mission file names is read as well, and its content put in place of its name: what
    is recorded of a run holds everything.

    Raises
    ------
    ConfigError
        When there is neither a scenario nor a readable file of that name.
    """
    if re.fullmatch(r"[A-Za-z0-9_-]+", scenario):
        shipped = resources.files("gcs") / "scenarios" / f"{scenario}.toml"
        if shipped.is_file():
            return shipped.read_text(encoding="utf-8"), scenario
    path = Path(scenario)
    if not path.is_file():
        raise ConfigError(
            scenario, "", f"no such file or scenario; shipped scenarios: {', '.join(scenario_names())}"
        )
    return _with_zones(_text_of(path), path), os.fspath(path)


def _text_of(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(os.fspath(path), "", f"cannot be read as text: {error}") from None


def _with_zones(text: str, path: Path) -> str:
    """Return a mission file's text with the content of the GeoJSON file that it names."""
    match = _GEOJSON.search(text)
    if match is None:
        return text
    name = match["basic"] or match["literal"] or ""
    if not name or name.lstrip().startswith("{"):
        return text
    file = path.parent / name
    if not file.is_file():
        raise ConfigError(os.fspath(path), "map.geojson", f"no such file: {file}")
    zones = _text_of(file)
    read_zones(zones, os.fspath(file))
    # A JSON string of one line without control characters is a TOML string too.
    compact = msgspec.json.encode(msgspec.json.decode(zones)).decode()
    quoted = msgspec.json.encode(compact).decode()
    return text[: match.start("value")] + quoted + text[match.end("value") :]


def parse(text: str, source: str) -> Config:
    """Validate the text of a mission file.

    Raises
    ------
    ConfigError
        For broken TOML, unknown or missing keys, values out of range, and contradictions between keys.
    """
    try:
        raw = msgspec.toml.decode(text)
    except (msgspec.DecodeError, ValueError) as error:
        raise ConfigError(source, "", f"not valid TOML: {error}") from None
    config = convert(raw, Config, source)
    _cross_check(config, source)
    return config


def load(scenario: str) -> Config:
    """Read and validate a shipped scenario or a file."""
    return parse(*read_text(scenario))


def _cross_check(config: Config, source: str) -> None:
    if config.map.geojson:
        _check_zones(config, source)
    _check_links(config, source)
    ids = [agent.vehicle for agent in config.agents]
    for index, vehicle in enumerate(ids):
        if vehicle in ids[:index]:
            raise ConfigError(
                source,
                f"agents[{index}].system_id",
                f"{vehicle_name(vehicle)} is used twice; each agent needs its own",
            )
    area = config.map
    for index, corners in enumerate(area.polygons_m):
        if len({tuple(corner) for corner in corners}) < 3:
            raise ConfigError(source, f"map.polygons_m[{index}]", "expected at least three different corners")
    places: list[tuple[str, Sequence[AgentTable | BirthTable]]] = [
        ("agents", config.agents),
        ("births", config.births),
    ]
    for name, rows in places:
        for index, row in enumerate(rows):
            if not (0.0 <= row.east_m <= area.width_m and 0.0 <= row.north_m <= area.height_m):
                raise ConfigError(
                    source,
                    f"{name}[{index}]",
                    f"({row.east_m}, {row.north_m}) lies outside the map: "
                    f"{area.width_m} m x {area.height_m} m",
                )
    east, north = config.spacing_m
    if not np.isclose(east, north, rtol=1e-6):
        raise ConfigError(
            source,
            "map",
            f"the grid's cells must be square: width gives {east:.3f} m a cell, height {north:.3f} m; "
            "change nodes_east or nodes_north",
        )


def _check_zones(config: Config, source: str) -> None:
    if not config.map.geojson.lstrip().startswith("{"):
        raise ConfigError(
            source,
            "map.geojson",
            'expected the name of a file on a line of its own: geojson = "zones.geojson"',
        )
    given, near = read_zones(config.map.geojson, f"{source}: map.geojson"), config.zones
    for what, some, here in (
        ("the boundary", given.boundary, near.boundary),
        ("every keep-out zone", given.polygons + given.circles, near.polygons + near.circles),
    ):
        if some and not here:
            raise ConfigError(
                source,
                "map.geojson",
                f"{what} lies far from the frame's origin ({config.frame.lat_deg:.3f}°, "
                f"{config.frame.lon_deg:.3f}°); positions are [longitude, latitude], in this order",
            )


def _check_links(config: Config, source: str) -> None:
    """Read every connection string, and see that networks and endpoints fit together."""
    links: list[tuple[str, Link]] = []
    for key, entry in config.links.entries():
        try:
            link = _link(entry)
        except LinkError as error:
            raise ConfigError(source, key, str(error)) from None
        if link.name in (other.name for _, other in links):
            raise ConfigError(source, key, f"{link.name} is there twice; each endpoint is one link")
        links.append((key, link))
    reached = {link.network for _, link in links if link.role == "vehicles"}
    for key, link in links:
        if link.network not in reached:
            raise ConfigError(source, key, f"network {link.network} has no endpoint in links.mavlink")
    for index, agent in enumerate(config.agents):
        if agent.network not in reached:
            raise ConfigError(
                source,
                f"agents[{index}].network",
                f"network {agent.network} has no endpoint in links.mavlink; "
                f"there is {', '.join(map(str, sorted(reached)))}",
            )
