"""Dispatch: planned routes become missions to upload; what follows when an upload has ended."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass

from gcs.core.authority.external_uploads import ExternalUploads
from gcs.core.operator.plan_approval import PlanApproval
from gcs.core.replanning.return_routes import ReturnRoutes
from gcs.core.state import Agent, wanted_routes
from gcs.core.tasking.mission_builder import is_hold
from gcs.core.tasking.upload_latency import note_failure, note_success
from gcs.core.tasking.upload_manager import UploadManager
from gcs.model import ControlEvent, Effect, Route, UploadReport


@dataclass(frozen=True, slots=True)
class Dispatch:
    """Connects planned routes, their approval, and uploads."""

    return_routes: ReturnRoutes
    approval: PlanApproval
    tasking: UploadManager
    agents: Mapping[int, Agent]
    external_uploads: ExternalUploads

    def send(self, routes: Sequence[Route], t_ns: int, urgent: Container[int] = ()) -> list[Effect]:
        """Upload routes as missions, with return routes; `urgent` vehicles do not wait for anything."""
        effects: list[Effect] = self.withdraw(t_ns)
        for route in routes:
            at_once = route.vehicle in urgent
            elapsed_s = self.tasking.state.elapsed_s(route.vehicle, t_ns)
            if elapsed_s is not None:
                note_failure(self.agents[route.vehicle].tasking, elapsed_s)
            return_route, warnings = self.return_routes.plan(route, t_ns)
            effects += warnings
            effects += self.settle(self.tasking.enqueue_upload(route, t_ns, return_route, at_once=at_once))
        return effects

    def withdraw(self, t_ns: int) -> list[Effect]:
        """Remove queued routes that their vehicles should not fly any more."""
        unwanted = self.tasking.withdraw_except(wanted_routes(self.agents))
        return [answer for v in unwanted for answer in self.approval.end(v, t_ns, "not wanted any more")]

    def settle(self, effects: Sequence[Effect]) -> list[Effect]:
        """Process upload reports; a vehicle without its mission is planned for again."""
        settled: list[Effect] = []
        for effect in effects:
            settled.append(effect)
            if not isinstance(effect, UploadReport):
                continue
            if effect.ok:
                self.external_uploads.release(effect.vehicle, ControlEvent.UPLOAD_VERIFIED, effect.t_ns)
                note_success(self.agents[effect.vehicle].tasking, effect.duration_s)
            else:
                note_failure(self.agents[effect.vehicle].tasking, effect.duration_s)
            if self.tasking.state.has_pending(effect.vehicle):
                continue  # the result of the newer upload counts
            settled += self.approval.uploaded(effect)
            if not effect.ok:
                routes = self.agents[effect.vehicle].routes
                routes.drop_flown()
                if routes.stacked is not None and is_hold(routes.stacked):
                    routes.unstack()  # it stays in LOITER
        return settled
