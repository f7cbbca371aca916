"""Pre-flight checks of one vehicle, from its answers to `gcs.mavlink.services.preflight_query`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import Config
from gcs.core.preflight.result import Check, CheckLevel
from gcs.core.preflight.return_heights import (
    MARGIN_M,
    ReturnHeight,
    return_height_check,
    return_of,
    returns_check,
)
from gcs.fence import Fence, fence_of, rally_of
from gcs.geo import LocalFrame
from gcs.mavlink.autopilots import FenceLimits, mode_name
from gcs.mavlink.autopilots.modes import AUTO, LOITER, RTL
from gcs.mavlink.autopilots.preflight_parameters import Envelope, WantedParameter
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.vehicle import Health
from gcs.mavlink.mission.geofence_rally import (
    FENCE,
    RALLY,
    fence_from_items,
    fence_items,
    list_difference,
    rally_items,
)
from gcs.mavlink.services.preflight_query import PreflightQuery
from gcs.model import NS_PER_S, FloatArray, vehicle_name

_TASKABLE: Final = (AUTO, LOITER)
_MIN_BATTERY: Final = (25, 50)
"""Battery in percent: refused below the first, warning below the second."""
_MAX_CLOCK_S: Final = 1.0
_HOME_M: Final = 50.0
"""Maximum distance of home from a vehicle on the ground."""
_MIN_SATELLITES: Final = 8
_SENSORS: Final = {
    dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO: "gyro",
    dialect.MAV_SYS_STATUS_SENSOR_3D_ACCEL: "accelerometer",
    dialect.MAV_SYS_STATUS_SENSOR_3D_MAG: "compass",
    dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE: "barometer",
    dialect.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE: "airspeed sensor",
    dialect.MAV_SYS_STATUS_SENSOR_GPS: "GPS",
    dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER: "remote control",
    dialect.MAV_SYS_STATUS_GEOFENCE: "fence",
    dialect.MAV_SYS_STATUS_AHRS: "attitude",
    dialect.MAV_SYS_STATUS_LOGGING: "logging",
    dialect.MAV_SYS_STATUS_SENSOR_BATTERY: "battery",
    dialect.MAV_SYS_STATUS_PREARM_CHECK: "pre-arm check",
}
_POSITION_OF: Final = {
    "EKF_STATUS_REPORT": dialect.EKF_POS_HORIZ_ABS,
    "ESTIMATOR_STATUS": dialect.ESTIMATOR_POS_HORIZ_ABS,
}


def envelope_of(config: Config, vehicle: int) -> Envelope:
    """Return the flight envelope that the mission needs of a vehicle."""
    airframe = config.airframe_of(vehicle)
    name = config.airframe_name(vehicle)
    table = f"airframes.{name}" if name else "airframe"
    return Envelope(airframe.speed_m_s, airframe.bank_deg, airframe.end == "land", table)


class VehicleChecks:
    """Checks of one vehicle.

    Parameters
    ----------
    routes_m : sequence of FloatArray
        Routes that the mission may have, (n, 2) east/north each, from the vehicle's position.
    has_key : bool
        True if there is a signing key for the vehicle here.
    """

    def __init__(
        self,
        query: PreflightQuery,
        fleet: Fleet,
        config: Config,
        routes_m: Sequence[FloatArray],
        t_ns: int,
        *,
        has_key: bool = False,
    ) -> None:
        self._has_key = has_key
        self._query = query
        self._config = config
        self._routes_m = routes_m
        self._t_ns = t_ns
        self._vehicle = query.vehicle
        self._state = fleet.state(self._vehicle)
        self._health: Health = next(h for h in fleet.health() if h.system_id == self._vehicle)
        self._messages = {name: message for name, (_, message) in query.messages.items()}

    def checks(self) -> list[Check]:
        """Return all rows."""
        if "HEARTBEAT" not in self._messages:
            remedy = "is it on, with this system id, and does it send to this machine (links.mavlink)?"
            return [self._row("link", "refused", "not heard", "heartbeats", remedy)]
        rows = [self._link(), self._firmware(), self._fix(), self._position(), self._home(), self._mode()]
        rows += [self._armed(), self._sensors(), *self._texts(), self._battery(), self._clock()]
        rows.append(self._signing())
        if self._query.profile is not None:
            rows += [*self._parameters(), *self._fence(), *self._rally(), *self._return_height()]
        return rows

    def _row(self, name: str, level: CheckLevel, value: str, wanted: str = "", remedy: str = "") -> Check:
        return Check(self._vehicle, name, level, value, wanted, "" if level == "ok" else remedy)

    # ------------------------------------------------------------ state

    def _link(self) -> Check:
        health = self._health
        part = health.lost / max(health.lost + health.frames, 1)
        where = "" if health.address is None else health.address[1]
        level: CheckLevel = "refused" if health.liveness != "alive" else "warning" if part > 0.1 else "ok"
        value = f"{health.liveness} at {where}, {100.0 * part:.0f} % lost"
        if health.conflicts:
            value = f"{value}, {health.conflicts} frames of another with its id"
            level = "refused"
        remedy = "antennas, range, radio rate; one system id each"
        return self._row("link", level, value, "alive, < 10 % lost", remedy)

    def _firmware(self) -> Check:
        profile = self._query.profile
        version = self._messages.get("AUTOPILOT_VERSION")
        if profile is None:
            value = f"MAV_AUTOPILOT {self._messages['HEARTBEAT'].autopilot}"
            remedy = "it is tracked, but never tasked"
            return self._row("firmware", "refused", value, "ArduPlane or PX4", remedy)
        if version is None:
            return self._row("firmware", "warning", profile.name, "a version", "no AUTOPILOT_VERSION")
        numbers = ".".join(str((version.flight_sw_version >> shift) & 0xFF) for shift in (24, 16, 8))
        return self._row("firmware", "ok", f"{profile.name} {numbers}")

    def _fix(self) -> Check:
        gps = self._messages.get("GPS_RAW_INT")
        if gps is None:
            return self._row("GPS", "refused", "not reported", "3D fix", "is there a receiver?")
        count = "" if gps.satellites_visible == 255 else f", {gps.satellites_visible} satellites"
        entry = dialect.enums["GPS_FIX_TYPE"].get(gps.fix_type)
        name = str(gps.fix_type) if entry is None else entry.name.removeprefix("GPS_FIX_TYPE_")
        few = gps.satellites_visible < _MIN_SATELLITES
        level: CheckLevel = (
            "refused" if gps.fix_type < dialect.GPS_FIX_TYPE_3D_FIX else "warning" if few else "ok"
        )
        wanted = f"3D fix, {_MIN_SATELLITES} satellites"
        return self._row("GPS", level, name + count, wanted, "wait, under open sky")

    def _position(self) -> Check:
        if self._state is None:
            why = ", ".join(self._health.refused) or "none came"
            return self._row("position", "refused", why, "near the origin", "wait for the EKF; check [frame]")
        for name, bit in _POSITION_OF.items():
            message = self._messages.get(name)
            if message is not None and not message.flags & bit:
                return self._row("position", "refused", "EKF without it", "EKF ready", "wait for the EKF")
        place = f"({self._state.east_m:.0f}, {self._state.north_m:.0f}) m, {self._state.alt_msl_m:.0f} m AMSL"
        area = self._config.map
        inside = 0 <= self._state.east_m <= area.width_m and 0 <= self._state.north_m <= area.height_m
        wanted = f"on the map, {area.width_m:.0f} x {area.height_m:.0f} m"
        level: CheckLevel = "ok" if inside else "warning"
        return self._row("position", level, place, wanted, "routes begin at the map's nearest cell")

    def _home(self) -> Check:
        home = self._health.home
        if home is None:
            return self._row("home", "refused", "not set", "set", "wait for the EKF's origin, or set home")
        east_m, north_m = self._config.local_frame.to_local(home.lat_deg, home.lon_deg)
        text = f"({east_m:.0f}, {north_m:.0f}) m, {home.alt_msl_m:.0f} m AMSL"
        state = self._state
        if state is not None and not state.armed:
            away_m = math.hypot(state.east_m - east_m, state.north_m - north_m)
            if away_m > _HOME_M:
                value = f"{text}: {away_m:.0f} m away"
                return self._row("home", "refused", value, f"within {_HOME_M:.0f} m", "set home anew")
        return self._row("home", "ok", text)

    def _mode(self) -> Check:
        mode = mode_name(self._messages["HEARTBEAT"])
        who = f"-v {vehicle_name(self._vehicle)}"
        if self._is_armed and mode not in _TASKABLE:
            remedy = f"it gets no mission in {mode}: gcs order resume {who}, when its pilot agrees"
        elif mode == AUTO and not self._is_armed:
            remedy = f"armed in AUTO it takes off with its onboard mission: gcs order hold {who}"
        elif mode == RTL:
            remedy = "a lost ground station puts it there, and it cannot be armed in RTL"
            remedy += f": gcs run, then gcs order hold {who}, or LOITER by the transmitter"
        elif mode not in _TASKABLE:
            remedy = f"it gets no mission in {mode}: gcs run, then gcs order hold {who}, or LOITER by hand"
        else:
            return self._row("mode", "ok", mode)
        return self._row("mode", "warning", mode, " or ".join(_TASKABLE), remedy)

    @property
    def _is_armed(self) -> bool:
        return bool(self._messages["HEARTBEAT"].base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)

    def _armed(self) -> Check:
        if not self._is_armed:
            return self._row("armed", "ok", "disarmed", "disarmed")
        remedy = "propellers may turn: keep away, or it flies already"
        return self._row("armed", "warning", "armed", "disarmed", remedy)

    def _sensors(self) -> Check:
        status = self._messages.get("SYS_STATUS")
        if status is None:
            return self._row("sensors", "warning", "not reported", "healthy", "no SYS_STATUS")
        enabled = status.onboard_control_sensors_present & status.onboard_control_sensors_enabled
        ill = [n for bit, n in _SENSORS.items() if enabled & bit & ~status.onboard_control_sensors_health]
        if not ill:
            return self._row("sensors", "ok", "healthy", "healthy")
        remedy = "see its messages below" if self._query.texts else "it gives no reason: inspect it"
        return self._row("sensors", "refused", f"{', '.join(ill)} not healthy", "healthy", remedy)

    def _texts(self) -> Iterator[Check]:
        """Yield the messages of the autopilot during the query."""
        for text in self._query.texts:
            yield self._row("message", "warning", text, "", "message of the autopilot (STATUSTEXT)")

    def _battery(self) -> Check:
        status = self._messages.get("SYS_STATUS")
        if status is None or not 0 <= status.battery_remaining <= 100:
            return self._row("battery", "warning", "not reported", "", "no battery monitor: watch it by hand")
        percent = status.battery_remaining
        refused, warned = _MIN_BATTERY
        level: CheckLevel = "refused" if percent < refused else "warning" if percent < warned else "ok"
        volts = "" if status.voltage_battery in (0, 65535) else f", {status.voltage_battery / 1e3:.1f} V"
        return self._row("battery", level, f"{percent} %{volts}", f"{warned} %", "charge it")

    def _clock(self) -> Check:
        if "SYSTEM_TIME" not in self._messages or not self._messages["SYSTEM_TIME"].time_unix_usec:
            remedy = "its logs and signing lack the time"
            return self._row("clock", "warning", "unknown to the vehicle", "GPS time", remedy)
        came_t_ns, message = self._query.messages["SYSTEM_TIME"]
        off_s = (message.time_unix_usec * 1000 - came_t_ns) / NS_PER_S
        level: CheckLevel = "ok" if abs(off_s) <= _MAX_CLOCK_S else "warning"
        value = f"{off_s:+.1f} s to ours"
        wanted = f"within {_MAX_CLOCK_S:.0f} s"
        return self._row("clock", level, value, wanted, "is this machine's clock set (NTP)?")

    def _signing(self) -> Check:
        signed = self._health.signed
        wanted = bool(self._config.links.keys)
        if signed and not self._has_key:
            text = "it may ignore our messages: put its key into links.keys (docs/signing.md)"
            return self._row("signing", "refused", "signed, no key for it here", "its key", text)
        level: CheckLevel = "ok" if signed or not wanted else "warning"
        value = "signed" if signed else "not signed"
        want = "signed" if wanted else ""
        return self._row("signing", level, value, want, "gcs keys install, if its link has a key")

    # ------------------------------------------------------------ parameters, fence and rally points

    def _parameters(self) -> Iterator[Check]:
        profile = self._query.profile
        values = self._query.values
        assert profile is not None
        if not values:
            yield self._row("parameters", "refused", "no answer", "", "is the link good enough both ways?")
            return
        for wish in (*profile.parameters, *profile.fits(envelope_of(self._config, self._vehicle))):
            yield self._parameter(wish, values)

    def _parameter(self, wish: WantedParameter, values: Mapping[str, float]) -> Check:
        found = wish.found(values)
        if found is None:
            names = " or ".join(wish.all_names)
            text = "no such parameter in this firmware, or the reply was lost: check by hand"
            return self._row(names, "warning", "no answer", wish.wanted, text)
        wish, name = found
        level: CheckLevel = "ok" if wish.accepts(values[name]) else "refused" if wish.must else "warning"
        meaning = wish.meanings.get(values[name], "")
        value = f"{values[name]:.6g}" + (f" ({meaning})" if meaning else "")
        first = wish.allowed[0] if wish.allowed else wish.low
        remedy = f"gcs param set CONFIG {name} {first:.6g}" if wish.low == wish.high else "set it"
        return self._row(name, level, value, wish.wanted, f"{remedy}: {wish.why}")

    def _fence(self) -> Iterator[Check]:
        profile = self._query.profile
        config = self._config
        assert profile is not None
        limits = profile.fence_limits(self._query.values)
        wanted = fence_of(config, config.name)
        onboard = self._query.onboard_lists.get(FENCE)
        yield self._fence_on_board(wanted, onboard)
        ceiling_m = self._query.values.get(profile.ceiling_parameter)
        wanted_m = wanted.max_alt_rel_m
        if wanted_m and ceiling_m != wanted_m:
            value = "no answer" if ceiling_m is None else f"{ceiling_m:g} m"
            remedy = f"gcs fence upload sets {profile.ceiling_parameter}"
            yield self._row("ceiling", "refused", value, f"{wanted_m:g} m", remedy)
        problem = self._breach(limits, None if onboard is None else fence_from_items(onboard))
        level: CheckLevel = "refused" if problem else "ok"
        value = problem or ("fits" if limits.is_on else "the fence is off")
        remedy = "it would breach its fence on the way: change the mission or the fence"
        yield self._row("mission in fence", level, value, "", remedy)

    def _fence_on_board(self, wanted: Fence, onboard: Sequence[object] | None) -> Check:
        items = fence_items(wanted)
        text = "not reported" if onboard is None else f"{len(onboard)} items" if onboard else "none"
        if onboard is None:
            level: CheckLevel = "refused" if items else "warning"
            return self._row("fence", level, text, "", "no reply to the download of its fence")
        if not items:
            return self._row("fence", "ok", text, "none in the mission file")
        if not list_difference(FENCE, items, self._query.onboard_lists[FENCE] or ()):
            return self._row("fence", "ok", text, "that of the mission file")
        level = "refused" if onboard or self._config.fence.areas else "warning"
        return self._row("fence", level, text, "that of the mission file", "gcs fence upload")

    def _rally(self) -> Iterator[Check]:
        items = rally_items(rally_of(self._config))
        onboard = self._query.onboard_lists.get(RALLY)
        if onboard is None:
            if items:
                wanted = f"{len(items)} points"
                yield self._row("rally", "refused", "not reported", wanted, "gcs fence upload")
            return
        same = not list_difference(RALLY, items, onboard)
        level: CheckLevel = "ok" if same else "refused" if items else "warning"
        value = f"{len(onboard)} points" + ("" if same or not onboard else ", others")
        wanted = f"{len(items)} points" if items else "none"
        yield self._row("rally", level, value, wanted, "gcs fence upload")

    def _return_height(self) -> Iterator[Check]:
        assert self._query.profile is not None
        profile = self._query.profile
        values = self._query.values
        ceiling_m = self._config.fence.max_alt_rel_m
        yield from return_height_check(
            self._vehicle, profile, values, _rally_heights_m(self._query, self._config), ceiling_m
        )

    def _breach(self, limits: FenceLimits, onboard: Fence | None) -> str:
        """Return how the mission would breach the vehicle's own fence; empty if it would not."""
        config = self._config
        frame = self._config.local_frame
        if not limits.is_on:
            return ""
        ceiling_m = limits.max_alt_rel_m
        altitude_m = config.mission.highest_rel_m
        if ceiling_m is not None and ceiling_m < altitude_m + MARGIN_M:
            return (
                f"ceiling at {ceiling_m:g} m, the highest layer at {altitude_m:g} m: less than {MARGIN_M:g} m"
            )
        if limits.max_radius_m is not None and (far_m := self._farthest_m(frame)) > limits.max_radius_m:
            return f"{far_m:.0f} m from home, the fence ends at {limits.max_radius_m:g} m"
        if limits.polygons and onboard is not None:
            beyond_m = max((onboard.beyond(route, frame) for route in self._routes_m), default=0.0)
            if beyond_m:
                return f"{beyond_m:.0f} m of a route lie beyond it"
        return ""

    def _farthest_m(self, frame: LocalFrame) -> float:
        home = self._health.home
        if home is None or not self._routes_m:
            return 0.0
        home_m = np.array(frame.to_local(home.lat_deg, home.lon_deg))
        return float(max(np.hypot(*(route - home_m).T).max() for route in self._routes_m))


def vehicle_checks(
    queries: Sequence[PreflightQuery],
    fleet: Fleet,
    config: Config,
    routes_m: Callable[[int], Sequence[FloatArray]],
    t_ns: int,
    has_key: Callable[[int], bool],
) -> list[Check]:
    """Check all vehicles; `has_key` returns True if there is a signing key for a vehicle here."""
    checks = [
        check
        for one in queries
        for check in VehicleChecks(
            one, fleet, config, routes_m(one.vehicle), t_ns, has_key=has_key(one.vehicle)
        ).checks()
    ]
    returns = [found for one in queries if (found := _return_of(one, config)) is not None]
    return [*checks, *returns_check(returns, config.mission.layer_step_m, config.fence.max_alt_rel_m)]


def _return_of(one: PreflightQuery, config: Config) -> ReturnHeight | None:
    if one.profile is None:
        return None
    return return_of(one.vehicle, one.profile, one.values, _rally_heights_m(one, config))


def _rally_heights_m(one: PreflightQuery, config: Config) -> list[float]:
    """Return the heights above home of the rally points on board and in the mission file."""
    return [point.z_m for point in (*rally_items(rally_of(config)), *(one.onboard_lists.get(RALLY) or ()))]
