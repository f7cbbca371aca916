"""Trajectory recovery: whole paths from association histories, without the delay of confirmation.

A filtered estimate shows an object from the scan of its confirmation on. The confirmed track carries its
association history: its detection at each scan since birth. A Kalman filter over that history gives the path
from birth on (the "recovered" estimator of the Vos' toolbox; Nguyen & Kim, Sensors 19, 2019). A
Rauch-Tung-Striebel pass gives the smoothed path (`rts`).

`Histories` keeps them as a tree (`history_tree`). Memory and time per scan follow the current tracks, not the
length of the run.

A path is returned for every label that was in the MAP-cardinality estimate at some scan, with its last
estimated history. Later scans decide three questions:

- *Death.* The path of a label that no longer exists ends with its last detection: j undetected scans before
  death have the weight (p_S (1 - p_D))^j (1 - p_S), greatest at j = 0. An object does not die between scans
  of one epoch, so p_S is that of the time to the next epoch.
- *Birth.* A path of weight r/(1 - r) x prod(option weights) (1 - p_S), relative to clutter, is dropped if
  the weight is below 1: the estimate took clutter for an object.
- *Shared detections.* A detection belongs to one object. If two paths hold it, the existing label gets it, or
  else that of greater weight. The other path is weighed and filtered again without it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from gcs.jit import Call
from gcs.model import BoolArray, FloatArray, IntArray, Label, Sensor, read_only
from gcs.tracking.glmb.kalman import Interval
from gcs.tracking.glmb.recursion import Posterior, UpdateResult
from gcs.tracking.models import constant_velocity
from gcs.tracking.models.coordinated_turn import TurnModel
from gcs.tracking.models.sensor_geometry import MAX_DETECTION_PROBABILITY
from gcs.tracking.trajectories import rts
from gcs.tracking.trajectories.history_tree import NO_NODE, HistoryTree, extend_tree, release_nodes
from gcs.tracking.trajectories.rts import FilterStep, run_filter, smooth_states

if TYPE_CHECKING:
    from gcs.tracking.glmb.params import Birth
    from gcs.tracking.state_space.models import MeasurementModel

_MIN_REMEMBERED_SCANS = 64
"""Scans that are kept before the unused ones are removed."""


@dataclass(frozen=True, slots=True)
class Path:
    """The path of one label, one row per scan from its birth to its end."""

    label: Label
    scan: IntArray
    """(n,) scan numbers of the tracker, consecutive."""
    t_ns: IntArray
    """(n,) times of measurement."""
    mean: FloatArray
    """(n, 4) east_m, north_m, v_east_m_s, v_north_m_s."""
    cov: FloatArray
    """(n, 4, 4)."""
    z_m: FloatArray
    """(n, 2) detection of the object in each scan, NaN for none."""
    alive: bool
    """True if the label is in the estimate of the last scan."""


@dataclass(slots=True)
class _Scan:
    """What all nodes of a scan share."""

    t_ns: int
    dt_s: float
    Q: FloatArray
    sensor: Sensor | MeasurementModel
    births: tuple[Birth, ...]
    survival: float
    log_death: float = 0.0
    """Log-probability of death before the next epoch; 0 until there is one."""

    @property
    def log_undetected(self) -> float:
        return math.log1p(-min(self.sensor.detection_probability, MAX_DETECTION_PROBABILITY))


class Histories:
    """The association histories of a tracker.

    Parameters
    ----------
    turns : TurnModel, optional
        Turn model of the objects; without it they fly straight.
    """

    def __init__(self, turns: TurnModel | None = None) -> None:
        self._turns = turns
        self._scans: dict[int, _Scan] = {}
        self._epoch: list[_Scan] = []
        """The last scans, measured at one time."""
        self._max_scans = _MIN_REMEMBERED_SCANS
        self._tree = HistoryTree.allocate(256)
        self._nodes: IntArray = np.empty(0, np.int64)
        """Node of each of the tracker's tracks."""
        self._estimated: dict[Label, int] = {}
        self._estimated_now: set[Label] = set()

    @property
    def nodes(self) -> int:
        """Number of nodes in use."""
        return int(self._tree.parent.size - self._tree.n_free[0])

    @property
    def labels(self) -> int:
        """Number of labels with a path."""
        return len(self._estimated)

    def add_scan(
        self,
        t_ns: int,
        sensor: Sensor | MeasurementModel,
        births: tuple[Birth, ...],
        survival: float,
        interval: Interval,
        result: UpdateResult,
    ) -> None:
        """Add a processed scan: replace the tracks and record the estimated labels.

        `sensor` measured at `t_ns`, `survival` is the probability of survival to it, and `births` are its
        birth components, with positive definite covariances.
        """
        k = interval.scan
        if interval.dt_s > 0.0:
            for scan in self._epoch:
                scan.log_death = math.log(max(1.0 - survival, 1e-300))
            self._epoch.clear()
        self._scans[k] = _Scan(t_ns, interval.dt_s, interval.Q, sensor, births, survival)
        self._epoch.append(self._scans[k])
        if result.parent.size > self._tree.n_free[0]:
            self._tree = self._tree.larger(result.parent.size)
        self._nodes, labels, nodes = extend_tree(
            self._tree,
            self._nodes,
            k,
            result.posterior,
            result.parent,
            result.meas,
            result.logw,
            result.position_m,
        )
        now = dict(zip(map(tuple, labels.tolist()), nodes.tolist(), strict=True))
        released = [self._estimated[label] for label in now if label in self._estimated]
        self._estimated.update(now)
        self._estimated_now = set(now)
        release_nodes(self._tree, np.array(released, np.int64))
        if len(self._scans) > self._max_scans:
            self._forget_scans()

    def paths(self, *, smooth: bool = False, since_scan: int = 0) -> tuple[Path, ...]:
        """Return the path of every label ever estimated, ordered by label, from the scans so far.

        Parameters
        ----------
        smooth : bool
            True to use later detections for each state.
        since_scan : int
            Paths that were last estimated before this scan are left out.
        """
        chains = {
            label: self._chain(label)
            for label, node in self._estimated.items()
            if self._tree.scan[node] >= since_scan
        }
        return self._paths(sorted(self._resolve_shared_detections(chains).items()), smooth=smooth)

    def _chain(self, label: Label) -> IntArray:
        """Return the nodes of a label, birth first."""
        chain = []
        node = self._estimated[label]
        while node != NO_NODE:
            chain.append(node)
            node = int(self._tree.parent[node])
        return np.array(chain[::-1], np.int64)

    def _resolve_shared_detections(
        self, chains: dict[Label, IntArray]
    ) -> dict[Label, tuple[IntArray, BoolArray]]:
        """Return the paths that outweigh clutter, with True at each scan with a detection.

        Existing labels choose first, then those of greater weight.
        """
        weight = {label: self._trim(label, chain, set())[2] for label, chain in chains.items()}
        order = sorted(chains, key=lambda label: (label not in self._estimated_now, -weight[label], label))
        result: set[tuple[int, int]] = set()
        kept = {}
        for label in order:
            chain, is_detected, logw = self._trim(label, chains[label], result)
            if label in self._estimated_now or logw > 0.0:
                kept[label] = chain, is_detected
                result.update(self._detections(chain[is_detected]))
        return kept

    def _detections(self, chain: IntArray) -> list[tuple[int, int]]:
        """Return scan and index of the detection of each node."""
        tree = self._tree
        return list(zip(tree.scan[chain].tolist(), tree.meas[chain].tolist(), strict=True))

    def _trim(
        self, label: Label, chain: IntArray, result: set[tuple[int, int]]
    ) -> tuple[IntArray, BoolArray, float]:
        """Cut a path to its own detections and, if the label ended, to its last one.

        Returns the nodes, True for each one with a detection, and the log-weight against clutter.
        """
        shared = np.array([detection in result for detection in self._detections(chain)], np.bool_)
        is_detected = (self._tree.meas[chain] >= 0) & ~shared
        alive = label in self._estimated_now
        if not alive:
            length = int(np.flatnonzero(is_detected)[-1]) + 1 if is_detected.any() else 0
            if not length:
                return chain[:0], is_detected[:0], -math.inf
            chain = chain[:length]
            is_detected = is_detected[:length]
            shared = shared[:length]
        first = self._scans[int(self._tree.scan[chain[0]])]
        probability = first.births[int(self._tree.birth[chain[0]])].probability
        born = min(max(probability, 1e-9), 1.0 - 1e-9)
        logw = self._tree.logw[chain].copy()
        for i in np.flatnonzero(shared):
            scan = self._scans[int(self._tree.scan[chain[i]])]
            logw[i] = scan.log_undetected + math.log(scan.survival if i else born)
        never = math.log1p(-born)
        death = 0.0 if alive else self._scans[int(self._tree.scan[chain[-1]])].log_death
        return chain, is_detected, float(logw.sum()) - never + death

    def _paths(
        self, chains: Iterable[tuple[Label, tuple[IntArray, BoolArray]]], *, smooth: bool
    ) -> tuple[Path, ...]:
        return tuple(self._path(label, *chain, smooth=smooth) for label, chain in chains)

    def _path(self, label: Label, chain: IntArray, is_detected: BoolArray, *, smooth: bool) -> Path:
        scans = [self._scans[int(k)] for k in self._tree.scan[chain]]
        birth = scans[0].births[int(self._tree.birth[chain[0]])]
        z_m = np.where(is_detected[:, None], self._tree.z_m[chain], np.nan)
        steps = [
            FilterStep(
                scan.dt_s,
                constant_velocity.transition(scan.dt_s),
                scan.Q,
                cast(Sensor, scan.sensor),
                z if detected else None,
            )
            for scan, z, detected in zip(scans, z_m, is_detected, strict=True)
        ]
        run = run_filter(birth.mean, birth.cov, steps, self._turns)
        mean, cov = smooth_states(run) if smooth else (run.mean, run.cov)
        return Path(
            label,
            self._tree.scan[chain],
            np.array([scan.t_ns for scan in scans], np.int64),
            read_only(mean[:, :4]),
            read_only(cov[:, :4, :4]),
            read_only(z_m),
            label in self._estimated_now,
        )

    def _forget_scans(self) -> None:
        """Remove scans without nodes; called when their number has doubled."""
        needed = set(self._tree.scan[self._tree.references > 0].tolist())
        self._scans = {k: scan for k, scan in self._scans.items() if k in needed}
        self._max_scans = max(_MIN_REMEMBERED_SCANS, 2 * len(self._scans))


def warm_up_calls() -> list[Call]:
    """Return one call of every kernel, with the types of a tracker."""
    none = np.empty(0, np.int64)
    tree = HistoryTree.allocate(1)
    return [
        (extend_tree, tree, none, 0, Posterior.empty(), none, none, np.empty(0), np.empty((0, 2))),
        (release_nodes, tree, none),
        *rts.warm_up_calls(),
    ]
