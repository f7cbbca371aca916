"""What vehicles store, read once more and held against what they were left with.

A vehicle is out of our sight while the service is down, and while it is not heard. Somebody else may give it
another mission then, by a radio of his own. So what it stores is read again after either, before it gets a
mission from us: equal, it is as if nothing had happened; different, it is set aside like one that a guest
gave a mission: the operator is told, and it is left alone until he orders it to resume. One that does not
tell is not tasked either, and asked on.

A vehicle that rebooted is asked, too. It may have lost its mission: one that holds none, and has booted since
it was known to hold one, stays ours and is planned for again. One that holds none and has not booted was
cleared by somebody, and is set aside.

Not seen: a mission that somebody wrote to a vehicle while it was heard here all the time, by a link that does
not pass here. It shows in the next read-back of a transfer at the latest, which then is of ours.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.operator.vehicle_orders import Orders
from gcs.core.replanning.replanner import Replanner
from gcs.core.tasking.onboard_missions import OnboardMission
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, Message
from gcs.mavlink.mission.protocol import MissionDownload
from gcs.mavlink.services.retry import ns
from gcs.mavlink.services.rtt import RttEstimator
from gcs.model import Effect, Notice, system_of

_LATE_NS: Final = ns(25.0)
_BOOT_SLACK_NS: Final = ns(5.0)
"""A reboot is recognised only after some reports; until then the vehicle was heard."""
_MISSION: Final[int] = dialect.MAV_MISSION_TYPE_MISSION


class _Check:
    """One vehicle's."""

    def __init__(
        self, flown: OnboardMission, t_ns: int, then: Callable[[OnboardMission], None], known_t_ns: int
    ) -> None:
        self.flown, self.began_t_ns, self.then = flown, t_ns, then
        self.known_t_ns = known_t_ns
        """When it was last known to hold this."""
        self.is_late = False
        self.begin(t_ns)

    def begin(self, t_ns: int) -> None:
        to = (system_of(self.flown.route.vehicle), AUTOPILOT_COMPONENT_ID)
        self.reading = MissionDownload(to, RttEstimator(), t_ns)


