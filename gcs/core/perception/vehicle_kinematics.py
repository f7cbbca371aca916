"""Speed and turn rate of vehicles from their reports: the motion in which planned routes begin.

A track's velocity lags in turns and has no turn rate. Position and course come from the newest report, the
turn rate from courses a second apart. A report counts while it is fresh and near the track; else the track is
extrapolated along a straight line.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping

from gcs.core.replanning.plan_targets import place_of
from gcs.core.state import Agent
from gcs.geo import wrap_pi
from gcs.model import NS_PER_S, Track, VehicleState
from gcs.planning.forward_simulation import Motion, RemainingMission
from gcs.planning.route_progress import CORRIDOR_M

_MIN_INTERVAL_NS = NS_PER_S * 3 // 4
_MAX_INTERVAL_NS = 3 * NS_PER_S
"""Time between two courses: less is noise, in more a vehicle may turn by 180 degrees."""
_MIN_SPEED_M_S = 3.0
"""Below this ground speed the course is noise."""
_MAX_TURN_RATE_RAD_S = 1.0


class Motions(Mapping[int, Motion]):
    """Motions of vehicles, each computed when it is asked for first; most plans are not made."""

    def __init__(self, vehicles: Iterable[int], motion: Callable[[int], Motion]) -> None:
        self._motion = motion
        self._known: dict[int, Motion | None] = dict.fromkeys(vehicles)

    def __getitem__(self, vehicle: int) -> Motion:
        motion = self._known[vehicle]
        if motion is None:
            motion = self._known[vehicle] = self._motion(vehicle)
        return motion

    def __iter__(self) -> Iterator[int]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)


class VehicleKinematics:
    """Newest report of each vehicle, at most `max_age_s` old, and its turn rate."""

    def __init__(self, agents: Mapping[int, Agent], max_age_s: float) -> None:
        self._agents = agents
        self._max_age_ns = int(max_age_s * NS_PER_S)

    def update(self, states: Iterable[VehicleState]) -> None:
        """Process the newest reports; those of high latency are too coarse."""
        for state in states:
            if state.period_s:
                continue
            motion = self._agents[state.system_id].perception.motion
            motion.state = state
            before_ns, course_rad = motion.course or (-_MAX_INTERVAL_NS, 0.0)
            passed_ns = state.t_ns - before_ns
            if passed_ns < _MIN_INTERVAL_NS:
                continue
            is_known = passed_ns <= _MAX_INTERVAL_NS and state.ground_speed_m_s >= _MIN_SPEED_M_S
            turned_rad = wrap_pi(state.course_rad - course_rad) if is_known else 0.0
            rate = turned_rad * NS_PER_S / passed_ns
            motion.turn_rate_rad_s = rate if abs(rate) <= _MAX_TURN_RATE_RAD_S else 0.0
            motion.course = (state.t_ns, state.course_rad)

    def motions(
        self,
        agents: Mapping[int, Track],
        t_ns: int,
        tracked_t_ns: int,
        ahead: Callable[[int], RemainingMission] = lambda _vehicle: RemainingMission(),
    ) -> Motions:
        """Return the motion of each vehicle at `t_ns`; tracks are as of `tracked_t_ns`."""
        return Motions(agents, lambda v: self._motion(v, agents[v], t_ns, tracked_t_ns, ahead))

    def _motion(
        self,
        vehicle: int,
        track: Track,
        t_ns: int,
        tracked_t_ns: int,
        ahead: Callable[[int], RemainingMission],
    ) -> Motion:
        reported = self._agents[vehicle].perception.motion
        state = reported.state
        if state is None or not self._is_valid(state, track, t_ns):
            return motion_of(track, t_ns - tracked_t_ns)
        return Motion(
            state.east_m,
            state.north_m,
            state.ground_speed_m_s,
            state.course_rad,
            reported.turn_rate_rad_s,
            (t_ns - state.t_ns) / NS_PER_S,
            ahead(vehicle),
        )

    def _is_valid(self, state: VehicleState, track: Track, t_ns: int) -> bool:
        is_fresh = t_ns - state.t_ns <= self._max_age_ns
        off_m = math.dist(place_of(track), (state.east_m, state.north_m))
        return is_fresh and off_m <= CORRIDOR_M and state.ground_speed_m_s >= _MIN_SPEED_M_S


def motion_of(track: Track, age_ns: int = 0) -> Motion:
    """Return the motion of a track, along a straight line."""
    v_east = float(track.mean[2])
    v_north = float(track.mean[3])
    return Motion(
        *place_of(track), math.hypot(v_east, v_north), math.atan2(v_east, v_north), 0.0, age_ns / NS_PER_S
    )
