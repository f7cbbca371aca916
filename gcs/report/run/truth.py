"""Ground truth of a simulated run over time. The evaluator knows it; central command does not."""

from __future__ import annotations

import bisect
from collections.abc import Container

import numpy as np

from gcs.model import FloatArray, Kind, Truth, TruthObject, read_only


class GroundTruth:
    """Ground truth at each scan, added in any order, and interpolated between scans."""

    def __init__(self) -> None:
        self._objects: dict[int, tuple[TruthObject, ...]] = {}
        self._times_ns: list[int] = []

    def add(self, truth: Truth) -> None:
        """Add the ground truth at one scan."""
        if truth.t_ns not in self._objects:
            bisect.insort(self._times_ns, truth.t_ns)
        self._objects[truth.t_ns] = truth.objects

    @property
    def times_ns(self) -> list[int]:
        """Times of the scans with ground truth, in order."""
        return self._times_ns

    def at(self, t_ns: int) -> tuple[TruthObject, ...]:
        """Return the ground truth at any time: positions interpolated, life as at the scan before."""
        times = self._times_ns
        if not times:
            return ()
        after = bisect.bisect_right(times, t_ns)
        if after == 0 or after == len(times):
            return self._objects[times[min(after, len(times) - 1)]]
        part = (t_ns - times[after - 1]) / (times[after] - times[after - 1])
        later = {(thing.kind, thing.id): thing for thing in self._objects[times[after]]}
        return tuple(
            _between(thing, later.get((thing.kind, thing.id), thing), part)
            for thing in self._objects[times[after - 1]]
        )

    def positions(self, t_ns: int, kind: Kind) -> FloatArray:
        """Return the (n, 2) positions of living objects at the time of a scan."""
        living = [
            (thing.east_m, thing.north_m)
            for thing in self._objects[t_ns]
            if thing.kind == kind and thing.alive
        ]
        return read_only(np.reshape(living, (-1, 2)))

    def losses(self, agents: Container[int]) -> dict[int, int]:
        """Return the time of the first scan from which on each lost agent is missing."""
        lost: dict[int, int] = {}
        for t_ns in self._times_ns:
            for thing in self._objects[t_ns]:
                if thing.kind == "agents" and thing.id in agents:
                    if thing.alive:
                        lost.pop(thing.id, None)
                    else:
                        lost.setdefault(thing.id, t_ns)
        return lost

    def targets(self) -> set[int]:
        """Return the targets that ever existed."""
        everything = (thing for objects in self._objects.values() for thing in objects)
        return {thing.id for thing in everything if thing.kind == "targets" and thing.alive}


def _between(before: TruthObject, after: TruthObject, part: float) -> TruthObject:
    east_m = before.east_m + part * (after.east_m - before.east_m)
    north_m = before.north_m + part * (after.north_m - before.north_m)
    alt_msl_m = before.alt_msl_m
    if alt_msl_m is not None and after.alt_msl_m is not None:
        alt_msl_m += part * (after.alt_msl_m - alt_msl_m)
    return TruthObject(before.kind, before.id, east_m, north_m, before.alive, before.down, alt_msl_m)
