"""Recovered trajectories: whole paths from association histories, without the gaps of late confirmation.

A filtered estimate shows an object from the scan at which it was believed, and each state as it was known
then. But the track that is believed at last carries its *association history*: which detection it made at
each scan since its birth. Re-running the Kalman filter over that history gives the path from the birth on
(the "recovered" estimator of the Vos' toolbox; Nguyen & Kim, "GLMB tracker with partial smoothing", Sensors
19, 2019), and a Rauch-Tung-Striebel pass (see `smoothing`) the smoothed one.

`Histories` keeps them as a forest: a node is one track after one scan, and points at the track that it came
from. Nodes are counted by who refers to them (tracks that live on, children, labels that were estimated) and
reused when nobody does, so that memory and time per scan follow the tracks that matter, not the length of
the run; only what is part of a path to be returned stays.

Which paths: every label that was in the MAP-cardinality estimate at some scan, with the history that it had
when it was there last. What is known later decides about two ends of it, by the model alone:

- *Death.* A label that is no longer there ends with its last detection: living on undetected for j scans and
  dying then has the weight (p_S (1 - p_D))^j (1 - p_S), greatest for j = 0.
- *Birth.* A path of weight r/(1 - r) x prod(option weights) (1 - p_S), relative to its detections being
  clutter, is dropped when that is below 1: the estimate had taken clutter for an object, and gave it up.
- *Once.* A detection is of one object. When two labels' paths hold the same one (two guesses at one object,
  one later given up), it belongs to the one that is still there or else to that of the greater weight, and
  the other is weighed and re-estimated without it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from gcs.model import FloatArray, Label, Sensor, read_only
from gcs.tracking.sensors import MOST_DETECTION
from gcs.tracking.smoothing import Step, filtered, smoothed
from gcs.tracking.turning import Turns

if TYPE_CHECKING:
    from gcs.tracking.params import Birth

IntArray: TypeAlias = npt.NDArray[np.int64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]

_NONE = -1
_NODE = np.dtype(
    [
        ("references", np.int64),
        ("parent", np.int64),
        ("scan", np.int64),
        ("birth", np.int64),  # which birth of its scan, in a node without parent
        ("meas", np.int64),  # which detection of its scan, negative for none
        ("z_m", np.float64, 2),
        ("logw", np.float64),  # of what the track did, relative to its detection being clutter
    ]
)


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


@dataclass(frozen=True, slots=True)
class _Scan:
    """What every node of a scan shares."""

    t_ns: int
    dt_s: float
    F: FloatArray
    Q: FloatArray
    sensor: Sensor
    births: tuple[Birth, ...]
    log_death: float
    log_survival: float
    log_undetected: float


class Histories:
    """The association histories of a tracker's tracks.

    Parameters
    ----------
    turns : Turns, optional
        How its objects turn, where they do not fly straight.
    """

    def __init__(self, turns: Turns | None = None) -> None:
        self._turns = turns
        self._scans: dict[int, _Scan] = {}
        self._nodes_of: dict[int, int] = {}
        self._scan_count = 0
        self._live: IntArray = np.empty(0, np.int64)
        """Node of each of the tracker's tracks."""
        self._node = np.zeros(256, _NODE)
        self._free: IntArray = np.arange(256)
        """The first `_n_free` of these nodes are not in use."""
        self._n_free = 256
        self._estimated: dict[Label, int] = {}
        self._estimated_now: set[Label] = set()

    @property
    def nodes(self) -> int:
        """How many nodes are in use."""
        return self._node.size - self._n_free

    @property
    def labels(self) -> int:
        """Of how many labels a path is kept."""
        return len(self._estimated)

    def begin(
        self,
        t_ns: int,
        dt_s: float,
        F: FloatArray,
        Q: FloatArray,
        sensor: Sensor,
        births: Sequence[Birth],
        survival: float,
    ) -> None:
        """Begin a scan, before its tracks are known.

        `F`, `Q` (4, 4) move a track straight on by `dt_s` since the scan before, which it survives to this
        one with probability `survival`; `sensor` made the scan. Births need positive definite covariances.
        """
        self._scans[self._scan_count] = _Scan(
            t_ns,
            dt_s,
            F,
            Q,
            sensor,
            tuple(births),
            math.log(max(1.0 - survival, 1e-300)),
            math.log(survival),
            math.log1p(-min(sensor.detection_probability, MOST_DETECTION)),
        )
        self._nodes_of[self._scan_count] = 0

    def extend(self, parent: IntArray, meas: IntArray, logw: FloatArray, z_m: FloatArray) -> None:
        """Replace the tracks by those after the scan.

        Parameters
        ----------
        parent : (n,) array
            The predicted track that each comes from; the scan's births follow the tracks there were.
        meas : (n,) array
            Row of `z_m` that each made, negative for none.
        logw : (n,) array
            Log-weight of that.
        z_m : (m, 2) array
            The scan's detections.
        """
        born = parent - self._live.size
        nodes = self._allocated(parent.size)
        if parent.size:
            made = meas >= 0
            old = np.append(self._live, _NONE)
            ancestor = np.where(born < 0, old[np.minimum(parent, self._live.size)], _NONE)
            new = np.zeros(parent.size, _NODE)
            new["references"], new["parent"], new["scan"] = 1, ancestor, self._scan_count
            new["birth"], new["meas"], new["logw"] = born, meas, logw
            new["z_m"][made] = z_m[meas[made]]
            self._node[nodes] = new
            np.add.at(self._node["references"], ancestor[ancestor != _NONE], 1)
        self._nodes_of[self._scan_count] = parent.size
        released, self._live = self._live, nodes
        self._release(released)

    def end(self, estimate: Mapping[Label, int]) -> None:
        """End a scan: note which labels are in the estimate, and the track that each is."""
        released = []
        for label, track in estimate.items():
            node = int(self._live[track])
            self._node["references"][node] += 1
            before = self._estimated.get(label, _NONE)
            if before != _NONE:
                released.append(before)
            self._estimated[label] = node
        self._estimated_now = set(estimate)
        self._release(np.array(released, np.int64))
        if not self._nodes_of[self._scan_count]:
            self._drop_scan(self._scan_count)
        self._scan_count += 1

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
            self._path(label, chain, made, smooth=smooth, lag_scans=lag_scans)
            for label, (chain, made) in sorted(self._once(chains).items())
        )

    def _chain(self, label: Label) -> IntArray:
        """Nodes of a label's history, birth first."""
        chain, node = [], self._estimated[label]
        while node != _NONE:
            chain.append(node)
            node = int(self._node["parent"][node])
        return np.array(chain[::-1], np.int64)

    def _once(self, chains: dict[Label, IntArray]) -> dict[Label, tuple[IntArray, BoolArray]]:
        """Paths that outweigh clutter by detections of their own; the living and the heavy choose first.

        Returns each with whether it made a detection at each scan.
        """
        weight = {label: self._cut(label, chain, set())[2] for label, chain in chains.items()}
        order = sorted(chains, key=lambda label: (label not in self._estimated_now, -weight[label], label))
        taken: set[tuple[int, int]] = set()
        kept = {}
        for label in order:
            chain, made, logw = self._cut(label, chains[label], taken)
            if label in self._estimated_now or logw > 0.0:
                kept[label] = chain, made
                taken.update(self._detections(chain[made]))
        return kept

    def _detections(self, chain: IntArray) -> list[tuple[int, int]]:
        """Scan and number of the detections that nodes made."""
        nodes = self._node[chain]
        return list(zip(nodes["scan"].tolist(), nodes["meas"].tolist(), strict=True))

    def _cut(
        self, label: Label, chain: IntArray, taken: set[tuple[int, int]]
    ) -> tuple[IntArray, BoolArray, float]:
        """Cut a path to what is its own: without others' detections, and if it ended, up to its last one.

        Returns the nodes, whether each made a detection, and the path's log-weight against clutter.
        """
        shared = np.array([detection in taken for detection in self._detections(chain)], np.bool_)
        made = (self._node["meas"][chain] >= 0) & ~shared
        alive = label in self._estimated_now
        if not alive:
            length = int(np.flatnonzero(made)[-1]) + 1 if made.any() else 0
            if not length:
                return chain[:0], made[:0], -math.inf
            chain, made, shared = chain[:length], made[:length], shared[:length]
        first = self._scans[int(self._node["scan"][chain[0]])]
        probability = first.births[int(self._node["birth"][chain[0]])].probability
        born = min(max(probability, 1e-9), 1.0 - 1e-9)
        logw = self._node["logw"][chain].copy()
        for i in np.flatnonzero(shared):
            scan = self._scans[int(self._node["scan"][chain[i]])]
            logw[i] = scan.log_undetected + (scan.log_survival if i else math.log(born))
        never = math.log1p(-born)
        death = 0.0 if alive else self._scans[int(self._node["scan"][chain[-1]])].log_death
        return chain, made, float(logw.sum()) - never + death

    def _path(
        self, label: Label, chain: IntArray, made: BoolArray, *, smooth: bool, lag_scans: int | None
    ) -> Path:
        scans = [self._scans[int(k)] for k in self._node["scan"][chain]]
        birth = scans[0].births[int(self._node["birth"][chain[0]])]
        z_m = np.where(made[:, None], self._node["z_m"][chain], np.nan)
        steps = [
            Step(scan.dt_s, scan.F, scan.Q, scan.sensor, z if seen else None)
            for scan, z, seen in zip(scans, z_m, made, strict=True)
        ]
        run = filtered(birth.mean, birth.cov, steps, self._turns)
        mean, cov = smoothed(run, lag_scans) if smooth else (run.mean, run.cov)
        return Path(
            label,
            self._node["scan"][chain],
            np.array([scan.t_ns for scan in scans], np.int64),
            read_only(mean[:, :4]),
            read_only(cov[:, :4, :4]),
            read_only(z_m),
            label in self._estimated_now,
        )

    def _allocated(self, n: int) -> IntArray:
        """Take `n` free nodes."""
        if n > self._n_free:
            size = self._node.size
            more = max(size, n)
            self._node = np.concatenate([self._node, np.zeros(more, _NODE)])
            self._free = np.concatenate(
                [
                    self._free[: self._n_free],
                    np.arange(size, size + more),
                    np.empty(size - self._n_free, np.int64),
                ]
            )
            self._n_free += more
        self._n_free -= n
        return self._free[self._n_free : self._n_free + n].copy()

    def _release(self, nodes: IntArray) -> None:
        """Drop one reference to each of the nodes, and free what nobody refers to any more."""
        while nodes.size:
            np.subtract.at(self._node["references"], nodes, 1)
            dead = nodes[self._node["references"][nodes] == 0]
            if not dead.size:
                return
            dead = np.unique(dead)
            self._free[self._n_free : self._n_free + dead.size] = dead
            self._n_free += dead.size
            for k, count in Counter(self._node["scan"][dead].tolist()).items():
                self._nodes_of[k] -= count
                if not self._nodes_of[k] and k != self._scan_count:
                    self._drop_scan(k)
            parents = self._node["parent"][dead]
            nodes = parents[parents != _NONE]

    def _drop_scan(self, k: int) -> None:
        del self._scans[k], self._nodes_of[k]
