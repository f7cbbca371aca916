"""First legs of new missions: a vehicle that flies another line than its new leg gets the item again.

ArduPlane tracks the line from its previous waypoint to the current item. If a selection keeps the previous
waypoint of the old mission, the vehicle flies an unplanned line and passes its waypoint hundreds of metres
off. So each selection is monitored for a few seconds. NAV_CONTROLLER_OUTPUT gives the cross-track error and
the distance to the waypoint; MISSION_CURRENT shows that they belong to the first leg. A correct leg starts at
the vehicle: its cross-track error is at most the distance flown since. A wrong leg is started again by
another selection, with a notice.
"""

from __future__ import annotations

import math
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.tasking.tasking_state import FirstLeg, OnboardMission
from gcs.mavlink.autopilots.modes import AUTO
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.command_sender import REQUEST_MESSAGE, command_long, set_current_item
from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S, Effect, Notice, NoticeCode, Parameter, VehicleState

_OFF_M: Final = 20.0
_DISTANCE_OFF_M: Final = 40.0
"""Maximum error of the distance to the waypoint, plus the distance flown in `_REPORT_AGE_S`."""
_REPORT_AGE_S: Final = 1.0
"""Maximum age of a position with which the distance is compared."""
_WATCH_NS: Final = ns(4.0)
_PERIOD_NS: Final = ns(0.4)
_SAMPLES: Final = 2
"""Consecutive wrong samples before a correction; the first may precede the selection."""
_MAX_CORRECTIONS: Final = 3
_REQUESTED: Final = (dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT, dialect.MAVLINK_MSG_ID_MISSION_CURRENT)


class FirstLegs:
    """Monitor of first legs."""

    def __init__(self, fleet: Fleet, legs: dict[int, FirstLeg]) -> None:
        self._fleet = fleet
        self._legs = legs

    def begin(self, mission: OnboardMission, seq: int, began_t_ns: int, t_ns: int) -> None:
        """Monitor the leg to item `seq`, which was selected at `began_t_ns`.

        Only route points are monitored, and only with firmware that may start a leg elsewhere.
        """
        vehicle = mission.route.vehicle
        index = seq - mission.first_point
        profile = self._fleet.profile(vehicle)
        if profile is None or not profile.tracks_old_leg or not 0 <= index < len(mission.route.points_m):
            return
        east_m, north_m = mission.route.points_m[index].tolist()
        self._legs[vehicle] = FirstLeg(seq, (east_m, north_m), began_t_ns, t_ns)
        self._fleet.watch_leg(vehicle, watched=True)

    def end(self, vehicle: int) -> None:
        """End the monitoring of a vehicle."""
        if self._legs.pop(vehicle, None) is not None:
            self._fleet.watch_leg(vehicle, watched=False)

    def poll(self, t_ns: int) -> list[Effect]:
        """Request the messages that show the flown legs."""
        effects: list[Effect] = []
        for vehicle, leg in list(self._legs.items()):
            if t_ns - leg.began_t_ns > _WATCH_NS:
                self.end(vehicle)
            elif t_ns >= leg.next_t_ns:
                leg.next_t_ns = t_ns + _PERIOD_NS
                effects += self._send(
                    vehicle, [command_long(vehicle, REQUEST_MESSAGE, number) for number in _REQUESTED]
                )
        return effects

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Process a message of a vehicle."""
        leg = self._legs.get(vehicle)
        state = self._fleet.state(vehicle)
        if leg is None or state is None:
            return []
        if state.mode not in ("", AUTO):
            self.end(vehicle)
        elif message.get_type() == "NAV_CONTROLLER_OUTPUT":
            leg.problem = _problem(message, leg, state, t_ns)
            leg.has_sample = True
        elif message.get_type() == "MISSION_CURRENT" and message.seq > leg.seq:
            self.end(vehicle)
        elif message.get_type() == "MISSION_CURRENT" and message.seq == leg.seq and leg.has_sample:
            leg.has_sample = False
            leg.off = leg.off + 1 if leg.problem else 0
            if leg.off >= _SAMPLES:
                return self._correct(vehicle, leg, t_ns)
        return []

    def _correct(self, vehicle: int, leg: FirstLeg, t_ns: int) -> list[Effect]:
        """Start the leg again at the vehicle; raise an alarm if that has not helped."""
        profile = self._fleet.profile(vehicle)
        assert profile is not None  # watched
        if leg.corrections >= _MAX_CORRECTIONS:
            self.end(vehicle)
            about: dict[str, Parameter] = {
                "selections": leg.corrections,
                "item": leg.seq,
                "problem": leg.problem,
            }
            return [Notice(t_ns, NoticeCode.FIRST_LEG_STILL_WRONG, vehicle, about)]
        leg.corrections += 1
        leg.off = 0
        leg.has_sample = False
        leg.began_t_ns = t_ns
        effects = self._send(vehicle, [set_current_item(vehicle, profile, leg.seq)])
        if leg.corrections == 1:
            found: dict[str, Parameter] = {"problem": leg.problem, "item": leg.seq}
            effects.append(Notice(t_ns, NoticeCode.FIRST_LEG_WRONG, vehicle, found))
        return effects

    def _send(self, vehicle: int, messages: list[Message]) -> list[Effect]:
        return [*self._fleet.address_frames(vehicle, map(self._fleet.encoder(vehicle), messages))]


def _problem(output: Message, leg: FirstLeg, state: VehicleState, t_ns: int) -> str:
    """Return the error that a NAV_CONTROLLER_OUTPUT shows; empty if there is none."""
    speed_m_s = state.ground_speed_m_s
    off_m = abs(output.xtrack_error)
    if off_m > _OFF_M + speed_m_s * (t_ns - leg.began_t_ns) / NS_PER_S:
        return f"{off_m:.0f} m off its line"
    if t_ns - state.t_ns > _REPORT_AGE_S * NS_PER_S:
        return ""  # the distance is from where the vehicle was
    to_go_m = math.hypot(leg.item_m[0] - state.east_m, leg.item_m[1] - state.north_m)
    if abs(output.wp_dist - to_go_m) > _DISTANCE_OFF_M + speed_m_s * _REPORT_AGE_S:
        return f"it flies to a waypoint {output.wp_dist} m away, its own is {to_go_m:.0f} m away"
    return ""
