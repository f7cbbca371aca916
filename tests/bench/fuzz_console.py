"""Hostile requests to the console of a flying service; what a vehicle hears of the service meanwhile.

``python tests/bench/fuzz_console.py [--minutes 60] [--seed 1] [--threads 8] [--kinds LIST] [--out FILE]``.
Runs `gcs run` with four simulated vehicles, each a real socket. A tap between them and the service measures
the times between the service's heartbeats at each vehicle. Meanwhile threads of another process send to every
route of the console, and to its WebSocket: wrong methods, long and hostile texts, numbers and JSON, broken
requests and frames, connections that wait, that do not read, that send without end, and pages by the hundred.
An operator asks for the status once a second, and opens a page, beside them. Prints the result as JSON.

``--each`` runs each of `EACH` alone for that time, and prints a table: clients that send a byte now and
then, 1,000 connections that send nothing, 200 pages that do nothing, cookies and addresses of a megabyte, a
console that is stopped (SIGSTOP).
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import json
import os
import random
import re
import selectors
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.table import Table

HEARTBEAT: Final = b"\x00\x00\x00"
"""Number of the message, in a frame of MAVLink 2."""
STATION: Final = 255
ROUTES: Final = (
    "/", "/login", "/alarms", "/feed", "/api/status", "/api/plan", "/api/vehicles/1", "/api/vehicles/x",
    "/api/orders", "/api/orders/x", "/api/preflight", "/api/replay", "/api/marks", "/api/charts",
    "/api/openapi.json", "/tiles/1/2/3", "/metrics", "/page.js", "/base.css", "/icon.svg", "/b/feed",
    "/compare.html", "/preflight.html", "/nothing",
)  # fmt: skip
METHODS: Final = (
    "GET",
    "GET",
    "GET",
    "GET",
    "GET",
    "POST",
    "POST",
    "POST",
    "HEAD",
    "PUT",
    "DELETE",
    "OPTIONS",
    "TRACE",
    "X" * 300,
)
PIECES: Final = (
    "a", "agent 3: ", "no scan of sensor  was processed for  s,  were refused: ",
    "%", "%41", "%zz", "%00", "+", "&", "=", "&a=", ";",
    "/", "..", "\\", '"', "'", "<b>", "ü", "\x7f", "0", "9", "-", "e", "nan", "inf", "lost", " for ", " s",
)  # fmt: skip
EACH: Final = ("slow_clients", "half_open", "idle_pages", "megabytes", "stop_console")
ORDERS: Final = ("hold", "resume", "plan", "status", "confirm", "no-fly-zone", "priority", "ignore", "unpin")
"""Those that keep the vehicles in the air."""
VALUES: Final[tuple[Any, ...]] = (
    None, True, 0, -1, 1, 3, 2**53, 10**30, 1e308, "", "x", "T0.1", "all", "\x00", "ü" * 50, [], [1], [1, 2],
    {}, {"name": "z", "circle": [500, 500, 5]}, {"name": "z"}, "9" * 5000, [[[[[[]]]]]],
)  # fmt: skip
FIELDS: Final = ("order_id", "vehicles", "plan_id", "no_fly_zone", "target", "priority", "origin", "extra")


class Attacker:
    """Sends hostile requests, from a seed."""

    def __init__(self, port: int, seed: int, kinds: str) -> None:
        self.address = ("127.0.0.1", port)
        self.ends = threading.Event()
        self.random = random.Random(seed)
        self.sent: Counter[str] = Counter()
        self.waiting: list[socket.socket] = []
        self.most_waiting = 60
        self.kinds: tuple[Callable[[], None], ...] = (
            self.request, self.request, self.request, self.request, self.garbage, self.frames, self.pages,
            self.wait, self.never_read, self.flood, self.pipeline, self.hurry,
        )  # fmt: skip
        self.kinds = tuple(kind for kind in self.kinds if not kinds or kind.__name__ in kinds)
        if kinds in EACH:
            self.kinds = (getattr(self, kinds),)
            self.most_waiting = 1000

    def attack(self) -> None:
        """Send one thing."""
        kind = self.random.choice(self.kinds)
        self.sent[kind.__name__] += 1
        try:
            kind()
        except (OSError, ValueError, IndexError):  # refused, closed, cut off: as it should be
            self.sent["refused"] += 1
        while len(self.waiting) > self.most_waiting:
            self.waiting.pop(self.random.randrange(self.most_waiting)).close()

    def text(self, length: int) -> str:
        """Return a hostile text of about a length."""
        rng, found = self.random, ""
        piece = rng.choice(PIECES) if rng.random() < 0.5 else None
        while len(found) < length:
            found += piece or rng.choice(PIECES)
        return found

    def length(self) -> int:
        return self.random.choice((0, 1, 10, 300, 4000, 8100, 9000, 30_000, 70_000))

    def path(self) -> str:
        rng, path = self.random, self.random.choice(ROUTES)
        chance = rng.random()
        if chance < 0.2:
            path = "/alarms?about=" + self.text(self.length())
        elif chance < 0.3:
            path = "/tiles/" + "/".join(rng.choice(("1", "-1", "9" * 5000, "x", "²")) for _ in range(3))
        elif chance < 0.5:
            path += "?" + rng.choice(("after=", "wait_s=", "a&", "&&&&", "about=")) + self.text(self.length())
        elif chance < 0.6:
            path += self.text(self.length())
        return path.encode("ascii", "replace").decode().replace(" ", "%20")

    def headers(self) -> list[str]:
        rng = self.random
        found = [f"Host: 127.0.0.1:{self.address[1]}" if rng.random() < 0.97 else f"Host: {self.text(30)}"]
        hostile = (
            "Content-Type: application/json", "Sec-Fetch-Site: cross-site", "Origin: http://evil.example",
            f"Cookie: swarm_gcs_token={self.text(self.length())}", 'Cookie: "' + "\\1" * 4000,
            "Cookie: " + "a=b;" * 2000, "Authorization: Bearer x", "Authorization: " + self.text(500),
            "X-Forwarded-For: 10.0.0.1", "Transfer-Encoding: chunked", "Expect: 100-continue",
            "Accept-Encoding: " + ", " * 4000, "Connection: Upgrade\r\nUpgrade: websocket",
            "\r\n".join(["X: y"] * 1000), " folded", "Connection: close",
        )  # fmt: skip
        return [
            *found,
            *(line for line in hostile if rng.random() < (0.8 if line.startswith("Content-T") else 0.03)),
        ]

    def body(self) -> bytes:
        rng = self.random
        choice = rng.random()
        if choice < 0.1:
            return b"[" * self.length()
        if choice < 0.2:
            return b'{"a":' * self.length()
        if choice < 0.3:
            return rng.randbytes(self.length())
        order = {"action": rng.choice(ORDERS)}
        if choice < 0.6:
            order["vehicles"] = "all"
        for name in FIELDS:
            if rng.random() < 0.3:
                order[name] = rng.choice(VALUES)
        return json.dumps(order).encode()

    def message(self) -> bytes:
        rng, body = self.random, b""
        lines = [f"{rng.choice(METHODS)} {self.path()} HTTP/1.{rng.choice('0111')}", *self.headers()]
        if rng.random() < 0.5:
            body = self.body()
            lines.append(f"Content-Length: {rng.choice((len(body), len(body), len(body), 0, 10**9))}")
        return "\r\n".join([*lines, "", ""]).encode("latin-1", "replace") + body

    def connect(self, timeout_s: float = 3.0) -> socket.socket:
        return socket.create_connection(self.address, timeout_s)

    def request(self) -> None:
        with self.connect(1.5) as link:
            link.sendall(self.message())
            self.sent[link.recv(4096)[9:12].decode("latin-1") or "closed"] += 1

    def pipeline(self) -> None:
        with self.connect(1.5) as link:
            link.sendall(b"".join(self.message() for _ in range(20)))
            link.recv(4096)

    def hurry(self) -> None:
        """Ask what is allowed, as fast as the answers come."""
        with self.connect() as link:
            path = self.random.choice(("/", "/api/openapi.json", "/metrics", "/alarms", "/page.js"))
            message = f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{self.address[1]}\r\n\r\n".encode()
            for _ in range(300):
                if self.ends.is_set():  # the console serves a connection in a hurry slowly
                    return
                link.sendall(message)
                link.recv(65536)

    def garbage(self) -> None:
        with self.connect(0.3) as link:
            link.sendall(self.random.randbytes(self.length()) if self.random.random() < 0.5 else b"GET ")
            link.recv(100)

    def wait(self) -> None:
        """Leave a request half sent, for as long as the server allows it."""
        link = self.connect()
        link.sendall(self.message()[: self.random.randrange(200)])
        self.waiting.append(link)

    def never_read(self) -> None:
        link = socket.socket()
        self.waiting.append(link)
        link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        link.settimeout(1.0)
        link.connect(self.address)
        link.sendall(f"GET /page.js HTTP/1.1\r\nHost: 127.0.0.1:{self.address[1]}\r\n\r\n".encode())

    def open_page(self) -> socket.socket:
        link = self.connect(1.0)
        key = base64.b64encode(self.random.randbytes(16)).decode()
        link.sendall(
            f"GET /feed HTTP/1.1\r\nHost: 127.0.0.1:{self.address[1]}\r\nConnection: Upgrade\r\n"
            f"Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n\r\n".encode()
        )
        return link

    def pages(self) -> None:
        """Open pages that do nothing."""
        for _ in range(10):
            self.waiting.append(self.open_page())

    def frames(self) -> None:
        rng = self.random
        with self.open_page() as link:
            link.recv(4096)
            for _ in range(50):
                data = rng.randbytes(rng.choice((0, 1, 125, 126, 2000, 70_000)))
                length = len(data) if rng.random() < 0.9 else rng.choice((0, 2**62))
                link.sendall(
                    _frame(rng.choice((0x01, 0x81, 0x82, 0x80, 0x00, 0x88, 0x89, 0x8A, 0xFF)), data, length)
                )

    def flood(self) -> None:
        """Send pings, or content, without end and without reading."""
        with self.open_page() as link:
            until_s = time.monotonic() + 2.0
            while time.monotonic() < until_s:
                link.sendall(_frame(0x89, b"x" * 125, 125) * 100)

    def keep_waiting(self, count: int, opens: Callable[[], socket.socket]) -> None:
        """Replace connections that the console has closed, up to a number of them."""
        self.waiting = [link for link in self.waiting if not _is_closed(link)]
        for _ in range(min(50, count - len(self.waiting))):
            self.waiting.append(opens())
            self.sent["opened"] += 1
        self.sent["open at most"] = max(self.sent["open at most"], len(self.waiting))
        time.sleep(0.1)

    def begin_connection(self) -> socket.socket:
        """Connect without waiting: the console may be slow to accept."""
        link = socket.socket()
        link.setblocking(False)
        link.connect_ex(self.address)
        return link

    def half_open(self) -> None:
        """Keep a thousand connections that send nothing."""
        self.keep_waiting(1000, self.begin_connection)

    def idle_pages(self) -> None:
        """Keep 200 pages that do nothing."""
        self.keep_waiting(200, self.open_page)

    def slow_clients(self) -> None:
        """Keep 200 requests that go on by a byte now and then."""
        self.keep_waiting(200, self.begin_connection)
        for link in self.waiting:
            with contextlib.suppress(OSError):
                link.send(self.random.choice((b"GET / HTTP/1.1\r\nX: ", b"y", b"y", b"\r\nZ: z")))

    def megabytes(self) -> None:
        """Send a cookie, or an address, of a megabyte."""
        text = (self.text(1_000).encode("ascii", "replace") * 1_000).replace(b" ", b"+")
        head = f"Host: 127.0.0.1:{self.address[1]}".encode()
        request = b"GET /%s HTTP/1.1\r\n%s\r\n\r\n" % (text, head)
        if self.random.random() < 0.5:
            request = b"GET / HTTP/1.1\r\n%s\r\nCookie: %s\r\n\r\n" % (head, text)
        with self.connect(3.0) as link:
            link.sendall(request)
            self.sent[link.recv(4096)[9:12].decode("latin-1") or "closed"] += 1

    def stop_console(self) -> None:
        """Do nothing: the console is stopped by `fuzz`."""
        time.sleep(0.5)


def _is_closed(link: socket.socket) -> bool:
    """Return True if the other side has closed; what it sent before is dropped."""
    try:
        return not link.recv(65_536, socket.MSG_DONTWAIT)
    except BlockingIOError:
        return False
    except OSError:
        return True


def _frame(head: int, data: bytes, length: int) -> bytes:
    if length < 126:
        size = bytes((0x80 | length,))
    elif length < 65536:
        size = struct.pack(">BH", 0xFE, length)
    else:
        size = struct.pack(">BQ", 0xFF, length)
    return bytes((head,)) + size + bytes(4) + data


def attack(port: int, seed: int, threads: int, kinds: str) -> None:
    """Attack until the input ends; print the counts."""
    attackers = [Attacker(port, seed * 1000 + number, kinds) for number in range(threads)]

    def run(one: Attacker) -> None:
        while not one.ends.is_set():
            one.attack()

    started = [threading.Thread(target=run, args=(one,), daemon=True) for one in attackers]
    for thread in started:
        thread.start()
    sys.stdin.read()
    for one in attackers:
        one.ends.set()
    for thread in started:
        thread.join(5.0)
    print(json.dumps(sum((one.sent for one in attackers), Counter())))


def tap(port: int, service: int) -> None:
    """Pass datagrams between vehicles and a service; print, at the end, when each heard a heartbeat."""
    down = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    down.bind(("127.0.0.1", port))
    ups: dict[Any, socket.socket] = {}
    heard: dict[str, list[float]] = {}
    waiting = selectors.DefaultSelector()
    waiting.register(down, selectors.EVENT_READ)
    waiting.register(sys.stdin, selectors.EVENT_READ)
    while True:
        for key, _ in waiting.select():
            if key.fileobj is sys.stdin:
                print(json.dumps(heard))
                return
            if key.fileobj is down:
                data, vehicle = down.recvfrom(65536)
                if vehicle not in ups:
                    ups[vehicle] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                    ups[vehicle].connect(("127.0.0.1", service))
                    waiting.register(ups[vehicle], selectors.EVENT_READ, vehicle)
                _send(ups[vehicle], data)
                continue
            try:
                data = key.fileobj.recv(65536)
            except ConnectionRefusedError:
                continue
            if _has_heartbeat(data):
                heard.setdefault(str(key.data[1]), []).append(time.monotonic())
            down.sendto(data, key.data)


def _has_heartbeat(data: bytes) -> bool:
    """Return True for a datagram with a heartbeat of the station: a frame of MAVLink 2."""
    at = data.find(b"\xfd")
    while 0 <= at < len(data) - 10:
        if data[at + 5] == STATION and data[at + 7 : at + 10] == HEARTBEAT:
            return True
        at = data.find(b"\xfd", at + 1)
    return False


def _send(link: socket.socket, data: bytes) -> None:
    with contextlib.suppress(ConnectionRefusedError):  # the service is not there yet
        link.send(data)


class Operator:
    """Asks for the status once a second, and opens a page."""

    def __init__(self, url: str) -> None:
        self.url, self.waits_s, self.failures = url, list[float](), list[str]()
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        from websockets.sync.client import connect

        while not self._ends.wait(1.0):
            begun_s = time.monotonic()
            try:
                with urllib.request.urlopen(self.url + "api/status", timeout=10.0) as reply:
                    reply.read()
                with connect(self.url.replace("http", "ws") + "feed", compression=None, proxy=None) as page:
                    page.send("used")
                    page.recv(timeout=10.0)
                    page.recv(timeout=10.0)
            except Exception as error:  # counted
                self.failures.append(f"{type(error).__name__}: {error}")
            self.waits_s.append(time.monotonic() - begun_s)

    def end(self) -> None:
        self._ends.set()
        self._thread.join(15.0)


def start(*arguments: Any) -> subprocess.Popen[str]:
    """Start this file as the tap or the attacker."""
    command = [sys.executable, __file__, *map(str, arguments)]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def result_of(process: subprocess.Popen[str]) -> Any:
    """End a process; return what it prints."""
    return json.loads(process.communicate("", 20.0)[0])


def fuzz(
    folder: Path, seconds: float, *options: Any, calm_s: float = 5.0, stops_console: bool = False
) -> dict[str, Any]:
    """Attack a flying service for a time, after a calm time; return what was measured.

    Options are those of this program for the attack.
    """
    from helpers.processes import Run, console_of, free_port, waited_ns

    relay = free_port()
    run = Run(folder, relay=relay)
    taps = start("--tap", relay, run.port)
    try:
        address = f"127.0.0.1:{free_port()}"
        service = run.serve("flown", {"PYTHONUNBUFFERED": "1"}, ("--console", address))
        said = run.until("flown", lambda text: text.count("verified by read-back") >= 4, 120.0)
        url = re.search(r"console: (http\S+)", said)[1]  # type: ignore[index]
        time.sleep(calm_s)
        begun_s, lines = time.monotonic(), len((folder / "flown.log").read_text().splitlines())
        attacker = start("--attack", url.rstrip("/").rpartition(":")[2], *options)
        operator, most, console = Operator(url), 0, console_of(service.pid).pid
        waited_before_ns = waited_ns(service) + waited_ns(taps)
        if stops_console:
            os.kill(console, signal.SIGSTOP)
        while time.monotonic() - begun_s < seconds and service.poll() is None:
            time.sleep(0.2)
            most = max(most, sum(1 for _ in Path(f"/proc/{console}/fd").iterdir()))
        ended_s, waited_after_ns = time.monotonic(), waited_ns(service) + waited_ns(taps)
        if stops_console:
            os.kill(console, signal.SIGCONT)
        operator.end()
        sent, alive = result_of(attacker), service.poll() is None
        memory_mb = {name: _peak_mb(pid) for name, pid in (("service", service.pid), ("console", console))}
        heard = result_of(taps)
    finally:
        taps.kill()
        run.end()
    text = (folder / "flown.log").read_text()
    attacked = [gap for times in heard.values() for gap in _gaps(times, begun_s, ended_s)]
    calm = [max(_gaps(times, begun_s - calm_s, begun_s)) for times in heard.values()]
    return {
        "seconds": round(ended_s - begun_s, 1),
        "sent": sent,
        "vehicles": len(heard),
        "longest_gap_s": round(max(attacked), 3),
        "waited_for_processor_s": round((waited_after_ns - waited_before_ns) / 1e9, 3),
        "longest_gap_before_s": round(max(calm), 3),
        "gaps_above_0.6_s": sum(gap > 0.6 for gap in attacked),
        "operator_requests": len(operator.waits_s),
        "operator_longest_wait_s": round(max(operator.waits_s, default=0.0), 2),
        "operator_failures": operator.failures[:10],
        "operator_failed": len(operator.failures),
        "service_alive": alive,
        "descriptors": most,
        "memory_mb": memory_mb,
        "lines_printed": len(text.splitlines()) - lines,
        "program_errors": re.findall(r".*program error.*", text)[:10],
    }  # fmt: skip


def _peak_mb(pid: int) -> int:
    found = re.search(r"VmHWM:\s+(\d+)", Path(f"/proc/{pid}/status").read_text())
    return 0 if found is None else int(found[1]) // 1000


def _gaps(times: list[float], begin_s: float, end_s: float) -> list[float]:
    within = [begin_s, *(one for one in times if begin_s < one < end_s), end_s]
    return [later - earlier for earlier, later in pairwise(within)]


def table_of(results: dict[str, dict[str, Any]]) -> Table:
    """Return what vehicles and the operator noticed of each attack."""
    table = Table("attack", "longest gap, s", "before it, s", "operator waits, s", "failures", "sent")
    for kind, one in results.items():
        failed = f"{one['operator_failed']} of {one['operator_requests']}"
        gaps = (one["longest_gap_s"], one["longest_gap_before_s"], one["operator_longest_wait_s"])
        table.add_row(kind, *map(str, gaps), failed, json.dumps(one["sent"]))
    return table


def main() -> None:
    """Run as the head of this file says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, default=8)
    parser.add_argument("--kinds", default="", help="such as: request,frames; all if empty")
    parser.add_argument("--each", action="store_true", help="each of `EACH` alone")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--tap", type=int, nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--attack", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.tap:
        tap(*arguments.tap)
        return
    if arguments.attack:
        attack(arguments.attack, arguments.seed, arguments.threads, arguments.kinds)
        return
    results = {}
    for kind in EACH if arguments.each else (arguments.kinds,):
        threads = 1 if arguments.each else arguments.threads
        with tempfile.TemporaryDirectory() as folder:
            os.environ["XDG_RUNTIME_DIR"] = folder
            options = ("--seed", arguments.seed, "--threads", threads, "--kinds", kind)
            stops = kind == "stop_console"
            results[kind] = fuzz(Path(folder), arguments.minutes * 60.0, *options, stops_console=stops)
    text = json.dumps(results if arguments.each else results[arguments.kinds], indent=2)
    if arguments.each:
        Console(width=160).print(table_of(results))
    else:
        print(text)
    if arguments.out is not None:
        arguments.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
