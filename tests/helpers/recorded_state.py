"""What a recorded flight replays, and what may differ outside its state."""

from __future__ import annotations

from pathlib import Path

from gcs.config import Config, parse
from gcs.io.recording.reader import Damage, read, read_info
from gcs.model import Event, Truth

CACHES: frozenset[str] = frozenset(
    {
        # The picture of the posterior, and its confirmed tracks.
        "gcs.core.perception.track_lifecycle.TrackConfirmation.existing",
        "gcs.core.perception.track_lifecycle.TrackConfirmation.tracks",
        "gcs.core.perception.class_tracker.ClassTracker.picture",
        # Arguments of the last update, as arrays, and its detection summary.
        "gcs.tracking.glmb.filter.Glmb._birth_components",
        "gcs.tracking.glmb.filter.Glmb._births",
        "gcs.tracking.glmb.filter.Glmb._sensor",
        "gcs.tracking.glmb.filter.Glmb._sensor_model",
        "gcs.tracking.glmb.filter.Glmb.detection_summary",
        "gcs.core.airspace.no_fly_zones.NoFlyZones.closed",  # cells of the closed zones, drawn from the state
        "gcs.core.airspace.no_fly_zones.NoFlyZones.closed_cells",
        "gcs.core.airspace.no_fly_zones.NoFlyZones.obstacles",
        "gcs.core.airspace.no_fly_zones.NoFlyZones.limited",
        "gcs.core.airspace.no_fly_zones.NoFlyZones.limited_cells",
        "gcs.core.airspace.obstacle_map.ObstacleMap.grid",
        "gcs.core.airspace.obstacle_map.ObstacleMap.near_ground",
        "gcs.core.airspace.obstacle_map.ObstacleMap.low_areas",
        "gcs.core.separation.predicted_flights.PredictedFlights._flights",  # for the checks of one event
        "gcs.mavlink.fleet.vehicle.Vehicle._state",  # from its link and its row of the telemetry table
        "gcs.mavlink.fleet.vehicle.Vehicle._state_positions",
        "gcs.mavlink.frames.fast_scan.Scanner._rows",  # buffer, empty before each datagram
        "gcs.planning.map.grid.Grid.blocked",
    }
)
"""Attributes that may change outside the state: they change no result."""


def events_of(path: Path) -> tuple[Config, int, list[Event]]:
    info = read_info(path)
    values = [record.value for record in read(path)]
    events = [v for v in values if isinstance(v, Event) and not isinstance(v, Truth | Damage)]
    return parse(info.config_text, path.name), info.run.seed, events
