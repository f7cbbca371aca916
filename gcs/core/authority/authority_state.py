"""State of control authority: overrides, missions of other ground stations, audits."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.core.tasking.tasking_state import OnboardMission
from gcs.mavlink.fleet.fleet_state import ModeRecord
from gcs.mavlink.mission.item_transfer import MissionDownload
from gcs.mavlink.services.command_sender import CommandSender
from gcs.mavlink.services.retransmission_timeout import RttEstimator
from gcs.model import Label


@dataclass(slots=True)
class ExternalUpload:
    """Upload of another ground station to one vehicle."""

    sender: tuple[int, int]
    """System and component id."""
    station: str
    """Name for operators."""
    heard_t_ns: int
    """Time of its last frame."""
    has_ended: bool = False


@dataclass(slots=True)
class Audit:
    """Audit of one vehicle's onboard mission."""

    mission: OnboardMission
    """Mission that it should store."""
    began_t_ns: int
    known_t_ns: int
    """Time at which the vehicle was last known to store the mission."""
    rtt: RttEstimator
    download: MissionDownload


@dataclass(slots=True)
class ParameterSet:
    """PARAM_SET of another ground station that has not been reported yet."""

    station: str
    """Name for operators."""
    value: float
    t_ns: int
    before: float | None = None
    """Value before; None if it was never heard."""
    answer: float | None = None
    """Value in the vehicle's answer; None before it."""


@dataclass(slots=True)
class ParameterRecord:
    """Parameters of one vehicle, as far as they were heard."""

    values: dict[str, float] = field(default_factory=dict)
    sets: dict[str, ParameterSet] = field(default_factory=dict)
    """PARAM_SET to report, by name."""
    reported_t_ns: dict[str, int] = field(default_factory=dict)
    """Time of the last notice about a parameter, by name."""


@dataclass(slots=True)
class CommanderWatch:
    """Answers of one vehicle to requests that another service with our ids sent."""

    asked_t_ns: dict[int, int] = field(default_factory=dict)
    """Time of our last request, by command; 0 for the mission protocol."""
    heard_since_t_ns: int | None = None
    """Time since which the vehicle is heard without a link loss; None before its first answer."""
    returns: int = 0
    """Ends of link losses until then."""
    unasked: int = 0
    """Answers to requests that were not ours, without a long gap."""
    unasked_t_ns: int = 0
    """Time of the last one."""
    sequence: int = -1
    """Its sequence number."""
    is_tolerated: bool = False
    """True if an operator resumed the vehicle, and the other service has not ended since."""
    is_reported: bool = False
    """True if the operator was warned that the other service goes on."""


@dataclass(slots=True)
class StoredMission:
    """Number of items that a vehicle reports to store, compared with its verified mission."""

    mission_id: int = -1
    """Number of the verified mission; -1 before the first."""
    is_matched: bool = False
    """True if a report has agreed with it."""
    opaque_id: int = 0
    """Identity of the stored mission that the vehicle reported then; 0 if it reports none."""
    differs_t_ns: int | None = None
    """Time since which the reports differ; None if they agree."""
    reports: int = 0
    """Reports since then."""


@dataclass(slots=True)
class AgentAuthority:
    """Control authority over one vehicle, besides its `gcs.model.Control`."""

    mode: ModeRecord = field(default_factory=ModeRecord)
    mission_state: int | None = None
    """Last MISSION_CURRENT.mission_state; None before the first."""
    reported_mode: str = ""
    """Overriding mode that the operator was notified of; empty without one."""
    is_reported: bool = False
    """True after a notice that another controls the vehicle, until the one that it is ours again."""
    external_upload: ExternalUpload | None = None
    """Last upload of another ground station, until the vehicle is released."""
    audit: Audit | None = None
    """Audit in progress."""
    returns: int = 0
    """Ends of link losses after which the onboard mission was audited."""
    heard_t_ns: int | None = None
    """Time of the last message; None before the first."""
    loiter: CommandSender | None = None
    """Command that sets the disarmed vehicle from AUTO to LOITER."""
    stays_in_auto: bool = False
    """True if that command failed."""
    commander: CommanderWatch = field(default_factory=CommanderWatch)
    stored: StoredMission = field(default_factory=StoredMission)
    parameters: ParameterRecord = field(default_factory=ParameterRecord)


@dataclass(slots=True)
class AuthorityState:
    """What belongs to no single vehicle."""

    reports_t_ns: dict[tuple[int, tuple[int, int], str], int] = field(default_factory=dict)
    """Time of the last notice of a message of another station, by vehicle (0: all), sender and name."""
    disarmed_check_t_ns: int = 0
    """Time of the next check for disarmed vehicles in AUTO."""
    override_check_t_ns: int = 0
    """Time of the next check for overridden vehicles."""
    watched_from_t_ns: int | None = None
    """Time from which answers are ours or another service's; None before the first event."""
    known_targets: tuple[Label, ...] = ()
    """Open targets at the end of the mission, and those that were reported since."""
