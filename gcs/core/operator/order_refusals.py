"""Refusals of orders to vehicles: what is not possible, not safe, or would change nothing.

No order leads a vehicle into another one (`gcs.core.separation.order_check`): an order to resume is refused
then. Orders to hold or return wait instead (`gcs.core.operator.waiting_orders`). A vehicle that returns or
lands is not turned back near the ground.

Arming is refused in a mode in which the vehicle would take off at once, except with a verified mission that
is to be flown now: PX4 and ArduPlane start the stored mission when they are armed in AUTO. It is also refused
while another vehicle blocks the take-off (`gcs.core.takeoff.sequence`). Disarming is refused unless the
vehicle reports that it is on the ground, and never forced.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Final

from gcs.core.operator.order_commands import MODES, ordered_modes
from gcs.core.replanning.stacked_missions import StackedMissions
from gcs.core.separation.order_check import OrderCheck
from gcs.core.separation.predicted_flights import PredictedFlights
from gcs.core.state import State
from gcs.core.takeoff.sequence import SELF_LAUNCHING, TakeoffSequence
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.autopilots.modes import AUTO, LOITER, PILOTED, RTL
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.on_ground import is_on_ground
from gcs.model import Authority, Order, VehicleState, vehicle_name

_MAX_GROUND_SPEED_M_S: Final = 2.0
_MAX_GROUND_HEIGHT_M: Final = 5.0
MIN_RESUME_HEIGHT_M: Final = 40.0
"""Minimum height above home at which a vehicle that returns or lands is turned back; landing approaches begin
at 30 m."""
_LEVEL_HEIGHT_M: Final = 20.0
"""The same for a PX4 in RTL that does not descend: its return may end in a low circle, at RTL_DESCEND_ALT."""
_LEVEL_M_S: Final = 0.5


def not_in_mission(known: Iterable[int]) -> str:
    """Return why an order to a vehicle that is not of the mission is refused."""
    return f"no vehicle of this mission; it has {', '.join(map(vehicle_name, known))}"


class OrderRefusals:
    """Gives the reasons for which orders to vehicles are not carried out."""

    def __init__(
        self,
        state: State,
        fleet: Fleet,
        tasking: UploadManager,
        takeoff_sequence: TakeoffSequence,
        order_check: OrderCheck,
        stacked_missions: StackedMissions,
    ) -> None:
        self._agents = state.agents
        self._fleet = fleet
        self._tasking = tasking
        self._takeoff_sequence = takeoff_sequence
        self._order_check = order_check
        self._stacked = stacked_missions

    def unchanged(self, order: Order, vehicle: int, *, is_heard: bool) -> str:
        """Return why an order would change nothing; empty if it would, or that is unknown."""
        state = self._fleet.state(vehicle)
        control = self._agents[vehicle].control
        if self._agents[vehicle].orders.command is not None or state is None or not is_heard:
            return ""
        match order.action:
            case "resume" if Authority.REJECTING in control.claims:
                return ""  # resume ends the pause after rejected missions
            case "resume" if state.mode == LOITER and self._agents[vehicle].tasking.retry.failures:
                return ""  # resume ends the pause after failed uploads
            case "resume" if control.is_ours:
                return f"is not suspended, and is in {state.mode or 'an unknown mode'}"
            case "hold" | "return" as action if control.suspension == action and (
                state.mode == MODES[action] or self._stacked.is_flown(vehicle)
            ):
                return control.reason
            case "arm" | "disarm" if self._agents[vehicle].link.high_latency is not None:
                return ""  # PX4 does not say there whether it is armed
            case "arm" if state.armed:
                return "is armed"
            case "disarm" if not state.armed:
                return "is disarmed"
        return ""

    def refusal(
        self,
        order: Order,
        vehicle: int,
        begun: Collection[int],
        flights: PredictedFlights,
        *,
        is_heard: bool,
    ) -> str:
        """Return why an order to a vehicle is refused, while those to others begin; empty if it is not."""
        state = self._fleet.state(vehicle)
        claims = self._agents[vehicle].control.claims
        match order.action:
            case "hold" | "return" | "resume" | "arm" if Authority.DOWN in claims:
                return Authority.DOWN.reason
            case "arm" if Authority.LANDED in claims:
                return Authority.LANDED.reason
            case "hold" | "return" | "resume" if self._fleet.profile(vehicle) is None:
                return Authority.UNSUPPORTED.reason  # its modes are not known
            case "resume":
                refusal = self._cannot_resume(state) or self._blocked(order, vehicle, begun)
                return refusal or self._leads_near(vehicle, begun, flights)
            case "arm" if not is_heard:
                return "is not heard: its mode is not known"
            case "arm":
                return self._cannot_arm(vehicle, state) or self._blocked(order, vehicle, begun)
            case "disarm":
                return self._cannot_disarm(vehicle, state)
        return ""

    def _cannot_resume(self, state: VehicleState | None) -> str:
        """Return why a vehicle must stay in its mode; empty if it need not."""
        if state is None:
            return ""
        if state.mode in PILOTED:
            return f"is in {state.mode}: its pilot has to give it back"
        height_m = self._fleet.height_m(state)
        profile = self._fleet.profile(state.system_id)
        circles = profile is not None and profile.return_circle_parameter and state.mode == RTL
        is_level = state.climb_m_s > -_LEVEL_M_S and not self._stacked.lands(state.system_id)
        least_m = _LEVEL_HEIGHT_M if circles and is_level else MIN_RESUME_HEIGHT_M
        low = height_m < min(least_m, 0.5 * self._tasking.altitude_rel_m)
        if state.mode == LOITER or _stands(state) or not low:
            return ""
        return (
            f"is in {state.mode}, {height_m:.0f} m above home: too low to turn back; let it land, or order "
            "it to resume when it is higher"
        )

    def _cannot_arm(self, vehicle: int, state: VehicleState | None) -> str:
        """Return why arming would start an unwanted mission; empty if it would not."""
        if state is None or not state.mode:
            return "has not reported its mode and position yet"
        tasking = self._agents[vehicle].tasking
        if tasking.rejections.count and tasking.onboard is None:
            cause = f"its navigator rejects it ({tasking.rejections.cause})"
            return f"has no mission: {cause}; correct its parameters first (`gcs preflight`)"
        if state.mode not in SELF_LAUNCHING or (state.mode == AUTO and self._tasking.may_take_off(vehicle)):
            return ""
        return (
            f"is in {state.mode}: armed, it would take off at once, and not with a mission that was read "
            "back from it and is wanted now; order it to hold first, then arm it"
        )

    def _cannot_disarm(self, vehicle: int, state: VehicleState | None) -> str:
        """Return why a vehicle may be in the air; empty if it reports that it is on the ground."""
        home = self._fleet.home(vehicle)
        if state is None or home is None:
            return "its position and home are not known: it may be in the air"
        height_m = state.alt_msl_m - home.alt_msl_m
        is_low = abs(height_m) <= _MAX_GROUND_HEIGHT_M or state.grounded is True
        if state.ground_speed_m_s > _MAX_GROUND_SPEED_M_S or not is_low:
            return f"is in the air: {height_m:.0f} m above home, {state.ground_speed_m_s:.0f} m/s"
        return ""

    def _blocked(self, order: Order, vehicle: int, begun: Collection[int]) -> str:
        """Return which vehicle blocks the take-off that an order starts; empty if none does."""
        if not self._takeoff_sequence.launches(vehicle, order.action):
            return ""
        starting = self._takeoff_sequence.launching() | {
            other for other in begun if self._takeoff_sequence.launches(other, order.action)
        }
        reason = self._takeoff_sequence.blocked_by(vehicle, starting, order.t_ns)
        return f"would take off at once, and {reason}, then order it again" if reason else ""

    def _leads_near(self, vehicle: int, resumed: Collection[int], flights: PredictedFlights) -> str:
        """Return which vehicle, ground, zone or obstacle a resumed one would come near to; empty if none."""
        state = self._fleet.state(vehicle)
        t_ns = flights.t_ns
        mode = self._resumed_mode(vehicle, t_ns)
        is_in_air = state is not None and not is_on_ground(state, self._fleet.home(vehicle))
        if state is None or not is_in_air or state.mode == mode:
            return ""
        modes = {other: self._resumed_mode(other, t_ns) for other in (*resumed, vehicle)}
        problem = self._order_check.problem(vehicle, ordered_modes(self._agents) | modes, flights)
        return f"{problem}: resume it when it is clear" if problem else ""

    def _resumed_mode(self, vehicle: int, t_ns: int) -> str:
        """Return AUTO for a vehicle that can fly on with its mission, else LOITER, where it waits for one.

        A mission over terrain keeps above the ground along its route, which the vehicle may have left.
        """
        agent = self._agents[vehicle]
        onboard = agent.tasking.onboard
        suspended = agent.routes.suspended
        if suspended is not None and suspended.heights_msl_m is not None:
            return LOITER
        is_stored = onboard is not None and onboard.route.is_same(suspended or agent.routes.flown)
        return AUTO if is_stored and self._order_check.mission_is_clear(vehicle, t_ns) else LOITER


def _stands(state: VehicleState) -> bool:
    """Return True if a vehicle is disarmed and reports no ground speed."""
    return not state.armed and state.ground_speed_m_s <= _MAX_GROUND_SPEED_M_S
