"""A real `gcs run` with real simulated vehicles."""

from __future__ import annotations

import json
import os
import random
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil

from gcs.config import read_text
from gcs.config.key_overrides import override_keys
from gcs.errors import RecordingError
from gcs.io.recording.reader import read
from gcs.io.zenoh.session import free_endpoint
from gcs.model import Notice, NoticeCode
from helpers.noticed import noticed

GCS = [sys.executable, "-P", "-c", "from gcs.cli import main; main()"]


def free_port() -> int:
    """Return a UDP port that is free, and below those that the system gives to other programs meanwhile."""
    while True:
        port = random.randrange(10_000, 32_000)
        with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", port))
            return port


def console_of(service: int) -> psutil.Process:
    """Return the process of the console that a service has started, as soon as it runs."""
    deadline = time.monotonic() + 30.0
    while time.monotonic() < deadline:
        with suppress(psutil.NoSuchProcess):
            for child in psutil.Process(service).children():
                if "console" in child.cmdline():
                    return child
        time.sleep(0.05)
    raise AssertionError("no console")


class Run:
    """The simulated side, and central command as often as it is started."""

    def __init__(
        self,
        folder: Path,
        speed: float = 1.0,
        relay: int | None = None,
        observers: Sequence[str] = (),
        sitl: str = "",
        port: int | None = None,
    ) -> None:
        text, source = read_text("deterministic")
        text = override_keys(
            text, ["planning.shape=pulled"], source
        )  # routes that are not bettered in flight
        self.port = port = port or free_port()
        self.seat = free_port()
        """Of the service; vehicles send to `relay`, if given."""
        self.zenoh, self.standby = free_endpoint(), free_endpoint()
        text = text.replace('mavlink = "udpin:0.0.0.0:14550"', f'mavlink = "udpin:127.0.0.1:{port}"', 1)
        text = text.replace('zenoh = "tcp/127.0.0.1:7447"', f'zenoh = "{self.zenoh}"', 1)
        text += f'\n[[links.forward]]\nendpoint = "udpin:127.0.0.1:{self.seat}"\naccess = "full"\n'
        assert f'mavlink = "udpin:127.0.0.1:{port}"' in text
        assert self.zenoh in text
        self.folder, self.file = folder, folder / "mission.toml"
        self.file.write_text(text)
        command = [sys.executable, "-P", "-m", "sim_vehicles", "run", str(self.file), "--speed", str(speed)]
        command += [
            "--gcs",
            f"127.0.0.1:{relay or port}",
            "--zenoh",
            ",".join((self.zenoh, self.standby, *observers)),
            "--json",
            "--until-stdin-closes",
        ]
        command += ["--sitl", sitl, "--sitl-folder", str(folder / "firmware")] if sitl else ["--pack", "4"]
        self.world = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        assert self.world.stdout is not None
        started = next(e for line in self.world.stdout if (e := json.loads(line))["event"] == "started")
        self.clock = ["--clock", f"{started['epoch_ns']},{speed}"] if speed != 1.0 else []
        self.services: list[subprocess.Popen[bytes]] = []

    def serve(
        self,
        name: str,
        environment: Mapping[str, str] | None = None,
        arguments: Sequence[str] = (),
        file: Path | None = None,
        program: Sequence[str] = GCS,
    ) -> subprocess.Popen[bytes]:
        """Start a service without a console, unless `arguments` name one.

        `file` is another mission file, `program` one that stands for `gcs`.
        """
        command = [*program, "run", str(file or self.file), "--headless", "--out", str(self.folder / name)]
        command += ["--journal", str(self.folder / "journal"), "--console", "off", *self.clock, *arguments]
        with (self.folder / f"{name}.log").open("wb") as log:
            whole = {**os.environ, **(environment or {})}
            self.services.append(subprocess.Popen(command, stdout=log, stderr=log, env=whole))
        return self.services[-1]

    def until(self, name: str, wanted: Callable[[str], bool], timeout_s: float = 60.0) -> str:
        """Wait until a service has printed what is wanted; return all that it printed."""
        deadline, said = time.monotonic() + timeout_s, ""
        while time.monotonic() < deadline:
            if wanted(said := self.printed(name)):
                return said
            time.sleep(0.05)
        raise AssertionError(f"not within {timeout_s} s:\n{said}")

    def printed(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text()

    def all(self, name: str, kind: type) -> list[Any]:
        records = read(self.folder / name, only={kind})
        return [record.value for record in records if isinstance(record.value, kind)]

    def until_told(
        self, name: str, code: NoticeCode, count: int = 1, timeout_s: float = 60.0
    ) -> list[Notice]:
        """Wait until a service has recorded that many notices of a code; return them."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            with suppress(RecordingError):  # nothing is recorded yet
                if len(found := noticed(self.all(name, Notice), code)) >= count:
                    return found
            time.sleep(0.2)
        raise AssertionError(f"no {count} x {code} within {timeout_s} s:\n{self.printed(name)}")

    def end(self) -> None:
        for service in self.services:
            if service.poll() is None:
                service.kill()
            service.wait()
        assert self.world.stdin is not None
        self.world.stdin.close()
        self.world.wait(20.0)


def node_of(process: subprocess.Popen[bytes]) -> psutil.Process:
    """Return the node of a supervisor, as soon as it runs (`gcs.service.node_supervisor`)."""
    deadline = time.monotonic() + 30.0
    supervisor = psutil.Process(process.pid)
    while time.monotonic() < deadline:
        with suppress(psutil.NoSuchProcess):
            for child in supervisor.children():
                if child.cmdline() == supervisor.cmdline() and child.status() != psutil.STATUS_ZOMBIE:
                    return child
        time.sleep(0.02)
    raise AssertionError("no node")


def bridges(folder: Path) -> list[psutil.Process]:
    """Return the bridges that services of a test have started: their runtime folder is its own."""
    found = []
    for process in psutil.process_iter():
        with suppress(psutil.Error):
            is_bridge = "gcs.service.bridge_process" in process.cmdline()
            if is_bridge and process.environ().get("XDG_RUNTIME_DIR") == str(folder):
                found.append(process)
    return found


def waited_ns(process: subprocess.Popen[Any]) -> int:
    """Return how long the process' main thread was ready to run while others had the processors."""
    schedstat = Path(f"/proc/{process.pid}/schedstat")
    return int(schedstat.read_text().split()[1]) if schedstat.exists() else 0
