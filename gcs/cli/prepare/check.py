"""`gcs check`: validate a mission file, print what it means, and warn of what is unusual."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from gcs.cli.arguments import ConfigArgument, JsonOption, MapSeedOption, command_app
from gcs.cli.errors import exit_on_error
from gcs.cli.zenoh_security import zenoh_warnings
from gcs.errors import ConfigError
from gcs.io.terminal import console_for
from gcs.mistake_codes import MistakeCode

if TYPE_CHECKING:
    from gcs.config import Config
    from gcs.config.schema import AgentTable, BirthTable
    from gcs.core.airspace.obstacle_map import ObstacleMap
    from gcs.io.zenoh.certificates import Node
    from gcs.planning.map.grid import Grid

app = command_app()

_ROLES = {
    "vehicles": "vehicles",
    "read-only": "other ground stations, read-only",
    "full": "other ground stations, with full access",
}


@app.command()
def check(config: ConfigArgument, seed: MapSeedOption = 1, as_json: JsonOption = False) -> None:
    """Validate a mission file and print what it means.

    A mistake is shown with its file, its key and the expected value.
    """
    with exit_on_error(as_json=as_json):
        describe(config, seed, console_for(stderr=as_json))
        if as_json:
            typer.echo(json.dumps({"mistakes": []}))


def describe(scenario: str, seed: int, console: Console) -> None:
    """Validate a mission file and print what it means.

    Raises
    ------
    ConfigError
        When the file is wrong.
    """
    from gcs.config import load
    from gcs.core.airspace.obstacle_map import mission_map
    from gcs.fence import fence_of, rally_of
    from gcs.model import vehicle_name

    config = load(scenario)
    obstacles = mission_map(config, seed)
    grid = obstacles.grid
    blocked = int(grid.blocked.sum())
    low = int((obstacles.near_ground.blocked & ~grid.blocked).sum())
    area = config.map
    fence = fence_of(config, scenario)
    planning = config.planning
    tracking = config.tracking
    table = Table(title=f"{config.name}: {config.description}", title_justify="left", show_header=False)
    table.add_column(style="bold")
    table.add_column()
    table.add_row(
        "origin",
        f"{config.frame.lat_deg:.7f}°, {config.frame.lon_deg:.7f}°, {config.frame.alt_msl_m:.0f} m AMSL",
    )
    table.add_row(
        "map",
        f"{area.width_m:.0f} m x {area.height_m:.0f} m, {area.nodes_east} x {area.nodes_north} nodes, "
        f"{grid.spacing_m:.1f} m apart",
    )
    table.add_row("terrain", config.ground)
    table.add_row(
        "obstacles",
        f"{blocked} nodes ({100 * blocked / grid.blocked.size:.1f} %) with seed {seed}"
        + (", those outside the fence included" if fence.areas else "")
        + (f"; {low} more below the altitude layers" if low else ""),
    )
    if area.geojson:
        zones = config.zones
        table.add_row(
            "GeoJSON",
            f"{len(zones.no_fly)} no-fly zones, " + ("a boundary" if zones.boundary else "no boundary"),
        )
    table.add_row(
        "agents",
        "\n".join(
            f"{vehicle_name(a.vehicle)} at {_position_text(config, a)}"
            + (f", airframe {a.airframe}" if a.airframe else "")
            for a in config.agents
        ),
    )
    table.add_row(
        "target births",
        "\n".join(f"{_position_text(config, b)} ± {b.std_m:.0f} m" for b in config.births) or "none",
    )
    table.add_row(
        "tracking",
        f"up to {tracking.max_hypotheses} hypotheses, "
        f"gate {math.sqrt(tracking.gate_chi2):.1f} σ, lost below existence {tracking.lost_existence}",
    )
    table.add_row(
        "planning",
        f"checked every {planning.period_s} s; new plan when a target has moved "
        f"{planning.target_moved_m:.0f} m, an agent is lost or a target appears",
    )
    table.add_row(
        "missions",
        f"at {config.mission.altitude_rel_m:.0f} m above the origin; waypoints reached at "
        f"{config.mission.accept_radius_m:.0f} m, targets at {planning.capture_radius_m:.0f} m",
    )
    for link in config.mavlink_links:
        uses = {
            _ROLES[link.role]: True,
            f"network {link.network}": link.network > 0,
            "a second link of vehicles": link.redundant,
            "receivers of other aircraft": link.traffic,
        }
        table.add_row("MAVLink", f"{link.name}: {', '.join(text for text, is_so in uses.items() if is_so)}")
    table.add_row("signing", f"keys of {config.links.keys}" if config.links.keys else "none")
    rally = rally_of(config)
    ceiling = f"ceiling {fence.max_alt_rel_m:g} m" if fence.max_alt_rel_m else "no ceiling"
    table.add_row("fence", f"{len(fence.areas)} areas, {ceiling}; {len(rally)} rally points")
    node = _node(config, scenario)
    table.add_row("zenoh", _zenoh_text(config, node))
    table.add_row(
        "simulated world",
        "yes: `gcs demo` can fly it (`sim-vehicles` checks its keys)" if config.simulation else "no",
    )
    console.print(table)
    warnings = [f"warning: {warning}" for warning in position_warnings(config, obstacles, scenario)]
    if config.elevation_model is not None:
        warnings += [f"warning: {remark}" for remark in config.elevation_model.remarks]
    for warning in (*warnings, *zenoh_warnings(config.links, node)):
        console.print(warning, style="yellow", highlight=False, markup=False, soft_wrap=True)


def _node(config: Config, source: str) -> Node | None:
    """Return the certificate of the mission file."""
    folder = config.links.tls_folder(source)
    if folder is None:
        return None
    from gcs.io.zenoh.certificates import read_node

    node = read_node(folder)
    if node.role not in ("command", "bridge"):
        problem = f"{node.common_name} may not command vehicles: expected a certificate of the role command"
        raise ConfigError(source, "links.zenoh_tls", MistakeCode.BAD_CREDENTIALS, problem)
    return node


def _zenoh_text(config: Config, node: Node | None) -> str:
    """Return endpoint, certificate, and the nodes that may connect."""
    text = f"{config.links.zenoh} (central command {config.links.zenoh_role}s)"
    if node is None:
        return text
    nodes = ", ".join(f"{role} {name}" for name, role in sorted((node.access(listens=True) or {}).items()))
    return f"{text} as {node.common_name}, valid until {node.expires:%Y-%m-%d}; for {nodes}"


def position_warnings(config: Config, obstacles: ObstacleMap, source: str) -> list[str]:
    """Return the agents and births in an obstacle or outside the fence, in words."""
    from gcs.fence import held_areas
    from gcs.model import vehicle_name
    from gcs.planning.map.line_of_sight import line_of_sight

    areas = held_areas(config, source)
    rows: list[tuple[str, AgentTable | BirthTable, Grid]] = [
        *((f"agent {vehicle_name(one.vehicle)} starts", one, obstacles.near_ground) for one in config.agents),
        *((f"births[{index}] lies", birth, obstacles.grid) for index, birth in enumerate(config.births)),
    ]
    found = []
    for subject, row, grid in rows:
        place = (row.east_m, row.north_m)
        wrong = [
            area
            for area in areas
            if bool(area.contains(np.array([place]), config.local_frame)[0]) != area.stay_in
        ]
        if wrong:
            where = (
                "outside the fence's inclusion area"
                if wrong[0].stay_in
                else "in an exclusion area of the fence"
            )
        elif grid.contains(place) and not line_of_sight(grid, place, place):
            where = "in an obstacle"
        else:
            continue
        found.append(f"{subject} {where}, at {_position_text(config, row)}")
    return found


def _position_text(config: Config, row: AgentTable | BirthTable) -> str:
    """Return a position in degrees and in metres."""
    lat_deg, lon_deg = config.local_frame.to_geodetic(row.east_m, row.north_m)
    return f"{lat_deg:.7f}°, {lon_deg:.7f}° (east {row.east_m:.1f} m, north {row.north_m:.1f} m)"
