"""Construction of the stages of the engine, in the order in which they depend on each other.

A stage is a small class without state of its own. It gets the parts of the state that it may change.
"""

from __future__ import annotations

from pymavlink.dialects.v20.ardupilotmega import (
    MAVLINK_MSG_ID_PARAM_VALUE,
    MAVLINK_MSG_ID_TERRAIN_REQUEST,
)

from gcs.config import Config
from gcs.core.airspace.ground_proximity import GroundProximity
from gcs.core.airspace.incursion_warning import IncursionWarnings
from gcs.core.airspace.mission_bounds import MissionBoundsCheck
from gcs.core.airspace.no_fly_zones import NoFlyZones
from gcs.core.airspace.obstacle_map import mission_map
from gcs.core.airspace.terrain_service import TerrainService
from gcs.core.authority.disarmed_in_auto import DisarmedInAuto
from gcs.core.authority.external_uploads import ExternalUploads
from gcs.core.authority.onboard_audit import OnboardAudit
from gcs.core.authority.override_notices import OverrideNotices
from gcs.core.authority.parameter_changes import ParameterChanges
from gcs.core.authority.second_commander import SecondCommander
from gcs.core.flight.failsafes import Failsafes
from gcs.core.flight.health import HealthMonitor
from gcs.core.flight.phases import FlightPhases
from gcs.core.operator.no_fly_zone_orders import NoFlyZoneOrders
from gcs.core.operator.plan_approval import PlanApproval
from gcs.core.operator.ready_orders import ReadyOrders
from gcs.core.operator.status_report import StatusReport
from gcs.core.operator.target_orders import TargetOrders
from gcs.core.operator.vehicle_orders import Orders
from gcs.core.perception.arrival_and_loss import AgentStatusMonitor
from gcs.core.perception.fusion import MultiSensorTracker
from gcs.core.perception.position_integrity import PositionIntegrityMonitor
from gcs.core.perception.report_history import ReportHistory
from gcs.core.perception.track_to_vehicle import TrackVehicleAssociation
from gcs.core.perception.vehicle_kinematics import VehicleKinematics
from gcs.core.preflight.return_heights import ReturnHeightMonitor
from gcs.core.replanning.input_builder import PlanningInputBuilder
from gcs.core.replanning.replanner import Replanner
from gcs.core.replanning.return_routes import ReturnRoutes
from gcs.core.replanning.stacked_missions import StackedMissions
from gcs.core.separation.aircraft import AirTraffic
from gcs.core.separation.avoidance import Avoidances
from gcs.core.separation.climb_traffic import ClimbTraffic
from gcs.core.separation.intents import Intents
from gcs.core.separation.landing_order import LandingOrder
from gcs.core.separation.mission_traffic import MissionTraffic
from gcs.core.separation.monitor import SeparationMonitor
from gcs.core.separation.order_check import OrderCheck
from gcs.core.state import State
from gcs.core.takeoff.climbs import Climbs
from gcs.core.takeoff.sequence import TakeoffSequence
from gcs.core.tasking.dispatch import Dispatch
from gcs.core.tasking.onboard_missions import OnboardMissions
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.fleet.checks.link_timeouts import STALE_PERIODS
from gcs.mavlink.fleet.fleet import TRAFFIC, Fleet, FleetSettings
from gcs.model import NS_PER_S, VehicleState


