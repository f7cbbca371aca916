"""Parts of the page's data: plain objects of a capture, rounded to what a page shows.

Positions are east and north in metres, times are seconds since the start of the run.
"""

from __future__ import annotations

import base64
from typing import Any, Final

import numpy as np

from gcs.config import Config
from gcs.console.view.capture import Capture, ServiceState
from gcs.console.view.rounding import rounded
from gcs.fence import drawn_areas, rally_of
from gcs.mavlink.fleet.checks.battery_alarm import is_low
from gcs.model import (
    AgentRecord,
    NoFlyZone,
    Picture,
    Proposal,
    Route,
    Scan,
    Sensor,
    SwarmStatus,
    VehicleState,
    target_name,
    track_name,
    vehicle_name,
)
from gcs.planning.map.grid import Grid
from gcs.report.agent_order import attention, is_late, pinned_vehicles

MAX_DETECTIONS: Final = 20_000
"""Detections of one scan that a page gets."""


def mission(config: Config) -> dict[str, Any]:
    """Return what does not change in a run."""
    area, frame = config.map, config.local_frame
    return {
        "name": config.name,
        "size_m": [area.width_m, area.height_m],
        "origin_deg": [frame.lat_deg, frame.lon_deg],
        "origin_alt_m": frame.alt_msl_m,
        "loiter_radii_m": {v: one.loiter_radius_m for v, one in config.airframes_of_agents.items()},
        "homes": [[one.east_m, one.north_m] for one in config.agents],
        "rally": [frame.to_local(one.lat_deg, one.lon_deg) for one in rally_of(config)],
        "fence": [
            {"stay_in": one.stay_in, "ring": one.outline_m(frame)} for one in drawn_areas(config, config.name)
        ],
    }


def obstacle_map(grid: Grid) -> dict[str, Any]:
    """Return the blocked cells: one bit each, row by row from the south."""
    return {
        "origin_m": grid.origin_m,
        "spacing_m": grid.spacing_m,
        "shape": grid.shape,
        "blocked": base64.b64encode(
            np.packbits(grid.blocked, axis=None, bitorder="little").tobytes()
        ).decode(),
    }


def zones(closed: tuple[NoFlyZone, ...]) -> list[dict[str, Any]]:
    """Return the no-fly zones."""
    return [{"name": one.name, "disc": one.disc_m, "polygon": one.polygon_m} for one in closed]


def vehicles(capture: Capture) -> list[dict[str, Any]]:
    """Return the vehicles, those that need attention first."""
    states = {state.system_id: state for state in capture.states}
    agents = sorted(capture.status.agents, key=attention)
    return [
        _vehicle(agent, states.get(agent.vehicle), capture.lost_at_m.get(agent.vehicle)) for agent in agents
    ]


def _vehicle(
    agent: AgentRecord, state: VehicleState | None, lost_at_m: tuple[float, float] | None
) -> dict[str, Any]:
    return {
        "id": agent.vehicle,
        "name": vehicle_name(agent.vehicle),
        "status": agent.status,
        "authority": agent.authority,
        "problems": list(agent.problems),
        "reason": agent.reason,
        "mode": agent.mode,
        "armed": agent.armed,
        "at": None if agent.position_m is None else [rounded(value) for value in agent.position_m],
        "course": None if state is None else rounded(state.course_rad, 2),
        "alt_m": rounded(agent.alt_rel_m),
        "layer": agent.layer,
        "speed_m_s": rounded(agent.ground_speed_m_s),
        "battery": agent.battery_percent,
        "battery_low": is_low(agent.battery_percent),
        "fix": agent.fix_type,
        "heard_s": rounded(agent.heard_age_s),
        "late": is_late(agent),
        "loss": rounded(agent.loss, 3),
        "doubted": agent.is_position_doubted,
        "target": None if agent.target is None else target_name(agent.target),
        "proposed": None if agent.proposed_target is None else target_name(agent.proposed_target),
        "pinned": None if agent.pinned is None else target_name(agent.pinned),
        "passed": agent.points_passed,
        "eta_s": rounded(agent.eta_s, 0),
        "upload": agent.upload,
        "failed": agent.has_failed,
        "verified": agent.is_verified,
        "lost_at": lost_at_m,
    }


