"""Telemetry of a swarm for benchmarks: built beforehand, sent in batches by a process of its own.

``python tests/bench/telemetry.py --vehicles 250 --hz 50 --seconds 6 --together 1300 PORT...`` plays all
vehicles of one network to each port, with GLOBAL_POSITION_INT at the rate given and HEARTBEAT once a second.
All datagrams are made, and the system's send tables filled in, before the first is sent, so that what a
sender costs is the system calls. It says ``ready``, sends a first word of each vehicle at a line on its
standard input, plays at the next, and prints what it did as JSON.
"""

import argparse
import ctypes
import itertools
import json
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.io.links.recvmmsg import _Header, _IoVector
from gcs.mavlink.frames.fast_scan import CRC_TABLES
from gcs.mavlink.frames.signing import signed, timestamp_of

TICK_S = 0.01
AT_ONCE = 512


# ------------------------------------------------------------------------------------ frames


def position_frames(systems, sequence, boot_ms):
    """GLOBAL_POSITION_INT of many vehicles at once: (n, 40) bytes."""
    n = len(systems)
    frames = np.zeros((n, 40), np.uint8)
    frames[:, [0, 1, 6, 7]] = (0xFD, 28, 1, 33)
    frames[:, 4], frames[:, 5] = sequence % 256, systems
    angle = boot_ms * 1e-4 + systems
    fields = np.zeros((n, 7), "<i4")
    fields[:, 0], fields[:, 3] = boot_ms, 400_000
    fields[:, 1] = 332_000_000 + 50_000 * np.sin(angle)
    fields[:, 2] = -876_000_000 + 50_000 * np.cos(angle)
    fields[:, 5] = 1500
    fields[:, 6] = 9000 << 16
    frames[:, 10:38] = fields.view(np.uint8)
    return with_crc(frames, dialect.MAVLink_global_position_int_message.crc_extra)


def beat_frames(systems, sequence):
    """HEARTBEAT of many vehicles at once: (n, 21) bytes."""
    frames = np.zeros((len(systems), 21), np.uint8)
    frames[:, [0, 1, 6, 10, 14, 15, 16, 17, 18]] = (0xFD, 9, 1, 10, 1, 3, 217, 4, 3)
    frames[:, 4], frames[:, 5] = sequence % 256, systems
    return with_crc(frames, dialect.MAVLink_heartbeat_message.crc_extra)


def with_crc(frames, extra):
    crc = np.full(len(frames), 0xFFFF, np.int32)
    for byte in (*frames[:, 1:-2].T.astype(np.int32), np.full(len(frames), extra, np.int32)):
        crc = crc >> 8 ^ CRC_TABLES[0, (crc ^ byte) & 0xFF]
    frames[:, -2], frames[:, -1] = crc & 0xFF, crc >> 8
    return frames


class Traffic(NamedTuple):
    """What one network says."""

    first: list[bytes]
    """A beat and a position of each vehicle."""
    ticks: list[list[bytes]]
    """Datagrams of each tick."""
    frames: int
    """In all ticks."""


def traffic(vehicles, hz, seconds, together, key=None):
    """Make it; frames are put together up to so many bytes, or go alone where two do not fit."""
    systems = np.arange(1, vehicles + 1)
    sequence = np.zeros(vehicles, np.int64)
    phases, per_tick = max(1, round(1 / hz / TICK_S)), max(1, round(hz * TICK_S))
    stamps = itertools.count(timestamp_of(time.time_ns()))

    def said(frames):
        rows = [row.tobytes() for row in frames]
        return rows if key is None else [signed(row, key, 0, next(stamps)) for row in rows]

    first = [*said(beat_frames(systems, sequence)), *said(position_frames(systems, sequence + 1, sequence))]
    sequence += 2
    ticks, count = [], 0
    for tick in range(round(seconds / TICK_S)):
        frames = []
        beating = systems % 100 == tick % 100
        frames += said(beat_frames(systems[beating], sequence[beating]))
        sequence[beating] += 1
        for k in range(per_tick):
            now = (systems + tick) % phases == 0
            boot_ms = np.full(now.sum(), (tick + 1) * round(TICK_S * 1e3) + k)
            frames += said(position_frames(systems[now], sequence[now], boot_ms))
            sequence[now] += 1
        count += len(frames)
        ticks.append(put_together(frames, together))
    return Traffic(first, ticks, count)


