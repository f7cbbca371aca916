"""Missions that a vehicle's navigator rejects: the cause in its own texts, and the next attempt.

A PX4 stores a mission, acknowledges it, and may reject it all the same (MISSION_CURRENT.mission_state
NO_MISSION). A STATUSTEXT names the cause, mostly before that state is seen. While a mission stands rejected
(`Authority.REJECTING`) its vehicle gets no other, and its target goes to another vehicle. The next attempt
follows

* at once after a parameter of the vehicle has changed, or after a reboot: `RejectionRetry.note_change`;
* after growing pauses, a few times only: another route may be accepted;
* when an operator orders the vehicle to resume.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from gcs.core.state import Agent
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, Authority, ControlEvent, Effect, Notice, NoticeCode, Parameter, vehicle_name

_CAUSE: Final = re.compile(r"\b(mission|waypoints?|take-?off|landing|geofence)\b", re.IGNORECASE)
_CONSEQUENCE: Final = re.compile(r"no valid mission|arming denied|executing|finished|detected", re.IGNORECASE)
_PREFLIGHT: Final = re.compile(r"preflight", re.IGNORECASE)
_MAX_SEVERITY: Final = 4
"""MAV_SEVERITY_WARNING."""
_MAX_TEXTS: Final = 4
_MAX_LENGTH: Final = 120
_NO_CAUSE: Final = "it names no cause"
_BEFORE_NS: Final = ns(10.0)
"""Age of the texts that explain a rejection outside an upload, and delay of one that comes late."""


@dataclass(frozen=True, slots=True)
class Rejections:
    """Rejected missions of all vehicles."""

    agents: Mapping[int, Agent]

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Keep a STATUSTEXT that may name the cause of a rejection, or add it to one without a cause."""
        if message.get_type() != "STATUSTEXT" or message.severity > _MAX_SEVERITY:
            return []
        text = str(message.text)[:_MAX_LENGTH].strip().rstrip(".")
        is_cause = _CAUSE.search(text) or _PREFLIGHT.match(text)
        if not is_cause or _CONSEQUENCE.search(text):
            return []
        agent = self.agents[vehicle]
        retry = agent.tasking.rejections
        retry.texts = [*(one for one in retry.texts if one[1] != text), (t_ns, text)][-_MAX_TEXTS:]
        is_missing = Authority.REJECTING in agent.claims and retry.cause == _NO_CAUSE
        if not is_missing or t_ns - retry.rejected_t_ns > _BEFORE_NS:
            return []
        return self._tell(vehicle, text, t_ns)

    def cause(self, vehicle: int, since_t_ns: int) -> str:
        """Return the vehicle's own words for a rejection, from its texts since then."""
        texts = self.agents[vehicle].tasking.rejections.texts
        said = [text for said_t_ns, text in texts if said_t_ns >= since_t_ns]
        return "; ".join([one for one in said if _CAUSE.search(one)] or said) or _NO_CAUSE

    def begin(self, vehicle: int, t_ns: int, began_t_ns: int | None = None) -> list[Effect]:
        """Note that a vehicle rejects its mission, whose upload began at `began_t_ns`, if there was one."""
        since_t_ns = t_ns - _BEFORE_NS if began_t_ns is None else began_t_ns
        retry = self.agents[vehicle].tasking.rejections
        retry.note_rejection(t_ns, t_ns if began_t_ns is None else began_t_ns)
        return self._tell(vehicle, self.cause(vehicle, since_t_ns), t_ns)

    def poll(self, t_ns: int) -> None:
        """End the rejections whose next attempt is due."""
        for agent in self.agents.values():
            retry = agent.tasking.rejections
            if Authority.REJECTING in agent.claims and retry.is_due(t_ns):
                retry.note_attempt()
                agent.claims.apply(ControlEvent.NEXT_ATTEMPT, t_ns)

    def _tell(self, vehicle: int, cause: str, t_ns: int) -> list[Effect]:
        """Begin the claim; notify of a new cause, and of the last attempt."""
        agent = self.agents[vehicle]
        retry = agent.tasking.rejections
        is_new = cause != retry.cause
        retry.cause = cause
        agent.claims.apply(ControlEvent.MISSION_REJECTED, t_ns, cause)
        if not is_new and retry.next_t_ns is not None:
            return []
        if retry.next_t_ns is None:
            outlook = f"as `gcs order resume --vehicle {vehicle_name(vehicle)}` does"
        else:
            outlook = f"else it follows in {retry.pause_ns / NS_PER_S:.0f} s"
        parameters: dict[str, Parameter] = {"cause": cause, "outlook": outlook}
        return [Notice(t_ns, NoticeCode.MISSION_REJECTED, vehicle, parameters)]
