"""What a MAVLink message costs on its way in, and how many a second get through without loss.

``python tests/bench/bench_ingest.py [--networks 20] [--vehicles 250] [--hz 50] [--seconds 6]``

First the decoding alone, by pymavlink, by the simple form and by the kernels. Then over real sockets: a
process of its own plays the vehicles of all networks (`telemetry.py`; one UDP port a network), and receivers
are held against each other on the same traffic: `recvfrom`, pymavlink's decoder and the least that a user of
it keeps of each vehicle (where it is, how it moves, its mode, when it was heard, how many frames were lost),
with and without that last part; and the service's own way in (its endpoints, its queue and its fleet; its
gate, where frames are signed), which keeps that and checks it besides. The frames of a tick are put together
as autopilots and routers do it, or go one in a datagram. First contact is made before. Rates that the machine
does not reach are reported as reached; CPU is of the receiver's process.
"""

import argparse
import asyncio
import resource
import selectors
import socket
import time
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect
from rich.console import Console
from rich.table import Table
from telemetry import Batch, Player, beat_frames, position_frames, put_together, sockets_to

from gcs.endpoints import Link, parse_endpoint
from gcs.geo import LocalFrame
from gcs.io.links.garbage import GarbageFilter
from gcs.io.links.manager import Links
from gcs.io.links.recvmmsg import BatchReader
from gcs.io.signing.link_signing import LinkSigning
from gcs.mavlink.fleet import fast_telemetry
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.frames.codec import scan
from gcs.mavlink.frames.fast_scan import Scanner
from gcs.mavlink.frames.signing import Keys, SigningGate
from gcs.model import NS_PER_S, Datagram, vehicle_id

FRAME = LocalFrame(33.2, -87.6, 70.0)
KEY = bytes(range(32))
TOGETHER_BYTES = 1300


class IngestResult(NamedTuple):
    """What a receiver did with a run."""

    name: str
    account: dict
    frames: int
    cpu_s: float
    missing: int = 0
    dropped: int = 0


# ------------------------------------------------------------------------------------ the receivers


class PymavlinkUser:
    """The least that a user of pymavlink keeps for the fleet's states of each vehicle."""

    def __init__(self):
        self.places, self.beats, self.heard_s, self.sequence, self.lost = {}, {}, {}, {}, 0

    def take(self, network, message):
        vehicle = (network, message.get_srcSystem())
        self.heard_s[vehicle] = time.time()
        sequence = message.get_seq()
        self.lost += (sequence - self.sequence.get(vehicle, sequence - 1) - 1) % 256
        self.sequence[vehicle] = sequence
        match message.get_type():
            case "GLOBAL_POSITION_INT":
                place = (message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
                moves = (message.vx * 1e-2, message.vy * 1e-2, message.hdg * 1e-2)
                self.places[vehicle] = (message.time_boot_ms, place, moves)
            case "HEARTBEAT":
                self.beats[vehicle] = (message.autopilot, message.base_mode, message.custom_mode)


def receive_by_pymavlink(args, together, keeps=True):
    """`recvfrom`, pymavlink's decoder, one of its own a socket, and what a user keeps."""
    selector, ports = selectors.DefaultSelector(), []
    for network in range(args.networks):
        fresh = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        fresh.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 * 1024 * 1024)
        fresh.setblocking(False)
        fresh.bind(("127.0.0.1", 0))
        selector.register(fresh, selectors.EVENT_READ, (network, dialect.MAVLink(None)))
        ports.append(fresh.getsockname()[1])
    player, count = Player(ports, args.vehicles, args.hz, args.seconds, together), 0
    user = PymavlinkUser()
    for _ in ("first words", "all others"):
        player.go_on()
        count, began, last = 0, time.process_time(), time.monotonic()
        while time.monotonic() - last < 1.0:
            for key, _ in selector.select(0.2):
                source, (network, decoder) = key.fileobj, key.data
                for _ in range(256):
                    try:
                        data = source.recvfrom(2048)[0]
                    except BlockingIOError:
                        break
                    messages = decoder.parse_buffer(data) if together else [decoder.decode(bytearray(data))]
                    count += len(messages)
                    if keeps:
                        for message in messages:
                            user.take(network, message)
                    last = time.monotonic()
    cpu_s = time.process_time() - began
    for key in list(selector.get_map().values()):
        key.fileobj.close()
    assert not keeps or len(user.places) == args.networks * args.vehicles
    name = "recvfrom + pymavlink + a user's table" if keeps else "recvfrom + pymavlink"
    return IngestResult(name, player.account(), count, cpu_s, user.lost)


