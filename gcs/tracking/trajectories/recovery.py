"""Recovered trajectories: whole paths from association histories, without the gaps of late confirmation.

A filtered estimate shows an object from the scan at which it was believed, and each state as it was known
then. But the track that is believed at last carries its *association history*: which detection it made at
each scan since its birth. Re-running the Kalman filter over that history gives the path from the birth on
(the "recovered" estimator of the Vos' toolbox; Nguyen & Kim, "GLMB tracker with partial smoothing", Sensors
19, 2019), and a Rauch-Tung-Striebel pass (see `smoothing`) the smoothed one.

`Histories` keeps them as a forest (see `forest`): memory and time per scan follow the tracks that matter, not
the length of the run; only what is part of a path to be returned stays.

Which paths: every label that was in the MAP-cardinality estimate at some scan, with the history that it had
when it was there last. What is known later decides about two ends of it, by the model alone:

- *Death.* A label that is no longer there ends with its last detection: living on undetected for j scans and
  dying then has the weight (p_S (1 - p_D))^j (1 - p_S), greatest for j = 0. Nobody dies between the scans of
  several sensors at one moment: p_S is that of the time to the next moment.
- *Birth.* A path of weight r/(1 - r) x prod(option weights) (1 - p_S), relative to its detections being
  clutter, is dropped when that is below 1: the estimate had taken clutter for an object, and gave it up.
- *Once.* A detection is of one object. When two labels' paths hold the same one (two guesses at one object,
  one later given up), it belongs to the one that is still there or else to that of the greater weight, and
  the other is weighed and re-estimated without it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from gcs.jit import Call
from gcs.model import FloatArray, Label, Sensor, read_only
from gcs.tracking.glmb.recursion import Interval, Posterior, UpdateResult
from gcs.tracking.models import constant_velocity
from gcs.tracking.models.coordinated_turn import TurnModel
from gcs.tracking.models.sensors import MAX_DETECTION_PROBABILITY
from gcs.tracking.trajectories import rts
from gcs.tracking.trajectories.history_tree import NO_NODE, HistoryTree, extend_tree, release_nodes
from gcs.tracking.trajectories.rts import FilterStep, run_filter, smooth_states

if TYPE_CHECKING:
    from gcs.tracking.glmb.params import Birth

IntArray: TypeAlias = npt.NDArray[np.int64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]

_MIN_REMEMBERED_SCANS = 64
"""Scans that are remembered before it is asked which of them are still needed."""


@dataclass(frozen=True, slots=True)
class Path:
    """The whole path of one label, one row per scan from its birth to its end."""

    label: Label
    scan: IntArray
    """(n,) which of the tracker's scans, counted from 0, without gaps."""
    t_ns: IntArray
    """(n,) when these were measured."""
    mean: FloatArray
    """(n, 4) east_m, north_m, v_east_m_s, v_north_m_s."""
    cov: FloatArray
    """(n, 4, 4)."""
    z_m: FloatArray
    """(n, 2) the detection that the object made in the scan, NaN where none."""
    alive: bool
    """Whether the label is in the last scan's estimate."""


@dataclass(slots=True)
class _Scan:
    """What every node of a scan shares."""

    t_ns: int
    dt_s: float
    Q: FloatArray
    sensor: Sensor
    births: tuple[Birth, ...]
    survival: float
    log_death: float = 0.0
    """Of not surviving to the next moment at which anything was measured; 0 until there is one."""

    @property
    def log_undetected(self) -> float:
        return math.log1p(-min(self.sensor.detection_probability, MAX_DETECTION_PROBABILITY))


