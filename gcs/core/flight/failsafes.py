"""Failsafes: modes that an autopilot chose by itself, told with the cause that it gives.

Two things show that a failsafe chose a mode. Both depend on the firmware (`gcs.mavlink.autopilots`).

* HEARTBEAT shows MAV_STATE_CRITICAL or worse, in a mode that failsafes choose. A PX4 shows it as long as the
  failsafe's mode lasts; an ArduPlane as long as the cause lasts, so that only the change of both at one time
  counts.
* A STATUSTEXT names the failsafe at the time of the change, and the failsafe chooses this mode. ArduPlane
  only: each failsafe of PX4 shows in its heartbeat. The text that the loss of the link has ended counts when
  the link has just returned: its heartbeat may not show the failsafe any more.

Every other change is a person's or another station's, whatever the vehicle says meanwhile.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from gcs.core.state import Agent
from gcs.mavlink.autopilots import AutopilotProfile, FailsafeText
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.retry import ns
from gcs.model import Authority

_MAX_TEXTS: Final = 4
_MAX_LENGTH: Final = 80
_RECENT_NS: Final = ns(10.0)
"""Age of the texts that are named as causes. PX4 holds 5 s before it acts."""
_TOGETHER_NS: Final = ns(1.5)
"""Time between a failsafe's text and the heartbeat with its mode: a heartbeat may be lost."""


class Failsafes:
    """Causes of failsafes, from texts and heartbeats of vehicles."""

    def __init__(self, agents: Mapping[int, Agent]) -> None:
        self._agents = agents

    def receive(self, vehicle: int, message: Message, t_ns: int) -> None:
        """Keep a STATUSTEXT that names a failsafe or its cause."""
        profile = self._agents[vehicle].link.profile
        if message.get_type() != "STATUSTEXT" or profile is None:
            return
        text = str(message.text)[:_MAX_LENGTH].rstrip()
        failsafe = _failsafe_of(text, profile)
        if failsafe is None or message.severity > failsafe.max_severity:
            return
        texts = [one for one in self._agents[vehicle].flight.texts if one[1] != text]
        self._agents[vehicle].flight.texts = [*texts, (t_ns, text)][-_MAX_TEXTS:]

    def cause(self, vehicle: int, t_ns: int) -> str:
        """Return the cause of the failsafe that chose a vehicle's mode; empty if none did."""
        agent = self._agents[vehicle]
        profile = agent.link.profile
        if profile is None or not (_is_shown(agent, profile) or _is_said(agent, profile)):
            return ""
        recent = [text for said_t_ns, text in agent.flight.texts if t_ns - said_t_ns <= _RECENT_NS]
        said = [text for text in recent if not _ends(text, profile)]
        if any(_names_cause(text, profile) for text in said):
            return "; ".join(said)
        problems = [problem.cause for problem in agent.flight.problems.values() if problem.is_told]
        if _has_returned(agent, t_ns):
            problems.append("its link was down")  # and its texts were not heard
        return "; ".join([*problems, *said]) or "its autopilot names no cause"


def _failsafe_of(text: str, profile: AutopilotProfile) -> FailsafeText | None:
    return next((one for one in profile.failsafe_texts if one.pattern.match(text)), None)


def _names_cause(text: str, profile: AutopilotProfile) -> bool:
    failsafe = _failsafe_of(text, profile)
    return failsafe is not None and failsafe.names_cause


def _ends(text: str, profile: AutopilotProfile) -> bool:
    """Return True if a text says that a failsafe has ended."""
    failsafe = _failsafe_of(text, profile)
    return failsafe is not None and failsafe.ends


def _has_returned(agent: Agent, t_ns: int) -> bool:
    """Return True if the link was down until a short time ago."""
    return agent.link.returns > 0 and t_ns - agent.link.returned_t_ns <= _RECENT_NS


def _is_shown(agent: Agent, profile: AutopilotProfile) -> bool:
    """Return True if the heartbeat shows that a failsafe chose the mode."""
    record = agent.authority.mode
    if not record.in_failsafe or record.mode not in profile.failsafe_modes:
        return False
    return profile.critical_ends or abs(record.failsafe_t_ns - _chosen_t_ns(agent)) <= _TOGETHER_NS


def _is_said(agent: Agent, profile: AutopilotProfile) -> bool:
    """Return True if a text shows that a failsafe chose the mode."""
    mode = agent.authority.mode.mode
    chosen_t_ns = _chosen_t_ns(agent)
    has_returned = _has_returned(agent, chosen_t_ns)
    said = [text for t_ns, text in agent.flight.texts if abs(t_ns - chosen_t_ns) <= _TOGETHER_NS]
    failsafes = [one for text in said if (one := _failsafe_of(text, profile)) is not None]
    return any(mode in one.modes and (has_returned or not one.ends) for one in failsafes)


def _chosen_t_ns(agent: Agent) -> int:
    """Return when the mode was first seen; 0 if nobody but this service chose it."""
    return agent.claims.since_t_ns(Authority.OVERRIDDEN) or 0
