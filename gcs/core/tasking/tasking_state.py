"""State of tasking: queued and active uploads, onboard missions."""

from __future__ import annotations

from dataclasses import dataclass, field

from pymavlink.dialects.v20.ardupilotmega import MAV_CMD_NAV_LOITER_UNLIM

from gcs.core.tasking.upload_pauses import ClearingRetry, RejectionRetry, UploadRetry
from gcs.core.tasking.upload_window import UploadWindow
from gcs.mavlink.mission.items import Item
from gcs.mavlink.mission.upload_state import UploadState
from gcs.model import NS_PER_S, Route
from gcs.planning.forward_simulation import LoiterCircle
from gcs.planning.manoeuvres.landing import ReturnRoute

NO_MISSION = -1
"""Instead of a mission number."""


@dataclass(frozen=True, slots=True)
class OnboardMission:
    """Onboard mission of one vehicle, by the last read-back."""

    route: Route
    items: tuple[Item, ...]
    first_point: int
    """Number of the item that is the route's first point."""
    mission_id: int = 0
    """Number of the mission; 0 if it was uploaded before a restart."""
    takeoff_m: tuple[float, float] | None = None
    """East and north of the place from which it takes off; None if it begins in flight."""

    @property
    def circle(self) -> LoiterCircle | None:
        """Loiter circle at the end; None if the autopilot sets the radius, or the vehicle lands."""
        radius_m = self.items[-1].param3 if self.items[-1].command == MAV_CMD_NAV_LOITER_UNLIM else 0.0
        east_m, north_m = self.route.flown_m[-1].tolist()
        return LoiterCircle((east_m, north_m), radius_m) if radius_m > 0.0 else None


@dataclass(frozen=True, slots=True)
class QueuedRoute:
    """A route that waits for its upload."""

    route: Route
    planned_t_ns: int
    until_t_ns: int
    """End of the wait for an item."""
    at_once: bool
    return_route: ReturnRoute | None
    begins_t_ns: int = 0
    """Begin of its upload as planned."""


@dataclass(slots=True)
class ActiveUpload:
    """An upload in progress."""

    state: UploadState
    link: str
    onboard: OnboardMission | None
    """Onboard mission after success; None while an inconsistent mission is cleared."""
    planned_t_ns: int
    """Time at which its route was planned."""


@dataclass(slots=True)
class FirstLeg:
    """The first leg of one vehicle's new mission."""

    seq: int
    item_m: tuple[float, float]
    """Position of its item, east and north."""
    began_t_ns: int
    next_t_ns: int
    """Time of the next request for samples."""
    problem: str = ""
    """Error of the newest sample in words; empty if there is none."""
    has_sample: bool = False
    """True if the newest sample has not been counted yet."""
    off: int = 0
    """Consecutive wrong samples."""
    corrections: int = 0
    """Times that the leg was started again."""


@dataclass(slots=True)
class RouteEnd:
    """End of a route that a vehicle has passed without having reached its target."""

    since_t_ns: int | None = None
    """Time since when it has passed the end; None if it has not."""
    mission_id: int = NO_MISSION
    """Number of the mission with this route."""
    reported_id: int | None = None
    """Number of the last mission that was reported; None before the first."""
    has_missed: bool = False
    """True if the mission does not lead back to the target."""


@dataclass(slots=True)
class AgentTasking:
    """Missions of one vehicle: queued, uploading, on board."""

    onboard: OnboardMission | None = None
    """Onboard mission by the last read-back; None if it is unknown."""
    is_selected: bool = True
    """False while the vehicle still counts items of the mission before."""
    is_inconsistent: bool = False
    """True if the onboard mission may be inconsistent: the vehicle is held and cleared when it is heard."""
    boots: int = 0
    """Reboots that have been processed."""
    before_boot: OnboardMission | None = None
    """Mission that the vehicle stored before it rebooted outside an upload, until its audit begins."""
    refusal: str = ""
    """Kind of the problem for which the newest mission was refused."""
    retry: UploadRetry = field(default_factory=UploadRetry)
    clearing: ClearingRetry = field(default_factory=ClearingRetry)
    rejections: RejectionRetry = field(default_factory=RejectionRetry)
    route_end: RouteEnd = field(default_factory=RouteEnd)
    usual_upload_s: float | None = None
    """Estimated duration of an upload; None before the first one."""

    def pop_before_boot(self) -> OnboardMission | None:
        """Return, once, the mission that the vehicle stored before it rebooted outside an upload."""
        mission = self.before_boot
        self.before_boot = None
        return mission


@dataclass(slots=True)
class TaskingState:
    """Uploads over each link."""

    mission_count: int = 0
    """Number of missions made so far."""
    queue: dict[int, QueuedRoute] = field(default_factory=dict)
    """By vehicle, the longest waiting first."""
    uploads: dict[int, ActiveUpload] = field(default_factory=dict)
    """Uploads in progress by vehicle, in order of their begin."""
    first_legs: dict[int, FirstLeg] = field(default_factory=dict)
    """Monitored first legs by vehicle, in order of their begin."""
    windows: dict[str, UploadWindow] = field(default_factory=dict)
    """By link."""

    @property
    def stages(self) -> dict[int, str]:
        """Stage of each upload, by vehicle; "waiting" for queued routes."""
        return {vehicle: self.stage(vehicle) for vehicle in self.queue | self.uploads}

    def stage(self, vehicle: int) -> str:
        """Return the stage of an upload, "waiting" for a queued route; empty if there is neither."""
        upload = self.uploads.get(vehicle)
        if upload is not None:
            return upload.state.now.stage
        return "waiting" if vehicle in self.queue else ""

    def elapsed_s(self, vehicle: int, t_ns: int) -> float | None:
        """Return the time since an upload began; None if there is none."""
        upload = self.uploads.get(vehicle)
        return None if upload is None else (t_ns - upload.state.began_t_ns) / NS_PER_S

    def is_uploading(self, vehicle: int) -> bool:
        """Return True if a mission is being uploaded to a vehicle, and not merely queued or cleared."""
        upload = self.uploads.get(vehicle)
        return upload is not None and upload.onboard is not None

    def has_pending(self, vehicle: int) -> bool:
        """Return True if a mission is queued or being uploaded."""
        return vehicle in self.queue or self.is_uploading(vehicle)
