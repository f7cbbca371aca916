"""Every notice of the service: code, level, subject, text, what it means, and what to do.

This table is the only place with the words of notices. The alarms page of the documentation and of the
console are made from it (`gcs.report.alarms_page`); programs use the code, the subject and the parameters.

A text is a template (`gcs.model.templates`).

A condition begins with a warning or an alarm, and ends with the notice whose `ends` names its code, about the
same subject. Parameters in `by` belong to its identity: two parameters of one vehicle are two conditions.
A notice that ends one of several conditions names its code in the parameter `condition`.
"""

from __future__ import annotations

from functools import partial
from typing import Final, Literal, TypeAlias

from gcs.model.basics import Level
from gcs.model.code_table import Entry, TableCode

About: TypeAlias = Literal["vehicle", "sensor", "link", "mission"]
"""Kind of a notice's subject; "link" also stands for outputs and parts of the service."""

_A: Final[Level] = "alarm"
_W: Final[Level] = "warning"
_I: Final[Level] = "info"


def _entry(
    about: About,
    code: str,
    level: Level,
    text: str,
    meaning: str = "",
    action: str = "",
    *,
    ends: str = "",
    by: str = "",
) -> Entry:
    """Return the entry of a code; `ends` and `by` are words with spaces between."""
    texts = {"text": text, "meaning": meaning, "action": action}
    return code, {
        "level": level,
        "about": about,
        "ends": tuple(ends.split()),
        "by": tuple(by.split()),
    } | texts


_vehicle = partial(_entry, "vehicle")
_sensor = partial(_entry, "sensor")
_link = partial(_entry, "link")
_mission = partial(_entry, "mission")
_RESUME: Final = "`gcs order resume --vehicle {vehicle}`"
_IN_FLIGHT: Final = (
    "sinks gps-problem gps-position-problem estimate-problem propulsion-problem battery-problem "
    "airspeed-problem rc-problem fence-problem wind-problem"
)
"""Conditions of a flight, which end with it."""
_READY: Final = "`gcs order ready --vehicle {vehicle}`"


