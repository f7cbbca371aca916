"""Planning inputs from the current tracks, reports, uploads and statuses."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from gcs.core.operator.records import OperatorState
from gcs.core.perception.fusion import MultiSensorTracker
from gcs.core.perception.vehicle_kinematics import VehicleKinematics
from gcs.core.replanning.inputs import PlanningInputs
from gcs.core.replanning.records import OtherVehicle
from gcs.core.replanning.replanner import Replanner
from gcs.core.state import Agent, at_targets, with_status, without_missions
from gcs.core.tasking.upload_latency import late_s, left_s
from gcs.core.tasking.upload_manager import UploadManager
from gcs.geo import LocalFrame
from gcs.mavlink.autopilots.modes import AUTO, LOITER, RTL
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.on_ground import is_on_ground
from gcs.model import Authority, Label, Track, VehicleState
from gcs.planning.manoeuvres.climb import Climb
from gcs.planning.map.grid import Point

_CIRCLE_M: Final = 60.0
"""Radius of a loiter circle that is not seen yet; default WP_LOITER_RAD of ArduPlane."""
_MAX_CIRCLE_M: Final = 150.0


@dataclass(frozen=True, slots=True)
class PlanningInputBuilder:
    """Collects the inputs of a plan from the stages of the engine."""

    agents: Mapping[int, Agent]
    operator: OperatorState
    frame: LocalFrame
    fleet: Fleet
    trackers: MultiSensorTracker
    kinematics: VehicleKinematics
    tasking: UploadManager
    replanner: Replanner

    def build(self, t_ns: int, picture_t_ns: int) -> PlanningInputs:
        """Return the inputs of a plan at `t_ns`, with tracks as of `picture_t_ns`."""
        tracks = self._tracks()
        untaskable = without_missions(self.agents)
        untaskable |= {
            vehicle: "has touched the ground"
            for vehicle, agent in self.agents.items()
            if agent.flight.phase.is_in_air and agent.flight.grounded_since_t_ns is not None
        }
        picture = self.trackers.agents.picture  # later than that of targets after reports alone
        agents_t_ns = picture_t_ns if picture is None else max(picture_t_ns, picture.scan_t_ns)
        active = with_status(self.agents, "active")
        lost = frozenset(with_status(self.agents, "lost"))
        agents = {v: tracks[v] for v in active if v not in untaskable and v in tracks}
        climbs = self.climbs(agents)
        return PlanningInputs(
            t_ns=t_ns,
            picture_t_ns=picture_t_ns,
            agents=agents,
            motions=self.kinematics.motions(
                agents, t_ns, agents_t_ns, lambda v: self.tasking.forward_simulation(v, t_ns)
            ),
            late_s={vehicle: late_s(self.agents[vehicle].tasking) for vehicle in agents},
            left_s=self._left_s(agents, t_ns),
            heights_msl_m=self._heights_msl_m(agents, climbs),
            climbing_first=frozenset(filter(self._climbs_first, agents)),
            climbs=climbs,
            other_vehicles=self._other_vehicles(agents, lost),
            passed=frozenset(filter(self.tasking.onboard_missions.has_missed, agents)),
            targets=self.open_targets(),
            ignored=frozenset(t for t, s in self.operator.targets.items() if s.is_ignored),
            at_targets=at_targets(self.agents),
            priorities={t: s.priority for t, s in self.operator.targets.items() if s.priority is not None},
            arrived=frozenset(with_status(self.agents, "arrived")),
            lost=lost,
            down=frozenset(with_status(self.agents, "down")),
            unfit=frozenset(
                v
                for v in agents
                if self.agents[v].flight.unfit or self.agents[v].link.high_latency is not None
            ),
            grounded=frozenset(v for v in agents if self.is_on_ground(v)),
            doubtful=frozenset(v for v in agents if self.agents[v].tasking.rejections.count),
            ranges=self._ranges(agents),
            untaskable=untaskable,
        )

    def _ranges(self, vehicles: Iterable[int]) -> dict[int, tuple[Point, float]]:
        """Return home and range of the vehicles whose battery limits them."""
        found = {}
        for vehicle in vehicles:
            home = self.fleet.home(vehicle)
            state = self.fleet.state(vehicle)
            endurance_s = self.agents[vehicle].flight.endurance_s
            if home is not None and state is not None and endurance_s is not None:
                home_m = self.frame.to_local(home.lat_deg, home.lon_deg)
                found[vehicle] = (home_m, endurance_s * state.ground_speed_m_s)
        return found

    def _heights_msl_m(self, vehicles: Iterable[int], climbs: Mapping[int, Climb]) -> dict[int, float]:
        """Return the heights of vehicles, at the ends of the climbs of those that have one."""
        found = {}
        for vehicle in vehicles:
            state = self.fleet.state(vehicle)
            home = self.fleet.home(vehicle)
            if vehicle in climbs and home is not None:
                found[vehicle] = home.alt_msl_m + climbs[vehicle].altitude_rel_m
            elif state is not None:
                found[vehicle] = state.alt_msl_m
        return found

    def _climbs_first(self, vehicle: int) -> bool:
        """Return True if a vehicle would climb in a circle to the first point of a mission."""
        profile = self.fleet.profile(vehicle)
        state = self.fleet.state(vehicle)
        return profile is not None and profile.climbs_first and state is not None and state.mode != AUTO

    def is_on_ground(self, vehicle: int) -> bool:
        """Return True if a vehicle is on the ground."""
        return is_on_ground(self.fleet.state(vehicle), self.fleet.home(vehicle))

    def _tracks(self) -> dict[int, Track]:
        """Return the confirmed track of each vehicle; after a break, the one near a planned vehicle."""
        confirmation = self.trackers.agents.confirmation
        tracks = dict[int, Track]()
        for vehicle, agent in self.agents.items():
            label = agent.perception.association.label
            near = agent.perception.association.near
            if label is not None and label in confirmation.tracks:
                tracks[vehicle] = confirmation.tracks[label]
            elif near is not None and agent.routes.is_planned:
                tracks[vehicle] = confirmation.existing[near]
        return tracks

    def open_targets(self) -> dict[Label, Track]:
        """Return the confirmed targets that need more agents, and are not ignored."""
        arrived = at_targets(self.agents)
        needed = self.replanner.plan_targets.needed
        return {
            label: track
            for label, track in self.trackers.targets.confirmation.tracks.items()
            if arrived[label] < needed(label) and not self.operator.is_ignored(label)
        }

    def climbs(self, vehicles: Iterable[int]) -> dict[int, Climb]:
        """Return the climbs that vehicles have before their routes."""
        found = {v: self.tasking.climb(v, self.replanner.layers.of(v)) for v in vehicles}
        return {vehicle: climb for vehicle, climb in found.items() if climb is not None}

    def _other_vehicles(self, planned: Container[int], lost: Container[int]) -> tuple[OtherVehicle, ...]:
        """Return the vehicles in the air that are not planned for now, and fly no mission of ours."""
        found = []
        for state in self.fleet.states():
            vehicle = state.system_id
            home = self.fleet.home(vehicle)
            if vehicle in planned or vehicle in lost or is_on_ground(state, home):
                continue
            is_ours = self.agents[vehicle].control.authority is Authority.OURS
            if is_ours and state.mode == AUTO:  # it circles in its layer at the end of its route
                continue
            position_m = to_m = (state.east_m, state.north_m)
            if state.mode == RTL and home is not None:
                to_m = self.frame.to_local(home.lat_deg, home.lon_deg)
            radius_m = _CIRCLE_M
            if state.mode == LOITER:
                position_m, radius_m = _circle(state, self.agents[vehicle].separation.rate_rad_s)
                to_m = position_m
            height_m = self.replanner.layers.present_height_m(state, self.fleet.height_m(state))
            stacked = self.agents[vehicle].routes.stacked
            if stacked is not None and state.mode == AUTO:
                to_m = (float(stacked.flown_m[-1, 0]), float(stacked.flown_m[-1, 1]))
                height_m = self.replanner.layers.end_height_m(stacked)
            found.append(OtherVehicle(vehicle, position_m, to_m, height_m, radius_m))
        return tuple(found)

    def _left_s(self, vehicles: Iterable[int], t_ns: int) -> dict[int, float]:
        """Return the remaining time of each upload in progress."""
        elapsed = {vehicle: self.tasking.state.elapsed_s(vehicle, t_ns) for vehicle in vehicles}
        return {v: left_s(self.agents[v].tasking, for_s) for v, for_s in elapsed.items() if for_s is not None}


def _circle(state: VehicleState, rate_rad_s: float) -> tuple[Point, float]:
    """Return centre and radius of the circle that a vehicle flies; wide round one that has just begun it."""
    place_m = (state.east_m, state.north_m)
    radius_m = state.ground_speed_m_s / max(abs(rate_rad_s), 1e-3)
    if radius_m > _MAX_CIRCLE_M:
        return place_m, 2.0 * _CIRCLE_M
    side_m = math.copysign(radius_m, rate_rad_s)
    east_m, north_m = place_m
    return (
        (east_m + side_m * math.cos(state.course_rad), north_m - side_m * math.sin(state.course_rad)),
        radius_m,
    )
