"""An operator's orders to vehicles: hold, resume, return, arm, disarm, and what became of each.

An order sets a vehicle aside at once: from then on it is not tasked, whatever becomes of the command. A
mission transfer under way is given up first, safely: the vehicle keeps a whole mission, or holds and is
cleared. "Done" is said when the vehicle's own heartbeat shows it (`gcs.mavlink.errand`).

A vehicle that is resumed goes back to its mission when that is whole and nobody else has its target by now;
otherwise it waits in LOITER for the next plan. No mission is sent to it before it does: one that started it
would be undone by the LOITER that is still on its way.

Arming happens here and nowhere else, and only for an order that says so. Disarming is refused unless the
vehicle reports that it stands on the ground, and it is never forced: the autopilot may refuse it as well.
"""

from __future__ import annotations

from collections.abc import Callable, Container
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.command.answers import Ongoing, named
from gcs.command.replanning import Replanner
from gcs.command.tasking import Tasking
from gcs.mavlink.codec import Message
from gcs.mavlink.commands import command, set_mode
from gcs.mavlink.errand import Errand, Shown
from gcs.mavlink.fleet import Fleet
from gcs.mavlink.modes import AUTO, LOITER, RTL
from gcs.model import Aside, Effect, Label, Order, Route, VehicleState, vehicle_name

_ARM_DISARM: Final[int] = dialect.MAV_CMD_COMPONENT_ARM_DISARM
_SET_ASIDE: Final = {"hold": LOITER, "return": RTL}
_WORDS: Final = {"hold": "is held by order", "return": "returns by order", "found": "flies another mission"}
_PILOTED: Final = frozenset(
    {"MANUAL", "STABILIZE", "STABILIZED", "TRAINING", "ACRO", "FBWA", "FBWB", "CRUISE", "AUTOTUNE"}
    | {"ALTCTL", "POSCTL", "RATTITUDE", "QSTABILIZE", "QHOVER", "QACRO"}
)
"""Somebody has the sticks: we do not take the aircraft out of their hands."""
_STANDING_M_S = 2.0
_STANDING_M = 5.0