class NoticeCode(TableCode):
    """Identity of an alarm, a warning or a piece of information. Its value is stable."""

    level: Level
    about: About
    text: str
    """Template of the text."""
    meaning: str
    action: str
    """What the operator should do; empty if nothing."""
    ends: tuple[str, ...]
    """Codes of the conditions that this notice ends, of the same subject."""
    by: tuple[str, ...]
    """Parameters that, with code and subject, identify a condition."""

    @classmethod
    def _missing_(cls, _value: object) -> NoticeCode:
        """Return the code that stands for one of a later version."""
        return cls.UNKNOWN

    @property
    def ended(self) -> tuple[NoticeCode, ...]:
        """Conditions that this notice ends, of the same subject."""
        return tuple(NoticeCode.__members__[code.upper().replace("-", "_")] for code in self.ends)

    # ------------------------------------------------------------ is a vehicle heard?

    NOT_HEARD_YET = _mission(
        "not-heard-yet",
        _W,
        "{vehicles:agents} not heard yet: on, with this system id, and sending to this machine?",
        "an agent was not heard in the first 10 s",
        "check power, system id, `links.mavlink`; run `gcs preflight`",
    )
    ALL_HEARD = _mission("all-heard", _I, "all agents are heard", ends="not-heard-yet")
    LINK_STALE = _vehicle(
        "link-stale",
        _W,
        "not heard for {silence_s:.1f} s",
        "no frame of its autopilot for 2.5 s",
        "watch; normal on a weak radio",
    )
    LINK_DOWN = _vehicle(
        "link-down",
        _A,
        "link down: not heard for {silence_s:.1f} s",
        "no frame for 5 s. It flies its verified mission, or its failsafe acts",
        "check radio, power, range",
    )
    HEARD_AGAIN = _vehicle(
        "heard-again", _I, "heard again after {silence_s:.1f} s", ends="link-stale link-down"
    )
    HIGH_LATENCY = _vehicle(
        "high-latency",
        _W,
        "heard by HIGH_LATENCY2 only: it flies its verified mission and gets no other",
        "no position for 2.5 s, and a high-latency report: its radio is down, its satellite link is not",
        "watch; check radio, power, range",
    )
    HIGH_LATENCY_OVER = _vehicle(
        "high-latency-over", _I, "heard by usual telemetry again", ends="high-latency"
    )
    IN_CONTACT = _vehicle("in-contact", _I, "in contact: {peer} on {link}")
    ADDRESS_CHANGED = _vehicle(
        "address-changed", _I, "moved: {peer} on {link}", "after a loss it is heard from another address"
    )
    STANDBY_LINK = _vehicle("standby-link", _I, "has a stand-by link: {peer} on {link}", ends="standby-down")
    STANDBY_DOWN = _vehicle(
        "standby-down",
        _W,
        "its stand-by link is silent: {peer} on {link}",
        "no frame on its second link for 5 s: if the link in use fails, no other takes over",
        "check that link",
    )
    REBOOTED = _vehicle("rebooted", _A, "rebooted", "its time since boot started again", "read its log")
    AGENT_LOST = _vehicle(
        "agent-lost", _A, "lost", "neither sensors nor reports show it", "look for it where it was last shown"
    )
    AGENT_BACK = _vehicle(
        "agent-back",
        _W,
        "is back",
        "it counted as lost or down, and is active again",
        ends="agent-lost agent-down came-down",
    )
    AGENT_DOWN = _vehicle(
        "agent-down", _A, "down", "its status after it came to the ground elsewhere than by a planned landing"
    )
    MESSAGE_REFUSED = _vehicle(
        "message-refused",
        _W,
        "does not give {messages}",
        "it refused a message that the service needs",
        "check stream rates (`SR*_`) and firmware",
    )
    FIRMWARE_UNKNOWN = _vehicle(
        "firmware-unknown",
        _A,
        "MAV_AUTOPILOT {autopilot} on MAV_TYPE {vehicle_type}: a firmware not known here; it is tracked "
        "and never tasked",
        "neither ArduPilot nor PX4",
        "remove it from the mission, or add a profile",
    )
    MODE_CHANGED = _vehicle("mode-changed", _I, "mode {before} -> {mode}", ends="auto-on-ground")
    ARMED = _vehicle("armed", _I, "armed")
    DISARMED = _vehicle("disarmed", _I, "disarmed", ends="battery-low battery-critical")

    # ------------------------------------------------------------ does it fly?

    CAME_DOWN = _vehicle(
        "came-down",
        _A,
        "came down while {phase}[ ({causes})], at {lat_deg:.6f}, {lon_deg:.6f}[; its target {target} needs "
        "another vehicle]. Recover it; once it can fly again: " + _READY,
        "it stands on the ground elsewhere than after a planned landing. Its target goes to another vehicle",
        "recover it; disarm it if it is armed; `gcs order ready` when it can fly again",
        ends=_IN_FLIGHT,
    )
    LANDED = _vehicle(
        "landed",
        _I,
        "has landed: it gets no mission until " + _READY,
        "a planned landing",
        "`gcs order ready` before its next flight",
        ends=_IN_FLIGHT,
    )
    TAKEOFF_ENDED = _vehicle(
        "takeoff-ended",
        _I,
        "is on the ground again: problems that it had in its take-off are not watched there",
        "the take-off ended before the vehicle was 10 m high",
        "find the cause of the problems before its next take-off",
        ends=_IN_FLIGHT,
    )
    SINKS = _vehicle(
        "sinks",
        _A,
        "sinks at {sink_m_s:.0f} m/s: {height_m:.0f} m above home[, {planned_m:.0f} m planned]; on the "
        "ground in {down_s:.0f} s. Let a pilot take it over, or prepare to recover it",
        "it sinks 15 m below its planned height without having been told to, or faster than 8 m/s in a "
        "mode of the autopilot",
        "a pilot takes it over; else see where it comes down",
    )
    SINKS_NO_LONGER = _vehicle(
        "sinks-no-longer", _I, "no longer sinks: {height_m:.0f} m above home", ends="sinks"
    )
    IN_AIR_AFTER_ALL = _vehicle(
        "in-air-after-all",
        _W,
        "is in the air after all: it is tracked and tasked again",
        "it counted as down, and flies",
        "watch it",
        ends="came-down agent-down",
    )
    GPS_PROBLEM = _vehicle(
        "gps-problem",
        _A,
        "GPS: {cause}",
        "GPS_RAW_INT shows no 3D fix: it flies by its inertial estimate, and its position drifts. Or a "
        "glitch: the estimator rejects a position that jumps. After 5 s it is unfit",
        "return it by hand if it stays",
    )
    GPS_GOOD = _vehicle("gps-good", _I, "GPS: good again", ends="gps-problem")
    GPS_POSITION_PROBLEM = _vehicle(
        "gps-position-problem",
        _A,
        "GPS position: {cause}",
        "GPS glitch: EKF_STATUS_REPORT (ArduPlane) or ESTIMATOR_STATUS (PX4) flags it. After 5 s it is unfit",
        "return it by hand if it stays; interference or spoofing?",
    )
    GPS_POSITION_GOOD = _vehicle(
        "gps-position-good", _I, "GPS position: good again", ends="gps-position-problem"
    )
    ESTIMATE_PROBLEM = _vehicle(
        "estimate-problem",
        _A,
        "estimate: {cause}",
        "EKF or estimator flags, or the health bits of AHRS and position control. It is unfit",
        "let a pilot take it over",
    )
    ESTIMATE_GOOD = _vehicle("estimate-good", _I, "estimate: good again", ends="estimate-problem")
    PROPULSION_PROBLEM = _vehicle(
        "propulsion-problem",
        _A,
        "propulsion: {cause}",
        "no thrust. It is unfit",
        "it comes down: prepare to recover it",
    )
    PROPULSION_GOOD = _vehicle("propulsion-good", _I, "propulsion: good again", ends="propulsion-problem")
    BATTERY_PROBLEM = _vehicle(
        "battery-problem",
        _A,
        "battery: {cause}",
        "empty, faulty, below 15 %, or, by its use in this flight, too little for its route and the way "
        "back. It is unfit",
        "return it, or accept the loss",
    )
    BATTERY_GOOD = _vehicle("battery-good", _I, "battery: good again", ends="battery-problem")
    AIRSPEED_PROBLEM = _vehicle(
        "airspeed-problem", _W, "airspeed: {cause}", "it flies without airspeed", "watch speed in wind"
    )
    AIRSPEED_GOOD = _vehicle("airspeed-good", _I, "airspeed: good again", ends="airspeed-problem")
    RC_PROBLEM = _vehicle(
        "rc-problem", _W, "RC receiver: {cause}", "the pilot cannot take it over", "check the transmitter"
    )
    RC_GOOD = _vehicle("rc-good", _I, "RC receiver: good again", ends="rc-problem")
    FENCE_PROBLEM = _vehicle(
        "fence-problem",
        _A,
        "fence: {cause}",
        "the autopilot acts by FENCE_ACTION or GF_ACTION",
        "see which way it flies",
    )
    FENCE_GOOD = _vehicle("fence-good", _I, "fence: good again", ends="fence-problem")
    WIND_PROBLEM = _vehicle(
        "wind-problem",
        _W,
        "wind: {cause}",
        "wind above `airframe.wind_m_s`; where that is 0, above 30 % of the airspeed",
        "routes may be flown into obstacles: return, or raise the key",
    )
    WIND_GOOD = _vehicle("wind-good", _I, "wind: good again", ends="wind-problem")
    BATTERY_LOW = _vehicle(
        "battery-low", _W, "battery low: {charge_percent} %", "armed, below 30 %", "return or land it"
    )
    BATTERY_CRITICAL = _vehicle(
        "battery-critical",
        _A,
        "battery critical: {charge_percent} %",
        "armed, below 15 %",
        "return or land it",
    )
    BATTERY_RISEN = _vehicle(
        "battery-risen", _I, "battery: {charge_percent} % again", ends="battery-low battery-critical"
    )

    TERRAIN_UNKNOWN = _vehicle(
        "terrain-unknown",
        _I,
        "asks for terrain at {lat_deg:.4f}°, {lon_deg:.4f}°, where the elevation model has none",
        "it asks for heights of the ground beyond the mission's elevation model; they are not sent",
        "for flight by its own terrain data: use a file that reaches 6 km beyond the map",
    )

    # ------------------------------------------------------------ is it the vehicle?

    ID_CONFLICT = _vehicle(
        "id-conflict",
        _A,
        "{peer} on {link} uses its system id, heard from {own_peer}",
        "a second address uses its system id; frames from there are ignored",
        "two vehicles with one id, a second path, or an impostor: [sign the link](signing.md)",
    )
    ID_CONFLICT_OVER = _vehicle(
        "id-conflict-over", _I, "no other address uses its system id any more", ends="id-conflict"
    )
    RECORDED_FRAMES = _vehicle(
        "recorded-frames",
        _A,
        "{peer} on {link} sent recorded frames with its id",
        "on a signed link another address repeated frames",
        "find the sender",
    )
    DUPLICATE_ID = _vehicle(
        "duplicate-id",
        _A,
        "two vehicles report with its system id, {distance_m:.0f} m apart[, switched on {boots_s:.0f} s "
        "apart]",
        "reports alternate between two places or boot times",
        "land one, give it its own system id",
    )
    DUPLICATE_ID_OVER = _vehicle(
        "duplicate-id-over", _I, "one vehicle reports with its system id again", ends="duplicate-id"
    )
    TYPE_CHANGED = _vehicle(
        "type-changed",
        _A,
        "says that it is MAV_AUTOPILOT {autopilot} on MAV_TYPE {vehicle_type}, it was {autopilot_before} "
        "on {vehicle_type_before}: is it the same vehicle?",
        "its heartbeats name another firmware or vehicle type",
        "find out which vehicle speaks; hold it",
    )
    FRAME_RATE_HIGH = _vehicle(
        "frame-rate-high",
        _W,
        "sends {rate_hz:.0f} frames a second: check its stream rates",
        "more than 1,000, for 5 s",
        "lower its rates, or find the program that raised them",
    )
    FRAME_RATE_NORMAL = _vehicle("frame-rate-normal", _I, "sends fewer frames again", ends="frame-rate-high")
    SIGNS = _vehicle("signs", _I, "signs its frames", ends="signs-no-longer")
    SIGNS_NO_LONGER = _vehicle(
        "signs-no-longer",
        _W,
        "no longer signs its frames",
        "it used to sign",
        "its key was removed, or it is another vehicle",
    )
    KEY_MISSING = _vehicle(
        "key-missing",
        _A,
        "signs its frames, and there is no key for it here; it may ignore all that we send: put its key "
        "into links.keys (docs/signing.md)",
        "it may ignore orders and missions from here",
        "add its key to `links.keys` ([signing](signing.md)), or remove it over a cable",
    )
    KEY_NOT_MISSING = _vehicle(
        "key-not-missing", _I, "no longer signs with a key that is not here", ends="key-missing"
    )
    FRAMES_REJECTED = _link(
        "frames-rejected",
        _A,
        "{count} frames rejected: {reason}[{advice}][, the last from {sender}]",
        "frames on a signed link were dropped. `not signed`, `signed with another key`: a vehicle without "
        "its key, or an impostor. `signed before the last one`: few when the network reorders, many in a "
        "replay attack, which failed. `signed more than a minute ago`: the vehicle has no time of day yet. "
        "`SETUP_SIGNING`: a signing key was sent over this link",
        "find the sender; `gcs keys install`; after SETUP_SIGNING rotate that key",
        by="reason",
    )
    SIGNING_TIME_UNWRITTEN = _link(
        "signing-time-unwritten",
        _A,
        "{path} cannot be written: {cause}",
        "the time beside the key file: after a restart vehicles might refuse signed frames",
        "check disk and permissions",
    )
    SIGNING_TIME_WRITTEN = _link(
        "signing-time-written", _I, "{path} is written again", ends="signing-time-unwritten"
    )

    # ------------------------------------------------------------ is it where it says?

    POSITION_JUMP = _vehicle(
        "position-jump",
        _A,
        "its position jumped by {distance_m:.0f} m",
        "reports from a place that it cannot have reached are used after 2 s",
        "an EKF reset, a GPS glitch, or spoofing: watch for the next",
    )
    POSITION_FROZEN = _vehicle(
        "position-frozen",
        _A,
        "reports one place for {stood_s:.0f} s at {speed_m_s:.0f} m/s: its position is frozen",
        "one position while its ground speed adds up to 60 m: refused",
        "receiver or autopilot hung, or a replay; hold or return it",
    )
    POSITION_MOVES = _vehicle("position-moves", _I, "its position moves again", ends="position-frozen")
    NO_POSITION = _vehicle(
        "no-position",
        _A,
        "no position that can be believed for {silence_s:.0f} s[; refused so far: {reasons}]",
        "it is heard, and 5 s of positions were refused",
        "act on the reason named",
    )
    POSITION_BELIEVED = _vehicle(
        "position-believed", _I, "its positions are believed again", ends="no-position"
    )
    VELOCITY_WRONG = _vehicle(
        "velocity-wrong",
        _A,
        "its velocity does not agree with its positions: it reports {speed_m_s:.0f} m/s, and is "
        "{error_m_s:.0f} m/s off that",
        "five seconds of velocities and positions that contradict each other",
        "its estimator or its reports are wrong: watch it with a sensor, hold or return it",
    )
    VELOCITY_RIGHT = _vehicle(
        "velocity-right", _I, "its velocity agrees with its positions again", ends="velocity-wrong"
    )
    HEIGHT_JUMP = _vehicle(
        "height-jump",
        _A,
        "its height jumped by {jump_m:.0f} m",
        "a change of height that no vehicle flies",
        "its height keeps no distance to others: watch it with a sensor, hold or return it",
    )
    HEIGHT_WRONG = _vehicle(
        "height-wrong",
        _A,
        "reports a height of {height_m:.0f} m above home, which it cannot have",
        "a height that no vehicle flies",
        "its height keeps no distance to others: watch it with a sensor, hold or return it",
    )
    HEIGHT_RIGHT = _vehicle("height-right", _I, "its height is possible again", ends="height-wrong")
    REPORTS_LATE = _vehicle(
        "reports-late",
        _W,
        "its reports come {delay_s:.1f} s late: its radio gets more than it can carry, or its clock is slow",
        "for ten seconds reports took so much longer to arrive than the fastest ones; or the clock of the "
        "vehicle is slow, such as in a simulation on a slow machine",
        "its place on the map is old by that time: lower `telemetry.rate_hz` and the streams that it sends "
        "by itself ([slow radios](links.md#endpoints))",
    )
    REPORTS_IN_TIME = _vehicle("reports-in-time", _I, "its reports come in time again", ends="reports-late")
    NOT_SEEN_THERE = _vehicle(
        "not-seen-there",
        _A,
        "is not seen where it reports to be: its position or its identity may be false",
        "sensors that cover its place miss it too often for chance (8000 to 1)",
        "spoofed receiver, impostor, or crashed. All vehicles at once: the sensor is misplaced or blind",
    )
    SEEN_ELSEWHERE = _vehicle(
        "seen-elsewhere",
        _A,
        "is seen {distance_m:.0f} m from where it reports to be, at {east_m:.0f} m east, {north_m:.0f} m "
        "north: its position is false",
        "sensors miss it too often for chance, and its track continues elsewhere",
        "do not send it by its own GPS: fly it by hand, or let it land",
    )
    SEEN_THERE = _vehicle(
        "seen-there", _I, "is seen where it reports to be again", ends="not-seen-there seen-elsewhere"
    )

    # ------------------------------------------------------------ distance between vehicles

    TAKEOFF_BLOCKED = _vehicle(
        "takeoff-blocked",
        _A,
        "its take-off is not clear, it gets no mission: {reason}",
        "its climb is obstructed at the place named ([take-off](planning.md#take-off))",
        "lower `takeoff.altitude_rel_m`, turn or move the vehicle",
    )
    TAKEOFF_CLEAR = _vehicle("takeoff-clear", _I, "its take-off is clear again", ends="takeoff-blocked")
    TAKEOFF_WAITS = _vehicle(
        "takeoff-waits",
        _W,
        "its take-off waits: {reason}",
        "another vehicle near by takes off, lands, or flies where its climb leads "
        "([take-offs](planning.md#one-after-another))",
        "wait; disarm it to cancel",
    )
    TAKEOFF_STUCK = _vehicle(
        "takeoff-stuck",
        _W,
        "does not lift off: its take-off began {since_s:.0f} s ago, and take-offs near by wait for it. Check "
        "thrust and launch, or gcs order disarm --vehicle {vehicle}",
        "armed in AUTO at its take-off item, and below 10 m for 30 s",
        "launch it if it is thrown by hand; else disarm it and check motor, propeller and runway",
    )
    TAKEOFF_STUCK_NO_LONGER = _vehicle(
        "takeoff-stuck-no-longer", _I, "has lifted off, or was stopped", ends="takeoff-stuck"
    )
    CLIMBS_NEAR = _vehicle(
        "climbs-near",
        _A,
        "climbs out {distance_m:.0f} m from agent {other:agent}, which climbs out too: they are not apart "
        "in height yet. Watch both; if they close, let a pilot take one over",
        "no height separates them yet",
        "watch both; a pilot takes one over if they close",
        by="other",
    )
    CLIMBS_APART = _vehicle(
        "climbs-apart", _I, "no longer climbs out near agent {other:agent}", ends="climbs-near", by="other"
    )
    COMES_NEAR = _vehicle(
        "comes-near",
        _A,
        "comes within {distance_m:.0f} m and {height_m:.0f} m in height of agent {other:agent} in "
        "{after_s:.0f} s, at ({east_m:.0f}, {north_m:.0f}) m, {place_height_m:.0f} m high: hold or return "
        "one, or let a pilot take it over",
        "the flights of both, simulated 25 s ahead, come too near at the time and place named; repeated 10 "
        "s before ([separation](planning.md#separation-in-flight))",
        "hold or return one, or a pilot takes one over",
        by="other",
    )
    SEPARATION_LOST = _vehicle(
        "separation-lost",
        _A,
        "has lost separation from agent {other:agent}: {distance_m:.0f} m and {height_m:.0f} m in height, "
        "at ({east_m:.0f}, {north_m:.0f}) m, {place_height_m:.0f} m high: hold or return one, or let a "
        "pilot take it over",
        "both are nearer than `separation_m` and half a layer in height",
        "hold or return one, or a pilot takes one over, at once",
        by="other",
    )
    APART_AGAIN = _vehicle(
        "apart-again",
        _I,
        "is apart from agent {other:agent} again[; the nearest was {nearest_m:.0f} m and "
        "{nearest_height_m:.0f} m in height]",
        ends="comes-near separation-lost",
        by="other",
    )
    NEAR_GROUND = _vehicle(
        "near-ground",
        _A,
        "comes within {agl_m:.0f} m of the ground in {after_s:.0f} s, at ({east_m:.0f}, {north_m:.0f}) m; "
        "{least_m:.0f} m are the least: let a pilot take it over, or order it to return if it is clear",
        "by the elevation model, at its height now, or in the next 20 s in a mode other than AUTO; half of "
        "`terrain.min_agl_m` is the least height",
        "a pilot climbs; on a mission, check the height of the autopilot and the elevation model",
    )
    CLEAR_OF_GROUND = _vehicle("clear-of-ground", _I, "is clear of the ground", ends="near-ground")
    AIRCRAFT_NEAR = _vehicle(
        "aircraft-near",
        _A,
        "{aircraft} comes within {distance_m:.0f} m and {height_m:.0f} m in height of it in {after_s:.0f} s, "
        "at ({east_m:.0f}, {north_m:.0f}) m, {place_height_m:.0f} m high: hold or return it, or let a pilot "
        "take it over",
        "an aircraft or drone that is received by ADS-B or Remote ID is predicted to come within 300 m and "
        "75 m in height; repeated 10 s before",
        "keep clear: hold, return or land the vehicle, or let a pilot take it over",
        by="aircraft",
    )
    AIRCRAFT_GONE = _vehicle(
        "aircraft-gone", _I, "is apart from {aircraft}", ends="aircraft-near", by="aircraft"
    )
    CHANGES_LAYER = _vehicle(
        "changes-layer",
        _W,
        "circles near {other}: it gets a circle that is clear of it, {height_m:.0f} m above home",
        "the circles of two that wait are nearer than the separation at one height, or a vehicle that others "
        "steer comes near the circle at a target (`planning.avoidance`)",
        "nothing; `gcs order resume` as always",
    )
    AVOIDS = _vehicle(
        "avoids",
        _W,
        "holds: it would come near {other} in {after_s:.0f} s. It flies on when they are apart",
        "its mission leads it near the other vehicle, and a hold keeps it farther away "
        "(`planning.avoidance`, [separation](planning.md#separation-in-flight))",
        "wait",
        by="other",
    )
    AVOIDS_NO_LONGER = _vehicle(
        "avoids-no-longer",
        _I,
        "no longer holds for {other}[: {reason}]",
        ends="avoids holds-before-zone",
        by="other",
    )
    HOLDS_BEFORE_ZONE = _vehicle(
        "holds-before-zone",
        _A,
        "holds: its mission leads into {other}: {remedy}",
        "no other mission was on board in time: no route leads round the zone, or none was confirmed or "
        "uploaded (`planning.avoidance`, [no-fly zones](orders.md#no-fly-zones))",
        "open the zone, confirm a plan, or return it, if it does not return already; with a route round the "
        "zone it flies on by itself",
        by="other",
    )
    RETURNS_NEAR = _mission(
        "returns-near",
        _W,
        "{heights}: a failsafe would bring them together. {remedy}",
        "their return heights are less than a layer apart",
        "return one at a time; set them apart before the next flight",
    )
    RETURNS_APART = _mission(
        "returns-apart", _I, "return heights are a layer apart again", ends="returns-near"
    )
    RETURN_ORDER_NEAR = _mission(
        "return-order-near",
        _W,
        "{warning}",
        "vehicles that were ordered to return would fly at one height",
        "hold one until the other is down",
    )
    MISSION_WAITS = _vehicle(
        "mission-waits",
        _W,
        "its new mission waits, it {reason}: it is uploaded when that is over, in a minute at the latest",
        "from its present place and height it would lead the vehicle near another one, or too low",
        "wait: until then the vehicle flies on as before",
    )
    ORDER_WAITS = _vehicle(
        "order-waits",
        _A,
        "its order to {action} waits, it {reason}: it flies on until it is clear. Order it again to "
        "{action} it at once",
        "to hold or return now would lead it near another vehicle, or to hold into a zone or an obstacle",
        "wait; give the order again to carry it out at once",
    )
    ORDER_BEGINS = _vehicle(
        "order-begins", _I, "is clear: its order to {action} is carried out", ends="order-waits"
    )
    RETURN_ROUTE_PROBLEM = _vehicle(
        "return-route-problem",
        _W,
        "{problem}",
        "the way back to its landing: not clear, or it would land at the time of another vehicle and no "
        "point of it has a clear circle to wait on",
        "watch it; hold one until the other is down",
    )

    RETURN_ROUTE_CLEAR = _vehicle(
        "return-route-clear", _I, "its return route is clear again", ends="return-route-problem"
    )

    # ------------------------------------------------------------ its mission

    MISSION_VERIFIED = _vehicle(
        "mission-verified",
        _I,
        "mission of {items} items {detail} in {duration_s:.2f} s, {retries} retries",
        ends="mission-failed mission-held-back uploads-failed upload-slow clearing-failed clearing-given-up "
        "mission-rejected mission-waits takeoff-waits first-leg-wrong first-leg-still-wrong "
        "route-ended-short without-mission upload-error mission-unread mission-differs mission-count-changed "
        "mission-changed",
    )
    MISSION_FAILED = _vehicle(
        "mission-failed",
        _A,
        "mission transfer failed: {detail}",
        "the mission was not read back equal; the reason names the onboard mission "
        "([missions](missions.md)). `is overridden`, `was chosen meanwhile`, `commands a mode`: a pilot, a "
        "failsafe or another station changed its mode during the upload, which was stopped at once ([what "
        "it stores now](missions.md#after-an-override))",
        "none: it is planned for again; after an override `gcs order resume`",
    )
    MISSION_HELD_BACK = _vehicle(
        "mission-held-back",
        _A,
        "its mission is not uploaded, {reason}",
        "the last check before an upload simulates climb, turns, loiter circle and landing; the part named "
        "is not clear, or lies outside the map or the fence. Nothing was sent",
        "watch the vehicle on its old mission; correct map, fence, home, altitude layers, radii or speeds",
    )
    FIRST_LEG_WRONG = _vehicle(
        "first-leg-wrong",
        _W,
        "its first leg is wrong: {problem}; item {item} is selected again",
        "it flew off its line or to another waypoint; the leg was started again",
    )
    FIRST_LEG_STILL_WRONG = _vehicle(
        "first-leg-still-wrong",
        _A,
        "its first leg is still wrong after {selections} selections of item {item}: {problem}; hold it, or "
        "return it",
        "that did not help",
        "hold it, or return it",
    )
    UPLOADS_FAILED = _vehicle(
        "uploads-failed",
        _A,
        "last {failures} mission uploads failed: next attempt in {pause_s:.0f} s",
        "each upload report has its reason",
        "check the link; `gcs order resume` ends the wait",
    )
    UPLOAD_SLOW = _vehicle(
        "upload-slow",
        _W,
        "its upload takes {took_s:.0f} s so far, waiting for {waits_for}[; before: {before}]",
        "after 10 s, 30 s and 90 s: what the vehicle has not answered",
        "check the link; hold it in doubt",
    )
    CLEARING_FAILED = _vehicle(
        "clearing-failed",
        _A,
        "its inconsistent mission could not be cleared ({detail}): next attempt in {pause_s:.0f} s",
        "it keeps a mission that may be mixed from two",
        "keep it out of AUTO",
    )
    CLEARING_GIVEN_UP = _vehicle(
        "clearing-given-up",
        _A,
        "its inconsistent mission could not be cleared ({detail}): no more attempts: it does not obey; "
        "keep it out of AUTO, or order it to resume",
        "after five attempts there are no more",
        "land it, or `gcs order resume` tries again",
    )
    UPLOAD_ERROR = _vehicle(
        "upload-error",
        _A,
        "its upload ended by a program error ({error}); it is planned for again",
        "its mission counts as unknown; it is held and cleared",
        "report the recording",
    )
    WITHOUT_MISSION = _vehicle(
        "without-mission",
        _A,
        "{state}: {detail}",
        "after an upload it has no mission, waits in LOITER, or is overridden. Do not choose AUTO before "
        "an inconsistent mission is repaired",
        "none: it is planned for again; after an override order it to resume",
    )
    ROUTE_ENDED_SHORT = _vehicle(
        "route-ended-short",
        _A,
        "ended its route without having reached its target: {state}",
        "it passed the end of its route, or flies RTL after it",
        "none if a new route follows; else hold or return it",
    )
    MISSION_REJECTED = _vehicle(
        "mission-rejected",
        _A,
        "its navigator rejects its mission: {cause}. Correct its parameters (`gcs preflight`): a change "
        "starts the next attempt, {outlook}",
        "a PX4 stored the mission and will not fly it; its own words follow. Its target goes to another "
        "vehicle ([next attempt](missions.md#rejected-missions))",
        "correct its parameters; without a cause check MIS_TKO_LAND_REQ, fence and messages (`gcs "
        "preflight`)",
    )
    MISSION_LOST = _vehicle(
        "mission-lost",
        _W,
        "lost its onboard mission at a reboot: it gets a new one",
        "its mission storage was empty after a reboot",
        "watch it until it has a mission",
    )
    MISSION_DIFFERS = _vehicle(
        "mission-differs",
        _A,
        "its onboard mission is not the one it was given ({difference}): left alone until " + _RESUME,
        "after a restart, or a change from elsewhere, it differs from the verified one; it is not tasked",
        "`gcs order resume -v N` gives it a new one",
    )
    MISSION_UNREAD = _vehicle(
        "mission-unread",
        _A,
        "does not answer the download of its onboard mission: left alone until "
        + _RESUME
        + ", or until it does",
        "its read-back failed; it gets no task",
        "check the link, or `gcs order resume`",
    )
    MISSION_COUNT_CHANGED = _vehicle(
        "mission-count-changed",
        _W,
        "reports {reported} mission items, it was given {given}: its onboard mission is read back",
        "its mission changed without this service: it is compared",
        "find who else uploads to it",
    )
    MISSION_CHANGED = _vehicle(
        "mission-changed",
        _W,
        "reports another mission of the same length: its onboard mission is read back",
        "its mission changed without this service: it is compared",
        "find who else uploads to it",
    )
    ONBOARD_VERIFIED = _vehicle(
        "onboard-verified",
        _I,
        "its onboard mission is verified",
        ends="mission-unread mission-differs mission-count-changed mission-changed",
    )

    # ------------------------------------------------------------ who controls it?

    STATION_WRITES = _vehicle(
        "station-writes",
        _A,
        "{station} writes a mission of its own ({message}): it is overridden from now on",
        "another ground station uploads to it; it is not tasked",
        "`gcs order resume`",
    )
    STATION_WROTE = _vehicle(
        "station-wrote",
        _W,
        "took the mission of {station}; it is not tasked until it is ordered to resume",
        "another ground station's mission is complete",
        "`gcs order resume`",
    )
    STATION_UPLOAD_BROKEN = _vehicle(
        "station-upload-broken",
        _A,
        "the upload of {station} {how}: it keeps the mission before that; order it to resume, and it gets "
        "a new one of ours",
        "that upload broke off or was refused",
        "`gcs order resume`",
    )
    STATION_UPLOAD_MIXED = _vehicle(
        "station-upload-mixed",
        _A,
        "the upload of {station} {how}: its onboard mission may be inconsistent; order it to resume, and "
        "it gets a new one of ours",
        "that upload broke off or was refused",
        "`gcs order resume`",
    )
    SECOND_COMMANDER = _vehicle(
        "second-commander",
        _A,
        "another service with our ids ({ids}) commands it: {sign}; end one of the two. It is not "
        "tasked until " + _RESUME,
        "it answers requests that this service did not send, or another service's heartbeats are heard; "
        "sign and address are named",
        "end one of the two services, then `gcs order resume`",
    )
    SECOND_COMMANDER_TOLERATED = _vehicle(
        "second-commander-tolerated",
        _W,
        "another service with our ids ({ids}) commands it: {sign}. It is tasked all the same, by your order",
        "the other service goes on after `resume`",
        "end it",
    )
    SECOND_COMMANDER_GONE = _vehicle(
        "second-commander-gone",
        _I,
        "no other service with our ids has commanded it for {quiet_s:.0f} s",
        ends="second-commander-tolerated",
    )
    FAILSAFE = _vehicle(
        "failsafe",
        _A,
        "is in {mode} by a failsafe: {cause}. It is left alone until " + _RESUME + ", or until it is in AUTO",
        "its autopilot chose that mode and gives the cause; it is not tasked",
        "let the failsafe end; then `gcs order resume`",
    )
    OVERRIDDEN = _vehicle(
        "overridden",
        _W,
        "is in {mode}, not by this service: {why}. It is left alone until "
        + _RESUME
        + ", or until it is in AUTO",
        "a pilot, a failsafe or another station chose its mode; it is not tasked",
        "`gcs order resume`; from MANUAL, FBWA and the like the pilot gives it back",
    )
    OURS_AGAIN = _vehicle(
        "ours-again",
        _I,
        "is ours to task again",
        ends="failsafe overridden second-commander station-writes station-wrote station-upload-broken "
        "station-upload-mixed",
    )
    LOITER_ON_GROUND = _vehicle(
        "loiter-on-ground",
        _I,
        "stands on the ground in AUTO with no mission to fly: armed, it would take off; set to LOITER",
        "it was set to LOITER (Hold)",
    )
    AUTO_ON_GROUND = _vehicle(
        "auto-on-ground",
        _A,
        "stays in AUTO on the ground ({detail}): armed, it would take off with an old mission; set LOITER "
        "or Hold by hand before arming",
        "setting it to LOITER failed, for the reason in brackets",
        "set LOITER or Hold by hand before arming",
    )
    ORDER_ENDED = _vehicle(
        "order-ended",
        _A,
        "its order to {action} was not confirmed before the restart of the service; to {action} it, order "
        "it again",
        "orders to arm or disarm, and old ones, are not carried out after a restart",
        "order it again",
    )
    RESUMED = _mission(
        "resumed",
        _W,
        "continues from its state {age_s:.0f} s ago: {contents}; for a new flight, end the service and "
        "start it with --no-resume",
        "restart from the journal",
        "for a new flight start with `--no-resume`",
    )
    TARGETS_UNATTENDED = _mission(
        "targets-unattended",
        _W,
        "the mission has ended, and no agent is sent to {targets}: order `gcs order continue` to send "
        "agents there",
        "targets that need agents after the end",
        "`gcs order continue` sends free agents",
    )
    TARGETS_ATTENDED = _mission(
        "targets-attended", _I, "no target is left without an agent", ends="targets-unattended"
    )
    MISSION_GOES_ON = _mission(
        "mission-goes-on",
        _W,
        "{vehicles:agents} can fly again: the mission goes on",
        "the mission ended when no agent could fly, such as in an outage of all radios; now one is back",
        "watch which targets it flies to, or hold it",
    )
    STANDSTILL = _mission(
        "standstill",
        _A,
        "the mission stands still, no agent can be tasked: {vehicles}. `gcs order resume` those that can "
        "fly on; let a pilot land the others",
        "every agent that is left circles after a failsafe, is unfit, not heard, or under other control; "
        "the mission has not ended",
        "resume those that can fly on; let a pilot land the others",
    )
    STANDSTILL_OVER = _mission(
        "standstill-over", _I, "the mission goes on: {vehicles} can be tasked", ends="standstill"
    )
    ZONE_AHEAD = _vehicle(
        "zone-ahead",
        _A,
        "would fly through no-fly zone {zone}: in {after_s:.0f} s, on its way to item {item} of its "
        "onboard mission[: {remedy}]",
        "its onboard mission leads through it at the time and item named",
        "confirm a plan, hold it, or return it; open the zone for one that returns",
        by="zone",
    )
    ZONE_ENTERED = _vehicle(
        "zone-entered",
        _A,
        "is inside no-fly zone {zone}: open the zone, return it, or let a pilot lead it out",
        "nothing was done in time",
        "open the zone, return it, or let a pilot lead it out; a hold keeps it inside",
        by="zone",
    )
    ZONE_UNAVOIDABLE = _vehicle(
        "zone-unavoidable",
        _A,
        "has no way around {zone}: {remedy}",
        "no route to its target, or home, avoids the new zone",
        "confirm a plan, hold it, or return it; open the zone for one that returns",
        by="zone",
    )
    ZONE_ON_RETURN = _vehicle(
        "zone-on-return",
        _A,
        "flies home through {zone}: hold or return it",
        "its return route leads through the new zone",
        "hold or return it",
        by="zone",
    )
    ZONE_CLEAR = _vehicle(
        "zone-clear",
        _I,
        "keeps clear of no-fly zone {zone} again",
        ends="zone-ahead zone-entered zone-unavoidable zone-on-return",
        by="zone",
    )
    AGENT_NOT_ON_EARTH = _vehicle(
        "agent-not-on-earth",
        _W,
        "its position is not on Earth: it gets no route",
        "the tracker's estimate is wrong by far",
        "check the vehicle's GPS and clock",
    )
    TARGET_NOT_ON_EARTH = _mission(
        "target-not-on-earth",
        _W,
        "target {target}: its position is not on Earth",
        "the sensors report impossible positions",
        "check the sensors; `gcs order ignore`",
        by="target",
    )
    NO_AGENTS = _mission(
        "no-agents",
        _W,
        "no plan: no agent can get a route",
        "all agents are held, on their return, under a pilot's control, at their targets or lost",
    )
    NO_TARGETS = _mission("no-targets", _W, "no targets", "no target is tracked, or all are ignored")
    NO_FREE_CELL = _mission(
        "no-free-cell", _W, "the map has no free cell", "obstacles cover all of it", "check the map"
    )
    TARGET_OUTSIDE_MAP = _mission(
        "target-outside-map",
        _W,
        "target {target} is outside the map; its route ends at the nearest point inside",
        "no waypoint lies outside the map",
        "a larger map, or ignore the target",
        by="target",
    )
    NO_PATH_FROM_AGENTS = _mission(
        "no-path-from-agents",
        _W,
        "target {target}: no path from any agent",
        "obstacles, or the fence, enclose it",
        "check the map and the fence, or ignore the target",
        by="target",
    )
    NO_PATH_TO_TARGETS = _vehicle(
        "no-path-to-targets",
        _W,
        "no path to any target",
        "obstacles, or the fence, enclose it",
        "fly it out by hand, or check the map and the fence",
    )
    INSIDE_OBSTACLE = _vehicle(
        "inside-obstacle",
        _W,
        "inside an obstacle; leaves it by ({east_m:.0f}, {north_m:.0f}) m",
        "its position is in a cell that the map shows as blocked",
        "watch the vehicle; check the map",
    )
    TARGET_OVER_OBSTACLE = _vehicle(
        "target-over-obstacle",
        _W,
        "target {target} is over an obstacle; the route ends at ({east_m:.0f}, {north_m:.0f}) m",
        "the route ends at the nearest point that the vehicle can reach",
        "ignore the target, or approach it by hand",
        by="target",
    )
    ROUTE_NEAR_OBSTACLES = _vehicle(
        "route-near-obstacles",
        _W,
        "the route to target {target} comes nearer than {clearance_m:g} m to obstacles: every path that "
        "keeps this distance is a long detour, or there is none",
        "the route keeps less than `planning.clearance_m`",
        "watch the vehicle; a smaller `clearance_m`, or ignore the target",
        by="target",
    )
    TIGHTEST_TURN = _vehicle(
        "tightest-turn",
        _W,
        "no clear turn onto its route: it makes its tightest turn",
        "every turn that it can fly comes near an obstacle",
        "watch the vehicle",
        by="target",
    )
    SHARP_CORNERS = _vehicle(
        "sharp-corners",
        _W,
        "its route has corners that it cannot fly at that distance",
        "the vehicle cuts corners, or overshoots them, near an obstacle",
        "watch the vehicle; a smaller `clearance_m`",
        by="target",
    )
    LOITERS_SHORT = _vehicle(
        "loiters-short",
        _W,
        "no clear path past target {target}: it loiters near it",
        "a circle through the target would come near an obstacle or the fence",
        "smaller `mission.loiter_radius_m`, a wider fence, or ignore the target",
        by="target",
    )
    NO_CLEAR_LOITER = _vehicle(
        "no-clear-loiter",
        _W,
        "no loiter circle near target {target} keeps clear of obstacles and the fence: it gets no new route "
        "there",
        "the vehicle keeps its last verified mission",
        "smaller `mission.loiter_radius_m`, a wider fence, or ignore the target",
        by="target",
    )
    NO_ROUTE_IN_BAND = _vehicle(
        "no-route-in-band",
        _W,
        "no route to target {target} keeps between the least and the greatest height above ground: it gets "
        "no new route there",
        "climb, turn radius or flight band do not fit the terrain on the way, or there is no loiter circle",
        "lower `terrain.min_agl_m`, raise `terrain.max_agl_m`, or ignore the target",
        by="target",
    )
    NO_LAYER_LEFT = _mission(
        "no-layer-left",
        _W,
        "{vehicles:agents} will come near each other at one altitude[, {distance_m:.0f} m][ after "
        "{after_s:.0f} s]: no layer is left",
        "there are more vehicles than altitude layers",
        "hold one of them; more `mission.layers`",
        by="vehicles",
    )
    LAYERS_SUFFICE = _mission(
        "layers-suffice",
        _I,
        "{vehicles:agents} no longer come near each other at one altitude",
        ends="no-layer-left",
        by="vehicles",
    )
    ROUTE_REMARK_OVER = _vehicle(
        "route-remark-over",
        _I,
        "the last plan is without {condition} for target {target}",
        "its parameter `condition` names which one ended",
        ends="target-over-obstacle route-near-obstacles tightest-turn sharp-corners loiters-short "
        "no-clear-loiter no-route-in-band",
        by="target",
    )
    AGENT_REMARK_OVER = _vehicle(
        "agent-remark-over",
        _I,
        "the last plan is without {condition}",
        "its parameter `condition` names which one ended",
        ends="agent-not-on-earth no-path-to-targets inside-obstacle",
    )
    TARGET_REMARK_OVER = _mission(
        "target-remark-over",
        _I,
        "the last plan is without {condition} for target {target}",
        "its parameter `condition` names which one ended",
        ends="target-not-on-earth target-outside-map no-path-from-agents",
        by="target",
    )
    PLAN_REMARK_OVER = _mission(
        "plan-remark-over",
        _I,
        "the last plan is without {condition}",
        "its parameter `condition` names which one ended",
        ends="no-agents no-targets no-free-cell",
    )
    PLAN_WAITS = _mission(
        "plan-waits",
        _W,
        "{plan}",
        '`retask = "confirm"`: the plan waits to be confirmed; repeated once a minute '
        "([orders](orders.md#confirming-plans))",
        "`gcs order confirm`, or `reject N`",
    )
    PARAMETER_SET = _vehicle(
        "parameter-set",
        _I,
        "{station} set its parameter {name} from {before} to {value}[; the vehicle {answer}]",
        "another ground station changed a parameter of a vehicle",
        "ask its operator; set it back with `gcs param set`",
        by="name",
    )
    PARAMETER_SET_WRONG = _vehicle(
        "parameter-set-wrong",
        _W,
        "{station} set its parameter {name} from {before} to {value}[; the vehicle {answer}]; {problem}",
        "as above, and `gcs preflight` would object",
        "ask its operator; set it back with `gcs param set`",
        by="name",
    )
    PARAMETER_CHANGED = _vehicle(
        "parameter-changed",
        _I,
        "its parameter {name} changed from {before} to {value}, set over another link",
        "a parameter that preflight checks changed, and not through this service",
        "find who set it",
        by="name",
    )
    PARAMETER_CHANGED_WRONG = _vehicle(
        "parameter-changed-wrong",
        _W,
        "its parameter {name} changed from {before} to {value}, set over another link; {problem}",
        "as above, and `gcs preflight` would object",
        "find who set it",
        by="name",
    )
    STATION_COMMANDS = _vehicle(
        "station-commands",
        _I,
        "{message} from {station}",
        "another ground station sent it a message that does more than read",
    )
    STATION_ARMS = _vehicle(
        "station-arms",
        _W,
        "{message} from {station}",
        "another ground station arms or disarms it",
        "ask its operator",
    )
    STATION_DANGER = _vehicle(
        "station-danger",
        _A,
        "{message} from {station}: {danger}; if that was not intended, stop that ground station",
        "another ground station sent that command",
        'ask its operator, or set `access = "read-only"` ([links](links.md))',
    )
    STATION_COMMANDS_ALL = _mission(
        "station-commands-all", _I, "{message} from {station}, to all vehicles", "as above, to system 0"
    )
    STATION_ARMS_ALL = _mission(
        "station-arms-all",
        _W,
        "{message} from {station}, to all vehicles",
        "another ground station arms or disarms all",
        "ask its operator",
    )
    STATION_DANGER_ALL = _mission(
        "station-danger-all",
        _A,
        "{message} from {station}, to all vehicles: {danger}; if that was not intended, stop that ground "
        "station",
        "another ground station sent that command",
        'ask its operator, or set `access = "read-only"` ([links](links.md))',
    )
    AUTOPILOT_ALARM = _vehicle(
        "autopilot-alarm",
        _A,
        "{said}",
        "STATUSTEXT of severity 0 to 2. A vehicle on the ground may repeat one: it is shown when it "
        "begins, and again after two minutes without it",
        "see the autopilot's documentation",
        by="said",
    )
    AUTOPILOT_WARNING = _vehicle(
        "autopilot-warning", _W, "{said}", "STATUSTEXT of severity 3 and 4", by="said"
    )
    AUTOPILOT_INFO = _vehicle("autopilot-info", _I, "{said}", "other STATUSTEXT", by="said")

    # ------------------------------------------------------------ sensors

    NO_SENSOR = _mission(
        "no-sensor",
        _A,
        "no scan for {silence_s:.0f} s: is the sensor there?",
        "losses go unseen, nothing is planned; reports alone track agents",
        "check sensor, network, `links.zenoh`",
    )
    SCANS_AGAIN = _mission(
        "scans-again", _I, "scans are processed after {silence_s:.0f} s without one", ends="no-sensor"
    )
    SENSOR_SILENT = _sensor(
        "sensor-silent",
        _A,
        "no scan for {silence_s:.0f} s: is the sensor there?",
        "none for 5 s or three periods",
        "check sensor and network",
    )
    SCANS_REFUSED = _sensor(
        "scans-refused",
        _A,
        "no scan was processed for {silence_s:.0f} s, {count} were refused: {reason}",
        "all its scans are refused, for the reason named",
        "correct clock, origin or format ([sensors](sensors.md))",
    )
    SENSOR_AGAIN = _sensor(
        "sensor-again",
        _I,
        "its scans are processed again after {silence_s:.0f} s",
        ends="sensor-silent scans-refused",
    )
    SENSOR_CLOCK_OFF = _sensor(
        "sensor-clock-off",
        _A,
        "its clock is {off_s:.1f} s {side} ours: its times are corrected by that from now on; set its "
        "clock (NTP, PTP)",
        "five scans were off by one amount",
        "set the sensor's clock",
    )
    SENSOR_CLOCK_STEP = _sensor(
        "sensor-clock-step",
        _I,
        "its clock was set by {step_s:+.1f} s with this machine's; its times are corrected by as much",
    )
    SENSOR_CLOCK_AGREES = _sensor(
        "sensor-clock-agrees", _I, "its clock agrees with ours again", ends="sensor-clock-off"
    )
    NO_ASSOCIATION = _mission(
        "no-association",
        _A,
        "vehicles report and scans arrive, but no vehicle has been associated with a track for "
        "{silence_s:.0f} s, so nothing is planned: compare the sensors' clocks, origin and field of view "
        "with the vehicles' positions",
        "sensor and vehicles disagree; nothing is planned",
        "check clocks, origin, field of view",
    )
    ASSOCIATED_AGAIN = _mission(
        "associated-again", _I, "vehicles are associated with tracks again", ends="no-association"
    )
    UNTRACKED_DETECTIONS = _mission(
        "untracked-detections",
        _A,
        "detections persist at {places} where no births are declared: no track takes them; {remedy}",
        "detections repeat there and are not tracked",
        "a target: add `[[births]]`, or raise `tracking.targets.anywhere.per_s`. Else keep clear, or mask it",
    )
    UNTRACKED_OVER = _mission(
        "untracked-over", _I, "no detections persist without a track any more", ends="untracked-detections"
    )
    CLUTTER_WRONG = _sensor(
        "clutter-wrong",
        _W,
        "{estimated:.3g} false detections a scan seen, {announced:.3g} announced; check its configuration",
        "with more than announced clutter may pass for objects, with less tracks are confirmed late",
        "set `correct_sensors`, or correct the sensor",
    )
    CLUTTER_RIGHT = _sensor(
        "clutter-right",
        _I,
        "{estimated:.3g} false detections a scan seen, {announced:.3g} announced: in agreement again",
        ends="clutter-wrong",
    )
    DETECTION_WRONG = _sensor(
        "detection-wrong",
        _W,
        "{estimated:.2f} of the objects in view are detected, {announced:.2f} announced; check its "
        "configuration",
        "with less than announced tracks may be dropped, with more losses are detected late",
        "set `correct_sensors`, or correct the sensor",
    )
    DETECTION_RIGHT = _sensor(
        "detection-right",
        _I,
        "{estimated:.2f} of the objects in view are detected, {announced:.2f} announced: in agreement again",
        ends="detection-wrong",
    )
    SENSORS_CONTRADICT = _sensor(
        "sensors-contradict",
        _A,
        "misses the {kind} that sensor {other} detects at {east_m:.0f} m east, {north_m:.0f} m north: one of "
        "the two is wrong",
        "both have it in view, and by what they announce it is no chance (1e8 to 1): a blocked view, wrong "
        "alignment, wrong values, or false detections ([sensors](sensors.md#several-sensors))",
        "ask a third sensor, the vehicle, or look: which is wrong? Stop that sensor, or remove its line in "
        "`nodes.toml` ([security](security.md))",
        by="other",
    )
    SENSORS_AGREE = _sensor(
        "sensors-agree",
        _I,
        "misses no object that sensor {other} detects any more",
        ends="sensors-contradict",
        by="other",
    )
    BAD_INPUT = _mission(
        "bad-input",
        _W,
        "bad input: {problem}",
        "unreadable input, or a program that floods the service with orders",
        "find the sender; end that program, and repeat your own order",
        by="source",
    )
    BAD_INPUT_MORE = _mission(
        "bad-input-more",
        _W,
        "bad input: {count} more of {source} in {seconds:.0f} s, the last: {problem}",
        "a summary of further unreadable input",
        "find the sender",
        by="source",
    )

    # ------------------------------------------------------------ links, the service

    UNREADABLE_BYTES = _link(
        "unreadable-bytes",
        _W,
        "unreadable bytes from {peer}, {count} there in all",
        "noise on a link, or no MAVLink",
        "check baud rate, wiring, other programs",
    )
    NOISE_DROPPED = _link(
        "noise-dropped",
        _W,
        "{count} bytes that form no MAVLink frame were dropped; a sample of them is recorded",
        "a link carries more than 2 kB of noise a second",
        "check baud rate, other programs, or an attacker",
    )
    UNKNOWN_SYSTEM = _link(
        "unknown-system",
        _I,
        "unknown system {system}, component {component}, from {peer}",
        "the mission does not list it; never acted on",
        "add it to `[[agents]]`, or ignore it",
        by="system component",
    )
    NODE_WITHOUT_RIGHTS = _link(
        "node-without-rights",
        _W,
        "{name} connected and may do nothing here: nodes.toml does not list it with that role",
        "a program with a valid certificate for zenoh, which was not or is no longer admitted",
        "add it to `nodes.toml` of this service and start the service again, or find out which program it is",
        by="name",
    )
    LINK_OPEN = _link("link-open", _I, "connected", ends="link-failed")
    LINK_FAILED = _link(
        "link-failed",
        _W,
        "{problem}; trying again",
        "an endpoint cannot be opened, connected or reached, or its connection was lost",
        "check device, permissions, host, port",
    )
    LINK_UNREADABLE = _link(
        "link-unreadable",
        _A,
        "cannot be read ({cause}); the next try is in 1 s",
        "the system refused to read its socket",
        "check memory and limits",
    )
    PEER_CONNECTED = _link("peer-connected", _I, "{peer} connected")
    PEER_GONE = _link("peer-gone", _I, "{peer} {why}")
    CONNECTIONS_CLOSED = _link(
        "connections-closed",
        _W,
        "{count} connections without a valid frame were closed, the last from {peer}",
        "programs that connect and speak no MAVLink",
        "find the sender",
    )
    STATION_REFUSED = _link(
        "station-refused",
        _W,
        "{count} frames of other ground stations refused: {reason}",
        "another ground station may not send that ([links](links.md))",
        '`access = "full"`, if it should',
        by="reason",
    )
    RECORDING_ENDED = _link(
        "recording-ended",
        _A,
        "{problem}; the flight goes on unrecorded",
        "the recording cannot be written, or its limit was reached; earlier parts stay readable",
        "free the disk, restart `gcs run`; larger limits, or another disk",
    )
    RECORDING_MOVED = _link(
        "recording-moved",
        _A,
        "{lost} was deleted or moved away; the recording goes on in {folder}",
        "the folder was removed in flight",
    )
    DISK_LOW = _link(
        "disk-low",
        _A,
        "disk space runs low: {folder} has {used_gb:.2f} GB, its disk {free_mb:.0f} MB free; it ends at "
        "{max_gb:.6g} GB, or {min_free_mb:.0f} MB free: free disk space",
        "four fifths of `recording.max_gb` are used, or the disk nears `recording.min_free_mb`",
        "free the disk now: nothing is deleted automatically",
    )
    DISK_FREE = _link(
        "disk-free",
        _I,
        "disk space suffices again: {folder} has {used_gb:.2f} GB, its disk {free_mb:.0f} MB free",
        ends="disk-low",
    )
    JOURNAL_UNWRITTEN = _link(
        "journal-unwritten",
        _A,
        "{problem}: a restart would begin from an older state",
        "the journal cannot be written",
        "check disk and permissions; do not restart before",
    )
    JOURNAL_WRITTEN = _link("journal-written", _I, "is written again", ends="journal-unwritten")
    JOURNAL_REFUSED = _link(
        "journal-refused",
        _A,
        "{problem}; the service goes on without the state of the previous flight",
        "the journal is damaged, was changed, or is of another mission",
        "vehicles in the air are read back and tasked anew; watch the first plan",
    )
    OUTPUT_ENDED = _link(
        "output-ended",
        _A,
        "cannot be written any more ({cause}); the flight goes on without it",
        "a terminal, pipe or file is gone",
        "`kill -INT` ends the service",
    )
    OUTPUT_BLOCKED = _link(
        "output-blocked",
        _W,
        "accepts no output for {seconds:.0f} s: output is queued, then dropped",
        "the terminal is stopped (Ctrl-S, a pager), or a subscriber does not read",
        "Ctrl-Q; end that subscriber",
    )
    DISK_BLOCKED = _link(
        "disk-blocked",
        _A,
        "accepts no output for {seconds:.0f} s: output is queued, then dropped",
        "the disk blocks; after 300 000 waiting records the recording ends",
        "check the disk: full, failing, a network drive",
    )
    OUTPUT_AGAIN = _link(
        "output-again",
        _I,
        "accepts output again; {dropped} pieces were dropped so far",
        ends="output-blocked disk-blocked",
    )
    BRIDGE_LATE = _link(
        "bridge-late",
        _W,
        "{late} datagrams were ignored: they came more than 1 s late",
        "reports of vehicles are missing; a late one does not show how a vehicle flies now",
        "check the load of this machine, and the network between it and the bridge",
    )
    BRIDGE_LOSSES = _link(
        "bridge-losses",
        _W,
        "{missed} messages from it were lost; each has the reports of some milliseconds",
        "reports of vehicles are missing",
        "check the network between this machine and the bridge, and the load of both",
    )
    BRIDGE_ENDED = _link(
        "bridge-ended",
        _A,
        "ended ({cause}); it is started again",
        "no vehicle hears this service until the bridge runs again, mostly within a second",
        "if it repeats, check the log of the system and the memory of this machine",
    )
    BRIDGE_UNREAD = _link(
        "bridge-unread",
        _W,
        "{count} datagrams were dropped: command did not read them",
        "command was stopped or slow; the heartbeats went on",
        "check the load of the machine of command",
    )
    LEASE_MISSING = _link(
        "lease-missing",
        _A,
        "holds too few bridges ({bridges} missing): nothing is sent to the vehicles",
        "vehicles fly their verified missions to the end; their failsafes act when the heartbeats end",
        "check those bridges, and the network to them; see failover",
    )
    ORDER_NOT_TAKEN = _link(
        "order-not-taken",
        _W,
        "order {action} was not taken: this node sends nothing to the vehicles now",
        "nothing was done; the node that commands answers, if it got the order",
        "order again when this node commands, or at the node that commands",
    )
    LEASE_AGAIN = _link("lease-again", _I, "commands the vehicles again", ends="lease-missing")
    BRIDGE_UNRECORDED = _link(
        "bridge-unrecorded",
        _W,
        "its frames are not recorded: {problem}",
        "what the bridge hears while command is dead is in no recording",
        "make space on the disk of the bridge, or make its folder writable",
    )
    BRIDGE_RECORDED = _link("bridge-recorded", _I, "its frames are recorded again", ends="bridge-unrecorded")
    STANDBY_MISSING = _link(
        "standby-missing",
        _W,
        "no standby follows: if this service ends, no other node takes over",
        "the standby was not started, has ended, or does not reach this node",
        "start it; see failover",
    )
    STANDBY_FOLLOWS = _link("standby-follows", _I, "a standby follows", ends="standby-missing")
    BRIDGE_REFUSED = _link(
        "bridge-refused",
        _W,
        "{count} messages to vehicles were refused: their sender does not have the lease, or they came late",
        "another node commands the vehicles, or the connection to the bridge was interrupted",
        "end the one that should not command; see failover",
    )
    PROCESS_ENDED = _link(
        "process-ended",
        _W,
        "ended ({error}); it is started again in {pause_s:.1f} s, and the flight goes on",
        "the process of this part of the service has failed or was killed; pages of a console connect again "
        "by themselves",
        "wait; report it if it was not killed on purpose",
    )
    PROCESS_AGAIN = _link("process-again", _I, "runs again", ends="process-ended")
    PROCESS_GIVEN_UP = _link(
        "process-given-up",
        _A,
        "ended {starts} times in a row ({error}) and is not started again; the flight goes on",
        "the process fails each time; the pages of this console are gone",
        "report it; elsewhere `gcs console --zenoh` may serve a console",
    )
    CONSOLE_FAILED = _link(
        "console-failed",
        _W,
        "a request failed by a program error ({error}); all else goes on",
        "that request got no answer; at most once a minute",
        "report it",
    )
    UPLOADS_AWAITED = _link(
        "uploads-awaited",
        _W,
        "waiting for the mission uploads of {vehicles:agents}; press Ctrl-C again to end at once",
        "Ctrl-C during an upload: it is finished first, for 30 s at most",
        "wait",
    )
    UPLOADS_UNFINISHED = _link(
        "uploads-unfinished",
        _A,
        "{vehicles:agents} may store inconsistent missions: start the service again, or set the vehicles "
        "to LOITER with another ground station",
        "an upload was not finished: second Ctrl-C, or a poor link",
        "start `gcs run` again, which holds and clears them; or set them to LOITER",
    )
    SIMULATION_SLOW = _link(
        "simulation-slow",
        _W,
        "this machine is too slow for the simulation: {vehicles:agents} fell behind the clock; a lower "
        "--speed would help",
        "simulated vehicles fell behind the clock: they may be called lost",
        "a lower `--speed`, or end other programs",
    )
    SERVICE_SLOW = _mission(
        "service-slow",
        _W,
        "this machine cannot keep up: {lag_s:.1f} s of run time behind, {dropped} events dropped; {remedy}",
        "events wait for more than half a second",
        "end other programs, lower `telemetry.rate_hz`",
    )
    CLOCK_SET = _mission(
        "clock-set",
        _W,
        "the wall clock of this machine was set by {step_s:+.1f} s, or the machine was suspended; timers "
        "are not affected. Check that the sensors' clocks agree with it",
        "by more than 0.2 s. The flight runs on a monotonic clock",
        "check NTP or PTP",
    )
    # ------------------------------------------------------------ the run

    PLAN_MADE = _mission("plan-made", _I, "plan: {reason}; re-tasked: {routes}", ends="plan-waits")
    TARGET_REACHED = _vehicle("target-reached", _I, "reached target {target}")
    TARGET_LEFT = _vehicle("target-left", _I, "leaves target {target}")
    ORDER_ACCEPTED = _vehicle("order-accepted", _I, "order {action} accepted: {detail}")
    ORDER_DONE = _vehicle(
        "order-done", _I, "order {action} done: {detail}", ends="order-waits order-ended order-failed"
    )
    ORDER_REFUSED = _vehicle(
        "order-refused",
        _W,
        "order {action} refused: {detail}",
        "`would come within`, `would circle within`, `would fly into`: a mission or mode would lead it near "
        "another vehicle or the ground, or into a zone. "
        "`is not the plan that was shown any more`: the plan has changed; nothing was uploaded",
        "resume it when it is clear; read the new plan",
    )
    ORDER_FAILED = _vehicle(
        "order-failed",
        _A,
        "order {action} failed: {detail}",
        "the vehicle did not confirm it",
        ends="order-waits",
    )
    MISSION_ENDED = _mission(
        "mission-ended",
        _I,
        "mission ended: {arrived} arrived, {lost} lost[, {down} down][, {surplus} surplus]",
    )
    UNKNOWN = _mission("unknown", _I, "a notice of a later version of this software", "in recordings only")
