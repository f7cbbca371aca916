"""What flows between the rooms: frozen records with units in their names.

Frame: local east/north metres (see `gcs.geo`). Time: integer nanoseconds of the run's clock, since the Unix
epoch, and always an argument. Arrays are float64 and read-only; tuples of tracks are ordered by label.
State order everywhere: ``[east_m, north_m, v_east_m_s, v_north_m_s]``.

Events go into `gcs.command`, effects come out; both are plain data, so a recording is a list of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

NS_PER_S = 1_000_000_000

FloatArray: TypeAlias = npt.NDArray[np.float64]
Label: TypeAlias = tuple[int, int]
"""Identity of a track: (scan count at its birth, index within that scan); ordered."""

Kind: TypeAlias = Literal["agents", "targets"]
Level: TypeAlias = Literal["info", "warning", "alarm"]


def read_only(array: npt.ArrayLike) -> FloatArray:
    """Return a float64 copy of `array` that nobody can write to."""
    result = np.array(array, dtype=np.float64)
    result.flags.writeable = False
    return result


# ---------------------------------------------------------------- what vehicles are called


def vehicle_id(network: int, system_id: int) -> int:
    """Return the number that a vehicle is called by: its MAVLink network times 256, plus its system id."""
    return network << 8 | system_id


def network_of(vehicle: int) -> int:
    """MAVLink network of a vehicle."""
    return vehicle >> 8


def system_of(vehicle: int) -> int:
    """MAVLink system id of a vehicle, on its network."""
    return vehicle & 0xFF


def vehicle_name(vehicle: int) -> str:
    """Write a vehicle as people do: "17", or "2:17" on network 2."""
    network, system_id = network_of(vehicle), system_of(vehicle)
    return f"{network}:{system_id}" if network else str(system_id)


def vehicle_of(text: str) -> int:
    """Read what `vehicle_name` writes.

    Raises
    ------
    ValueError
        When it is no such name.
    """
    network, _, system_id = text.rpartition(":")
    numbers = int(network or 0), int(system_id)
    if not (0 <= numbers[0] <= 255 and 1 <= numbers[1] <= 250):
        raise ValueError(text)
    return vehicle_id(*numbers)


# ---------------------------------------------------------------- events: what goes into the fold


@dataclass(frozen=True, slots=True)
class Datagram:
    """Bytes that arrived on a link. `peer` is the sender as the link writes it ("127.0.0.1:50000")."""

    t_ns: int
    link: str
    peer: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Polar:
    """How a range/bearing sensor sees: bearings run clockwise from north, clutter is uniform in both."""

    east_m: float
    """Where it stands."""
    north_m: float
    range_std_m: float
    bearing_std_rad: float
    range_m: tuple[float, float]
    """Least and greatest range at which it sees."""
    bearing_rad: tuple[float, float]
    """Centre of the sector that it sees, and how far it sees to either side: pi is all around."""
    clutter_per_m_rad: float
    """Clutter intensity in a cell of range x bearing."""


@dataclass(frozen=True, slots=True)
class Sensor:
    """What a sensor says of itself. Clutter is Poisson, uniform over the field of view.

    A range/bearing sensor has `polar`, which says exactly how it sees. What its other fields hold is for
    those who only draw: clutter and noise at the middle of its range, and the box around its field of view.
    """

    name: str
    detection_probability: float
    clutter_density_per_m2: float
    noise_cov_m2: FloatArray
    """(2, 2) covariance of a detection's east/north."""
    field_of_view_m: tuple[float, float, float, float]
    """east_min, north_min, east_max, north_max: outside it the sensor sees nothing."""
    polar: Polar | None = None


@dataclass(frozen=True, slots=True)
class Scan:
    """One scan of a sensor: detections without identity, in no meaningful order."""

    t_ns: int
    """When it arrived."""
    measured_t_ns: int
    """When it was measured."""
    sensor: Sensor
    z_m: FloatArray
    """(m, 2) east/north of each detection, whatever the sensor measures; m may be 0."""


@dataclass(frozen=True, slots=True)
class Tick:
    """Time passed. Every timer of the fold is driven by it."""

    t_ns: int


@dataclass(frozen=True, slots=True)
class BadInput:
    """Something arrived at the edge that could not be read; it is counted and shown, never raised."""

    t_ns: int
    source: str
    problem: str


@dataclass(frozen=True, slots=True)
class LinkNews:
    """What the edge has to say of a MAVLink link: lost, there again, somebody kept out."""

    t_ns: int
    link: str
    level: Level
    text: str


Action: TypeAlias = Literal["hold", "resume", "return", "arm", "disarm", "confirm", "reject", "keep-out"]


