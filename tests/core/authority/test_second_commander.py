"""Two services would fly one vehicle: an upload goes on after the alarm, or leaves a mission of both."""

from __future__ import annotations

from collections.abc import Iterator

from helpers.noticed import noticed
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.frames.codec import GCS_COMPONENT_ID, GCS_SYSTEM_ID, Encoder, decode
from gcs.mavlink.mission.upload_stages import Stage
from gcs.model import NS_PER_S, Effect, NoticeCode, Order, Send, UploadReport
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import load

VEHICLE, PEER = 1, "vehicle:1"
OWN = GCS_SYSTEM_ID, GCS_COMPONENT_ID
ITEMS = ("MISSION_ITEM_INT",)
CHANGES = ("MISSION_COUNT", "MISSION_SET_CURRENT", "MISSION_CLEAR_ALL", *ITEMS)


class Flight:
    """A mission in which another one is uploaded to vehicle 1 after 30 s, and gets no further than wanted."""

    def __init__(self) -> None:
        scenario = load("deterministic")
        self.effects: list[tuple[int, Effect]] = []
        self.ignored: tuple[str, ...] = ()
        self.said: list[bytes] = []
        self.encode = Encoder(VEHICLE, 1)
        self.run = VirtualRun(
            scenario,
            1,
            on_effect=lambda t_ns, effect: self.effects.append((t_ns, effect)),
            tamper=self.tamper,
        )
        self.plane = self.run.vehicles[PEER]
        receive = self.plane.receive_datagram

        def receive_some(data: bytes, t_ns: int) -> None:
            if decode(data)[0][0].get_type() not in self.ignored:
                receive(data, t_ns)

        self.plane.receive_datagram = receive_some  # type: ignore[method-assign]

    def tamper(self, _t_ns: int, peer: str, data: bytes) -> Iterator[tuple[str, bytes]]:
        yield peer, data
        while peer == PEER and self.said:
            yield peer, self.said.pop()

    @property
    def stage(self) -> str:
        return self.run.engine.state.tasking.stages.get(VEHICLE, "")

    def upload_until(self, stage: Stage, ignored: tuple[str, ...]) -> None:
        """Have a mission uploaded again, and stop the transfer in a stage."""
        self.run.run(30.0)
        assert self.plane.autopilot.mode is Mode.AUTO
        self.ignored = ignored
        self.run.engine.state.agents[VEHICLE].routes.drop_flown()
        while self.stage != stage:
            self.wait(0.05)
        self.wait(0.5)
        assert self.stage == stage

    def hear_another_service(self) -> int:
        """Answer two commands that this service did not send; return the time of the alarm."""
        for _ in range(2):
            self.said.append(self.encode(dialect.MAVLink_command_ack_message(400, 0, 0, 0, *OWN)))
        self.wait(0.1)
        (alarm,) = [n for n in self.told(NoticeCode.SECOND_COMMANDER) if n.vehicle == VEHICLE]
        return alarm.t_ns

    def wait(self, seconds: float) -> None:
        self.run.run((self.run.t_ns - START_T_NS) / NS_PER_S + seconds)

    def told(self, code: NoticeCode) -> list:
        return noticed([effect for _, effect in self.effects], code)

    def reports(self, after_ns: int) -> list[UploadReport]:
        found = [effect for t_ns, effect in self.effects if t_ns >= after_ns]
        return [one for one in found if isinstance(one, UploadReport) and one.vehicle == VEHICLE]

    def sent(self, after_ns: int) -> list:
        """Return what was sent to the vehicle after a time and could change a mission or its progress."""
        sends = [e for t_ns, e in self.effects if t_ns > after_ns and isinstance(e, Send) and e.peer == PEER]
        messages = [message for send in sends for message in decode(send.data)[0]]
        return [message for message in messages if message.get_type() in CHANGES]

    def order(self, action: str) -> None:
        self.run.order(Order(self.run.t_ns, action, action, (VEHICLE,)))


def test_an_upload_ends_with_the_alarm_and_no_inconsistent_mission_is_left() -> None:
    """It went on to the end: the vehicle flew another mission after the alarm that it is not tasked."""
    flight = Flight()
    flight.upload_until(Stage.UPLOAD, ITEMS)
    at_ns = flight.hear_another_service()
    flight.ignored = ()
    flight.wait(0.5)
    assert flight.plane.autopilot.mode is Mode.LOITER
    flight.wait(14.0)
    assert {message.get_type() for message in flight.sent(at_ns)} == {"MISSION_CLEAR_ALL"}
    agent = flight.run.engine.state.agents[VEHICLE]
    assert (flight.stage, agent.tasking.onboard, agent.tasking.is_inconsistent) == ("", None, False)
    assert len(flight.plane.autopilot.mission) <= 1  # home
    (failed,) = [report for report in flight.reports(at_ns) if not report.ok]
    assert "another service with our ids" in failed.detail
    flight.order("resume")
    flight.wait(10.0)
    assert flight.reports(at_ns)[-1].ok