class Intake:
    """The service's noise filter, queue and consumer, with a fleet behind it."""

    def __init__(self, links, vehicles):
        self.fleet = Fleet(vehicles, FRAME, links=links)
        self.garbage, self.queue = GarbageFilter(), asyncio.Queue(20_000)
        self.dropped = 0

    def now_ns(self):
        return time.time_ns()

    def on_datagram(self, link, peer, frames):
        frames = self.garbage.filter_datagram(time.time_ns(), link, frames)
        try:
            self.queue.put_nowait((Datagram(time.time_ns(), link, peer, frames.data), frames))
        except asyncio.QueueFull:
            self.dropped += 1

    def on_notice(self, subject, code, /, **parameters):
        raise AssertionError(f"{subject}: {code} {parameters}")

    async def consume(self):
        while True:
            self.fleet.receive(*await self.queue.get())

    def missing(self):
        return sum(counters.lost for counters in self.fleet.links.values())


def free_ports(count):
    frees = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(count)]
    for free in frees:
        free.bind(("127.0.0.1", 0))
    ports = [free.getsockname()[1] for free in frees]
    for free in frees:
        free.close()
    return ports


async def receive_by_ours(args, together, key=None):
    """Endpoints, gate, queue and fleet."""
    ports = free_ports(args.networks)
    links = [Link(parse_endpoint(f"udpin:127.0.0.1:{port}"), network) for network, port in enumerate(ports)]
    vehicles = [vehicle_id(n, s) for n in range(args.networks) for s in range(1, args.vehicles + 1)]
    intake, signing = Intake(links, vehicles), LinkSigning(links, None)
    if key is not None:
        signing.gate = SigningGate(Keys(default=key), links)
    opened = Links(links, vehicles, FRAME, signing, Scanner())
    player = await asyncio.to_thread(Player, ports, args.vehicles, args.hz, args.seconds, together, key)
    opened.start(asyncio.get_running_loop(), intake)
    consumer = asyncio.create_task(intake.consume())
    player.go_on()
    while intake.fleet.counters.frames < 2 * len(vehicles):
        await asyncio.sleep(0.1)
    assert len(intake.fleet.states()) == len(vehicles)
    player.go_on()
    before, began = intake.fleet.counters.frames, time.process_time()
    while player.is_playing:
        await asyncio.sleep(0.25)
    frames = -1
    while frames < (frames := intake.fleet.counters.frames - before):
        await asyncio.sleep(0.3)
    cpu_s = time.process_time() - began
    consumer.cancel()
    opened.close()
    name = "links, queue, fleet" if key is None else "gate, links, queue, fleet"
    return IngestResult(name, player.account(), frames, cpu_s, intake.missing(), intake.dropped)


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
    whole = put_together(singles, 1400)
    decoder, scanner, n = dialect.MAVLink(None), Scanner(), len(singles)

    def time_fleet(datagrams, kernel, repeats):
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
        ("ours, kernel: framed, one a datagram", us_each(lambda: [scanner(d) for d in singles], n)),
        ("ours, kernel: framed, 35 a datagram", us_each(lambda: [scanner(d) for d in whole], n)),
        ("fleet without kernels, one a datagram", time_fleet(singles, False, 3)),
        ("fleet, one a datagram", time_fleet(singles, True, 7)),
        ("fleet, 35 a datagram", time_fleet(whole, True, 7)),
    ]
    table = Table("decoding GLOBAL_POSITION_INT, checksums enforced", "us a message", "times pymavlink")
    for name, us in rows:
        table.add_row(name, f"{us:.2f}", f"{rows[0][1] / us:.1f}")
    console.print(table)


