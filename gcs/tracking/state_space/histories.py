"""Trajectory recovery with a user's models: the paths of `trajectories.recovery`, filtered by those models.

The motion mode of each scan is part of an association history. So a path is filtered and smoothed with known
modes. All paths are filtered at once, scan by scan.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.model import BoolArray, FloatArray, IntArray, Label, Sensor, read_only
from gcs.tracking.glmb.kalman import Interval
from gcs.tracking.glmb.recursion import DetectionSummary, UpdateResult
from gcs.tracking.state_space.linearisation import wrap
from gcs.tracking.state_space.models import MeasurementModel, SwitchingMotion
from gcs.tracking.state_space.recursion import StepResult, predict_states, update_states
from gcs.tracking.state_space.sensors import ScanModel
from gcs.tracking.trajectories.recovery import Histories, Path
from gcs.tracking.trajectories.rts import FilterResult, smooth_states

if TYPE_CHECKING:
    from gcs.tracking.glmb.params import Birth


class _Chain(NamedTuple):
    """A path to filter; n scans."""

    label: Label
    nodes: IntArray
    scan: IntArray
    mode: IntArray
    meas: IntArray
    """(n,) detection, or negative."""
    run: FilterResult
    """To be filled."""


class StateSpaceHistories(Histories):
    """The association histories of a tracker with a user's models."""

    def __init__(self, motion: SwitchingMotion) -> None:
        super().__init__()
        self._motion = motion
        self._models: dict[int, ScanModel] = {}
        """By number of scan."""

    def add(
        self,
        t_ns: int,
        sensor: Sensor | MeasurementModel,
        births: tuple[Birth, ...],
        survival: float,
        interval: Interval,
        model: ScanModel,
        result: StepResult,
    ) -> None:
        """Add a processed scan (see `Histories.add_scan`)."""
        n_modes = len(self._motion.models)
        # A node has one number for its detection and its mode; the tree asks for its sign only.
        coded = np.where(result.meas >= 0, result.meas * n_modes + result.mode, -1 - result.mode)
        rows = np.zeros((model.z.shape[0] * n_modes, 2))
        self._models[interval.scan] = model
        summary = DetectionSummary(result.explained, 0.0, 0.0)
        self.add_scan(
            t_ns,
            sensor,
            births,
            survival,
            interval,
            UpdateResult(result.posterior, summary, 0, result.parent, coded, result.logw, rows),
        )

    def _detections(self, chain: IntArray) -> list[tuple[int, int]]:
        tree = self._tree
        meas = tree.meas[chain] // len(self._motion.models)
        return list(zip(tree.scan[chain].tolist(), meas.tolist(), strict=True))

    def _paths(
        self, chains: Iterable[tuple[Label, tuple[IntArray, BoolArray]]], *, smooth: bool
    ) -> tuple[Path, ...]:
        prepared = [self._prepare(label, nodes, detected) for label, (nodes, detected) in chains]
        self._filter(prepared)
        return tuple(self._finished(chain, smooth=smooth) for chain in prepared)

    def _prepare(self, label: Label, nodes: IntArray, detected: BoolArray) -> _Chain:
        coded = self._tree.meas[nodes]
        n_modes = len(self._motion.models)
        mode = np.where(coded >= 0, coded % n_modes, -1 - coded)
        n = nodes.size
        d = len(self._motion.names)
        run = FilterResult(
            np.empty((n, d)),
            np.empty((n, d, d)),
            np.empty((n, d)),
            np.empty((n, d, d)),
            np.empty((n - 1, d, d)),
        )
        return _Chain(
            label, nodes, self._tree.scan[nodes], mode, np.where(detected, coded // n_modes, -1), run
        )

    def _filter(self, chains: list[_Chain]) -> None:
        """Fill the runs of all chains, scan by scan."""
        at: dict[int, list[tuple[_Chain, int]]] = {}
        for chain in chains:
            for i, k in enumerate(chain.scan.tolist()):
                at.setdefault(k, []).append((chain, i))
        for k in sorted(at):
            self._predict(k, at[k])
            self._update(k, [(chain, i) for chain, i in at[k] if chain.meas[i] >= 0])

    def _predict(self, k: int, active: list[tuple[_Chain, int]]) -> None:
        scan = self._scans[k]
        by_mode: dict[int, list[tuple[_Chain, int]]] = {}
        for chain, i in active:
            if i > 0 and scan.dt_s > 0.0:
                by_mode.setdefault(int(chain.mode[i]), []).append((chain, i))
                continue
            birth = scan.births[int(self._tree.birth[chain.nodes[0]])] if i == 0 else None
            chain.run.predicted_mean[i] = chain.run.mean[i - 1] if birth is None else birth.mean
            chain.run.predicted_cov[i] = chain.run.cov[i - 1] if birth is None else birth.cov
            if i > 0:
                chain.run.F[i - 1] = np.eye(len(self._motion.names))
        for mode, some in by_mode.items():
            mean = np.array([chain.run.mean[i - 1] for chain, i in some])
            cov = np.array([chain.run.cov[i - 1] for chain, i in some])
            moved = predict_states(self._motion, mode, mean, cov, scan.dt_s)
            for (chain, i), value, A, P in zip(some, *moved, strict=True):
                chain.run.predicted_mean[i] = value
                chain.run.predicted_cov[i] = P
                chain.run.F[i - 1] = A
        for chain, i in active:
            chain.run.mean[i] = chain.run.predicted_mean[i]
            chain.run.cov[i] = chain.run.predicted_cov[i]

    def _update(self, k: int, detected: list[tuple[_Chain, int]]) -> None:
        if not detected:
            return
        mean = np.array([chain.run.mean[i] for chain, i in detected])
        cov = np.array([chain.run.cov[i] for chain, i in detected])
        model = self._models[k]
        measured = model.expect(mean, cov).model
        z = model.z[[int(chain.meas[i]) for chain, i in detected]]
        updated = update_states(mean, cov, measured, wrap(z - measured.value, model.angles))
        for (chain, i), one, P in zip(detected, *updated, strict=True):
            chain.run.mean[i] = one
            chain.run.cov[i] = P

    def _finished(self, chain: _Chain, *, smooth: bool) -> Path:
        mean, cov = smooth_states(chain.run) if smooth else (chain.run.mean, chain.run.cov)
        scans = [self._scans[int(k)] for k in chain.scan]
        return Path(
            chain.label,
            chain.scan,
            np.array([scan.t_ns for scan in scans], np.int64),
            read_only(mean),
            read_only(cov),
            self._measured(chain),
            chain.label in self._estimated_now,
        )

    def _measured(self, chain: _Chain) -> FloatArray:
        """Return the detections (n, k) of a path, NaN for none."""
        z = [self._models[int(k)].z for k in chain.scan]
        width = max((one.shape[1] for one in z), default=0)
        rows = np.full((len(z), width), np.nan)
        for i, j in enumerate(chain.meas.tolist()):
            if j >= 0:
                rows[i, : z[i].shape[1]] = z[i][j]
        return read_only(rows)

    def _forget_scans(self) -> None:
        super()._forget_scans()
        self._models = {k: model for k, model in self._models.items() if k in self._scans}
