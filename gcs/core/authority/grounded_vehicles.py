"""Vehicles that stand on the ground in AUTO with no mission to fly: each is put into LOITER.

After a landing both PX4 and ArduPlane stay in AUTO, and begin the stored mission anew when somebody arms
them, by a switch or from any ground station. So a vehicle that is disarmed in AUTO is told to LOITER (PX4's
Hold), in which arming starts nothing, unless the mission that it stores was read back from it by this run of
the service and is to be flown now. One that somebody else has taken is left alone.
"""

from __future__ import annotations

from collections.abc import Callable, Container
from typing import Final

from gcs.core.operator.vehicle_orders import Orders
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.command_sender import CommandSender, HeartbeatState, set_mode
from gcs.mavlink.services.retry import ns
from gcs.model import Effect, Notice, VehicleState

_PERIOD_NS: Final = ns(1.0)
_STANDING_M_S: Final = 2.0


class GroundedVehicles:
    """Vehicles on the ground, and the commands under way to them.

    Parameters
    ----------
    fleet : Fleet
        What vehicles say of themselves.
    tasking : Tasking
        What they store, and which missions are on their way.
    orders : Orders
        Which vehicles may fly what they store.
    """

    def __init__(self, fleet: Fleet, tasking: UploadManager, orders: Orders) -> None:
        self._fleet, self._tasking, self._orders = fleet, tasking, orders
        self._errands: dict[int, CommandSender] = {}
        self._failed: set[int] = set()
        """Vehicles that stayed in AUTO, of which the operator was told."""
        self._next_look_t_ns = 0

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Take a vehicle's message."""
        if vehicle not in self._errands:
            return []
        self._errands[vehicle].receive(message)
        return self._worked(vehicle, t_ns)

    def poll(self, t_ns: int, untaskable: Callable[[], Container[int]]) -> list[Effect]:
        """Look at all vehicles once a second; those that are `away` are not ours to command."""
        effects = [effect for vehicle in list(self._errands) for effect in self._worked(vehicle, t_ns)]
        if t_ns < self._next_look_t_ns:
            return effects
        self._next_look_t_ns = t_ns + _PERIOD_NS
        skipped = untaskable()
        for state in self._fleet.states():
            vehicle = state.system_id
            if not self._is_loaded(state) or vehicle in skipped:
                self._failed.discard(vehicle)
            elif vehicle not in self._errands and vehicle not in self._failed:
                effects += self._begin(vehicle, t_ns)
        return effects

    def _is_loaded(self, state: VehicleState) -> bool:
        """Whether a vehicle would take off with a mission that it is not to fly if somebody armed it."""
        vehicle = state.system_id
        stands = not state.armed and state.mode == AUTO and state.ground_speed_m_s <= _STANDING_M_S
        is_busy = vehicle in self._tasking.stages or vehicle in self._orders.commanded
        return stands and not is_busy and not self._orders.may_fly(vehicle)

    def _begin(self, vehicle: int, t_ns: int) -> list[Effect]:
        profile = self._fleet.profile(vehicle)
        if profile is None:
            return []
        question = set_mode(vehicle, profile.autopilot, LOITER)
        self._tasking.note_parked(vehicle)
        self._errands[vehicle] = CommandSender(question, _is_parked, self._fleet.encoder(vehicle), t_ns)
        text = "stands on the ground in AUTO with no mission to fly: armed, it would take off; told to LOITER"
        return [Notice(t_ns, "info", text, vehicle), *self._worked(vehicle, t_ns)]

    def _worked(self, vehicle: int, t_ns: int) -> list[Effect]:
        errand, state = self._errands[vehicle], self._fleet.state(vehicle)
        if state is not None and state.armed:  # it flies, or is about to: not ours to stop from here
            del self._errands[vehicle]
            return []
        effects: list[Effect] = [*self._fleet.address_frames(vehicle, errand.poll(t_ns))]
        self._fleet.forward_next_heartbeat(vehicle)
        if errand.outcome is None:
            return effects
        del self._errands[vehicle]
        is_done, detail = errand.outcome
        if not is_done:
            self._failed.add(vehicle)
            text = f"stays in AUTO on the ground ({detail}): armed, it would take off with an old mission; "
            effects.append(Notice(t_ns, "alarm", text + "set LOITER or Hold by hand before arming", vehicle))
        return effects


def _is_parked(shown: HeartbeatState) -> bool:
    return shown.mode == LOITER
