"""Status of the swarm, collected from the stages of the engine."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcs.core.operator.operator_state import TargetSettings
from gcs.core.perception.fusion import MultiSensorTracker
from gcs.core.replanning.planned_flights import AltitudeLayers
from gcs.core.state import State, flown_routes, reached
from gcs.core.tasking.mission_builder import flown_points
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.fleet.checks.battery_alarm import is_low
from gcs.mavlink.fleet.checks.link_timeouts import STALE_AFTER_S
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.vehicle import Health
from gcs.model import NS_PER_S, AgentRecord, Label, SwarmStatus, TargetRecord, Track, VehicleState
from gcs.model.rounding import rounded, rounded_place
from gcs.planning.route_progress import remaining_length_m
from gcs.terrain.elevation_grid import Elevation

_MIN_SPEED_M_S = 1.0


@dataclass(frozen=True, slots=True)
class StatusReport:
    """Collects the status."""

    state: State
    fleet: Fleet
    trackers: MultiSensorTracker
    layers: AltitudeLayers
    tasking: UploadManager
    ground: str
    """Terrain of the mission in words."""
    elevation: Elevation | None = None
    """None: the ground is flat."""

    def build(self, t_ns: int, order_id: str = "") -> SwarmStatus:
        """Return the status now, as the answer to an order."""
        pending = self.state.operator.approval.pending
        return SwarmStatus(
            t_ns,
            order_id,
            agents=tuple(self.agent(health, t_ns) for health in self.fleet.health()),
            targets=self._targets(),
            sensors=self.state.perception.sensor_watchdog.records(t_ns),
            plan_id=None if pending is None else pending.plan_id,
            has_ended=self.state.has_ended,
            terrain=self.ground,
        )

    def agent(self, health: Health, t_ns: int) -> AgentRecord:
        """Return the status of one agent now."""
        vehicle = health.system_id
        agent = self.state.agents[vehicle]
        state = self.fleet.state(vehicle)
        status = agent.perception.status
        label = agent.perception.association.label
        track = None if label is None else self.trackers.agents.confirmation.tracks.get(label)
        flown = agent.routes.flown
        route = agent.routes.stacked if flown is None else flown
        proposed = agent.routes.proposed
        lost_at_m = status.position_m if status.status in ("lost", "down") else None
        heard_age_s = (t_ns - health.heard_t_ns) / NS_PER_S if health.frames else None
        to_go_m = eta_s = None
        points_passed = 0
        if state is not None and route is not None:
            points_passed = flown_points(agent, route, state)
            climb = self.tasking.climb(vehicle, route.layer)
            if climb is None:
                position_m = (state.east_m, state.north_m)
                to_go_m = remaining_length_m(route.points_m, position_m, points_passed)
                eta_s = to_go_m / max(state.ground_speed_m_s, _MIN_SPEED_M_S)
            else:
                left_m = remaining_length_m(route.points_m, climb.latest_end_m, points_passed)
                to_go_m = climb.latest_length_m + left_m
                eta_s = climb.duration_s + left_m / climb.speed_m_s
        return AgentRecord(
            vehicle=vehicle,
            status=status.status,
            authority=agent.control.authority.word,
            reason=agent.control.reason,
            heard_age_s=rounded(heard_age_s),
            is_late=heard_age_s is None or heard_age_s > STALE_AFTER_S,
            loss=round(health.lost / max(1, health.frames + health.lost), 3),
            mode="" if state is None else state.mode,
            armed=state is not None and state.armed,
            battery_percent=health.battery_percent,
            is_battery_low=is_low(health.battery_percent),
            fix_type=health.fix_type,
            position_m=None if state is None else rounded_place(state.east_m, state.north_m),
            course_rad=None if state is None else rounded(state.course_rad, 2),
            alt_rel_m=None if state is None else rounded(self.fleet.height_m(state)),
            alt_msl_m=None if state is None else rounded(state.alt_msl_m),
            agl_m=None if state is None else self._agl_m(state),
            ground_speed_m_s=None if state is None else rounded(state.ground_speed_m_s),
            is_position_doubted=agent.perception.integrity.is_alarmed,
            lost_at_m=None if lost_at_m is None else rounded_place(*lost_at_m),
            track=label,
            existence=0.0 if track is None else round(track.existence, 3),
            layer=self.layers.of(vehicle),
            target=status.target if flown is None else flown.target,
            to_go_m=rounded(to_go_m, 0),
            points_passed=points_passed,
            eta_s=rounded(eta_s, 0),
            upload=self.state.tasking.stage(vehicle),
            has_failed=agent.tasking.retry.failures > 0,
            is_verified=agent.tasking.onboard is not None,
            proposed_target=None if proposed is None else proposed.target,
            pinned=agent.orders.pinned,
            phase=agent.flight.phase.value,
            problems=tuple(
                f"{item.value}: {one.cause}" for item, one in agent.flight.problems.items() if one.is_told
            ),
        )

    def _agl_m(self, state: VehicleState) -> float | None:
        """Return the height of a vehicle above the ground; None over flat ground, and beyond the model."""
        if self.elevation is None:
            return None
        agl_m = state.alt_msl_m - self.elevation.height_msl_m(state.east_m, state.north_m)
        return rounded(agl_m) if math.isfinite(agl_m) else None

    def _targets(self) -> tuple[TargetRecord, ...]:
        agents = self.state.agents
        settings = self.state.operator.targets
        default = TargetSettings()
        routes = flown_routes(agents)

        def record(label: Label, track: Track) -> TargetRecord:
            east_m, north_m, east_m_s, north_m_s = track.mean.tolist()
            return TargetRecord(
                label,
                round(track.existence, 3),
                rounded_place(east_m, north_m),
                round(math.hypot(east_m_s, north_m_s), 1),
                agents=tuple(vehicle for vehicle, route in routes.items() if route.target == label),
                reached_by=tuple(vehicle for vehicle, agent in agents.items() if label in reached(agent)),
                is_ignored=settings.get(label, default).is_ignored,
                priority=settings.get(label, default).priority,
                pinned=tuple(vehicle for vehicle, agent in agents.items() if agent.orders.pinned == label),
            )

        found = self.trackers.targets.confirmation.tracks
        return tuple(record(label, track) for label, track in sorted(found.items()))
