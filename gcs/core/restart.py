"""Restart: continuation from persisted state, checked against vehicles and sensors.

* A vehicle keeps its route if its onboard mission reads back equal; nothing is uploaded again. With another
  mission it is suspended. Without an answer it is not tasked (`gcs.core.authority.onboard_audit`). After an
  interrupted upload its mission may be inconsistent: it is held, cleared and planned for.
* An overridden vehicle stays overridden.
* Targets are expected where they were and must be confirmed again. Their tracks get new labels, and the kept
  routes follow these. A target that was reached stays reached.
* Proposed plans are made again, with higher numbers.

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

_MAX_WAIT_S: Final = 25.0
"""Maximum time until the first plan."""
_MAX_OTHERS_WAIT_S: Final = 8.0
"""Maximum wait for agents and targets without a verified route."""
_GATE_CHI2: Final = 13.8
"""Gate on the squared Mahalanobis distance of a target from its prediction: 99.9 % in two dimensions."""
_FAR_M: Final = 1e9


class Restart:
    """Collects the state to persist, and restores it."""

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
        self._audited: set[int] = set()
        """Vehicles that keep their route if their mission reads back equal."""
        self._expected_labels: dict[int, Label] = {}
        self._former_labels: dict[Label, Label] = {}
        self._reached: dict[int, Label] = {}
        self._expected: tuple[int, tuple[Track, ...]] = (0, ())
        self._until_t_ns: int | None = None

    # ------------------------------------------------------------ persisted state

    def vehicles(self) -> tuple[PersistedVehicle, ...]:
        """Return the persisted state of every vehicle."""
        return tuple(self._persisted(vehicle) for vehicle in self._agent_status.by_vehicle)

    def targets(self, t_ns: int, confirmed: Mapping[Label, Track]) -> tuple[Track, ...]:
        """Return the targets to persist; during a restart these are predictions."""
        if self._until_t_ns is None:
            return tuple(track for _, track in sorted(confirmed.items()))
        then_t_ns, expected = self._expected
        return self._trackers.predict_targets(expected, (t_ns - then_t_ns) / NS_PER_S)

    def _persisted(self, vehicle: int) -> PersistedVehicle:
        audited = self._onboard_audit.expected(vehicle)  # still the persisted mission
        onboard = audited or self._tasking.onboard(vehicle)
        wanted = (self._replanner.routes, self._orders.suspended_routes, self._verified)
        route = next((routes[vehicle] for routes in wanted if vehicle in routes), None)
        unsure = self._tasking.may_be_inconsistent(vehicle)
        is_obsolete = route is None and vehicle not in self._audited
        if onboard is not None and (audited is not None or (is_obsolete and not unsure)):
            route = onboard.route
        if onboard is None or onboard.route is not route:
            onboard = None
        status = self._agent_status.by_vehicle[vehicle]
        return PersistedVehicle(
            status=replace(status, target=self._reached.get(vehicle, status.target)),
            suspension=self._orders.suspensions.get(vehicle),
            route=route,
            items=() if onboard is None or unsure else tuple(_values(item) for item in onboard.items),
            first_point=1 if onboard is None else onboard.first_point,
            may_be_inconsistent=unsure,
            authority=self._tasking.overrides.persisted(vehicle),
            external_mission=self._external_uploads.persisted(vehicle),
            is_obsolete=is_obsolete,
        )

    # ------------------------------------------------------------ restoring

    def begin(self, event: Resumed) -> list[Effect]:
        """Restore persisted state; return notices."""
        state, t_ns = event.state, event.t_ns
        age_s = max(0.0, (t_ns - state.t_ns) / NS_PER_S)
        self._expected_labels = self._trackers.expect(state.targets, age_s)
        self._expected = state.t_ns, state.targets
        self._tasking.mission_count = state.mission_count
        self._until_t_ns = t_ns + round(_MAX_WAIT_S * NS_PER_S)
        effects: list[Effect] = []
        known = set(self._agent_status.by_vehicle)
        text = f"continues from its state {age_s:.0f} s ago: {_contents(state, known)}"
        text += "; for a new flight, end the service and start it with --no-resume"
        effects.append(Notice(t_ns, "warning", text))
        for one in state.vehicles:
            vehicle = one.status.vehicle
            if vehicle not in known:
                continue
            if one.status.target is not None:  # old labels are meaningless now
                self._reached[vehicle] = one.status.target
            self._agent_status.by_vehicle[vehicle] = replace(one.status, target=None)
            if one.suspension is not None:
                self._orders.suspensions[vehicle] = one.suspension
            if one.authority is not None:
                self._tasking.overrides.of(vehicle).restore(one.authority)
            if one.external_mission is not None:
                self._external_uploads.restore(vehicle, one.external_mission, t_ns)
                station = one.external_mission.station
                text = f"has a mission of {station} and stays overridden until it is ordered to resume"
                effects.append(Notice(t_ns, "warning", text, vehicle))
            if one.may_be_inconsistent:
                self._tasking.mark_inconsistent(vehicle)
                text = "had an upload in progress, or a part of one: its onboard mission may be inconsistent"
                effects.append(Notice(t_ns, "warning", text, vehicle))
            elif one.items and one.route is not None and one.status.status == "active":
                onboard = OnboardMission(one.route, tuple(_item(row) for row in one.items), one.first_point)
                if not one.is_obsolete:
                    self._audited.add(vehicle)
                self._onboard_audit.begin(onboard, t_ns, self._note_verified, known_t_ns=state.t_ns)
        return effects

    @property
    def is_under_way(self) -> bool:
        """True while the state of vehicles is still being verified."""
        return self._until_t_ns is not None or self._onboard_audit.is_awaiting

    def _note_verified(self, onboard: OnboardMission) -> None:
        """Keep the route of a verified mission."""
        vehicle = onboard.route.vehicle
        if vehicle in self._audited and self._until_t_ns is not None:
            self._verified[vehicle] = onboard.route
        self._audited.discard(vehicle)

    # ------------------------------------------------------------ end of the restart

    def is_waiting(self, t_ns: int, agents: Container[int], targets: Mapping[Label, Track]) -> bool:
        """Return True if it is too early to plan: vehicles or targets are still being verified."""
        if self._until_t_ns is None:
            return False
        recognised = set(self._recognised(t_ns, targets).values())
        are_verified_there = all(r.target in recognised and v in agents for v, r in self._verified.items())
        are_others_there = all(v in agents for v in self._agent_status.active()) and recognised >= set(
            self._expected_labels.values()
        )
        left_s = (self._until_t_ns - t_ns) / NS_PER_S
        if left_s > 0.0 and (
            self._onboard_audit.is_awaiting
            or not are_verified_there
            or (not are_others_there and left_s > _MAX_WAIT_S - _MAX_OTHERS_WAIT_S)
        ):
            return True
        self._finish(t_ns, targets)
        return False

    def _recognised(self, t_ns: int, targets: Mapping[Label, Track]) -> dict[Label, Label]:
        """Return the former labels of confirmed targets: by birth component, else by distance."""
        former = {
            label: self._expected_labels[label[1]] for label in targets if label[1] in self._expected_labels
        }
        then_t_ns, tracks = self._expected
        predicted = self._trackers.predict_targets(tracks, (t_ns - then_t_ns) / NS_PER_S)
        expected = [track for track in predicted if track.label not in former.values()]
        seen = [track for label, track in sorted(targets.items()) if label not in former]
        if expected and seen:
            offset = np.array([[e.mean[:2] - s.mean[:2] for s in seen] for e in expected])
            S = np.array([[e.cov[:2, :2] + s.cov[:2, :2] for s in seen] for e in expected])
            d2 = np.einsum("ijk,ijkl,ijl->ij", offset, np.linalg.inv(S), offset)
            away_m = np.where(d2 <= _GATE_CHI2, np.hypot(offset[..., 0], offset[..., 1]), _FAR_M)
            for row, column in zip(*linear_sum_assignment(away_m), strict=True):
                if away_m[row, column] < _FAR_M:
                    former[seen[column].label] = expected[row].label
        return former

    def is_reached(self, label: Label) -> bool:
        """Return True if a target was reached before the restart."""
        return self._former_labels.get(label, self._expected_labels.get(label[1])) in self._reached.values()

    def _finish(self, t_ns: int, targets: Mapping[Label, Track]) -> None:
        """Give the verified routes to the replanner, with the new labels of their targets."""
        self._until_t_ns = None
        self._former_labels = self._recognised(t_ns, targets)
        now = {was: label for label, was in self._former_labels.items()}
        for vehicle in [vehicle for vehicle, label in self._reached.items() if label in now]:
            target = now[self._reached.pop(vehicle)]
            self._agent_status.by_vehicle[vehicle] = replace(
                self._agent_status.by_vehicle[vehicle], target=target
            )
        routes = {v: replace(r, target=now[r.target]) for v, r in self._verified.items() if r.target in now}
        self._verified.clear()
        for vehicle, route in routes.items():
            onboard = self._tasking.onboard(vehicle)
            if onboard is not None:
                self._tasking.onboard_missions.note(replace(onboard, route=route))
        for vehicle in [vehicle for vehicle in routes if vehicle in self._orders.suspensions]:
            self._orders.suspended_routes[vehicle] = routes.pop(vehicle)
        for vehicle in [vehicle for vehicle in routes if not self._is_flown(vehicle)]:
            del routes[vehicle]  # it does not fly its onboard mission: it gets another with the next plan
        self._replanner.resume(t_ns, routes, targets)

    def _is_flown(self, vehicle: int) -> bool:
        """Return True if a vehicle flies its onboard mission."""
        state = self._fleet.state(vehicle)
        return state is not None and state.mode == AUTO and vehicle not in self._orders.commanded


def _contents(state: PersistedState, known: Container[int]) -> str:
    """Return the persisted state of this mission's vehicles, in words."""
    vehicles = [one for one in state.vehicles if one.status.vehicle in known]
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
    parts.append(f"{len(state.targets)} targets")
    if state.no_fly_zones:
        parts.append("closed areas " + ", ".join(area.name for area in state.no_fly_zones))
    return "; ".join(parts)


def _values(item: Item) -> tuple[float | None, ...]:
    return tuple(None if math.isnan(value) else float(value) for value in item)


def _item(row: tuple[float | None, ...]) -> Item:
    """Return a mission item from its persisted values."""
    values = [math.nan if value is None else value for value in row]
    command, frame, x, y, z_m, param1, param2, param3, param4, autocontinue = values
    return Item(
        int(command), int(frame), int(x), int(y), z_m, param1, param2, param3, param4, int(autocontinue)
    )
