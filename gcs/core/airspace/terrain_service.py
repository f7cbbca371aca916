"""Answers to autopilots that ask for terrain, from the elevation model of the mission."""

from __future__ import annotations

from collections.abc import Mapping

from pymavlink.dialects.v20.ardupilotmega import MAVLINK_MSG_ID_TERRAIN_REQUEST

from gcs.config import Config
from gcs.core.state import Agent
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.terrain_data import TerrainServer
from gcs.model import Effect, Notice, NoticeCode


class TerrainService:
    """Answers TERRAIN_REQUEST of our vehicles; without an elevation model nothing is sent."""

    def __init__(self, config: Config, fleet: Fleet, agents: Mapping[int, Agent]) -> None:
        elevation = config.elevation
        self._server = None if elevation is None else TerrainServer(elevation, config.local_frame)
        self._fleet = fleet
        self._agents = agents

    def receive(self, vehicle: int, message: Message) -> None:
        """Process a message of a vehicle."""
        if self._server is not None and message.get_msgId() == MAVLINK_MSG_ID_TERRAIN_REQUEST:
            self._server.receive(self._agents[vehicle].terrain, message)

    def poll(self, t_ns: int) -> list[Effect]:
        """Return the answers that are due."""
        effects: list[Effect] = []
        if self._server is None:
            return effects
        for vehicle, agent in self._agents.items():
            record = agent.terrain
            if not record.mask or agent.link.liveness != "alive" or agent.link.high_latency is not None:
                continue
            messages, unknown = self._server.poll(record, t_ns)
            encode = self._fleet.encoder(vehicle)
            effects += self._fleet.address_frames(vehicle, map(encode, messages))
            if unknown is not None:
                lat_deg, lon_deg = unknown
                place = {"lat_deg": lat_deg, "lon_deg": lon_deg}
                effects.append(Notice(t_ns, NoticeCode.TERRAIN_UNKNOWN, vehicle, place))
        return effects
