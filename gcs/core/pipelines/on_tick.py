"""Timers: what happens at each tick although no message comes; tracking by reports alone."""

from __future__ import annotations

from typing import Final

from gcs.core.operator.standstill import check_standstill
from gcs.core.perception.never_heard import check_never_heard
from gcs.core.pipelines.changes import apply_statuses
from gcs.core.pipelines.planning import renew_outdated
from gcs.core.stages import Stages
from gcs.model import Authority, Effect, Tick

_STANDING: Final = {Authority.GROUNDED, Authority.REJECTING, Authority.LANDED, Authority.DOWN}
"""Claims of vehicles on the ground that nobody else controls."""


def poll_links(stages: Stages, event: Tick) -> list[Effect]:
    """Send heartbeats and requests; tell of silent vehicles."""
    return [*stages.fleet.poll(event.t_ns), *stages.fleet.notices()]


def serve_terrain(stages: Stages, event: Tick) -> list[Effect]:
    """Send terrain to vehicles that ask for it."""
    return stages.terrain.poll(event.t_ns)


def check_flight(stages: Stages, event: Tick) -> list[Effect]:
    """Check flight phases, four times a second: what has come down, and what flies again."""
    t_ns = event.t_ns
    if not stages.flight_phases.is_due(t_ns):
        return []
    effects = apply_statuses(stages, stages.flight_phases.check(t_ns))
    for vehicle, agent in stages.state.agents.items():
        if agent.flight.phase.has_flown and agent.tasking.onboard is not None:
            agent.routes.drop()
            stages.tasking.cancel(vehicle, t_ns)
            stages.tasking.forget_onboard(vehicle)  # it is not for a take-off from here
    return effects


def check_health(stages: Stages, event: Tick) -> list[Effect]:
    """Check the health of vehicles in flight, twice a second; plan for those that have become unfit."""
    t_ns = event.t_ns
    agents = stages.state.agents
    if not stages.health.is_due(t_ns):
        return []
    fit = {vehicle for vehicle, agent in agents.items() if not agent.flight.unfit}
    effects = stages.health.check(t_ns)
    for vehicle in sorted(fit):
        if cause := agents[vehicle].flight.unfit:
            stages.replanner.note_unfit(vehicle, cause, t_ns)
    return effects


def check_sensors(stages: Stages, event: Tick) -> list[Effect]:
    """Tell of silent sensors, of vehicles that were never heard, and of unreadable input."""
    t_ns = event.t_ns
    state = stages.state
    effects = stages.sensor_watchdog.poll(t_ns)
    effects += check_never_heard(state.agents, state.perception, t_ns)
    return effects + stages.input_errors.poll(t_ns)


def keep_reports(stages: Stages, event: Tick) -> list[Effect]:
    """Keep the newest positions for scans that were measured now and arrive later."""
    if stages.report_history.is_due(event.t_ns):
        stages.report_history.add(event.t_ns, stages.fleet.states())
    return []


def track_by_reports(stages: Stages, event: Tick) -> list[Effect]:
    """Track agents by their reports alone while no sensor publishes.

    The epoch is as old as scans are when they arrive: the first one that comes again is not refused.
    """
    if not stages.sensor_watchdog.is_blind or stages.oosm_buffer.held:
        return []
    measured_t_ns = event.t_ns - stages.scan_timing.max_lag_ns()
    if not stages.trackers.is_report_epoch_due(measured_t_ns):
        return []
    newest = stages.fleet.states()
    stages.report_history.add(event.t_ns, newest)
    states = stages.report_history.at(measured_t_ns, newest)
    pictures = stages.trackers.report_epoch(event.t_ns, measured_t_ns, states)
    if pictures:
        stages.association.update(stages.trackers.agents.confirmation, measured_t_ns, states)
        stages.kinematics.update(newest)
        return [*pictures, *stages.trackers.agents.lagged(event.t_ns)]
    return []


def upload_missions(stages: Stages, event: Tick) -> list[Effect]:
    """Begin uploads, and go on with those in progress."""
    effects = stages.dispatch.withdraw(event.t_ns)
    effects += renew_outdated(stages, event.t_ns)
    return effects + stages.dispatch.settle(stages.tasking.poll(event.t_ns, renewed=False))


def watch_other_stations(stages: Stages, event: Tick) -> list[Effect]:
    """Watch what others do to our vehicles: missions, commands, parameters."""
    t_ns = event.t_ns
    effects = stages.external_uploads.poll(t_ns)
    effects += stages.dispatch.settle(stages.second_commander.poll(t_ns))
    return effects + stages.parameter_changes.poll(t_ns)


def carry_on_orders(stages: Stages, event: Tick) -> list[Effect]:
    """Repeat commands of orders that vehicles have not confirmed; carry out those that waited."""
    return stages.dispatch.settle(stages.orders.poll(event.t_ns))


def audit_missions(stages: Stages, event: Tick) -> list[Effect]:
    """Go on with the read-back of onboard missions."""
    return stages.onboard_audit.poll(event.t_ns)


def watch_takeoffs(stages: Stages, event: Tick) -> list[Effect]:
    """Tell which take-offs and new missions wait for others, and which vehicles climb near each other."""
    return stages.takeoff_sequence.check(event.t_ns) + stages.mission_traffic.check(event.t_ns)


def watch_zones(stages: Stages, event: Tick) -> list[Effect]:
    """Warn of vehicles that fly into no-fly zones, and let them hold before."""
    t_ns = event.t_ns
    if not stages.incursions.is_due(t_ns):
        return []
    imminent = stages.incursions.imminent(t_ns, stages.fleet.states(), stages.no_fly_zones.closed)
    effects: list[Effect] = [*stages.incursions.tell(t_ns, imminent)]
    for entry in imminent:
        effects += stages.avoidances.hold_before_zone(entry, t_ns)
    return effects


def watch_separation(stages: Stages, event: Tick) -> list[Effect]:
    """Look ahead over all pairs of vehicles in the air."""
    watched = stages.dispatch.settle(stages.separation.check(event.t_ns))
    return watched + stages.avoidances.poll(event.t_ns)


def watch_ground(stages: Stages, event: Tick) -> list[Effect]:
    """Tell of vehicles that come near the ground."""
    return stages.ground_proximity.check(event.t_ns)


def report_standstill(stages: Stages, event: Tick) -> list[Effect]:
    """Tell when no agent that is left can be tasked."""
    state = stages.state
    if state.has_ended or not stages.replanner.has_planned:
        return []
    return check_standstill(state.agents, state.operator.standstill, event.t_ns)


def report_overrides(stages: Stages, event: Tick) -> list[Effect]:
    """Tell of modes that this service did not command, with their cause."""
    return stages.override_notices.poll(event.t_ns)


def leave_auto_on_ground(stages: Stages, event: Tick) -> list[Effect]:
    """Set vehicles that stand on the ground in AUTO, and would take off when armed, to LOITER."""
    if stages.onboard_audit.awaited:
        return []
    agents = stages.state.agents
    return stages.disarmed_in_auto.poll(
        event.t_ns, lambda vehicle: agents[vehicle].control.claims.keys() <= _STANDING
    )
