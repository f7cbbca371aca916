"""Second commander: another service with our system and component id that commands our vehicles.

Two signs:

* A vehicle answers requests that this service did not send: its COMMAND_ACK, or a message of the mission
  protocol, is addressed to our ids. Other ground stations have other ids, also those at our own endpoints.
* Heartbeats of another instance with our ids arrive on a vehicles' link (`gcs.mavlink.fleet.own_ids`).

An alarm names the sign and where it was heard. The vehicle, or all vehicles of the network with the
heartbeats, are not tasked until an operator orders `resume`. After that order the sign is a warning, until it
has ended for `_ENDED_NS`: the operator has decided.

Answers to our own requests may be late or come twice, also those to the service before a restart. So an
answer within `SETTLED_NS` of a request of its kind, of the start of the service, or of the return of the
link, is ours. A single one is no sign.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.authority.authority_state import AuthorityState
from gcs.core.state import Agent
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.fleet.own_ids import SETTLED_NS
from gcs.mavlink.fleet.peers import Address
from gcs.mavlink.frames.codec import OWN_IDS, Message, frame_at, target_of
from gcs.mavlink.router.access_policy import MISSION_PROTOCOL, command_of
from gcs.mavlink.services.retry import ns
from gcs.model import (
    NS_PER_S,
    Authority,
    ControlEvent,
    Effect,
    Notice,
    NoticeCode,
    Parameter,
    Send,
    network_of,
    vehicle_id,
)

_MISSION: Final = 0
"""Instead of a command, for messages of the mission protocol."""
_ANSWERS: Final = frozenset(
    {
        "COMMAND_ACK",
        "MISSION_REQUEST",
        "MISSION_REQUEST_INT",
        "MISSION_ACK",
        "MISSION_COUNT",
        "MISSION_ITEM_INT",
    }
)
_HEARTBEAT: Final[int] = dialect.MAVLINK_MSG_ID_HEARTBEAT
_MIN_UNASKED: Final = 2
_MAX_GAP_NS: Final = ns(60.0)
"""Longest time between two such answers."""
_ENDED_NS: Final = ns(60.0)
_REMINDER_NS: Final = ns(60.0)
_STOPPED: Final = "stopped: another service with our ids commands the vehicle"


class SecondCommander:
    """Monitor of another service with our ids."""

    def __init__(
        self, agents: Mapping[int, Agent], fleet: Fleet, tasking: UploadManager, state: AuthorityState
    ) -> None:
        self._agents = agents
        self._fleet = fleet
        self._tasking = tasking
        self._state = state

    def begin_again(self) -> None:
        """Note a restart: the service before may have sent requests of any kind."""
        self._state.watched_from_t_ns = None

    def note_sent(self, effects: Iterable[Effect], t_ns: int) -> None:
        """Note our own requests."""
        if self._state.watched_from_t_ns is None:
            self._state.watched_from_t_ns = t_ns + SETTLED_NS
        for effect in effects:
            if isinstance(effect, Send) and effect.data:
                self._note_request(effect, t_ns)

    def _note_request(self, send: Send, t_ns: int) -> None:
        frame = frame_at(send.data, 0, len(send.data))
        if frame.message_id == _HEARTBEAT:
            return
        number = _MISSION if frame.message_id in MISSION_PROTOCOL else command_of(frame)
        target = target_of(frame)
        if number is None or target is None:
            return
        agent = self._agents.get(vehicle_id(self._fleet.network(send.link), target[0]))
        if agent is not None:
            agent.authority.commander.asked_t_ns[number] = t_ns

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Process a message of a vehicle."""
        name = message.get_type()
        if name not in _ANSWERS or (message.target_system, message.target_component) != OWN_IDS:
            return []
        agent = self._agents[vehicle]
        watch = agent.authority.commander
        if watch.heard_since_t_ns is None or watch.returns != agent.link.returns:
            watch.heard_since_t_ns = t_ns
            watch.returns = agent.link.returns
        number = message.command if name == "COMMAND_ACK" else _MISSION
        latest_t_ns = max(watch.asked_t_ns.get(number, 0), watch.heard_since_t_ns)
        watched_from_t_ns = self._state.watched_from_t_ns
        is_ours = watched_from_t_ns is None or t_ns < watched_from_t_ns or t_ns - latest_t_ns < SETTLED_NS
        if is_ours or message.get_seq() == watch.sequence:
            return []
        since_ns = t_ns - watch.unasked_t_ns
        watch.unasked = watch.unasked + 1 if since_ns <= _MAX_GAP_NS else 1
        watch.is_tolerated &= since_ns <= _ENDED_NS
        watch.unasked_t_ns = t_ns
        watch.sequence = message.get_seq()
        if watch.unasked < _MIN_UNASKED:
            return []
        return self._take(vehicle, f"{_sign(message)}, {_at(agent.link.address)}", t_ns)

    def poll(self, t_ns: int) -> list[Effect]:
        """Check for heartbeats of another instance, and for the end of one that is tolerated."""
        return [*self._heartbeats(t_ns), *self._ended(t_ns)]

    def _ended(self, t_ns: int) -> list[Effect]:
        effects: list[Effect] = []
        for vehicle, agent in self._agents.items():
            watch = agent.authority.commander
            if watch.is_reported and t_ns - watch.unasked_t_ns > _ENDED_NS:
                watch.is_reported = False
                about = {"quiet_s": (t_ns - watch.unasked_t_ns) / NS_PER_S}
                effects.append(Notice(t_ns, NoticeCode.SECOND_COMMANDER_GONE, vehicle, about))
        return effects

    def _heartbeats(self, t_ns: int) -> list[Effect]:
        address = self._fleet.other_instance(t_ns)
        if address is None:
            return []
        network = self._fleet.network(address[0])
        effects: list[Effect] = []
        for vehicle, agent in self._agents.items():
            if network_of(vehicle) != network:
                continue
            watch = agent.authority.commander
            watch.is_tolerated &= t_ns - watch.unasked_t_ns <= _ENDED_NS
            watch.unasked_t_ns = t_ns
            effects += self._take(vehicle, f"its heartbeats come {_at(address)}", t_ns)
        return effects

    def release(self, vehicle: int, t_ns: int) -> None:
        """Take control of a vehicle back, on an operator's order."""
        agent = self._agents[vehicle]
        if Authority.SECOND_COMMANDER in agent.claims:
            agent.authority.commander.is_tolerated = True
            agent.authority.commander.unasked_t_ns = t_ns
            agent.claims.apply(ControlEvent.RESUME, t_ns)

    def _take(self, vehicle: int, sign: str, t_ns: int) -> list[Effect]:
        """Leave a vehicle alone because of a sign of another service."""
        agent = self._agents[vehicle]
        if Authority.SECOND_COMMANDER in agent.claims:
            return []
        parameters: dict[str, Parameter] = {"ids": f"{OWN_IDS[0]}/{OWN_IDS[1]}", "sign": sign}
        if agent.authority.commander.is_tolerated:
            agent.authority.commander.is_reported = True
            return self._remind(Notice(t_ns, NoticeCode.SECOND_COMMANDER_TOLERATED, vehicle, parameters))
        agent.claims.apply(ControlEvent.COMMANDED_ELSEWHERE, t_ns)
        agent.routes.drop()
        alarm = Notice(t_ns, NoticeCode.SECOND_COMMANDER, vehicle, parameters)
        return [alarm, *self._tasking.yield_up(vehicle, _STOPPED, t_ns)]

    def _remind(self, reminder: Notice) -> list[Effect]:
        """Warn at intervals of a service that an operator has decided to ignore."""
        key = (reminder.vehicle or 0, OWN_IDS, "")
        t_ns = reminder.t_ns
        last_t_ns = self._state.reports_t_ns.get(key)
        if last_t_ns is not None and t_ns - last_t_ns < _REMINDER_NS:
            return []
        self._state.reports_t_ns[key] = t_ns
        return [reminder]


def _sign(message: Message) -> str:
    """Return the answer to a request that was not ours, in words."""
    if message.get_type() != "COMMAND_ACK":
        return f"it sends {message.get_type()}, and no transfer of this service is under way"
    known = dialect.enums["MAV_CMD"].get(message.command)
    command = known.name if known is not None else f"command {message.command}"
    return f"it acknowledges {command}, which this service did not send"


def _at(address: Address | None) -> str:
    return "" if address is None else f"from {address[1]} on {address[0]}"
