"""What a MAVLink message costs on its way in, and how many a second get through without loss.

``python tests/bench/bench_ingest.py [--networks 20] [--vehicles 250] [--hz 50] [--seconds 8]``

First the decoding alone, by pymavlink, by the simple form and by the kernels. Then over real sockets: a
process of its own plays the vehicles of all networks (one UDP port each, one message a datagram, as a radio's
router sends them), and two receivers are held against each other on the same traffic: `recvfrom` and
pymavlink's decoder, and the service's own way in (its endpoints, its queue and its fleet). Rates that the
machine does not reach are reported as reached; CPU is of the receiver's process.
"""

import argparse
import asyncio
import ctypes
import json
import resource
import selectors
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect
from rich.console import Console
from rich.table import Table

from gcs.edge.batches import ManyAtOnce, _Header, _IoVector
from gcs.edge.links import Links
from gcs.edge.signing import Signing
from gcs.endpoints import Link, parse_endpoint
from gcs.geo import LocalFrame
from gcs.mavlink import bulk, quiet
from gcs.mavlink.codec import Encoder, scan
from gcs.mavlink.fleet import Fleet
from gcs.model import NS_PER_S, Datagram, vehicle_id

FRAME = LocalFrame(33.2, -87.6, 70.0)
TICK_S = 0.01
_STEPS = bulk._STEPS[0]


# ------------------------------------------------------------------------------------ the senders


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
        crc = crc >> 8 ^ _STEPS[(crc ^ byte) & 0xFF]
    frames[:, -2], frames[:, -1] = crc & 0xFF, crc >> 8
    return frames


class Sender:
    """One network's socket."""

    def __init__(self, port):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._sendmmsg = ctypes.CDLL(None, use_errno=True).sendmmsg
        self._vectors, self._headers = (_IoVector * 512)(), (_Header * 512)()
        for vector, header in zip(self._vectors, self._headers, strict=True):
            header.message.vector, header.message.vectors = ctypes.pointer(vector), 1
        self._bases = np.frombuffer(memoryview(self._vectors).cast("B"), np.uint64).reshape(-1, 2)

    def send(self, frames):
        frames = np.ascontiguousarray(frames)
        n, size = frames.shape
        self._bases[:n, 0] = frames.ctypes.data + size * np.arange(n, dtype=np.uint64)
        self._bases[:n, 1] = size
        at = 0
        while at < n:
            header = ctypes.byref(self._headers, at * ctypes.sizeof(_Header))
            sent = self._sendmmsg(self._socket.fileno(), header, n - at, 0)
            at += sent if sent > 0 else 1


def play(ports, vehicles, hz, seconds):
    """Play all vehicles; print what was sent, and how it was paced, as JSON."""
    senders = [Sender(port) for port in ports]
    systems = np.arange(1, vehicles + 1)
    sequence = np.zeros(vehicles, np.int64)
    phases = max(1, round(1 / hz / TICK_S))
    per_tick = max(1, round(hz * TICK_S))
    sent, tick, late_s = 0, 0, 0.0
    began = time.monotonic()
    while tick * TICK_S < seconds:
        due = began + tick * TICK_S
        late_s = max(late_s, time.monotonic() - due)
        time.sleep(max(0.0, due - time.monotonic()))
        batches = []
        beating = (systems % 100 == tick % 100) | (tick == 0)
        if beating.any():
            batches.append(beat_frames(systems[beating], sequence[beating]))
            sequence[beating] += 1
        for k in range(per_tick):
            now = (systems + tick) % phases == 0
            boot_ms = np.full(now.sum(), tick * round(TICK_S * 1e3) + k + 1)
            batches.append(position_frames(systems[now], sequence[now], boot_ms))
            sequence[now] += 1
        for sender in senders:
            for frames in batches:
                sender.send(frames)
        sent += len(senders) * sum(len(frames) for frames in batches)
        tick += 1
    took_s = time.monotonic() - began
    cpu_s = time.process_time()
    print(json.dumps({"sent": sent, "took_s": took_s, "late_s": late_s, "cpu_s": cpu_s}), flush=True)


