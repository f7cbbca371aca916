"""What recordings of a flight show: messages that steer against a mode, read-backs, and pairs that were near.

Of each vehicle a mode is the service's if it is AUTO, if the service had just commanded it, or from an order
to the vehicle on. Any other is somebody else's, or the autopilot's own.
"""

import itertools
import math
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path

from fault_watch import PLANE_AUTO, PX4_AUTO
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.io.recording.reader import read
from gcs.mavlink.frames.codec import scan
from gcs.model import NS_PER_S, Datagram, Notice, Order, Send, Truth, UploadReport

OBEYED_NS = 3 * NS_PER_S
"""A mode that a vehicle shows this soon after the service commanded it is the service's."""
NEAR_M, NEAR_HEIGHT_M = 30.0, 15.0
LOWEST_M = 5.0
STEERING_MESSAGES = frozenset({11, 38, 39, 41, 44, 45, 73, 86})
STEERING_COMMANDS = frozenset({16, 20, 21, 22, 176, 192, 224, 252, 300, 400})


@dataclass
class Shown:
    """What one vehicle shows, and what was sent to it."""

    mode: int | None = None
    is_ours: bool = True
    """True in AUTO, and in a mode that the service had just commanded."""
    commanded_ns: dict[int, int] = field(default_factory=dict)
    sent: dict[int, tuple] = field(default_factory=dict)
    """Items of the mission that was sent last, by number; without item 0 of ArduPlane."""
    stored: dict[int, tuple] = field(default_factory=dict)
    """The same, as they were read back after that."""


class Reader:
    """Reads recordings for steering messages and verified uploads."""

    def __init__(self, firmware: str, vehicles: Collection[int]) -> None:
        self.auto = {"arduplane": PLANE_AUTO, "px4": PX4_AUTO}[firmware]
        self.first = int(firmware == "arduplane")
        self.shown = {vehicle: Shown() for vehicle in vehicles}
        self.steered: list[tuple[int, str]] = []
        self.uploads: list[tuple[int, str]] = []
        self.unequal: list[tuple[int, str]] = []
        self.notices: list[tuple[int, str]] = []

    def read(self, recording: Path) -> None:
        """Read one recording; what was sent right before a kill is not in it."""
        for shown in self.shown.values():
            shown.sent = {}
        for record in read(recording, only=(Datagram, Order, Notice, Send, UploadReport)):
            value, t_ns = record.value, record.t_ns
            if isinstance(value, Datagram):
                for frame in scan(value.data).frames:
                    if frame.message_id in (0, 73) and frame.component_id == 1:
                        self._see(self.shown.get(frame.system_id), frame.message(), t_ns)
            elif isinstance(value, Send):
                for frame in scan(value.data).frames:
                    self._sent(frame.message(), t_ns)
            elif isinstance(value, Order) and value.action in ("hold", "return", "resume"):
                for vehicle in value.vehicles or self.shown:
                    self.shown[vehicle].is_ours = True
            elif isinstance(value, Notice):
                self.notices.append((t_ns, f"{value.level} {value.vehicle or ''} {value.text}"))
            elif isinstance(value, UploadReport):
                words = f"{value.vehicle}: {value.items} items, {value.detail}"
                self.uploads.append((t_ns, f"{'verified' if value.ok else 'failed'} {words}"))
                shown = self.shown[value.vehicle]
                is_whole = len(shown.stored) == value.items - self.first
                if value.ok and not (is_whole and shown.sent.items() <= shown.stored.items()):
                    self.unequal.append((t_ns, f"{words}: sent {shown.sent}, read back {shown.stored}"))

    def _see(self, shown: Shown | None, message: object, t_ns: int) -> None:
        if shown is None:
            return
        if message.get_type() == "MISSION_ITEM_INT":
            if message.mission_type == 0 and message.seq >= self.first:
                shown.stored[message.seq] = item_of(message)
            return
        if message.custom_mode != shown.mode:
            since_ns = t_ns - shown.commanded_ns.get(message.custom_mode, -OBEYED_NS)
            shown.is_ours = message.custom_mode == self.auto or since_ns < OBEYED_NS
        shown.mode = message.custom_mode

    def _sent(self, message: object, t_ns: int) -> None:
        shown = self.shown.get(getattr(message, "target_system", 0))
        if shown is None or getattr(message, "mission_type", 0):
            return
        number, command = message.get_msgId(), getattr(message, "command", None)
        if number == mavlink.MAVLINK_MSG_ID_MISSION_COUNT:
            shown.sent, shown.stored = {}, {}
        elif number == mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST:
            shown.stored = {}
        elif number == mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT and message.seq >= self.first:
            shown.sent[message.seq] = item_of(message)
        command = command if number in (75, 76) else None
        if command == mavlink.MAV_CMD_DO_SET_MODE:
            main, sub = int(message.param2), int(message.param3)
            shown.commanded_ns[main << 16 | sub << 24 if self.auto == PX4_AUTO else main] = t_ns
        if not shown.is_ours and (number in STEERING_MESSAGES or command in STEERING_COMMANDS):
            words = f"{message.target_system}: {message.get_type()} {command} in mode {shown.mode}"
            self.steered.append((t_ns, words))


def item_of(message: object) -> tuple:
    """Return what makes an item the same; frames and unused parameters are read back in other forms."""
    return message.command, message.x, message.y, round(message.z, 1)


def near_pairs(truths: list[Truth], ground_msl_m: float) -> tuple[float, str, set[tuple[int, int]]]:
    """Return the least nearness of two that are in the air, its words, and pairs nearer than both minima."""
    least, words, near = math.inf, "-", set()
    for before, now in itertools.pairwise(truths):
        places = {}
        for one in before.objects:
            new = next((o for o in now.objects if (o.kind, o.id) == (one.kind, one.id)), None)
            if one.kind == "agents" and one.alive and new is not None and not (one.down or new.down):
                places[one.id] = (one, new)
        for (a, first), (b, second) in itertools.combinations(sorted(places.items()), 2):
            for step in range(5):
                at = [between(*pair, step / 5.0) for pair in (first, second)]
                away_m, height_m = math.dist(at[0][:2], at[1][:2]), abs(at[0][2] - at[1][2])
                nearness = max(away_m / NEAR_M, height_m / NEAR_HEIGHT_M)
                if min(at[0][2], at[1][2]) < ground_msl_m + LOWEST_M:
                    continue
                if nearness < 1.0:
                    near.add((a, b))
                if nearness < least:
                    least, words = nearness, f"{a}-{b}: {away_m:.0f} m, {height_m:.0f} m in height"
    return least, words, near


def between(before: object, now: object, part: float) -> tuple[float, float, float]:
    """Return a place between two, with its height."""
    ends = [(one.east_m, one.north_m, one.alt_msl_m) for one in (before, now)]
    return tuple(first + part * (last - first) for first, last in zip(*ends, strict=True))
