"""The mission file as one value."""

from __future__ import annotations

import math
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from gcs.config.airframe import AgentAirframe, AirframeTable, NamedAirframeTable
from gcs.config.schema import (
    AgentTable,
    BirthTable,
    FenceTable,
    FrameTable,
    LinksTable,
    MapTable,
    MissionTable,
    PlanningTable,
    RallyTable,
    RecordingTable,
    TakeoffTable,
    TelemetryTable,
    TerrainTable,
    TrackingTable,
    link_of,
)
from gcs.config.validation import Table
from gcs.endpoints import Link
from gcs.geo import LocalFrame
from gcs.geojson import Zones, read_zones
from gcs.model import LayerHeights, VerticalLimits
from gcs.terrain.elevation_grid import Elevation
from gcs.terrain.elevation_text import ElevationModel, decode_model

AirframeName = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,32}$")]
ZONES = "the GeoJSON of the map"


class Config(Table, frozen=True, kw_only=True):
    """A mission file."""

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
    description: str = ""
    frame: FrameTable
    map: MapTable = MapTable()
    terrain: TerrainTable | None = None
    agents: Annotated[list[AgentTable], Meta(min_length=1)]
    births: list[BirthTable] = []
    tracking: TrackingTable = TrackingTable()
    telemetry: TelemetryTable = TelemetryTable()
    airframe: AirframeTable = AirframeTable()
    airframes: dict[AirframeName, NamedAirframeTable] = {}
    planning: PlanningTable = PlanningTable()
    mission: MissionTable = MissionTable()
    takeoff: TakeoffTable = TakeoffTable()
    links: LinksTable = LinksTable()
    recording: RecordingTable = RecordingTable()
    fence: FenceTable = FenceTable()
    rally: list[RallyTable] = []
    simulation: dict[str, Any] = {}

    @property
    def mavlink_links(self) -> tuple[Link, ...]:
        """All MAVLink endpoints: those of vehicles, then those of other ground stations."""
        return tuple(link_of(entry) for _, entry in self.links.entries())

    @property
    def local_frame(self) -> LocalFrame:
        """Local frame of all east/north coordinates."""
        return LocalFrame(self.frame.lat_deg, self.frame.lon_deg, self.frame.alt_msl_m)

    @property
    def airframes_of_agents(self) -> dict[int, AgentAirframe]:
        """Airframe of each vehicle."""
        return {agent.vehicle: self._airframe(agent) for agent in self.agents}

    def airframe_of(self, vehicle: int) -> AgentAirframe:
        """Return the airframe of a vehicle; that of `[airframe]` for one that is no agent."""
        return self._airframe(next((agent for agent in self.agents if agent.vehicle == vehicle), None))

    def airframe_name(self, vehicle: int) -> str:
        """Return the name of a vehicle's airframe; empty for that of `[airframe]`."""
        return next((agent.airframe for agent in self.agents if agent.vehicle == vehicle), "")

    @property
    def default_airframe(self) -> AgentAirframe:
        """Airframe of agents that name none."""
        return self._airframe(None)

    def _airframe(self, agent: AgentTable | None) -> AgentAirframe:
        keys: dict[str, Any] = msgspec.structs.asdict(self.airframe)
        keys |= {name: getattr(self.takeoff, name) for name in ("climb_deg", "ground_run_m")}
        keys |= {name: getattr(self.mission, name) for name in ("accept_radius_m", "loiter_radius_m", "end")}
        if agent is not None and agent.airframe in self.airframes:
            own = msgspec.structs.asdict(self.airframes[agent.airframe])
            keys |= {name: value for name, value in own.items() if value is not None}
        if agent is not None and agent.speed_m_s is not None:
            keys["speed_m_s"] = agent.speed_m_s
        airframe = AgentAirframe(**keys)
        if self.terrain is None or self.elevation is None:
            return airframe
        return airframe.at_height(float(self.elevation.heights_msl_m.max()) + self.terrain.max_agl_m)

    @property
    def speeds_m_s(self) -> dict[int, float]:
        """Airspeed of each vehicle."""
        return {vehicle: airframe.speed_m_s for vehicle, airframe in self.airframes_of_agents.items()}

    def takeoff_altitude_rel_m(self, layer: int) -> float:
        """Return the altitude above home at the end of the climb, for an altitude layer."""
        mission = self.mission
        return self.takeoff.altitude_rel_m or mission.altitude_rel_m + layer * mission.layer_step_m

    @property
    def layer_heights(self) -> LayerHeights:
        """Heights at which routes are flown over level ground, from the end of the climb on."""
        mission = self.mission
        ground_m = self.frame.alt_msl_m
        clearance_m = self.planning.vertical_clearance_m
        if self.terrain is not None:
            return LayerHeights(self.terrain.max_agl_m, -math.inf, ground_m, clearance_m)
        lowest_m = min(mission.altitude_rel_m, self.takeoff.altitude_rel_m or mission.altitude_rel_m)
        return LayerHeights(lowest_m, mission.highest_rel_m, ground_m, clearance_m)

    @property
    def area_limits(self) -> list[VerticalLimits]:
        """Vertical limits of all obstacles, no-fly zones and fence areas that have some."""
        limits = [table.limits for table in (*self.map.obstacles, *self.fence.areas)]
        limits += [zone.limits for zone in self.zones.no_fly]
        return [one for one in limits if not one.are_open]

    @property
    def max_alt_rel_m(self) -> float:
        """Ceiling of the fence above home, with home at the height of the frame's origin; 0 for none."""
        fence = self.fence
        return (
            fence.max_alt_rel_m if fence.max_alt_msl_m is None else fence.max_alt_msl_m - self.frame.alt_msl_m
        )

    @property
    def agents_per_target(self) -> int:
        """Maximum number of agents at one target."""
        return max((birth.agents for birth in self.births), default=1)

    @property
    def spacing_m(self) -> tuple[float, float]:
        """Grid spacing east and north."""
        return self.map.width_m / (self.map.nodes_east - 1), self.map.height_m / (self.map.nodes_north - 1)

    @property
    def elevation_model(self) -> ElevationModel | None:
        """Elevation of the ground, with the file that it is from; None: the ground is flat."""
        return None if self.terrain is None else decode_model(self.terrain.file)

    @property
    def ground(self) -> str:
        """Elevation model and flight band in words, or "flat"."""
        if self.terrain is None:
            return "flat"
        band = f"flight {self.terrain.min_agl_m:g} to {self.terrain.max_agl_m:g} m above it"
        return f"{self.elevation_model}; {band}"

    @property
    def elevation(self) -> Elevation | None:
        """Elevation of the ground under the map and around it; None: the ground is flat."""
        model = self.elevation_model
        return None if model is None else model.elevation

    @property
    def zones(self) -> Zones:
        """No-fly zones and boundary of the GeoJSON, in metres."""
        return read_zones(self.map.geojson, ZONES).to_local(self.local_frame) if self.map.geojson else Zones()
