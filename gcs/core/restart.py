"""Taking up where an earlier service was, from its memory and from what vehicles and sensors show now.

Memory alone decides nothing:

* A vehicle flies its remembered route when its mission reads back equal; then nothing is uploaded again. One
  that stores another mission was given it by somebody else: it is set aside and the operator is told. One
  that does not answer may hold anything, and is not tasked before it does
  (`gcs.core.authority.onboard_audit`). One whose transfer was under way, or left a mix behind, may hold one:
  it is told to hold, and planned for anew.
* A vehicle that somebody took, by choosing its mode or by writing a mission to it, stays theirs.
* Targets are expected where they were believed to be and must be seen there again; their tracks get new
  labels, and the remembered routes follow them. A target that was reached stays reached.
* Plans that waited for a word are made anew, under higher numbers: the picture has changed.

No plan is made before this has ended, which is bounded in time.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from gcs.core.authority.external_uploads import ExternalUploads
from gcs.core.authority.onboard_audit import OnboardAudit
from gcs.core.operator.replies import named
from gcs.core.operator.vehicle_orders import Orders
from gcs.core.perception.agent_status import AgentStatusMonitor
from gcs.core.perception.fusion import MultiSensorTracker
from gcs.core.replanning.replanner import Replanner
from gcs.core.tasking.onboard_missions import OnboardMission
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.autopilots.modes import AUTO
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.mission.items import Item
from gcs.model import NS_PER_S, Effect, Label, Notice, PersistedState, PersistedVehicle, Resumed, Route, Track

_LONGEST_S: Final = 25.0
"""After this a plan is made with what is known."""
_PATIENT_S: Final = 8.0
"""So long for agents and targets that no verified route is about."""
_GATE_CHI2: Final = 13.8
"""On the squared normalised distance of a target from where it should be: 99.9 % of two dimensions."""
_FAR_M: Final = 1e9


class Restart:
    """What is left to be found out after a restart.

    Parameters
    ----------
    fleet, tasking, replanner, orders, agent_status, trackers, external_uploads, onboard_audit
        The parts of the fold that remember, and are reminded.
    """

    def __init__(
        self,
        fleet: Fleet,
        tasking: UploadManager,
        replanner: Replanner,
        orders: Orders,
        agent_status: AgentStatusMonitor,
        trackers: MultiSensorTracker,
        external_uploads: ExternalUploads,
        onboard_audit: OnboardAudit,
    ) -> None:
        self._fleet, self._tasking, self._replanner = fleet, tasking, replanner
        self._orders, self._agent_status, self._trackers, self._external_uploads = (
            orders,
            agent_status,
            trackers,
            external_uploads,
        )
        self._onboard_audit = onboard_audit
        self._verified: dict[int, Route] = {}
        self._asked: set[int] = set()
        """Vehicles whose routes are taken up when they still hold them."""
        self._was: dict[int, Label] = {}
        self._known: dict[Label, Label] = {}
        self._reached: dict[int, Label] = {}
        self._expected: tuple[int, tuple[Track, ...]] = (0, ())
        self._until_t_ns: int | None = None

    # ------------------------------------------------------------ remembering

    def vehicles(self) -> tuple[PersistedVehicle, ...]:
        """Return what is to be remembered of every vehicle."""
        return tuple(self._memory(vehicle) for vehicle in self._agent_status.by_vehicle)

    def targets(self, t_ns: int, believed: Mapping[Label, Track]) -> tuple[Track, ...]:
        """Return the targets that are to be remembered: until they are seen again, where they should be."""
        if self._until_t_ns is None:
            return tuple(track for _, track in sorted(believed.items()))
        then_t_ns, expected = self._expected
        return self._trackers.moved_on(expected, (t_ns - then_t_ns) / NS_PER_S)

    def _memory(self, vehicle: int) -> PersistedVehicle:
        asked = self._onboard_audit.flown(vehicle)  # not known yet: still what was remembered
        flown = asked or self._tasking.onboard(vehicle)
        wanted = (self._replanner.routes, self._orders.suspended_routes, self._verified)
        route = next((routes[vehicle] for routes in wanted if vehicle in routes), None)
        unsure = self._tasking.may_be_inconsistent(vehicle)
        spare = route is None and vehicle not in self._asked
        if flown is not None and (asked is not None or (spare and not unsure)):
            route = flown.route
        if flown is None or flown.route is not route:
            flown = None
        status = self._agent_status.by_vehicle[vehicle]
        return PersistedVehicle(
            status=replace(status, target=self._reached.get(vehicle, status.target)),
            suspension=self._orders.suspensions.get(vehicle),
            route=route,
            items=() if flown is None or unsure else tuple(_row(item) for item in flown.items),
            first_point=1 if flown is None else flown.first_point,
            may_be_inconsistent=unsure,
            authority=self._tasking.persisted_authority(vehicle),
            external_mission=self._external_uploads.persisted(vehicle),
            is_obsolete=spare,
        )

    # ------------------------------------------------------------ being reminded

    def begin(self, event: Resumed) -> list[Effect]:
        """Take the memory; returns what the operator should know."""
        memory, t_ns = event.state, event.t_ns
        age_s = max(0.0, (t_ns - memory.t_ns) / NS_PER_S)
        self._was = self._trackers.expect(memory.targets, age_s)
        self._expected = memory.t_ns, memory.targets
        self._tasking.resume_count(memory.mission_count)
        self._until_t_ns = t_ns + round(_LONGEST_S * NS_PER_S)
        effects: list[Effect] = []
        known = set(self._agent_status.by_vehicle)
        text = f"takes up where it was {age_s:.0f} s ago: {_contents(memory, known)}"
        text += "; to begin clean, end it and start it with --no-resume"
        effects.append(Notice(t_ns, "warning", text))
        for one in memory.vehicles:
            vehicle = one.status.vehicle
            if vehicle not in known:
                continue
            if one.status.target is not None:  # labels of then mean nothing now
                self._reached[vehicle] = one.status.target
            self._agent_status.by_vehicle[vehicle] = replace(one.status, target=None)
            if one.suspension is not None:
                self._orders.suspensions[vehicle] = one.suspension
            if one.authority is not None:
                self._tasking.restore_authority(vehicle, one.authority)
            if one.external_mission is not None:
                self._external_uploads.restore(vehicle, one.external_mission, t_ns)
                station = one.external_mission.station
                text = f"has a mission of {station} and stays theirs until it is ordered to resume"
                effects.append(Notice(t_ns, "warning", text, vehicle))
            if one.may_be_inconsistent:
                self._tasking.mark_inconsistent(vehicle)
                text = "was being given a mission, or left with a part of one: it may hold a mix"
                effects.append(Notice(t_ns, "warning", text, vehicle))
            elif one.items and one.route is not None and one.status.status == "active":
                flown = OnboardMission(one.route, tuple(_item(row) for row in one.items), one.first_point)
                if not one.is_obsolete:
                    self._asked.add(vehicle)
                self._onboard_audit.begin(flown, t_ns, self._take_up, known_t_ns=memory.t_ns)
        return effects

    @property
    def is_under_way(self) -> bool:
        """True if who flies what is still being found out."""
        return self._until_t_ns is not None or self._onboard_audit.hurries

    def _take_up(self, flown: OnboardMission) -> None:
        """Take up the route of a vehicle that flies it."""
        vehicle = flown.route.vehicle
        if vehicle in self._asked and self._until_t_ns is not None:
            self._verified[vehicle] = flown.route
        self._asked.discard(vehicle)

    # ------------------------------------------------------------ the end of it

    def is_waiting(self, t_ns: int, agents: Container[int], targets: Mapping[Label, Track]) -> bool:
        """Whether it is too early to plan: who flies what, or where targets are, is still being found out."""
        if self._until_t_ns is None:
            return False
        seen = set(self._recognised(t_ns, targets).values())
        flown = all(r.target in seen and v in agents for v, r in self._verified.items())
        rest = all(v in agents for v in self._agent_status.active()) and seen >= set(self._was.values())
        left_s = (self._until_t_ns - t_ns) / NS_PER_S
        if left_s > 0.0 and (
            self._onboard_audit.hurries or not flown or (not rest and left_s > _LONGEST_S - _PATIENT_S)
        ):
            return True
        self._finish(t_ns, targets)
        return False

    def _recognised(self, t_ns: int, targets: Mapping[Label, Track]) -> dict[Label, Label]:
        """Labels before the restart of targets seen now: by place of birth, the others by nearness."""
        known = {label: self._was[label[1]] for label in targets if label[1] in self._was}
        then_t_ns, tracks = self._expected
        moved_on = self._trackers.moved_on(tracks, (t_ns - then_t_ns) / NS_PER_S)
        expected = [track for track in moved_on if track.label not in known.values()]
        seen = [track for label, track in sorted(targets.items()) if label not in known]
        if expected and seen:
            offset = np.array([[e.mean[:2] - s.mean[:2] for s in seen] for e in expected])
            S = np.array([[e.cov[:2, :2] + s.cov[:2, :2] for s in seen] for e in expected])
            d2 = np.einsum("ijk,ijkl,ijl->ij", offset, np.linalg.inv(S), offset)
            away_m = np.where(d2 <= _GATE_CHI2, np.hypot(offset[..., 0], offset[..., 1]), _FAR_M)
            for row, column in zip(*linear_sum_assignment(away_m), strict=True):
                if away_m[row, column] < _FAR_M:
                    known[seen[column].label] = expected[row].label
        return known

    def is_reached(self, label: Label) -> bool:
        """Whether a target that is seen now was reached before the restart."""
        return self._known.get(label, self._was.get(label[1])) in self._reached.values()

    def _finish(self, t_ns: int, targets: Mapping[Label, Track]) -> None:
        """Hand the routes over, with their targets under the labels that they have now."""
        self._until_t_ns = None
        self._known = self._recognised(t_ns, targets)
        now = {was: label for label, was in self._known.items()}
        for vehicle in [vehicle for vehicle, label in self._reached.items() if label in now]:
            target = now[self._reached.pop(vehicle)]
            self._agent_status.by_vehicle[vehicle] = replace(
                self._agent_status.by_vehicle[vehicle], target=target
            )
        routes = {v: replace(r, target=now[r.target]) for v, r in self._verified.items() if r.target in now}
        self._verified.clear()
        for vehicle, route in routes.items():
            flown = self._tasking.onboard(vehicle)
            if flown is not None:
                self._tasking.note_onboard(replace(flown, route=route))
        for vehicle in [vehicle for vehicle in routes if vehicle in self._orders.suspensions]:
            self._orders.suspended_routes[vehicle] = routes.pop(vehicle)
        for vehicle in [vehicle for vehicle in routes if not self._is_flown(vehicle)]:
            del routes[vehicle]  # it holds its mission and does not fly it: the next plan has another for it
        self._replanner.resume(t_ns, routes, targets)

    def _is_flown(self, vehicle: int) -> bool:
        """Whether a vehicle flies what it holds: an order may have let it go on from where it was held."""
        state = self._fleet.state(vehicle)
        return state is not None and state.mode == AUTO and vehicle not in self._orders.commanded


def _contents(memory: PersistedState, known: Container[int]) -> str:
    """Say what a memory holds of the vehicles that the mission has."""
    vehicles = [one for one in memory.vehicles if one.status.vehicle in known]
    groups = {
        "missions of {}": [
            one for one in vehicles if one.route is not None and one.status.status == "active"
        ],
        "{} at their targets": [one for one in vehicles if one.status.status == "arrived"],
        "{} lost, until they report and are tracked again": [
            one for one in vehicles if one.status.status == "lost"
        ],
        "{} suspended": [one for one in vehicles if one.suspension is not None],
    }
    parts = [text.format(named(o.status.vehicle for o in ones)) for text, ones in groups.items() if ones]
    parts.append(f"{len(memory.targets)} targets")
    if memory.no_fly_zones:
        parts.append("closed areas " + ", ".join(area.name for area in memory.no_fly_zones))
    return "; ".join(parts)


def _row(item: Item) -> tuple[float | None, ...]:
    return tuple(None if math.isnan(value) else float(value) for value in item)


def _item(row: tuple[float | None, ...]) -> Item:
    """Read an item back; whole numbers are integers again."""
    values = [math.nan if value is None else value for value in row]
    command, frame, x, y, z_m, param1, param2, param3, param4, autocontinue = values
    return Item(
        int(command), int(frame), int(x), int(y), z_m, param1, param2, param3, param4, int(autocontinue)
    )
