"""Stand-by links: a vehicle that is heard on two links, such as radio and LTE, is heard on one at a time.

Frames of the stand-by link are counted and dropped. So a frame that comes on both counts once, and an upload
or a read-back never mixes two streams. The other link takes over when the first is silent, or loses many more
frames. Which links may be second paths is said in the mission file (`redundant`).
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from typing import Final

from gcs.mavlink.fleet.peers import Address
from gcs.mavlink.fleet.telemetry_table import FRAMES, LOST, NONE, VehicleRecord
from gcs.mavlink.services.retry import ns

SWITCH_AFTER_NS: Final = ns(1.5)
"""Silence of the link in use after which a heartbeat on the other one takes over."""
_WINDOW_NS: Final = ns(10.0)
_MIN_FRAMES: Final = 20
_MIN_GAIN: Final = 0.2
"""Difference of the lost fractions for which a link is changed: the streams are requested anew."""
_SEQUENCE_RANGE: Final = 256


def is_second_path(one: Address, other: Address, redundant: Container[str]) -> bool:
    """Return True if one vehicle may be heard at both addresses; `redundant` are the names of such links."""
    return one[0] != other[0] and (one[0] in redundant or other[0] in redundant)


@dataclass(slots=True)
class StandbyLink:
    """Stand-by link of one vehicle, and the loss of both links in the present window."""

    address: Address
    heard_t_ns: int
    since_t_ns: int
    """Begin of the window."""
    sequence: int = NONE
    """Of its last frame."""
    frames: int = 0
    lost: int = 0
    used_frames: int = 0
    """Frames of the link in use at the begin of the window."""
    used_lost: int = 0

    def count(self, sequence: int, t_ns: int) -> None:
        """Count one frame and the gap before it."""
        self.heard_t_ns = t_ns
        self.frames += 1
        ahead = (sequence - self.sequence) % _SEQUENCE_RANGE
        if self.sequence != NONE and 0 < ahead < _SEQUENCE_RANGE // 2:
            self.lost += ahead - 1
        if self.sequence == NONE or ahead < _SEQUENCE_RANGE // 2:
            self.sequence = sequence

    def is_better(self, used: VehicleRecord, t_ns: int) -> bool:
        """Return True, at the end of a window, if the link in use loses many more frames."""
        if t_ns - self.since_t_ns < _WINDOW_NS:
            return False
        used_frames = used.item(FRAMES) - self.used_frames
        used_lost = used.item(LOST) - self.used_lost
        is_known = min(used_frames, self.frames) >= _MIN_FRAMES
        gain = _lost_fraction(used_frames, used_lost) - _lost_fraction(self.frames, self.lost)
        self.begin_window(used, t_ns)
        return is_known and gain > _MIN_GAIN

    def begin_window(self, used: VehicleRecord, t_ns: int) -> None:
        """Begin to compare the links anew."""
        self.since_t_ns = t_ns
        self.frames = self.lost = 0
        self.used_frames = used.item(FRAMES)
        self.used_lost = used.item(LOST)


def _lost_fraction(frames: int, lost: int) -> float:
    return max(lost, 0) / max(frames + lost, 1)
