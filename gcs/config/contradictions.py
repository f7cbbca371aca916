"""Contradictions between keys of a mission file: with one, the file is refused."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gcs.config.mission_file import Config
from gcs.config.schema import (
    AgentTable,
    BirthTable,
    LimitsTable,
    LinksTable,
    TerrainTable,
    link_of,
)
from gcs.endpoints import Link, is_loopback
from gcs.errors import ConfigError, LinkError, TerrainFileError
from gcs.geo import corner_error
from gcs.geojson import read_zones
from gcs.mistake_codes import MistakeCode
from gcs.model import vehicle_name
from gcs.terrain.elevation_text import decode_model, is_model_text

_MIN_BAND_M = 20.0
"""Minimum height of the flight band: autopilots keep an altitude to some metres."""


def check(config: Config, source: str) -> None:
    """Raise `ConfigError` with all contradictions."""
    found = list(_contradictions(config, source))
    if found:
        raise ConfigError.of_all(found)


def _contradictions(config: Config, source: str) -> Iterator[ConfigError]:
    if config.map.geojson:
        yield from _zones(config, source)
    if config.terrain is not None:
        yield from _terrain(config, config.terrain, source)
    yield from _links(config, source)
    yield from _zenoh(config.links, source)
    ids = [agent.vehicle for agent in config.agents]
    for index, vehicle in enumerate(ids):
        if vehicle in ids[:index]:
            yield ConfigError(
                source,
                f"agents[{index}].system_id",
                MistakeCode.DUPLICATE,
                f"{vehicle_name(vehicle)} is used twice; each agent needs its own",
            )
    for index, agent in enumerate(config.agents):
        if agent.airframe and agent.airframe not in config.airframes:
            known = ", ".join(f'"{name}"' for name in sorted(config.airframes)) or "none"
            yield ConfigError(
                source,
                f"agents[{index}].airframe",
                MistakeCode.UNKNOWN_NAME,
                f"there is no table [airframes.{agent.airframe}]; there is {known}",
            )
    area = config.map
    for index, corners in enumerate(area.polygons_m):
        if error := corner_error({tuple(corner) for corner in corners}):
            yield ConfigError(source, f"map.polygons_m[{index}]", MistakeCode.BAD_SHAPE, error)
    yield from _heights(config, source)
    lists: list[tuple[str, Sequence[AgentTable | BirthTable]]] = [
        ("agents", config.agents),
        ("births", config.births),
    ]
    for name, rows in lists:
        for index, row in enumerate(rows):
            if not (0.0 <= row.east_m <= area.width_m and 0.0 <= row.north_m <= area.height_m):
                yield ConfigError(
                    source,
                    f"{name}[{index}]",
                    MistakeCode.OUTSIDE_MAP,
                    f"({row.east_m}, {row.north_m}) lies outside the map: "
                    f"{area.width_m} m x {area.height_m} m",
                )
    if config.takeoff.altitude_rel_m > config.mission.altitude_rel_m:
        yield ConfigError(
            source,
            "takeoff.altitude_rel_m",
            MistakeCode.CONFLICT,
            f"expected at most mission.altitude_rel_m, {config.mission.altitude_rel_m:g} m; "
            "vehicles climb on from there",
        )
    east, north = config.spacing_m
    if not np.isclose(east, north, rtol=1e-6):
        yield ConfigError(
            source,
            "map",
            MistakeCode.CONFLICT,
            f"the grid's cells must be square: width gives {east:.3f} m a cell, height {north:.3f} m; "
            "change nodes_east or nodes_north",
        )


def _heights(config: Config, source: str) -> Iterator[ConfigError]:
    """Check the vertical limits of areas, and that each altitude has one reference."""
    for index, obstacle in enumerate(config.map.obstacles):
        key = f"map.obstacles[{index}]"
        shapes = [obstacle.disc_m, obstacle.box_m, obstacle.polygon_m]
        if sum(shape is not None for shape in shapes) != 1:
            yield ConfigError(
                source, key, MistakeCode.CONFLICT, "expected one of disc_m, box_m and polygon_m"
            )
        if obstacle.polygon_m and (error := corner_error({tuple(corner) for corner in obstacle.polygon_m})):
            yield ConfigError(source, f"{key}.polygon_m", MistakeCode.BAD_SHAPE, error)
        yield from _limits(obstacle, source, key)
    for index, area in enumerate(config.fence.areas):
        yield from _limits(area, source, f"fence.areas[{index}]")
        heights = (area.height_m, area.floor_m, area.ceiling_m)
        if area.kind == "inclusion" and any(height is not None for height in heights):
            yield ConfigError(
                source,
                f"fence.areas[{index}]",
                MistakeCode.CONFLICT,
                "an area to stay in has no heights: set fence.max_alt_rel_m or fence.max_alt_msl_m",
            )
    if config.fence.max_alt_msl_m is not None:
        if config.fence.max_alt_rel_m:
            yield ConfigError(
                source, "fence", MistakeCode.CONFLICT, "expected either max_alt_rel_m or max_alt_msl_m"
            )
        elif config.max_alt_rel_m <= 0.0:
            yield ConfigError(
                source,
                "fence.max_alt_msl_m",
                MistakeCode.CONFLICT,
                f"expected more than frame.alt_msl_m, {config.frame.alt_msl_m:g} m",
            )
    for index, point in enumerate(config.rally):
        if sum(alt is not None for alt in (point.alt_rel_m, point.alt_msl_m, point.alt_agl_m)) != 1:
            yield ConfigError(
                source,
                f"rally[{index}]",
                MistakeCode.CONFLICT,
                "expected one of alt_rel_m, alt_msl_m and alt_agl_m",
            )


def _limits(table: LimitsTable, source: str, key: str) -> Iterator[ConfigError]:
    try:
        table.limits  # noqa: B018  raises
    except ValueError as error:
        name, _, problem = str(error).partition(": ")
        yield ConfigError(source, f"{key}.{name}", MistakeCode.CONFLICT, problem)


def _zones(config: Config, source: str) -> Iterator[ConfigError]:
    if not config.map.geojson.lstrip().startswith("{"):
        yield ConfigError(
            source,
            "map.geojson",
            MistakeCode.WRONG_TYPE,
            'expected the name of a file on a line of its own: geojson = "zones.geojson"',
        )
        return
    given = read_zones(config.map.geojson, f"{source}: map.geojson")
    near = config.zones
    for what, some, here in (
        ("the boundary", given.boundary, near.boundary),
        ("every no-fly zone", given.no_fly, near.no_fly),
    ):
        if some and not here:
            yield ConfigError(
                source,
                "map.geojson",
                MistakeCode.OUTSIDE_MAP,
                f"{what} lies far from the frame's origin ({config.frame.lat_deg:.3f}°, "
                f"{config.frame.lon_deg:.3f}°); positions are [longitude, latitude], in this order",
            )


def _terrain(config: Config, terrain: TerrainTable, source: str) -> Iterator[ConfigError]:
    """Check the flight band, and that the elevation model is there and covers the map."""
    if terrain.max_agl_m - terrain.min_agl_m < _MIN_BAND_M:
        yield ConfigError(
            source,
            "terrain.max_agl_m",
            MistakeCode.CONFLICT,
            f"expected at least {_MIN_BAND_M:g} m above terrain.min_agl_m, {terrain.min_agl_m:g} m",
        )
    if not is_model_text(terrain.file):
        yield ConfigError(
            source,
            "terrain.file",
            MistakeCode.WRONG_TYPE,
            'expected the name of a file on a line of its own: file = "ground.tif"',
        )
        return
    try:
        ground = decode_model(terrain.file).elevation
    except TerrainFileError as error:
        yield ConfigError(
            source, "terrain.file", MistakeCode.INVALID_FILE, f"expected the name of a file; this is {error}"
        )
        return
    corners = np.array([[0.0, 0.0], [config.map.width_m, config.map.height_m]])
    if not np.isfinite(ground.heights_at(corners)).all():
        yield ConfigError(
            source,
            "terrain.file",
            MistakeCode.CONFLICT,
            "the elevation model is that of a smaller map: expected the name of its file",
        )


def _zenoh(links: LinksTable, source: str) -> Iterator[ConfigError]:
    """Check that other machines do not reach an endpoint without certificates by mistake."""
    named = {"zenoh": links.zenoh, "standby": links.standby}
    named |= {f"bridges[{index}].zenoh": one.zenoh for index, one in enumerate(links.bridges)}
    for key, endpoint in named.items():
        if not endpoint:
            continue
        is_tls = endpoint.startswith("tls/")
        if is_tls and not links.zenoh_tls:
            problem = f"is missing: {endpoint} needs a folder with a certificate (gcs keys node)"
            yield ConfigError(source, "links.zenoh_tls", MistakeCode.MISSING_KEY, problem)
        if links.zenoh_tls and not is_tls:
            problem = f"{endpoint} would not use links.zenoh_tls; expected tls/HOST:PORT"
            yield ConfigError(source, f"links.{key}", MistakeCode.CONFLICT, problem)
        if not (is_tls or is_loopback(endpoint) or links.zenoh_unprotected):
            problem = (
                f"{endpoint} lets every program on that network command the vehicles: expected tls/HOST:PORT "
                "with links.zenoh_tls (gcs keys node), or zenoh_unprotected = true where no one else is on "
                "that network"
            )
            yield ConfigError(source, f"links.{key}", MistakeCode.INSECURE, problem)


def _bridge(config: Config, source: str, key: str, link: Link) -> Iterator[ConfigError]:
    """Check that an endpoint names its bridge, if there are several, and one that exists."""
    names = [one.name for one in config.links.bridges]
    if link.bridge and link.bridge not in names:
        listed = ", ".join(names) or "none"
        yield ConfigError(
            source,
            f"{key}.bridge",
            MistakeCode.UNKNOWN_NAME,
            f"no bridge is called {link.bridge}; there is {listed}",
        )
    if len(names) > 1 and not link.bridge:
        problem = f"expected the bridge that opens it: {', '.join(names)}"
        yield ConfigError(source, f"{key}.bridge", MistakeCode.MISSING_KEY, problem)


def _links(config: Config, source: str) -> Iterator[ConfigError]:
    """Parse all connection strings; check that networks have endpoints, and bridges names of their own."""
    names = [one.name for one in config.links.bridges]
    for index, name in enumerate(names):
        if name in names[:index]:
            yield ConfigError(
                source, f"links.bridges[{index}].name", MistakeCode.DUPLICATE, f"{name} is there twice"
            )
    links: list[tuple[str, Link]] = []
    for key, entry in config.links.entries():
        try:
            link = link_of(entry)
        except LinkError as error:
            yield ConfigError(source, key, MistakeCode.WRONG_TYPE, str(error))
            continue
        yield from _bridge(config, source, key, link)
        if link.name in (other.name for _, other in links):
            yield ConfigError(
                source, key, MistakeCode.DUPLICATE, f"{link.name} is there twice; each endpoint is one link"
            )
        links.append((key, link))
    reached = {link.network for _, link in links if link.role == "vehicles"}
    for key, link in links:
        if link.network not in reached:
            yield ConfigError(
                source,
                key,
                MistakeCode.UNKNOWN_NAME,
                f"network {link.network} has no endpoint in links.mavlink",
            )
    for index, agent in enumerate(config.agents):
        if agent.network not in reached:
            yield ConfigError(
                source,
                f"agents[{index}].network",
                MistakeCode.UNKNOWN_NAME,
                f"network {agent.network} has no endpoint in links.mavlink; "
                f"there is {', '.join(map(str, sorted(reached)))}",
            )
