"""Failsafes: modes that an autopilot chose by itself, told with the cause that it gives.

A vehicle that changes its mode in a failsafe says so: its heartbeat is CRITICAL or EMERGENCY, or a STATUSTEXT
names the failsafe or its cause (ArduPlane `events.cpp`, PX4 `commander/failsafe`). A person's choice shows
neither.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.state import Agent
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.retry import ns

_WORDS: Final = re.compile(
    r"failsafe|battery|fence|gps|ekf|manual control lost|connection (to ground station )?lost|link loss|"
    r"no (rc|manual)|engine|crash|termination",
    re.IGNORECASE,
)
_QUIET: Final = re.compile(r"\b(off|cleared|regained|restored|active|preflight)\b", re.IGNORECASE)
_MAX_SEVERITY: Final = 5
"""MAV_SEVERITY_NOTICE, as of ArduPlane's fence breach; less severe texts report the ordinary course."""
_MAX_TEXTS: Final = 4
_MAX_LENGTH: Final = 80
_RECENT_NS: Final = ns(10.0)
_CRITICAL: Final = (dialect.MAV_STATE_CRITICAL, dialect.MAV_STATE_EMERGENCY)


class Failsafes:
    """Causes of failsafes, from texts and heartbeats of vehicles."""

    def __init__(self, agents: Mapping[int, Agent]) -> None:
        self._agents = agents

    def receive(self, vehicle: int, message: Message, t_ns: int) -> None:
        """Keep a STATUSTEXT that names a failsafe or its cause."""
        if message.get_type() != "STATUSTEXT" or message.severity > _MAX_SEVERITY:
            return
        text = str(message.text)[:_MAX_LENGTH].rstrip()
        if not _WORDS.search(text) or _QUIET.search(text):
            return
        texts = [one for one in self._agents[vehicle].flight.texts if one[1] != text]
        self._agents[vehicle].flight.texts = [*texts, (t_ns, text)][-_MAX_TEXTS:]

    def cause(self, vehicle: int, t_ns: int) -> str:
        """Return the cause of a failsafe at this time in the autopilot's words; empty if there is none."""
        agent = self._agents[vehicle]
        told = [text for said_t_ns, text in agent.flight.texts if t_ns - said_t_ns <= _RECENT_NS]
        problems = [problem.cause for problem in agent.flight.problems.values() if problem.is_told]
        if told:
            return "; ".join(told)
        if agent.link.system_status in _CRITICAL:
            return "; ".join(problems) or "its autopilot names no cause"
        return ""
