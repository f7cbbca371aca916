"""Start of what goes on after an outage of the service: audits, and uploads by their own rules."""

from __future__ import annotations

from gcs.core.stages import Stages
from gcs.core.state import with_status
from gcs.model import Effect, Resumed


def audit_missions(stages: Stages, event: Resumed) -> list[Effect]:
    """Read the onboard missions of active agents back."""
    stages.second_commander.begin_again()
    for vehicle in with_status(stages.state.agents, "active"):
        agent = stages.state.agents[vehicle]
        audit = agent.authority.audit
        mission = agent.tasking.onboard if audit is None else audit.mission
        known_t_ns = event.saved_t_ns if audit is None else audit.known_t_ns
        is_uploading = vehicle in stages.state.tasking.uploads  # its read-back decides
        if mission is not None and not (is_uploading or stages.tasking.may_be_inconsistent(vehicle)):
            stages.onboard_audit.begin(mission, event.t_ns, known_t_ns=known_t_ns)
    return []


def resume_uploads(stages: Stages, event: Resumed) -> list[Effect]:
    """Go on with uploads that were in progress: read back first."""
    return stages.tasking.resume(event.t_ns)
