"""Dispatch of planned routes as missions, and handling of upload results."""

from __future__ import annotations

from collections.abc import Container, Sequence

from gcs.core.authority.external_uploads import ExternalUploads
from gcs.core.operator.plan_approval import PlanApproval
from gcs.core.replanning.replanner import Replanner
from gcs.core.tasking.upload_latency import UploadLatency
from gcs.core.tasking.upload_manager import UploadManager
from gcs.model import Effect, Route, UploadReport


class Dispatch:
    """Connects planned routes, their approval, and uploads.

    Parameters
    ----------
    replanner : Replanner
        Loses the route of a vehicle whose upload fails.
    approval : PlanApproval
        Answers confirmations with upload results.
    tasking : UploadManager
        Uploads missions.
    latency : UploadLatency
        Estimates upload times from results.
    external_uploads : ExternalUploads
        Releases a vehicle that has a verified mission of ours.
    """

    def __init__(
        self,
        replanner: Replanner,
        approval: PlanApproval,
        tasking: UploadManager,
        latency: UploadLatency,
        external_uploads: ExternalUploads,
    ) -> None:
        self._replanner, self._approval = replanner, approval
        self._tasking, self._latency, self._external_uploads = tasking, latency, external_uploads

    def send(self, routes: Sequence[Route], t_ns: int, urgent: Container[int] = ()) -> list[Effect]:
        """Upload routes as missions; `urgent` vehicles do not wait for anything."""
        effects: list[Effect] = self.withdraw(t_ns)
        for route in routes:
            at_once = route.vehicle in urgent
            elapsed_s = self._tasking.elapsed_s(route.vehicle, t_ns)
            if elapsed_s is not None:
                self._latency.note_failure(route.vehicle, elapsed_s)
            effects += self.settle(self._tasking.enqueue_upload(route, t_ns, at_once=at_once))
        return effects

    def withdraw(self, t_ns: int) -> list[Effect]:
        """Remove queued routes that their vehicles should not fly any more."""
        unwanted = self._tasking.withdraw_except(self._replanner.routes)
        return [answer for v in unwanted for answer in self._approval.end(v, t_ns, "not wanted any more")]

    def settle(self, effects: Sequence[Effect]) -> list[Effect]:
        """Process upload reports; a vehicle without its mission is planned for again."""
        settled: list[Effect] = []
        for effect in effects:
            settled.append(effect)
            if not isinstance(effect, UploadReport):
                continue
            if effect.ok:
                self._external_uploads.release([effect.vehicle])
                self._latency.note_success(effect.vehicle, effect.duration_s)
            else:
                self._latency.note_failure(effect.vehicle, effect.duration_s)
            if self._tasking.has_pending(effect.vehicle):
                continue  # the result of the newer upload counts
            settled += self._approval.uploaded(effect)
            if not effect.ok:
                self._replanner.drop_route(effect.vehicle)
        return settled
