"""The mission file as one value."""

from __future__ import annotations

from typing import Annotated, Any

from msgspec import Meta

from gcs.config.airframe import AirframeTable
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
    TrackingTable,
    link_of,
)
from gcs.config.validation import Table
from gcs.endpoints import Link
from gcs.geo import LocalFrame
from gcs.geojson import Zones, read_zones

ZONES = "the GeoJSON of the map"


class Config(Table, frozen=True, kw_only=True):
    """A mission file."""

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
    description: str = ""
    frame: FrameTable
    map: MapTable = MapTable()
    agents: Annotated[list[AgentTable], Meta(min_length=1)]
    births: list[BirthTable] = []
    tracking: TrackingTable = TrackingTable()
    telemetry: TelemetryTable = TelemetryTable()
    airframe: AirframeTable = AirframeTable()
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
    def speeds_m_s(self) -> dict[int, float]:
        """Airspeed of each vehicle: its own, or that of the airframe."""
        return {agent.vehicle: agent.speed_m_s or self.airframe.speed_m_s for agent in self.agents}

    def takeoff_altitude_rel_m(self, layer: int) -> float:
        """Return the altitude above home at the end of the climb, for an altitude layer."""
        mission = self.mission
        return self.takeoff.altitude_rel_m or mission.altitude_rel_m + layer * mission.layer_step_m

    @property
    def agents_per_target(self) -> int:
        """Maximum number of agents at one target."""
        if self.planning.surplus == "double":
            return len(self.agents)
        return max((birth.agents for birth in self.births), default=1)

    @property
    def spacing_m(self) -> tuple[float, float]:
        """Grid spacing east and north."""
        return self.map.width_m / (self.map.nodes_east - 1), self.map.height_m / (self.map.nodes_north - 1)

    @property
    def zones(self) -> Zones:
        """No-fly zones and boundary of the GeoJSON, in metres."""
        return read_zones(self.map.geojson, ZONES).to_local(self.local_frame) if self.map.geojson else Zones()
