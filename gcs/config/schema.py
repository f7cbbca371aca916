"""Tables of a mission file: keys, units, ranges and defaults."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from gcs.config.validation import Table
from gcs.endpoints import Link, parse_endpoint
from gcs.model import LimitReference, VerticalLimits, vehicle_id, vertical_limits

Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Probability = Annotated[float, Meta(ge=0.0, le=1.0)]
InnerProbability = Annotated[float, Meta(gt=0.0, lt=1.0)]
SystemId = Annotated[int, Meta(ge=1, le=250)]
Network = Annotated[int, Meta(ge=0, le=255)]
Point2 = Annotated[list[float], Meta(min_length=2, max_length=2)]
Point3 = Annotated[list[float], Meta(min_length=3, max_length=3)]
Box = Annotated[list[float], Meta(min_length=4, max_length=4)]
AcceptRadius = Annotated[float, Meta(gt=0.0, le=255.0)]
LoiterRadius = Annotated[float, Meta(ge=0.0, le=255.0)]
AltitudeMsl = Annotated[float, Meta(ge=-500.0, le=30_000.0)]
ClimbAngle = Annotated[float, Meta(ge=2.0, le=60.0)]
MIN_RALLY_M = 10
"""Least height of a rally point above home."""
NODE_NAME = r"^[A-Za-z0-9_-]{1,48}$"
"""With its role a name fits into the 64 characters of a certificate's common name."""
ZenohEndpoint = Annotated[str, Meta(pattern=r"^(tcp|udp|tls)/[^/]+:\d{1,5}$")]
MissionEnd = Literal["loiter", "land"]
Latitude = Annotated[float, Meta(ge=-90.0, le=90.0)]
Longitude = Annotated[float, Meta(ge=-180.0, le=180.0)]
LatLon = tuple[Latitude, Longitude]


class FrameTable(Table, frozen=True, kw_only=True):
    """Origin of the local east/north frame on WGS84."""

    lat_deg: Annotated[float, Meta(ge=-85.0, le=85.0)]
    lon_deg: Annotated[float, Meta(ge=-180.0, le=180.0)]
    alt_msl_m: Annotated[float, Meta(ge=-500.0, le=9000.0)]


class LimitsTable(Table, frozen=True, kw_only=True):
    """Vertical limits of an area; without them it reaches from the ground to the sky."""

    height_m: float | None = None
    floor_m: float | None = None
    ceiling_m: float | None = None
    reference: LimitReference | None = None

    @property
    def limits(self) -> VerticalLimits:
        """Limits that the keys give.

        Raises
        ------
        ValueError
            As `gcs.model.vertical_limits`; a mission file is checked for it when it is read.
        """
        return vertical_limits(self.height_m, self.floor_m, self.ceiling_m, self.reference)


class ObstacleTable(LimitsTable, frozen=True, kw_only=True):
    """Obstacle with vertical limits: a disc, a box or a polygon."""

    disc_m: Point3 | None = None
    box_m: Box | None = None
    polygon_m: Annotated[list[Point2], Meta(min_length=3)] | None = None


class MapTable(Table, frozen=True, kw_only=True):
    """Mission area and its search grid; node (0, 0) lies at the frame's origin."""

    width_m: Positive = 2000.0
    height_m: Positive = 2000.0
    nodes_east: Annotated[int, Meta(ge=2, le=4000)] = 51
    nodes_north: Annotated[int, Meta(ge=2, le=4000)] = 51
    discs_m: list[Point3] = []
    boxes_m: list[Box] = []
    polygons_m: list[Annotated[list[Point2], Meta(min_length=3)]] = []
    obstacles: list[ObstacleTable] = []
    geojson: str = ""
    random_threshold: Annotated[float, Meta(ge=0.0, le=0.6)] = 0.0


class TerrainTable(Table, frozen=True, kw_only=True):
    """Elevation of the ground, and the heights above it between which vehicles fly."""

    file: str
    """Name of the file; in a text that was read, the elevation model itself (`gcs.terrain`)."""
    vertical_datum: Literal["msl", "ellipsoid"] = "msl"
    min_agl_m: Annotated[float, Meta(ge=0.0, le=10_000.0)] = 50.0
    max_agl_m: Annotated[float, Meta(gt=0.0, le=10_000.0)] = 120.0

    @property
    def flown_min_agl_m(self) -> float:
        """Least height above ground of what is flown: half of that for which routes are planned."""
        return 0.5 * self.min_agl_m


class AgentTable(Table, frozen=True, kw_only=True):
    """One agent: MAVLink network, system id and start."""

    system_id: SystemId
    network: Network = 0
    east_m: float
    north_m: float
    course_deg: Annotated[float, Meta(ge=-360.0, le=360.0)] = 90.0
    speed_m_s: Positive | None = None
    airframe: str = ""

    @property
    def vehicle(self) -> int:
        """Number of the vehicle (`gcs.model.vehicle_id`)."""
        return vehicle_id(self.network, self.system_id)


