"""State of perception: trackers, associations, statuses, sensors."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

from gcs.core.perception.input_errors import InputErrors
from gcs.core.perception.out_of_sequence_buffer import OutOfSequenceBuffer
from gcs.core.perception.scan_timing import ScanTiming
from gcs.core.perception.sensor_contradictions import SensorContradictions
from gcs.core.perception.sensor_watchdog import SensorWatchdog
from gcs.model import AgentStatus, Label, VehicleState
from gcs.tracking.glmb.filter_state import GlmbState
from gcs.tracking.models.adaptive_birth import AdaptiveBirthState
from gcs.tracking.models.persistent_detections import PersistentDetections
from gcs.tracking.models.sensor_estimation import SensorEstimation


@dataclass(slots=True)
class ConsecutiveEpochs:
    """Number of consecutive epochs at which a condition held.

    Of several measurements at one epoch the last one counts.
    """

    t_ns: int = -1
    """Last epoch."""
    number: int = 0
    """Up to the last epoch."""
    before: int = 0
    """Before the last epoch."""

    def count(self, measured_t_ns: int, *, holds: bool) -> int:
        """Return the number up to the epoch `measured_t_ns`; 0 if the condition does not hold."""
        if measured_t_ns > self.t_ns:
            self.before = self.number
        self.t_ns = measured_t_ns
        self.number = self.before + 1 if holds else 0
        return self.number


class PositionReport(NamedTuple):
    """Position report of a vehicle."""

    t_ns: int
    east_m: float
    north_m: float
    alt_msl_m: float
    ground_speed_m_s: float
    course_rad: float


@dataclass(slots=True)
class AgentSighting:
    """Inputs of the agent status."""

    awaited_t_ns: int | None = None
    """Time of the first scan without a track or report of the agent; None after the first of these."""
    seen_t_ns: int | None = None
    """Time of the last scan with a track or report of the agent."""
    reported_t_ns: int | None = None
    """Time of the last scan with a report of the agent."""
    position_m: tuple[float, float] | None = None
    """East and north of the last detected track."""
    at_target: ConsecutiveEpochs = field(default_factory=ConsecutiveEpochs)
    """Epochs within the capture radius."""


@dataclass(slots=True)
class Association:
    """Association of a vehicle with an agent track."""

    label: Label | None = None
    """Label of its track."""
    near: Label | None = None
    """Nearest existing track, if it reports and has no association."""
    was_lost: bool = False
    """True if its track was lost at the last update."""
    outside: ConsecutiveEpochs = field(default_factory=ConsecutiveEpochs)
    """Epochs with its report outside the gate of its track."""
    waiting: ConsecutiveEpochs = field(default_factory=ConsecutiveEpochs)
    """Epochs with an existing track near and no association."""


@dataclass(slots=True)
class IntegrityTest:
    """CUSUM test of the reported positions of a vehicle."""

    cusum: float = 0.0
    is_alarmed: bool = False
    t_ns: int | None = None
    """Time of the last check; None if it was not checked for a while."""
    label: Label | None = None
    """Label of its track when its reports were last consistent."""


@dataclass(slots=True)
class ReportedMotion:
    """Motion of a vehicle by its reports."""

    state: VehicleState | None = None
    """Newest report at the last scan."""
    course: tuple[int, float] | None = None
    """Time and course of the report that the turn rate was last taken from."""
    turn_rate_rad_s: float = 0.0


@dataclass(slots=True)
class AgentPerception:
    """What is known of one agent."""

    status: AgentStatus = field(default_factory=partial(AgentStatus, 0, 0, "active"))
    """Active, arrived or lost; `State.initial` sets the vehicle."""
    reached: tuple[Label, ...] = ()
    """Targets that it had reached when an operator continued the mission."""
    sighting: AgentSighting = field(default_factory=AgentSighting)
    association: Association = field(default_factory=Association)
    integrity: IntegrityTest = field(default_factory=IntegrityTest)
    motion: ReportedMotion = field(default_factory=ReportedMotion)
    reports: list[PositionReport] = field(default_factory=list)
    """Position reports of the last seconds, the oldest first."""

    def leave_target(self, t_ns: int, *, has_served: bool) -> AgentStatus:
        """Make an arrived agent active; return the change, with the target that it leaves.

        With `has_served` the target needs no other agent in its place.
        """
        before = self.status
        if has_served and before.target is not None:
            self.reached = (*self.reached, before.target)
        self.status = AgentStatus(t_ns, before.vehicle, "active", None, self.sighting.position_m)
        return replace(self.status, target=before.target)


@dataclass(slots=True)
class ConfirmationState:
    """Confirmation of the tracks of one kind."""

    t_ns: int = -1
    """Last epoch."""
    counts: dict[Label, int] = field(default_factory=dict)
    """Consecutive epochs of each label in the estimate; negative: out of it."""
    counts_before: dict[Label, int] = field(default_factory=dict)
    """The same before the last epoch."""
    confirmed: list[Label] = field(default_factory=list)
    """Labels of the confirmed tracks, in order."""


@dataclass(slots=True)
class TrackerState:
    """Tracker of one kind."""

    filter: GlmbState = field(default_factory=GlmbState)
    confirmation: ConfirmationState = field(default_factory=ConfirmationState)
    adaptive_birth: AdaptiveBirthState = field(default_factory=AdaptiveBirthState)
    is_born: list[bool] = field(default_factory=list)
    """True for each birth component whose first object was confirmed."""
    born_t_ns: int = -1
    """Last epoch with births."""


@dataclass(slots=True)
class UntrackedState:
    """Detections that persist without a track."""

    chains: dict[str, PersistentDetections] = field(default_factory=dict)
    """By sensor."""
    new_m: list[tuple[float, float]] = field(default_factory=list)
    """Positions, east and north, that no alarm has named yet."""
    notice_t_ns: int | None = None
    """Time of the last alarm."""
    is_raised: bool = False
    """True until the all-clear."""


@dataclass(slots=True)
class TrackersState:
    """Trackers of agents and targets."""

    agents: TrackerState = field(default_factory=TrackerState)
    targets: TrackerState = field(default_factory=lambda: TrackerState(GlmbState(rng=1)))
    measured_t_ns: int = -1
    """Measurement time of the last scan."""
    sensors_at_epoch: list[str] = field(default_factory=list)
    """Sensors with a scan of that time."""
    reports_t_ns: int = -1
    """Time at which position reports were last used."""
    slow_reports_t_ns: dict[int, int] = field(default_factory=dict)
    """Time of the last high-latency report that was used, by vehicle."""
    estimations: dict[str, SensorEstimation] = field(default_factory=dict)
    """Estimated model of each sensor, the least recently heard first."""
    contradictions: SensorContradictions = field(default_factory=SensorContradictions)
    untracked: UntrackedState = field(default_factory=UntrackedState)


@dataclass(slots=True)
class PerceptionState:
    """Trackers and sensors."""

    trackers: TrackersState = field(default_factory=TrackersState)
    scan_timing: ScanTiming = field(default_factory=ScanTiming)
    oosm_buffer: OutOfSequenceBuffer = field(default_factory=OutOfSequenceBuffer)
    sensor_watchdog: SensorWatchdog = field(default_factory=SensorWatchdog)
    input_errors: InputErrors = field(default_factory=InputErrors)
    sampled_t_ns: int = 0
    """Time at which position reports were last added to those of the last seconds."""
    never_heard_due_t_ns: int | None = None
    """Time of the check for vehicles that were never heard; None before the first tick."""
    is_never_heard_checked: bool = False
    is_any_missing: bool = False
    """True after the warning, until all are heard."""