class Histories:
    """The association histories of a tracker's tracks.

    Parameters
    ----------
    turns : Turns, optional
        How its objects turn, where they do not fly straight.
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
        """How many nodes are in use."""
        return int(self._tree.parent.size - self._tree.n_free[0])

    @property
    def labels(self) -> int:
        """Of how many labels a path is kept."""
        return len(self._estimated)

    def add_scan(
        self,
        t_ns: int,
        sensor: Sensor,
        births: tuple[Birth, ...],
        survival: float,
        interval: Interval,
        result: UpdateResult,
    ) -> None:
        """Take a scan that was taken in: replace the tracks by those after it, and note who is there.

        `sensor` made it at `t_ns`, objects survived to it with probability `survival`, and those born by it
        are `births`, which need positive definite covariances.
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

    def paths(self, *, smooth: bool = False, lag_scans: int | None = None) -> tuple[Path, ...]:
        """Return the path of every label ever estimated, ordered by label.

        Parameters
        ----------
        smooth : bool
            Whether each state knows the detections that came later; else only those up to it.
        lag_scans : int, optional
            How many later scans a smoothed state knows; all of them without it.
        """
        chains = {label: self._chain(label) for label in self._estimated}
        return tuple(
            self._path(label, chain, is_detected, smooth=smooth, lag_scans=lag_scans)
            for label, (chain, is_detected) in sorted(self._resolve_shared_detections(chains).items())
        )

    def _chain(self, label: Label) -> IntArray:
        """Nodes of a label's history, birth first."""
        chain, node = [], self._estimated[label]
        while node != NO_NODE:
            chain.append(node)
            node = int(self._tree.parent[node])
        return np.array(chain[::-1], np.int64)

    def _resolve_shared_detections(
        self, chains: dict[Label, IntArray]
    ) -> dict[Label, tuple[IntArray, BoolArray]]:
        """Paths that outweigh clutter by detections of their own; the living and the heavy choose first.

        Returns each with whether it made a detection at each scan.
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
        """Scan and number of the detections that nodes made."""
        tree = self._tree
        return list(zip(tree.scan[chain].tolist(), tree.meas[chain].tolist(), strict=True))

    def _trim(
        self, label: Label, chain: IntArray, result: set[tuple[int, int]]
    ) -> tuple[IntArray, BoolArray, float]:
        """Cut a path to what is its own: without others' detections, and if it ended, up to its last one.

        Returns the nodes, whether each made a detection, and the path's log-weight against clutter.
        """
        shared = np.array([detection in result for detection in self._detections(chain)], np.bool_)
        is_detected = (self._tree.meas[chain] >= 0) & ~shared
        alive = label in self._estimated_now
        if not alive:
            length = int(np.flatnonzero(is_detected)[-1]) + 1 if is_detected.any() else 0
            if not length:
                return chain[:0], is_detected[:0], -math.inf
            chain, is_detected, shared = chain[:length], is_detected[:length], shared[:length]
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

    def _path(
        self, label: Label, chain: IntArray, is_detected: BoolArray, *, smooth: bool, lag_scans: int | None
    ) -> Path:
        scans = [self._scans[int(k)] for k in self._tree.scan[chain]]
        birth = scans[0].births[int(self._tree.birth[chain[0]])]
        z_m = np.where(is_detected[:, None], self._tree.z_m[chain], np.nan)
        steps = [
            FilterStep(
                scan.dt_s,
                constant_velocity.transition(scan.dt_s),
                scan.Q,
                scan.sensor,
                z if detected else None,
            )
            for scan, z, detected in zip(scans, z_m, is_detected, strict=True)
        ]
        run = run_filter(birth.mean, birth.cov, steps, self._turns)
        mean, cov = smooth_states(run, lag_scans) if smooth else (run.mean, run.cov)
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
        """Forget what no node is of; asked when twice as many are remembered, so that it costs little."""
        needed = set(self._tree.scan[self._tree.references > 0].tolist())
        self._scans = {k: scan for k, scan in self._scans.items() if k in needed}
        self._max_scans = max(_MIN_REMEMBERED_SCANS, 2 * len(self._scans))


def warm_up_calls() -> list[Call]:
    """One call of every kernel, types as in a tracker."""
    none, tree = np.empty(0, np.int64), HistoryTree.allocate(1)
    return [
        (extend_tree, tree, none, 0, Posterior.empty(), none, none, np.empty(0), np.empty((0, 2))),
        (release_nodes, tree, none),
        *rts.warm_up_calls(),
    ]