class OnboardAudit:
    """All of them under way.

    Parameters
    ----------
    fleet, tasking, replanner, orders
        Who talks to vehicles, keeps what they hold, who flies what, and who is set aside.
    """

    def __init__(self, fleet: Fleet, tasking: UploadManager, replanner: Replanner, orders: Orders) -> None:
        self._fleet, self._tasking, self._replanner, self._orders = fleet, tasking, replanner, orders
        self._checks: dict[int, _Check] = {}
        self._returns: dict[int, int] = {}
        self._heard_t_ns: dict[int, int] = {}

    @property
    def hurries(self) -> bool:
        """Whether an answer is expected any moment."""
        return any(not check.is_late for check in self._checks.values())

    def flown(self, vehicle: int) -> OnboardMission | None:
        """What a vehicle should hold that is being asked; None for others."""
        check = self._checks.get(vehicle)
        return None if check is None else check.flown

    def untaskable(self) -> dict[int, str]:
        """Vehicles that are not tasked because they do not tell what they hold, and that, in words."""
        return {
            v: "does not tell which mission it holds" for v, check in self._checks.items() if check.is_late
        }

    def begin(
        self,
        flown: OnboardMission,
        t_ns: int,
        then: Callable[[OnboardMission], None] = lambda _flown: None,
        *,
        known_t_ns: int,
    ) -> None:
        """Ask a vehicle whether it still holds what it held at `known_t_ns`; `then` when it does."""
        vehicle = flown.route.vehicle
        self._checks[vehicle] = _Check(flown, t_ns, then, known_t_ns)
        self._tasking.pause_uploads(vehicle)

    def release(self, vehicles: Iterable[int]) -> None:
        """Task vehicles whatever they hold: an operator's order."""
        for vehicle in vehicles:
            self._end(vehicle)

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Take a vehicle's message: part of its answer, perhaps, or the first after a silence."""
        flown = self._tasking.pop_mission_before_boot(vehicle)
        if self._fleet.returns(vehicle) != self._returns.setdefault(vehicle, 0):
            self._returns[vehicle] = self._fleet.returns(vehicle)
            flown = flown or self._tasking.onboard(vehicle)
        known_t_ns = self._heard_t_ns.get(vehicle, t_ns)
        self._heard_t_ns[vehicle] = t_ns
        is_being_told = self._tasking.elapsed_s(vehicle, t_ns) is not None
        is_free = vehicle not in self._checks and not is_being_told
        if flown is not None and is_free and not self._tasking.may_be_inconsistent(vehicle):
            self.begin(flown, t_ns, known_t_ns=known_t_ns)
        check = self._checks.get(vehicle)
        if check is None or getattr(message, "mission_type", None) != _MISSION:
            return []
        match message.get_type():
            case "MISSION_COUNT":
                check.reading.add_count(message, t_ns)
            case "MISSION_ITEM_INT":
                check.reading.add_item(message, t_ns)
            case "MISSION_ACK" if message.type == dialect.MAV_MISSION_ERROR:
                check.reading.restart_if_in_order(t_ns)
        if not check.reading.is_complete:
            return self._ask(vehicle, check, t_ns)
        frames = [self._fleet.encoder(vehicle)(check.reading.ack_message())]
        return [*self._fleet.address_frames(vehicle, frames), *self._judge(vehicle, check, t_ns)]

    def poll(self, t_ns: int) -> list[Effect]:
        """Let timers run."""
        effects: list[Effect] = []
        for vehicle, check in self._checks.items():
            if not check.is_late and t_ns - check.began_t_ns > _LATE_NS:
                check.is_late = True
                text = f"does not tell which mission it holds: left alone {_until(vehicle)}, or until it does"
                effects.append(Notice(t_ns, "alarm", text, vehicle))
            if check.reading.is_exhausted(t_ns):
                check.begin(t_ns)
            if self._fleet.profile(vehicle) is not None:
                effects += self._ask(vehicle, check, t_ns)
        return effects

    def _ask(self, vehicle: int, check: _Check, t_ns: int) -> list[Effect]:
        encode = self._fleet.encoder(vehicle)
        return [*self._fleet.address_frames(vehicle, map(encode, check.reading.poll(t_ns)))]

    def _judge(self, vehicle: int, check: _Check, t_ns: int) -> list[Effect]:
        profile = self._fleet.profile(vehicle)
        assert profile is not None  # nothing is asked before it is known
        difference = profile.difference(check.flown.items, check.reading.items)
        booted_t_ns = self._fleet.booted_t_ns(vehicle)
        is_empty = len(check.reading.items) <= profile.home_items
        if is_empty and booted_t_ns is None:
            check.begin(t_ns)  # until it tells since when it runs
            return []
        self._end(vehicle)
        if is_empty and booted_t_ns is not None and booted_t_ns > check.known_t_ns - _BOOT_SLACK_NS:
            self._tasking.note_mission_lost(vehicle, booted_t_ns)
            self._replanner.drop_route(vehicle)
            text = "holds no mission since it rebooted: it stays ours, and gets a new one"
            return [Notice(t_ns, "warning", text, vehicle)]
        if difference:
            self._orders.suspensions[vehicle] = "found"
            self._replanner.drop(vehicle)
            self._tasking.forget_onboard(vehicle)
            text = f"holds another mission than the one it was given ({difference}): left alone "
            return [Notice(t_ns, "alarm", text + _until(vehicle), vehicle)]
        self._tasking.note_onboard(check.flown)
        check.then(check.flown)
        return [Notice(t_ns, "info", "holds the mission that it was given", vehicle)]

    def _end(self, vehicle: int) -> None:
        if self._checks.pop(vehicle, None) is not None:
            self._tasking.resume_uploads(vehicle)


def _until(vehicle: int) -> str:
    return f"until `gcs order resume --vehicle {vehicle}`"
