"""Ground-truth trackers: an upper bound for the real trackers.

A mission flown with them differs in the tracks only; association, planning, tasking and agent status are the
same. ``gcs montecarlo`` flies both and compares the mission times.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gcs.config import Config
from gcs.core.perception.terrain_sight import TerrainSight
from gcs.model import (
    NS_PER_S,
    Kind,
    Label,
    LaggedPicture,
    Notice,
    Picture,
    Scan,
    Track,
    Truth,
    VehicleState,
    read_only,
)

_COV = read_only(np.diag([0.01, 0.01, 0.01, 0.01]))


class GroundTruthConfirmation:
    """Confirmation of tracks by the ground truth, without delay."""

    def __init__(self) -> None:
        self.tracks: Mapping[Label, Track] = {}

    @property
    def existing(self) -> Mapping[Label, Track]:
        """Tracks of living objects: all."""
        return self.tracks

    def is_lost(self, label: Label) -> bool:
        """Return True if an object is not alive."""
        return label not in self.tracks


class GroundTruthClass:
    """Tracks of one kind from the truth. A label is (0, id)."""

    def __init__(self, kind: Kind) -> None:
        self._kind: Kind = kind
        self._before: dict[Label, tuple[int, float, float]] = {}
        self.confirmation = GroundTruthConfirmation()
        self.picture: Picture | None = None

    def update(self, truth: Truth, t_ns: int) -> Picture:
        """Return the tracks at a scan; velocities are differences to the scan before."""
        places = {
            (0, thing.id): (truth.t_ns, thing.east_m, thing.north_m)
            for thing in truth.objects
            if thing.kind == self._kind and thing.alive
        }
        ordered = sorted(places.items())
        self.confirmation.tracks = {label: self._track(label, place) for label, place in ordered}
        self._before = places
        tracks = tuple(self.confirmation.tracks.values())
        cardinality = np.zeros(len(tracks) + 1)
        cardinality[-1] = 1.0
        self.picture = Picture(t_ns, truth.t_ns, self._kind, tracks, read_only(cardinality))
        return self.picture

    def _track(self, label: Label, place: tuple[int, float, float]) -> Track:
        t_ns, east_m, north_m = place
        then_ns, then_east_m, then_north_m = self._before.get(label, place)
        dt_s = (t_ns - then_ns) / NS_PER_S or 1.0
        velocity = ((east_m - then_east_m) / dt_s, (north_m - then_north_m) / dt_s)
        return Track(label, read_only([east_m, north_m, *velocity]), _COV, 1.0, estimated=True)


class GroundTruthTrackers:
    """Replaces `gcs.core.perception.fusion.MultiSensorTracker`; `truth` is set before each scan."""

    def __init__(self, config: Config) -> None:
        self.truth: Truth | None = None
        self._sight = TerrainSight(config)
        self.agents = GroundTruthClass("agents")
        self.targets = GroundTruthClass("targets")

    def refusal(self, _scan: Scan) -> str:
        """Refuse no scan."""
        return ""

    def scan_of_agents(self, scan: Scan) -> Scan:
        """Return a scan as agents' detections, as the service does."""
        return self._sight.scan_of(scan, "agents")

    def is_report_epoch_due(self, _t_ns: int) -> bool:
        """Use no position reports."""
        return False

    def notices(self, _scan: Scan) -> list[Notice]:
        """Return no sanity warnings."""
        return []

    def lagged_pictures(self, _t_ns: int) -> list[LaggedPicture]:
        """Return none: the truth is not late."""
        return []

    def scan(self, scan: Scan, _states: Sequence[VehicleState]) -> tuple[Picture, Picture]:
        """Return the true pictures of agents and targets."""
        assert self.truth is not None
        return self.agents.update(self.truth, scan.t_ns), self.targets.update(self.truth, scan.t_ns)
