"""Hostile bytes into the MAVLink package, by the million: nothing may be raised, and effects must stay sane.

``python tests/bench/fuzz_link.py [--inputs 10000000] [--seed 1] [--minutes 10]``. An input is one datagram
from one of a few addresses to a whole link: fleet, mission transfers under way, timers. Datagrams
are made of frames of every message that it reads (and some that it does not) with hostile fields
(extremes, NaN, foreign and own targets, any sequence), then cut, joined, doubled, flipped or replaced by
noise.
"""

import argparse
import math
import time

import numpy as np
from helpers.missions import upload_manager
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.geo import LocalFrame
from gcs.mavlink.fleet.fleet import Fleet
from gcs.model import Datagram, Route, Send, read_only

FRAME = LocalFrame(33.2, -87.6, 70.0)
VEHICLES = (1, 2, 3, 4)
ADDRESSES = ("10.0.0.1:1", "10.0.0.2:2", "10.0.0.3:3", "10.0.0.4:4", "10.9.9.9:9")
NAMES = [
    "HEARTBEAT", "SYS_STATUS", "GPS_RAW_INT", "GLOBAL_POSITION_INT", "HOME_POSITION", "AUTOPILOT_VERSION",
    "STATUSTEXT", "COMMAND_ACK", "MISSION_CURRENT", "MISSION_ITEM_REACHED", "MISSION_COUNT",
    "MISSION_REQUEST",
    "MISSION_REQUEST_INT", "MISSION_ITEM_INT", "MISSION_ACK", "ATTITUDE", "EXTENDED_SYS_STATE", "PARAM_VALUE",
]  # fmt: skip
CLASSES = [c for c in dialect.mavlink_map.values() if c.msgname in NAMES]
INTEGERS = {"uint8_t": (0, 255), "int8_t": (-128, 127), "uint16_t": (0, 65535), "int16_t": (-32768, 32767)}
INTEGERS |= {"uint32_t": (0, 2**32 - 1), "int32_t": (-(2**31), 2**31 - 1), "uint64_t": (0, 2**64 - 1)}
REALS = [0.0, -0.0, 1.0, -1.0, 255.0, 1e30, -1e30, math.nan, math.inf, -math.inf]
LIKELY = {
    "target_system": [255, 255, 255, 0, 254], "target_component": [190, 190, 0, 1],
    "mission_type": [0, 0, 0, 1, 255], "autopilot": [3, 3, 12, 0],
    "seq": [0, 1, 2, 3, 4, 5, 65535],
    "count": [0, 1, 5, 6, 65535],
    "type": [1, 0, 2, 6, 13, 15],
    "result": [0, 1, 2, 3, 4, 5], "command": [176, 224, 511, 512, 16], "fix_type": [0, 1, 3, 6],
    "custom_mode": [10, 12, 11, 0, 4 << 16 | 4 << 24],
    "lat": [332_000_000, 0], "lon": [-876_000_000, 0],
}  # fmt: skip


