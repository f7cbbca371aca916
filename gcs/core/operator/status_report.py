"""Status of the swarm, collected from the stages of the engine."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.core.operator.records import TargetSettings
from gcs.core.perception.fusion import MultiSensorTracker
from gcs.core.replanning.planned_flights import AltitudeLayers
from gcs.core.state import State, flown_routes, reached
from gcs.core.tasking.mission_builder import flown_points
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.vehicle import Health
from gcs.model import NS_PER_S, AgentRecord, Label, SwarmStatus, TargetRecord
from gcs.planning.route_progress import remaining_length_m

_MIN_SPEED_M_S = 1.0


@dataclass(frozen=True, slots=True)
class StatusReport:
    """Collects the status."""

    state: State
    fleet: Fleet
    trackers: MultiSensorTracker
    layers: AltitudeLayers
    tasking: UploadManager

    def build(self, t_ns: int, order_id: str = "") -> SwarmStatus:
        """Return the status now, as the answer to an order."""
        pending = self.state.operator.approval.pending
        return SwarmStatus(
            t_ns,
            order_id,
            agents=tuple(self._agent(health, t_ns) for health in self.fleet.health()),
            targets=self._targets(),
            sensors=self.state.perception.sensor_watchdog.records(t_ns),
            plan_id=None if pending is None else pending.plan_id,
            has_ended=self.state.has_ended,
        )

    def _agent(self, health: Health, t_ns: int) -> AgentRecord:
        vehicle, agent = health.system_id, self.state.agents[health.system_id]
        state, status = self.fleet.state(vehicle), agent.perception.status
        label = agent.perception.association.label
        track = None if label is None else self.trackers.agents.confirmation.tracks.get(label)
        route, proposed = agent.routes.flown, agent.routes.proposed
        to_go_m = eta_s = position_m = None
        points_passed = 0
        if state is not None:
            position_m = (state.east_m, state.north_m)
            if route is not None:
                points_passed = flown_points(agent, route, state)
                climb = self.tasking.climb(vehicle, route.layer)
                if climb is None:
                    to_go_m = remaining_length_m(route.points_m, position_m, points_passed)
                    eta_s = to_go_m / max(state.ground_speed_m_s, _MIN_SPEED_M_S)
                else:
                    left_m = remaining_length_m(route.points_m, climb.latest_end_m, points_passed)
                    to_go_m, eta_s = (
                        climb.latest_length_m + left_m,
                        climb.duration_s + left_m / climb.speed_m_s,
                    )
        return AgentRecord(
            vehicle=vehicle,
            status=status.status,
            authority=agent.control.authority.word,
            reason=agent.control.reason,
            heard_age_s=(t_ns - health.heard_t_ns) / NS_PER_S if health.frames else None,
            loss=health.lost / max(1, health.frames + health.lost),
            mode="" if state is None else state.mode,
            armed=state is not None and state.armed,
            battery_percent=health.battery_percent,
            fix_type=health.fix_type,
            position_m=position_m,
            alt_rel_m=None if state is None else self.fleet.height_m(state),
            ground_speed_m_s=None if state is None else state.ground_speed_m_s,
            is_position_doubted=agent.perception.integrity.is_alarmed,
            track=label,
            existence=0.0 if track is None else track.existence,
            layer=self.layers.of(vehicle),
            target=status.target if route is None else route.target,
            to_go_m=to_go_m,
            points_passed=points_passed,
            eta_s=eta_s,
            upload=self.state.tasking.stages.get(vehicle, ""),
            has_failed=agent.tasking.retry.failures > 0,
            is_verified=agent.tasking.onboard is not None,
            proposed_target=None if proposed is None else proposed.target,
            pinned=agent.orders.pinned,
            phase=agent.flight.phase.value,
            problems=tuple(
                f"{item.value}: {one.cause}" for item, one in agent.flight.problems.items() if one.is_told
            ),
        )

    def _targets(self) -> tuple[TargetRecord, ...]:
        routes, settings, default = (
            flown_routes(self.state.agents),
            self.state.operator.targets,
            TargetSettings(),
        )

        def reached_by(label: Label) -> tuple[int, ...]:
            return tuple(v for v, agent in self.state.agents.items() if label in reached(agent))

        return tuple(
            TargetRecord(
                label,
                track.existence,
                (float(track.mean[0]), float(track.mean[1])),
                float((track.mean[2] ** 2 + track.mean[3] ** 2) ** 0.5),
                agents=tuple(vehicle for vehicle, route in routes.items() if route.target == label),
                reached_by=reached_by(label),
                is_ignored=settings.get(label, default).is_ignored,
                priority=settings.get(label, default).priority,
            )
            for label, track in sorted(self.trackers.targets.confirmation.tracks.items())
        )
