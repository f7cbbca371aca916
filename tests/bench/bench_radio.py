"""Missions for a swarm over one slow radio: how long they take, and how much of the radio.

``python tests/bench/bench_radio.py [--vehicles 8 16] [--loss 0 0.1 0.2]`` gives each of some scripted
ArduPlanes a mission of 30 items over one radio of 57,600 baud that all of them share: 5,760 bytes a second
each way, one byte after the other, 40 ms of latency, and telemetry that takes a part of the way down. Virtual
time, the service's own tasking with its windows. A row for each: seconds until the first, half and all of
them fly their mission, bytes sent up, messages that were repeated, and how long a byte waited in the radio.
"""

import argparse
import heapq

import numpy as np
from helpers.missions import upload_manager
from helpers.plane_double import LOITER, Plane, S

from gcs.geo import LocalFrame
from gcs.mavlink.fleet.fleet import Fleet
from gcs.model import Datagram, Route, Send, UploadReport, read_only

FRAME = LocalFrame(-35.3632621, 149.165237, 584.09)
BYTES_S = 5760.0
LATENCY_S = 0.04
STEP_NS = S // 100
LIMIT_S = 900.0


class Radio:
    """One way: a byte at a time, so that what is sent too fast waits."""

    def __init__(self, seed: int, loss: float, busy: float = 0.0) -> None:
        self._rng, self._loss = np.random.default_rng(seed), loss
        self._ns_per_byte = S / (BYTES_S * (1.0 - busy))
        self._free_ns, self._sent = 0, 0
        self._queue: list[tuple[int, int, int, bytes]] = []
        self.bytes = 0
        self.waited_s: list[float] = [0.0]

    def put(self, whose: int, data: bytes, t_ns: int) -> None:
        self.waited_s.append(max(0, self._free_ns - t_ns) / S)
        self._free_ns = max(self._free_ns, t_ns) + round(len(data) * self._ns_per_byte)
        self.bytes += len(data)
        self._sent += 1
        if self._rng.random() >= self._loss:
            arrival_ns = self._free_ns + round(LATENCY_S * S)
            heapq.heappush(self._queue, (arrival_ns, self._sent, whose, data))

    def get(self, t_ns: int) -> list[tuple[int, bytes]]:
        out = []
        while self._queue and self._queue[0][0] <= t_ns:
            out.append(heapq.heappop(self._queue)[2:])
        return out


def fly(vehicles: int, loss: float, telemetry: float) -> str:
    """Return the row of one run."""
    planes = {n: Plane(n, mode=LOITER) for n in range(1, vehicles + 1)}
    fleet = Fleet(planes, FRAME)
    tasking = upload_manager(fleet, FRAME, planes)
    up, down = Radio(1, loss), Radio(2, loss, telemetry)
    reports: list[UploadReport] = []

    def carry(effects: list, t_ns: int) -> None:
        for effect in effects:
            if isinstance(effect, Send):
                up.put(int(effect.peer), effect.data, t_ns)
            elif isinstance(effect, UploadReport):
                reports.append(effect)

    t_ns, begun_ns = 0, 3 * S
    points_m = np.column_stack((np.linspace(0.0, 9000.0, 28), np.zeros(28)))
    while t_ns < begun_ns + LIMIT_S * S and sum(r.ok for r in reports) < vehicles:
        t_ns += STEP_NS
        if t_ns == begun_ns:
            up.bytes = 0
            for n in planes:
                carry(tasking.enqueue_upload(Route(n, (0, 0), read_only(points_m + n), 1.0), t_ns), t_ns)
        for n, data in up.get(t_ns):
            for frame in planes[n].receive(data, t_ns):
                down.put(n, frame, t_ns)
        for n, plane in planes.items():
            for frame in plane.poll(t_ns):
                down.put(n, frame, t_ns)
        for n, data in down.get(t_ns):
            for vehicle, message in fleet.receive(Datagram(t_ns, "radio", str(n), data)):
                carry(tasking.receive(vehicle, message, t_ns), t_ns)
        if t_ns % (S // 20) == 0:
            carry([*fleet.poll(t_ns), *tasking.poll(t_ns)], t_ns)
    done_s = sorted((r.t_ns - begun_ns) / S for r in reports if r.ok)
    times = f"{done_s[0]:.0f} / {done_s[len(done_s) // 2]:.0f} / {done_s[-1]:.0f}" if done_s else ""
    waits = " / ".join(f"{max(way.waited_s):.1f}" for way in (up, down))
    failed = sum(not r.ok for r in reports)
    repeated = sum(r.retries for r in reports)
    cells = [vehicles, f"{loss:.0%}", f"{len(done_s)} / {vehicles}", failed, times]
    cells += [f"{up.bytes / 1e3:.0f}", repeated, waits]
    return "| " + " | ".join(map(str, cells)) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, nargs="*", default=[1, 8, 16])
    parser.add_argument("--loss", type=float, nargs="*", default=[0.0, 0.1, 0.2])
    parser.add_argument("--telemetry", type=float, default=0.5, help="part of the way down that is taken")
    arguments = parser.parse_args()
    heads = ["vehicles", "loss", "flown", "failed", "s, first / half / all", "kB up", "repeated", "waits, s"]
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    for vehicles in arguments.vehicles:
        for loss in arguments.loss:
            print(fly(vehicles, loss, arguments.telemetry), flush=True)


if __name__ == "__main__":
    main()