class Stages:
    """All stages of the engine, connected.

    Parameters
    ----------
    config : Config
        The mission.
    seed : int
        Seed of the map's random obstacles.
    state : State
        State that they change.

    Raises
    ------
    ValueError
        If the state is damaged, or of another mission.
    """

    def __init__(self, config: Config, seed: int, state: State) -> None:
        vehicles = [agent.vehicle for agent in config.agents]
        if list(state.agents) != vehicles:
            raise ValueError("the state is of other vehicles than the mission")
        self.config = config
        self.state = state
        agents = state.agents
        tracking = config.tracking
        telemetry = config.telemetry
        links = config.mavlink_links
        self.needs_approval = config.planning.retask == "confirm"
        self.expected_targets = len(config.births)
        self.reorder_window_s = tracking.reorder_window_s
        self._max_report_age_ns = int(telemetry.max_age_s * NS_PER_S)
        self.no_fly_zones = NoFlyZones(self.state.airspace, mission_map(config, seed))
        self.fleet = Fleet(
            vehicles,
            config.local_frame,
            FleetSettings(
                position_rate_hz=telemetry.rate_hz,
                max_speed_m_s=max(one.max_ground_speed_m_s for one in config.airframes_of_agents.values()),
                checks_signatures=bool(config.links.keys),
                extra_ids=(MAVLINK_MSG_ID_PARAM_VALUE, MAVLINK_MSG_ID_TERRAIN_REQUEST, *TRAFFIC),
            ),
            links=[link for link in links if link.role == "vehicles"],
            state=self.state.fleet,
            vehicle_links={vehicle: agent.link for vehicle, agent in agents.items()},
        )
        self.terrain = TerrainService(config, self.fleet, agents)
        self.external_uploads = ExternalUploads(links, agents, self.state.authority)
        self.parameter_changes = ParameterChanges(config, agents, links)
        # Perception
        perception = self.state.perception
        self.scan_timing = perception.scan_timing
        self.oosm_buffer = perception.oosm_buffer
        self.sensor_watchdog = perception.sensor_watchdog
        self.input_errors = perception.input_errors
        self.report_history = ReportHistory(agents, perception)
        self.trackers = MultiSensorTracker(config, perception.trackers)
        self.association = TrackVehicleAssociation(
            agents, tracking.gate_chi2, telemetry.noise_std_m, telemetry.max_age_s
        )
        self.position_integrity = PositionIntegrityMonitor(agents, telemetry)
        self.kinematics = VehicleKinematics(agents, telemetry.max_age_s)
        self.agent_status = AgentStatusMonitor(agents, self.no_fly_zones, config.planning.capture_radius_m)
        # Separation
        self.return_heights = ReturnHeightMonitor(config, self.fleet, agents)
        self.intents = Intents(config, self.fleet, agents, self.return_heights)
        self.air_traffic = AirTraffic(config, self.fleet, self.state.separation)
        order_check = OrderCheck(config, self.intents, self.air_traffic, self.no_fly_zones)
        self.mission_traffic = MissionTraffic(order_check, agents, self.state.tasking, self.state.separation)
        # Planning and tasking
        self.replanner = Replanner(config, self.no_fly_zones, agents, self.state.replanning)
        landing_order = LandingOrder(config, self.fleet, agents)
        self.return_routes = ReturnRoutes(config, self.no_fly_zones, self.fleet, agents, landing_order)
        self.climbs = Climbs(config, self.no_fly_zones, self.fleet, agents)
        traffic = ClimbTraffic(config, self.intents, self.climbs, self.replanner.layers, agents)
        missions = OnboardMissions(self.fleet, agents)
        self.takeoff_sequence = TakeoffSequence(config, self.fleet, missions, self.state, traffic)
        self.tasking = UploadManager(
            config,
            self.fleet,
            agents,
            self.state.tasking,
            self.climbs,
            MissionBoundsCheck(config, self.no_fly_zones),
            self.takeoff_sequence,
            self.mission_traffic,
        )
        stacked_missions = StackedMissions(
            config,
            self.no_fly_zones,
            self.fleet,
            agents,
            self.tasking,
            self.replanner.layers,
            self.return_routes,
            order_check,
        )
        self.avoidances = Avoidances(
            config,
            self.fleet,
            agents,
            self.tasking,
            order_check,
            landing_order,
            self.air_traffic,
            stacked_missions,
        )
        self.separation = SeparationMonitor(
            config, self.intents, self.return_heights, self.avoidances, self.air_traffic, self.state
        )
        self.ground_proximity = GroundProximity(config, self.intents, self.state)
        self.flight_phases = FlightPhases(
            config, self.fleet, agents, self.tasking.onboard_missions, self.state.flight
        )
        self.health = HealthMonitor(config, self.fleet, agents, self.state.flight)
        self.failsafes = Failsafes(agents)
        self.approval = PlanApproval(config, self.no_fly_zones, self.replanner, agents, self.state.operator)
        self.dispatch = Dispatch(
            self.return_routes, self.approval, self.tasking, agents, self.external_uploads
        )
        # Orders and control authority
        self.orders = Orders(
            self.state,
            self.fleet,
            self.tasking,
            self.replanner.layers,
            self.takeoff_sequence,
            order_check,
            landing_order,
            stacked_missions,
        )
        self.incursions = IncursionWarnings(
            self.state.airspace, self.tasking.onboard_missions, config.local_frame
        )
        self.no_fly_zone_orders = NoFlyZoneOrders(
            self.no_fly_zones,
            self.state,
            self.fleet,
            self.replanner,
            self.return_routes,
            self.incursions,
            stacked_missions,
            self.needs_approval,
        )
        self.target_orders = TargetOrders(
            agents, self.state.operator, self.trackers.targets.confirmation, self.replanner
        )
        self.ready_orders = ReadyOrders(agents, self.fleet, self.flight_phases)
        self.disarmed_in_auto = DisarmedInAuto(agents, self.state.authority, self.fleet, self.tasking)
        self.onboard_audit = OnboardAudit(agents, self.fleet, self.tasking)
        authority = self.state.authority
        self.second_commander = SecondCommander(agents, self.fleet, self.tasking, authority)
        self.override_notices = OverrideNotices(
            agents, authority, self.tasking.overrides, self.orders, self.failsafes, self.fleet
        )
        self.planning_inputs = PlanningInputBuilder(
            agents,
            self.state.operator,
            config.local_frame,
            self.fleet,
            self.trackers,
            self.kinematics,
            self.tasking,
            self.replanner,
        )
        self.status_report = StatusReport(
            self.state,
            self.fleet,
            self.trackers,
            self.replanner.layers,
            self.tasking,
            config.ground,
            config.elevation,
        )

    def max_age_ns(self, state: VehicleState) -> int:
        """Return the age up to which a vehicle's last report shows that it is there."""
        return max(self._max_report_age_ns, round(STALE_PERIODS * state.period_s * NS_PER_S))
