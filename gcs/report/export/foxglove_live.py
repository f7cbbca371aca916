"""Messages for Foxglove of a running service, from what it shows now.

Displays may subscribe at any time. So what changes seldom (areas, routes) is complete in each message, and
can be sent again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from gcs.model import AgentRecord, NoFlyZone, Route, SwarmStatus, limits_text
from gcs.report.export.foxglove import FoxgloveMessages, Message, Outline

_CIRCLE_VERTICES = 48


class LiveMessages:
    """Turns the state of a service into messages: positions, routes and areas that have changed.

    Parameters
    ----------
    fence : sequence of Outline
        The fence of the mission.
    """

    def __init__(self, messages: FoxgloveMessages, fence: Sequence[Outline]) -> None:
        self._messages = messages
        self._fence = fence
        self._agents: dict[int, AgentRecord] = {}
        self._routes: tuple[Route, ...] | None = None
        self._zones: tuple[NoFlyZone, ...] | None = None

    def state(
        self, t_ns: int, status: SwarmStatus, routes: tuple[Route, ...], zones: tuple[NoFlyZone, ...]
    ) -> Iterator[Message]:
        """Yield the messages of the state at a time."""
        for agent in status.agents:
            last = self._agents.get(agent.vehicle)
            if last is None or (agent.position_m, agent.alt_msl_m) != (last.position_m, last.alt_msl_m):
                yield from self._messages.agent(t_ns, agent)
            self._agents[agent.vehicle] = agent
        if routes is not self._routes:
            self._routes = routes
            yield from self._messages.routes(t_ns, routes, [route.vehicle for route in routes])
        if zones != self._zones:
            self._zones = zones
            yield from self._messages.areas(t_ns, [*self._fence, *map(_outline, zones)])


def _outline(zone: NoFlyZone) -> Outline:
    heights = limits_text(zone.limits)
    if zone.disc_m is None:
        return Outline(False, zone.polygon_m, heights)
    east_m, north_m, radius_m = zone.disc_m
    turns = (math.tau * number / _CIRCLE_VERTICES for number in range(_CIRCLE_VERTICES))
    corners_m = [(east_m + radius_m * math.sin(turn), north_m + radius_m * math.cos(turn)) for turn in turns]
    return Outline(False, corners_m, heights)
