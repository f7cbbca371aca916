"""Records of the console: the schema of all that its page and other programs get.

The feed and `/api` encode them; the description of `/api` and the types of the page's modules are made from
them. Agents, targets, sensors, routes, plans, no-fly zones and answers are the records of `gcs.model`.

Positions are east and north in metres; times are seconds since the start of the run. A number that is not
known is null.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec
from msgspec import UNSET, Struct, UnsetType

from gcs.core.preflight.result import PreflightResult
from gcs.io.recording.disk_space import DiskSpace
from gcs.model import (
    AgentRecord,
    Kind,
    Label,
    Level,
    NoFlyZone,
    OrderAnswer,
    Proposal,
    Route,
    SensorRecord,
    TargetRecord,
)
from gcs.model.sensors import Polar

Point: TypeAlias = tuple[float, float]
"""East and north."""
Covariance: TypeAlias = tuple[float, float, float]
"""East-east, east-north and north-north, in square metres."""
TrailPoint: TypeAlias = tuple[float, float, float]
"""East, north, and height above mean sea level."""
Trail: TypeAlias = list[TrailPoint | None]
"""Places of a vehicle; None where it was not heard between two of them."""
LatePath: TypeAlias = list[Point | None]
"""Late estimates of a track, one a scan; None where it was not estimated between two of them."""
Series: TypeAlias = list[float | None]
"""Values by bin; None for empty bins."""
Role: TypeAlias = Literal["view", "operate"]
MarkKind: TypeAlias = Literal["lost", "down", "arrived", "plan", "upload", "alarm", "order", "ended"]
Work: TypeAlias = Literal["scan", "plan"]


class FenceArea(Struct, frozen=True):
    """An area of the fence."""

    stay_in: bool
    ring: tuple[Point, ...]
    """Its corners, in order."""


class TilesInfo(Struct, frozen=True):
    """Map tiles that are drawn below the map."""

    min_zoom: int
    max_zoom: int
    attribution: str


class RunInfo(Struct, frozen=True):
    """Origin of what is shown: a live service, or a replay."""

    kind: Literal["live", "replay"] = "live"
    speed: float = 1.0
    """Speed of the run's clock, as a multiple of real time."""
    begun: str = ""
    """Differs for each run that is shown."""
    preflight: bool = False
    """True if its vehicles can be checked."""
    tiles: TilesInfo | None = None
    title: str = ""
    """File that is replayed."""


class ElevationMap(Struct, frozen=True):
    """Ground of a mission over terrain, and its flight band."""

    origin_m: Point
    """South-western node."""
    spacing_m: float
    shape: tuple[int, int]
    """Rows and columns."""
    lowest_msl_m: float
    step_m: float
    heights: str
    """Steps of each node above the lowest one, row by row from the south: 16 bits, little-endian, base64."""
    min_agl_m: float
    max_agl_m: float


class MissionInfo(RunInfo, frozen=True, kw_only=True):
    """Parts of the mission that do not change in a run."""

    name: str
    size_m: Point
    """Extent of the map."""
    origin_deg: tuple[float, float]
    """Latitude and longitude of the origin of positions."""
    origin_alt_m: float
    """Its height above sea level."""
    terrain: str
    """Elevation model and flight band in words, or "flat"."""
    elevation: ElevationMap | None = None
    """Null: the ground is flat."""
    layers_rel_m: tuple[float, ...] = ()
    """Height of each altitude layer above home, over flat ground."""
    loiter_radii_m: dict[int, float]
    """Loiter radius of each vehicle."""
    homes: tuple[Point, ...]
    rally: tuple[Point, ...]
    fence: tuple[FenceArea, ...]
    lag_scans: int = 0
    """Number of scans by which `late` is late; 0: there are no late estimates."""


class Figures(Struct, frozen=True):
    """Figures by which two runs are compared; null: not known, or not read from the recording yet."""

    retasks: int | None
    """Re-tasks until now."""
    failed_uploads: int | None
    """Failed uploads until now."""
    ospa_agents_m: float | None
    """OSPA of the agents at the last scan."""
    ospa_targets_m: float | None


class ReplayState(Struct, frozen=True):
    """Position and speed of a replay."""

    paused: bool
    ended: bool
    speed: float | None
    """Null: as fast as it can."""
    at_s: float
    back: bool
    """True if it can go back."""
    duration_s: float | None
    figures: Figures | None = None
    """Only in a comparison."""


