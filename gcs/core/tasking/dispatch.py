"""Routes go out as missions; who did not get its mission is planned for again."""

from __future__ import annotations

from collections.abc import Container, Sequence

from gcs.core.authority.external_uploads import ExternalUploads
from gcs.core.operator.plan_approval import PlanApproval
from gcs.core.replanning.replanner import Replanner
from gcs.core.tasking.upload_latency import UploadLatency
from gcs.core.tasking.upload_manager import UploadManager
from gcs.model import Effect, Route, UploadReport


class Dispatch:
    """Between who decides routes and who transfers missions.

    Parameters
    ----------
    replanner, approval
        Who flies what, and which of it an operator confirmed.
    tasking
        Transfers missions.
    latency
        Learns how long that takes.
    external_uploads
        Know to whom another ground station gave a mission.
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

    def send(self, routes: Sequence[Route], t_ns: int, hurried: Container[int] = ()) -> list[Effect]:
        """Send routes to their vehicles as missions; those `hurried` do not wait for anything."""
        effects: list[Effect] = self.withdraw(t_ns)
        for route in routes:
            at_once = route.vehicle in hurried
            for_s = self._tasking.elapsed_s(route.vehicle, t_ns)
            if for_s is not None:
                self._latency.given_up(route.vehicle, for_s)
            effects += self.settle(self._tasking.enqueue_upload(route, t_ns, at_once=at_once))
        return effects

    def withdraw(self, t_ns: int) -> list[Effect]:
        """Let no route wait for a vehicle that is not to fly it any more."""
        unwanted = self._tasking.withdraw_except(self._replanner.routes)
        return [answer for v in unwanted for answer in self._approval.end(v, t_ns, "not wanted any more")]

    def settle(self, effects: Sequence[Effect]) -> list[Effect]:
        """Answer for transfers that ended; who did not get its mission is planned for again."""
        settled: list[Effect] = []
        for effect in effects:
            settled.append(effect)
            if not isinstance(effect, UploadReport):
                continue
            if effect.ok:
                self._external_uploads.release([effect.vehicle])
                self._latency.arrived(effect.vehicle, effect.duration_s)
            else:
                self._latency.given_up(effect.vehicle, effect.duration_s)
            if self._tasking.has_pending(effect.vehicle):
                continue  # a newer mission is on its way: what counts is what becomes of that
            settled += self._approval.uploaded(effect)
            if not effect.ok:
                self._replanner.drop_route(effect.vehicle)
        return settled
