"""Orders of operators."""

from __future__ import annotations

from gcs.core.authority.override_notices import overridden_text
from gcs.core.operator.arrived_agents import continue_mission
from gcs.core.operator.records import OrderInProgress
from gcs.core.pipelines.changes import apply_statuses
from gcs.core.pipelines.planning import plan_now
from gcs.core.stages import Stages
from gcs.model import ControlEvent, Effect, Order


def report_status(stages: Stages, event: Order) -> list[Effect]:
    """Answer a question about the status."""
    if event.action != "status":
        return []
    return [stages.status_report.build(event.t_ns, event.order_id)]


def carry_out(stages: Stages, event: Order) -> list[Effect]:
    """Carry out an order that changes something, and answer it."""
    t_ns = event.t_ns
    match event.action:
        case "status":
            return []
        case "confirm" | "reject":
            inputs = stages.planning_inputs.build(t_ns, stages.state.measured_t_ns)
            effects, routes = stages.approval.decide(event, inputs)
            return effects + stages.dispatch.send(routes, t_ns)
        case "plan":
            return _answer_plan(stages, event)
        case "no-fly-zone":
            return stages.no_fly_zone_orders.carry_out(event, lambda urgent: plan_now(stages, t_ns, urgent))
        case "ready":
            return apply_statuses(stages, stages.ready_orders.carry_out(event))
        case "ignore" | "attend" | "priority" | "pin" | "unpin":
            return stages.target_orders.carry_out(event, lambda: plan_now(stages, t_ns))
        case "continue":
            open_targets = stages.planning_inputs.open_targets()
            effects = continue_mission(event, stages.state, stages.replanner, open_targets)
            return effects + plan_now(stages, t_ns)
    targets = stages.trackers.targets.confirmation.tracks
    released = stages.orders.carry_out(event, targets, lambda vehicle, at: _release(stages, vehicle, at))
    return stages.dispatch.settle(released)


def refresh_proposal(stages: Stages, event: Order) -> list[Effect]:
    """Renew or withdraw the plan that waits, and plan if the control of a vehicle has changed."""
    if event.action == "status":
        return []
    effects = stages.approval.refresh_ours(event.t_ns)
    return effects + (plan_now(stages, event.t_ns) if stages.approval.changed_control() else [])


def _answer_plan(stages: Stages, event: Order) -> list[Effect]:
    """Answer with the plan that waits, and name the vehicles that are overridden."""
    overridden = overridden_modes(stages)
    text = overridden_text(overridden)
    ongoing = OrderInProgress(event, tuple(overridden))
    effects: list[Effect] = [ongoing.answer(event.t_ns, "accepted", text)] if text else []
    return effects + stages.approval.answer(event)


def overridden_modes(stages: Stages) -> dict[int, str]:
    """Return the overriding modes by vehicle, except modes that orders here asked for."""
    modes = stages.tasking.overrides.modes()
    return {v: mode for v, mode in modes.items() if not stages.orders.has_ordered(v, mode)}


def _release(stages: Stages, vehicle: int, t_ns: int) -> None:
    """Take control of a vehicle back on an operator's order, whatever mission it stores."""
    stages.external_uploads.release(vehicle, ControlEvent.RESUME, t_ns)
    stages.onboard_audit.release(vehicle, t_ns)
    stages.second_commander.release(vehicle, t_ns)