class ServiceState(Struct, frozen=True):
    """State of the service around the engine."""

    lag_s: float
    """Run time that the newest tick waited before it was processed."""
    dropped: int
    """Events that found the queue of the service full."""
    is_recording: bool
    space: DiskSpace | None
    """Space of the recording; null if it is not known."""
    stations: tuple[str, ...]
    """Other ground stations: address, and system and component ids."""


class Head(Struct, frozen=True):
    """Time of the run, its sensors and its service."""

    t_ms: int
    """Milliseconds since 1970."""
    elapsed_s: float
    ended: bool
    """True after the end of the mission."""
    sensors: tuple[SensorRecord, ...]
    service: ServiceState | None
    """Null in a replay."""


class ObstacleMap(Struct, frozen=True):
    """Blocked cells of the map."""

    origin_m: Point
    """Centre of the first cell."""
    spacing_m: float
    shape: tuple[int, int]
    """Rows and columns."""
    blocked: str
    """One bit for each cell, row by row from the south, in base64."""
    below: str
    """The same for cells that are blocked below the altitude layers only; empty if there are none."""


class Tracks(Struct, frozen=True):
    """Tracks of one kind: columns of one value for each."""

    names: list[str]
    means: list[tuple[float, float, float, float]]
    """East, north, and their rates."""
    covs: list[Covariance]
    """Covariance of each position."""
    existence: list[float]
    """Existence probabilities."""
    estimated: list[bool]


class FieldOfView(Struct, frozen=True):
    """Field of view of a sensor: a sector around it, or a box."""

    box_m: tuple[float, float, float, float]
    """West, south, east and north."""
    polar: Polar | None
    """Null: the box."""


class LogEntry(Struct, frozen=True):
    """Line of the log."""

    n: int
    """Number; later entries have higher ones."""
    t_s: float
    level: Level
    text: str
    kind: str
    """Kind of its effect, or of its mark."""
    code: str
    """Code of its notice: an entry of the page of alarms; empty for an order."""
    key: str = ""
    """Identity of the condition that it tells of."""
    ends: tuple[str, ...] = ()
    """Conditions that it ends."""
    vehicle: int | None = None


class RoleMessage(Struct, frozen=True, tag_field="type", tag="role"):
    """First message of the feed: what its page may do."""

    role: Role


class Sections(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="type"):
    """Sections of the page's data."""

    mission: MissionInfo | UnsetType = UNSET
    lost: int | UnsetType | None = UNSET
    """Milliseconds since 1970 at which the service was last heard; null while it answers."""
    replay: ReplayState | UnsetType | None = UNSET
    """Null for a live run."""
    head: Head | UnsetType = UNSET
    vehicles: tuple[AgentRecord, ...] | UnsetType = UNSET
    """Those that need attention first."""
    targets: tuple[TargetRecord, ...] | UnsetType = UNSET
    proposal: Proposal | UnsetType | None = UNSET
    """The plan that waits for approval."""
    map: ObstacleMap | UnsetType = UNSET
    zones: tuple[NoFlyZone, ...] | UnsetType = UNSET
    routes: tuple[Route, ...] | UnsetType = UNSET
    agents_tracks: Tracks | UnsetType = UNSET
    targets_tracks: Tracks | UnsetType = UNSET
    fields_of_view: dict[str, FieldOfView] | UnsetType = UNSET
    """Field of view of each sensor."""
    scans: list[list[int]] | UnsetType = UNSET
    """New scans; not in a snapshot. East and north of the detections of each in turns."""
    log: list[LogEntry] | UnsetType = UNSET
    """New entries; in a snapshot the last ones."""
    answers: list[OrderAnswer] | UnsetType = UNSET
    """New answers to orders; in a snapshot the last ones."""
    trails: dict[int, Trail] | UnsetType = UNSET
    """Places of each vehicle; only in a snapshot."""
    late: dict[str, LatePath] | UnsetType = UNSET
    """New estimates of each track some scans late; in a snapshot the last ones."""


class SnapshotMessage(Sections, frozen=True, tag="snapshot"):
    """Message of the feed with all sections that there are."""


class UpdateMessage(Sections, frozen=True, tag="update"):
    """Message of the feed with the sections that have changed."""


FeedMessage: TypeAlias = RoleMessage | SnapshotMessage | UpdateMessage


class ClaimDetail(Struct, frozen=True):
    """Authority that holds a vehicle."""

    authority: str
    reason: str
    since_s: float | None
    """Time since its begin."""


