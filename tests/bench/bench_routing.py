"""What a frame costs on its way through the routes: CPU time next to that of pymavlink on the same bytes.

    python tests/bench/bench_routing.py [--vehicles 200] [--stations 3] [--seconds 20]

Every vehicle sends what an autopilot sends (HEARTBEAT 1 Hz, ATTITUDE and GLOBAL_POSITION_INT 4 Hz); each
frame is split, checked and routed to every other ground station. Nothing is sent: sockets are not part of it.
"""

from __future__ import annotations

import argparse
import time

from pymavlink.dialects.v20 import ardupilotmega as dialect
from rich.console import Console
from rich.table import Table

from gcs.endpoints import Link, parse_endpoint
from gcs.mavlink.frames.codec import Encoder
from gcs.mavlink.frames.fast_scan import Scanner
from gcs.mavlink.router.router import Router

S = 1_000_000_000
AIR, SEAT = "udpin:0.0.0.0:1", "udpin:0.0.0.0:2"


def traffic(vehicles: int, seconds: int) -> list[tuple[int, tuple[str, str], bytes]]:
    beat = dialect.MAVLink_heartbeat_message(1, 3, 217, 10, 4, 3)
    rest = (
        dialect.MAVLink_attitude_message(1000, 0.1, 0.2, 0.3, 0, 0, 0),
        dialect.MAVLink_global_position_int_message(1000, 332000000, -876000000, 170000, 100000, 1, 2, 3, 4),
    )
    encoders = {number: Encoder(number, 1) for number in range(1, vehicles + 1)}
    sent = []
    for quarter in range(4 * seconds):
        for number, encode in encoders.items():
            address = (AIR, f"10.0.0.{number}:9")
            messages = (*rest, beat) if quarter % 4 == 0 else rest
            sent += [(quarter * S // 4, address, encode(message)) for message in messages]
    return sent


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    for name, default in (("vehicles", 200), ("stations", 3), ("seconds", 20)):
        arguments.add_argument(f"--{name}", type=int, default=default)
    chosen = arguments.parse_args()
    links = [Link(parse_endpoint(AIR)), Link(parse_endpoint(SEAT), role="full")]
    sent, scanner = traffic(chosen.vehicles, chosen.seconds), Scanner()

    def routed() -> None:
        router = Router(links, range(1, chosen.vehicles + 1))
        for station in range(chosen.stations):
            router.add_connection(0, (SEAT, f"10.1.0.{station}:9"))
        for t_ns, address, data in sent:
            for frame in scanner(data):
                router.route_frame(t_ns, address, frame)
        assert router.counters[SEAT].sent >= chosen.stations * len(sent) * 0.9

    def split() -> None:
        for _, _, data in sent:
            scanner(data)

    def parsed() -> None:
        parser = dialect.MAVLink(None)
        for _, _, data in sent:
            parser.parse_buffer(bytearray(data))

    table = Table("", "µs a frame", "of pymavlink", box=None)
    spent = {
        "split, checked, routed": least(routed),
        "split and checked": least(split),
        "pymavlink": least(parsed),
    }
    for name, seconds in spent.items():
        table.add_row(name, f"{seconds / len(sent) * 1e6:.2f}", f"{seconds / spent['pymavlink']:.2f}")
    Console().print(f"{len(sent)} frames of {chosen.vehicles} vehicles to {chosen.stations} stations")
    Console().print(table)


def least(work) -> float:
    """Least CPU time of three."""
    times = []
    for _ in range(3):
        began = time.process_time()
        work()
        times.append(time.process_time() - began)
    return min(times)


if __name__ == "__main__":
    main()