def targets(status: SwarmStatus) -> list[dict[str, Any]]:
    """Return the confirmed targets."""
    pins = pinned_vehicles(status.agents)
    return [
        {
            "name": target_name(one.label),
            "existence": rounded(one.existence, 2),
            "at": [rounded(value) for value in one.position_m],
            "speed_m_s": rounded(one.speed_m_s),
            "agents": [vehicle_name(vehicle) for vehicle in one.agents],
            "reached_by": [vehicle_name(vehicle) for vehicle in one.reached_by],
            "ignored": one.is_ignored,
            "priority": one.priority,
            "pinned": [vehicle_name(vehicle) for vehicle in pins.get(one.label, ())],
        }
        for one in status.targets
    ]


def sensors(capture: Capture) -> list[dict[str, Any]]:
    """Return the sensors: the age of each one's last scan, and whether it is late or silent."""
    return [
        {
            "name": one.name,
            "age_s": rounded(one.scan_age_s),
            "state": capture.sensors.get(one.name, ""),
        }
        for one in capture.status.sensors
    ]


def service(state: ServiceState | None) -> dict[str, Any] | None:
    """Return the state of the service around the engine; None in a replay."""
    if state is None:
        return None
    space = state.space
    return {
        "lag_s": rounded(state.lag_s, 2),
        "dropped": state.dropped,
        "recording": state.is_recording,
        "used_mb": None if space is None else rounded(space.used_bytes / 1e6),
        "free_mb": None if space is None else rounded(space.free_bytes / 1e6, 0),
        "low": space is not None and space.is_low,
        "stations": state.stations,
    }


def tracks(picture: Picture) -> dict[str, Any]:
    """Return the tracks of one kind, column by column."""
    found = picture.tracks
    means = np.array([track.mean for track in found]).reshape(-1, 4)
    covs = np.array([track.cov for track in found]).reshape(-1, 4, 4)
    return {
        "names": [track_name(picture.kind, track.label) for track in found],
        "means": means.round(1).tolist(),
        "covs": covs[:, [0, 0, 1], [0, 1, 1]].round(1).tolist(),
        "existence": [round(track.existence, 3) for track in found],
        "estimated": [track.estimated for track in found],
    }


def route(one: Route) -> dict[str, Any]:
    """Return a route."""
    return {
        "id": one.vehicle,
        "target": target_name(one.target),
        "points": one.points_m.round(1).tolist(),
        "length_m": rounded(one.length_m, 0),
        "wait": one.wait_m,
    }


def proposal(pending: Proposal | None) -> dict[str, Any] | None:
    """Return the plan that waits for approval."""
    if pending is None or not pending.routes:
        return None
    figures = {one.vehicle: one for one in pending.figures}
    rows = []
    for one in pending.routes:
        known = figures.get(one.vehicle)
        row = route(one) | {"name": vehicle_name(one.vehicle)}
        if known is not None:
            row |= {
                "length_m": rounded(known.length_m, 0),
                "shown_length_m": rounded(known.shown_length_m, 0),
                "arrival_s": rounded(known.arrival_s, 0),
                "separation_m": rounded(known.separation_m, 0),
                "clearance_m": rounded(known.clearance_m, 0),
                "short": known.is_short,
            }
        rows.append(row)
    return {
        "id": pending.plan_id,
        "reason": pending.reason,
        "age_s": rounded(pending.age_s, 0),
        "routes": rows,
    }


def scan(one: Scan) -> dict[str, Any]:
    """Return the detections of a scan, east and north in turns."""
    return {"sensor": one.sensor.name, "z": one.z_m[:MAX_DETECTIONS].round(0).astype(int).ravel().tolist()}


def field_of_view(sensor: Sensor) -> dict[str, Any]:
    """Return the field of view of a sensor: a box, or a sector."""
    polar = sensor.polar
    if polar is None:
        return {"box": [rounded(value) for value in sensor.field_of_view_m]}
    return {
        "at": [rounded(polar.east_m), rounded(polar.north_m)],
        "range_m": polar.range_m,
        "bearing_rad": polar.bearing_rad,
    }