class Maker:
    """Makes datagrams from a seed."""

    def __init__(self, seed: int, pool: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.pens = {
            (s, c): dialect.MAVLink(None, srcSystem=s, srcComponent=c)
            for s in (*VEHICLES, 9)
            for c in (1, 190)
        }
        self.frames = [self._frame() for _ in range(pool)]

    def _field(self, name: str, kind: str, length: int):
        rng = self.rng
        if length:
            if kind == "char":
                return bytes(rng.integers(0, 256, length, dtype=np.uint8))
            return [self._field(name, kind, 0) for _ in range(length)]
        if name in LIKELY and rng.random() < 0.85:
            return LIKELY[name][rng.integers(len(LIKELY[name]))]
        if kind in ("float", "double"):
            return REALS[rng.integers(len(REALS))]
        low, high = INTEGERS.get(kind, (0, 127))
        return [low, high, 0, 1, (low + high) // 3][rng.integers(5)]

    def _frame(self) -> bytes:
        rng = self.rng
        made = CLASSES[rng.integers(len(CLASSES))]
        shapes = zip(made.fieldnames, made.ordered_fieldnames, strict=True)
        kinds = dict(zip(made.fieldnames, made.fieldtypes, strict=True))
        lengths = dict(zip(made.ordered_fieldnames, made.array_lengths, strict=True))
        values = [self._field(name, kinds[name], lengths[name]) for name, _ in shapes]
        system, component = (*VEHICLES, *VEHICLES, 9)[rng.integers(9)], (1, 1, 1, 1, 190)[rng.integers(5)]
        pen = self.pens[system, component]
        pen.seq = int(rng.integers(256))
        try:
            return bytes(made(*values).pack(pen, force_mavlink1=bool(rng.random() < 0.1)))
        except Exception:  # what pymavlink itself cannot pack is no frame
            return b"\xfd" + bytes(rng.integers(0, 256, 20, dtype=np.uint8))

    def datagram(self) -> bytes:
        """One hostile datagram."""
        rng = self.rng
        picks = rng.integers(len(self.frames), size=1 + int(rng.random() < 0.3) * int(rng.integers(1, 4)))
        data = b"".join([self.frames[pick] for pick in picks])
        how = rng.random()
        if how < 0.6:
            return data
        if how < 0.75:
            return data[int(rng.integers(len(data))) :]
        if how < 0.85:
            return data[: int(rng.integers(len(data)))]
        if how < 0.95:
            flipped = bytearray(data)
            flipped[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
            return bytes(flipped)
        return bytes(rng.integers(0, 256, int(rng.integers(300)), dtype=np.uint8))


def run(inputs: int, seed: int, seconds: float = math.inf, pool: int = 20_000) -> tuple[int, dict[str, int]]:
    """Feed so many datagrams, or for so long; return how many, and what came of them."""
    maker, rng = Maker(seed, pool), np.random.default_rng(seed + 1)
    fleet = Fleet(VEHICLES, FRAME)
    tasking = upload_manager(fleet, FRAME, VEHICLES, 3)
    t_ns, began_s, done = 0, time.monotonic(), 0
    seen = {"messages": 0, "sends": 0, "ended": 0, "tasks": 0, "notices": 0}
    while done < inputs and (done % 1000 or time.monotonic() - began_s < seconds):
        done += 1
        t_ns += int(rng.exponential(5e6))
        address = ADDRESSES[0 if rng.random() < 0.9 else rng.integers(len(ADDRESSES))]
        effects = []
        for vehicle, message in fleet.receive(Datagram(t_ns, "udp", address, maker.datagram())):
            seen["messages"] += 1
            effects += tasking.receive(vehicle, message, t_ns)
        if done % 10 == 0:
            effects += [*fleet.poll(t_ns), *tasking.poll(t_ns)]
            seen["notices"] += len(fleet.notices())
        if done % 200 == 0:
            points = read_only(rng.uniform(0.0, 2000.0, (int(rng.integers(1, 5)), 2)))
            vehicle = VEHICLES[rng.integers(len(VEHICLES))]
            effects += tasking.enqueue_upload(Route(vehicle, (0, 0), points, 1.0), t_ns)
            seen["tasks"] += 1
        if done % 5000 == 0:
            tasking.cancel(VEHICLES[rng.integers(len(VEHICLES))], t_ns)
            fleet.health(), fleet.states(), tasking.overrides.modes(), tasking.state.stages
        for effect in effects:
            if isinstance(effect, Send):
                seen["sends"] += 1
                assert effect.peer in ADDRESSES
            else:
                seen["ended"] += 1
    assert len(fleet.unknown_systems()) <= 64
    return done, seen


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=10_000_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=math.inf)
    arguments = parser.parse_args()
    began_s = time.process_time()
    done, seen = run(arguments.inputs, arguments.seed, 60.0 * arguments.minutes)
    cpu_s = time.process_time() - began_s
    print(f"{done:,} inputs, no exception; {seen}; {1e6 * cpu_s / done:.0f} µs of CPU each")


if __name__ == "__main__":
    main()
