"""Uploads in progress, one for each vehicle: begun, restarted, abandoned; what follows from the result.

Each is an `Upload`: send, read back, compare, start. Its result updates the onboard mission of the vehicle
(`gcs.core.tasking.onboard_missions`), or marks that mission as possibly inconsistent. A vehicle with
an inconsistent mission is held and cleared, unless a new mission replaces it first.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from gcs.core.authority.overrides import Overrides
from gcs.core.state import Agent
from gcs.core.tasking.first_legs import FirstLegs
from gcs.core.tasking.mission_builder import points_passed
from gcs.core.tasking.onboard_missions import OnboardMissions
from gcs.core.tasking.rejections import Rejections
from gcs.core.tasking.tasking_state import ActiveUpload, OnboardMission, TaskingState
from gcs.core.tasking.upload_pauses import ClearingRetry, RejectionRetry, UploadRetry
from gcs.core.tasking.upload_window import UploadWindow
from gcs.mavlink.autopilots.modes import AUTO, LOITER
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.on_ground import is_on_ground
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.mission.item_builder import first_flown_item
from gcs.mavlink.mission.upload import Upload
from gcs.mavlink.mission.upload_kinds import mission_upload
from gcs.mavlink.mission.upload_limits import MAX_ITEMS_IN_FLIGHT, UploadPolicy
from gcs.mavlink.mission.upload_stages import Event, OnboardState
from gcs.mavlink.mission.upload_state import UploadState
from gcs.model import Effect, Notice, NoticeCode, Parameter, UploadReport


class ActiveUploads(UploadPolicy):
    """Uploads in progress, at most `max_parallel` at a time over one link, and their policy."""

    def __init__(
        self,
        fleet: Fleet,
        agents: Mapping[int, Agent],
        state: TaskingState,
        onboard: OnboardMissions,
        overrides: Overrides,
        first_legs: FirstLegs,
        rejections: Rejections,
        max_parallel: int,
    ) -> None:
        self._fleet = fleet
        self._agents = agents
        self._state = state
        self._uploads = state.uploads
        self._windows = state.windows
        self._onboard = onboard
        self._overrides = overrides
        self._first_legs = first_legs
        self._rejections = rejections
        self._max_parallel = max_parallel

    def has_capacity(self, vehicle: int) -> bool:
        """Return True if an upload to a vehicle may begin; clearing precedes a mission."""
        if vehicle in self._uploads:
            return not self._state.is_uploading(vehicle)
        window = self._window(self._fleet.link(vehicle))
        return window.active < window.window

    def mark_inconsistent(self, vehicle: int) -> None:
        """Mark an onboard mission as inconsistent: the vehicle is held and cleared when it is heard."""
        self._agents[vehicle].tasking.is_inconsistent = True
        self._fleet.forward_next_heartbeat(vehicle)

    def round_trip_s(self, link: str) -> float:
        """Return the round-trip time that the last upload over a link measured; 0 if there was none."""
        return self._window(link).round_trip_s

    def _window(self, link: str) -> UploadWindow:
        if link not in self._windows:
            self._windows[link] = UploadWindow.first(self._max_parallel)
        return self._windows[link]

    # ------------------------------------------------------------ policy of the tasks

    def time_to_next_s(self, vehicle: int, t_ns: int) -> float:
        """Return the time until a vehicle reaches its current item; 0 if that is unknown."""
        return self._onboard.time_to_next_s(vehicle, t_ns) if self._state.is_uploading(vehicle) else 0.0

    def first_item(self, vehicle: int) -> int:
        """Return the first item ahead of a vehicle."""
        upload = self._uploads[vehicle]
        profile = self._fleet.profile(vehicle)
        if upload.onboard is None or profile is None:
            return 0
        state = self._fleet.state(vehicle)
        route = upload.onboard.route
        is_circling = profile.climbs_first and state is not None and state.mode != AUTO
        begins_low = is_circling and route.heights_msl_m is not None  # the first point is the lowest one
        return first_flown_item(
            profile,
            0 if begins_low else points_passed(route, upload.planned_t_ns, state),
            from_ground=upload.onboard.first_point > profile.home_items,
            still_on_ground=is_on_ground(state, self._fleet.home(vehicle)),
        )

    def max_items_in_flight(self, vehicle: int) -> int:
        """Return the number of items that an upload may have in flight on its link."""
        return max(1, MAX_ITEMS_IN_FLIGHT // self._window(self._uploads[vehicle].link).active)

    # ------------------------------------------------------------ uploads

    def start(
        self, state: UploadState, mission: OnboardMission, planned_t_ns: int, t_ns: int
    ) -> list[Effect]:
        """Start the upload of a mission whose route was planned at `planned_t_ns`."""
        self._add(ActiveUpload(state, self._fleet.link(state.vehicle), mission, planned_t_ns))
        self._agents[state.vehicle].tasking.retry.note_begin(t_ns)
        return self._order(state.vehicle, Event.START, t_ns)

    def clear(self, state: UploadState, t_ns: int) -> list[Effect]:
        """Hold a vehicle and clear its inconsistent mission."""
        self._add(ActiveUpload(state, self._fleet.link(state.vehicle), None, t_ns))
        return self._order(state.vehicle, Event.START_CLEARING, t_ns)

    def _add(self, upload: ActiveUpload) -> None:
        vehicle = upload.state.vehicle
        self._agents[vehicle].tasking.is_inconsistent = False
        self._first_legs.end(vehicle)
        self._uploads[vehicle] = upload
        self._window(upload.link).active += 1

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Process a message of a vehicle."""
        if vehicle not in self._uploads:
            return []
        task = self._task(vehicle)
        return self._progress(vehicle, task, task.receive(message, t_ns), t_ns)

    def poll(self, t_ns: int) -> list[Effect]:
        """Run the timers."""
        effects: list[Effect] = []
        for vehicle in list(self._uploads):
            task = self._task(vehicle)
            effects += self._progress(vehicle, task, task.poll(t_ns), t_ns)
        return effects

    def restart(self, vehicle: int, t_ns: int) -> list[Effect]:
        """Restart an upload after a reboot of its vehicle."""
        return self._order(vehicle, Event.REBOOT, t_ns)

    def resume(self, t_ns: int) -> list[Effect]:
        """Continue all uploads after an outage of the service."""
        effects: list[Effect] = []
        for vehicle in list(self._uploads):
            effects += self._order(vehicle, Event.RESTART, t_ns)
        return effects

    def abandon(self, vehicle: int, reason: str, t_ns: int, mode: str) -> list[Effect]:
        """End an upload for an order to a mode; nothing is sent that could undo another one than LOITER."""
        return self._order(vehicle, Event.ABANDON if mode == LOITER else Event.STOP, t_ns, reason)

    def yield_up(self, vehicle: int, reason: str, t_ns: int) -> list[Effect]:
        """End an upload because another service with our ids commands the vehicle."""
        return self._order(vehicle, Event.YIELD, t_ns, reason)

    def supersede(self, vehicle: int, t_ns: int) -> list[Effect]:
        """End an upload without a report, for a newer one."""
        if vehicle not in self._uploads:
            return []
        task = self._task(vehicle)
        frames = task.order(Event.STOP, t_ns, "superseded")
        self._remove(vehicle, task)
        return [*self._fleet.address_frames(vehicle, frames)]

    def _task(self, vehicle: int) -> Upload:
        state = self._uploads[vehicle].state
        encode = self._fleet.encoder(vehicle)
        return mission_upload(state, encode, self._overrides.of(vehicle), self)

    def _order(self, vehicle: int, event: Event, t_ns: int, reason: str = "") -> list[Effect]:
        task = self._task(vehicle)
        return self._progress(vehicle, task, task.order(event, t_ns, reason), t_ns)

    def _remove(self, vehicle: int, task: Upload) -> None:
        """Remove an ended upload and keep its result."""
        upload = self._uploads.pop(vehicle)
        result = task.result
        self._window(upload.link).active -= 1
        tasking = self._agents[vehicle].tasking
        assert result is not None
        if upload.state.transfer.uploads:
            tasking.is_selected = result.selected
        if task.is_inconsistent or task.is_unselected:
            tasking.onboard = None
            self.mark_inconsistent(vehicle)
        elif result.onboard is OnboardState.EQUAL and upload.onboard is not None:
            tasking.onboard = upload.onboard
            if result.ok:
                flown = upload.state.activation
                self._first_legs.begin(upload.onboard, flown.first_seq, flown.leg_t_ns, result.t_ns)
        elif result.onboard is not OnboardState.OLD:
            tasking.onboard = None

    def _progress(self, vehicle: int, task: Upload, frames: list[bytes], t_ns: int) -> list[Effect]:
        """Send the frames of an upload; report its result if it has ended."""
        upload = self._uploads[vehicle]
        result = task.result
        effects: list[Effect] = [*self._fleet.address_frames(vehicle, frames)]
        if task.error is not None:
            effects.insert(0, Notice(t_ns, NoticeCode.UPLOAD_ERROR, vehicle, {"error": str(task.error)}))
        if result is None:
            self._fleet.forward_next_heartbeat(vehicle)
            slowness = task.slowness(t_ns)
            if slowness:
                effects.append(Notice(t_ns, NoticeCode.UPLOAD_SLOW, vehicle, slowness))
            return effects
        self._remove(vehicle, task)
        window = self._window(upload.link)
        repeated = result.retries / len(task.items)
        window.note_end(upload.state.began_t_ns, result.t_ns, upload.state.rtt.round_trip_s, repeated)
        if upload.onboard is not None:
            if upload.state.activation.is_unflyable:
                self._agents[vehicle].tasking.retry.note_rejection()
                return effects + self._rejected(task.report(), upload)
            effects.append(task.report())
            if result.ok:
                self._agents[vehicle].tasking.retry = UploadRetry()
                self._agents[vehicle].tasking.rejections = RejectionRetry()
            else:
                effects += self._agents[vehicle].tasking.retry.note_failure(vehicle, result.t_ns)
        tasking = self._agents[vehicle].tasking
        taken_by = self._overrides.of(vehicle).taken_by
        if not task.is_inconsistent:
            tasking.clearing = ClearingRetry()
        elif task.state.clearing.has_begun and not taken_by:
            return effects + tasking.clearing.note_failure(vehicle, result.t_ns, result.detail)
        is_cleared = result.onboard is OnboardState.CLEARED
        if result.ok or not (result.was_held or taken_by or upload.onboard is None or is_cleared):
            return effects
        state = "was set to LOITER" if result.was_held else "is overridden"
        state = "has no onboard mission now" if is_cleared else state
        about: dict[str, Parameter] = {"state": state, "detail": result.detail}
        return [*effects, Notice(result.t_ns, NoticeCode.WITHOUT_MISSION, vehicle, about)]

    def _rejected(self, report: UploadReport, upload: ActiveUpload) -> list[Effect]:
        """Report an upload whose mission the vehicle's navigator rejects, with the vehicle's own cause."""
        began_t_ns = upload.state.began_t_ns
        detail = f"{report.detail}: {self._rejections.cause(report.vehicle, began_t_ns)}"
        notices = self._rejections.begin(report.vehicle, report.t_ns, began_t_ns)
        return [replace(report, detail=detail), *notices]
