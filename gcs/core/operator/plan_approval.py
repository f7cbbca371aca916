"""Approval of plans: those that wait for the operator (`planning.retask = "confirm"`), and for how long.

Each proposal has a number. Nothing is uploaded before it is confirmed, as a whole or for some vehicles. Until
then every vehicle flies its present mission.

A number stays while the assignment stays. Its routes are planned again from the current positions every
`RENEWAL_S`, and at the confirmation. A changed plan (`gcs.core.operator.plan_figures`) gets a new number, but
not before an operator could read the last one, unless it is urgent: a vehicle was lost, suspended or resumed,
a zone was closed, a vehicle would hit an obstacle. A confirmation of a plan that has changed meanwhile is
refused, and the new plan is proposed.

A rejected plan is not proposed again before something changes (`AgentRoutes.declined` keeps it).
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import replace

from gcs.config import Config
from gcs.core.airspace.no_fly_zones import NoFlyZones
from gcs.core.operator.operator_state import OperatorState, OrderInProgress
from gcs.core.operator.plan_figures import PlanFigures
from gcs.core.replanning.inputs import PlanningInputs
from gcs.core.replanning.replanner import Replanner
from gcs.core.state import Agent, flown_routes, without_missions
from gcs.model import (
    NS_PER_S,
    AnswerState,
    Authority,
    Effect,
    Order,
    OrderAnswer,
    Plan,
    Proposal,
    Route,
    RouteFigures,
    UploadReport,
    named,
    target_name,
    vehicle_name,
)

MIN_READING_S = 20.0
"""Minimum time between two numbers, unless the newer one is urgent."""
RENEWAL_S = 5.0
"""Interval at which the routes of a proposal are planned again."""


class PlanApproval:
    """Proposes plans, and carries out confirmations."""

    def __init__(
        self,
        config: Config,
        zones: NoFlyZones,
        replanner: Replanner,
        agents: Mapping[int, Agent],
        state: OperatorState,
    ) -> None:
        self._zones = zones
        self._replanner = replanner
        self._figures = PlanFigures(config)
        self._agents = agents
        self._operator = state
        self._state = state.approval

    # ------------------------------------------------------------ proposals

    def hurry(self) -> None:
        """Propose the next plan at once: a vehicle was lost."""
        self._state.is_urgent = True

    def check(self, inputs: PlanningInputs) -> list[Effect]:
        """Propose a new plan if there is a trigger, and renew the proposal that waits."""
        t_ns = inputs.t_ns
        state = self._state
        effects = self._withdraw(inputs)
        plan = self._replanner.check(inputs, urgent_only=self._is_early(t_ns) and not state.is_urgent)
        state.is_urgent = False
        if plan is not None:
            return effects + self._propose(plan, inputs)
        if state.pending is None or t_ns - state.renewed_t_ns < RENEWAL_S * NS_PER_S:
            return effects
        routes = state.pending.routes
        renewed = self._renew(routes, inputs)
        return effects + self._show(tuple(renewed.get(r.vehicle, r) for r in routes), inputs)

    def refresh(self, t_ns: int, untaskable: Container[int] = ()) -> list[Effect]:
        """Remove lost, suspended and overridden vehicles from the proposal."""
        pending = self._state.pending
        if pending is None:
            return []
        left = tuple(
            route
            for route in pending.routes
            if route.is_same(self._agents[route.vehicle].routes.proposed) and route.vehicle not in untaskable
        )
        return [] if len(left) == len(pending.routes) else self._keep(t_ns, left)

    def refresh_ours(self, t_ns: int) -> list[Effect]:
        """Remove the vehicles as well that get no mission now: not ours, or unable to fly."""
        if self._state.pending is None:
            return []
        return self.refresh(t_ns, without_missions(self._agents))

    def changed_control(self) -> list[int]:
        """Return the active vehicles that came under control, or left it, since the waiting plan was made."""
        if self._state.pending is None:
            return []
        return [vehicle for vehicle, agent in sorted(self._agents.items()) if _has_changed_control(agent)]

    def _withdraw(self, inputs: PlanningInputs) -> list[Effect]:
        """Remove vehicles that are about to reach a target on their flown routes."""
        self._replanner.withdraw_arriving(inputs)
        return self.refresh(inputs.t_ns)

    def _is_early(self, t_ns: int) -> bool:
        """Return True if the last proposal is too new to have been read."""
        numbered_t_ns = self._state.numbered_t_ns
        return numbered_t_ns is not None and t_ns - numbered_t_ns < MIN_READING_S * NS_PER_S

    def _propose(self, plan: Plan, inputs: PlanningInputs, *, new_number: bool = False) -> list[Effect]:
        """Propose a plan; it keeps the number of the last one with the same assignment."""
        pending = self._state.pending
        self._state.plan = plan
        agents = [agent for _, agent in sorted(self._agents.items())]
        proposed = [agent.routes.proposed for agent in agents if agent.routes.declined is None]
        waiting = tuple(route for route in proposed if route is not None)
        if not waiting:
            return self._withdraw_all(plan.t_ns, plan.reason)
        before = pending.routes if pending is not None else ()
        if new_number or not _assignment(waiting) <= _assignment(before):
            return self._number(waiting, plan.reason, inputs)
        return self._show(waiting, inputs)

    def _number(self, routes: tuple[Route, ...], reason: str, inputs: PlanningInputs) -> list[Effect]:
        """Propose routes under a new number."""
        state = self._state
        state.count += 1
        state.numbered_t_ns = state.renewed_t_ns = inputs.t_ns
        figures = self._figures_of(routes, inputs, {})
        state.shown = {one.vehicle: one for one in figures}
        state.pending = Proposal(inputs.t_ns, state.count, routes, reason, inputs.t_ns, figures)
        return [state.pending]

    def _show(self, routes: tuple[Route, ...], inputs: PlanningInputs) -> list[Effect]:
        """Propose renewed routes under the same number, or under a new one if they have changed."""
        state = self._state
        assert state.pending is not None
        figures = self._figures_of(routes, inputs, state.shown)
        changes = self._changes(routes, figures)
        if changes and not self._is_early(inputs.t_ns):
            return self._number(routes, "; ".join(changes), inputs)
        state.renewed_t_ns = inputs.t_ns
        state.pending = replace(state.pending, t_ns=inputs.t_ns, routes=routes, figures=figures)
        return [state.pending]

    def _renew(self, routes: Iterable[Route], inputs: PlanningInputs) -> dict[int, Route]:
        """Plan routes to the same targets again; none for a vehicle without a path."""
        return self._replanner.renew({route.vehicle: route.target for route in routes}, inputs)

    def _figures_of(
        self, routes: Sequence[Route], inputs: PlanningInputs, shown: dict[int, RouteFigures]
    ) -> tuple[RouteFigures, ...]:
        delays_s = {vehicle: self._replanner.starts.delivery_s(vehicle, inputs) for vehicle in inputs.agents}
        apart_m = self._replanner.separation_m(inputs)
        short = {v for v, agent in self._agents.items() if agent.routes.is_short}
        return self._figures.of(routes, shown, self._zones.grid, inputs, delays_s, apart_m, short)

    def _changes(self, routes: Sequence[Route], figures: Sequence[RouteFigures]) -> list[str]:
        """Return the changes of routes since they were first shown, in words."""
        pairs = zip(routes, figures, strict=True)
        shown = self._state.shown
        found = [self._figures.change(r, now, shown[r.vehicle]) for r, now in pairs]
        return [text for text in found if text]

    # ------------------------------------------------------------ orders

    def answer(self, order: Order) -> list[Effect]:
        """Answer an order that asks for the proposal."""
        state = self._state
        if state.pending is None:
            return [OrderInProgress(order).answer(order.t_ns, "refused", "no plan waits")]
        state.pending = replace(state.pending, t_ns=order.t_ns)
        return [OrderInProgress(order).showing(state.pending)]

    def decide(self, order: Order, inputs: PlanningInputs) -> tuple[list[Effect], list[Route]]:
        """Confirm or reject a proposal; return effects, and the routes to upload."""
        effects = self._withdraw(inputs)
        refusal = self._refusal(order)
        if refusal:
            return [*effects, OrderInProgress(order).answer(order.t_ns, "refused", refusal)], []
        pending = self._state.pending
        assert pending is not None
        chosen = [r for r in pending.routes if order.vehicles is None or r.vehicle in order.vehicles]
        if order.action == "confirm":
            return self._confirm(order, chosen, inputs)
        vehicles = [route.vehicle for route in chosen]
        for vehicle in vehicles:
            self._agents[vehicle].routes.decline()
        text = f"plan {pending.plan_id} rejected for {named(vehicles)}"
        left = tuple(route for route in pending.routes if route.vehicle not in vehicles)
        return [OrderInProgress(order).answer(order.t_ns, "done", text), *self._keep(order.t_ns, left)], []

    def _confirm(
        self, order: Order, chosen: list[Route], inputs: PlanningInputs
    ) -> tuple[list[Effect], list[Route]]:
        """Adopt the confirmed routes, from the current positions; refuse a plan that has changed."""
        pending = self._state.pending
        assert pending is not None
        vehicles = tuple(route.vehicle for route in chosen)
        renewed = self._renew(chosen, inputs)
        routes = tuple(renewed.get(r.vehicle, r) for r in pending.routes)
        self._state.pending = replace(pending, routes=routes)
        flown = [route for route in routes if route.vehicle in vehicles]
        problems = self._problems(flown, renewed, inputs)
        if problems:
            return self._refused(order, problems, inputs), []
        effects: list[Effect] = []
        ongoing = OrderInProgress(order, vehicles)
        number = self._operator.begin(ongoing)
        for vehicle in vehicles:
            effects += self.end(vehicle, order.t_ns, "replaced by a newer plan")
            self._agents[vehicle].orders.confirmation = number
        left = tuple(route for route in routes if route.vehicle not in vehicles)
        plan = self._adopt(order, flown, inputs, whole=not left)
        effects.append(ongoing.answer(order.t_ns, "accepted", f"missions go to {named(vehicles)}"))
        return [*effects, *self._keep(order.t_ns, left), plan], flown

    def _problems(
        self, routes: Sequence[Route], renewed: Container[int], inputs: PlanningInputs
    ) -> list[str]:
        """Return why confirmed routes differ from those that were shown, in words."""
        found = [
            f"agent {vehicle_name(vehicle)} is ours to task again"
            for vehicle in self.changed_control()
            if vehicle in inputs.agents
        ]
        for route in routes:
            if route.vehicle not in inputs.agents:
                why = inputs.untaskable.get(route.vehicle, "is not seen by any sensor now")
                found.append(f"agent {vehicle_name(route.vehicle)} {why}")
            elif route.target not in inputs.targets:
                found.append(f"target {target_name(route.target)} is not there any more")
            elif route.vehicle not in renewed:
                target = target_name(route.target)
                found.append(f"no way leads agent {vehicle_name(route.vehicle)} to target {target} now")
        return found or self._changes(routes, self._figures_of(routes, inputs, self._state.shown))

    def _refused(self, order: Order, problems: list[str], inputs: PlanningInputs) -> list[Effect]:
        """Refuse a plan that has changed, and propose the new one."""
        text = "; ".join(problems)
        plan = self._replanner.plan_anew(inputs, text)
        effects = self._propose(plan, inputs, new_number=True)
        pending = self._state.pending
        again = "no plan waits now" if pending is None else f"plan {pending.plan_id} waits instead"
        detail = f"plan {order.plan_id} is not the plan that was shown any more: {text}; {again}"
        return [OrderInProgress(order).answer(order.t_ns, "refused", detail), *effects]

    def uploaded(self, report: UploadReport) -> list[OrderAnswer]:
        """Answer a confirmation after the upload to a vehicle."""
        text = f"mission {report.detail}" if report.ok else f"mission transfer failed: {report.detail}"
        return self._finish(report.vehicle, report.t_ns, "done" if report.ok else "failed", text)

    def end(self, vehicle: int, t_ns: int, reason: str) -> list[OrderAnswer]:
        """Answer that a confirmed mission will not be flown."""
        return self._finish(vehicle, t_ns, "failed", reason)

    def _finish(self, vehicle: int, t_ns: int, state: AnswerState, detail: str) -> list[OrderAnswer]:
        orders = self._agents[vehicle].orders
        number = orders.confirmation
        orders.confirmation = None
        return [] if number is None else [self._operator.finish(number, t_ns, state, detail, vehicle)]

    def _refusal(self, order: Order) -> str:
        pending = self._state.pending
        if pending is None:
            return "no plan waits"
        if order.plan_id != pending.plan_id:
            return f"that plan is no longer the one shown: plan {pending.plan_id} is ({pending.reason})"
        missing = set(order.vehicles or ()) - {route.vehicle for route in pending.routes}
        return f"nothing waits for {named(missing)} in plan {order.plan_id}" if missing else ""

    def _adopt(self, order: Order, chosen: list[Route], inputs: PlanningInputs, *, whole: bool) -> Plan:
        """Make routes the flown ones; return them as a plan."""
        plan = self._state.plan
        pending = self._state.pending
        assert plan is not None
        assert pending is not None
        for route in chosen:
            self._agents[route.vehicle].routes.adopt(route)
        if whole and all(agent.routes.declined is None for agent in self._agents.values()):
            routed = {route.vehicle for route in plan.routes}
            for vehicle, agent in self._agents.items():
                if agent.routes.is_planned and vehicle not in routed:
                    agent.routes.drop_flown()
        return replace(
            plan,
            t_ns=order.t_ns,
            picture_t_ns=inputs.picture_t_ns,
            routes=tuple(flown_routes(self._agents).values()),
            reason=f"plan {order.plan_id} confirmed: {pending.reason}",
            changed=tuple(route.vehicle for route in chosen),
        )

    def _keep(self, t_ns: int, left: tuple[Route, ...]) -> list[Effect]:
        pending = self._state.pending
        assert pending is not None
        if not left:
            return self._withdraw_all(t_ns, pending.reason)
        vehicles = {route.vehicle for route in left}
        figures = tuple(one for one in pending.figures if one.vehicle in vehicles)
        self._state.pending = replace(pending, t_ns=t_ns, routes=left, figures=figures)
        return [self._state.pending]

    def _withdraw_all(self, t_ns: int, reason: str) -> list[Effect]:
        before = self._state.pending
        self._state.pending = None
        return [] if before is None else [Proposal(t_ns, before.plan_id, (), reason, before.shown_t_ns)]


def _assignment(routes: Iterable[Route]) -> frozenset[tuple[int, object]]:
    return frozenset((route.vehicle, route.target) for route in routes)


def _has_changed_control(agent: Agent) -> bool:
    """Return True if an active vehicle came under control, or left it, since the last plan."""
    perception = agent.perception
    is_ours = agent.control.authority is Authority.OURS
    is_seen = perception.association.label is not None
    return (
        perception.status.status == "active"
        and agent.routes.is_planned is not is_ours
        and (is_seen or not is_ours)
    )
