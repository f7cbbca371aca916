"""Captures of the engine's state, and of its mission."""

from __future__ import annotations

import base64
from functools import lru_cache
from typing import Final

import msgspec
import numpy as np

from gcs.config import Config
from gcs.console.view.capture import Capture
from gcs.console.view.page_records import (
    ElevationMap,
    FenceArea,
    MissionInfo,
    ObstacleMap,
    RunInfo,
    ServiceState,
)
from gcs.core.engine import Engine
from gcs.core.state import wanted_routes
from gcs.fence import drawn_areas, rally_of
from gcs.model import BoolArray
from gcs.planning.map.grid import Grid

_MAX_NODES: Final = 100_000
"""Of the ground that is sent to a page: 270 kB."""
_STEPS: Final = 2**16 - 1
_MIN_STEP_M: Final = 0.01


def capture(engine: Engine, t_ns: int, service: ServiceState | None = None) -> Capture:
    """Return the state of the engine now."""
    pending = engine.state.operator.approval.pending
    obstacles = engine.stages.no_fly_zones.obstacles
    return Capture(
        t_ns=t_ns,
        status=engine.stages.status_report.build(t_ns),
        routes=tuple(wanted_routes(engine.state.agents).values()),
        proposal=pending if pending is not None and pending.routes else None,
        map=obstacle_map(obstacles.grid, obstacles.near_ground),
        zones=tuple(engine.state.airspace.zones.values()),
        telemetry=engine.state.fleet.table.copy(),
        service=service,
    )


@lru_cache(maxsize=2)
def obstacle_map(grid: Grid, near_ground: Grid) -> ObstacleMap:
    """Return the cells that are blocked in the altitude layers, and those that are so below them only."""
    below = "" if near_ground is grid else _bits(near_ground.blocked & ~grid.blocked)
    return ObstacleMap(grid.origin_m, grid.spacing_m, grid.shape, _bits(grid.blocked), below)


def _bits(blocked: BoolArray) -> str:
    return base64.b64encode(np.packbits(blocked, axis=None, bitorder="little").tobytes()).decode()


def elevation_map(config: Config) -> ElevationMap | None:
    """Return the ground for the page, resampled to at most `_MAX_NODES`; None if it is flat."""
    terrain = config.terrain
    elevation = config.elevation
    if terrain is None or elevation is None:
        return None
    drawn = elevation.coarser(_MAX_NODES)
    lowest_m = float(drawn.heights_msl_m.min())
    step_m = max(float(np.ptp(drawn.heights_msl_m)) / _STEPS, _MIN_STEP_M)
    steps = np.rint((drawn.heights_msl_m - lowest_m) / step_m).astype("<u2")
    return ElevationMap(
        origin_m=drawn.origin_m,
        spacing_m=drawn.spacing_m,
        shape=steps.shape,
        lowest_msl_m=lowest_m,
        step_m=step_m,
        heights=base64.b64encode(steps.tobytes()).decode(),
        min_agl_m=terrain.min_agl_m,
        max_agl_m=terrain.max_agl_m,
    )


def mission_info(config: Config, run: RunInfo) -> MissionInfo:
    """Return what does not change in a run."""
    area = config.map
    frame = config.local_frame
    mission = config.mission
    return MissionInfo(
        **msgspec.structs.asdict(run),
        name=config.name,
        size_m=(area.width_m, area.height_m),
        origin_deg=(frame.lat_deg, frame.lon_deg),
        origin_alt_m=frame.alt_msl_m,
        terrain=config.ground,
        elevation=elevation_map(config),
        layers_rel_m=tuple(
            mission.altitude_rel_m + layer * mission.layer_step_m for layer in range(mission.layers)
        ),
        loiter_radii_m={v: one.loiter_radius_m for v, one in config.airframes_of_agents.items()},
        homes=tuple((one.east_m, one.north_m) for one in config.agents),
        rally=tuple(frame.to_local(one.lat_deg, one.lon_deg) for one in rally_of(config)),
        fence=tuple(
            FenceArea(one.stay_in, tuple(one.outline_m(frame))) for one in drawn_areas(config, config.name)
        ),
        lag_scans=config.tracking.lag_scans,
    )
