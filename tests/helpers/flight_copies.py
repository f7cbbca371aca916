"""Copies of virtual flights in the air: tests share the time before the event that each of them is about."""

from __future__ import annotations

import copy
import struct
from types import CellType, FunctionType
from typing import Any
from unittest import mock

from gcs.core.engine import Engine
from gcs.core.snapshot import decode_state, encode_state
from sim_vehicles.autopilots.autopilot_traits import AutopilotTraits
from sim_vehicles.campaign.virtual_run import VirtualRun


def copy_of(run: VirtualRun) -> VirtualRun:
    """Return a copy of a flight. What is called with its events and effects is not copied."""
    bare = copy.copy(run)
    bare.on_event = bare.on_effect = bare.on_truth = bare.on_snapshot = bare.tamper = bare.engine = None
    shared = (run.scenario, run.scenario.config.elevation)
    with mock.patch.dict(copy._deepcopy_dispatch, _KINDS):
        new = copy.deepcopy(bare, {id(one): one for one in shared if one is not None})
    new.engine = Engine(run.scenario.config, run.seed, decode_state("copy", encode_state(run.engine.state)))
    return new


def _copied_function(function: FunctionType, memo: dict[int, Any]) -> FunctionType:
    """Return a closure over copies; another function as it is."""
    if function.__closure__ is None:
        return function
    cells = tuple(CellType(copy.deepcopy(cell.cell_contents, memo)) for cell in function.__closure__)
    code, defaults = function.__code__, function.__defaults__
    return FunctionType(code, function.__globals__, function.__name__, defaults, cells)


def _same(one: Any, _memo: dict[int, Any]) -> Any:
    return one


_KINDS = {FunctionType: _copied_function, struct.Struct: _same, AutopilotTraits: _same}
"""How objects are copied that `deepcopy` shares or refuses."""
