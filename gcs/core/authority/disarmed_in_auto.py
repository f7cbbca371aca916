"""Disarmed vehicles in AUTO without a mission to fly: each is set to LOITER.

After a landing PX4 and ArduPlane stay in AUTO. Armed by a switch or from any ground station, they start the
stored mission again. LOITER (PX4: Hold) prevents that. A vehicle stays in AUTO if this run of the service has
read back its onboard mission, and that is the one to fly now. An overridden vehicle is left alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from gcs.core.operator.vehicle_orders import Orders
from gcs.core.state import Agent
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.command_sender import CommandSender, set_mode
from gcs.mavlink.services.retry import ns
from gcs.model import Effect, Notice, VehicleState

_PERIOD_NS: Final = ns(1.0)
_MAX_SPEED_M_S: Final = 2.0


class DisarmedInAuto:
    """Sets disarmed vehicles in AUTO to LOITER."""

    def __init__(
        self, agents: Mapping[int, Agent], fleet: Fleet, tasking: UploadManager, orders: Orders
    ) -> None:
        self._agents = agents
        self._fleet, self._tasking, self._orders = fleet, tasking, orders
        self._senders: dict[int, CommandSender] = {}
        self._failed: set[int] = set()
        """Vehicles that stayed in AUTO."""
        self._next_check_t_ns = 0

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Process a message of a vehicle."""
        if vehicle not in self._senders:
            return []
        self._senders[vehicle].receive(message)
        return self._progress(vehicle, t_ns)

    def poll(self, t_ns: int, is_ours: Callable[[int], bool]) -> list[Effect]:
        """Check the vehicles that are ours once a second."""
        effects = [effect for vehicle in list(self._senders) for effect in self._progress(vehicle, t_ns)]
        if t_ns < self._next_check_t_ns:
            return effects
        self._next_check_t_ns = t_ns + _PERIOD_NS
        for state in self._fleet.states():
            vehicle = state.system_id
            if not self._would_take_off(state) or not is_ours(vehicle):
                self._failed.discard(vehicle)
            elif vehicle not in self._senders and vehicle not in self._failed:
                effects += self._begin(vehicle, t_ns)
        return effects

    def _would_take_off(self, state: VehicleState) -> bool:
        """Return True if arming would start a mission that the vehicle is not to fly."""
        vehicle = state.system_id
        stands = not state.armed and state.mode == AUTO and state.ground_speed_m_s <= _MAX_SPEED_M_S
        is_busy = vehicle in self._tasking.stages or self._agents[vehicle].orders.command is not None
        return stands and not is_busy and not self._orders.may_fly(vehicle)

    def _begin(self, vehicle: int, t_ns: int) -> list[Effect]:
        profile = self._fleet.profile(vehicle)
        if profile is None:
            return []
        command = set_mode(vehicle, profile.autopilot, LOITER)
        self._tasking.overrides.note_command(vehicle, LOITER)
        self._senders[vehicle] = CommandSender.begin(command, t_ns, mode=LOITER)
        text = "stands on the ground in AUTO with no mission to fly: armed, it would take off; set to LOITER"
        return [Notice(t_ns, "info", text, vehicle), *self._progress(vehicle, t_ns)]

    def _progress(self, vehicle: int, t_ns: int) -> list[Effect]:
        sender, state = self._senders[vehicle], self._fleet.state(vehicle)
        if state is not None and state.armed:  # it flies, or will soon: it must not be stopped now
            del self._senders[vehicle]
            return []
        effects: list[Effect] = [
            *self._fleet.address_frames(vehicle, sender.poll(t_ns, self._fleet.encoder(vehicle)))
        ]
        self._fleet.forward_next_heartbeat(vehicle)
        if sender.outcome is None:
            return effects
        del self._senders[vehicle]
        is_done, detail = sender.outcome
        if not is_done:
            self._failed.add(vehicle)
            text = f"stays in AUTO on the ground ({detail}): armed, it would take off with an old mission; "
            effects.append(Notice(t_ns, "alarm", text + "set LOITER or Hold by hand before arming", vehicle))
        return effects
