"""Captures of the engine's state, and of its mission."""

from __future__ import annotations

import base64
from functools import lru_cache

import msgspec
import numpy as np

from gcs.config import Config
from gcs.console.view.capture import Capture
from gcs.console.view.schema import FenceArea, MissionInfo, ObstacleMap, RunInfo, ServiceState
from gcs.core.engine import Engine
from gcs.core.state import flown_routes
from gcs.fence import drawn_areas, rally_of
from gcs.planning.map.grid import Grid


def capture(engine: Engine, t_ns: int, service: ServiceState | None = None) -> Capture:
    """Return the state of the engine now."""
    pending = engine.state.operator.approval.pending
    return Capture(
        t_ns=t_ns,
        status=engine.stages.status_report.build(t_ns),
        routes=tuple(flown_routes(engine.state.agents).values()),
        proposal=pending if pending is not None and pending.routes else None,
        map=obstacle_map(engine.grid),
        zones=tuple(engine.state.airspace.zones.values()),
        telemetry=engine.state.fleet.table.copy(),
        service=service,
    )


@lru_cache(maxsize=2)
def obstacle_map(grid: Grid) -> ObstacleMap:
    """Return the blocked cells."""
    bits = np.packbits(grid.blocked, axis=None, bitorder="little").tobytes()
    return ObstacleMap(grid.origin_m, grid.spacing_m, grid.shape, base64.b64encode(bits).decode())


def mission_info(config: Config, run: RunInfo) -> MissionInfo:
    """Return what does not change in a run."""
    area = config.map
    frame = config.local_frame
    return MissionInfo(
        **msgspec.structs.asdict(run),
        name=config.name,
        size_m=(area.width_m, area.height_m),
        origin_deg=(frame.lat_deg, frame.lon_deg),
        origin_alt_m=frame.alt_msl_m,
        terrain=config.ground,
        loiter_radii_m={v: one.loiter_radius_m for v, one in config.airframes_of_agents.items()},
        homes=tuple((one.east_m, one.north_m) for one in config.agents),
        rally=tuple(frame.to_local(one.lat_deg, one.lon_deg) for one in rally_of(config)),
        fence=tuple(
            FenceArea(one.stay_in, tuple(one.outline_m(frame))) for one in drawn_areas(config, config.name)
        ),
    )