@dataclass(frozen=True, slots=True)
class KeepOut:
    """An area that routes stay out of: a disc or a polygon, in the mission's local frame.

    One of a name replaces the one before; with neither disc nor polygon the name's area is open again.
    """

    name: str
    disc_m: tuple[float, float, float] | None = None
    """East, north, radius."""
    polygon_m: tuple[tuple[float, float], ...] = ()
    """East and north of its corners, at least three, in order."""


@dataclass(frozen=True, slots=True)
class Order:
    """What an operator wants. It is answered by `OrderAnswer` with the same `order_id`."""

    t_ns: int
    order_id: str
    action: Action
    vehicles: tuple[int, ...] | None
    """System ids in order; None for all of the mission."""
    plan_id: int | None = None
    """Of the proposal that is confirmed or rejected."""
    keep_out: KeepOut | None = None
    origin: str = ""
    """Who gave it, in words."""


@dataclass(frozen=True, slots=True)
class UploadAnswer:
    """What the program that uploads in our place says of one `Upload`."""

    t_ns: int
    vehicle: int
    mission_id: int
    ok: bool
    begun: bool
    """Whether the vehicle may have begun to change what it stores."""
    detail: str


Aside: TypeAlias = Literal["hold", "return", "found"]
"""Why a vehicle is not tasked: ordered to hold or to return, or found with a mission of somebody else's."""


@dataclass(frozen=True, slots=True)
class CustodyMemory:
    """Who chose the mode that a vehicle was in (`gcs.mavlink.custody`)."""

    mode: str
    taken: str
    ordered: str
    tasked: bool


@dataclass(frozen=True, slots=True)
class GuestMission:
    """A mission that another ground station writes, or wrote, to a vehicle of ours."""

    system_id: int
    """The station's."""
    component_id: int
    words: str
    """Who that is, to be shown."""
    ended: bool
    """Whether the upload had an end: it was taken, refused, or broke off."""


@dataclass(frozen=True, slots=True)
class VehicleMemory:
    """What the service knew of one vehicle."""

    fate: Fate
    aside: Aside | None
    route: Route | None
    """What it flies; of a vehicle that is set aside, what it flew."""
    items: tuple[tuple[float | None, ...], ...]
    """Mission items that it stores, by the last read-back; none when that is not known. None is NaN."""
    first_point: int
    """Number of the item that is the route's first point."""
    unsure: bool
    """Whether a transfer was under way, or left a mix behind: it may hold one."""
    custody: CustodyMemory | None = None
    """None in what was written before this was remembered."""
    guest: GuestMission | None = None
    """Whose mission it holds, when not ours."""


@dataclass(frozen=True, slots=True)
class Memory:
    """What a service must know to take up where an earlier one was."""

    t_ns: int
    missions: int
    """Missions that were made so far."""
    plans: int
    """Number of the last plan that was put to an operator."""
    ended: bool
    vehicles: tuple[VehicleMemory, ...]
    targets: tuple[Track, ...]
    """Believed then."""
    keep_outs: tuple[KeepOut, ...]


@dataclass(frozen=True, slots=True)
class Resumed:
    """The service was started anew and takes up where an earlier one was."""

    t_ns: int
    memory: Memory


Event: TypeAlias = Datagram | Scan | Tick | BadInput | LinkNews | Order | UploadAnswer | Resumed


# ---------------------------------------------------------------- the picture


@dataclass(frozen=True, slots=True)
class Track:
    """One object as a tracker sees it."""

    label: Label
    mean: FloatArray
    """(4,) east_m, north_m, v_east_m_s, v_north_m_s."""
    cov: FloatArray
    """(4, 4)."""
    existence: float
    """Existence probability in [0, 1] of this label."""
    estimated: bool = False
    """Whether it is in the MAP-cardinality estimate: the best hypothesis of the most probable number.
    An object whose label is ambiguous (born at one scan or at the next?) is in it once, however its
    existence is shared out."""


@dataclass(frozen=True, slots=True)
class Picture:
    """All tracks of one kind after one scan."""

    t_ns: int
    scan_t_ns: int
    kind: Kind
    tracks: tuple[Track, ...]
    """Ordered by label."""
    cardinality: FloatArray
    """(n + 1,) probability of each number of objects."""


@dataclass(frozen=True, slots=True)
class VehicleState:
    """What a vehicle last said of itself over MAVLink."""

    system_id: int
    t_ns: int
    """When its last position report arrived."""
    east_m: float
    north_m: float
    alt_msl_m: float
    ground_speed_m_s: float
    course_rad: float
    mode: str
    """Mode name of its autopilot, such as AUTO or LOITER; empty before the first heartbeat."""
    armed: bool
    mission_seq: int
    """Item that it flies to, -1 when unknown."""