def start_senders(ports, args):
    command = [sys.executable, str(Path(__file__)), "--vehicles", str(args.vehicles), "--hz", str(args.hz)]
    command += ["--seconds", str(args.seconds), "--play", *map(str, ports)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


# ------------------------------------------------------------------------------------ the receivers


def receive_by_pymavlink(args):
    """`recvfrom` and pymavlink's decoder; returns messages, CPU seconds and the senders' account."""
    sockets = []
    selector = selectors.DefaultSelector()
    for _ in range(args.networks):
        fresh = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        fresh.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 * 1024 * 1024)
        fresh.setblocking(False)
        fresh.bind(("127.0.0.1", 0))
        selector.register(fresh, selectors.EVENT_READ)
        sockets.append(fresh)
    decoder = dialect.MAVLink(None)
    senders, count = start_senders([s.getsockname()[1] for s in sockets], args), 0
    began, last = time.process_time(), time.monotonic() + 10.0
    while time.monotonic() - last < 1.0:
        for key, _ in selector.select(0.2):
            for _ in range(256):
                try:
                    data, _peer = key.fileobj.recvfrom(2048)
                except BlockingIOError:
                    break
                decoder.decode(bytearray(data))
                count += 1
                last = time.monotonic()
    cpu_s = time.process_time() - began
    for fresh in sockets:
        fresh.close()
    return count, cpu_s, json.loads(senders.communicate()[0])


class Intake:
    """The service's queue and consumer, with a fleet behind it."""

    def __init__(self, links, vehicles):
        self.fleet = Fleet(vehicles, FRAME, links=links)
        self.queue = asyncio.Queue(20_000)
        self.dropped = self.events = 0
        self.t_ns = time.time_ns()

    def now_ns(self):
        return time.time_ns()

    def on_datagram(self, link, peer, data):
        try:
            self.queue.put_nowait(Datagram(time.time_ns(), link, peer, data))
        except asyncio.QueueFull:
            self.dropped += 1

    def on_link_news(self, link, level, text):
        raise AssertionError(text)

    async def consume(self):
        while True:
            event = await self.queue.get()
            self.fleet.receive(event)
            self.events += 1


async def receive_by_ours(args):
    """Links, queue and fleet; returns the intake, CPU seconds and the senders' account."""
    frees = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(args.networks)]
    for free in frees:
        free.bind(("127.0.0.1", 0))
    ports = [free.getsockname()[1] for free in frees]
    for free in frees:
        free.close()
    links = [Link(parse_endpoint(f"udpin:127.0.0.1:{port}"), network) for network, port in enumerate(ports)]
    vehicles = [vehicle_id(n, s) for n in range(args.networks) for s in range(1, args.vehicles + 1)]
    intake = Intake(links, vehicles)
    opened = Links(links, vehicles, FRAME, Signing(links, None))
    opened.start(asyncio.get_running_loop(), intake)
    consumer = asyncio.create_task(intake.consume())
    senders = start_senders(ports, args)
    while not intake.events:
        await asyncio.sleep(0.02)
    began = time.process_time()
    while senders.poll() is None:
        await asyncio.sleep(0.25)
    await asyncio.sleep(0.3)
    cpu_s = time.process_time() - began
    consumer.cancel()
    opened.close()
    return intake, cpu_s, json.loads(senders.communicate()[0])


# ------------------------------------------------------------------------------------ tables


def us_each(work, messages, repeats=7):
    """Least CPU microseconds a message of some repeats."""
    best = float("inf")
    for _ in range(repeats):
        began = time.process_time()
        work()
        best = min(best, time.process_time() - began)
    return best / messages * 1e6


def decoding(console):
    positions = [
        position_frames(np.arange(1, 251), np.full(250, k), np.full(250, 20 * k + 1)) for k in range(40)
    ]
    singles = [row.tobytes() for frames in positions for row in frames]
    beats = [row.tobytes() for row in beat_frames(np.arange(1, 251), np.zeros(250, int))]
    whole = [b"".join(singles[k : k + 35]) for k in range(0, len(singles), 35)]
    decoder, frames, n = dialect.MAVLink(None), bulk.Frames(), len(singles)

    def fold(datagrams, kernel, repeats):
        """Each time into a fleet that knows its vehicles and has heard no position."""
        made = []
        for _ in range(repeats):
            made.append(Fleet(range(1, 251), FRAME, kernel=kernel))
            for data in beats:
                made[-1].receive(Datagram(1, "udp", "a", data))
        events = [Datagram(NS_PER_S, "udp", "a", data) for data in datagrams]

        def work():
            receive = made.pop().receive
            for event in events:
                receive(event)

        return us_each(work, n, repeats)

    rows = [
        ("pymavlink: decode", us_each(lambda: [decoder.decode(bytearray(d)) for d in singles], n)),
        (
            "ours, simple: scan, then fields",
            us_each(lambda: [scan(d).frames[0].message() for d in singles], n),
        ),
        ("ours, kernel: framed, one a datagram", us_each(lambda: [frames.take(d) for d in singles], n)),
        ("ours, kernel: framed, 35 a datagram", us_each(lambda: [frames.take(d) for d in whole], n)),
        ("fleet without kernels, one a datagram", fold(singles, False, 3)),
        ("fleet, one a datagram", fold(singles, True, 7)),
        ("fleet, 35 a datagram", fold(whole, True, 7)),
    ]
    table = Table("decoding GLOBAL_POSITION_INT, checksums enforced", "us a message", "times pymavlink")
    for name, us in rows:
        table.add_row(name, f"{us:.2f}", f"{rows[0][1] / us:.1f}")
    console.print(table)


