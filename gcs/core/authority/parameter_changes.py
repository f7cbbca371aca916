"""Parameters that other ground stations set: each change is reported with its name, old and new value.

PARAM_SET of a station is noted when it is forwarded, and reported when the vehicle answers with PARAM_VALUE,
or after `_ANSWER_NS` without an answer. A value that preflight would refuse or warn of is a warning. There is
at most one notice of a parameter in `_REPEAT_NS`; the newest value is reported then.

A parameter that preflight checks, and that changes without a PARAM_SET through this service, was set over
another link. That is reported, too. Any changed parameter may be the correction that a rejected mission waits
for (`gcs.core.tasking.rejections`); one that is heard for the first time may have changed as well.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import Config
from gcs.core.authority.authority_state import ParameterRecord, ParameterSet
from gcs.core.preflight.vehicle_checks import envelope_of
from gcs.core.state import Agent
from gcs.endpoints import Link
from gcs.mavlink.frames.codec import FrameTable, Message
from gcs.mavlink.services.parameter_protocol import decode_value
from gcs.mavlink.services.retry import ns
from gcs.model import Datagram, Effect, Notice, NoticeCode, Parameter, network_of, vehicle_id
from gcs.safe_text import printable

_PARAM_SET: Final[int] = dialect.MAVLINK_MSG_ID_PARAM_SET
_ANSWER_NS: Final = ns(3.0)
_REPEAT_NS: Final = ns(10.0)
_MAX_SETS: Final = 500
"""Of one vehicle, not reported yet."""
_MAX_VALUES: Final = 20_000
"""Of all vehicles together."""


class ParameterChanges:
    """Monitor of parameters that other ground stations set."""

    def __init__(self, config: Config, agents: Mapping[int, Agent], links: Iterable[Link]) -> None:
        self._config = config
        self._agents = agents
        self._networks = {link.name: link.network for link in links}
        self._max_values = _MAX_VALUES // max(1, len(agents))

    def receive_forwarded(self, datagram: Datagram, frames: FrameTable) -> None:
        """Process a datagram of another ground station that was forwarded."""
        network = self._networks[datagram.link]
        for frame in frames.frames:
            message = frame.message() if frame.message_id == _PARAM_SET else None
            if message is None:
                continue
            station = f"system {frame.system_id}/{frame.component_id} at {datagram.peer}"
            target = vehicle_id(network, message.target_system)
            vehicles = [target] if message.target_system else self._agents
            for vehicle in vehicles:
                if vehicle in self._agents and network_of(vehicle) == network:
                    self._note_set(vehicle, message, station, datagram.t_ns)

    def _note_set(self, vehicle: int, message: Message, station: str, t_ns: int) -> None:
        agent = self._agents[vehicle]
        parameters = agent.authority.parameters
        name = printable(str(message.param_id))
        if name in parameters.sets or len(parameters.sets) < _MAX_SETS:
            value = decode_value(message, agent.link.is_atomic)
            old = parameters.sets.get(name)
            before = parameters.values.get(name) if old is None else old.before
            parameters.sets[name] = ParameterSet(station, value, t_ns, before)

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Process a message of a vehicle."""
        if message.get_type() != "PARAM_VALUE":
            return []
        agent = self._agents[vehicle]
        parameters = agent.authority.parameters
        name = printable(str(message.param_id))
        value = decode_value(message, agent.link.is_atomic)
        before = parameters.values.get(name)
        required, problem = self._requirement(vehicle, name, value)
        is_changed = not _is_same(value, before)
        if is_changed:
            agent.tasking.rejections.note_change(t_ns)
        if required or before is not None or len(parameters.values) < self._max_values:
            parameters.values[name] = value
        if name in parameters.sets:
            parameters.sets[name].answer = value
            return self._report_due(vehicle, name, t_ns)
        if not required or before is None or not is_changed or _is_reported(parameters, name, t_ns):
            return []
        parameters.reported_t_ns[name] = t_ns
        code = NoticeCode.PARAMETER_CHANGED_WRONG if problem else NoticeCode.PARAMETER_CHANGED
        change: dict[str, Parameter] = {"name": name, "before": f"{before:g}", "value": f"{value:g}"}
        return [Notice(t_ns, code, vehicle, change | {"problem": problem})]

    def poll(self, t_ns: int) -> list[Effect]:
        """Return the notices that are due."""
        effects: list[Effect] = []
        for vehicle, agent in self._agents.items():
            parameters = agent.authority.parameters
            for name in list(parameters.sets):
                effects += self._report_due(vehicle, name, t_ns)
            if parameters.reported_t_ns:
                times = parameters.reported_t_ns.items()
                parameters.reported_t_ns = {name: at for name, at in times if t_ns - at < _REPEAT_NS}
        return effects

    def _report_due(self, vehicle: int, name: str, t_ns: int) -> list[Effect]:
        """Report a PARAM_SET that was answered, or was not in time, unless it was reported a moment ago."""
        parameters = self._agents[vehicle].authority.parameters
        one = parameters.sets[name]
        if one.answer is None and t_ns - one.t_ns < _ANSWER_NS:
            return []
        if _is_reported(parameters, name, t_ns):
            return []
        del parameters.sets[name]
        if one.answer is not None and _is_same(one.answer, one.before) and _is_same(one.answer, one.value):
            return []
        parameters.reported_t_ns[name] = t_ns
        _, problem = self._requirement(vehicle, name, one.value if one.answer is None else one.answer)
        answer = ""
        if one.answer is None:
            answer = "has not confirmed it"
        elif not _is_same(one.answer, one.value):
            answer = f"answers {one.answer:g}"
        change: dict[str, Parameter] = {
            "station": one.station,
            "name": name,
            "before": "an unknown value" if one.before is None else f"{one.before:g}",
            "value": f"{one.value:g}",
            "answer": answer,
            "problem": problem,
        }
        code = NoticeCode.PARAMETER_SET_WRONG if problem else NoticeCode.PARAMETER_SET
        return [Notice(t_ns, code, vehicle, change)]

    def _requirement(self, vehicle: int, name: str, value: float) -> tuple[bool, str]:
        """Return True if preflight checks a parameter, and why it would object to a value."""
        profile = self._agents[vehicle].link.profile
        if profile is None:
            return False, ""
        wanted = (*profile.parameters, *profile.fits(envelope_of(self._config, vehicle)))
        found = next((match for one in wanted if (match := one.found({name: value}))), None)
        if found is None:
            return False, ""
        parameter = found[0]
        return True, "" if parameter.accepts(value) else f"wanted is {parameter.wanted}: {parameter.why}"


def _is_same(value: float, other: float | None) -> bool:
    """Return True for equal values, also if both are no number."""
    return value == other or (other is not None and math.isnan(value) and math.isnan(other))


def _is_reported(parameters: ParameterRecord, name: str, t_ns: int) -> bool:
    return t_ns - parameters.reported_t_ns.get(name, t_ns - _REPEAT_NS) < _REPEAT_NS
