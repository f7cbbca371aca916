"""Missions on their way to vehicles: one transfer a vehicle at a time, the newest wins.

A route becomes a mission, a mission becomes a `MissionTask` (upload, read back, compare, start), and its
end becomes an `UploadReport`. A newer mission for the same vehicle replaces a transfer under way, at once;
other missions wait until their link has room for them (`gcs.command.lanes`).

What a task leaves behind is kept here: what each vehicle holds by the last read-back, whose it is
(`gcs.mavlink.custody`), and whether it may hold a mix. A vehicle that may is held and cleared as soon as it
is heard, if no new mission does away with the mix first.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from gcs.command.lanes import Lane
from gcs.config.tables import AirframeTable, MissionTable
from gcs.geo import LocalFrame
from gcs.mavlink.codec import Message
from gcs.mavlink.custody import Custody
from gcs.mavlink.fleet import Fleet
from gcs.mavlink.items import Home, Item
from gcs.mavlink.modes import AUTO, LOITER
from gcs.mavlink.profiles import Profile
from gcs.mavlink.profiles.profile import is_on_ground
from gcs.mavlink.task import Timing
from gcs.mavlink.transfer import MissionTask
from gcs.model import (
    NS_PER_S,
    CustodyMemory,
    Effect,
    FloatArray,
    Mission,
    Notice,
    Route,
    Upload,
    UploadAnswer,
    UploadReport,
    Waypoint,
)
from gcs.planning.prediction import Ahead
from gcs.planning.progress import CORRIDOR_M, next_point, time_to_point_s
from gcs.planning.turning import acceptance_m

_MAX_RADIUS_M = 255.0
"""What a mission item can hold."""
_TRANSFER_S = 1.0
"""What a transfer takes on a good link."""
_PAST_S = 0.3
"""Until a vehicle that should have turned to its next item says so."""
_MOST_WAIT_NS = 5 * NS_PER_S


@dataclass(frozen=True, slots=True)
class Flown:
    """What a vehicle holds, by the last read-back."""

    route: Route
    items: tuple[Item, ...]
    first_point: int
    """Number of the item that is the route's first point."""


@dataclass(frozen=True, slots=True)
class _Waiting:
    """A route that waits for its transfer."""

    route: Route
    until_ns: int
    """From then on it waits for room on its link alone."""


@dataclass(slots=True)
class _Delivery:
    """One transfer under way."""

    task: MissionTask
    link: str
    began_t_ns: int
    flown: Flown | None
    """What the vehicle holds when this went well; None for a clearing, of which nobody waits for a report."""


