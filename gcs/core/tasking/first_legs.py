"""First legs of new missions: whether a vehicle flies the line that was planned for it.

ArduPlane tracks the line from the waypoint before to the item that it flies to. A selection that does not
break with the old waypoint makes it fly a line that nobody planned, hundreds of metres off, and pass its
waypoint as far off (recorded: 300 to 1349 m). So each selection is watched for a few seconds: the vehicle is
asked for NAV_CONTROLLER_OUTPUT, which tells its cross-track error and the distance to its waypoint, and for
MISSION_CURRENT, which tells that these are still about the first leg. A leg that starts where the vehicle is
cannot be farther off than the vehicle has flown since, and its waypoint is as far away as the item is. A leg
that is off is started again by another selection, and the operator is told.

In recorded flights good legs were up to 10 m outside that bound, wrong ones 31 m and more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.tasking.onboard_missions import OnboardMission
from gcs.mavlink.autopilots.modes import AUTO
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.command_sender import REQUEST_MESSAGE, command_long, set_current_item
from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, Effect, Notice, VehicleState

_OFF_M: Final = 20.0
_DISTANCE_OFF_M: Final = 40.0
"""Greatest error of the distance to the waypoint, beside what the vehicle flies in `_REPORT_AGE_S`."""
_REPORT_AGE_S: Final = 1.0
_WATCH_NS: Final = ns(4.0)
_PERIOD_NS: Final = ns(0.4)
_SAMPLES: Final = 2
"""In a row, before a leg counts as off: the first may have been made before the selection was heard."""
_MAX_CORRECTIONS: Final = 3
_ASKED: Final = (dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT, dialect.MAVLINK_MSG_ID_MISSION_CURRENT)


@dataclass(slots=True)
class _Leg:
    """The first leg of one vehicle's new mission."""

    seq: int
    place_m: tuple[float, float]
    """Where its item is: east, north."""
    began_t_ns: int
    next_t_ns: int
    problem: str = ""
    """Why the newest sample is off its line; empty when it is not."""
    has_sample: bool = False
    off: int = 0
    corrections: int = 0


class FirstLegs:
    """All first legs that are watched.

    Parameters
    ----------
    fleet : Fleet
        Where vehicles are, and their addresses.
    """

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet
        self._legs: dict[int, _Leg] = {}

    def begin(self, flown: OnboardMission, seq: int, began_t_ns: int, t_ns: int) -> None:
        """Watch the leg to item `seq`, which was selected at `began_t_ns`.

        Only points of a route are watched, and only where the firmware may start a leg elsewhere.
        """
        vehicle, index = flown.route.vehicle, seq - flown.first_point
        profile = self._fleet.profile(vehicle)
        if profile is None or not profile.tracks_old_leg or not 0 <= index < len(flown.route.points_m):
            return
        east_m, north_m = flown.route.points_m[index].tolist()
        self._legs[vehicle] = _Leg(seq, (east_m, north_m), began_t_ns, t_ns)
        self._fleet.watch_leg(vehicle, watched=True)

    def end(self, vehicle: int) -> None:
        """Watch a vehicle's leg no longer: it gets another mission, or another mode."""
        if self._legs.pop(vehicle, None) is not None:
            self._fleet.watch_leg(vehicle, watched=False)

    def poll(self, t_ns: int) -> list[Effect]:
        """Ask for what shows how the legs are flown."""
        effects: list[Effect] = []
        for vehicle, leg in list(self._legs.items()):
            if t_ns - leg.began_t_ns > _WATCH_NS:
                self.end(vehicle)
            elif t_ns >= leg.next_t_ns:
                leg.next_t_ns = t_ns + _PERIOD_NS
                effects += self._sends(
                    vehicle, [command_long(vehicle, REQUEST_MESSAGE, number) for number in _ASKED]
                )
        return effects

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Take a vehicle's message."""
        leg, state = self._legs.get(vehicle), self._fleet.state(vehicle)
        if leg is None or state is None:
            return []
        if state.mode not in ("", AUTO):
            self.end(vehicle)
        elif message.get_type() == "NAV_CONTROLLER_OUTPUT":
            leg.problem, leg.has_sample = _problem(message, leg, state, t_ns), True
        elif message.get_type() == "MISSION_CURRENT" and message.seq > leg.seq:
            self.end(vehicle)
        elif message.get_type() == "MISSION_CURRENT" and message.seq == leg.seq and leg.has_sample:
            leg.has_sample = False
            leg.off = leg.off + 1 if leg.problem else 0
            if leg.off >= _SAMPLES:
                return self._correct(vehicle, leg, t_ns)
        return []

    def _correct(self, vehicle: int, leg: _Leg, t_ns: int) -> list[Effect]:
        """Start the leg again where the vehicle is, or say that this does not help."""
        profile = self._fleet.profile(vehicle)
        assert profile is not None  # watched
        if leg.corrections >= _MAX_CORRECTIONS:
            self.end(vehicle)
            text = f"its first leg is still wrong after {leg.corrections} selections of item {leg.seq}: "
            return [Notice(t_ns, "alarm", f"{text}{leg.problem}; hold it, or call it back", vehicle)]
        leg.corrections += 1
        leg.off, leg.has_sample = 0, False
        leg.began_t_ns = t_ns
        effects = self._sends(vehicle, [set_current_item(vehicle, profile, leg.seq)])
        if leg.corrections == 1:
            text = f"its first leg is wrong: {leg.problem}; item {leg.seq} is selected again"
            effects.append(Notice(t_ns, "warning", text, vehicle))
        return effects

    def _sends(self, vehicle: int, messages: list[Message]) -> list[Effect]:
        return [*self._fleet.address_frames(vehicle, map(self._fleet.encoder(vehicle), messages))]


def _problem(output: Message, leg: _Leg, state: VehicleState, t_ns: int) -> str:
    """Say what a NAV_CONTROLLER_OUTPUT tells against a leg; empty when it fits."""
    speed_m_s, off_m = state.ground_speed_m_s, abs(output.xtrack_error)
    if off_m > _OFF_M + speed_m_s * (t_ns - leg.began_t_ns) / NS_PER_S:
        return f"{off_m:.0f} m off its line"
    to_go_m = math.hypot(leg.place_m[0] - state.east_m, leg.place_m[1] - state.north_m)
    if abs(output.wp_dist - to_go_m) > _DISTANCE_OFF_M + speed_m_s * _REPORT_AGE_S:
        return f"it flies to a waypoint {output.wp_dist} m away, its own is {to_go_m:.0f} m away"
    return ""
