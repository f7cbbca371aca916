"""Where an agent meets a target that moves: the earliest place on the target's way that it reaches in time.

A route to where a target is now ends where it was: the agent chases it, and one that is nearly as fast is
never caught. Instead the agent is sent to where they meet. The target is expected to keep its velocity v, so
it is at p + v t after t seconds; the agent gets there when the shortest way, around obstacles, is flown in
t. The earliest such t is the meeting.

A target's way is looked at every few seconds up to a horizon: those places stand in the cost matrix like
targets of their own, so that one search from each agent gives the ways to all. The meeting lies between the
last place that the agent reaches too late and the first that it reaches in time.

A velocity is only as good as its estimate. It is shrunk towards zero by how uncertain it is, as James &
Stein (1961, positive part) do: v max(0, 1 - 4 tr P / |v|^2) for an estimate with covariance P. Their factor
would be 1 for the least squared error; with 4, what stands still seems to move in 2 % of all scans, not in
37 %, and no agent is sent here and there for it. What has just been born is not led; the lead grows as the
estimate sharpens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.jit import Call, kernel
from gcs.model import FloatArray, Track, read_only
from gcs.planning.map.grid import Grid, Point

STEP_S = 5.0
"""Between two looks along a target's way."""
_DOUBT = 4.0
_LEAST_LEAD_M = 1.0
"""What moves less than this within a step stands still."""


@dataclass(frozen=True, slots=True)
class TargetPrediction:
    """Places on the ways of m targets, one target after another.

    Attributes
    ----------
    places_m : ndarray, shape (k, 2)
    after_s : ndarray, shape (k,)
        When the target is there, from now.
    first : ndarray of int, shape (m + 1,)
        Places of target j are those from first[j] to first[j + 1].
    """

    places_m: FloatArray
    after_s: FloatArray
    first: tuple[int, ...]


def shrunk_velocity(track: Track) -> tuple[float, float]:
    """East and north velocity of a track, shrunk by its uncertainty."""
    speed2 = float(track.mean[2] ** 2 + track.mean[3] ** 2)
    spread2 = float(track.cov[2, 2] + track.cov[3, 3])
    share = max(0.0, 1.0 - _DOUBT * spread2 / speed2) if speed2 > 0.0 else 0.0
    return share * float(track.mean[2]), share * float(track.mean[3])


def outlook(
    grid: Grid, places_m: Sequence[Point], velocities_m_s: Sequence[Point], horizon_s: float
) -> TargetPrediction:
    """Look along the ways of targets, as long as they are on the map."""
    found: list[Point] = []
    after: list[float] = []
    first = [0]
    for (east_m, north_m), (v_east, v_north) in zip(places_m, velocities_m_s, strict=True):
        found.append((east_m, north_m))
        after.append(0.0)
        if np.hypot(v_east, v_north) * STEP_S >= _LEAST_LEAD_M:
            for t_s in np.arange(STEP_S, horizon_s + 1e-6, STEP_S).tolist():
                place = (east_m + v_east * t_s, north_m + v_north * t_s)
                if not grid.contains(place):
                    break
                found.append(place)
                after.append(t_s)
        first.append(len(found))
    return TargetPrediction(np.reshape(found, (-1, 2)), read_only(after), tuple(first))


def meetings(
    lengths_m: FloatArray, view: TargetPrediction, speeds_m_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """When agents meet targets.

    Parameters
    ----------
    lengths_m : ndarray, shape (n, k)
        Ways of n agents to all places of the outlook; inf where there is none.
    speeds_m_s : ndarray, shape (n,)

    Returns
    -------
    arrivals_s, meetings_s : ndarray, shape (n, m)
        How long the agent flies, and where on the target's way they meet: after how many seconds it is there.
        A target that stands still is met where it is; so is one that is not met within the horizon at the
        last place that can be reached: the agent then comes too late, but follows. inf where there is no way.
    """
    late_s = np.ascontiguousarray(lengths_m / speeds_m_s[:, None] - view.after_s)
    arrivals_s, meetings_s = _meetings(late_s, np.array(view.after_s), np.array(view.first))
    return arrivals_s, meetings_s


@kernel
def _meetings(late_s, after_s, first):  # type: ignore[no-untyped-def]
    """Arrivals and meetings of all pairs, by how late (n, k) each agent is at each place."""
    n, m = late_s.shape[0], first.size - 1
    arrivals, met = np.full((n, m), np.inf), np.zeros((n, m))
    for i in range(n):
        for j in range(m):
            last, in_time = -1, -1
            for k in range(first[j], first[j + 1]):
                if np.isfinite(late_s[i, k]):
                    last = k
                    if late_s[i, k] <= 0.0:
                        in_time = k
                        break
            if last < 0:
                continue
            if in_time < 0:
                arrivals[i, j], met[i, j] = after_s[last] + late_s[i, last], after_s[last]
                continue
            meeting = after_s[in_time]
            if in_time > first[j] and np.isfinite(late_s[i, in_time - 1]):
                before_s, late = after_s[in_time - 1], late_s[i, in_time - 1]
                meeting = before_s + late / (late - late_s[i, in_time]) * (meeting - before_s)
            arrivals[i, j], met[i, j] = meeting, meeting
    return arrivals, met


def warm_up_calls() -> list[Call]:
    """One call of the kernel, types as in a plan."""
    return [(_meetings, np.zeros((1, 1)), np.zeros(1), np.arange(2))]