def put_together(frames, most_bytes):
    """Frames to datagrams as PX4 and mavlink-router fill theirs."""
    datagrams = []
    for frame in frames:
        if datagrams and len(datagrams[-1]) + len(frame) <= most_bytes:
            datagrams[-1] += frame
        else:
            datagrams.append(frame)
    return datagrams


# ------------------------------------------------------------------------------------ sending


class Batch:
    """Datagrams in memory, ready for ``sendmmsg``."""

    def __init__(self, datagrams):
        self._data = np.frombuffer(b"".join(datagrams), np.uint8)
        sizes = np.array([len(data) for data in datagrams], np.uint64)
        self._count = len(datagrams)
        self._vectors = (_IoVector * self._count)()
        words = np.frombuffer(memoryview(self._vectors).cast("B"), np.uint64).reshape(-1, 2)
        words[:, 0] = self._data.ctypes.data + np.cumsum(sizes) - sizes
        words[:, 1] = sizes
        self._headers = (_Header * self._count)()
        at = ctypes.addressof(self._vectors)
        vectors = np.frombuffer(memoryview(self._headers).cast("B"), np.uint64)
        vectors = vectors.reshape(-1, ctypes.sizeof(_Header) // 8)
        vectors[:, 2] = at + np.arange(self._count, dtype=np.uint64) * ctypes.sizeof(_IoVector)
        vectors[:, 3] = 1
        self._sendmmsg = ctypes.CDLL(None, use_errno=True).sendmmsg

    def send(self, link):
        """Send all; what the system refuses is left out."""
        at = 0
        while at < self._count:
            header = ctypes.byref(self._headers, at * ctypes.sizeof(_Header))
            sent = self._sendmmsg(link.fileno(), header, min(AT_ONCE, self._count - at), 0)
            at += sent if sent > 0 else 1


def sockets_to(ports):
    links = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in ports]
    for link, port in zip(links, ports, strict=True):
        link.connect(("127.0.0.1", port))
    return links


def play(ports, made):
    """Play to all ports; a line on standard input starts each part."""
    links = sockets_to(ports)
    beats, places = (
        Batch(part) for part in (made.first[: len(made.first) // 2], made.first[len(made.first) // 2 :])
    )
    ticks = [Batch(datagrams) for datagrams in made.ticks]
    print("ready", flush=True)
    sys.stdin.readline()
    for part in (beats, places):
        for link in links:
            part.send(link)
            time.sleep(0.01)
    sys.stdin.readline()
    late_s, cpu_s, began = 0.0, time.process_time(), time.monotonic()
    for number, batch in enumerate(ticks):
        wait_s = began + number * TICK_S - time.monotonic()
        late_s = max(late_s, -wait_s)
        if wait_s > 0.0:
            time.sleep(wait_s)
        for link in links:
            batch.send(link)
    took_s = max(time.monotonic() - began, len(ticks) * TICK_S)
    return {
        "sent": made.frames * len(links),
        "datagrams": sum(map(len, made.ticks)) * len(links),
        "took_s": took_s,
        "late_s": late_s,
        "cpu_s": time.process_time() - cpu_s,
    }


class Player:
    """The playing process, as its starter sees it."""

    def __init__(self, ports, vehicles, hz, seconds, together, key=None):
        command = [sys.executable, str(Path(__file__)), "--vehicles", str(vehicles), "--hz", str(hz)]
        command += ["--seconds", str(seconds), "--together", str(together), *map(str, ports)]
        command += [] if key is None else ["--key", key.hex()]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
        assert self.process.stdout.readline() == "ready\n"

    def go_on(self):
        self.process.stdin.write("\n")
        self.process.stdin.flush()

    @property
    def is_playing(self):
        return self.process.poll() is None

    def account(self):
        return json.loads(self.process.stdout.readline())


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("ports", type=int, nargs="+")
    parser.add_argument("--vehicles", type=int, default=250)
    parser.add_argument("--hz", type=float, default=50.0)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--together", type=int, default=0, help="bytes of a datagram; 0: a frame each")
    parser.add_argument("--key", type=bytes.fromhex)
    args = parser.parse_args()
    made = traffic(args.vehicles, args.hz, args.seconds, args.together, args.key)
    print(json.dumps(play(args.ports, made)), flush=True)


if __name__ == "__main__":
    main()
