"""The vehicle's MAVLink 2 signing, by pymavlink's own code: a peer that central command's must agree with.

As ArduPilot on a telemetry port: with a key it signs all that it sends, and rejects what is not validly
signed, but for RADIO_STATUS. SETUP_SIGNING with a key of zeros ends it.
"""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_EPOCH_S = 1_420_070_400
_NS_PER_TICK = 10_000
_RADIO = (mavlink.MAVLINK_MSG_ID_RADIO_STATUS, mavlink.MAVLINK_MSG_ID_RADIO)


class Signing:
    """A signing state that the vehicle's reader and outbox share."""

    def __init__(self, key: bytes | None = None) -> None:
        self.state: Any = mavlink.MAVLink(None).signing
        self.state.allow_unsigned_callback = lambda _mav, message_id: message_id in _RADIO
        if key is not None:
            self.set_up(key, 0)

    def set_up(self, key: bytes, timestamp: int) -> None:
        """Sign and check with this key from now on; with none when it is all zeros."""
        state = self.state
        state.secret_key = key if any(key) else None
        state.sign_outgoing = any(key)
        state.timestamp = max(state.timestamp, timestamp)
        state.stream_timestamps.clear()

    def tell_time(self, t_ns: int) -> None:
        """Move its time on; it follows what it hears, too."""
        now = t_ns // _NS_PER_TICK - _EPOCH_S * 100_000
        self.state.timestamp = max(self.state.timestamp, now)
