"""Planning inputs from the current tracks, reports, uploads and statuses."""

from __future__ import annotations

from collections.abc import Container, Iterable

from gcs.core.authority.taskability import Taskability
from gcs.core.perception.agent_status import AgentStatusMonitor
from gcs.core.perception.fusion import MultiSensorTracker
from gcs.core.perception.track_to_vehicle import TrackVehicleAssociation
from gcs.core.perception.vehicle_kinematics import VehicleKinematics
from gcs.core.replanning.inputs import OtherVehicle, PlanningInputs
from gcs.core.replanning.replanner import Replanner
from gcs.core.restart import Restart
from gcs.core.tasking.mission_ends import MissionEnds
from gcs.core.tasking.upload_latency import UploadLatency
from gcs.core.tasking.upload_manager import UploadManager
from gcs.geo import LocalFrame
from gcs.mavlink.autopilots.base import is_on_ground
from gcs.mavlink.autopilots.modes import RTL
from gcs.mavlink.fleet.fleet import Fleet
from gcs.model import Label, Track
from gcs.planning.terminal.climb import Climb


class PlanningInputBuilder:
    """Collects the inputs of a plan.

    Parameters
    ----------
    frame : LocalFrame
        Frame of routes.
    fleet, trackers, association, kinematics, agent_status, taskability, tasking, latency, mission_ends,
    replanner
        Stages of the engine that the inputs come from.
    restart : Restart
        Targets that were reached before a restart.
    """

    def __init__(
        self,
        frame: LocalFrame,
        fleet: Fleet,
        trackers: MultiSensorTracker,
        association: TrackVehicleAssociation,
        kinematics: VehicleKinematics,
        agent_status: AgentStatusMonitor,
        taskability: Taskability,
        tasking: UploadManager,
        latency: UploadLatency,
        mission_ends: MissionEnds,
        replanner: Replanner,
        restart: Restart,
    ) -> None:
        self._frame, self._fleet, self._trackers = frame, fleet, trackers
        self._association, self._kinematics, self._agent_status = association, kinematics, agent_status
        self._taskability, self._tasking, self._latency = taskability, tasking, latency
        self._mission_ends, self._replanner, self._restart = mission_ends, replanner, restart

    def build(self, t_ns: int, picture_t_ns: int) -> PlanningInputs:
        """Return the inputs of a plan at `t_ns`, with tracks as of `picture_t_ns`."""
        confirmed, labels = self._trackers.agents.confirmation.tracks, self._association.labels
        untaskable = self._taskability.without_missions()
        tracks = {v: confirmed[label] for v, label in labels.items() if label in confirmed}
        unassociated = self._association.unassociated
        tracks |= {v: track for v, track in unassociated.items() if v in self._replanner.planned}
        active = self._agent_status.active()
        agents = {v: tracks[v] for v in active if v not in untaskable and v in tracks}
        return PlanningInputs(
            t_ns=t_ns,
            picture_t_ns=picture_t_ns,
            agents=agents,
            motions=self._kinematics.motions(
                agents, t_ns, picture_t_ns, lambda v: self._tasking.forward_simulation(v, t_ns)
            ),
            late_s={vehicle: self._latency.late_s(vehicle) for vehicle in agents},
            left_s=self._left_s(agents, t_ns),
            climbs=self.climbs(agents),
            other_vehicles=self._other_vehicles(agents),
            passed=frozenset(filter(self._mission_ends.has_missed, agents)),
            targets=self.open_targets(),
            at_targets=self._agent_status.at_targets(),
            arrived=self._agent_status.arrived(),
            lost=self._agent_status.lost(),
            untaskable=untaskable,
        )

    def open_targets(self) -> dict[Label, Track]:
        """Return the confirmed targets that need more agents."""
        at_targets, needed = self._agent_status.at_targets(), self._replanner.plan_targets.needed
        return {
            label: track
            for label, track in self._trackers.targets.confirmation.tracks.items()
            if at_targets.get(label, 0) < needed(label) and not self._restart.is_reached(label)
        }

    def climbs(self, vehicles: Iterable[int]) -> dict[int, Climb]:
        """Return the climbs that vehicles have before their routes."""
        found = {v: self._tasking.climb(v, self._replanner.layer(v)) for v in vehicles}
        return {vehicle: climb for vehicle, climb in found.items() if climb is not None}

    def _other_vehicles(self, planned: Container[int]) -> tuple[OtherVehicle, ...]:
        """Return the vehicles in the air that are not planned for now."""
        untaskable, found = self._taskability.untaskable(), []
        for state in self._fleet.states():
            vehicle, home = state.system_id, self._fleet.home(state.system_id)
            is_lost = self._agent_status.by_vehicle[vehicle].status == "lost"
            if vehicle in planned or vehicle not in untaskable or is_lost or is_on_ground(state, home):
                continue
            position_m = to_m = (state.east_m, state.north_m)
            if state.mode == RTL and home is not None:
                to_m = self._frame.to_local(home.lat_deg, home.lon_deg)
            found.append(OtherVehicle(vehicle, position_m, to_m, self._tasking.height_m(state)))
        return tuple(found)

    def _left_s(self, vehicles: Iterable[int], t_ns: int) -> dict[int, float]:
        """Return the remaining time of each upload in progress."""
        elapsed = {vehicle: self._tasking.elapsed_s(vehicle, t_ns) for vehicle in vehicles}
        return {v: self._latency.left_s(v, for_s) for v, for_s in elapsed.items() if for_s is not None}
