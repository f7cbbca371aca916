"""Plans that wait for an operator's approval (`planning.retask = "confirm"`).

Each proposal has a number. Nothing is uploaded before it is confirmed, as a whole or for some vehicles. Until
then every vehicle flies its present mission.

A number stays while the assignment stays. Its routes are planned again from the current positions every
`RENEWAL_S`, and at the confirmation. A changed plan (`gcs.core.operator.plan_figures`) gets a new number, but
not before an operator could read the last one, unless it is urgent: a vehicle was lost or suspended, a zone
was closed, a vehicle would hit an obstacle. A confirmation of a plan that has changed meanwhile is refused,
and the new plan is proposed.

A rejected plan is not proposed again before something changes (`Replanner.proposed` keeps it).
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import replace

from gcs.config import Config
from gcs.core.airspace.no_fly_zones import NoFlyZones
from gcs.core.operator.plan_figures import PlanFigures
from gcs.core.operator.replies import OrderInProgress, named
from gcs.core.replanning.inputs import PlanningInputs
from gcs.core.replanning.plan_targets import place_of
from gcs.core.replanning.replanner import Replanner
from gcs.model import (
    NS_PER_S,
    Effect,
    Order,
    OrderAnswer,
    Plan,
    Proposal,
    Route,
    RouteFigures,
    UploadReport,
    target_name,
    vehicle_name,
)

MIN_READING_S = 20.0
"""Minimum time between two numbers, unless the newer one is urgent."""
RENEWAL_S = 5.0
"""Interval at which the routes of a proposal are planned again."""


class PlanApproval:
    """The proposal that waits, and its confirmations in progress."""

    def __init__(self, config: Config, zones: NoFlyZones, replanner: Replanner) -> None:
        self.pending: Proposal | None = None
        self.count = 0
        """Number of the last proposal."""
        self._zones, self._replanner, self._figures = zones, replanner, PlanFigures(config)
        self._plan: Plan | None = None
        self._shown: dict[int, RouteFigures] = {}
        """Figures of each vehicle when the number was first shown."""
        self._numbered_t_ns: int | None = None
        self._renewed_t_ns = 0
        self._is_urgent = False
        self._declined: dict[int, Route] = {}
        self._confirmed: dict[int, OrderInProgress] = {}

    # ------------------------------------------------------------ proposals

    def hurry(self) -> None:
        """Propose the next plan at once: a vehicle was lost."""
        self._is_urgent = True

    def check(self, inputs: PlanningInputs) -> list[Effect]:
        """Propose a new plan if there is a trigger, and renew the proposal that waits."""
        t_ns = inputs.t_ns
        effects = self._withdraw(inputs)
        plan = self._replanner.check(inputs, urgent_only=self._is_early(t_ns) and not self._is_urgent)
        self._is_urgent = False
        if plan is not None:
            return effects + self._propose(plan, inputs)
        if self.pending is None or t_ns - self._renewed_t_ns < RENEWAL_S * NS_PER_S:
            return effects
        renewed = self._renew(self.pending.routes, inputs)
        return effects + self._show(tuple(renewed[r.vehicle] for r in self.pending.routes), inputs)

    def refresh(self, t_ns: int, untaskable: Container[int] = ()) -> list[Effect]:
        """Remove lost, suspended and overridden vehicles from the proposal."""
        if self.pending is None:
            return []
        shown = self._replanner.proposed
        left = tuple(
            r for r in self.pending.routes if shown.get(r.vehicle) is r and r.vehicle not in untaskable
        )
        return [] if len(left) == len(self.pending.routes) else self._keep(t_ns, left)

    def _withdraw(self, inputs: PlanningInputs) -> list[Effect]:
        """Remove vehicles that are about to reach a target on their flown routes."""
        self._replanner.withdraw_arriving(inputs)
        return self.refresh(inputs.t_ns)

    def _is_early(self, t_ns: int) -> bool:
        """Return True if the last proposal is too new to have been read."""
        return self._numbered_t_ns is not None and t_ns - self._numbered_t_ns < MIN_READING_S * NS_PER_S

    def _propose(self, plan: Plan, inputs: PlanningInputs, *, new_number: bool = False) -> list[Effect]:
        """Propose a plan; it keeps the number of the last one with the same assignment."""
        shown, self._plan = self._replanner.proposed, plan
        self._declined = {v: route for v, route in self._declined.items() if shown.get(v) is route}
        waiting = tuple(route for v, route in sorted(shown.items()) if v not in self._declined)
        if not waiting:
            return self._withdraw_all(plan.t_ns, plan.reason)
        before = self.pending.routes if self.pending is not None else ()
        if new_number or not _assignment(waiting) <= _assignment(before):
            return self._number(waiting, plan.reason, inputs)
        return self._show(waiting, inputs)

    def _number(self, routes: tuple[Route, ...], reason: str, inputs: PlanningInputs) -> list[Effect]:
        """Propose routes under a new number."""
        self.count += 1
        self._numbered_t_ns = self._renewed_t_ns = inputs.t_ns
        figures = self._figures_of(routes, inputs, {})
        self._shown = {one.vehicle: one for one in figures}
        self.pending = Proposal(inputs.t_ns, self.count, routes, reason, inputs.t_ns, figures)
        return [self.pending]

    def _show(self, routes: tuple[Route, ...], inputs: PlanningInputs) -> list[Effect]:
        """Propose renewed routes under the same number, or under a new one if they have changed."""
        assert self.pending is not None
        figures = self._figures_of(routes, inputs, self._shown)
        changes = self._changes(routes, figures)
        if changes and not self._is_early(inputs.t_ns):
            return self._number(routes, "; ".join(changes), inputs)
        self._renewed_t_ns = inputs.t_ns
        self.pending = replace(self.pending, t_ns=inputs.t_ns, routes=routes, figures=figures)
        return [self.pending]

    def _renew(self, routes: Iterable[Route], inputs: PlanningInputs) -> dict[int, Route]:
        """Plan routes to the same targets again; without a path the old route stays."""
        old = {route.vehicle: route for route in routes}
        return old | self._replanner.renew({v: route.target for v, route in old.items()}, inputs)

    def _figures_of(
        self, routes: Sequence[Route], inputs: PlanningInputs, shown: dict[int, RouteFigures]
    ) -> tuple[RouteFigures, ...]:
        replanner = self._replanner
        positions = {vehicle: place_of(track) for vehicle, track in inputs.agents.items()}
        apart_m = replanner.separation_m(inputs)
        return self._figures.of(routes, shown, self._zones.grid, positions, apart_m, replanner.short)

    def _changes(self, routes: Sequence[Route], figures: Sequence[RouteFigures]) -> list[str]:
        """Return the changes of routes since they were first shown, in words."""
        pairs = zip(routes, figures, strict=True)
        found = [self._figures.change(r, now, self._shown[r.vehicle]) for r, now in pairs]
        return [text for text in found if text]

    # ------------------------------------------------------------ orders

    def answer(self, order: Order) -> list[Effect]:
        """Answer an order that asks for the proposal."""
        if self.pending is None:
            return [OrderInProgress(order).answer(order.t_ns, "refused", "no plan waits")]
        self.pending = replace(self.pending, t_ns=order.t_ns)
        return [OrderInProgress(order).showing(self.pending)]

    def decide(self, order: Order, inputs: PlanningInputs) -> tuple[list[Effect], list[Route]]:
        """Confirm or reject a proposal; return effects, and the routes to upload."""
        effects = self._withdraw(inputs)
        refusal = self._refusal(order)
        if refusal:
            return [*effects, OrderInProgress(order).answer(order.t_ns, "refused", refusal)], []
        pending = self.pending
        assert pending is not None
        chosen = [r for r in pending.routes if order.vehicles is None or r.vehicle in order.vehicles]
        if order.action == "confirm":
            return self._confirm(order, chosen, inputs)
        self._declined |= {route.vehicle: route for route in chosen}
        text = f"plan {pending.plan_id} rejected for {named(r.vehicle for r in chosen)}"
        left = tuple(route for route in pending.routes if route not in chosen)
        return [OrderInProgress(order).answer(order.t_ns, "done", text), *self._keep(order.t_ns, left)], []

    def _confirm(
        self, order: Order, chosen: list[Route], inputs: PlanningInputs
    ) -> tuple[list[Effect], list[Route]]:
        """Adopt the confirmed routes, from the current positions; refuse a plan that has changed."""
        pending = self.pending
        assert pending is not None
        vehicles = [route.vehicle for route in chosen]
        renewed = self._renew(chosen, inputs)
        routes = tuple(renewed.get(r.vehicle, r) for r in pending.routes)
        self.pending = pending = replace(pending, routes=routes)
        flown = [renewed[vehicle] for vehicle in vehicles]
        problems = self._problems(flown, inputs)
        if problems:
            return self._refused(order, problems, inputs), []
        effects: list[Effect] = []
        ongoing = OrderInProgress(order, vehicles)
        for vehicle in vehicles:
            effects += self.end(vehicle, order.t_ns, "replaced by a newer plan")
            self._confirmed[vehicle] = ongoing
        left = tuple(route for route in routes if route.vehicle not in vehicles)
        plan = self._adopt(order, flown, inputs, whole=not left)
        effects.append(ongoing.answer(order.t_ns, "accepted", f"missions go to {named(ongoing.waiting)}"))
        return [*effects, *self._keep(order.t_ns, left), plan], flown

    def _problems(self, routes: Sequence[Route], inputs: PlanningInputs) -> list[str]:
        """Return why confirmed routes differ from those that were shown, in words."""
        found = []
        for route in routes:
            if route.vehicle not in inputs.agents:
                why = inputs.untaskable.get(route.vehicle, "is not seen by any sensor now")
                found.append(f"agent {vehicle_name(route.vehicle)} {why}")
            elif route.target not in inputs.targets:
                found.append(f"target {target_name(route.target)} is not there any more")
            elif route.vehicle in self._replanner.unrouted:
                target = target_name(route.target)
                found.append(f"no way leads agent {vehicle_name(route.vehicle)} to target {target} now")
        return found or self._changes(routes, self._figures_of(routes, inputs, self._shown))

    def _refused(self, order: Order, problems: list[str], inputs: PlanningInputs) -> list[Effect]:
        """Refuse a plan that has changed, and propose the new one."""
        text = "; ".join(problems)
        plan = self._replanner.plan_anew(inputs, text)
        effects = self._propose(plan, inputs, new_number=True)
        again = "no plan waits now" if self.pending is None else f"plan {self.pending.plan_id} waits instead"
        detail = f"plan {order.plan_id} is not the plan that was shown any more: {text}; {again}"
        return [OrderInProgress(order).answer(order.t_ns, "refused", detail), *effects]

    def uploaded(self, report: UploadReport) -> list[OrderAnswer]:
        """Answer a confirmation after the upload to a vehicle."""
        ongoing = self._confirmed.pop(report.vehicle, None)
        if ongoing is None:
            return []
        text = f"mission {report.detail}" if report.ok else f"mission transfer failed: {report.detail}"
        return [ongoing.answer(report.t_ns, "done" if report.ok else "failed", text, report.vehicle)]

    def end(self, vehicle: int, t_ns: int, reason: str) -> list[OrderAnswer]:
        """Answer that a confirmed mission will not be flown."""
        ongoing = self._confirmed.pop(vehicle, None)
        return [] if ongoing is None else [ongoing.answer(t_ns, "failed", reason, vehicle)]

    def _refusal(self, order: Order) -> str:
        if self.pending is None:
            return "no plan waits"
        if order.plan_id != self.pending.plan_id:
            return (
                f"that plan is no longer the one shown: plan {self.pending.plan_id} is "
                f"({self.pending.reason})"
            )
        missing = set(order.vehicles or ()) - {route.vehicle for route in self.pending.routes}
        return f"nothing waits for {named(missing)} in plan {order.plan_id}" if missing else ""

    def _adopt(self, order: Order, chosen: list[Route], inputs: PlanningInputs, *, whole: bool) -> Plan:
        """Make routes the flown ones; return them as a plan."""
        plan, replanner = self._plan, self._replanner
        assert plan is not None
        assert self.pending is not None
        reason = self.pending.reason
        for route in chosen:
            replanner.adopt(route)
        if whole and not self._declined:
            replanner.keep_only({route.vehicle for route in plan.routes})
        return replace(
            plan,
            t_ns=order.t_ns,
            picture_t_ns=inputs.picture_t_ns,
            routes=tuple(route for _, route in sorted(replanner.routes.items())),
            reason=f"plan {order.plan_id} confirmed: {reason}",
            changed=tuple(route.vehicle for route in chosen),
        )

    def _keep(self, t_ns: int, left: tuple[Route, ...]) -> list[Effect]:
        assert self.pending is not None
        if not left:
            return self._withdraw_all(t_ns, self.pending.reason)
        vehicles = {route.vehicle for route in left}
        figures = tuple(one for one in self.pending.figures if one.vehicle in vehicles)
        self.pending = replace(self.pending, t_ns=t_ns, routes=left, figures=figures)
        return [self.pending]

    def _withdraw_all(self, t_ns: int, reason: str) -> list[Effect]:
        before, self.pending = self.pending, None
        return [] if before is None else [Proposal(t_ns, before.plan_id, (), reason, before.shown_t_ns)]


def _assignment(routes: Iterable[Route]) -> frozenset[tuple[int, object]]:
    return frozenset((route.vehicle, route.target) for route in routes)
