"""Geofence and rally points of vehicles: a session that uploads, reads or clears them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import Literal, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import Config
from gcs.fence import fence_of, rally_of
from gcs.io.vehicles.session import NOT_HEARD, VehicleSession
from gcs.mavlink.autopilots import profile_of
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.mission.geofence_rally import (
    FENCE,
    LIST_NAMES,
    RALLY,
    fence_from_items,
    fence_items,
    rally_items,
)
from gcs.mavlink.mission.items import Item
from gcs.mavlink.mission.upload import Upload
from gcs.mavlink.mission.upload_kinds import list_upload
from gcs.mavlink.services.parameter_protocol import ParameterSetter, is_bytewise

Action: TypeAlias = Literal["upload", "show", "clear"]


class FenceTask:
    """Fence, rally points and ceiling of one vehicle, one after the other.

    Parameters
    ----------
    lists : dict of int to sequence of Item, or None
        Items to upload by MAV_MISSION_TYPE; None only reads.
    ceiling_m : float
        Ceiling to set; 0 for none.
    own : (int, int)
        Our system and component id.
    not_sent : int
        Number of areas that are not uploaded, since missions pass above or below them.
    """

    def __init__(
        self,
        vehicle: int,
        lists: dict[int, Sequence[Item] | None],
        ceiling_m: float,
        encode: Callable[[Message], bytes],
        own: tuple[int, int],
        not_sent: int = 0,
    ) -> None:
        self.vehicle = vehicle
        self._not_sent = not_sent
        self._own = own
        self._todo = lists
        self._ceiling_m = ceiling_m
        self._encode = encode
        self._tasks: list[Upload] = []
        self._ceiling: ParameterSetter | None = None
        self._autopilot: tuple[int, int] | None = None

    @property
    def is_done(self) -> bool:
        """True if all steps have ended."""
        lists = len(self._tasks) == len(self._todo) and self._tasks[-1].result is not None
        return lists and (
            not self._has_ceiling or (self._ceiling is not None and self._ceiling.outcome is not None)
        )

    @property
    def ok(self) -> bool:
        """True if all steps succeeded."""
        return self.is_done and all(ok for _, ok, _ in self.rows())

    @property
    def _has_ceiling(self) -> bool:
        return self._ceiling_m > 0.0

    def rows(self) -> list[tuple[str, bool, str]]:
        """Return (step, True if it succeeded, detail) of each step."""
        if not self._tasks:
            return [("link", False, NOT_HEARD)]
        rows = []
        for task in self._tasks:
            result = task.result
            name = LIST_NAMES[task.mission_type]
            if result is None:
                rows.append((name, False, "not finished in time: the stored list is unknown"))
            else:
                detail = f"{result.detail}{_described(task, result.items)}"
                if self._not_sent and task.mission_type == FENCE:
                    detail += (
                        f"; {self._not_sent} areas with heights are not sent: missions pass above or below"
                    )
                rows.append((name, result.ok, detail))
        if self._ceiling is not None:
            rows.append(("ceiling", *(self._ceiling.outcome or (False, "not finished in time"))))
        return rows

    def poll(self, t_ns: int) -> list[bytes]:
        """Advance the timers; return the frames to send, none before the first heartbeat."""
        if self._autopilot is None or self.is_done:
            return []
        if not self._tasks or (self._tasks[-1].result is not None and len(self._tasks) < len(self._todo)):
            mission_type = list(self._todo)[len(self._tasks)]
            items = self._todo[mission_type]
            self._tasks.append(
                list_upload(self.vehicle, mission_type, items, self._encode, t_ns, own=self._own)
            )
        if self._tasks[-1].result is None:
            return self._tasks[-1].poll(t_ns)
        profile = profile_of(*self._autopilot)
        if self._has_ceiling and self._ceiling is None:
            name = "" if profile is None else profile.ceiling_parameter
            bytewise = is_bytewise(self._autopilot[0], None)
            self._ceiling = ParameterSetter(self.vehicle, name, self._ceiling_m, bytewise, self._encode)
        return [] if self._ceiling is None else self._ceiling.poll(t_ns)

    def receive(self, message: Message, t_ns: int) -> list[bytes]:
        """Process a message of the vehicle; return the frames to send."""
        if message.get_type() == "HEARTBEAT":
            self._autopilot = (message.autopilot, message.type)
        if self._ceiling is not None:
            self._ceiling.receive(message)
        return self._tasks[-1].receive(message, t_ns) if self._tasks else []


def fence_vehicles(
    config: Config, source: str, action: Action, vehicles: Sequence[int], wait_s: float, link: str | None
) -> list[FenceTask]:
    """Carry out one action on vehicles of a mission; return the task of each vehicle.

    Raises
    ------
    ConfigError, LinkError
        The fence is invalid, or a port cannot be opened.
    """
    fence = fence_of(config, source)
    rally = rally_of(config)
    lists: dict[int, Sequence[Item] | None] = {FENCE: (), RALLY: ()}
    if action == "upload":
        lists = {FENCE: fence_items(fence), RALLY: rally_items(rally)}
    elif action == "show":
        lists = {FENCE: None, RALLY: None}
    ceiling_m = fence.max_alt_rel_m if action == "upload" else 0.0
    session = VehicleSession.of_mission(
        config,
        source,
        [dialect.MAVLINK_MSG_ID_PARAM_VALUE],
        link,
        writes=action != "show",
    )
    not_sent = len(fence.passed) if action == "upload" else 0
    own = session.access.own
    tasks = [FenceTask(v, lists, ceiling_m, session.fleet.encoder(v), own, not_sent) for v in vehicles]
    asyncio.run(session.run(tasks, wait_s))
    return tasks


def _described(task: Upload, held: Sequence[Item] | None) -> str:
    if not held:
        return ""
    if task.mission_type == RALLY:
        return ": " + "; ".join(f"{i.x * 1e-7:.6f}°, {i.y * 1e-7:.6f}° at {i.z_m:.0f} m" for i in held)
    fence = fence_from_items(held)
    if fence is None:
        return ": no fence that can be read"
    shapes = [
        f"{'inside' if area.stay_in else 'outside'} "
        + (f"{len(area.corners_deg)} corners" if area.corners_deg else f"a circle of {area.radius_m:g} m")
        for area in fence.areas
    ]
    return ": stay " + ", ".join(shapes)
