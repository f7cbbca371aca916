"""Frozen records that packages exchange; units are in the names.

Frame: local east/north metres (see `gcs.geo`). Time: integer nanoseconds of the run's clock, since the Unix
epoch, and always an argument. Arrays are float64 and read-only; tuples of tracks are ordered by label.
State order everywhere: ``[east_m, north_m, v_east_m_s, v_north_m_s]``.

Events go into `gcs.core`, effects come out. Both are plain data, so a recording is a list of them. In reading
order: `basics` (labels, time), `sensors` (and their scans), `picture` (tracks, vehicle states), `plans`,
`orders`, `control` (authority over a vehicle), `flight` (its phase and health), `status` (of the swarm),
`notices` (and their table, `notice_codes`), `events`, `effects`, `truth` (simulations), `names`.
"""

from gcs.model.basics import (
    NS_PER_S,
    BoolArray,
    ByteArray,
    Float32Array,
    FloatArray,
    Int16Array,
    Int32Array,
    IntArray,
    KeyArray,
    Kind,
    Label,
    Level,
    UInt16Array,
    UInt32Array,
    array_of_parts,
    array_parts,
    read_only,
)
from gcs.model.control import Authority, AuthorityWord, Claim, Claims, Control, ControlEvent, Suspension
from gcs.model.effects import AgentStatus, Effect, MissionEnded, Send, UploadReport
from gcs.model.events import (
    BadInput,
    ClockStep,
    Datagram,
    Event,
    LinkNews,
    Resumed,
    Snapshot,
    Tick,
)
from gcs.model.flight import PHASE_TRANSITIONS, FlightEvent, FlightPhase, FlightPhaseWord, HealthItem
from gcs.model.names import (
    named,
    network_of,
    system_of,
    target_name,
    target_of,
    targets_text,
    track_name,
    vehicle_id,
    vehicle_name,
    vehicle_of,
)
from gcs.model.notice_codes import NoticeCode
from gcs.model.notices import Notice, NoticeContent, Notify, Subject
from gcs.model.orders import Action, AnswerState, NoFlyZone, Order, OrderAnswer, Proposal, RouteFigures
from gcs.model.picture import Picture, Track, VehicleState
from gcs.model.plans import APPROACH_M, Cause, LandingWait, Mission, Plan, Route, Waypoint
from gcs.model.sensors import Polar, Scan, Sensor, Viewpoint, Visibility
from gcs.model.status import AgentRecord, SensorRecord, SwarmStatus, TargetRecord
from gcs.model.templates import Parameter
from gcs.model.truth import Truth, TruthObject

__all__ = [
    "APPROACH_M",
    "NS_PER_S",
    "PHASE_TRANSITIONS",
    "Action",
    "AgentRecord",
    "AgentStatus",
    "AnswerState",
    "Authority",
    "AuthorityWord",
    "BadInput",
    "BoolArray",
    "ByteArray",
    "Cause",
    "Claim",
    "Claims",
    "ClockStep",
    "Control",
    "ControlEvent",
    "Datagram",
    "Effect",
    "Event",
    "FlightEvent",
    "FlightPhase",
    "FlightPhaseWord",
    "Float32Array",
    "FloatArray",
    "HealthItem",
    "Int16Array",
    "Int32Array",
    "IntArray",
    "KeyArray",
    "Kind",
    "Label",
    "LandingWait",
    "Level",
    "LinkNews",
    "Mission",
    "MissionEnded",
    "NoFlyZone",
    "Notice",
    "NoticeCode",
    "NoticeContent",
    "Notify",
    "Order",
    "OrderAnswer",
    "Parameter",
    "Picture",
    "Plan",
    "Polar",
    "Proposal",
    "Resumed",
    "Route",
    "RouteFigures",
    "Scan",
    "Send",
    "Sensor",
    "SensorRecord",
    "Snapshot",
    "Subject",
    "Suspension",
    "SwarmStatus",
    "TargetRecord",
    "Tick",
    "Track",
    "Truth",
    "TruthObject",
    "UInt16Array",
    "UInt32Array",
    "UploadReport",
    "VehicleState",
    "Viewpoint",
    "Visibility",
    "Waypoint",
    "array_of_parts",
    "array_parts",
    "named",
    "network_of",
    "read_only",
    "system_of",
    "target_name",
    "target_of",
    "targets_text",
    "track_name",
    "vehicle_id",
    "vehicle_name",
    "vehicle_of",
]
