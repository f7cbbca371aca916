"""Onboard mission audit: after a restart, or in doubt, the mission of a vehicle is downloaded and compared.

While the service is down, or a vehicle is not heard, another station may upload a mission to it. So the
onboard mission is downloaded afterwards, before a new upload. If it differs from the last verified one, the
vehicle is suspended until an operator orders `resume`. A vehicle that does not answer is not tasked; requests
go on.

A vehicle that rebooted is audited, too. If it has lost its mission by the reboot, it stays ours and is
planned for again. If the mission is gone without a reboot, it was cleared: the vehicle is suspended.

An upload over another link, while the vehicle was heard here all the time, shows in MISSION_CURRENT: its
number of items, or its mission id, is no longer that of the verified mission. Then the vehicle is audited,
too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.authority.authority_state import Audit, StoredMission
from gcs.core.state import Agent
from gcs.core.tasking.tasking_state import OnboardMission
from gcs.core.tasking.upload_manager import UploadManager
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import AUTOPILOT_COMPONENT_ID, Message
from gcs.mavlink.mission.item_transfer import MissionDownload
from gcs.mavlink.services.retransmission_timeout import RttEstimator
from gcs.mavlink.services.retry import ns
from gcs.model import Authority, ControlEvent, Effect, Notice, NoticeCode, Parameter, system_of

_TIMEOUT_NS: Final = ns(25.0)
_BOOT_SLACK_NS: Final = ns(5.0)
"""Time until a reboot is recognised; the vehicle is heard meanwhile."""
_BOOT_TIME_NS: Final = ns(0.5)
"""Wait for the boot time of a vehicle, which its positions tell, before its mission is read again."""
_DIFFERS_NS: Final = ns(6.0)
"""Time for which MISSION_CURRENT must differ from the verified mission; single messages may be late."""
_MIN_REPORTS: Final = 3
_MISSION_ID: Final = slice(6, 10)
"""Payload of MISSION_CURRENT that pymavlink does not unpack: identity of the stored mission, 0 if unknown."""
_MISSION: Final[int] = dialect.MAV_MISSION_TYPE_MISSION


class OnboardAudit:
    """Audits in progress."""

    def __init__(self, agents: Mapping[int, Agent], fleet: Fleet, tasking: UploadManager) -> None:
        self._agents = agents
        self._fleet = fleet
        self._tasking = tasking

    def _audits(self) -> Iterator[tuple[int, Audit]]:
        """Yield the audits in progress, by vehicle."""
        for vehicle, agent in self._agents.items():
            if agent.authority.audit is not None:
                yield vehicle, agent.authority.audit

    @property
    def awaited(self) -> list[int]:
        """Vehicles whose audit has not timed out yet."""
        return [vehicle for vehicle, _ in self._audits() if not self._is_late(vehicle)]

    def begin(self, mission: OnboardMission, t_ns: int, *, known_t_ns: int) -> None:
        """Audit a vehicle that stored a mission at `known_t_ns`."""
        vehicle = mission.route.vehicle
        rtt = RttEstimator()
        audit = Audit(mission, t_ns, known_t_ns, rtt, _download(vehicle, rtt, t_ns))
        self._agents[vehicle].authority.audit = audit
        self._fleet.forward_next_heartbeat(vehicle)

    def release(self, vehicle: int, t_ns: int) -> None:
        """End an audit, on an operator's order."""
        self._end(vehicle, ControlEvent.RESUME, t_ns)

    def receive(self, vehicle: int, message: Message, t_ns: int) -> list[Effect]:
        """Process a message of a vehicle; begin an audit after a reboot or a lost link.

        Over a high-latency link none begins: it waits for the radio.
        """
        agent = self._agents[vehicle]
        if agent.link.high_latency is not None:
            return []
        mission = agent.tasking.pop_before_boot()
        authority = agent.authority
        if agent.link.returns != authority.returns:
            authority.returns = agent.link.returns
            mission = mission or agent.tasking.onboard
        known_t_ns = t_ns if authority.heard_t_ns is None else authority.heard_t_ns
        authority.heard_t_ns = t_ns
        is_free = authority.audit is None and vehicle not in self._tasking.state.uploads
        is_free &= not self._tasking.may_be_inconsistent(vehicle)
        if mission is not None and is_free:
            self.begin(mission, t_ns, known_t_ns=known_t_ns)
        audit = authority.audit
        if message.get_type() == "MISSION_CURRENT" and audit is None and is_free:
            return self._check_stored(vehicle, message, t_ns)
        if audit is None or agent.link.profile is None or getattr(message, "mission_type", None) != _MISSION:
            return []
        match message.get_type():
            case "MISSION_COUNT":
                audit.download.add_count(message, t_ns, audit.rtt)
            case "MISSION_ITEM_INT":
                audit.download.add_item(message, t_ns, audit.rtt)
            case "MISSION_ACK" if message.type == dialect.MAV_MISSION_ERROR:
                audit.download.restart_if_in_order(t_ns, audit.rtt)
        if not (audit.download.is_complete or _count_difference(audit)):
            return self._send(vehicle, audit, t_ns)
        frames = [self._fleet.encoder(vehicle)(audit.download.ack_message())]
        return [*self._fleet.address_frames(vehicle, frames), *self._compare(vehicle, audit, t_ns)]

    def _check_stored(self, vehicle: int, current: Message, t_ns: int) -> list[Effect]:
        """Audit a vehicle whose MISSION_CURRENT agreed with its verified mission, and no longer does."""
        agent = self._agents[vehicle]
        profile = self._fleet.profile(vehicle)
        onboard = agent.tasking.onboard
        if onboard is None or profile is None:
            return []
        if agent.authority.stored.mission_id != onboard.mission_id:
            agent.authority.stored = StoredMission(onboard.mission_id)
        stored = agent.authority.stored
        total = len(onboard.items) - profile.home_items
        opaque_id = int.from_bytes(current.get_payload()[_MISSION_ID], "little")
        if current.total == total and (not stored.opaque_id or opaque_id == stored.opaque_id):
            stored.is_matched = True
            stored.opaque_id = opaque_id
            stored.differs_t_ns = None
            stored.reports = 0
        elif stored.is_matched:
            stored.differs_t_ns = t_ns if stored.differs_t_ns is None else stored.differs_t_ns
            stored.reports += 1
            if t_ns - stored.differs_t_ns >= _DIFFERS_NS and stored.reports >= _MIN_REPORTS:
                known_t_ns = stored.differs_t_ns
                agent.authority.stored = StoredMission()
                self.begin(onboard, t_ns, known_t_ns=known_t_ns)
                if current.total == total:
                    return [Notice(t_ns, NoticeCode.MISSION_CHANGED, vehicle)]
                counts: dict[str, Parameter] = {"reported": current.total, "given": total}
                return [Notice(t_ns, NoticeCode.MISSION_COUNT_CHANGED, vehicle, counts)]
        return []

    def poll(self, t_ns: int) -> list[Effect]:
        """Run the timers."""
        effects: list[Effect] = []
        for vehicle, audit in self._audits():
            if self._agents[vehicle].link.high_latency is not None:
                continue
            if t_ns - audit.began_t_ns > _TIMEOUT_NS and not self._is_late(vehicle):
                self._agents[vehicle].claims.apply(ControlEvent.AUDIT_LATE, t_ns)
                effects.append(Notice(t_ns, NoticeCode.MISSION_UNREAD, vehicle))
            if audit.download.is_exhausted(t_ns):
                _begin_again(audit, t_ns)
            if self._fleet.profile(vehicle) is not None:
                effects += self._send(vehicle, audit, t_ns)
        return effects

    def _send(self, vehicle: int, audit: Audit, t_ns: int) -> list[Effect]:
        encode = self._fleet.encoder(vehicle)
        return [*self._fleet.address_frames(vehicle, map(encode, audit.download.poll(t_ns, audit.rtt)))]

    def _compare(self, vehicle: int, audit: Audit, t_ns: int) -> list[Effect]:
        profile = self._fleet.profile(vehicle)
        assert profile is not None  # `receive` has checked it
        difference = _count_difference(audit) or profile.difference(audit.mission.items, audit.download.items)
        booted_t_ns = self._fleet.booted_t_ns(vehicle, audit.began_t_ns)
        is_empty = audit.download.is_complete and len(audit.download.items) <= profile.home_items
        if is_empty and booted_t_ns is None:
            _begin_again(audit, t_ns + _BOOT_TIME_NS)  # until its boot time is known
            return []
        if is_empty and booted_t_ns is not None and booted_t_ns > audit.known_t_ns - _BOOT_SLACK_NS:
            self._end(vehicle, ControlEvent.MISSION_LOST, t_ns)
            self._tasking.forget_onboard(vehicle)
            self._tasking.overrides.note_mission_lost(vehicle, booted_t_ns, t_ns)
            self._agents[vehicle].routes.drop_flown()
            return [Notice(t_ns, NoticeCode.MISSION_LOST, vehicle)]
        if difference:
            self._end(vehicle, ControlEvent.AUDIT_DIFFERENT, t_ns)
            self._agents[vehicle].routes.drop()
            self._tasking.forget_onboard(vehicle)
            return [Notice(t_ns, NoticeCode.MISSION_DIFFERS, vehicle, {"difference": difference})]
        self._end(vehicle, ControlEvent.AUDIT_EQUAL, t_ns)
        self._tasking.onboard_missions.note(audit.mission)
        return [Notice(t_ns, NoticeCode.ONBOARD_VERIFIED, vehicle)]

    def _is_late(self, vehicle: int) -> bool:
        return Authority.UNVERIFIED in self._agents[vehicle].claims

    def _end(self, vehicle: int, event: ControlEvent, t_ns: int) -> None:
        agent = self._agents[vehicle]
        if agent.authority.audit is not None:
            agent.authority.audit = None
            agent.claims.apply(event, t_ns)


def _count_difference(audit: Audit) -> str:
    """Return how many items differ in number; empty if none do, and for a mission that may be empty.

    A mission of another number of items is not downloaded: 65,535 items take an hour.
    """
    count = audit.download.count
    wanted = len(audit.mission.items)
    return f"{count} items instead of {wanted}" if count not in (None, 0, 1, wanted) else ""


def _begin_again(audit: Audit, t_ns: int) -> None:
    audit.rtt = RttEstimator()
    audit.download = _download(audit.mission.route.vehicle, audit.rtt, t_ns)


def _download(vehicle: int, rtt: RttEstimator, t_ns: int) -> MissionDownload:
    return MissionDownload.begin((system_of(vehicle), AUTOPILOT_COMPONENT_ID), rtt, t_ns)
