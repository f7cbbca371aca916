"""Scans of sensors: from their arrival to the plan, step by step."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.core.authority.override_notices import unattended_targets
from gcs.core.pipelines import planning
from gcs.core.pipelines.changes import follow_status
from gcs.core.stages import Stages
from gcs.core.tasking.missed_targets import check_missed_targets
from gcs.model import BadInput, Effect, Scan, VehicleState


@dataclass(frozen=True, slots=True)
class Epoch:
    """A scan that is processed now, with the states of the vehicles."""

    scan: Scan
    states: tuple[VehicleState, ...]
    """At the time of the measurement."""
    newest: tuple[VehicleState, ...]
    reporting: set[int]
    """Vehicles with a recent position."""

    @property
    def t_ns(self) -> int:
        """Time of arrival."""
        return self.scan.t_ns

    @property
    def measured_t_ns(self) -> int:
        """Time of the measurement."""
        return self.scan.measured_t_ns


# ------------------------------------------------------------ arrival


def hold_scan(stages: Stages, event: Scan) -> list[Effect]:
    """Correct the clock of a scan's sensor; keep the scan until its reorder window has passed."""
    scan, refusal, effects = stages.scan_timing.corrected(event)
    refusal = refusal or stages.trackers.refusal(scan)
    if refusal:
        return [*effects, *_refuse(stages, scan, refusal)]
    stages.oosm_buffer.add(scan)
    return effects


def _refuse(stages: Stages, scan: Scan, refusal: str) -> list[Effect]:
    name = scan.sensor.name
    stages.sensor_watchdog.refused(name, scan.t_ns, refusal)
    return stages.input_errors.add(BadInput(scan.t_ns, name, f"scan of {name} {refusal}", name))


def due_scans(stages: Stages, t_ns: int) -> list[Scan]:
    """Take the scans whose reorder window has passed."""
    return stages.oosm_buffer.due(t_ns, stages.reorder_window_s)


def begin_epoch(stages: Stages, scan: Scan) -> tuple[Epoch | None, list[Effect]]:
    """Begin to process a scan; None if a duplicate came while it waited."""
    refusal = stages.trackers.refusal(scan)
    if refusal:
        return None, _refuse(stages, scan, refusal)
    stages.state.measured_t_ns = scan.measured_t_ns
    newest = stages.fleet.states()
    stages.report_history.add(scan.t_ns, newest)
    states = stages.report_history.at(scan.measured_t_ns, newest)
    reporting = {one.system_id for one in newest if abs(scan.t_ns - one.t_ns) <= stages.max_age_ns(one)}
    return Epoch(scan, tuple(states), newest, reporting), []


# ------------------------------------------------------------ processing


def update_trackers(stages: Stages, epoch: Epoch) -> list[Effect]:
    """Update both trackers; return their pictures, and the all-clear of the sensor."""
    effects: list[Effect] = [*stages.sensor_watchdog.processed(epoch.scan.sensor.name, epoch.t_ns)]
    effects += stages.trackers.scan(epoch.scan, epoch.states)
    return [*effects, *stages.trackers.lagged_pictures(epoch.t_ns)]


def associate_vehicles(stages: Stages, epoch: Epoch) -> list[Effect]:
    """Associate tracks with vehicles, and compare reported positions with detections."""
    agents = stages.trackers.agents.confirmation
    targets = stages.trackers.targets.confirmation
    stages.association.update(agents, epoch.measured_t_ns, epoch.states)
    stages.kinematics.update(epoch.newest)
    scan = stages.trackers.scan_of_agents(epoch.scan)
    effects: list[Effect] = [
        *stages.position_integrity.update(scan, epoch.states, agents.tracks, targets.tracks.values())
    ]
    return effects + stages.sensor_watchdog.associated(epoch.t_ns, epoch.reporting, stages.association.labels)


def update_statuses(stages: Stages, epoch: Epoch) -> list[Effect]:
    """Decide which agents have arrived, are lost, or are active again."""
    agents = stages.trackers.agents.confirmation
    targets = stages.trackers.targets.confirmation
    effects: list[Effect] = []
    seen_by_one = stages.state.perception.trackers.contradictions.seen_by_one("agents")
    changes = stages.agent_status.update(
        epoch.t_ns, epoch.measured_t_ns, agents, targets, epoch.reporting, seen_by_one
    )
    for status in changes:
        effects.append(status)
        effects += follow_status(stages, status)
    return effects


def check_climbs(stages: Stages, epoch: Epoch) -> list[Effect]:
    """Check the take-offs of vehicles on the ground."""
    return planning.check_climbs(stages, epoch.t_ns)


def report_missed_targets(stages: Stages, epoch: Epoch) -> list[Effect]:
    """Tell which vehicles ended their routes without having reached their targets."""
    capture_m = stages.config.planning.capture_radius_m
    return check_missed_targets(stages.state.agents, stages.tasking.onboard_missions, capture_m, epoch.t_ns)


def refresh_proposal(stages: Stages, epoch: Epoch) -> list[Effect]:
    """Renew or withdraw the plan that waits to be confirmed."""
    return stages.approval.refresh_ours(epoch.t_ns)


def plan(stages: Stages, epoch: Epoch) -> list[Effect]:
    """Plan if it is due, and send or propose the missions."""
    return planning.plan(stages, epoch.t_ns, epoch.measured_t_ns)


def report_unattended_targets(stages: Stages, epoch: Epoch) -> list[Effect]:
    """Tell which targets need agents after the end of the mission."""
    state = stages.state
    targets = stages.planning_inputs.open_targets()
    return unattended_targets(state.authority, targets, epoch.t_ns, has_ended=state.has_ended)


def end_mission(stages: Stages, epoch: Epoch) -> list[Effect]:
    """End the mission when it is complete, or no agent can fly."""
    return planning.end_mission(stages, epoch.t_ns)


def report_sensor_model(stages: Stages, epoch: Epoch) -> list[Effect]:
    """Tell of sensors that contradict their model, and of detections that no track takes."""
    return [*stages.trackers.notices(epoch.scan)]
