"""What the console costs the service, and how many frames a second a browser draws.

- ``--pages 0 1 100``: CPU time of `gcs demo swarm-50` with so many pages that read all messages, and the
  longest time that a tick waited.
- ``--frames``: frames a second of Chromium with software rendering while the map is dragged, with 1,000
  tracks and 5,000 detections a second. The server is in a process of its own.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
from websockets.sync.client import connect

SECONDS = 20.0
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
                    lags_s.append(json.loads(message)["head"]["lag_s"])


@contextmanager
def pages(url: str, count: int, lags_s: list[float], sizes: list[int]) -> Iterator[None]:
    ends = threading.Event()
    threads = [threading.Thread(target=read_all, args=(url, ends, lags_s, sizes)) for _ in range(count)]
    for thread in threads:
        thread.start()
    yield
    ends.set()
    for thread in threads:
        thread.join()


def cpu_of_pages(counts: list[int]) -> None:
    port, folder = free_port(), Path(tempfile.mkdtemp())
    command = [sys.executable, "-m", "gcs", "demo", "swarm-50", "--headless", "--pack", "25"]
    command += ["--out", str(folder / "run"), "--console", f"127.0.0.1:{port}"]
    with (folder / "log").open("w") as log, subprocess.Popen(command, stdout=log, stderr=log) as demo:
        until_s = time.monotonic() + 200.0
        while "plan: first plan" not in (folder / "log").read_text() and time.monotonic() < until_s:
            time.sleep(0.5)
        service = psutil.Process(demo.pid)
        for count in counts:
            lags_s: list[float] = [0.0]
            sizes: list[int] = []
            with pages(f"ws://127.0.0.1:{port}/feed", count, lags_s, sizes):
                time.sleep(2.0)
                sizes.clear()
                before, began_s = sum(service.cpu_times()[:2]), time.monotonic()
                time.sleep(SECONDS)
                percent = 100.0 * (sum(service.cpu_times()[:2]) - before) / (time.monotonic() - began_s)
            each = max(1, count)
            print(
                f"{count:4d} pages: {percent:5.1f} % of a core, longest wait of a tick {max(lags_s):.2f} s, "
                f"{len(sizes) / each / SECONDS:.1f} messages and {sum(sizes) / each / SECONDS / 1e3:.0f} kB "
                "a second for each"
            )
        demo.terminate()
    shutil.rmtree(folder)


async def serve(port: int) -> None:
    from gcs.config import load
    from gcs.console import Access, ConsoleServer, Source
    from gcs.console.capture import Capture
    from gcs.core.airspace.obstacle_map import mission_grid
    from gcs.mavlink.fleet.telemetry_table import new_table
    from gcs.model import NS_PER_S, Picture, Scan, Sensor, SwarmStatus, TargetRecord, Tick, Track

    rng, config = np.random.default_rng(1), load("swarm-50")
    places = rng.uniform(0.0, 6000.0, (TRACKS, 2))
    grid, sensor = mission_grid(config, 1), Sensor("radar", 0.9, 1e-6, np.eye(2), (0.0, 0.0, 6000.0, 6000.0))

    def take(t_ns: int) -> Capture:
        targets = tuple(TargetRecord((0, n), 0.9, tuple(p), 1.0, (), ()) for n, p in enumerate(places))
        status = SwarmStatus(t_ns, "", (), targets, (), None, False)
        return Capture(t_ns, status, (), (), None, grid, (), {}, new_table(0), {}, {})

    run = SimpleNamespace(
        config=config, command=SimpleNamespace(fleet=SimpleNamespace(states=lambda: ())), sinks=[]
    )
    server = ConsoleServer(Source(run, take), Access(port=port))
    t_ns = NS_PER_S
    while True:
        await asyncio.sleep(1.0 / SCANS_PER_S)
        t_ns += NS_PER_S // SCANS_PER_S
        places += rng.normal(0.0, 1.0, places.shape)
        cov = np.diag([25.0, 100.0, 1.0, 1.0])
        tracks = tuple(Track((0, n), np.array([*p, 1.0, 0.0]), cov, 0.9, True) for n, p in enumerate(places))
        z = rng.uniform(0.0, 6000.0, (DETECTIONS_PER_S // SCANS_PER_S, 2))
        feed = server.feed
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
