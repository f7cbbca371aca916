"""Restart: continuation from persisted state, checked against vehicles and sensors.

* A vehicle keeps its route if its onboard mission reads back equal; nothing is uploaded again. With another
  mission it is suspended. Without an answer it is not tasked (`gcs.core.authority.onboard_audit`). After an
  interrupted upload its mission may be inconsistent: it is held, cleared and planned for.
* An overridden vehicle stays overridden.
* Tracks continue with their labels, predicted over the outage. After a long one the agents' tracks start
  again at their reports.
* Proposed plans are made again, with higher numbers.

No plan is made before this has ended, which is bounded in time.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Container, Mapping
from typing import Final

from gcs.core.authority.external_uploads import ExternalUploads
from gcs.core.authority.onboard_audit import OnboardAudit
from gcs.core.operator.replies import named
from gcs.core.perception.agent_status import AgentStatusMonitor
from gcs.core.perception.fusion import MultiSensorTracker
from gcs.core.perception.track_to_vehicle import TrackVehicleAssociation
from gcs.core.replanning.replanner import Replanner
from gcs.core.state import Agent
from gcs.core.tasking.records import OnboardMission
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.autopilots.modes import AUTO
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.mission.items import Item
from gcs.model import NS_PER_S, Effect, Label, Notice, PersistedState, PersistedVehicle, Resumed, Route
from gcs.model.control import SUSPENSIONS

_MAX_WAIT_S: Final = 25.0
"""Maximum time until the first plan."""
_MAX_UNHEARD_WAIT_S: Final = 8.0
"""Maximum wait for vehicles that have not reported a position."""
_MAX_PREDICTION_S: Final = 10.0
"""Maximum outage over which tracks of agents, which may turn, are predicted."""


class Restart:
    """Collects the state to persist, and restores it."""

    def __init__(
        self,
        agents: Mapping[int, Agent],
        fleet: Fleet,
        tasking: UploadManager,
        replanner: Replanner,
        agent_status: AgentStatusMonitor,
        trackers: MultiSensorTracker,
        association: TrackVehicleAssociation,
        external_uploads: ExternalUploads,
        onboard_audit: OnboardAudit,
    ) -> None:
        self._fleet, self._tasking, self._replanner = fleet, tasking, replanner
        self._agents = agents
        self._agent_status, self._trackers = agent_status, trackers
        self._association, self._external_uploads = association, external_uploads
        self._onboard_audit = onboard_audit
        self._audited: set[int] = set()
        """Vehicles that keep their route if their mission reads back equal."""
        self._until_t_ns: int | None = None

    # ------------------------------------------------------------ persisted state

    def vehicles(self) -> tuple[PersistedVehicle, ...]:
        """Return the persisted state of every vehicle."""
        return tuple(self._persisted(vehicle) for vehicle in self._agents)

    def _persisted(self, vehicle: int) -> PersistedVehicle:
        audit, routes = self._agents[vehicle].authority.audit, self._agents[vehicle].routes
        audited = None if audit is None else audit.mission  # still the persisted mission
        onboard = audited or self._agents[vehicle].tasking.onboard
        route = routes.flown or routes.suspended or self._verified().get(vehicle)
        unsure = self._tasking.may_be_inconsistent(vehicle)
        is_obsolete = route is None and (audited is None or vehicle not in self._audited)
        if onboard is not None and (audited is not None or (is_obsolete and not unsure)):
            route = onboard.route
        if onboard is None or not onboard.route.is_same(route):
            onboard = None
        return PersistedVehicle(
            status=self._agents[vehicle].perception.status,
            suspension=self._agents[vehicle].control.suspension,
            route=route,
            items=() if onboard is None or unsure else tuple(_values(item) for item in onboard.items),
            first_point=1 if onboard is None else onboard.first_point,
            may_be_inconsistent=unsure,
            authority=self._tasking.overrides.persisted(vehicle),
            external_mission=self._external_uploads.persisted(vehicle),
            track=self._agents[vehicle].perception.association.label,
            is_obsolete=is_obsolete,
        )

    # ------------------------------------------------------------ restoring

    def begin(self, event: Resumed) -> list[Effect]:
        """Restore persisted state; return notices."""
        state, t_ns = event.state, event.t_ns
        age_s = max(0.0, (t_ns - state.t_ns) / NS_PER_S)
        self._tasking.state.mission_count = state.mission_count
        self._until_t_ns = t_ns + round(_MAX_WAIT_S * NS_PER_S)
        effects: list[Effect] = []
        known = set(self._agents)
        text = f"continues from its state {age_s:.0f} s ago: {_contents(state, known)}"
        text += "; for a new flight, end the service and start it with --no-resume"
        effects.append(Notice(t_ns, "warning", text))
        effects += self._restore_tracks(state, age_s, t_ns)
        for one in state.vehicles:
            vehicle = one.status.vehicle
            if vehicle not in known:
                continue
            self._agent_status.restore(one.status)
            if one.suspension is not None:
                claim = next(claim for claim, word in SUSPENSIONS.items() if word == one.suspension)
                self._agents[vehicle].control.restore(claim, t_ns)
            if one.authority is not None:
                self._tasking.overrides.of(vehicle).restore(one.authority, t_ns)
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
                self._onboard_audit.begin(onboard, t_ns, known_t_ns=state.t_ns)
        return effects

    def _restore_tracks(self, state: PersistedState, age_s: float, t_ns: int) -> list[Effect]:
        with_agents = age_s <= _MAX_PREDICTION_S
        try:
            self._trackers.restore(state.trackers, with_agents=with_agents)
        except ValueError as error:
            return [Notice(t_ns, "alarm", f"{error}: tracks start again, and targets get new labels")]
        if with_agents:
            known = [one for one in state.vehicles if one.status.vehicle in self._agents]
            self._association.restore({one.status.vehicle: one.track for one in known})
        return []

    @property
    def is_under_way(self) -> bool:
        """True while the state of vehicles is still being verified."""
        return self._until_t_ns is not None or bool(self._onboard_audit.awaited)

    def _verified(self) -> dict[int, Route]:
        """Return the routes of missions that have been verified since the restart began; none after it."""
        if self._until_t_ns is None:
            return {}
        ended = [v for v in sorted(self._audited) if self._agents[v].authority.audit is None]
        missions = {vehicle: self._agents[vehicle].tasking.onboard for vehicle in ended}
        return {vehicle: mission.route for vehicle, mission in missions.items() if mission is not None}

    # ------------------------------------------------------------ end of the restart

    def is_waiting(self, t_ns: int, targets: Collection[Label]) -> bool:
        """Return True if it is too early to plan: the state of vehicles is still being verified.

        `targets` are the confirmed ones, which a first plan after the restart is compared with.
        """
        if self._until_t_ns is None:
            return False
        left_s = (self._until_t_ns - t_ns) / NS_PER_S
        is_audited = not any(map(self._fleet.state, self._onboard_audit.awaited))
        are_heard = all(map(self._fleet.state, self._agent_status.active()))
        if left_s > 0.0 and not (is_audited and (are_heard or left_s < _MAX_WAIT_S - _MAX_UNHEARD_WAIT_S)):
            return True
        self._finish(t_ns, targets)
        return False

    def _finish(self, t_ns: int, targets: Collection[Label]) -> None:
        """Give the verified routes to the replanner."""
        routes = self._verified()
        self._until_t_ns = None
        suspended = {v: routes.pop(v) for v in list(routes) if self._agents[v].control.suspension is not None}
        for vehicle in [vehicle for vehicle in routes if not self._is_flown(vehicle)]:
            del routes[vehicle]  # it does not fly its onboard mission: it gets another with the next plan
        self._replanner.resume(t_ns, routes, suspended, targets)

    def _is_flown(self, vehicle: int) -> bool:
        """Return True if a vehicle flies its onboard mission."""
        state = self._fleet.state(vehicle)
        return state is not None and state.mode == AUTO and self._agents[vehicle].orders.command is None


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
    targets = sum(one.is_confirmed for one in state.trackers.targets.confirmations)
    parts.append(f"{targets} targets")
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