def in_turn(console):
    """Send 200 datagrams to a socket, then take them: no process waits for a core."""
    made, beats = Fleet(range(1, 201), FRAME), beat_frames(np.arange(1, 201), np.zeros(200, int))
    reader, decoder, step = ManyAtOnce(), dialect.MAVLink(None), 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours:
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 * 1024 * 1024)
        ours.setblocking(False)
        ours.bind(("127.0.0.1", 0))
        sender = Sender(ours.getsockname()[1])

        def by_pymavlink():
            for _ in range(200):
                decoder.decode(bytearray(ours.recvfrom(2048)[0]))

        def by_ours():
            for peer, data in reader.read(ours)[1]:
                made.receive(Datagram(NS_PER_S, "udp", peer, data))

        sender.send(beats)
        by_ours()
        table = Table("200 datagrams of one network, from the socket to the state", "us a message")
        for name, work in (("recvfrom + pymavlink", by_pymavlink), ("recvmmsg, gathered, fleet", by_ours)):
            best = float("inf")
            for _ in range(100):
                step += 1
                sender.send(position_frames(np.arange(1, 201), np.full(200, step), np.full(200, 20 * step)))
                best = min(best, us_each(work, 200, 1))
            table.add_row(name, f"{best:.2f}")
    console.print(table)


def loopback(args, console):
    table = Table(
        "receiver", "sent/s", "taken/s", "lost", "CPU of a core", "us a message", "messages a CPU second"
    )
    count, cpu_s, by = receive_by_pymavlink(args)
    rows = [("recvfrom + pymavlink", by, count, cpu_s)]
    intake, cpu_s, by = asyncio.run(receive_by_ours(args))
    rows.append(("links, queue, fleet", by, intake.fleet.counters.frames, cpu_s))
    for name, account, taken, cpu in rows:
        took_s = account["took_s"]
        lost = 1.0 - taken / account["sent"]
        table.add_row(
            name, f"{account['sent'] / took_s:,.0f}", f"{taken / took_s:,.0f}", f"{lost:.2%}",
            f"{cpu / took_s:.0%}", f"{cpu / taken * 1e6:.2f}", f"{taken / cpu:,.0f}",
        )  # fmt: skip
    console.print(table)
    states = intake.fleet.states()
    gaps = sum(counters.lost for counters in intake.fleet.links.values())
    first, second = rows[0][2] / rows[0][3], rows[1][2] / rows[1][3]
    console.print(
        f"{len(states)} vehicles known; frames missing in their sequences: {gaps}; events: {intake.events} "
        f"(dropped: {intake.dropped}); {second / first:.1f} times the messages a CPU second; senders: "
        f"{by['cpu_s'] / by['took_s']:.0%} of a core, {by['late_s'] * 1e3:.0f} ms late at worst; "
        f"receiver's peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024} MB",
        highlight=False,
    )


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--networks", type=int, default=20)
    parser.add_argument("--vehicles", type=int, default=250, help="on each network")
    parser.add_argument("--hz", type=float, default=50.0, help="positions a second of each vehicle")
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--play", type=int, nargs="*", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.play:
        play(args.play, args.vehicles, args.hz, args.seconds)
        return
    console = Console(width=120)
    quiet.warm_up()
    assert len(Encoder(1, 1)(dialect.MAVLink_heartbeat_message(1, 3, 217, 10, 4, 3))) == 21
    decoding(console)
    in_turn(console)
    loopback(args, console)


if __name__ == "__main__":
    main()
