"""Plans that wait for an operator's word: `planning.retask = "confirm"`.

The newest plan is the one that is shown, under a number that counts up. Nothing of it is uploaded before it
is confirmed, whole or for some vehicles; a number that is no longer shown is refused, so that nobody confirms
what he has not seen. Until then every vehicle flies the mission that it has. What was rejected is not
proposed again before something changes (`Replanner.proposed` remembers it).
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import replace

from gcs.command.answers import Ongoing, named
from gcs.command.replanning import Replanner
from gcs.model import Effect, Order, OrderAnswer, Plan, Proposal, Route, UploadReport


class Approval:
    """The plan that waits, and the orders about it that are being carried out.

    Parameters
    ----------
    replanner : Replanner
        Who flies what, and what was put to the operator.
    """

    def __init__(self, replanner: Replanner) -> None:
        self.pending: Proposal | None = None
        self.count = 0
        """The last plan's number."""
        self._replanner = replanner
        self._plan: Plan | None = None
        self._declined: dict[int, Route] = {}
        self._confirmed: dict[int, Ongoing] = {}

    def propose(self, plan: Plan) -> list[Effect]:
        """Show a plan in place of the one before; nothing when what waits is the same."""
        shown = self._replanner.proposed
        self._declined = {v: route for v, route in self._declined.items() if shown.get(v) is route}
        waiting = tuple(route for v, route in sorted(shown.items()) if v not in self._declined)
        self._plan = plan
        if _same(waiting, self.pending.routes if self.pending is not None else ()):
            return []
        if not waiting:
            return self._none_waits(plan.t_ns, plan.reason)
        self.count += 1
        self.pending = Proposal(plan.t_ns, self.count, waiting, plan.reason)
        return [self.pending]

    def refresh(self, t_ns: int, away: Container[int] = ()) -> list[Effect]:
        """Take out of the plan that waits whoever died, was held or taken over since."""
        if self.pending is None:
            return []
        shown = self._replanner.proposed
        left = tuple(r for r in self.pending.routes if shown.get(r.vehicle) is r and r.vehicle not in away)
        if len(left) == len(self.pending.routes):
            return []
        return self._left(t_ns, left)

    def take(self, order: Order) -> tuple[list[Effect], list[Route]]:
        """Carry out a confirm or reject; returns what to tell, and the routes to send as missions."""
        refusal = self._refusal(order)
        if refusal:
            return [Ongoing(order).answer(order.t_ns, "refused", refusal)], []
        pending = self.pending
        assert pending is not None
        chosen = [r for r in pending.routes if order.vehicles is None or r.vehicle in order.vehicles]
        left = tuple(
            r for r in pending.routes if order.vehicles is not None and r.vehicle not in order.vehicles
        )
        if order.action == "reject":
            self._declined |= {route.vehicle: route for route in chosen}
            text = f"plan {pending.plan_id} rejected for {named(r.vehicle for r in chosen)}"
            return [Ongoing(order).answer(order.t_ns, "done", text), *self._left(order.t_ns, left)], []
        effects: list[Effect] = []
        ongoing = Ongoing(order, (route.vehicle for route in chosen))
        for route in chosen:
            effects += self.end(route.vehicle, order.t_ns, "replaced by a newer plan")
            self._confirmed[route.vehicle] = ongoing
        plan = self._adopt(order, chosen, whole=not left)
        effects.append(ongoing.answer(order.t_ns, "accepted", f"missions go to {named(ongoing.waiting)}"))
        return [*effects, *self._left(order.t_ns, left), plan], chosen

    def uploaded(self, report: UploadReport) -> list[OrderAnswer]:
        """Answer for a vehicle whose mission was confirmed, now that its transfer has ended."""
        ongoing = self._confirmed.pop(report.vehicle, None)
        if ongoing is None:
            return []
        text = f"mission {report.detail}" if report.ok else f"mission transfer failed: {report.detail}"
        return [ongoing.answer(report.t_ns, "done" if report.ok else "failed", text, report.vehicle)]

    def end(self, vehicle: int, t_ns: int, why: str) -> list[OrderAnswer]:
        """Answer that a confirmed mission will not be flown."""
        ongoing = self._confirmed.pop(vehicle, None)
        return [] if ongoing is None else [ongoing.answer(t_ns, "failed", why, vehicle)]

    def _refusal(self, order: Order) -> str:
        if self.pending is None:
            return "no plan waits"
        if order.plan_id != self.pending.plan_id:
            return f"that plan is no longer the one shown: plan {self.pending.plan_id} is"
        missing = set(order.vehicles or ()) - {route.vehicle for route in self.pending.routes}
        return f"nothing waits for {named(missing)} in plan {order.plan_id}" if missing else ""

    def _adopt(self, order: Order, chosen: list[Route], *, whole: bool) -> Plan:
        """Make routes the ones that are flown, and say so as a plan."""
        plan, replanner = self._plan, self._replanner
        assert plan is not None
        for route in chosen:
            replanner.adopt(route)
        if whole and not self._declined:
            replanner.keep_only({route.vehicle for route in plan.routes})
        return replace(
            plan,
            t_ns=order.t_ns,
            routes=tuple(route for _, route in sorted(replanner.routes.items())),
            reason=f"plan {order.plan_id} confirmed: {plan.reason}",
            changed=tuple(route.vehicle for route in chosen),
        )

    def _left(self, t_ns: int, left: tuple[Route, ...]) -> list[Effect]:
        assert self.pending is not None
        if not left:
            return self._none_waits(t_ns, self.pending.reason)
        self.pending = replace(self.pending, t_ns=t_ns, routes=left)
        return [self.pending]

    def _none_waits(self, t_ns: int, reason: str) -> list[Effect]:
        before, self.pending = self.pending, None
        return [] if before is None else [Proposal(t_ns, before.plan_id, (), reason)]


def _same(one: tuple[Route, ...], other: tuple[Route, ...]) -> bool:
    return len(one) == len(other) and all(a is b for a, b in zip(one, other, strict=True))