def in_turn(console):
    """Send 200 datagrams to a socket, then take them: no process waits for a core."""
    made, beats = Fleet(range(1, 201), FRAME), beat_frames(np.arange(1, 201), np.zeros(200, int))
    reader, decoder, step = BatchReader(), dialect.MAVLink(None), 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours:
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 * 1024 * 1024)
        ours.setblocking(False)
        ours.bind(("127.0.0.1", 0))
        (link,) = sockets_to([ours.getsockname()[1]])

        def by_pymavlink():
            for _ in range(200):
                decoder.decode(bytearray(ours.recvfrom(2048)[0]))

        def by_ours():
            for peer, data in reader.read(ours)[1]:
                made.receive(Datagram(NS_PER_S, "udp", peer, data))

        def send(frames):
            Batch([row.tobytes() for row in frames]).send(link)

        send(beats)
        by_ours()
        table = Table("200 datagrams of one network, from the socket to the state", "us a message")
        for name, work in (("recvfrom + pymavlink", by_pymavlink), ("recvmmsg, gathered, fleet", by_ours)):
            best = float("inf")
            for _ in range(100):
                step += 1
                send(position_frames(np.arange(1, 201), np.full(200, step), np.full(200, 20 * step)))
                best = min(best, us_each(work, 200, 1))
            table.add_row(name, f"{best:.2f}")
        link.close()
    console.print(table)


def loopback(args, console):
    """Play to receivers in turn, and hold them against each other."""
    heads = ["receiver", "frames a datagram", "sent/s", "taken/s", "lost", "CPU of a core", "us a message"]
    table = Table(*heads, "ratio", "sender's CPU", "late, ms", title="over sockets", title_justify="left")
    for together in (TOGETHER_BYTES, 0):
        peer = receive_by_pymavlink(args, together)
        rows = [peer, receive_by_pymavlink(args, together, keeps=False)]
        rows.append(asyncio.run(receive_by_ours(args, together)))
        rows.append(asyncio.run(receive_by_ours(args, together, KEY)))
        for row in rows:
            account, took_s = row.account, row.account["took_s"]
            table.add_row(
                row.name, f"{account['sent'] / account['datagrams']:.1f}", f"{account['sent'] / took_s:,.0f}",
                f"{row.frames / took_s:,.0f}", f"{1.0 - row.frames / account['sent']:.2%}",
                f"{row.cpu_s / took_s:.0%}", f"{row.cpu_s / row.frames * 1e6:.2f}",
                f"{peer.cpu_s / peer.frames / (row.cpu_s / row.frames):.1f}",
                f"{account['cpu_s'] / took_s:.0%}", f"{account['late_s'] * 1e3:.0f}",
            )  # fmt: skip
            if row.missing or row.dropped:
                console.print(f"{row.name}: {row.missing} frames missing, {row.dropped} events dropped")
    console.print(table)
    console.print(f"receiver's peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024} MB")


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--networks", type=int, default=20)
    parser.add_argument("--vehicles", type=int, default=250, help="on each network")
    parser.add_argument("--hz", type=float, default=50.0, help="positions a second of each vehicle")
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--sockets-only", action="store_true")
    args = parser.parse_args()
    console = Console(width=140)
    fast_telemetry.warm_up()
    if not args.sockets_only:
        decoding(console)
        in_turn(console)
    loopback(args, console)


if __name__ == "__main__":
    main()
