"""Sections of the feed that are computed; the others are records of `gcs.model` as they are."""

from __future__ import annotations

import base64
from typing import Any, Final

import msgspec
import numpy as np

from gcs.config import Config
from gcs.console.view.schema import FenceArea, FieldOfView, MissionInfo, ObstacleMap, RunInfo, Tracks
from gcs.fence import drawn_areas, rally_of
from gcs.model import Picture, Scan, track_name
from gcs.planning.map.grid import Grid

MAX_DETECTIONS: Final = 20_000
"""Detections of one scan that a page gets."""


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
        loiter_radii_m={v: one.loiter_radius_m for v, one in config.airframes_of_agents.items()},
        homes=tuple((one.east_m, one.north_m) for one in config.agents),
        rally=tuple(frame.to_local(one.lat_deg, one.lon_deg) for one in rally_of(config)),
        fence=tuple(
            FenceArea(one.stay_in, tuple(one.outline_m(frame))) for one in drawn_areas(config, config.name)
        ),
    )


def obstacle_map(grid: Grid) -> ObstacleMap:
    """Return the blocked cells."""
    bits = np.packbits(grid.blocked, axis=None, bitorder="little").tobytes()
    return ObstacleMap(grid.origin_m, grid.spacing_m, grid.shape, base64.b64encode(bits).decode())


def tracks(picture: Picture) -> Tracks:
    """Return the tracks of one kind."""
    found = picture.tracks
    means: Any = np.array([track.mean for track in found]).reshape(-1, 4)
    covs = np.array([track.cov for track in found]).reshape(-1, 4, 4)
    return Tracks(
        names=[track_name(picture.kind, track.label) for track in found],
        means=means.round(1).tolist(),
        covs=covs[:, [0, 0, 1], [0, 1, 1]].round(1).tolist(),
        existence=[round(track.existence, 3) for track in found],
        estimated=[track.estimated for track in found],
    )


def detections(scan: Scan) -> list[int]:
    """Return the detections of a scan, east and north in turns."""
    found: list[int] = scan.z_m[:MAX_DETECTIONS].round(0).astype(int).ravel().tolist()
    return found


def fields_of_view(scans: list[Scan]) -> dict[str, FieldOfView]:
    """Return the field of view of the sensor of each scan."""
    return {one.sensor.name: FieldOfView(one.sensor.field_of_view_m, one.sensor.polar) for one in scans}