# ---------------------------------------------------------------- plans and missions


@dataclass(frozen=True, slots=True)
class Waypoint:
    """One place to fly to."""

    lat_deg: float
    lon_deg: float
    alt_rel_m: float
    accept_radius_m: float


@dataclass(frozen=True, slots=True)
class Mission:
    """Waypoints for one vehicle, home excluded."""

    mission_id: int
    vehicle: int
    waypoints: tuple[Waypoint, ...]
    loiter_radius_m: float = 0.0
    """Of the circle at the last waypoint; 0 leaves it to the autopilot."""
    end: Literal["loiter", "land"] = "loiter"
    """Circle at the last waypoint, or go home from there and land."""


@dataclass(frozen=True, slots=True)
class Route:
    """A way for one vehicle to one target."""

    vehicle: int
    target: Label
    points_m: FloatArray
    """(k, 2) east/north, the vehicle's position excluded, the target's included."""
    length_m: float
    """From the vehicle's position along the points."""
    lane: int = 0
    """Altitude lane, from 0, the lowest (see `gcs.planning.separation`)."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Who flies where, and why this was decided."""

    t_ns: int
    picture_t_ns: int
    routes: tuple[Route, ...]
    """Ordered by vehicle."""
    unassigned_vehicles: tuple[int, ...]
    unassigned_targets: tuple[Label, ...]
    reason: str
    changed: tuple[int, ...] = ()
    """Vehicles whose route differs from what they fly now: only these get a new mission."""


# ---------------------------------------------------------------- effects: what comes out of the fold


@dataclass(frozen=True, slots=True)
class Send:
    """Bytes for a peer of a link."""

    link: str
    peer: str
    data: bytes


@dataclass(frozen=True, slots=True)
class Upload:
    """A mission that another program is to upload; `UploadAnswer` says how that went."""

    vehicle: int
    mission_id: int
    frames: bytes
    """MISSION_ITEM_INT frames, in order, one behind the other."""


@dataclass(frozen=True, slots=True)
class UploadReport:
    """How one mission transfer ended."""

    t_ns: int
    vehicle: int
    mission_id: int
    items: int
    ok: bool
    detail: str
    """Why it failed, or how it went: "verified by read-back"."""
    duration_s: float
    retries: int


@dataclass(frozen=True, slots=True)
class Notice:
    """Something an operator should know."""

    t_ns: int
    level: Level
    text: str
    vehicle: int | None = None


@dataclass(frozen=True, slots=True)
class Fate:
    """What became of an agent, as central command sees it from measurements."""

    t_ns: int
    vehicle: int
    fate: Literal["flying", "arrived", "dead"]
    target: Label | None = None
    position_m: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class MissionEnded:
    """Every agent has arrived, is dead, or is left over when every target has what it needs."""

    t_ns: int
    arrived: tuple[int, ...]
    dead: tuple[int, ...]
    spare: tuple[int, ...] = ()


AnswerState: TypeAlias = Literal["accepted", "done", "refused", "failed"]


@dataclass(frozen=True, slots=True)
class OrderAnswer:
    """What became of an order: first whether it is taken, then how it went for each vehicle."""

    t_ns: int
    order_id: str
    action: Action
    state: AnswerState
    """"accepted": under way; "done": the vehicle itself shows it; "refused": nothing was done; "failed"."""
    detail: str
    vehicle: int | None = None
    """None: about the order as a whole."""
    waiting: tuple[int, ...] = ()
    """Vehicles whose answer is still to come; the order is over when nobody is left."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A plan that waits for an operator's word; without routes: nothing waits any more."""

    t_ns: int
    plan_id: int
    """Counts up: a newer proposal replaces the one before, and its id with it."""
    routes: tuple[Route, ...]
    """Those that are not flown until they are confirmed, ordered by vehicle."""
    reason: str


Effect: TypeAlias = (
    Send | Upload | Picture | Plan | UploadReport | Notice | Fate | MissionEnded | OrderAnswer | Proposal
)


# ---------------------------------------------------------------- truth: known to a simulation alone


@dataclass(frozen=True, slots=True)
class TruthObject:
    """One real object of a simulated world."""

    kind: Kind
    id: int
    """System id of an agent, index of a target."""
    east_m: float
    north_m: float
    alive: bool


@dataclass(frozen=True, slots=True)
class Truth:
    """The simulated world at the moment of one scan. Central command never sees it; the judge does."""

    t_ns: int
    objects: tuple[TruthObject, ...] = field(default_factory=tuple)