class Tasking:
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
    """

    def __init__(
        self,
        table: MissionTable,
        airframe: AirframeTable,
        frame: LocalFrame,
        fleet: Fleet,
        max_parallel: int = 32,
    ) -> None:
        self._table = table
        self._airframe = airframe
        self._frame = frame
        self._fleet = fleet
        self._home = Home(frame.lat_deg, frame.lon_deg, frame.alt_msl_m)
        self._deliveries: dict[int, _Delivery] = {}
        self._waiting: dict[int, _Waiting] = {}
        self._asked_t_ns: dict[int, int] = {}
        """When each vehicle's newest route was made."""
        self._lanes: defaultdict[str, Lane] = defaultdict(lambda: Lane(max_parallel))
        self._busy: defaultdict[str, int] = defaultdict(int)
        self._custody: defaultdict[int, Custody] = defaultdict(Custody)
        self._flown: dict[int, Flown] = {}
        self._mixed: set[int] = set()
        """Vehicles that may hold a mix."""
        self._unselected: set[int] = set()
        """Vehicles that may fly on by the numbers of a mission that they no longer hold."""
        self._boots: dict[int, int] = {}
        self._mission_count = 0

    @property
    def under_way(self) -> dict[int, str]:
        """Stage of each transfer under way, by vehicle; "waiting" for room on its link."""
        stages = {vehicle: delivery.task.stage for vehicle, delivery in self._deliveries.items()}
        return dict.fromkeys(self._waiting, "waiting") | stages

    def under_way_s(self, vehicle: int, t_ns: int) -> float | None:
        """How long a transfer has been under way; None when there is none."""
        delivery = self._deliveries.get(vehicle)
        return None if delivery is None else (t_ns - delivery.began_t_ns) / NS_PER_S

    @property
    def missions(self) -> int:
        """Missions that were made so far."""
        return self._mission_count

    def count_from(self, missions: int) -> None:
        """Go on counting where an earlier service was."""
        self._mission_count = missions

    def flown(self, vehicle: int) -> Flown | None:
        """What a vehicle holds, by the last read-back."""
        return self._flown.get(vehicle)

    def ahead(self, vehicle: int, t_ns: int) -> Ahead:
        """What a vehicle flies to by itself until it gets another mission, and when that may begin."""
        points = self.points_ahead(vehicle)
        if not points:
            return Ahead()
        items = self._flown[vehicle].items
        last = self._flown[vehicle].first_point + len(self._flown[vehicle].route.points_m)
        radii = tuple(item.param2 for item in items[last - len(points) : last])
        return Ahead(points, radii, 0.0 if vehicle in self._deliveries else self._wait_s(vehicle, t_ns))

    def points_ahead(self, vehicle: int) -> tuple[tuple[float, float], ...]:
        """Points that a vehicle in AUTO flies to by what it holds, the next one first."""
        flown, state = self._flown.get(vehicle), self._fleet.state(vehicle)
        if flown is None or state is None or state.mode != AUTO or vehicle in self._unselected:
            return ()
        if state.mission_seq < flown.first_point:
            return ()
        left = flown.route.points_m[state.mission_seq - flown.first_point :]
        return tuple((east_m, north_m) for east_m, north_m in left.tolist())

    def may_be_mixed(self, vehicle: int) -> bool:
        """Whether a transfer is under way to a vehicle, or left a mix behind."""
        return vehicle in self._deliveries or vehicle in self._mixed

    def found(self, flown: Flown) -> None:
        """Note what a vehicle was found to hold."""
        self._flown[flown.route.vehicle] = flown

    def suspect(self, vehicle: int) -> None:
        """Take a vehicle for one that may hold a mix: it is held and cleared when it is heard."""
        self._mixed.add(vehicle)
        self._fleet.attend(vehicle)

    def custody(self, vehicle: int) -> CustodyMemory | None:
        """Return what is to be remembered of whose a vehicle is; None before it was heard."""
        return self._custody[vehicle].memory() if vehicle in self._custody else None

    def remember(self, vehicle: int, custody: CustodyMemory) -> None:
        """Take up whose a vehicle was."""
        self._custody[vehicle].remember(custody)

    def taken(self) -> dict[int, str]:
        """Vehicles that are not ours to task, and why, in words."""
        reasons = {v: f"is in {c.taken} and left alone" for v, c in self._custody.items() if c.taken}
        for vehicle in self._custody:
            if self._fleet.link(vehicle) and self._fleet.profile(vehicle) is None:
                reasons[vehicle] = "has a firmware that is not known here"
        return reasons

    def overwritten(self, vehicle: int) -> None:
        """Forget what a vehicle holds: somebody else writes a mission to it."""
        self._flown.pop(vehicle, None)
        self._mixed.discard(vehicle)

    def release(self, vehicle: int) -> None:
        """Take a vehicle back that somebody else took, on an operator's order."""
        self._custody[vehicle].release()

    # ------------------------------------------------------------ in

    def task(self, route: Route, t_ns: int, *, at_once: bool = False) -> list[Effect]:
        """Send a route to its vehicle as a mission; a transfer under way is given up for it.

        Without `at_once` it waits until the vehicle has passed an item that it is about to reach.
        """
        vehicle = route.vehicle
        self._asked_t_ns[vehicle] = t_ns
        if self._supersede(vehicle, t_ns):
            return self._begin(route, t_ns)
        before = self._waiting.get(vehicle)
        patience_ns = 0 if at_once else _MOST_WAIT_NS
        until_ns = t_ns + patience_ns if before is None else min(before.until_ns, t_ns + patience_ns)
        self._waiting[vehicle] = _Waiting(route, until_ns)
        return self._admit(t_ns)

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Take a vehicle's message: for its transfer, and for what it tells of the vehicle."""
        effects = self._watch(vehicle, message, t_ns)
        delivery = self._deliveries.get(vehicle)
        if delivery is not None:
            effects += self._worked(vehicle, delivery.task.receive(message, t_ns))
        return effects

    def poll(self, t_ns: int) -> list[Effect]:
        """Let timers run."""
        effects: list[Effect] = []
        for vehicle, delivery in list(self._deliveries.items()):
            effects += self._worked(vehicle, delivery.task.poll(t_ns))
        return effects + self._admit(t_ns)

    def answered(self, answer: UploadAnswer) -> list[Effect]:
        """Take what another program says of an upload that was left to it."""
        delivery = self._deliveries.get(answer.vehicle)
        if delivery is None or delivery.task.mission.mission_id != answer.mission_id:
            return []
        frames = delivery.task.delivered(answer.ok, answer.begun, answer.detail, answer.t_ns)
        return self._worked(answer.vehicle, frames)

    def cancel(self, vehicle: int, t_ns: int) -> None:
        """Stop talking to a vehicle that is taken for dead; should it be heard after all, no mix is left."""
        self._waiting.pop(vehicle, None)
        self._supersede(vehicle, t_ns)

    def abandon(self, vehicle: int, reason: str, t_ns: int) -> list[Effect]:
        """Give a transfer up safely: the vehicle keeps a whole mission, or holds and is cleared."""
        self._waiting.pop(vehicle, None)
        delivery = self._deliveries.get(vehicle)
        return [] if delivery is None else self._worked(vehicle, delivery.task.abandon(reason, t_ns))

    # ------------------------------------------------------------ what a vehicle tells of itself

    def _watch(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        if self._fleet.boots(vehicle) != self._boots.setdefault(vehicle, 0):
            return self._rebooted(vehicle, t_ns)
        profile = self._fleet.profile(vehicle)
        if message.get_type() != "HEARTBEAT" or profile is None:
            return []
        custody = self._custody[vehicle]
        custody.heard(profile.mode_name(message.custom_mode), at_end=self._at_end(vehicle, profile))
        if vehicle in self._mixed and vehicle not in self._deliveries:
            return self._clean(vehicle, t_ns)
        return []

    def _rebooted(self, vehicle: int, t_ns: int) -> list[Effect]:
        """Begin a transfer again: what the vehicle stores and flies must be learned anew."""
        self._boots[vehicle] = self._fleet.boots(vehicle)
        self._custody[vehicle].rebooted()
        self._flown.pop(vehicle, None)
        self._unselected.discard(vehicle)
        delivery = self._deliveries.get(vehicle)
        return [] if delivery is None else self._worked(vehicle, delivery.task.restart(t_ns))

    def _at_end(self, vehicle: int, profile: Profile) -> bool:
        flown, state = self._flown.get(vehicle), self._fleet.state(vehicle)
        if profile.ends_in != LOITER or flown is None or state is None:
            return False
        return state.mission_seq == len(flown.items) - 1

    def _time_to_next_s(self, vehicle: int, t_ns: int) -> float:
        """Seconds until it can take its next item from the store; 0 when that is not known."""
        flown, state = self._flown.get(vehicle), self._fleet.state(vehicle)
        if flown is None or state is None or vehicle in self._unselected:
            return 0.0
        if state.mission_seq < flown.first_point:
            return 0.0
        place, index = (state.east_m, state.north_m), state.mission_seq - flown.first_point
        if index >= len(flown.route.points_m):
            return math.inf if self._table.end == "loiter" else 0.0
        points_m, speed_m_s = flown.route.points_m, state.ground_speed_m_s
        radius_m = flown.items[state.mission_seq].param2 if state.mission_seq < len(flown.items) else 0.0
        to_go_s = time_to_point_s(points_m, index, place, speed_m_s, radius_m)
        return to_go_s - (t_ns - state.t_ns) / NS_PER_S

    # ------------------------------------------------------------ transfers

    def _admit(self, t_ns: int) -> list[Effect]:
        """Begin the transfers for which there is room."""
        effects: list[Effect] = []
        for vehicle, one in list(self._waiting.items()):
            link = self._fleet.link(vehicle)
            has_room = self._busy[link] < self._lanes[link].window
            if has_room and (t_ns >= one.until_ns or not self._wait_s(vehicle, t_ns)):
                del self._waiting[vehicle]
                effects += self._begin(one.route, t_ns)
        return effects

    def _wait_s(self, vehicle: int, t_ns: int) -> float:
        """How long to wait with a transfer, so that the vehicle need not be told to hold for it.

        Over a mixed store nobody may take the next item; whoever is about to would have to hold, which is a
        turn that nobody planned, from where it happens to be. It is past its item within seconds.
        """
        profile = self._fleet.profile(vehicle)
        if profile is None or profile.atomic or not self.points_ahead(vehicle):
            return 0.0
        to_go_s = self._time_to_next_s(vehicle, t_ns)
        return to_go_s + _PAST_S if to_go_s < Timing().guard_s + _TRANSFER_S else 0.0

    def _begin(self, route: Route, t_ns: int) -> list[Effect]:
        vehicle, fleet = route.vehicle, self._fleet
        self._mission_count += 1
        mission = self._mission(route, self._mission_count)
        profile, state = fleet.profile(vehicle), fleet.state(vehicle)
        if profile is None:
            text = "its firmware is not known here, or it was never heard"
            return [UploadReport(t_ns, vehicle, mission.mission_id, 0, False, text, 0.0, 0)]
        from_ground = is_on_ground(state, fleet.home(vehicle))
        old, mixed = self._flown.get(vehicle), vehicle in self._mixed
        self._mixed.discard(vehicle)
        task = MissionTask(
            mission,
            fleet.home(vehicle) or self._home,
            fleet.encoder(vehicle),
            profile=profile,
            custody=self._custody[vehicle],
            old=None if old is None else old.items,
            mixed=mixed,
            current=state.mission_seq if state is not None and state.mission_seq >= 0 else None,
            time_to_next_s=lambda now_ns: self._time_to_next_s(vehicle, now_ns),
            first_item=lambda: profile.first_flown(
                self._points_passed(route),
                from_ground=from_ground,
                still_on_ground=is_on_ground(fleet.state(vehicle), fleet.home(vehicle)),
            ),
            from_ground=from_ground,
            delegated=self._table.uploader != "own",
            timing=Timing().over(self._lanes[fleet.link(vehicle)].round_trip_s),
        )
        flown = Flown(route, task.items, profile.home_items + int(from_ground))
        self._deliveries[vehicle] = _Delivery(task, fleet.link(vehicle), t_ns, flown)
        self._busy[fleet.link(vehicle)] += 1
        return self._worked(vehicle, task.start(t_ns))

    def _clean(self, vehicle: int, t_ns: int) -> list[Effect]:
        """Hold and clear a vehicle that may hold a mix."""
        profile, home = self._fleet.profile(vehicle), self._home
        assert profile is not None  # its heartbeat was just taken
        self._mixed.discard(vehicle)
        nothing = Waypoint(home.lat_deg, home.lon_deg, self._table.altitude_rel_m, _MAX_RADIUS_M)
        task = MissionTask(
            Mission(0, vehicle, (nothing,)),  # a clearing sends no item
            home,
            self._fleet.encoder(vehicle),
            profile=profile,
            custody=self._custody[vehicle],
            mixed=True,
        )
        delivery = _Delivery(task, self._fleet.link(vehicle), t_ns, None)
        self._deliveries[vehicle] = delivery
        self._busy[delivery.link] += 1
        return self._worked(vehicle, task.clean(t_ns))

    def _supersede(self, vehicle: int, t_ns: int) -> bool:
        """End a transfer under way, silently; return whether there was one."""
        delivery = self._deliveries.get(vehicle)
        if delivery is None:
            return False
        delivery.task.supersede(t_ns)
        self._leave(vehicle)
        return True

    def _leave(self, vehicle: int) -> _Delivery:
        """Take an ended transfer off, and keep what it says of the vehicle."""
        delivery = self._deliveries.pop(vehicle)
        self._busy[delivery.link] -= 1
        result = delivery.task.result
        assert result is not None
        if delivery.task.uploads:
            (self._unselected.discard if result.selected else self._unselected.add)(vehicle)
        if delivery.task.is_mixed:
            self.suspect(vehicle)
        elif result.holds == "equal" and delivery.flown is not None:
            self._flown[vehicle] = delivery.flown
        elif result.holds != "old":
            self._flown.pop(vehicle, None)
        return delivery

    def _worked(self, vehicle: int, frames: list[bytes]) -> list[Effect]:
        delivery = self._deliveries[vehicle]
        task, result = delivery.task, delivery.task.result
        effects: list[Effect] = [*self._fleet.sends(vehicle, frames)]
        handover = task.handover()
        if handover:
            effects.append(Upload(vehicle, task.mission.mission_id, handover))
        if result is None:
            self._fleet.attend(vehicle)
            return effects
        self._leave(vehicle)
        repeated = result.retries / len(task.items)
        self._lanes[delivery.link].ended(delivery.began_t_ns, result.t_ns, task.round_trip_s, repeated)
        is_clearing = delivery.flown is None
        if not is_clearing:
            effects.append(task.report())
        if not result.ok and (result.held or self._custody[vehicle].taken or is_clearing):
            said = "was told to hold" if result.held else "is not ours now"
            said = "holds no mission now" if result.holds == "cleared" else said
            effects.append(Notice(result.t_ns, "alarm", f"agent {vehicle} {said}: {result.detail}", vehicle))
        return effects

    def _points_passed(self, route: Route) -> int:
        state = self._fleet.state(route.vehicle)
        if state is None:
            return 0
        flown_s = (state.t_ns - self._asked_t_ns.get(route.vehicle, 0)) / NS_PER_S
        place, most_m = (state.east_m, state.north_m), state.ground_speed_m_s * flown_s
        return next_point(route.points_m, place, CORRIDOR_M, most_m)

    def _mission(self, route: Route, mission_id: int) -> Mission:
        places = (self._frame.to_geodetic(float(east), float(north)) for east, north in route.points_m)
        table = self._table
        altitude_rel_m = table.altitude_rel_m + route.lane * table.lane_step_m
        waypoints = tuple(
            Waypoint(*place, altitude_rel_m, float(radius_m))
            for place, radius_m in zip(places, self._acceptance_m(route), strict=True)
        )
        return Mission(mission_id, route.vehicle, waypoints, table.loiter_radius_m, table.end)

    def _acceptance_m(self, route: Route) -> FloatArray:
        """How near to each waypoint it counts as reached: soon enough to turn to the next one."""
        state = self._fleet.state(route.vehicle)
        start = route.points_m[:1] if state is None else [(state.east_m, state.north_m)]
        airframe = self._airframe
        wanted = acceptance_m(
            np.concatenate((start, route.points_m)),
            airframe.turn_radius_m,
            airframe.turn_lag_m,
            self._table.accept_radius_m,
        )
        return np.minimum(np.round(wanted, 0), _MAX_RADIUS_M)