class Orders:
    """Orders to vehicles under way, and who is set aside by one.

    Parameters
    ----------
    fleet : Fleet
        Addresses, sequences, and what vehicles say of themselves.
    tasking : Tasking
        Whose transfers an order ends.
    replanner : Replanner
        Who flies what.
    """

    def __init__(self, fleet: Fleet, tasking: Tasking, replanner: Replanner) -> None:
        self.aside: dict[int, Aside] = {}
        """Vehicles that are not tasked, and why."""
        self.suspended: dict[int, Route] = {}
        """Whole routes of vehicles set aside."""
        self._fleet, self._tasking, self._replanner = fleet, tasking, replanner
        self._errands: dict[int, tuple[Errand, Ongoing]] = {}

    def away(self) -> dict[int, str]:
        """Vehicles that are not to be tasked now, and why, in words."""
        routes = self._replanner.routes
        waiting = {
            vehicle: "is told to wait for a mission"
            for vehicle, (_, ongoing) in self._errands.items()
            if ongoing.order.action == "resume" and vehicle not in routes
        }
        return waiting | {vehicle: _WORDS[why] for vehicle, why in self.aside.items()}

    @property
    def commanded(self) -> Container[int]:
        """Vehicles that are being told what to do, and have not shown it."""
        return self._errands

    def take(self, order: Order, targets: Container[Label]) -> list[Effect]:
        """Begin to carry out an order to vehicles.

        Parameters
        ----------
        order
            One of hold, resume, return, arm, disarm.
        targets
            Those that are there to be flown to.
        """
        known = {health.system_id: health for health in self._fleet.health()}
        vehicles = order.vehicles if order.vehicles is not None else tuple(known)
        ongoing = Ongoing(order, set(vehicles))
        effects: list[Effect] = []
        begun = []
        for vehicle in vehicles:
            if vehicle not in known:
                refusal = f"no vehicle of this mission; it has {', '.join(map(vehicle_name, known))}"
            elif known[vehicle].address is None:
                refusal = "never heard"
            else:
                refusal = self._refusal(order, vehicle)
            if refusal:
                effects.append(ongoing.answer(order.t_ns, "refused", refusal, vehicle))
            else:
                begun.append(vehicle)
        for vehicle in begun:
            effects += self._begin(ongoing, vehicle, known[vehicle].autopilot, targets)
        if not ongoing.waiting:
            return effects
        return [ongoing.answer(order.t_ns, "accepted", named(ongoing.waiting)), *effects]

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Take a vehicle's message."""
        if vehicle not in self._errands:
            return []
        self._errands[vehicle][0].receive(message)
        return self._worked(vehicle, t_ns)

    def poll(self, t_ns: int) -> list[Effect]:
        """Let timers run."""
        return [effect for vehicle in list(self._errands) for effect in self._worked(vehicle, t_ns)]

    # ------------------------------------------------------------ one vehicle

    def _refusal(self, order: Order, vehicle: int) -> str:
        state = self._fleet.state(vehicle)
        if order.action == "resume" and state is not None and state.mode in _PILOTED:
            return f"is in {state.mode}: whoever flies it has to give it back"
        if order.action == "disarm":
            return self._airborne(vehicle, state)
        return ""

    def _airborne(self, vehicle: int, state: VehicleState | None) -> str:
        """Say why it may be in the air; empty when it reports that it stands on the ground."""
        home = self._fleet.home(vehicle)
        if state is None or home is None:
            return "its position and home are not known: it may be in the air"
        height_m = state.alt_msl_m - home.alt_msl_m
        if state.ground_speed_m_s > _STANDING_M_S or abs(height_m) > _STANDING_M:
            return f"is in the air: {height_m:.0f} m above home, {state.ground_speed_m_s:.0f} m/s"
        return ""

    def _begin(
        self, ongoing: Ongoing, vehicle: int, autopilot: int, targets: Container[Label]
    ) -> list[Effect]:
        order = ongoing.order
        effects: list[Effect] = self._give_up(vehicle, order.t_ns, f"replaced by an order to {order.action}")
        if order.action in ("arm", "disarm"):
            arm = order.action == "arm"
            question = command(vehicle, _ARM_DISARM, 1.0 if arm else 0.0)
            return effects + self._send(ongoing, vehicle, question, lambda shown: shown.armed is arm)
        if order.action == "resume":
            if vehicle not in self.aside and self._is_taskable(vehicle):
                return [*effects, ongoing.answer(order.t_ns, "done", "was not set aside", vehicle)]
            mode = self._take_up(vehicle, targets)
        else:
            mode = _SET_ASIDE[order.action]
            effects += self._set_aside(vehicle, "hold" if order.action == "hold" else "return", order.t_ns)
        question = set_mode(vehicle, autopilot, mode)
        return effects + self._send(ongoing, vehicle, question, lambda shown: shown.mode == mode)

    def _is_taskable(self, vehicle: int) -> bool:
        state = self._fleet.state(vehicle)
        return state is not None and state.mode in (AUTO, LOITER)

    def _set_aside(self, vehicle: int, why: Aside, t_ns: int) -> list[Effect]:
        self.aside[vehicle] = why
        route = self._replanner.routes.get(vehicle)
        if route is not None and vehicle not in self._tasking.under_way:
            self.suspended[vehicle] = route
        self._replanner.drop(vehicle)
        return self._tasking.abandon(vehicle, f"given up for an order to {why}", t_ns)

    def _take_up(self, vehicle: int, targets: Container[Label]) -> str:
        """Let a vehicle be tasked again; returns the mode to fly in until then."""
        self.aside.pop(vehicle, None)
        self._tasking.release(vehicle)
        route = self.suspended.pop(vehicle, None)
        if vehicle in self._replanner.routes:
            return AUTO if vehicle not in self._tasking.under_way else LOITER
        if route is None or route.target not in targets or route.target in self._replanner.assigned.values():
            return LOITER
        self._replanner.routes[vehicle] = route
        return AUTO

    # ------------------------------------------------------------ errands

    def _send(
        self, ongoing: Ongoing, vehicle: int, question: Message, wanted: Callable[[Shown], bool]
    ) -> list[Effect]:
        errand = Errand(question, wanted, self._fleet.encoder(vehicle), ongoing.order.t_ns)
        self._errands[vehicle] = (errand, ongoing)
        return self._worked(vehicle, ongoing.order.t_ns)

    def _worked(self, vehicle: int, t_ns: int) -> list[Effect]:
        errand, ongoing = self._errands[vehicle]
        effects: list[Effect] = [*self._fleet.sends(vehicle, errand.poll(t_ns))]
        self._fleet.attend(vehicle)
        if errand.outcome is not None:
            del self._errands[vehicle]
            done, detail = errand.outcome
            if ongoing.order.action == "resume" and not done and vehicle not in self._tasking.under_way:
                self._replanner.undelivered(vehicle)  # it does not fly its route: the next plan has another
            effects.append(ongoing.answer(t_ns, "done" if done else "failed", detail, vehicle))
        return effects

    def _give_up(self, vehicle: int, t_ns: int, why: str) -> list[Effect]:
        """End the errand under way, if there is one: the newest order counts."""
        if vehicle not in self._errands:
            return []
        _, ongoing = self._errands.pop(vehicle)
        return [ongoing.answer(t_ns, "failed", why, vehicle)]
