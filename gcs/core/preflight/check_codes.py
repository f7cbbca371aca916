"""Levels and words of the preflight checks: for each finding its code, the name of the check, and texts.

This table is the only place with the words of the checks. Programs use the code, the vehicle and the
parameters. Value, wanted and remedy are templates (`gcs.model.templates`).
"""

from __future__ import annotations

from functools import partial
from typing import Final, Literal, TypeAlias

from gcs.model.code_table import Entry, TableCode

CheckLevel: TypeAlias = Literal["ok", "warning", "refused"]
"""Refused: do not fly."""


def _entry(level: CheckLevel, code: str, check: str, found: str, wanted: str = "", remedy: str = "") -> Entry:
    return code, {"level": level, "check": check, "found": found, "wanted": wanted, "remedy": remedy}


_ok = partial(_entry, "ok")
_warning = partial(_entry, "warning")
_refused = partial(_entry, "refused")

_LINK: Final = "{liveness} at {address}, {lost_percent:.0f} % lost"
_LINK_WANTED: Final = "alive, < 10 % lost"
_LINK_REMEDY: Final = "antennas, range, radio rate; one system id each"
_FIX: Final = "{fix}[, {satellites} satellites]"
_FIX_WANTED: Final = "3D fix, {min_satellites} satellites"
_PLACE: Final = "({east_m:.0f}, {north_m:.0f}) m, {alt_msl_m:.0f} m AMSL"
_ON_MAP: Final = "on the map, {width_m:.0f} x {height_m:.0f} m"
_MODES: Final = "AUTO or LOITER"
_BATTERY: Final = "{percent} %[, {volts:.1f} V]"
_BATTERY_WANTED: Final = "{min_percent} %"
_CLOCK: Final = "{off_s:+.1f} s to ours"
_CLOCK_WANTED: Final = "within {max_off_s:.0f} s"
_PARAMETER: Final = "{value:.6g}[ ({meaning})]"
_SET_PARAMETER: Final = "set it[ (gcs param set CONFIG {parameter} {only:.6g})]: {why}"
_OF_MISSION_FILE: Final = "that of the mission file"
_UPLOAD: Final = "gcs fence upload"
_BREACHES: Final = "it would breach its fence on the way: change the mission or the fence"
_RALLY: Final = "rally point {number}"
_RALLY_CIRCLE: Final = (
    "({lat_deg:.5f}, {lon_deg:.5f}), circle of {radius_m:.0f} m at {height_m:g} m above home"
)
_RETURN: Final = "{height_m:g} m ({source})"
_RETURNS: Final = "agents {heights}"
_RETURNS_WANTED: Final = "{step_m:g} m between them"
_MEETING: Final = "sent home together they meet at one height: return them one after another"
_CLIMB: Final = (
    "{length_m:.0f} m along {heading_deg:.0f} degrees to {altitude_m:g} m, "
    "there at ({east_m:.0f}, {north_m:.0f}) m"
)
_ROUTES: Final = "{count} routes, the longest {longest_m:.0f} m"
_SEPARATION: Final = "{used} of {layers} layers, at {heights} m"
_SCANS: Final = "{count} of {sensor}, {detections:.0f} detections each, {age_s:+.2f} s old"


