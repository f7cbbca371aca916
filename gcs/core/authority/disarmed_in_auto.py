"""Disarmed vehicles in AUTO without a mission to fly: each is set to LOITER.

After a landing PX4 and ArduPlane stay in AUTO. Armed by a switch or from any ground station, they start the
stored mission again. LOITER (PX4: Hold) prevents that. A vehicle stays in AUTO if this run of the service has
read back its onboard mission, and that is the one to fly now. An overridden vehicle is left alone; so is one
that is heard by HIGH_LATENCY2 alone: PX4 does not say there whether it is armed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from gcs.core.authority.authority_state import AuthorityState
from gcs.core.state import Agent
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.on_ground import is_on_ground
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.command_sender import CommandSender, set_mode
from gcs.mavlink.services.retry import ns
from gcs.model import Effect, Notice, NoticeCode, VehicleState

_PERIOD_NS: Final = ns(1.0)


class DisarmedInAuto:
    """Sets disarmed vehicles in AUTO to LOITER."""

    def __init__(
        self,
        agents: Mapping[int, Agent],
        state: AuthorityState,
        fleet: Fleet,
        tasking: UploadManager,
    ) -> None:
        self._agents = agents
        self._state = state
        self._fleet = fleet
        self._tasking = tasking

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Process a message of a vehicle."""
        sender = self._agents[vehicle].authority.loiter
        if sender is None:
            return []
        sender.receive(message)
        return self._progress(vehicle, sender, t_ns)

    def poll(self, t_ns: int, is_free: Callable[[int], bool]) -> list[Effect]:
        """Check the vehicles that nobody else controls once a second."""
        effects: list[Effect] = []
        for vehicle, agent in self._agents.items():
            if agent.authority.loiter is not None:
                effects += self._progress(vehicle, agent.authority.loiter, t_ns)
        if t_ns < self._state.disarmed_check_t_ns:
            return effects
        self._state.disarmed_check_t_ns = t_ns + _PERIOD_NS
        for state in self._fleet.states():
            vehicle = state.system_id
            authority = self._agents[vehicle].authority
            if not self._would_take_off(state) or not is_free(vehicle):
                authority.stays_in_auto = False
            elif authority.loiter is None and not authority.stays_in_auto:
                effects += self._begin(vehicle, t_ns)
        return effects

    def _would_take_off(self, state: VehicleState) -> bool:
        """Return True if arming would start a mission that the vehicle is not to fly."""
        vehicle = state.system_id
        if not self._agents[vehicle].link.has_telemetry:
            return False  # it may have taken off since
        on_ground = is_on_ground(state, self._fleet.home(vehicle))
        stands = not state.armed and state.mode == AUTO and on_ground
        is_busy = bool(self._tasking.state.stage(vehicle)) or self._agents[vehicle].orders.command is not None
        return stands and not is_busy and not self._tasking.may_take_off(vehicle)

    def _begin(self, vehicle: int, t_ns: int) -> list[Effect]:
        profile = self._fleet.profile(vehicle)
        if profile is None:
            return []
        command = set_mode(vehicle, profile.autopilot, LOITER)
        self._tasking.overrides.of(vehicle).note_command(LOITER)
        sender = self._agents[vehicle].authority.loiter = CommandSender.begin(command, t_ns, mode=LOITER)
        notice = Notice(t_ns, NoticeCode.LOITER_ON_GROUND, vehicle)
        return [notice, *self._progress(vehicle, sender, t_ns)]

    def _progress(self, vehicle: int, sender: CommandSender, t_ns: int) -> list[Effect]:
        authority = self._agents[vehicle].authority
        state = self._fleet.state(vehicle)
        is_heard = self._agents[vehicle].link.has_telemetry
        if not is_heard or (state is not None and state.armed):  # it may fly: it must not be stopped now
            authority.loiter = None
            return []
        frames = sender.poll(t_ns, self._fleet.encoder(vehicle))
        effects: list[Effect] = [*self._fleet.address_frames(vehicle, frames)]
        self._fleet.forward_next_heartbeat(vehicle)
        if sender.outcome is None:
            return effects
        authority.loiter = None
        is_done, detail = sender.outcome
        if not is_done:
            authority.stays_in_auto = True
            effects.append(Notice(t_ns, NoticeCode.AUTO_ON_GROUND, vehicle, {"detail": detail}))
        return effects
