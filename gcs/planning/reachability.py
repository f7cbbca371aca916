"""Agents inside obstacles, and agents and targets that no path reaches, as notes of a plan."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gcs.model import FloatArray, Label, NoticeCode
from gcs.planning.map.grid import Grid
from gcs.planning.plan_notes import PlanNote, of_target
from gcs.planning.search.cost_matrix import Endpoints
from gcs.planning.search.neighbours import SearchMap, cells


def reachability_notes(
    grid: Grid,
    smap: SearchMap,
    vehicles: Sequence[int],
    labels: Sequence[Label],
    starts: Endpoints,
    lengths_m: FloatArray,
) -> list[PlanNote]:
    """Return notes on agents inside obstacles and on unreachable agents and targets."""
    if grid.blocked.all():
        return [PlanNote(NoticeCode.NO_FREE_CELL)]
    notes = []
    for i in np.flatnonzero(starts.inside).tolist():
        east, north = cells(smap, starts.nodes[i, :1])[0] * grid.spacing_m + np.array(grid.origin_m)
        where = {"east_m": float(east), "north_m": float(north)}
        notes.append(PlanNote(NoticeCode.INSIDE_OBSTACLE, vehicles[i], where))
    return notes + unreached_notes(vehicles, labels, lengths_m)


def unreached_notes(
    vehicles: Sequence[int], labels: Sequence[Label], lengths_m: FloatArray
) -> list[PlanNote]:
    """Return notes on agents and targets without any path."""
    reached = np.isfinite(lengths_m)
    notes = [
        PlanNote(NoticeCode.NO_PATH_TO_TARGETS, vehicles[i])
        for i in np.flatnonzero(~reached.any(axis=1)).tolist()
    ]
    notes += [
        of_target(NoticeCode.NO_PATH_FROM_AGENTS, labels[j])
        for j in np.flatnonzero(~reached.any(axis=0)).tolist()
    ]
    return notes
