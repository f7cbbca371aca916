"""Preflight checks of one vehicle: link, fix, home, mode, battery, clock, parameters, fence, return."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import Config
from gcs.core.airspace.obstacle_map import ObstacleMap
from gcs.core.preflight.check_codes import CheckCode
from gcs.core.preflight.rally_circles import DISC, RallyCircles, return_radius_m
from gcs.core.preflight.result import Check
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
from gcs.model import NS_PER_S, FloatArray, Parameter

_RETURN_SAMPLES: Final = 200
"""Places on the straight line to home at which the ground is read."""
_TASKABLE: Final = (AUTO, LOITER)
_MIN_BATTERY: Final = (25, 50)
"""Battery in percent: refused below the first, warning below the second."""
_MAX_CLOCK_S: Final = 1.0
_HOME_M: Final = 50.0
"""Maximum distance of home from a vehicle on the ground."""
_MIN_SATELLITES: Final = 8
_UNKNOWN_SATELLITES: Final = 255
_MAX_LOSS: Final = 0.1
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
    lands = airframe.end == "land"
    return Envelope(
        airframe.speed_m_s,
        airframe.bank_deg,
        lands,
        table,
        config.terrain is not None,
        airframe.climb_m_s,
        airframe.sink_m_s,
    )


class VehicleChecks:
    """Checks of one vehicle.

    Parameters
    ----------
    routes_m : sequence of FloatArray
        Routes that the mission may have, (n, 2) east/north each, from the vehicle's position.
    obstacles : ObstacleMap
        Obstacles of the mission file.
    has_key : bool
        True if there is a signing key for the vehicle here.
    """

    def __init__(
        self,
        query: PreflightQuery,
        fleet: Fleet,
        config: Config,
        routes_m: Sequence[FloatArray],
        obstacles: ObstacleMap,
        t_ns: int,
        *,
        has_key: bool = False,
    ) -> None:
        self._has_key = has_key
        self._query = query
        self._config = config
        self._routes_m = routes_m
        self._obstacles = obstacles
        self._t_ns = t_ns
        self._vehicle = query.vehicle
        self._state = fleet.state(self._vehicle)
        self._health: Health = next(h for h in fleet.health() if h.system_id == self._vehicle)
        self._messages = {name: message for name, (_, message) in query.messages.items()}

    def checks(self) -> list[Check]:
        """Return all findings."""
        if "HEARTBEAT" not in self._messages:
            return [self._found(CheckCode.NOT_HEARD)]
        rows = [self._link(), self._firmware(), self._fix(), self._position(), self._home(), self._mode()]
        rows += [self._armed(), self._sensors(), *self._texts(), self._battery(), self._clock()]
        rows.append(self._signing())
        if self._query.profile is not None:
            rows += [*self._altitude_control(), *self._parameters(), *self._fence(), *self._rally()]
            rows += [*self._rally_circles(), *self._return_height()]
        return rows

    def _found(self, code: CheckCode, **parameters: Parameter) -> Check:
        return Check(self._vehicle, code, parameters)

    # ------------------------------------------------------------ state

    def _link(self) -> Check:
        health = self._health
        part = health.lost / max(health.lost + health.frames, 1)
        code = CheckCode.LINK_LOSSY if part > _MAX_LOSS else CheckCode.LINK
        if health.liveness != "alive":
            code = CheckCode.LINK_SILENT
        if health.conflicts:
            code = CheckCode.LINK_SHARED
        return self._found(
            code,
            liveness=health.liveness,
            address="" if health.address is None else health.address[1],
            lost_percent=100.0 * part,
            conflicts=health.conflicts,
        )

    def _firmware(self) -> Check:
        profile = self._query.profile
        version = self._messages.get("AUTOPILOT_VERSION")
        if profile is None:
            return self._found(CheckCode.FIRMWARE_UNKNOWN, autopilot=self._messages["HEARTBEAT"].autopilot)
        if version is None:
            return self._found(CheckCode.NO_VERSION, firmware=profile.name)
        numbers = ".".join(str((version.flight_sw_version >> shift) & 0xFF) for shift in (24, 16, 8))
        return self._found(CheckCode.FIRMWARE, firmware=profile.name, version=numbers)

    def _fix(self) -> Check:
        gps = self._messages.get("GPS_RAW_INT")
        if gps is None:
            return self._found(CheckCode.NO_GPS)
        code = CheckCode.FEW_SATELLITES if gps.satellites_visible < _MIN_SATELLITES else CheckCode.FIX
        if gps.fix_type < dialect.GPS_FIX_TYPE_3D_FIX:
            code = CheckCode.NO_FIX
        entry = dialect.enums["GPS_FIX_TYPE"].get(gps.fix_type)
        return self._found(
            code,
            fix=str(gps.fix_type) if entry is None else entry.name.removeprefix("GPS_FIX_TYPE_"),
            satellites="" if gps.satellites_visible == _UNKNOWN_SATELLITES else gps.satellites_visible,
            min_satellites=_MIN_SATELLITES,
        )

    def _position(self) -> Check:
        if self._state is None:
            reasons = ", ".join(self._health.refused)
            code = CheckCode.POSITION_REFUSED if reasons else CheckCode.NO_POSITION
            return self._found(code, reasons=reasons)
        for name, bit in _POSITION_OF.items():
            message = self._messages.get(name)
            if message is not None and not message.flags & bit:
                return self._found(CheckCode.POSITION_NOT_ESTIMATED)
        area = self._config.map
        inside = 0 <= self._state.east_m <= area.width_m and 0 <= self._state.north_m <= area.height_m
        return self._found(
            CheckCode.POSITION if inside else CheckCode.OUTSIDE_MAP,
            east_m=self._state.east_m,
            north_m=self._state.north_m,
            alt_msl_m=self._state.alt_msl_m,
            width_m=area.width_m,
            height_m=area.height_m,
        )

    def _home(self) -> Check:
        home = self._health.home
        if home is None:
            return self._found(CheckCode.NO_HOME)
        east_m, north_m = self._config.local_frame.to_local(home.lat_deg, home.lon_deg)
        state = self._state
        away_m = 0.0
        if state is not None and not state.armed:
            away_m = math.hypot(state.east_m - east_m, state.north_m - north_m)
        frame_msl_m = self._config.frame.alt_msl_m
        max_off_m = self._config.planning.vertical_clearance_m
        code = CheckCode.HOME
        if _uses_heights(self._config) and abs(home.alt_msl_m - frame_msl_m) > max_off_m:
            code = CheckCode.HOME_HEIGHT_OFF
        return self._found(
            CheckCode.HOME_FAR if away_m > _HOME_M else code,
            wanted_msl_m=frame_msl_m,
            max_off_m=max_off_m,
            east_m=east_m,
            north_m=north_m,
            alt_msl_m=home.alt_msl_m,
            distance_m=away_m,
            max_distance_m=_HOME_M,
        )

    def _mode(self) -> Check:
        mode = mode_name(self._messages["HEARTBEAT"])
        code = CheckCode.MODE
        if self._is_armed and mode not in _TASKABLE:
            code = CheckCode.PILOT_FLIES
        elif mode == AUTO and not self._is_armed:
            code = CheckCode.AUTO_ON_GROUND
        elif mode == RTL:
            code = CheckCode.RTL_ON_GROUND
        elif mode not in _TASKABLE:
            code = CheckCode.MODE_NOT_TASKED
        return self._found(code, mode=mode)

    def _altitude_control(self) -> Iterator[Check]:
        """Refuse a vehicle whose altitude control has not reached its altitude since its start."""
        profile = self._query.profile
        assert profile is not None
        rate_m_s = self._query.values.get(profile.altitude_reference_parameter, 0.0)
        is_unknown = self._state is None or "SYSTEM_TIME" not in self._messages
        if is_unknown or rate_m_s <= 0.0 or self._is_armed:
            return
        assert self._state is not None
        came_t_ns, message = self._query.messages["SYSTEM_TIME"]
        runs_s = message.time_boot_ms * 1e-3 + (self._t_ns - came_t_ns) / NS_PER_S
        needed_s = self._state.alt_msl_m / rate_m_s
        is_low = runs_s < needed_s and self._state.mode not in profile.modes_without_altitude
        yield self._found(
            CheckCode.ALTITUDE_CONTROL_LOW if is_low else CheckCode.ALTITUDE_CONTROL,
            runs_s=runs_s,
            alt_msl_m=self._state.alt_msl_m,
            needed_s=math.ceil(needed_s),
            wait_s=math.ceil(max(needed_s - runs_s, 0.0)),
        )

    @property
    def _is_armed(self) -> bool:
        return bool(self._messages["HEARTBEAT"].base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)

    def _armed(self) -> Check:
        return self._found(CheckCode.ARMED if self._is_armed else CheckCode.DISARMED)

    def _sensors(self) -> Check:
        status = self._messages.get("SYS_STATUS")
        if status is None:
            return self._found(CheckCode.NO_SENSOR_STATUS)
        enabled = status.onboard_control_sensors_present & status.onboard_control_sensors_enabled
        ill = [n for bit, n in _SENSORS.items() if enabled & bit & ~status.onboard_control_sensors_health]
        if not ill:
            return self._found(CheckCode.SENSORS)
        has_reason = bool(self._query.texts)
        code = CheckCode.SENSORS_UNHEALTHY_EXPLAINED if has_reason else CheckCode.SENSORS_UNHEALTHY
        return self._found(code, sensors=", ".join(ill))

    def _texts(self) -> Iterator[Check]:
        """Yield the messages of the autopilot during the query."""
        for text in self._query.texts:
            yield self._found(CheckCode.MESSAGE, text=text)

    def _battery(self) -> Check:
        status = self._messages.get("SYS_STATUS")
        if status is None or not 0 <= status.battery_remaining <= 100:
            return self._found(CheckCode.NO_BATTERY_STATUS)
        percent = status.battery_remaining
        refused, warned = _MIN_BATTERY
        code = CheckCode.BATTERY_LOW if percent < warned else CheckCode.BATTERY
        if percent < refused:
            code = CheckCode.BATTERY_EMPTY
        volts = "" if status.voltage_battery in (0, 65535) else status.voltage_battery / 1e3
        return self._found(code, percent=percent, volts=volts, min_percent=warned)

    def _clock(self) -> Check:
        if "SYSTEM_TIME" not in self._messages or not self._messages["SYSTEM_TIME"].time_unix_usec:
            return self._found(CheckCode.NO_CLOCK)
        came_t_ns, message = self._query.messages["SYSTEM_TIME"]
        off_s = (message.time_unix_usec * 1000 - came_t_ns) / NS_PER_S
        code = CheckCode.CLOCK if abs(off_s) <= _MAX_CLOCK_S else CheckCode.CLOCK_OFF
        return self._found(code, off_s=off_s, max_off_s=_MAX_CLOCK_S)

    def _signing(self) -> Check:
        if self._health.signed:
            return self._found(CheckCode.SIGNED if self._has_key else CheckCode.NO_KEY)
        has_keys = bool(self._config.links.keys)
        return self._found(CheckCode.UNSIGNED if has_keys else CheckCode.UNSIGNED_WITHOUT_KEYS)

    # ------------------------------------------------------------ parameters, fence and rally points

    def _parameters(self) -> Iterator[Check]:
        profile = self._query.profile
        values = self._query.values
        assert profile is not None
        if not values:
            yield self._found(CheckCode.NO_PARAMETERS)
            return
        for wish in (*profile.parameters, *profile.fits(envelope_of(self._config, self._vehicle))):
            yield self._parameter(wish, values)

    def _parameter(self, wish: WantedParameter, values: Mapping[str, float]) -> Check:
        found = wish.found(values)
        if found is None:
            names = " or ".join(wish.all_names)
            return self._found(CheckCode.NO_PARAMETER, parameters=names, required=wish.wanted)
        wish, name = found
        value = values[name]
        code = CheckCode.PARAMETER_WRONG if wish.must else CheckCode.PARAMETER_UNWISE
        return self._found(
            CheckCode.PARAMETER if wish.accepts(value) else code,
            parameter=name,
            value=value,
            meaning=wish.meanings.get(value, ""),
            required=wish.wanted,
            only=wish.low if wish.low == wish.high else "",
            why=wish.why,
        )

    def _fence(self) -> Iterator[Check]:
        profile = self._query.profile
        config = self._config
        assert profile is not None
        limits = profile.fence_limits(self._query.values)
        wanted = fence_of(config, config.name)
        onboard = self._query.onboard_lists.get(FENCE)
        yield self._fence_on_board(wanted, onboard)
        name = profile.ceiling_parameter
        ceiling_m = self._query.values.get(name)
        required_m = wanted.max_alt_rel_m
        if required_m and ceiling_m is None:
            yield self._found(CheckCode.NO_CEILING, required_m=required_m, parameter=name)
        elif required_m and ceiling_m is not None and ceiling_m != required_m:
            yield self._found(
                CheckCode.CEILING_DIFFERS, ceiling_m=ceiling_m, required_m=required_m, parameter=name
            )
        yield self._breach(limits, None if onboard is None else fence_from_items(onboard))

    def _fence_on_board(self, wanted: Fence, onboard: Sequence[object] | None) -> Check:
        items = fence_items(wanted)
        if onboard is None:
            return self._found(CheckCode.FENCE_NOT_READ if items else CheckCode.NO_FENCE_STATUS)
        code = CheckCode.FENCE_DIFFERS if onboard or self._config.fence.areas else CheckCode.FENCE_MISSING
        if not items:
            code = CheckCode.NO_FENCE_WANTED
        elif not list_difference(FENCE, items, self._query.onboard_lists[FENCE] or ()):
            code = CheckCode.FENCE_STORED
        return self._found(code, count=len(onboard))

    def _rally(self) -> Iterator[Check]:
        items = rally_items(rally_of(self._config))
        onboard = self._query.onboard_lists.get(RALLY)
        if onboard is None:
            if items:
                yield self._found(CheckCode.RALLY_NOT_READ, required=len(items))
            return
        code = CheckCode.RALLY_DIFFERS if items else CheckCode.RALLY_NOT_WANTED
        if not list_difference(RALLY, items, onboard):
            code = CheckCode.RALLY
        yield self._found(code, count=len(onboard), required=len(items))

    def _rally_circles(self) -> Iterator[Check]:
        assert self._query.profile is not None
        home = self._health.home
        if home is None:
            return
        yield from RallyCircles(
            self._vehicle,
            self._config,
            self._obstacles,
            self._query.profile,
            self._query.values,
            home.alt_msl_m,
        ).checks()

    def _return_height(self) -> Iterator[Check]:
        assert self._query.profile is not None
        profile = self._query.profile
        values = self._query.values
        ceiling_m = self._config.max_alt_rel_m
        yield from return_height_check(
            self._vehicle,
            profile,
            values,
            _rally_heights_m(self._query, self._config),
            ceiling_m,
            _highest_obstacle_m(self._config),
            self._config.planning.vertical_clearance_m,
        )
        yield from self._return_over_terrain()

    def _return_over_terrain(self) -> Iterator[Check]:
        """Check that straight returns from the routes, and circles at home, keep above the ground."""
        elevation = self._config.elevation
        returns = _return_of(self._query, self._config)
        home = self._health.home
        profile = self._query.profile
        if elevation is None or self._config.terrain is None or returns is None or home is None:
            return
        assert profile is not None
        home_m = np.array(self._config.local_frame.to_local(home.lat_deg, home.lon_deg))
        points_m = np.concatenate([np.empty((0, 2)), *self._routes_m])
        share = np.linspace(0.0, 1.0, _RETURN_SAMPLES)[:, None, None]
        turn_radius_m = self._config.airframes_of_agents[self._vehicle].turn_radius_m
        radius_m = return_radius_m(profile, self._query.values, turn_radius_m)
        circle_m = home_m + radius_m * DISC
        yield from self._return_circle(elevation.heights_at(circle_m), radius_m, home.alt_msl_m)
        lines_m = (home_m + share * (points_m - home_m)).reshape(-1, 2)
        ground_m = elevation.heights_at(np.concatenate([lines_m, circle_m]))
        if not np.isfinite(ground_m).any():
            return
        needed_m = float(np.nanmax(ground_m)) - home.alt_msl_m + self._config.terrain.flown_min_agl_m
        if returns.height_m < needed_m:
            yield self._found(
                CheckCode.RETURN_INTO_GROUND,
                height_m=returns.height_m,
                source=returns.source,
                min_height_m=math.ceil(needed_m),
            )

    def _return_circle(self, ground_m: FloatArray, radius_m: float, home_msl_m: float) -> Iterator[Check]:
        """Check that the circle to which a return descends keeps above the ground."""
        assert self._query.profile is not None
        assert self._config.terrain is not None
        parameter = self._query.profile.return_circle_parameter
        height_m = self._query.values.get(parameter)
        if height_m is None or not np.isfinite(ground_m).any():
            return
        needed_m = float(np.nanmax(ground_m)) - home_msl_m + self._config.terrain.flown_min_agl_m
        if height_m < needed_m:
            yield self._found(
                CheckCode.RETURN_CIRCLE_INTO_GROUND,
                height_m=height_m,
                parameter=parameter,
                radius_m=radius_m,
                min_height_m=math.ceil(needed_m),
            )

    def _breach(self, limits: FenceLimits, onboard: Fence | None) -> Check:
        """Return whether the mission stays inside the vehicle's own fence."""
        frame = self._config.local_frame
        if not limits.is_on:
            return self._found(CheckCode.FENCE_OFF)
        ceiling_m = limits.max_alt_rel_m
        altitude_m = self._config.mission.highest_rel_m
        if ceiling_m is not None and ceiling_m < altitude_m + MARGIN_M:
            return self._found(
                CheckCode.LAYER_NEAR_CEILING, ceiling_m=ceiling_m, altitude_m=altitude_m, margin_m=MARGIN_M
            )
        if limits.max_radius_m is not None and (far_m := self._farthest_m(frame)) > limits.max_radius_m:
            return self._found(CheckCode.ROUTE_BEYOND_RADIUS, distance_m=far_m, radius_m=limits.max_radius_m)
        if limits.polygons and onboard is not None:
            beyond_m = max((onboard.beyond(route, frame) for route in self._routes_m), default=0.0)
            if beyond_m:
                return self._found(CheckCode.ROUTE_BEYOND_FENCE, beyond_m=beyond_m)
        return self._found(CheckCode.MISSION_IN_FENCE)

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
    obstacles: ObstacleMap,
    t_ns: int,
    has_key: Callable[[int], bool],
) -> list[Check]:
    """Check all vehicles; `has_key` returns True if there is a signing key for a vehicle here."""
    checks = [
        check
        for one in queries
        for check in VehicleChecks(
            one, fleet, config, routes_m(one.vehicle), obstacles, t_ns, has_key=has_key(one.vehicle)
        ).checks()
    ]
    returns = [found for one in queries if (found := _return_of(one, config)) is not None]
    return [*checks, *returns_check(returns, config.mission.layer_step_m, config.max_alt_rel_m)]


def _uses_heights(config: Config) -> bool:
    """Return True if heights of the mission file count from the height of the frame's origin."""
    is_converted = config.fence.max_alt_msl_m is not None or config.mission.altitude_msl_m is not None
    is_converted |= any(point.alt_rel_m is None for point in config.rally)
    return is_converted or bool(config.area_limits)


def _highest_obstacle_m(config: Config) -> float:
    """Return the height above home of the highest area with a ceiling; 0 without one."""
    tops_m = [one.above_level_ground(config.frame.alt_msl_m)[1] for one in config.area_limits]
    return max((top_m for top_m in tops_m if math.isfinite(top_m)), default=0.0)


def _return_of(one: PreflightQuery, config: Config) -> ReturnHeight | None:
    if one.profile is None:
        return None
    return return_of(one.vehicle, one.profile, one.values, _rally_heights_m(one, config))


def _rally_heights_m(one: PreflightQuery, config: Config) -> list[float]:
    """Return the heights above home of the rally points on board and in the mission file."""
    return [point.z_m for point in (*rally_items(rally_of(config)), *(one.onboard_lists.get(RALLY) or ()))]