class CheckCode(TableCode):
    """Identity of a finding. Its value is stable."""

    level: CheckLevel
    check: str
    """Template of the name of the check."""
    found: str
    """Template of the value."""
    wanted: str
    remedy: str
    """Template of what to do; empty if it is ok."""

    # ------------------------------------------------------------ link and firmware

    NOT_HEARD = _refused(
        "not-heard", "link", "not heard", "heartbeats",
        "is it on, with this system id, and does it send to this machine (links.mavlink)?",
    )  # fmt: skip
    LINK_SILENT = _refused("link-silent", "link", _LINK, _LINK_WANTED, _LINK_REMEDY)
    LINK_SHARED = _refused(
        "link-shared",
        "link",
        _LINK + ", {conflicts} frames of another with its id",
        _LINK_WANTED,
        _LINK_REMEDY,
    )
    LINK_LOSSY = _warning("link-lossy", "link", _LINK, _LINK_WANTED, _LINK_REMEDY)
    LINK = _ok("link", "link", _LINK, _LINK_WANTED)
    FIRMWARE_UNKNOWN = _refused(
        "firmware-unknown", "firmware", "MAV_AUTOPILOT {autopilot}", "ArduPlane or PX4",
        "it is tracked, but never tasked",
    )  # fmt: skip
    NO_VERSION = _warning("no-version", "firmware", "{firmware}", "a version", "no AUTOPILOT_VERSION")
    FIRMWARE = _ok("firmware", "firmware", "{firmware} {version}")

    # ------------------------------------------------------------ position

    NO_GPS = _refused("no-gps", "GPS", "not reported", "3D fix", "is there a receiver?")
    NO_FIX = _refused("no-fix", "GPS", _FIX, _FIX_WANTED, "wait, under open sky")
    FEW_SATELLITES = _warning("few-satellites", "GPS", _FIX, _FIX_WANTED, "wait, under open sky")
    FIX = _ok("fix", "GPS", _FIX, _FIX_WANTED)
    NO_POSITION = _refused(
        "no-position", "position", "none came", "near the origin", "wait for the EKF; check the table frame"
    )
    POSITION_REFUSED = _refused(
        "position-refused",
        "position",
        "{reasons}",
        "near the origin",
        "wait for the EKF; check the table frame",
    )
    POSITION_NOT_ESTIMATED = _refused(
        "position-not-estimated", "position", "EKF without it", "EKF ready", "wait for the EKF"
    )
    OUTSIDE_MAP = _warning(
        "outside-map", "position", _PLACE, _ON_MAP, "routes begin at the map's nearest cell"
    )
    POSITION = _ok("position", "position", _PLACE, _ON_MAP)
    NO_HOME = _refused("no-home", "home", "not set", "set", "wait for the EKF's origin, or set home")
    HOME_FAR = _refused(
        "home-far",
        "home",
        _PLACE + ": {distance_m:.0f} m away",
        "within {max_distance_m:.0f} m",
        "set home anew",
    )
    HOME_HEIGHT_OFF = _refused(
        "home-height-off", "home",
        "{alt_msl_m:.0f} m above sea level, the mission file's origin {wanted_msl_m:g} m",
        "within {max_off_m:g} m", "heights of obstacles and fence count from frame.alt_msl_m: correct it, or "
        "wait for a better fix and set home anew",
    )  # fmt: skip
    HOME = _ok("home", "home", _PLACE)

    # ------------------------------------------------------------ state

    PILOT_FLIES = _warning(
        "pilot-flies", "mode", "{mode}", _MODES,
        "it gets no mission in {mode}: gcs order resume -v {vehicle:agent}, when its pilot agrees",
    )  # fmt: skip
    AUTO_ON_GROUND = _warning(
        "auto-on-ground", "mode", "{mode}", _MODES,
        "armed in AUTO it takes off with its onboard mission: gcs order hold -v {vehicle:agent}",
    )  # fmt: skip
    RTL_ON_GROUND = _warning(
        "rtl-on-ground", "mode", "{mode}", _MODES,
        "a lost ground station puts it there, and it cannot be armed in RTL: gcs run, then gcs order hold "
        "-v {vehicle:agent}, or LOITER by the transmitter",
    )  # fmt: skip
    MODE_NOT_TASKED = _warning(
        "mode-not-tasked", "mode", "{mode}", _MODES,
        "it gets no mission in {mode}: gcs run, then gcs order hold -v {vehicle:agent}, or LOITER by hand",
    )  # fmt: skip
    MODE = _ok("mode", "mode", "{mode}")
    ALTITUDE_CONTROL_LOW = _refused(
        "altitude-control-low", "altitude control",
        "started {runs_s:.0f} s ago, {alt_msl_m:.0f} m above sea level", "{needed_s} s after its start",
        "the altitude that PX4 controls rises from sea level after a start (FW_T_CLMB_R_SP): after its "
        "take-off it would descend. Wait {wait_s} s, or set MANUAL by the transmitter for some seconds, and "
        "check it there",
    )  # fmt: skip
    ALTITUDE_CONTROL = _ok("altitude-control", "altitude control", "started {runs_s:.0f} s ago")
    ARMED = _warning(
        "armed", "armed", "armed", "disarmed", "propellers may turn: keep away, or it flies already"
    )
    DISARMED = _ok("disarmed", "armed", "disarmed", "disarmed")
    NO_SENSOR_STATUS = _warning("no-sensor-status", "sensors", "not reported", "healthy", "no SYS_STATUS")
    SENSORS_UNHEALTHY = _refused(
        "sensors-unhealthy", "sensors", "{sensors} not healthy", "healthy",
        "it gives no reason: inspect it",
    )  # fmt: skip
    SENSORS_UNHEALTHY_EXPLAINED = _refused(
        "sensors-unhealthy-explained", "sensors", "{sensors} not healthy", "healthy", "see its messages below"
    )
    SENSORS = _ok("sensors", "sensors", "healthy", "healthy")
    MESSAGE = _warning("message", "message", "{text}", "", "message of the autopilot (STATUSTEXT)")
    NO_BATTERY_STATUS = _warning(
        "no-battery-status", "battery", "not reported", "", "no battery monitor: watch it by hand"
    )
    BATTERY_EMPTY = _refused("battery-empty", "battery", _BATTERY, _BATTERY_WANTED, "charge it")
    BATTERY_LOW = _warning("battery-low", "battery", _BATTERY, _BATTERY_WANTED, "charge it")
    BATTERY = _ok("battery", "battery", _BATTERY, _BATTERY_WANTED)
    NO_CLOCK = _warning(
        "no-clock", "clock", "unknown to the vehicle", "GPS time", "its logs and signing lack the time"
    )
    CLOCK_OFF = _warning("clock-off", "clock", _CLOCK, _CLOCK_WANTED, "is this machine's clock set (NTP)?")
    CLOCK = _ok("clock", "clock", _CLOCK, _CLOCK_WANTED)
    CLOCK_SET = _warning(
        "clock-set", "clock", "set by {step_s:+.1f} s during the checks", "not set",
        "check again: ages of scans may be wrong",
    )  # fmt: skip
    NO_KEY = _refused(
        "no-key", "signing", "signed, no key for it here", "its key",
        "it may ignore our messages: put its key into links.keys (docs/signing.md)",
    )  # fmt: skip
    UNSIGNED = _warning(
        "unsigned", "signing", "not signed", "signed", "gcs keys install, if its link has a key"
    )
    SIGNED = _ok("signed", "signing", "signed")
    UNSIGNED_WITHOUT_KEYS = _ok("unsigned-without-keys", "signing", "not signed")

    # ------------------------------------------------------------ parameters, fence and rally points

    NO_PARAMETERS = _refused(
        "no-parameters", "parameters", "no answer", "", "is the link good enough both ways?"
    )
    NO_PARAMETER = _warning(
        "no-parameter", "{parameters}", "no answer", "{required}",
        "no such parameter in this firmware, or the reply was lost: check by hand",
    )  # fmt: skip
    PARAMETER_WRONG = _refused("parameter-wrong", "{parameter}", _PARAMETER, "{required}", _SET_PARAMETER)
    PARAMETER_UNWISE = _warning("parameter-unwise", "{parameter}", _PARAMETER, "{required}", _SET_PARAMETER)
    PARAMETER = _ok("parameter", "{parameter}", _PARAMETER, "{required}")
    FENCE_NOT_READ = _refused(
        "fence-not-read", "fence", "not reported", "", "no reply to the download of its fence"
    )
    NO_FENCE_STATUS = _warning(
        "no-fence-status", "fence", "not reported", "", "no reply to the download of its fence"
    )
    FENCE_DIFFERS = _refused("fence-differs", "fence", "{count} items", _OF_MISSION_FILE, _UPLOAD)
    FENCE_MISSING = _warning("fence-missing", "fence", "none", _OF_MISSION_FILE, _UPLOAD)
    FENCE_STORED = _ok("fence-stored", "fence", "{count} items", _OF_MISSION_FILE)
    NO_FENCE_WANTED = _ok("no-fence-wanted", "fence", "{count} items", "none in the mission file")
    NO_CEILING = _refused(
        "no-ceiling", "ceiling", "no answer", "{required_m:g} m", "gcs fence upload sets {parameter}"
    )
    CEILING_DIFFERS = _refused(
        "ceiling-differs",
        "ceiling",
        "{ceiling_m:g} m",
        "{required_m:g} m",
        "gcs fence upload sets {parameter}",
    )
    LAYER_NEAR_CEILING = _refused(
        "layer-near-ceiling", "mission in fence",
        "ceiling at {ceiling_m:g} m, the highest layer at {altitude_m:g} m: less than {margin_m:g} m", "",
        _BREACHES,
    )  # fmt: skip
    ROUTE_BEYOND_RADIUS = _refused(
        "route-beyond-radius", "mission in fence",
        "{distance_m:.0f} m from home, the fence ends at {radius_m:g} m", "", _BREACHES,
    )  # fmt: skip
    ROUTE_BEYOND_FENCE = _refused(
        "route-beyond-fence", "mission in fence", "{beyond_m:.0f} m of a route lie beyond it", "", _BREACHES
    )
    FENCE_OFF = _ok("fence-off", "mission in fence", "the fence is off")
    MISSION_IN_FENCE = _ok("mission-in-fence", "mission in fence", "fits")
    RALLY_NOT_READ = _refused("rally-not-read", "rally", "not reported", "{required} points", _UPLOAD)
    RALLY_DIFFERS = _refused(
        "rally-differs", "rally", "{count} points, not those", "{required} points", _UPLOAD
    )
    RALLY_NOT_WANTED = _warning("rally-not-wanted", "rally", "{count} points", "none", _UPLOAD)
    RALLY = _ok("rally", "rally", "{count} points", "{required} points")
    RALLY_INTO_GROUND = _refused(
        "rally-into-ground", _RALLY, _RALLY_CIRCLE + ", {above_m:.0f} m above the ground",
        "at least {min_above_m:g} m above the ground",
        "a return ends in this circle: raise the rally point to {min_alt_rel_m:g} m above home, or move it, "
        "then " + _UPLOAD,
    )  # fmt: skip
    RALLY_BEYOND_FENCE = _refused(
        "rally-beyond-fence", _RALLY, _RALLY_CIRCLE + ", {beyond_m:.0f} m of it beyond the fence",
        "{min_away_m:.0f} m inside the fence",
        "a return ends in this circle, and breaches the fence: move the rally point, then " + _UPLOAD,
    )  # fmt: skip
    RALLY_NEAR_OBSTACLE = _refused(
        "rally-near-obstacle", _RALLY,
        _RALLY_CIRCLE + ", an obstacle or no-fly zone {away_m:.0f} m from the point",
        "none within {min_away_m:.0f} m",
        "a return ends in this circle: move the rally point, or raise it above the obstacle, then " + _UPLOAD,
    )  # fmt: skip
    RALLY_CIRCLE = _ok("rally-circle", _RALLY, _RALLY_CIRCLE)
    RETURN_NEAR_CEILING = _refused(
        "return-near-ceiling", "return height", _RETURN,
        "at most {max_height_m:g} m, {margin_m:g} m below the ceiling",
        "RTL would climb into the ceiling: lower it, or the rally points, or raise the ceiling",
    )  # fmt: skip
    RETURN_LOW = _warning(
        "return-low", "return height", _RETURN, "at least {min_height_m:g} m",
        "RTL flies straight, and obstacles of the mission file are up to {obstacle_m:g} m high",
    )  # fmt: skip
    RETURN_INTO_GROUND = _refused(
        "return-into-ground", "return height", _RETURN, "at least {min_height_m:g} m",
        "RTL flies straight home and circles there: the ground is higher; raise it, or choose a rally point",
    )  # fmt: skip
    RETURN_CIRCLE_INTO_GROUND = _refused(
        "return-circle-into-ground", "return circle",
        "{height_m:g} m ({parameter}), {radius_m:g} m round home",
        "at least {min_height_m:g} m",
        "a return ends in a circle at this height, and the ground there is higher: raise it",
    )  # fmt: skip
    RETURN_HEIGHT = _ok("return-height", "return height", _RETURN)
    RETURNS_NEAR = _warning(
        "returns-near", "return heights", _RETURNS, _RETURNS_WANTED, _MEETING + ", or {commands}"
    )
    RETURNS_NEAR_UNDER_CEILING = _warning(
        "returns-near-under-ceiling", "return heights", _RETURNS, _RETURNS_WANTED,
        _MEETING + ", or begin below {lowest_m:g} m where ground and obstacles allow it, or raise "
        "fence.max_alt_rel_m: heights {step_m:g} m apart from {lowest_m:g} m on reach {highest_m:g} m, and "
        "{max_height_m:g} m are allowed",
    )  # fmt: skip
    RETURNS_NEAR_BY_RALLY = _warning(
        "returns-near-by-rally", "return heights", _RETURNS, _RETURNS_WANTED,
        _MEETING + ", or fly without rally points: then RTL_ALTITUDE of each counts",
    )  # fmt: skip
    RETURNS_APART = _ok("returns-apart", "return heights", "{heights} m")

    # ------------------------------------------------------------ the mission

    TAKEOFF_OBSTRUCTED = _refused(
        "takeoff-obstructed", "take-off", _CLIMB + "; {problem}", "a clear climb and first turn", "{remedy}"
    )
    TAKEOFF = _ok("takeoff", "take-off", _CLIMB)
    STANDING_NEAR = _warning(
        "standing-near", "standing", "{vehicles:agents} stand near each other: {distance_m:.0f} m",
        "{min_distance_m:g} m apart",
        "arm them one after another: gcs order arm {first:agent}, wait until it has climbed to its altitude, "
        "then gcs order arm {second:agent}",
    )  # fmt: skip
    LANDINGS_NEAR = _warning(
        "landings-near", "landing", "{vehicles:agents} land near each other: {distance_m:.0f} m",
        "{min_distance_m:g} m apart",
        "they land one after another: clear the strip in between, or let them start farther apart",
    )  # fmt: skip
    LANDING_INTO_GROUND = _refused(
        "landing-into-ground", "landing", "{vehicles:agents} cannot land over this terrain",
        "an approach that keeps above the ground",
        'let missions end with a circle (mission.end = "loiter"), or start where the ground is lower',
    )  # fmt: skip
    NO_ROUTE = _refused("no-route", "routes", "no route for {vehicles:agents}", "a route for all", "{notes}")
    NO_ROUTES = _refused("no-routes", "routes", "no route for any vehicle", "a route for all", "{notes}")
    ROUTES_WITH_NOTES = _warning("routes-with-notes", "routes", _ROUTES, "", "{notes}")
    ROUTES = _ok("routes", "routes", _ROUTES)
    ROUTES_NEAR = _warning(
        "routes-near", "separation", _SEPARATION + "; {pairs} come near each other", "a layer each",
        "more mission.layers, or watch them",
    )  # fmt: skip
    ROUTES_APART = _ok("routes-apart", "separation", _SEPARATION)
    NO_AREAS = _warning(
        "no-areas", "fence", "no areas in the mission file", "a table fence", "docs/preflight.md"
    )
    CEILING_ONLY = _ok("ceiling-only", "fence", "no areas in the mission file, but a ceiling")
    ROUTES_BEYOND_FENCE = _refused(
        "routes-beyond-fence", "fence", "beyond the fence: {distances}", "within",
        "move the starts, or draw it wider",
    )  # fmt: skip
    AREAS_NOT_HELD = _warning(
        "areas-not-held", "fence",
        "{count} areas that vehicles do not hold: missions pass above or below them", "",
        "autopilots hold an area at all heights; a pilot's flight is not kept out of these",
    )  # fmt: skip
    ROUTES_IN_FENCE = _ok("routes-in-fence", "fence", "{count} areas, routes within")
    LINK_WARNING = _warning("link-warning", "link", "{notice}")
    LINK_NEWS = _ok("link-news", "link", "{notice}")
    BAD_SCANS = _refused("bad-scans", "scans", "{problem}", "", "docs/sensors.md")
    NO_SCANS = _refused(
        "no-scans", "scans", "none in {waited_s:.0f} s", "scans", "do sensors publish to links.zenoh?"
    )
    SCANS_OFF = _refused("scans-off", "scans", _SCANS, _CLOCK_WANTED, "check the clocks")
    SCANS = _ok("scans", "scans", _SCANS, _CLOCK_WANTED)
