"""Return heights of vehicles: below the fence's ceiling, and a layer step apart.

A return that climbs through the ceiling breaches the fence; PX4 then goes from RTL to Hold (GF_ACTION 2).
Altitude layers end where RTL begins: vehicles that return together fly at the heights that their autopilots
are set to.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import attrgetter
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import Config
from gcs.core.preflight.check_codes import CheckCode
from gcs.core.preflight.result import Check
from gcs.core.state import Agent
from gcs.fence import rally_of
from gcs.mavlink.autopilots import AutopilotProfile
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.on_ground import is_on_ground
from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, Message
from gcs.mavlink.services.parameter_protocol import decode_value
from gcs.mavlink.services.retry import ns
from gcs.model import Effect, Notice, NoticeCode, Parameter, system_of, vehicle_name

MARGIN_M: Final = 15.0
"""Minimum height between planned flight and a ceiling; an ArduPlane overshoots its take-off altitude by up to
11.3 m."""
_UNITS_PER_M: Final = {"RTL_ALTITUDE": 1.0, "ALT_HOLD_RTL": 100.0, "RTL_RETURN_ALT": 1.0}
"""Parameters that set a return height, with their units per metre."""
_TYPE: Final = "RTL_TYPE"
_MISSION_LANDING: Final = 1.0
"""RTL_TYPE of a PX4 that lands by its mission if that has a landing."""
_DESCENT: Final = "RTL_DESCEND_ALT"
"""Height of the circle in which the return of a PX4 ends."""
_DESCENT_M: Final = 100.0
"""Its default on fixed-wing vehicles (PX4, ROMFS/px4fmu_common/init.d/rc.fw_defaults)."""
_RADII: Final = frozenset({"WP_LOITER_RAD", "RTL_RADIUS", "NAV_LOITER_RAD", "RTL_LOITER_RAD"})
_HEARD: Final = frozenset({*_UNITS_PER_M, _TYPE, _DESCENT, *_RADII})
"""Parameters that are kept."""
_RADII_M: Final = (5.0, 1000.0)
"""Minimum and maximum radius of a circle that is accepted from a vehicle."""
_MAX_VALUE: Final = 1e6
"""Greater values are not those of a return height."""
_TOLERANCE_M: Final = 0.5
_MAX_NAMED: Final = 8
_REQUEST_S = 2.0
_QUICK_REQUESTS = 5
_SLOW_REQUEST_S = 30.0
"""Time between requests for a parameter; after some of them it is longer."""
_SET_APART: Final = "Set them a layer apart before the next flight (gcs preflight), and return one at a time"


@dataclass(frozen=True, slots=True)
class ReturnHeight:
    """Return height of one vehicle."""

    vehicle: int
    height_m: float
    """Height above home."""
    source: str
    """The parameter or rally point that sets the height, in words."""
    parameter: str
    """Name of that parameter; empty if a rally point alone sets the height."""
    value: float
    """Value of the parameter, in its own unit."""

    @property
    def words(self) -> str:
        """Vehicle, height and source, in words."""
        return f"{vehicle_name(self.vehicle)} at {self.height_m:g} m ({self.source})"

    def raised_to(self, height_m: float) -> str:
        """Return the command that sets another return height."""
        value = self.value + (height_m - self.height_m) * _UNITS_PER_M[self.parameter]
        return f"gcs param set CONFIG {self.parameter} {value:g} -v {vehicle_name(self.vehicle)}"


def return_of(
    vehicle: int, profile: AutopilotProfile, values: Mapping[str, float], rally_m: Sequence[float]
) -> ReturnHeight | None:
    """Return the return height of a vehicle; None if its parameters do not give it.

    Of several rally points the highest counts, as if it were the nearest.
    """
    possible = profile.return_heights(values, rally_m)
    if not possible:
        return None
    first = possible[0]
    return ReturnHeight(
        vehicle, first.height_m, first.source, first.parameter, values.get(first.parameter, 0.0)
    )


def _too_close(heights: Sequence[ReturnHeight], step_m: float) -> list[ReturnHeight]:
    """Return the heights that are nearer to another one than `step_m`, the lowest first."""
    near: list[ReturnHeight] = []
    for lower, upper in pairwise(sorted(heights, key=lambda one: (one.height_m, one.vehicle))):
        if upper.height_m - lower.height_m < step_m - _TOLERANCE_M:
            near += [one for one in (lower, upper) if one not in near]
    return near


class ReturnHeightMonitor:
    """Return heights of vehicles in flight, from the parameters that were heard.

    They are requested when a vehicle is heard first, and again until it answers. They are also heard when
    `gcs preflight`, `gcs param` or another ground station requests them through the service.
    """

    def __init__(self, config: Config, fleet: Fleet, agents: Mapping[int, Agent]) -> None:
        self._fleet = fleet
        self._agents = agents
        self._step_m = config.mission.layer_step_m
        self._rally_m = [float(point.alt_rel_m) for point in rally_of(config)]

    def receive(self, vehicle: int, message: Message) -> None:
        """Process a message of a vehicle: keep the parameters of its return height and its circles."""
        if message.get_type() == "PARAM_VALUE" and message.param_id in _HEARD:
            agent = self._agents[vehicle]
            value = decode_value(message, agent.link.is_atomic)
            if abs(value) <= _MAX_VALUE:  # a number
                agent.returns.parameters[message.param_id] = value

    def check(self, t_ns: int) -> list[Effect]:
        """Request the parameters that are not known, and tell which vehicles in the air return together."""
        requests = [effect for vehicle in self._agents for effect in self._request(vehicle, t_ns)]
        near = {one.vehicle for one in self._near(self._agents)}
        is_new = False
        was_told = any(agent.returns.is_told for agent in self._agents.values())
        for vehicle, agent in self._agents.items():
            is_new |= vehicle in near and not agent.returns.is_told
            agent.returns.is_told = vehicle in near
        if was_told and not near:
            return [*requests, Notice(t_ns, NoticeCode.RETURNS_APART)]
        if not is_new:
            return requests
        parameters: dict[str, Parameter] = {
            "heights": self._words(self._near(near)),
            "remedy": _SET_APART,
        }
        return [*requests, Notice(t_ns, NoticeCode.RETURNS_NEAR, None, parameters)]

    def _request(self, vehicle: int, t_ns: int) -> list[Effect]:
        """Request the parameters of a vehicle that has not told them."""
        agent = self._agents[vehicle]
        profile = self._fleet.profile(vehicle)
        returns = agent.returns
        if profile is None or not agent.link.has_telemetry or t_ns < returns.next_request_t_ns:
            return []
        circles = (profile.return_circle_parameter, *profile.radius_parameters)
        names = [name for name in (*profile.return_parameters, *circles) if name]
        is_known = not returns.parameters.keys().isdisjoint(_UNITS_PER_M)
        if is_known and returns.parameters.keys() >= {_TYPE, *circles} & set(names):
            return []
        wait_s = _REQUEST_S if returns.requests < _QUICK_REQUESTS else _SLOW_REQUEST_S
        returns.requests = returns.requests + 1
        returns.next_request_t_ns = t_ns + ns(wait_s)
        messages = [
            dialect.MAVLink_param_request_read_message(
                system_of(vehicle), AUTOPILOT_COMPONENT_ID, name.encode(), -1
            )
            for name in names
        ]
        return [*self._fleet.address_frames(vehicle, map(self._fleet.encoder(vehicle), messages))]

    def _near(self, vehicles: Iterable[int]) -> list[ReturnHeight]:
        """Return the heights in flight that are nearer to another one than a layer step."""
        return _too_close([one for v in sorted(vehicles) if (one := self._of(v)) is not None], self._step_m)

    def _words(self, near: Sequence[ReturnHeight]) -> str:
        return f"agents {_listed(near)} return less than {self._step_m:g} m apart in height"

    def warning(self, vehicles: Collection[int]) -> str:
        """Return a warning of vehicles that would return nearer in height than a layer step; else empty."""
        near = self._near(vehicles)
        return f"{self._words(near)}: hold one until the other is down, or watch them" if near else ""

    def height(self, vehicle: int) -> ReturnHeight | None:
        """Return the return height of a vehicle; None if its parameters were not heard."""
        profile = self._fleet.profile(vehicle)
        if profile is None:
            return None
        return return_of(vehicle, profile, self._agents[vehicle].returns.parameters, self._rally_m)

    def circle_height_m(self, vehicle: int) -> float | None:
        """Return the height above home to which a return descends at its end; None: it does not descend."""
        profile = self._fleet.profile(vehicle)
        if profile is None or not profile.return_circle_parameter:
            return None
        return self._agents[vehicle].returns.parameters.get(_DESCENT, _DESCENT_M)

    def circle_radius_m(self, vehicle: int, *, in_return: bool = False) -> float | None:
        """Return the radius of a vehicle's circles in LOITER, or RTL; None if it was not heard.

        In metres, negative for circles to the left.
        """
        profile = self._fleet.profile(vehicle)
        if profile is None:
            return None
        radius_m = profile.circle_radius_m(self._agents[vehicle].returns.parameters, in_return=in_return)
        is_usable = radius_m is not None and _RADII_M[0] <= abs(radius_m) <= _RADII_M[1]
        return radius_m if is_usable else None

    def lands_by_mission(self, vehicle: int) -> bool:
        """Return True if a vehicle that returns flies to the landing of its mission, if that has one."""
        return self._agents[vehicle].returns.parameters.get(_TYPE) == _MISSION_LANDING

    def _of(self, vehicle: int) -> ReturnHeight | None:
        """Return the return height of a vehicle in flight."""
        if is_on_ground(self._fleet.state(vehicle), self._fleet.home(vehicle)):
            return None
        return self.height(vehicle)


def returns_check(heights: Sequence[ReturnHeight], step_m: float, ceiling_m: float = 0.0) -> Iterator[Check]:
    """Warn of vehicles whose return heights are nearer to each other than altitude layers.

    Parameters
    ----------
    step_m : float
        Height between altitude layers; 0: there is one layer, and no check.
    ceiling_m : float
        Ceiling of the mission file, above home; 0 for none.
    """
    if step_m <= 0.0 or len(heights) < 2:
        return
    near = _too_close(heights, step_m)
    if not near:
        listed = ", ".join(f"{one.height_m:g}" for one in heights[:_MAX_NAMED])
        yield Check(None, CheckCode.RETURNS_APART, {"heights": listed})
        return
    parameters: dict[str, Parameter] = {"heights": _listed(near), "step_m": step_m}
    if not all(one.parameter for one in near):
        yield Check(None, CheckCode.RETURNS_NEAR_BY_RALLY, parameters)
        return
    commands = []
    apart_m = sorted(one.height_m for one in heights if one not in near)
    height_m = near[0].height_m
    max_height_m = ceiling_m - MARGIN_M if ceiling_m else math.inf
    for one in near[1:_MAX_NAMED]:
        height_m = max(height_m + step_m, one.height_m)
        for other_m in apart_m:
            if abs(height_m - other_m) < step_m - _TOLERANCE_M:
                height_m = other_m + step_m
        if height_m > one.height_m:
            commands.append(one.raised_to(height_m))
    if height_m <= max_height_m:
        yield Check(None, CheckCode.RETURNS_NEAR, parameters | {"commands": ", ".join(commands)})
        return
    parameters |= {"lowest_m": near[0].height_m, "highest_m": height_m, "max_height_m": max_height_m}
    yield Check(None, CheckCode.RETURNS_NEAR_UNDER_CEILING, parameters)


def _listed(near: Sequence[ReturnHeight]) -> str:
    """Return the first of some vehicles with their heights, and how many more there are."""
    more = f" and {len(near) - _MAX_NAMED} more" if len(near) > _MAX_NAMED else ""
    return ", ".join(one.words for one in near[:_MAX_NAMED]) + more


def return_height_check(
    vehicle: int,
    profile: AutopilotProfile,
    values: Mapping[str, float],
    rally_m: Sequence[float],
    ceiling_m: float,
    obstacle_m: float = 0.0,
    clearance_m: float = 0.0,
) -> Iterator[Check]:
    """Check the maximum return height of a vehicle; nothing if its parameters do not give it.

    Parameters
    ----------
    rally_m : sequence of float
        Heights above home of the rally points: the vehicle's, and those of the mission file.
    ceiling_m : float
        Ceiling of the mission file, above home; 0 for none.
    obstacle_m, clearance_m : float
        Height above home of the highest obstacle whose height is known, and vertical clearance.
    """
    possible = profile.return_heights(values, rally_m)
    if not possible:
        return
    highest = max(possible, key=attrgetter("height_m"))
    height_m = highest.height_m
    parameters: dict[str, Parameter] = {"height_m": height_m, "source": highest.source}
    limits = profile.fence_limits(values)
    ceilings_m = [limits.max_alt_rel_m] if limits.is_on and limits.max_alt_rel_m else []
    ceilings_m += [ceiling_m] if ceiling_m else []
    if not ceilings_m or height_m <= (highest_m := min(ceilings_m) - MARGIN_M):
        lowest = min(possible, key=attrgetter("height_m"))
        if obstacle_m and lowest.height_m < obstacle_m + clearance_m:
            parameters |= {"height_m": lowest.height_m, "source": lowest.source}
            parameters |= {"obstacle_m": obstacle_m, "min_height_m": obstacle_m + clearance_m}
            yield Check(vehicle, CheckCode.RETURN_LOW, parameters)
            return
        yield Check(vehicle, CheckCode.RETURN_HEIGHT, parameters)
        return
    parameters |= {"max_height_m": highest_m, "margin_m": MARGIN_M}
    yield Check(vehicle, CheckCode.RETURN_NEAR_CEILING, parameters)
