"""An engine and one vehicle, ArduPlane or PX4, that is played message by message."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import parse
from gcs.core.engine import Engine
from gcs.mavlink.autopilots import profile_of
from gcs.mavlink.frames.codec import Encoder
from gcs.mavlink.frames.codec import decode as decode_frames
from gcs.model import Datagram, Notice, NoticeCode, Order, OrderAnswer, Send, Tick
from helpers.noticed import noticed
from helpers.other_station import AIR, MISSION, S

ARDUPLANE, PX4 = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, dialect.MAV_AUTOPILOT_PX4
BOTH = pytest.mark.parametrize("autopilot", [ARDUPLANE, PX4])
SET_MODE, ARM = dialect.MAV_CMD_DO_SET_MODE, dialect.MAV_CMD_COMPONENT_ARM_DISARM
PEER = "10.0.0.1:5"


class Stage:
    """A service and one vehicle, which shows what a test says that it shows."""

    away_m, climb_m_s, booted_t_ns = 0.0, 0.0, 0
    """Distance north of its first place, vertical speed, and time of its last boot."""
    system_status = dialect.MAV_STATE_ACTIVE

    def __init__(self, autopilot: int, mode: str, *, armed: bool, height_m: float, speed_m_s: float) -> None:
        self.engine, self.t_ns = Engine(parse(MISSION, "x"), 1), S
        self.encode, self.autopilot = Encoder(1, 1), autopilot
        self.mode, self.armed, self.height_m, self.speed_m_s = mode, armed, height_m, speed_m_s
        self.effects: list = []
        self.wait(2.0)

    def step(self, event) -> list:
        found = self.engine.step(event)
        self.effects += found
        return found

    def hear(self, message) -> None:
        self.step(Datagram(self.t_ns, AIR, PEER, self.encode(message)))

    def show(self) -> None:
        profile = profile_of(self.autopilot)
        assert profile is not None
        main, sub = profile.mode_numbers(self.mode)
        custom = main << 16 | sub << 24 if self.autopilot == PX4 else main
        base, status = 1 + 128 * self.armed, self.system_status
        self.hear(dialect.MAVLink_heartbeat_message(1, self.autopilot, base, custom, status, 3))
        self.hear(
            dialect.MAVLink_home_position_message(
                330000000, -870000000, 70_000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
            )
        )
        alt_mm = round((70 + self.height_m) * 1000)
        ms, speed_cm_s = (self.t_ns - self.booted_t_ns) // 1_000_000, round(self.speed_m_s * 100)
        self.hear(
            dialect.MAVLink_global_position_int_message(
                ms,
                330001000 + round(self.away_m * 89.8),
                -869998000,
                alt_mm,
                alt_mm - 70_000,
                speed_cm_s,
                0,
                round(-self.climb_m_s * 100),
                0,
            )
        )

    def wait(self, seconds: float) -> None:
        """Let time pass; the vehicle obeys."""
        for _ in range(round(seconds / 0.5)):
            self.t_ns += S // 2
            self.show()
            self.step(Tick(self.t_ns))

    def order(self, action) -> list[OrderAnswer]:
        found = self.step(Order(self.t_ns, f"{action}-{self.t_ns}", action, (1,)))
        return [effect for effect in found if isinstance(effect, OrderAnswer)]

    def commands(self, number: int) -> list:
        """What was sent of one MAV_CMD."""
        sent = [m for e in self.effects if isinstance(e, Send) for m in decode_frames(e.data)[0]]
        return [m for m in sent if m.get_type() == "COMMAND_LONG" and m.command == number]

    def noticed(self, code: NoticeCode) -> list[Notice]:
        return noticed(self.effects, code)


def landed(autopilot: int, mode: str = "AUTO") -> Stage:
    return Stage(autopilot, mode, armed=False, height_m=0.5, speed_m_s=0.0)


def airborne(autopilot: int, mode: str, height_m: float = 100.0) -> Stage:
    return Stage(autopilot, mode, armed=True, height_m=height_m, speed_m_s=15.0)