class BirthTable(Table, frozen=True, kw_only=True):
    """Birth component of targets: Gaussian in position and velocity."""

    east_m: float
    north_m: float
    std_m: Positive = 10.0
    v_east_m_s: float = 0.0
    v_north_m_s: float = 0.0
    speed_std_m_s: Positive = 4.5
    priority: int = 0
    agents: Annotated[int, Meta(ge=1, le=100)] = 1


class AnywhereTable(Table, frozen=True, kw_only=True):
    """Adaptive birth: at detections that no track explains."""

    per_s: NotNegative = 0.0
    speed_std_m_s: Positive = 10.0
    max_probability: InnerProbability = 0.1


class KindTracking(Table, frozen=True, kw_only=True):
    """Tracking of one kind of object."""

    accel_psd_m2_s3: Positive
    turn_rate_std_deg_s: Annotated[float, Meta(ge=0.0, le=180.0)] = 0.0
    anywhere: AnywhereTable = AnywhereTable()


class TrackingTable(Table, frozen=True, kw_only=True):
    """The two GLMB filters, and the evaluation of their output."""

    agents: KindTracking = KindTracking(accel_psd_m2_s3=16.0)
    targets: KindTracking = KindTracking(accel_psd_m2_s3=0.25)
    max_hypotheses: Annotated[int, Meta(ge=10, le=100_000)] = 200
    gate_chi2: Annotated[float, Meta(ge=4.0, le=100.0)] = 32.2
    lost_existence: Annotated[float, Meta(gt=0.0, le=0.5)] = 0.01
    lost_std_m: Positive = 500.0
    reorder_window_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    correct_sensors: bool = False
    lag_scans: Annotated[int, Meta(ge=0, le=50)] = 0


class TelemetryTable(Table, frozen=True, kw_only=True):
    """MAVLink position reports as a sensor of agents."""

    rate_hz: Annotated[float, Meta(gt=0.0, le=50.0)] = 4.0
    noise_std_m: Positive = 3.0
    detection_probability: InnerProbability = 0.9
    max_age_s: Positive = 1.0


class PlanningTable(Table, frozen=True, kw_only=True):
    """When and how to plan."""

    period_s: Positive = 5.0
    target_moved_m: Positive = 50.0
    capture_radius_m: Positive = 40.0
    clearance_m: NotNegative = 0.0
    vertical_clearance_m: NotNegative = 20.0
    shape: Literal["grid", "pulled", "flyable"] = "grid"
    switch_gain_m: NotNegative = 0.0
    retask: Literal["auto", "confirm"] = "auto"
    when: Literal["events", "period"] = "events"
    aim: Literal["intercept", "position"] = "intercept"
    horizon_s: Annotated[float, Meta(gt=0.0, le=3600.0)] = 120.0
    cost: Literal["length", "arrival"] = "length"
    separation_m: NotNegative = 60.0
    avoidance: Literal["act", "warn"] = "act"


class MissionTable(Table, frozen=True, kw_only=True):
    """Content of missions."""

    altitude_rel_m: Positive = 100.0
    altitude_msl_m: AltitudeMsl | None = None
    layer_step_m: Annotated[float, Meta(ge=0.0, le=200.0)] = 20.0
    layers: Annotated[int, Meta(ge=1, le=50)] = 5
    accept_radius_m: AcceptRadius = 10.0
    loiter_radius_m: LoiterRadius = 30.0
    end: MissionEnd = "loiter"
    max_duration_s: Positive = 600.0

    @property
    def highest_rel_m(self) -> float:
        """Altitude of the highest layer."""
        return self.altitude_rel_m + (self.layers - 1) * self.layer_step_m


class TakeoffTable(Table, frozen=True, kw_only=True):
    """Climb after take-off, straight along the runway to the take-off altitude."""

    altitude_rel_m: NotNegative = 0.0
    heading_deg: Annotated[float, Meta(ge=0.0, lt=360.0)] | None = None
    ground_run_m: NotNegative = 30.0
    climb_deg: ClimbAngle = 20.0


class FenceAreaTable(LimitsTable, frozen=True, kw_only=True):
    """Area of the fence: a polygon or a circle."""

    kind: Literal["inclusion", "exclusion"]
    corners_deg: list[LatLon] = []
    circle: tuple[Latitude, Longitude, Positive] | None = None


