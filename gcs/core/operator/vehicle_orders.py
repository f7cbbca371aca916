"""An operator's orders to vehicles: hold, resume, return, arm, disarm, and what became of each.

An order sets a vehicle aside at once: from then on it is not tasked, whatever becomes of the command. A
mission transfer under way is given up first, safely: the vehicle keeps a whole mission, or holds and is
cleared. "Done" is said when the vehicle's own heartbeat shows it (`gcs.mavlink.services.command_sender`).

A vehicle that is resumed, whoever took it, goes back to its mission when that was read back from it and
nobody else has its target by now; otherwise it waits in LOITER for the next plan. No mission is sent to it
before it does: one that started it would be undone by the LOITER that is still on its way. Near the ground a
vehicle that returns or lands is not turned back: it has no room to turn in. An order that changes nothing is
refused, and says so.

Arming happens here and nowhere else, and only for an order that says so. It is refused in a mode in which the
vehicle would take off at once, unless it does so with a mission that was read back from it and is wanted now:
PX4 and ArduPlane both begin the stored mission anew when they are armed in AUTO. It is refused, too, while
another vehicle is in the way of that take-off (`gcs.core.tasking.takeoff_sequence`). Disarming is refused
unless the vehicle reports that it stands on the ground, and it is never forced: the autopilot may refuse it
as well.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Container, Mapping, Set
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.operator.replies import OrderInProgress, named
from gcs.core.replanning.replanner import Replanner
from gcs.core.replanning.return_heights import Returns
from gcs.core.tasking.takeoff_sequence import SELF_LAUNCHING, Departures
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.autopilots.base import is_on_ground
from gcs.mavlink.autopilots.modes import AUTO, LOITER, RTL
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.command_sender import CommandSender, HeartbeatState, command_long, set_mode
from gcs.model import AnswerState, Effect, Label, Notice, Order, Route, Suspension, VehicleState, vehicle_name

_ARM_DISARM: Final[int] = dialect.MAV_CMD_COMPONENT_ARM_DISARM
_SET_ASIDE: Final = {"hold": LOITER, "return": RTL}
_WORDS: Final = {"hold": "is held by order", "return": "returns by order", "found": "flies another mission"}
PILOTED: Final = frozenset(
    {"MANUAL", "STABILIZE", "STABILIZED", "TRAINING", "ACRO", "FBWA", "FBWB", "CRUISE", "AUTOTUNE"}
    | {"ALTCTL", "POSCTL", "RATTITUDE", "QSTABILIZE", "QHOVER", "QACRO"}
)
"""Somebody has the sticks: we do not take the aircraft out of their hands."""
_STANDING_M_S = 2.0
_STANDING_M = 5.0
MIN_RESUME_HEIGHT_M: Final = 40.0
"""Height above home below which a vehicle that returns or lands is not turned back: above the 30 m at which
the landing approaches of our missions begin."""


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
    departures : Departures
        Who is in the way of a take-off.
    returns : Returns
        Who flies home at one height.
    outlook : callable
        What a vehicle that waits in LOITER, released, can expect; in words.
    """

    def __init__(
        self,
        fleet: Fleet,
        tasking: UploadManager,
        replanner: Replanner,
        departures: Departures,
        returns: Returns,
        outlook: Callable[[int], str] = lambda _vehicle: "waits for its next mission",
    ) -> None:
        self.suspensions: dict[int, Suspension] = {}
        """Vehicles that are not tasked, and why."""
        self.suspended_routes: dict[int, Route] = {}
        """Whole routes of vehicles set aside."""
        self._fleet, self._tasking, self._replanner, self._outlook = fleet, tasking, replanner, outlook
        self._departures, self._returns = departures, returns
        self._errands: dict[int, tuple[CommandSender, OrderInProgress]] = {}

    def untaskable(self) -> dict[int, str]:
        """Vehicles that are not to be tasked now, and why, in words."""
        routes = self._replanner.routes
        waiting = {
            vehicle: "is told to wait for a mission"
            for vehicle, (_, ongoing) in self._errands.items()
            if ongoing.order.action == "resume" and vehicle not in routes
        }
        return waiting | {vehicle: _WORDS[why] for vehicle, why in self.suspensions.items()}

    @property
    def commanded(self) -> Set[int]:
        """Vehicles that are being told what to do, and have not shown it."""
        return self._errands.keys()

    def has_ordered(self, vehicle: int, mode: str) -> bool:
        """Return True if an order put a vehicle into a mode, or tells it what to do just now."""
        return vehicle in self._errands or _SET_ASIDE.get(self.suspensions.get(vehicle, "")) == mode

    def take(
        self,
        order: Order,
        targets: Container[Label],
        untaskable: Mapping[int, str],
        release: Callable[[int], None] = lambda _vehicle: None,
    ) -> list[Effect]:
        """Begin to carry out an order to vehicles.

        Parameters
        ----------
        order
            One of hold, resume, return, arm, disarm.
        targets
            Those that are there to be flown to.
        untaskable
            Vehicles that get no mission now, and why.
        release
            Called with each vehicle that is taken back, before anything is sent to it.
        """
        known = {health.system_id: health for health in self._fleet.health()}
        vehicles = order.vehicles if order.vehicles is not None else tuple(known)
        ongoing = OrderInProgress(order, set(vehicles))
        effects: list[Effect] = []
        begun: list[int] = []
        unchanged: dict[int, str] = {}
        for vehicle in vehicles:
            is_heard = vehicle in known and known[vehicle].liveness == "alive"
            if vehicle not in known:
                refusal = f"no vehicle of this mission; it has {', '.join(map(vehicle_name, known))}"
            elif known[vehicle].address is None:
                refusal = "never heard"
            elif unchanged_state := self._unchanged(order, vehicle, untaskable, is_heard=is_heard):
                unchanged[vehicle] = f"{unchanged_state}: nothing was changed"
                continue
            else:
                refusal = self._refusal(order, vehicle, begun, is_heard=is_heard)
            if refusal:
                effects.append(ongoing.answer(order.t_ns, "refused", refusal, vehicle))
            else:
                begun.append(vehicle)
        state: AnswerState = "done" if begun and order.vehicles is None else "refused"
        for vehicle, text in unchanged.items():
            effects.append(ongoing.answer(order.t_ns, state, text, vehicle))
        for vehicle in begun:
            if order.action == "resume":
                release(vehicle)
            effects += self._begin(ongoing, vehicle, known[vehicle].autopilot, targets)
        if not ongoing.waiting:
            return effects
        detail = named(ongoing.waiting)
        if order.action == "return":
            returning = {vehicle for vehicle, why in self.suspensions.items() if why == "return"}
            remark = self._returns.meeting(returning)
            detail += f"; {remark}" if remark else ""
            effects += [Notice(order.t_ns, "warning", remark)] if remark else []
        return [ongoing.answer(order.t_ns, "accepted", detail), *effects]

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

    def _unchanged(self, order: Order, vehicle: int, untaskable: Mapping[int, str], *, is_heard: bool) -> str:
        """Say how a vehicle already is what an order wants; empty when it is not, or that is not known."""
        state = self._fleet.state(vehicle)
        if vehicle in self._errands or state is None or not is_heard:
            return ""
        match order.action:
            case "resume" if state.mode == LOITER and self._tasking.has_failed(vehicle):
                return ""  # its next mission need not wait any more
            case "resume" if vehicle not in untaskable:
                return f"was not set aside, and is in {state.mode or 'a mode that it has not told'}"
            case "hold" | "return" if (self.suspensions.get(vehicle), state.mode) == (
                order.action,
                _SET_ASIDE[order.action],
            ):
                return _WORDS[order.action]
            case "arm" if state.armed:
                return "is armed"
            case "disarm" if not state.armed:
                return "is disarmed"
        return ""

    def _refusal(self, order: Order, vehicle: int, begun: Collection[int], *, is_heard: bool) -> str:
        state = self._fleet.state(vehicle)
        match order.action:
            case "resume":
                return self._stays(state) or self._blocked(order, vehicle, begun)
            case "arm" if not is_heard:
                return "is not heard: its mode is not known"
            case "arm":
                return self._takes_off(vehicle, state) or self._blocked(order, vehicle, begun)
            case "disarm":
                return self._airborne(vehicle, state)
        return ""

    def _stays(self, state: VehicleState | None) -> str:
        """Say why a vehicle is not taken out of the mode that it is in; empty when it can be."""
        if state is None:
            return ""
        if state.mode in PILOTED:
            return f"is in {state.mode}: whoever flies it has to give it back"
        height_m = self._tasking.height_m(state)
        low = height_m < min(MIN_RESUME_HEIGHT_M, 0.5 * self._tasking.altitude_rel_m)
        if state.mode == LOITER or _stands(state) or not low:
            return ""
        return (
            f"is in {state.mode}, {height_m:.0f} m above home: too low to turn back; let it land, or order "
            "it to resume when it is higher"
        )

    def _takes_off(self, vehicle: int, state: VehicleState | None) -> str:
        """Say why a vehicle would take off with a mission that nobody wants now; empty when it would not."""
        if state is None or not state.mode:
            return "has not told its mode and position yet"
        if state.mode not in SELF_LAUNCHING or (state.mode == AUTO and self.may_fly(vehicle)):
            return ""
        return (
            f"is in {state.mode}: armed, it would take off at once, and not with a mission that was read "
            "back from it and is wanted now; order it to hold first, then arm it"
        )

    def launching(self) -> Set[int]:
        """Return the vehicles on the ground whose orders make them take off."""
        errands = self._errands.items()
        return {v for v, (_, ongoing) in errands if self._launches(v, ongoing.order.action)}

    def _launches(self, vehicle: int, action: str) -> bool:
        """Return True if an order lets a vehicle on the ground take off at once."""
        state = self._fleet.state(vehicle)
        if state is None or not is_on_ground(state, self._fleet.home(vehicle)):
            return False
        if action == "resume":
            return state.armed and self._tasking.onboard(vehicle) is not None
        return action == "arm" and (state.mode in SELF_LAUNCHING or self._tasking.is_uploading(vehicle))

    def _blocked(self, order: Order, vehicle: int, begun: Collection[int]) -> str:
        """Say who is in the way of a take-off that an order lets begin; empty when nobody is."""
        if not self._launches(vehicle, order.action):
            return ""
        starting = self.launching() | {other for other in begun if self._launches(other, order.action)}
        reason = self._departures.in_the_way(vehicle, starting)
        return f"would take off at once, and {reason}, then order it again" if reason else ""

    def may_fly(self, vehicle: int) -> bool:
        """Whether a vehicle stores the mission that it is to fly now, by a read-back of this run."""
        route, flown = self._replanner.routes.get(vehicle), self._tasking.onboard(vehicle)
        is_stored = flown is not None and flown.route is route
        return is_stored and vehicle not in self.suspensions and vehicle not in self._tasking.stages

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
        self, ongoing: OrderInProgress, vehicle: int, autopilot: int, targets: Container[Label]
    ) -> list[Effect]:
        order = ongoing.order
        effects: list[Effect] = self._give_up(vehicle, order.t_ns, f"replaced by an order to {order.action}")
        if order.action in ("arm", "disarm"):
            arm = order.action == "arm"
            question = command_long(vehicle, _ARM_DISARM, 1.0 if arm else 0.0)
            return effects + self._send(ongoing, vehicle, question, lambda shown: shown.armed is arm)
        if order.action == "resume":
            mode = self._take_up(vehicle, targets)
        else:
            mode = _SET_ASIDE[order.action]
            effects += self._set_aside(vehicle, "hold" if order.action == "hold" else "return", order.t_ns)
        question = set_mode(vehicle, autopilot, mode)
        return effects + self._send(ongoing, vehicle, question, lambda shown: shown.mode == mode)

    def _set_aside(self, vehicle: int, why: Suspension, t_ns: int) -> list[Effect]:
        self.suspensions[vehicle] = why
        route = self._replanner.routes.get(vehicle)
        if route is not None and vehicle not in self._tasking.stages:
            self.suspended_routes[vehicle] = route
        self._replanner.drop(vehicle)
        return self._tasking.abandon(vehicle, f"given up for an order to {why}", t_ns)

    def _take_up(self, vehicle: int, targets: Container[Label]) -> str:
        """Let a vehicle be tasked again; returns the mode to fly in until then."""
        self.suspensions.pop(vehicle, None)
        self._tasking.release_override(vehicle)
        route = self.suspended_routes.pop(vehicle, None)
        if vehicle not in self._replanner.routes:
            taken = self._replanner.assigned.values()
            if route is None or route.target not in targets or route.target in taken:
                return LOITER
            places = {state.system_id: (state.east_m, state.north_m) for state in self._fleet.states()}
            if not self._replanner.is_separated(route, places):
                return LOITER  # the next plan has a layer for it
            self._replanner.routes[vehicle] = route
        if self.may_fly(vehicle):
            return AUTO
        if vehicle not in self._tasking.stages:
            self._replanner.drop_route(vehicle)  # the next plan has another
        return LOITER

    # ------------------------------------------------------------ errands

    def _send(
        self,
        ongoing: OrderInProgress,
        vehicle: int,
        question: Message,
        wanted: Callable[[HeartbeatState], bool],
    ) -> list[Effect]:
        errand = CommandSender(question, wanted, self._fleet.encoder(vehicle), ongoing.order.t_ns)
        self._errands[vehicle] = (errand, ongoing)
        return self._worked(vehicle, ongoing.order.t_ns)

    def _worked(self, vehicle: int, t_ns: int) -> list[Effect]:
        errand, ongoing = self._errands[vehicle]
        effects: list[Effect] = [*self._fleet.address_frames(vehicle, errand.poll(t_ns))]
        self._fleet.forward_next_heartbeat(vehicle)
        if errand.outcome is not None:
            del self._errands[vehicle]
            done, detail = errand.outcome
            if ongoing.order.action == "resume" and done:
                detail += "" if self.may_fly(vehicle) else f": {self._outlook(vehicle)}"
            elif ongoing.order.action == "resume" and vehicle not in self._tasking.stages:
                self._replanner.drop_route(vehicle)  # it does not fly its route: the next plan has another
                detail += "; it gets a new mission with the next plan"
            effects.append(ongoing.answer(t_ns, "done" if done else "failed", detail, vehicle))
        return effects

    def _give_up(self, vehicle: int, t_ns: int, why: str) -> list[Effect]:
        """End the errand under way, if there is one: the newest order counts."""
        if vehicle not in self._errands:
            return []
        _, ongoing = self._errands.pop(vehicle)
        return [ongoing.answer(t_ns, "failed", why, vehicle)]


def _stands(state: VehicleState) -> bool:
    """Return True if a vehicle reports that it stands on the ground, disarmed."""
    return not state.armed and state.ground_speed_m_s <= _STANDING_M_S
