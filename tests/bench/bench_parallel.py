"""How long a swarm's missions take over loopback: real UDP sockets, one a vehicle, vehicles in a process.

``python tests/bench/bench_parallel.py [--vehicles 200] [--items 30] [--window 32] [--repeats 5]``. A light
vehicle is a store that speaks the mission protocol as ArduPlane does, without flight. Measured from the first
MISSION_COUNT to the last mission read back equal, selected and in AUTO; the service's own CPU next to it.
"""

import argparse
import multiprocessing
import resource
import selectors
import socket
import time

import numpy as np
from helpers.missions import upload_manager
from helpers.plane_double import LOITER, Plane

from gcs.geo import LocalFrame
from gcs.mavlink.fleet.fleet import Fleet
from gcs.model import Datagram, Route, Send, UploadReport, read_only

FRAME = LocalFrame(33.2, -87.6, 70.0)


def vehicles(system_ids: list[int], port: int) -> None:
    """A process of light vehicles; it ends with its parent."""
    selector, beat_s = selectors.DefaultSelector(), 0.0
    hosts = []
    for system_id in system_ids:
        link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        link.connect(("127.0.0.1", port))
        hosts.append((link, Plane(system_id, mode=LOITER)))
        selector.register(link, selectors.EVENT_READ, hosts[-1])
    while True:
        for key, _ in selector.select(0.1):
            link, plane = key.data
            for frame in plane.receive(link.recv(2048), time.time_ns()):
                link.send(frame)
        if time.monotonic() - beat_s > 0.2:
            beat_s = time.monotonic()
            for link, plane in hosts:
                for frame in plane.poll(time.time_ns()):
                    link.send(frame)


def once(count: int, items: int, window: int) -> tuple[float, float, int, float]:
    """Seconds, CPU seconds of the service's side, missions delivered, CPU seconds of the vehicles in all."""
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    link.bind(("127.0.0.1", 0))
    link.settimeout(0.01)
    port = link.getsockname()[1]
    ids = list(range(1, count + 1))
    process = multiprocessing.Process(target=vehicles, args=(ids, port), daemon=True)
    process.start()
    fleet = Fleet(ids, FRAME)
    tasking = upload_manager(fleet, FRAME, ids, window)
    rng = np.random.default_rng(1)
    done: list[UploadReport] = []
    polled_s = 0.0

    def carry_out(effects: list) -> None:
        for effect in effects:
            if isinstance(effect, Send):
                host, _, peer_port = effect.peer.rpartition(":")
                link.sendto(effect.data, (host, int(peer_port)))
            elif isinstance(effect, UploadReport):
                done.append(effect)

    def turn() -> None:
        nonlocal polled_s
        try:
            data, (host, peer_port) = link.recvfrom(2048)
        except TimeoutError:
            pass
        else:
            t_ns = time.time_ns()
            for vehicle, message in fleet.receive(Datagram(t_ns, "udp", f"{host}:{peer_port}", data)):
                carry_out(tasking.receive(vehicle, message, t_ns))
        if time.monotonic() - polled_s > 0.05:
            polled_s = time.monotonic()
            carry_out([*fleet.poll(time.time_ns()), *tasking.poll(time.time_ns())])

    while any(health.liveness != "alive" for health in fleet.health()):
        turn()
    end_s = time.monotonic() + 1.5  # let the questions of the first contact pass
    while time.monotonic() < end_s:
        turn()
    began_s, cpu_s = time.monotonic(), time.process_time()
    for vehicle in ids:
        points = read_only(rng.uniform(0.0, 2000.0, (items - 2, 2)))
        carry_out(tasking.enqueue_upload(Route(vehicle, (0, vehicle), points, 1.0), time.time_ns()))
    while len(done) < count and time.monotonic() - began_s < 120.0:
        turn()
    took_s, cpu_s = time.monotonic() - began_s, time.process_time() - cpu_s
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    process.kill()
    process.join()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    vehicles_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    link.close()
    return took_s, cpu_s, sum(report.ok for report in done), vehicles_s


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=200)
    parser.add_argument("--items", type=int, default=30)
    parser.add_argument("--window", type=int, default=32)
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(hard, 4096)), hard))
    rows = [once(arguments.vehicles, arguments.items, arguments.window) for _ in range(arguments.repeats)]
    times_s, cpu_s = [row[0] for row in rows], [row[1] for row in rows]
    print(
        f"{arguments.vehicles} vehicles x {arguments.items} items, window {arguments.window}: delivered "
        f"{min(row[2] for row in rows)}; {min(times_s):.2f} / {np.median(times_s):.2f} s (least / median), "
        f"{np.median(cpu_s):.2f} s of CPU, and {np.median([row[3] for row in rows]):.2f} s of the vehicles"
    )


if __name__ == "__main__":
    main()
