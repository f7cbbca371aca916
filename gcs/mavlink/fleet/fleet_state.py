"""State of the fleet: what telemetry, addresses and links tell."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import AutopilotProfile, profile_of
from gcs.mavlink.fleet.checks.battery_alarm import BatteryAlarm
from gcs.mavlink.fleet.checks.position_checks import BootClock
from gcs.mavlink.fleet.checks.position_plausibility import DuplicateIdDetector, MotionCheck
from gcs.mavlink.fleet.checks.report_consistency import ReportConsistency
from gcs.mavlink.fleet.high_latency import HighLatency
from gcs.mavlink.fleet.link_stats import LinkCounters, RadioReport, UnknownSystems
from gcs.mavlink.fleet.notice_queue import NoticeQueue
from gcs.mavlink.fleet.own_ids import OwnIds
from gcs.mavlink.fleet.peers import Address, Peers
from gcs.mavlink.fleet.standby_link import StandbyLink
from gcs.mavlink.fleet.statustext import TextChunks
from gcs.mavlink.fleet.stream_requests import StreamRecord
from gcs.mavlink.fleet.telemetry_table import ADDRESS, DUE_NS, NO_ADDRESS, NONE, new_table
from gcs.mavlink.mission.items import Home
from gcs.model import IntArray

Liveness: TypeAlias = Literal["waiting", "alive", "stale", "down"]
"""Not heard yet, heard, late, or not heard for so long that another address may be its own."""


@dataclass(slots=True)
class ModeRecord:
    """Modes that one vehicle showed, and that we commanded (`gcs.mavlink.fleet.mode_authority`)."""

    mode: str = ""
    """Mode of the last heartbeat; empty before the first."""
    previous: str = ""
    """Mode before that."""
    commanded: str = ""
    """Mode that we commanded last; empty if another was chosen since."""
    tasked: bool = False
    """True if the vehicle was in AUTO, or was commanded to it."""
    has_ended: bool = False
    """True if the vehicle is in RTL because its mission is complete."""
    in_failsafe: bool = False
    """True if the last heartbeat showed a failsafe (MAV_STATE_CRITICAL or worse)."""
    failsafe_t_ns: int = 0
    """Time of the first heartbeat that showed it."""


@dataclass(slots=True)
class PositionChecks:
    """Checks of one vehicle's position reports."""

    clock: BootClock = field(default_factory=BootClock)
    motion: MotionCheck = field(default_factory=MotionCheck)
    duplicates: DuplicateIdDetector = field(default_factory=DuplicateIdDetector)
    consistency: ReportConsistency = field(default_factory=ReportConsistency)
    positions: int = 0
    """Accepted positions that the checks have processed."""
    has_no_position: bool = False
    """True after the notice that no position is accepted for a while."""
    refused: dict[str, int] = field(default_factory=dict)
    """Refused position reports, by reason."""


@dataclass(slots=True)
class VehicleLink:
    """Link and telemetry of one vehicle; more is in its row of the telemetry table."""

    address: Address | None = None
    liveness: Liveness = "waiting"
    returns: int = 0
    """Times that it was heard again after its link was down."""
    conflicts: int = 0
    """Frames that used its id from another address."""
    claimed_t_ns: int | None = None
    """Time of the last such frame; None after a while without one."""
    signed_lead_ns: int | None = None
    """Signing time of the heartbeat that set the address, less our time; None if unsigned."""
    sequence: int = 0
    """Sequence number of our next frame to it."""
    autopilot: int = dialect.MAV_AUTOPILOT_INVALID
    """MAV_AUTOPILOT; invalid before its first heartbeat."""
    vehicle_type: int = dialect.MAV_TYPE_GENERIC
    boots: int = 0
    """Reboots seen."""
    mode: str = ""
    """Empty before its first heartbeat."""
    armed: bool = False
    system_status: int = dialect.MAV_STATE_UNINIT
    """MAV_STATE of its last heartbeat."""
    wind_m_s: tuple[float, float] | None = None
    """Velocity of the air that it estimates, east and north; None before it reports one."""
    mission_seq: int = -1
    """Current mission item; -1 if unknown."""
    home: Home | None = None
    checks: PositionChecks = field(default_factory=PositionChecks)
    battery: BatteryAlarm = field(default_factory=BatteryAlarm)
    requests: StreamRecord = field(default_factory=StreamRecord)
    texts: TextChunks = field(default_factory=TextChunks)
    returned_t_ns: int = 0
    """Time at which it was last heard again after its link was down."""

    last_link_t_ns: int = 0
    """Time of its last frame before its last change of link."""
    last_link_boot_ms: int = NONE
    """Its newest time since boot then; NONE if unknown."""
    standby: StandbyLink | None = None
    """Second link on which it is heard; None without one."""
    high_latency: HighLatency | None = None
    """Its reports while it is heard by HIGH_LATENCY2 alone; None with usual telemetry."""
    is_awaited: bool = False
    """True after a restart until its next heartbeat: its mode is not known."""

    @property
    def profile(self) -> AutopilotProfile | None:
        """Profile of the firmware; None before the first heartbeat, or if unknown."""
        return profile_of(self.autopilot, self.vehicle_type)

    @property
    def has_telemetry(self) -> bool:
        """True if it is heard, and not by HIGH_LATENCY2 alone."""
        return self.liveness == "alive" and self.high_latency is None

    @property
    def is_atomic(self) -> bool:
        """True if the firmware is known and replaces a mission as a whole."""
        profile = self.profile
        return profile is not None and profile.atomic

    def begin_again(self) -> None:
        """Count the vehicle as not heard until its next frame, from whatever address."""
        self.is_awaited = self.address is not None
        self.standby = None
        if self.liveness != "waiting":
            self.liveness = "down"


@dataclass(slots=True)
class FleetState:
    """Telemetry table of all vehicles, links and addresses."""

    table: IntArray = field(default_factory=lambda: new_table(0))
    """A row for each vehicle, by system id (`gcs.mavlink.fleet.telemetry_table`)."""
    links: dict[str, LinkCounters] = field(default_factory=dict)
    """By link, in order of the first datagram."""
    radios: dict[str, RadioReport] = field(default_factory=dict)
    """By link, of those whose radio reports its signal."""
    peers: Peers = field(default_factory=Peers)
    sequences: dict[Address, int] = field(default_factory=dict)
    """Sequence number of our next heartbeat to each outgoing endpoint and stand-by link."""
    unknown_systems: UnknownSystems = field(default_factory=UnknownSystems)
    notices: NoticeQueue = field(default_factory=NoticeQueue)
    own_ids: OwnIds = field(default_factory=OwnIds)

    def begin_again(self) -> None:
        """Forget which addresses are heard now; become another instance."""
        self.own_ids = OwnIds()
        self.table[:, ADDRESS] = NO_ADDRESS
        self.table[:, DUE_NS] = 0
