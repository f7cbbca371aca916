"""State of control authority: overrides, missions of other ground stations, audits."""

from __future__ import annotations

from dataclasses import dataclass, field

from gcs.core.tasking.records import OnboardMission
from gcs.mavlink.fleet.records import ModeRecord
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
class AgentAuthority:
    """Control authority over one vehicle, besides its `gcs.model.Control`."""

    mode: ModeRecord = field(default_factory=ModeRecord)
    mission_state: int | None = None
    """Last MISSION_CURRENT.mission_state; None before the first."""
    reported_mode: str = ""
    """Overriding mode that the operator was notified of; empty without one."""
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


@dataclass(slots=True)
class AuthorityState:
    """What belongs to no single vehicle."""

    reports_t_ns: dict[tuple[int, tuple[int, int], str], int] = field(default_factory=dict)
    """Time of the last notice of a message of another station, by vehicle (0: all), sender and name."""
    disarmed_check_t_ns: int = 0
    """Time of the next check for disarmed vehicles in AUTO."""
    override_check_t_ns: int = 0
    """Time of the next check for overridden vehicles."""
    known_targets: tuple[Label, ...] = ()
    """Open targets at the end of the mission, and those that were reported since."""
