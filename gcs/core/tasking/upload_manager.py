"""Missions on their way to vehicles: one transfer a vehicle at a time, the newest last.

A route becomes a mission, a mission becomes a `UploadTask` (upload, read back, compare, start), and its
end becomes an `UploadReport`. A newer route for the same vehicle replaces a transfer under way, unless that
has been replaced for long already; other routes wait until their link has room for them
(`gcs.core.tasking.upload_queue`, `gcs.core.tasking.link_window`).

What a task leaves behind is kept: what each vehicle holds (`gcs.core.tasking.onboard_missions`), whose it is
(`gcs.mavlink.fleet.mode_authority`), and whether it may hold a mix. A vehicle that may is held and cleared as
soon as it is heard, if no new mission does away with the mix first.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Container
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config.tables import AirframeTable, MissionTable
from gcs.core.airspace.mission_bounds import MissionBoundsCheck
from gcs.core.replanning.return_routes import ReturnRoutes
from gcs.core.replanning.takeoffs import Takeoffs
from gcs.core.tasking.first_legs import FirstLegs
from gcs.core.tasking.link_window import UploadWindow
from gcs.core.tasking.mission_builder import MissionBuilder, points_passed
from gcs.core.tasking.onboard_missions import OnboardMission, OnboardMissions, TerminalLoiter
from gcs.core.tasking.upload_queue import UploadQueue
from gcs.geo import LocalFrame
from gcs.mavlink.autopilots import AutopilotProfile
from gcs.mavlink.autopilots.base import is_on_ground
from gcs.mavlink.autopilots.modes import LOITER, RTL
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.mode_authority import ModeAuthority
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.mission.items import Home
from gcs.mavlink.mission.upload_stages import UploadTiming
from gcs.mavlink.mission.upload_task import UploadTask
from gcs.mavlink.services.rtt import RttEstimator
from gcs.model import (
    NS_PER_S,
    Effect,
    Notice,
    PersistedAuthority,
    Route,
    Upload,
    UploadAnswer,
    UploadReport,
    VehicleState,
)
from gcs.planning.terminal.climb import Climb
from gcs.planning.terminal.landing import ReturnRoute
from gcs.planning.vehicle_model import RemainingMission

_NO_ITEMS: Final = 0xFFFF
"""What PX4 gives as the number of items of no mission."""
_BOOT_NS: Final = 10 * NS_PER_S
"""So soon after a boot a mode is the one that the vehicle came up in."""
_END_NS: Final = 3 * NS_PER_S
"""Within this after a vehicle went to RTL it has told whether its mission is complete; it tells at 1 Hz."""
_ITEMS_ON_THEIR_WAY: Final = 12
"""Over one link at a time; each of its transfers has one of them at least."""


@dataclass(slots=True)
class _Delivery:
    """One transfer under way."""

    task: UploadTask
    link: str
    began_t_ns: int
    flown: OnboardMission | None
    """What the vehicle holds when this went well; None for a clearing, of which nobody waits for a report."""


class UploadManager:
    """All transfers under way.

    Parameters
    ----------
    table : MissionTable
        Altitude and least acceptance radius of every waypoint, and who uploads.
    airframe : AirframeTable
        How the vehicles turn: they are told to turn as long before each waypoint.
    frame : LocalFrame
        Where routes lie; its origin serves as home of a vehicle that has not told its own.
    fleet : Fleet
        Addresses and sequences.
    max_parallel : int
        Transfers at a time over one link, at the most.
    last_check : LastCheck or None
        Refuses missions with an item outside the map or the fence; None: none is refused.
    return_routes : Homing or None
        Plans the ways home of vehicles that land at their missions' ends; None: they fly straight.
    takeoffs : Takeoffs or None
        Knows the climbs of vehicles on the ground, and refuses those that are not clear; None: nobody does.
    holds_back : callable
        Says why a vehicle, armed on the ground, must not be started yet; empty when it may.
    """

    def __init__(
        self,
        table: MissionTable,
        airframe: AirframeTable,
        frame: LocalFrame,
        fleet: Fleet,
        max_parallel: int = 32,
        return_routes: ReturnRoutes | None = None,
        takeoffs: Takeoffs | None = None,
        last_check: MissionBoundsCheck | None = None,
        holds_back: Callable[[int], str] = lambda _vehicle: "",
    ) -> None:
        self._table, self._return_routes, self._takeoffs = table, return_routes, takeoffs
        self._last_check, self._holds_back = last_check, holds_back
        self._refusals: dict[int, str] = {}
        """Why the newest missions of vehicles are not uploaded, without figures: places are noisy."""
        self._missions = MissionBuilder(table, airframe, frame)
        self._fleet = fleet
        self._home = Home(frame.lat_deg, frame.lon_deg, frame.alt_msl_m)
        self._deliveries: dict[int, _Delivery] = {}
        self._onboard = OnboardMissions(fleet, stays=table.end == "loiter")
        self._first_legs = FirstLegs(fleet)
        self._waiting = UploadQueue(self._wait_s)
        self._windows: defaultdict[str, UploadWindow] = defaultdict(lambda: UploadWindow(max_parallel))
        self._busy: defaultdict[str, int] = defaultdict(int)
        self._authority: defaultdict[int, ModeAuthority] = defaultdict(ModeAuthority)
        self._paused: set[int] = set()
        """Vehicles that tell first what they hold."""
        self._inconsistent: set[int] = set()
        """Vehicles that may hold a mix."""
        self._mission_state: dict[int, int] = {}
        """MISSION_CURRENT's, as it was heard last."""
        self._boots: dict[int, int] = {}
        self._before_boot: dict[int, OnboardMission] = {}
        self._taken_t_ns: dict[int, int] = {}
        """When the mode was heard by which somebody took a vehicle."""
        self._mission_count = 0
        self._home_problems: dict[int, str] = {}

    @property
    def stages(self) -> dict[int, str]:
        """Stage of each transfer under way, by vehicle; "waiting" for room on its link."""
        stages = {vehicle: delivery.task.stage for vehicle, delivery in self._deliveries.items()}
        return dict.fromkeys(self._waiting.vehicles, "waiting") | stages

    def elapsed_s(self, vehicle: int, t_ns: int) -> float | None:
        """How long a transfer has been under way; None when there is none."""
        delivery = self._deliveries.get(vehicle)
        return None if delivery is None else (t_ns - delivery.began_t_ns) / NS_PER_S

    def is_uploading(self, vehicle: int) -> bool:
        """Return True if a mission is on its way to a vehicle, and not merely waiting for its turn."""
        delivery = self._deliveries.get(vehicle)
        return delivery is not None and delivery.flown is not None

    def has_pending(self, vehicle: int) -> bool:
        """Whether a mission waits for its transfer to a vehicle, or is on its way."""
        return vehicle in self._waiting.vehicles or self.is_uploading(vehicle)

    @property
    def mission_count(self) -> int:
        """Missions that were made so far."""
        return self._mission_count

    def resume_count(self, missions: int) -> None:
        """Go on counting where an earlier service was."""
        self._mission_count = missions

    def onboard(self, vehicle: int) -> OnboardMission | None:
        """What a vehicle holds, by the last read-back."""
        return self._onboard.of(vehicle)

    def forward_simulation(self, vehicle: int, t_ns: int) -> RemainingMission:
        """What a vehicle flies to by itself until it gets another mission, and when that may begin."""
        wait_s = 0.0 if vehicle in self._deliveries else self._wait_s(vehicle, t_ns)
        return self._onboard.forward_simulation(vehicle, wait_s, t_ns)

    def climb(self, vehicle: int, layer: int) -> Climb | None:
        """Return the climb that a vehicle has before it has its route; None when it flies."""
        if self._takeoffs is None:
            return None
        return self._takeoffs.climb(vehicle, layer, in_takeoff=self._onboard.is_in_takeoff(vehicle))

    def has_passed_route_end(self, vehicle: int) -> bool:
        """Whether a vehicle has its route's last point behind it, on a circle elsewhere."""
        return self._onboard.has_passed_route_end(vehicle)

    def terminal_phase(self, vehicle: int) -> TerminalLoiter:
        """Return what a vehicle flies behind the last point of its route; empty before that."""
        return "return" if self.has_completed(vehicle) else self._onboard.terminal_phase(vehicle)

    def is_in_takeoff(self, vehicle: int) -> bool:
        """Return True if a vehicle in AUTO flies to the take-off item of what it holds."""
        return self._onboard.is_in_takeoff(vehicle)

    def points_ahead(self, vehicle: int) -> tuple[tuple[float, float], ...]:
        """Points that a vehicle in AUTO flies to by what it holds, the next one first."""
        return self._onboard.points_ahead(vehicle)

    def may_be_inconsistent(self, vehicle: int) -> bool:
        """Whether a transfer is under way, or left a mix behind; never where uploads are atomic."""
        is_unsure = vehicle in self._deliveries or vehicle in self._inconsistent
        return is_unsure and not self._fleet.is_atomic(vehicle)

    def note_mission_lost(self, vehicle: int, booted_t_ns: int) -> None:
        """Note that a vehicle lost its mission when it booted; a LOITER that it came up in, nobody chose."""
        self.forget_onboard(vehicle)
        heard_t_ns = self._taken_t_ns.get(vehicle, booted_t_ns)
        if -NS_PER_S < heard_t_ns - booted_t_ns < _BOOT_NS:
            self._authority[vehicle].note_rejection()

    def pop_mission_before_boot(self, vehicle: int) -> OnboardMission | None:
        """Return, once, what a vehicle held when it rebooted; None where a transfer finds that out."""
        return self._before_boot.pop(vehicle, None)

    def note_onboard(self, flown: OnboardMission) -> None:
        """Note what a vehicle was found to hold."""
        self._onboard.note(flown)

    def pause_uploads(self, vehicle: int) -> None:
        """Begin no transfer to a vehicle until it is let go."""
        self._paused.add(vehicle)
        self._fleet.forward_next_heartbeat(vehicle)

    def resume_uploads(self, vehicle: int) -> None:
        """Let transfers to a vehicle begin again."""
        self._paused.discard(vehicle)

    def mark_inconsistent(self, vehicle: int) -> None:
        """Take a vehicle for one that may hold a mix: it is held and cleared when it is heard."""
        self._inconsistent.add(vehicle)
        self._fleet.forward_next_heartbeat(vehicle)

    def persisted_authority(self, vehicle: int) -> PersistedAuthority | None:
        """Return what is to be remembered of whose a vehicle is; None before it was heard."""
        return self._authority[vehicle].persisted() if vehicle in self._authority else None

    def restore_authority(self, vehicle: int, authority: PersistedAuthority) -> None:
        """Take up whose a vehicle was."""
        self._authority[vehicle].restore(authority)

    def untaskable(self) -> dict[int, str]:
        """Vehicles that are not ours to task, and why, in words."""
        reasons = {v: f"is in {mode} and left alone" for v, mode in self.override_modes().items()}
        landing = [v for v in self._authority if self._onboard.terminal_phase(v) == "landing"]
        reasons |= dict.fromkeys(landing, "is landing and left alone")
        for vehicle in self._authority:
            if self._fleet.link(vehicle) and self._fleet.profile(vehicle) is None:
                reasons[vehicle] = "has a firmware that is not known here"
        return reasons

    def override_modes(self) -> dict[int, str]:
        """Modes that somebody else chose, by vehicle."""
        return {v: custody.override for v, custody in self._authority.items() if custody.override}

    def forget_onboard(self, vehicle: int) -> None:
        """Forget what a vehicle holds: somebody else writes a mission to it."""
        self._first_legs.end(vehicle)
        self._onboard.forget(vehicle)
        self._inconsistent.discard(vehicle)

    def release_override(self, vehicle: int) -> None:
        """Take a vehicle back that somebody else took, on an operator's order."""
        self._authority[vehicle].release()
        self._waiting.forgive(vehicle)

    def has_failed(self, vehicle: int) -> bool:
        """True if a vehicle did not get or take its last mission: the next one may have to wait."""
        return self._waiting.has_failed(vehicle)

    @property
    def altitude_rel_m(self) -> float:
        """Height above home of the lowest altitude layer."""
        return self._table.altitude_rel_m

    def height_m(self, state: VehicleState) -> float:
        """Height of a vehicle above its home; above the mission's own when it has not told its home."""
        return state.alt_msl_m - (self._fleet.home(state.system_id) or self._home).alt_msl_m

    def note_parked(self, vehicle: int) -> None:
        """Note that a vehicle on the ground is told to LOITER: it stays ours to task."""
        self._authority[vehicle].note_command(LOITER)

    # ------------------------------------------------------------ in

    def enqueue_upload(self, route: Route, t_ns: int, *, at_once: bool = False) -> list[Effect]:
        """Send a route to its vehicle as a mission, in place of an older one that waits or is under way.

        Without `at_once` it waits until the vehicle has passed an item that it is about to reach, until a
        transfer is over that was replaced for long already, and for a pause after failures.
        """
        vehicle, delivery = route.vehicle, self._deliveries.get(route.vehicle)
        is_ours = delivery is not None and delivery.flown is not None  # a clearing gives way in `_admit`
        if (
            is_ours
            and not self._is_climbing(vehicle)
            and not self._holds_back(vehicle)
            and (at_once or self._waiting.is_replaceable(vehicle, t_ns))
        ):
            self._waiting.take(vehicle)
            return self._supersede(vehicle, t_ns) + self._begin(route, t_ns, t_ns)
        self._waiting.put(route, t_ns, at_once=at_once)
        return self._admit(t_ns)

    def withdraw_except(self, wanted: Container[int]) -> list[int]:
        """Take out the routes that wait for other vehicles than these; returns whose."""
        unwanted = [vehicle for vehicle in self._waiting.vehicles if vehicle not in wanted]
        for vehicle in unwanted:
            self._waiting.take(vehicle)
        return unwanted

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Take a vehicle's message: for its transfer, and for what it tells of the vehicle."""
        effects = self._watch(vehicle, message, t_ns)
        effects += self._first_legs.receive(vehicle, message, t_ns)
        delivery = self._deliveries.get(vehicle)
        if delivery is not None:
            effects += self._worked(vehicle, delivery.task.receive(message, t_ns))
        return effects

    def poll(self, t_ns: int) -> list[Effect]:
        """Let timers run."""
        effects: list[Effect] = []
        for vehicle, delivery in list(self._deliveries.items()):
            effects += self._worked(vehicle, delivery.task.poll(t_ns))
        effects += self._first_legs.poll(t_ns)
        return effects + self._admit(t_ns)

    def add_upload_answer(self, answer: UploadAnswer) -> list[Effect]:
        """Take what another program says of an upload that was left to it."""
        delivery = self._deliveries.get(answer.vehicle)
        if delivery is None or delivery.task.mission.mission_id != answer.mission_id:
            return []
        frames = delivery.task.add_external_result(answer.ok, answer.begun, answer.detail, answer.t_ns)
        return self._worked(answer.vehicle, frames)

    def cancel(self, vehicle: int, t_ns: int) -> None:
        """Stop talking to a vehicle that is taken for dead; should it be heard after all, no mix is left."""
        self._waiting.take(vehicle)
        self._supersede(vehicle, t_ns)
        self._waiting.forgive(vehicle)

    def abandon(self, vehicle: int, reason: str, t_ns: int) -> list[Effect]:
        """Give a transfer up safely: the vehicle keeps a whole mission, or holds and is cleared."""
        waited, delivery = self._waiting.take(vehicle), self._deliveries.get(vehicle)
        if delivery is not None:
            return self._worked(vehicle, delivery.task.abandon(reason, t_ns))
        return [] if waited is None else self._unsent(vehicle, reason, t_ns)

    # ------------------------------------------------------------ what a vehicle tells of itself

    def _watch(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        if self._fleet.boots(vehicle) != self._boots.setdefault(vehicle, 0):
            return self._rebooted(vehicle, t_ns)
        profile = self._fleet.profile(vehicle)
        if profile is None:
            return []
        if message.get_type() == "MISSION_CURRENT":
            self._complete(vehicle, profile, message, t_ns)
            return self._rejected(vehicle, profile, message, t_ns)
        if message.get_type() != "HEARTBEAT":
            return []
        custody = self._authority[vehicle]
        before = custody.override
        custody.observe_mode(
            profile.mode_name(message.custom_mode), at_end=self._onboard.is_at_end(vehicle, profile)
        )
        if custody.override != before:
            self._taken_t_ns[vehicle] = t_ns
        if profile.atomic:
            self._inconsistent.discard(vehicle)
        if vehicle in self._inconsistent and vehicle not in self._deliveries:
            return self._clean(vehicle, t_ns)
        return []

    def _rejected(self, vehicle: int, profile: AutopilotProfile, message: Message, t_ns: int) -> list[Effect]:
        """Take a vehicle back that is in LOITER because its navigator rejects the mission that it holds.

        A transfer under way sees to that itself.
        """
        before, self._mission_state[vehicle] = self._mission_state.get(vehicle), message.mission_state
        is_rejected = (
            message.mission_state == dialect.MISSION_STATE_NO_MISSION
            and before == dialect.MISSION_STATE_ACTIVE  # paused: somebody chose to hold it
            and 0 < message.total < _NO_ITEMS  # none: somebody cleared it
            and profile.atomic
        )
        if not is_rejected or vehicle in self._deliveries or self._authority[vehicle].override != LOITER:
            return []
        self._authority[vehicle].note_rejection()
        self._onboard.forget(vehicle)
        text = "its navigator rejects the mission that it holds (no valid mission): it waits where it is"
        return [Notice(t_ns, "alarm", text, vehicle), *self._unsent(vehicle, text, t_ns)]

    def _complete(self, vehicle: int, profile: AutopilotProfile, message: Message, t_ns: int) -> None:
        """Take a vehicle back that is in RTL because it has flown its mission to the end: nobody chose that.

        An ArduPlane that is told to return, or does so by a failsafe, has stopped its mission and not
        completed it (`GCS_MAVLINK::mission_state`, `ModeAuto::_exit`). Only its own mission counts, or what a
        transfer of ours has left of it.
        """
        flown = self._onboard.of(vehicle)
        is_whole = flown is not None and message.total == len(flown.items) - profile.home_items
        if (
            profile.ends_in == RTL
            and message.mission_state == dialect.MISSION_STATE_COMPLETE
            and (is_whole or vehicle in self._deliveries or vehicle in self._inconsistent)
            and vehicle in self.recently_in_rtl(t_ns)
        ):
            self._authority[vehicle].note_completion()

    def recently_in_rtl(self, t_ns: int) -> set[int]:
        """Return the vehicles that went from AUTO to RTL a moment ago, and have yet to tell why."""
        return {
            vehicle
            for vehicle, custody in self._authority.items()
            if custody.may_have_ended and t_ns - self._taken_t_ns.get(vehicle, 0) < _END_NS
        }

    def has_completed(self, vehicle: int) -> bool:
        """Return True if a vehicle is in RTL because its mission is complete."""
        return vehicle in self._authority and self._authority[vehicle].has_ended

    def _rebooted(self, vehicle: int, t_ns: int) -> list[Effect]:
        """Begin a transfer again: what the vehicle stores and flies must be learned anew."""
        self._boots[vehicle] = self._fleet.boots(vehicle)
        self._authority[vehicle].note_reboot()
        self._first_legs.end(vehicle)
        flown, delivery = self._onboard.of(vehicle), self._deliveries.get(vehicle)
        if flown is not None and delivery is None:
            self._before_boot[vehicle] = flown
        self._onboard.forget(vehicle)
        self._onboard.select(vehicle)
        return [] if delivery is None else self._worked(vehicle, delivery.task.restart(t_ns))

    def _wait_s(self, vehicle: int, t_ns: int) -> float:
        """How long to wait for a vehicle to pass an item; a mix is to be done away with at once."""
        return 0.0 if vehicle in self._inconsistent else self._onboard.wait_s(vehicle, t_ns)

    # ------------------------------------------------------------ transfers

    def _admit(self, t_ns: int) -> list[Effect]:
        """Begin the transfers for which there is room; a clearing gives its place to a mission."""
        effects: list[Effect] = []
        for vehicle in self._waiting.vehicles:
            link, delivery = self._fleet.link(vehicle), self._deliveries.get(vehicle)
            is_free = (
                self._busy[link] < self._windows[link].window if delivery is None else delivery.flown is None
            )
            is_held = vehicle in self._paused or self._is_climbing(vehicle)
            is_due = is_free and not is_held and self._waiting.is_due(vehicle, t_ns)
            if is_due and not self._holds_back(vehicle):
                made_t_ns = self._waiting.made_t_ns(vehicle)
                route = self._waiting.take(vehicle)
                assert route is not None  # it waits
                effects += self._supersede(vehicle, t_ns) + self._begin(route, made_t_ns, t_ns)
        return effects

    def _begin(self, route: Route, made_t_ns: int, t_ns: int) -> list[Effect]:
        vehicle, fleet = route.vehicle, self._fleet
        profile, state = fleet.profile(vehicle), fleet.state(vehicle)
        if profile is None:
            return self._unsent(vehicle, "its firmware is not known here, or it was never heard", t_ns)
        if self._authority[vehicle].override:
            return self._unsent(
                vehicle, f"not begun: {self._authority[vehicle].override} was chosen meanwhile", t_ns
            )
        climb = self.climb(vehicle, route.layer)
        if climb is not None and self._takeoffs is not None:
            problem = self._takeoffs.problem(vehicle, climb, route.points_m)
            if problem:
                return self._refused(vehicle, f"the take-off is not clear: {problem}", t_ns)
        self._mission_count += 1
        home = fleet.home(vehicle) or self._home
        way_home = None if self._return_routes is None else self._return_routes.way(route, state, home[:2])
        mission = self._missions.of(route, self._mission_count, state, way_home, climb)
        from_ground = is_on_ground(state, fleet.home(vehicle))
        old, mixed = self._onboard.of(vehicle), vehicle in self._inconsistent
        link = fleet.link(vehicle)
        round_trip_s = self._windows[link].round_trip_s or fleet.round_trip_s(vehicle)
        task = UploadTask(
            mission,
            home,
            fleet.encoder(vehicle),
            profile=profile,
            authority=self._authority[vehicle],
            old=None if old is None else old.items,
            inconsistent=mixed,
            current=state.mission_seq if state is not None and state.mission_seq >= 0 else None,
            time_to_next_s=lambda now_ns: self._onboard.time_to_next_s(vehicle, now_ns),
            first_item=lambda: profile.first_flown(
                points_passed(route, made_t_ns, fleet.state(vehicle)),
                from_ground=from_ground,
                still_on_ground=is_on_ground(fleet.state(vehicle), fleet.home(vehicle)),
            ),
            from_ground=from_ground,
            delegated=self._table.uploader != "own",
            timing=UploadTiming().for_round_trip(round_trip_s),
            rtt=RttEstimator(round_trip_s),
            link_window=lambda: max(1, _ITEMS_ON_THEIR_WAY // self._busy[link]),
        )
        if self._last_check is not None:
            problem = self._last_check.problem(task.items[profile.home_items :], state)
            if problem:
                return self._refused(vehicle, f"{problem}; the vehicle keeps what it holds", t_ns)
        self._refusals.pop(vehicle, None)
        self._inconsistent.discard(vehicle)
        self._first_legs.end(vehicle)
        flown = OnboardMission(route, task.items, profile.home_items + int(from_ground))
        self._deliveries[vehicle] = _Delivery(task, link, t_ns, flown)
        self._busy[link] += 1
        self._waiting.began(vehicle, t_ns)
        return [*self._warned(way_home, vehicle, t_ns), *self._worked(vehicle, task.start(t_ns))]

    def _warned(self, way_home: ReturnRoute | None, vehicle: int, t_ns: int) -> list[Effect]:
        """Say what is wrong with a vehicle's way home, unless that is no news."""
        said = self._home_problems.get(vehicle, "")
        problem = self._home_problems[vehicle] = "" if way_home is None else way_home.problem
        return [Notice(t_ns, "warning", problem, vehicle)] if problem not in ("", said) else []

    def _unsent(self, vehicle: int, why: str, t_ns: int) -> list[Effect]:
        """Say that a mission is not even begun with."""
        self._mission_count += 1
        return [
            UploadReport(t_ns, vehicle, self._mission_count, 0, False, why, 0.0, 0),
            *self._ended(vehicle, t_ns, ok=False),
        ]

    def _refused(self, vehicle: int, why: str, t_ns: int) -> list[Effect]:
        """Say why a mission is not uploaded; once, unless the reason changes by more than its figures."""
        effects: list[Effect] = []
        kind = "".join(letter for letter in why if not letter.isdigit())
        if self._refusals.get(vehicle) != kind:
            effects.append(Notice(t_ns, "alarm", f"its mission is not uploaded, {why}", vehicle))
        self._refusals[vehicle] = kind
        self._mission_count += 1
        self._waiting.ended(vehicle, t_ns, ok=False)
        return [*effects, UploadReport(t_ns, vehicle, self._mission_count, 0, False, why, 0.0, 0)]

    def _is_climbing(self, vehicle: int) -> bool:
        """Tell whether a vehicle is in the air in its take-off: a new mission would turn it at once."""
        state = self._fleet.state(vehicle)
        in_air = not is_on_ground(state, self._fleet.home(vehicle))
        return in_air and self._onboard.is_in_takeoff(vehicle)

    def _ended(self, vehicle: int, t_ns: int, *, ok: bool) -> list[Effect]:
        """Say so when a vehicle has to wait after failures."""
        pause_s = self._waiting.ended(vehicle, t_ns, ok=ok)
        if not pause_s:
            return []
        text = f"got none of its last missions: the next one is sent after {pause_s:.0f} s"
        return [Notice(t_ns, "alarm", text, vehicle)]

    def _clean(self, vehicle: int, t_ns: int) -> list[Effect]:
        """Hold and clear a vehicle that may hold a mix."""
        profile = self._fleet.profile(vehicle)
        assert profile is not None  # its heartbeat was just taken
        self._inconsistent.discard(vehicle)
        self._first_legs.end(vehicle)
        task = UploadTask(
            self._missions.nothing(vehicle),
            self._home,
            self._fleet.encoder(vehicle),
            profile=profile,
            authority=self._authority[vehicle],
            inconsistent=True,
        )
        delivery = _Delivery(task, self._fleet.link(vehicle), t_ns, None)
        self._deliveries[vehicle] = delivery
        self._busy[delivery.link] += 1
        return self._worked(vehicle, task.start_clearing(t_ns))

    def _supersede(self, vehicle: int, t_ns: int) -> list[Effect]:
        """End a transfer under way, silently."""
        delivery = self._deliveries.get(vehicle)
        if delivery is None:
            return []
        frames = delivery.task.supersede(t_ns)
        self._leave(vehicle)
        return [*self._fleet.address_frames(vehicle, frames)]

    def _leave(self, vehicle: int) -> _Delivery:
        """Take an ended transfer off, and keep what it says of the vehicle."""
        delivery = self._deliveries.pop(vehicle)
        self._busy[delivery.link] -= 1
        result = delivery.task.result
        assert result is not None
        if delivery.task.uploads:
            self._onboard.select(vehicle, selected=result.selected)
        if delivery.task.is_inconsistent:
            self.mark_inconsistent(vehicle)
        elif result.onboard == "equal" and delivery.flown is not None:
            self._onboard.note(delivery.flown)
            if result.ok:
                self._first_legs.begin(
                    delivery.flown, delivery.task.first_seq, delivery.task.leg_t_ns, result.t_ns
                )
        elif result.onboard != "old":
            self._onboard.forget(vehicle)
        return delivery

    def _worked(self, vehicle: int, frames: list[bytes]) -> list[Effect]:
        delivery = self._deliveries[vehicle]
        task, result = delivery.task, delivery.task.result
        effects: list[Effect] = [*self._fleet.address_frames(vehicle, frames)]
        handover = task.take_external_frames()
        if handover:
            effects.append(Upload(vehicle, task.mission.mission_id, handover))
        if result is None:
            self._fleet.forward_next_heartbeat(vehicle)
            return effects
        self._leave(vehicle)
        repeated = result.retries / len(task.items)
        self._windows[delivery.link].ended(delivery.began_t_ns, result.t_ns, task.round_trip_s, repeated)
        is_clearing = delivery.flown is None
        if not is_clearing:
            effects.append(task.report())
            effects += self._ended(vehicle, result.t_ns, ok=result.ok)
        is_cleared = result.onboard == "cleared"
        if not result.ok and (
            result.was_held or self._authority[vehicle].override or is_clearing or is_cleared
        ):
            said = "was told to hold" if result.was_held else "is not ours now"
            said = "holds no mission now" if is_cleared else said
            effects.append(Notice(result.t_ns, "alarm", f"{said}: {result.detail}", vehicle))
        return effects