class LinkDetail(Struct, frozen=True):
    """Link of a vehicle."""

    state: str
    address: str | None
    """Null: never heard."""
    signed: bool
    frames: int
    """Frames that have arrived."""
    lost: int
    """Frames that have not arrived."""
    conflicts: int
    """Frames that used its id from another address."""
    autopilot: str
    """Name of the firmware; empty if it is not known."""
    reboots: int


class MissionItem(Struct, frozen=True):
    """Item of an onboard mission."""

    seq: int
    command: str
    at: Point | None
    """Null: it has no place."""
    alt_m: float | None
    reference: Literal["home", "msl"]
    """What `alt_m` is above: home, or mean sea level (routes over terrain, an ArduPlane's home)."""


class MissionDetail(Struct, frozen=True):
    """Onboard mission of a vehicle, by the last read-back."""

    target: Label
    items: tuple[MissionItem, ...]
    first: int
    """Item with the first point of the route."""
    current: int | None
    """Current item; null while the vehicle still counts items of the mission before."""
    verified_s: float | None
    """Time since it was verified; null if that was before a restart, or never."""
    inconsistent: bool
    audited: bool
    """True while it is downloaded and compared."""


class UploadDetail(Struct, frozen=True):
    """Upload to a vehicle."""

    since_s: float | None
    """Time since it began; null without one."""
    failures: int
    """Failed uploads in a row."""
    pause_s: float
    """Time until the next attempt; 0 if none waits."""


class ReturnDetail(Struct, frozen=True):
    """Return to launch of a vehicle."""

    height: str
    """In words; empty if its parameters were not heard."""
    problem: str


class PositionDetail(Struct, frozen=True):
    """Position-integrity monitor of a vehicle."""

    cusum: float
    alarm_cusum: float
    """CUSUM from which its reports are doubted."""
    refused: dict[str, int]
    """Refused position reports, by reason."""


class VehicleDetail(Struct, frozen=True):
    """Everything of one vehicle's record."""

    t_s: float
    """Seconds since 1970, by the run's clock."""
    agent: AgentRecord
    claims: tuple[ClaimDetail, ...]
    """The one that prevails first."""
    link: LinkDetail
    mission: MissionDetail | None
    """Null: its onboard mission is not known."""
    upload: UploadDetail
    return_: ReturnDetail = msgspec.field(name="return")
    takeoff_problem: str
    """Why its take-off is not clear; empty if it is."""
    position: PositionDetail


class Mark(Struct, frozen=True):
    """One event of the run."""

    t_s: float
    kind: MarkKind
    text: str
    code: str = ""
    """Code of its notice; empty for an order."""
    key: str = ""
    """Identity of the condition that it tells of."""


class MarksReply(Struct, frozen=True):
    """Events of the run."""

    complete: bool
    """True if no more will come: a recording was read to its end."""
    marks: list[Mark]


class ChartsReply(Struct, frozen=True):
    """Series of the charts, in bins of equal width from the start of the run."""

    width_s: float
    """Width of a bin."""
    bins: int
    objects: dict[Kind, Series]
    """Mean number of objects."""
    spread: dict[Kind, Series]
    """Its standard deviation."""
    true: dict[Kind, Series]
    """True number of objects."""
    ospa: dict[Kind, Series]
    existence: dict[Kind, dict[str, Series]]
    """Existence probability of each track."""
    rate: dict[str, Series]
    """Messages of each vehicle per second."""
    loss: dict[str, Series]
    """Messages of each vehicle that were lost, in percent."""
    battery: dict[str, Series]
    """Charge of each vehicle, in percent."""
    work: dict[Work, Series]
    """Longest computing times, in milliseconds."""
    complete: bool
    """True if a recording was read to its end."""


class PlanReply(Struct, frozen=True):
    """Routes that are flown, and the plan that waits for approval."""

    routes: tuple[Route, ...]
    proposal: Proposal | None


class OrderReply(Struct, frozen=True):
    """Answers to an order until now."""

    order_id: str
    complete: bool
    """True if no more answers will come."""
    answers: list[OrderAnswer]


class PreflightRun(PreflightResult, frozen=True):
    """Result of `gcs preflight`, or why there is none."""

    at_ms: int = 0
    """Begin of the checks, in milliseconds since 1970."""
    error: str = ""


class PreflightReply(Struct, frozen=True):
    """Last result of `gcs preflight`."""

    possible: bool
    running: bool
    result: PreflightRun | None


class ErrorReply(Struct, frozen=True):
    """Why a request was refused."""

    error: str