class FenceTable(Table, frozen=True, kw_only=True):
    """Geofence (`gcs.fence`)."""

    from_map: bool = True
    max_alt_rel_m: NotNegative = 0.0
    max_alt_msl_m: AltitudeMsl | None = None
    areas: list[FenceAreaTable] = []


class RallyTable(Table, frozen=True, kw_only=True):
    """Rally point."""

    lat_deg: Latitude
    lon_deg: Longitude
    alt_rel_m: Annotated[int, Meta(ge=MIN_RALLY_M, le=30_000)] | None = None
    alt_msl_m: AltitudeMsl | None = None
    alt_agl_m: Annotated[float, Meta(ge=MIN_RALLY_M, le=30_000.0)] | None = None
    """Above the ground there; without an elevation model the ground is level."""


class RecordingTable(Table, frozen=True, kw_only=True):
    """How runs are recorded."""

    rotate_mb: Annotated[float, Meta(ge=1.0, le=1e6)] = 500.0
    max_gb: Annotated[float, Meta(ge=0.01, le=1e5)] = 100.0
    """Maximum size of a run; then the recording ends and the flight goes on."""
    min_free_mb: Annotated[float, Meta(ge=0.0, le=1e7)] = 200.0
    """Free disk space that a recording leaves."""
    bridge_mb: Annotated[float, Meta(ge=0.0, le=1e6)] = 200.0
    """Frames that each bridge keeps by itself; the oldest ones are deleted. 0: none."""


class EndpointTable(Table, frozen=True, kw_only=True):
    """Endpoint of vehicles, with its MAVLink network and its bridge."""

    endpoint: str
    network: Network = 0
    bridge: str = ""
    redundant: bool = False
    traffic: bool = False
    """True if receivers for ADS-B and Remote ID with system ids of their own report aircraft there."""


class ForwardTable(Table, frozen=True, kw_only=True):
    """Endpoint of another ground station, and its access."""

    endpoint: str
    bridge: str = ""
    access: Literal["read-only", "full"] = "read-only"
    adsb: bool = True
    network: Network = 0


class BridgeTable(Table, frozen=True, kw_only=True):
    """A bridge that runs by itself, and where it listens."""

    name: Annotated[str, Meta(pattern=NODE_NAME)]
    zenoh: ZenohEndpoint


class LinksTable(Table, frozen=True, kw_only=True):
    """Endpoints of vehicles, sensors and other ground stations."""

    mavlink: str | EndpointTable | Annotated[list[str | EndpointTable], Meta(min_length=1)] = (
        "udpin:0.0.0.0:14550"
    )
    forward: list[ForwardTable] = []
    keys: str = ""
    zenoh: ZenohEndpoint = "tcp/127.0.0.1:7447"
    zenoh_role: Literal["listen", "connect"] = "listen"
    bridges: list[BridgeTable] = []
    standby: Annotated[str, Meta(pattern=r"^((tcp|udp|tls)/[^/]+:\d{1,5})?$")] = ""
    zenoh_tls: str = ""
    zenoh_unprotected: bool = False
    max_parallel_uploads: Annotated[int, Meta(ge=1, le=1000)] = 32
    failover_s: Annotated[float, Meta(ge=0.0, le=600.0)] = 10.0

    def key_file(self, source: str) -> Path | None:
        """Return the file of signing keys, relative to the mission file `source`; None: nothing is signed."""
        return Path(source).parent / self.keys if self.keys else None

    def tls_folder(self, source: str) -> Path | None:
        """Return the folder of the certificate for zenoh, relative to the mission file; None: no TLS."""
        return Path(source).parent / self.zenoh_tls if self.zenoh_tls else None

    def entries(self) -> list[tuple[str, str | EndpointTable | ForwardTable]]:
        """Return all MAVLink endpoints with their keys, those of vehicles first."""
        entries: list[tuple[str, str | EndpointTable | ForwardTable]] = (
            [("links.mavlink", self.mavlink)]
            if not isinstance(self.mavlink, list)
            else [(f"links.mavlink[{index}]", entry) for index, entry in enumerate(self.mavlink)]
        )
        return entries + [(f"links.forward[{index}]", entry) for index, entry in enumerate(self.forward)]


def link_of(entry: str | EndpointTable | ForwardTable) -> Link:
    """Return the link of an entry.

    Raises
    ------
    LinkError
        For an invalid connection string.
    """
    match entry:
        case str():
            return Link(parse_endpoint(entry))
        case EndpointTable():
            endpoint = parse_endpoint(entry.endpoint)
            return Link(
                endpoint,
                entry.network,
                bridge=entry.bridge,
                redundant=entry.redundant,
                traffic=entry.traffic,
            )
        case ForwardTable():
            endpoint = parse_endpoint(entry.endpoint)
            return Link(endpoint, entry.network, entry.access, entry.adsb, entry.bridge)
