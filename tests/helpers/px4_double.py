"""A scripted PX4, as far as a mission task sees it: atomic uploads, and a navigator that may reject them.

As seen on PX4 1.17 (`plane_double.py` is the same for ArduPlane): a mission that the navigator
rejects gets ACK 0; then the vehicle is in Hold, MISSION_CURRENT says NO_MISSION, and AUTO is refused.
"""

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.mavlink.autopilots import PX4
from gcs.mavlink.frames.codec import Encoder, decode

S = 1_000_000_000
AUTO, HOLD = 4 << 16 | 4 << 24, 4 << 16 | 3 << 24


class Px4:
    """One PX4; `tamper` changes what it stores of an item, `rejects` is its navigator's mind."""

    def __init__(self, system_id=1, *, mode=HOLD, rejects=False, tamper=lambda item: item):
        self.system_id, self.mode, self.rejects, self.tamper = system_id, mode, rejects, tamper
        self.store, self.valid, self.current, self.armed = [], False, 0, True
        self.status = dialect.MAV_STATE_ACTIVE
        self.commands, self.modes_sent, self.uploads = [], [], 0
        self._encode = Encoder(system_id, 1)
        self._incoming, self._count, self._beat_t_ns = [], 0, -(10**18)

    def receive(self, data, t_ns):
        out = []
        for message in decode(data)[0]:
            handler = getattr(self, f"_on_{message.get_type().lower()}", None)
            if handler is not None:
                out += handler(message, (message.get_srcSystem(), message.get_srcComponent()))
        return [self._encode(message) for message in out]

    def poll(self, t_ns):
        if t_ns - self._beat_t_ns < S:
            return []
        self._beat_t_ns = t_ns
        position = dialect.MAVLink_global_position_int_message(
            t_ns // 1_000_000, -353632621, 1491652370, 684090, 100000, 0, 0, 0, 0
        )
        return [self._encode(message) for message in (self._heartbeat(), self.mission_current(), position)]

    def choose(self, mode):
        """As an operator by a switch."""
        self.mode = mode

    def _heartbeat(self):
        base_mode = 1 | (128 if self.armed else 0)
        return dialect.MAVLink_heartbeat_message(1, 12, base_mode, self.mode, self.status, 3)

    def mission_current(self):
        if not (self.store and self.valid):
            now = dialect.MISSION_STATE_NO_MISSION
        else:
            now = dialect.MISSION_STATE_ACTIVE if self.mode == AUTO else dialect.MISSION_STATE_PAUSED
        return dialect.MAVLink_mission_current_message(self.current, len(self.store) or 0xFFFF, now)

    def _on_mission_count(self, message, sender):
        self._incoming, self._count = [], message.count
        return [dialect.MAVLink_mission_request_int_message(*sender, 0, 0)]

    def _on_mission_item_int(self, message, sender):
        if message.seq != len(self._incoming) or not self._count:
            return []
        self._incoming.append(message)
        if len(self._incoming) < self._count:
            return [dialect.MAVLink_mission_request_int_message(*sender, message.seq + 1, 0)]
        self.uploads += 1
        self.store, self.valid, self.current = self._incoming, not self.rejects, 0
        if not self.valid:
            self.mode = HOLD
        return [dialect.MAVLink_mission_ack_message(*sender, 0, 0)]

    def _on_mission_ack(self, message, _sender):
        if message.type == dialect.MAV_MISSION_OPERATION_CANCELLED:
            self._count = 0
        return []

    def _on_mission_request_list(self, _message, sender):
        return [dialect.MAVLink_mission_count_message(*sender, len(self.store), 0)]

    def _on_mission_request_int(self, message, sender):
        it = self.store[message.seq]
        params = (0.0 if it.command == 22 else it.param1, it.param2, it.param3, it.param4)
        fields = self.tamper((it.frame, it.command, 0, 1, *params, it.x, it.y, it.z))
        return [dialect.MAVLink_mission_item_int_message(*sender, message.seq, *fields, 0)]

    def _on_mission_clear_all(self, _message, sender):
        self.store, self.valid = [], False
        return [dialect.MAVLink_mission_ack_message(*sender, 0, 0)]

    def _on_mission_set_current(self, message, _sender):
        self.current = message.seq if message.seq < len(self.store) else self.current
        return []

    def _on_command_long(self, message, sender):
        self.commands.append(message.command)
        result, extra = 0, []
        if message.command == 176:
            mode = int(message.param2) << 16 | int(message.param3) << 24
            self.modes_sent.append(PX4.mode_name(mode))
            if mode == AUTO and not self.valid:
                result = dialect.MAV_RESULT_TEMPORARILY_REJECTED
            else:
                self.mode = mode
        elif message.command == 511 and message.param1 == 42:
            result = dialect.MAV_RESULT_FAILED
        elif message.command == 512 and message.param1 == 42:
            extra = [self.mission_current()]
        elif message.command == 512 and message.param1 == 0:
            extra = [self._heartbeat()]
        return [dialect.MAVLink_command_ack_message(message.command, result, 0, 0, *sender), *extra]
