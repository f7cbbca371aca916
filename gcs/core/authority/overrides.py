"""Overrides: which vehicles a pilot, a failsafe or another station has put into another mode.

`gcs.mavlink.fleet.mode_authority` classifies the mode changes of one vehicle. MISSION_CURRENT explains some
of them afterwards: a PX4 in Hold rejects its mission, an ArduPlane in RTL has completed its mission.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.state import Agent
from gcs.core.tasking.onboard_missions import OnboardMissions
from gcs.mavlink.autopilots import AutopilotProfile
from gcs.mavlink.autopilots.modes import LOITER, RTL
from gcs.mavlink.fleet.mode_authority import ModeAuthority
from gcs.mavlink.frames.codec import Message
from gcs.model import Authority

_NO_ITEMS: Final = 0xFFFF
"""MISSION_CURRENT.total of a PX4 without a mission."""


class Overrides:
    """Overrides of all vehicles."""

    def __init__(self, onboard: OnboardMissions, agents: Mapping[int, Agent]) -> None:
        self._onboard = onboard
        self._agents = agents

    def of(self, vehicle: int) -> ModeAuthority:
        """Return the mode authority over one vehicle."""
        agent = self._agents[vehicle]
        return ModeAuthority(agent.authority.mode, agent.claims)

    def modes(self) -> dict[int, str]:
        """Return the overriding modes, by vehicle."""
        modes = {v: agent.claims.detail(Authority.OVERRIDDEN) for v, agent in self._agents.items()}
        return {vehicle: mode for vehicle, mode in modes.items() if mode}

    def observe_mode(self, vehicle: int, profile: AutopilotProfile, heartbeat: Message, t_ns: int) -> None:
        """Process the mode of a heartbeat."""
        at_end = self._onboard.is_at_end(vehicle, profile)
        self.of(vehicle).observe_heartbeat(heartbeat, profile, t_ns, at_end=at_end)

    def observe_rejection(
        self, vehicle: int, profile: AutopilotProfile, current: Message, t_ns: int, *, is_uploading: bool
    ) -> bool:
        """Process a MISSION_CURRENT; return True if a vehicle is in LOITER because it rejects its mission.

        Such a vehicle is ours again. An upload in progress handles this itself.
        """
        authority = self.of(vehicle)
        record = self._agents[vehicle].authority
        before = record.mission_state
        record.mission_state = current.mission_state
        is_rejected = (
            current.mission_state == dialect.MISSION_STATE_NO_MISSION
            and before == dialect.MISSION_STATE_ACTIVE  # not paused by an operator
            and 0 < current.total < _NO_ITEMS  # not cleared by an operator
            and profile.atomic
            and not is_uploading
            and authority.override == LOITER
        )
        if is_rejected:
            authority.note_rejection(t_ns)
        return is_rejected

    def observe_completion(
        self, vehicle: int, profile: AutopilotProfile, current: Message, t_ns: int, *, is_changing: bool
    ) -> None:
        """Process a MISSION_CURRENT: a vehicle in RTL because its mission is complete is ours.

        An ArduPlane that returns by command or failsafe has stopped its mission, not completed it
        (`GCS_MAVLINK::mission_state`, `ModeAuto::_exit`). Only its verified mission counts, or what an upload
        has left of it (`is_changing`).
        """
        onboard = self._agents[vehicle].tasking.onboard
        is_whole = onboard is not None and current.total == len(onboard.items) - profile.home_items
        if (
            profile.ends_in == RTL
            and current.mission_state == dialect.MISSION_STATE_COMPLETE
            and (is_whole or is_changing)
            and self.of(vehicle).awaits_completion(t_ns)
        ):
            self.of(vehicle).note_completion(t_ns)

    def recently_in_rtl(self, t_ns: int) -> set[int]:
        """Return the vehicles that went from AUTO to RTL a moment ago; the reason is not known yet."""
        return {vehicle for vehicle in self._agents if self.of(vehicle).awaits_completion(t_ns)}

    def note_mission_lost(self, vehicle: int, booted_t_ns: int, t_ns: int) -> None:
        """Note that a vehicle lost its mission at a boot: a LOITER that it started in is no override."""
        self.of(vehicle).note_mission_lost(booted_t_ns, t_ns)
