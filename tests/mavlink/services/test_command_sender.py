"""An operator would wait for seconds to see a hold confirmed, or see one confirmed that is not."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots.modes import AUTO, LOITER, RTL
from gcs.mavlink.frames.codec import GCS_COMPONENT_ID, GCS_SYSTEM_ID, Encoder, decode
from gcs.mavlink.services.command_sender import REQUEST_MESSAGE, SET_MODE, CommandSender, set_mode

S = 1_000_000_000
PLANE_MODES = {LOITER: 12, AUTO: 10, RTL: 11}


class Stage:
    def __init__(self, mode: str, before: str = "") -> None:
        command = set_mode(1, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, mode)
        self.sender = CommandSender.begin(command, 0, mode=mode, before=before)
        self._vehicle, self._gcs = Encoder(1, 1), Encoder(GCS_SYSTEM_ID, GCS_COMPONENT_ID)

    def sent(self, t_s: float) -> list[int]:
        frames = self.sender.poll(round(t_s * S), self._gcs)
        return [message.command for frame in frames for message in decode(frame)[0]]

    def hear(self, message: dialect.MAVLink_message) -> None:
        for heard in decode(self._vehicle(message))[0]:
            self.sender.receive(heard)

    def ack(self, result: int = dialect.MAV_RESULT_ACCEPTED) -> None:
        self.hear(
            dialect.MAVLink_command_ack_message(SET_MODE, result, 0, 0, GCS_SYSTEM_ID, GCS_COMPONENT_ID)
        )

    def show(self, mode: str) -> None:
        base = dialect.MAV_MODE_FLAG_SAFETY_ARMED | dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        plane = (dialect.MAV_TYPE_FIXED_WING, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA)
        self.hear(dialect.MAVLink_heartbeat_message(*plane, base, PLANE_MODES[mode], 4, 3))


def test_a_heartbeat_is_requested_once_after_the_ack_and_confirms() -> None:
    stage = Stage(LOITER)
    assert stage.sent(0.0) == [SET_MODE]
    stage.ack()
    stage.ack()
    assert stage.sent(0.1) == [REQUEST_MESSAGE]
    assert stage.sent(0.2) == []
    stage.show(AUTO)
    assert stage.sender.outcome is None
    stage.show(LOITER)
    assert stage.sender.outcome == (True, "LOITER, armed")


def test_without_an_ack_one_heartbeat_may_have_crossed() -> None:
    stage = Stage(LOITER)
    stage.sent(0.0)
    stage.show(LOITER)
    assert stage.sender.outcome is None
    stage.show(LOITER)
    assert stage.sender.outcome == (True, "LOITER, armed")


def test_auto_needs_two_heartbeats_since_a_mission_may_be_rejected_after_the_ack() -> None:
    stage = Stage(AUTO)
    stage.sent(0.0)
    stage.ack()
    stage.show(AUTO)
    assert stage.sender.outcome is None
    stage.show(LOITER)
    stage.show(AUTO)
    assert stage.sender.outcome is None
    stage.show(AUTO)
    assert stage.sender.outcome == (True, "AUTO, armed")


def test_a_refused_command_asks_for_no_heartbeat() -> None:
    stage = Stage(LOITER)
    stage.sent(0.0)
    stage.ack(dialect.MAV_RESULT_DENIED)
    assert stage.sent(0.1) == []


def test_an_order_to_resume_is_not_repeated_against_a_failsafe_that_returns() -> None:
    stage = Stage(AUTO, before=LOITER)
    stage.sent(0.0)
    stage.show(LOITER)
    assert stage.sent(1.0) == [SET_MODE]
    stage.show(RTL)
    assert stage.sender.outcome == (False, "RTL was chosen meanwhile")
    assert stage.sent(5.0) == []
