"""What the console costs the service, and how many frames a second a browser draws.

- ``--pages 0 1 100``: CPU time of the service and of the console of `gcs demo swarm-50` with so many pages
  that read all messages, one of them with the details of a vehicle, the longest time that a tick waited, and
  the longest time between two heartbeats at any vehicle. This needs the right to read all UDP datagrams of
  the machine (CAP_NET_RAW).
- ``--frames``: frames a second of Chromium with software rendering while the map is dragged, with 1,000
  tracks and 5,000 detections a second. The server is in a process of its own.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import re
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import psutil
from websockets.sync.client import connect

SECONDS = 20.0
SO_TIMESTAMPNS = 35
TRACKS, DETECTIONS_PER_S, SCANS_PER_S = 1000, 5000, 10
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
]


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def read_all(url: str, ends: threading.Event, lags_s: list[float], counts: list[int]) -> None:
    with connect(url, compression=None, proxy=None, max_size=None) as page:
        while not ends.is_set():
            with contextlib.suppress(TimeoutError):
                message = page.recv(timeout=1.0)
                counts.append(len(message))
                if b'"head"' in message:
                    lags_s.append(json.loads(message)["head"]["service"]["lag_s"])


def read_details(url: str, ends: threading.Event) -> None:
    while not ends.wait(1.0):
        urllib.request.urlopen(f"{url}/api/vehicles/1").close()


def heartbeats(payload: bytes) -> bool:
    """Return True if a datagram has a HEARTBEAT (MAVLink 2)."""
    at = 0
    while at + 12 <= len(payload) and payload[at] == 0xFD:
        if payload[at + 7 : at + 10] == b"\0\0\0":
            return True
        at += 12 + payload[at + 1] + (13 if payload[at + 2] & 1 else 0)
    return False


def watch_heartbeats(port: int, ends: threading.Event, heard_s: dict[int, list[float]]) -> None:
    """Note when the kernel delivered each heartbeat of the service, by the port of the vehicle."""
    with socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_UDP) as wire:
        wire.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 24)
        wire.settimeout(0.5)
        while not ends.is_set():
            with contextlib.suppress(TimeoutError):
                packet, ((_, _, stamp), *_), _, _ = wire.recvmsg(2048, 64)
                udp = 4 * (packet[0] & 15)
                sender, receiver = struct.unpack_from("!HH", packet, udp)
                if sender == port and heartbeats(packet[udp + 8 :]):
                    seconds, nanoseconds = struct.unpack("qq", stamp)
                    heard_s.setdefault(receiver, []).append(seconds + 1e-9 * nanoseconds)


@contextmanager
def pages(address: str, count: int, lags_s: list[float], sizes: list[int]) -> Iterator[None]:
    ends, url = threading.Event(), f"ws://{address}/feed"
    threads = [threading.Thread(target=read_all, args=(url, ends, lags_s, sizes)) for _ in range(count)]
    if count:
        threads.append(threading.Thread(target=read_details, args=(f"http://{address}", ends)))
    for thread in threads:
        thread.start()
    yield
    ends.set()
    for thread in threads:
        thread.join()


def cpu_s(processes: list[psutil.Process]) -> np.ndarray:
    return np.array([sum(one.cpu_times()[:2]) for one in processes])


def cpu_of_pages(counts: list[int]) -> None:
    port, folder = free_port(), Path(tempfile.mkdtemp())
    command = [sys.executable, "-P", "-m", "gcs", "demo", "swarm-50", "--headless", "--pack", "25"]
    command += ["--out", str(folder / "run"), "--console", f"127.0.0.1:{port}"]
    with (folder / "log").open("w") as log, subprocess.Popen(command, stdout=log, stderr=log) as demo:
        until_s = time.monotonic() + 200.0
        while "plan: first plan" not in (folder / "log").read_text() and time.monotonic() < until_s:
            time.sleep(0.5)
        service = psutil.Process(demo.pid)
        parts = [service, *(one for one in service.children() if "console" in one.cmdline())]
        listens = re.search(r"UDP port (\d+)", (folder / "log").read_text())
        assert listens is not None
        ends, heard_s = threading.Event(), dict[int, list[float]]()
        wire = threading.Thread(target=watch_heartbeats, args=(int(listens[1]), ends, heard_s))
        wire.start()
        for count in counts:
            lags_s: list[float] = [0.0]
            sizes: list[int] = []
            heard_s.clear()
            with pages(f"127.0.0.1:{port}", count, lags_s, sizes):
                time.sleep(2.0)
                sizes.clear()
                before, began_s = cpu_s(parts), time.monotonic()
                time.sleep(SECONDS)
                percents = 100.0 * (cpu_s(parts) - before) / (time.monotonic() - began_s)
                gap_s = max(float(np.diff(times).max()) for times in heard_s.values())
                vehicles = len(heard_s)
            each = max(1, count)
            print(
                f"{count:4d} pages: service {percents[0]:.1f} %, console {percents[1:].sum():.1f} % "
                f"of a core, longest wait of a tick {max(lags_s):.2f} s, "
                f"longest time between heartbeats at {vehicles} vehicles {gap_s:.2f} s, "
                f"{len(sizes) / each / SECONDS:.1f} messages and {sum(sizes) / each / SECONDS / 1e3:.0f} kB "
                "a second for each"
            )
        ends.set()
        wire.join()
        demo.terminate()
    shutil.rmtree(folder)


async def serve(port: int) -> None:
    from gcs.config import load
    from gcs.console.engine.captures import mission_info, obstacle_map
    from gcs.console.server import ConsoleServer
    from gcs.console.source import Source
    from gcs.console.view.capture import Capture
    from gcs.console.view.feed import Feed
    from gcs.console.view.news import News, NewsRequest
    from gcs.console.view.page_records import RunInfo
    from gcs.console.web.console_access import Access
    from gcs.core.airspace.obstacle_map import mission_grid
    from gcs.mavlink.fleet.telemetry_table import new_table
    from gcs.model import NS_PER_S, Picture, Scan, Sensor, SwarmStatus, TargetRecord, Tick, Track

    rng, config = np.random.default_rng(1), load("swarm-50")
    places = rng.uniform(0.0, 6000.0, (TRACKS, 2))
    grid = mission_grid(config, 1)
    shown_map = obstacle_map(grid, grid)
    sensor = Sensor("radar", 0.9, 1e-6, np.eye(2), (0.0, 0.0, 6000.0, 6000.0))

    def take(t_ns: int) -> Capture:
        targets = tuple(
            TargetRecord((0, n), 0.9, tuple(p), 1.0, (), ()) for n, p in enumerate(places.round(1).tolist())
        )
        status = SwarmStatus(t_ns, "", (), targets, (), None, False)
        return Capture(t_ns, status, (), None, shown_map, (), new_table(0))

    async def detail(_vehicle: int, _verified: tuple[int, int]) -> None:
        return None

    info = mission_info(config, RunInfo())
    feed = Feed(info, take, lambda: ())

    loop = asyncio.get_running_loop()

    async def on_loop(request: NewsRequest) -> News:
        return feed.pull(request)

    async def pull(request: NewsRequest) -> News:
        return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(on_loop(request), loop))

    ConsoleServer(Source(info, pull, detail), Access(port=port))
    t_ns = NS_PER_S
    while True:
        await asyncio.sleep(1.0 / SCANS_PER_S)
        t_ns += NS_PER_S // SCANS_PER_S
        places += rng.normal(0.0, 1.0, places.shape)
        cov = np.diag([25.0, 100.0, 1.0, 1.0])
        tracks = tuple(Track((0, n), np.array([*p, 1.0, 0.0]), cov, 0.9, True) for n, p in enumerate(places))
        z = rng.uniform(0.0, 6000.0, (DETECTIONS_PER_S // SCANS_PER_S, 2))
        feed.event(Scan(t_ns, t_ns, sensor, z))
        feed.effect(t_ns, Picture(t_ns, t_ns, "targets", tracks, np.ones(1)))
        feed.event(Tick(t_ns))


def frames() -> None:
    from playwright.sync_api import sync_playwright

    port = free_port()
    with subprocess.Popen([sys.executable, __file__, "--serve", str(port)]) as server:
        until_s = time.monotonic() + 30.0
        while time.monotonic() < until_s:
            with contextlib.suppress(OSError):
                urllib.request.urlopen(f"http://127.0.0.1:{port}/").close()
                break
            time.sleep(0.2)
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
            page = browser.new_page(viewport={"width": 1400, "height": 900})
            began_s = time.monotonic()
            page.goto(f"http://127.0.0.1:{port}/")
            page.locator("#targets tbody tr").first.wait_for()
            print(f"first picture after {time.monotonic() - began_s:.2f} s")
            time.sleep(5.0)  # detections of some seconds
            page.evaluate(
                "window.frameTimes = []; const f = (t) => { frameTimes.push(t); requestAnimationFrame(f); };"
                "requestAnimationFrame(f)"
            )
            box = page.locator("#map canvas").bounding_box()
            assert box is not None
            x, y = box["x"] + 300.0, box["y"] + 300.0
            page.mouse.move(x, y)
            page.mouse.down()
            until_s, step = time.monotonic() + 10.0, 0
            while time.monotonic() < until_s:
                step += 1
                page.mouse.move(x + 60.0 * np.cos(0.1 * step), y + 60.0 * np.sin(0.1 * step))
            times = np.array(page.evaluate("frameTimes"))
            gaps = np.diff(times)
            print(
                f"{1e3 / gaps.mean():.0f} frames a second; a frame takes {np.median(gaps):.0f} ms (median), "
                f"{np.percentile(gaps, 95):.0f} ms (95 %), {gaps.max():.0f} ms at most"
            )
            browser.close()
        server.terminate()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pages", type=int, nargs="*", default=[])
    parser.add_argument("--frames", action="store_true")
    parser.add_argument("--serve", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        asyncio.run(serve(arguments.serve))
    if arguments.frames:
        frames()
    if arguments.pages:
        cpu_of_pages(arguments.pages)
