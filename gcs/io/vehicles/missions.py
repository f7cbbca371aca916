"""Mission of one vehicle over a link of its own: upload, read-back, selection and start."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from gcs.endpoints import Link, parse_endpoint
from gcs.errors import LinkError
from gcs.geo import LocalFrame
from gcs.io.vehicles.session import NOT_HEARD, VehicleSession
from gcs.io.vehicles.vehicle_access import VehicleAccess
from gcs.mavlink.autopilots import AutopilotProfile, profile_of
from gcs.mavlink.fleet.mode_authority import ModeAuthority
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.mavlink.mission.upload import Upload
from gcs.mavlink.mission.upload_kinds import mission_upload
from gcs.mavlink.mission.upload_limits import UploadPolicy
from gcs.mavlink.mission.upload_stages import Event, UploadResult
from gcs.mavlink.mission.upload_state import UploadState
from gcs.model import NS_PER_S, Mission, Waypoint

_MAX_UPLOAD_S = 900.0
"""Every upload has ended before, by its own limits."""


class MissionTask:
    """Upload of one mission, from the first heartbeat of its vehicle on.

    Parameters
    ----------
    encode : callable
        Message to frame for this vehicle.
    resume : bool
        True to upload also in another mode than AUTO and LOITER.
    """

    def __init__(self, mission: Mission, encode: Callable[[Message], bytes], *, resume: bool) -> None:
        self.vehicle = mission.vehicle
        self.problem = ""
        """Why no upload began; empty if there is no reason."""
        self._mission = mission
        self._encode = encode
        self._resume = resume
        self._authority = ModeAuthority()
        self._profile: AutopilotProfile | None = None
        self._upload: Upload | None = None

    @property
    def result(self) -> UploadResult | None:
        """Result of the upload; None before its end."""
        return None if self._upload is None else self._upload.result

    @property
    def is_done(self) -> bool:
        """True if it has ended."""
        return bool(self.problem) or self.result is not None

    def give_up_silent(self) -> None:
        """End the task if the vehicle was not heard."""
        if self._profile is None and not self.problem:
            self.problem = NOT_HEARD

    def poll(self, t_ns: int) -> list[bytes]:
        """Advance the timers; return the frames to send, none before the first heartbeat."""
        if self._profile is None or self.is_done:
            return []
        if self._upload is not None:
            return self._upload.poll(t_ns)
        if self._authority.taken_by:
            if not self._resume:
                mode = self._authority.taken_by
                self.problem = f"is in {mode}: expected AUTO or LOITER; resume=True uploads all the same"
                return []
            self._authority.release(t_ns)
        first = self._mission.waypoints[0]
        home = Home(first.lat_deg, first.lon_deg, 0.0)  # an ArduPlane keeps its own
        items = build_items(self._profile, self._mission, home)
        state = UploadState.of_mission(self._mission, items, self._profile)
        self._upload = mission_upload(state, self._encode, self._authority, UploadPolicy())
        return self._upload.order(Event.START, t_ns)

    def receive(self, message: Message, t_ns: int) -> list[bytes]:
        """Process a message of the vehicle; return the frames to send."""
        if self._upload is not None:
            return self._upload.receive(message, t_ns)
        if message.get_type() == "HEARTBEAT":
            self._profile = profile_of(message.autopilot, message.type)
            if self._profile is None:
                self.problem = "is no fixed wing with ArduPlane or PX4"
            else:
                self._authority.observe_heartbeat(message, self._profile, t_ns, at_end=False)
        return []


def upload_mission(
    endpoint: str,
    system_id: int,
    waypoints: ArrayLike,
    *,
    accept_radius_m: float = 40.0,
    loiter_radius_m: float = 0.0,
    resume: bool = False,
    heard_within_s: float = 10.0,
) -> UploadResult:
    """Upload a mission to one vehicle, read it back, select its first item and command AUTO.

    The vehicle flies the waypoints and loiters at the last one. It is never armed. If it flies a mission now,
    it gets LOITER first. The call blocks until the upload has ended, which every upload does; in a notebook
    or coroutine: ``await asyncio.to_thread(upload_mission, ...)``.

    Parameters
    ----------
    endpoint : str
        ``udpin:HOST:PORT``, ``udpout:HOST:PORT``, ``tcp:HOST:PORT`` or ``serial:/dev/DEVICE:BAUD``.
    system_id : int
        System id of the vehicle.
    waypoints : (k, 3) array
        Latitude and longitude in degrees, and height above home in metres.
    accept_radius_m : float
        Distance at which a waypoint is reached.
    loiter_radius_m : float
        Radius at the last waypoint; 0: the autopilot's own.
    resume : bool
        True to upload also to a vehicle in another mode than AUTO and LOITER, such as MANUAL after its boot.
        A pilot who chose that mode loses control.
    heard_within_s : float
        Time in which the vehicle must be heard.

    Returns
    -------
    UploadResult
        `ok` is True if the mission was read back equal and is flown; `detail` says what failed; `items` are
        those of the last read-back, on ArduPlane with home as item 0.

    Raises
    ------
    ValueError
        The waypoints have another shape or range.
    LinkError
        The endpoint cannot be used, or the vehicle is not heard, has another firmware or another mode.
    """
    points = _waypoints(waypoints, accept_radius_m)
    mission = Mission(1, system_id, points, loiter_radius_m)
    access = VehicleAccess((Link(parse_endpoint(endpoint)),))
    session = VehicleSession([system_id], LocalFrame(points[0].lat_deg, points[0].lon_deg, 0.0), access)
    task = MissionTask(mission, session.fleet.encoder(system_id), resume=resume)
    deadline_t_ns = session.now_ns() + int(heard_within_s * NS_PER_S)

    def check_heard() -> None:
        if session.now_ns() > deadline_t_ns:
            task.give_up_silent()

    asyncio.run(session.run([task], _MAX_UPLOAD_S + heard_within_s, check_heard))
    if task.result is None:
        raise LinkError(endpoint, f"vehicle {system_id} {task.problem or 'did not end its upload'}")
    return task.result


def _waypoints(waypoints: ArrayLike, accept_radius_m: float) -> tuple[Waypoint, ...]:
    rows = np.asarray(waypoints, np.float64)
    if rows.ndim != 2 or rows.shape[1] != 3 or not len(rows):
        raise ValueError(
            "waypoints: expected shape (k, 3) with at least one row: latitude and longitude in degrees, "
            f"height above home in metres; got {rows.shape}"
        )
    if not (np.isfinite(rows).all() and (abs(rows[:, 0]) <= 90.0).all() and (abs(rows[:, 1]) <= 180.0).all()):
        raise ValueError(
            "waypoints: expected latitudes of -90 to 90, longitudes of -180 to 180, finite heights"
        )
    if not 0.0 < accept_radius_m < math.inf:
        raise ValueError(f"accept_radius_m: expected metres above 0, got {accept_radius_m}")
    return tuple(Waypoint(lat, lon, alt_m, accept_radius_m) for lat, lon, alt_m in rows.tolist())
