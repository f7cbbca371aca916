"""Supervision of the bridge process on this machine: started, watched, started again, taken over, ended.

A bridge outlives a command that is killed, for the time of a failover. A command that is started again in
that time with the same mission file takes the bridge over: the vehicles hear no gap in the heartbeats.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import IO, Final

import msgspec

from gcs.errors import LinkError
from gcs.io.cluster.bridge_settings import BridgeSettings
from gcs.io.zenoh.discovery import is_running
from gcs.model import NoticeCode, NoticeContent
from gcs.service.bridge_process import BridgeStarted, remove_socket
from gcs.service.child_process import how_ended

_ARGUMENTS: Final = (sys.executable, "-P", "-m", "gcs.service.bridge_process")
_START_S: Final = 20.0
_END_S: Final = 3.0
_FIRST_WAIT_S: Final = 0.1
_MAX_WAIT_S: Final = 5.0
_STEADY_S: Final = 60.0
"""A bridge that ran for so long is started again at once."""
_MAX_TEXT: Final = 200


class Running(msgspec.Struct, frozen=True, kw_only=True):
    """The file of a running bridge."""

    pid: int
    command_pid: int
    settings: BridgeSettings
    started: BridgeStarted


class BridgeProcess:
    """A bridge that this process has started, or taken over.

    Parameters
    ----------
    settings : BridgeSettings
        Its settings.
    file : Path
        Where a running bridge is noted for the next command.
    """

    def __init__(self, settings: BridgeSettings, file: Path) -> None:
        self.settings = settings
        self.started = BridgeStarted()
        self._file = file
        self._process: subprocess.Popen[bytes] | None = None
        self._pid = 0
        """Of a bridge that was taken over; else 0."""
        self._is_watched = False
        """True for the bridge of another command, as long as that looks after it."""
        self._last_line = ""
        """Of its error output."""
        self._errors = threading.Thread()
        """Reads it."""
        self._began_s = self._due_s = 0.0
        self._wait_s = _FIRST_WAIT_S

    def begin(self) -> None:
        """Take over a running bridge with these settings, or start one and wait for it.

        Raises
        ------
        LinkError
            An endpoint cannot be opened, or the bridge does not start.
        """
        running = self._without_command()
        if running is not None and _comparable(running.settings) == _comparable(self.settings):
            self._pid = running.pid
            self.settings = running.settings
            self.started = running.started
            self._note(running.pid)
            return
        if running is not None:  # of another version of the mission file: it holds the ports
            _end_other(running.pid)
        self._start()
        reader = threading.Thread(target=self._read_answer, daemon=True)
        reader.start()
        reader.join(_START_S)
        if self.started.error or not self.started.ports:
            self.end(goes_on=False)
            link, _, problem = self.started.error.partition(": ")
            raise LinkError(link or "bridge", problem or f"did not start: {self._last_line or 'no answer'}")
        self.settings = msgspec.structs.replace(self.settings, ports=self.started.ports)

    def watch(self) -> None:
        """Watch the running bridge of another command.

        Raises
        ------
        LinkError
            There is none.
        """
        running = self._noted()
        if running is None:
            raise LinkError(
                "standby",
                "no bridge of this mission runs on this machine: start `gcs run` first, or name the bridge "
                "of another machine in links.bridges",
            )
        self._is_watched = True
        self._pid = running.pid
        self.settings = running.settings
        self.started = running.started

    def is_of_other_node(self) -> bool:
        """Return True if the bridge runs, and the node that looks after it, too."""
        running = self._noted()
        return running is not None and _is_bridge(running.pid) and is_running(running.command_pid)

    def _noted(self) -> Running | None:
        """Return the bridge that was noted last on this machine."""
        with contextlib.suppress(OSError, msgspec.DecodeError):
            return msgspec.json.decode(self._file.read_bytes(), type=Running)
        return None

    def _without_command(self) -> Running | None:
        """Return a running bridge whose command has ended."""
        running = self._noted()
        if running is not None and _is_bridge(running.pid) and not is_running(running.command_pid):
            return running
        return None

    def _note(self, pid: int) -> None:
        """Note the running bridge for the next command."""
        running = Running(pid=pid, command_pid=os.getpid(), settings=self.settings, started=self.started)
        self._file.write_bytes(msgspec.json.encode(running))

    def _start(self) -> None:
        self._began_s = time.monotonic()
        process = self._process = subprocess.Popen(  # noqa: S603  this program
            _ARGUMENTS,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        assert process.stdin is not None
        assert process.stderr is not None
        with contextlib.suppress(OSError):  # it ended at once
            process.stdin.write(msgspec.json.encode(self.settings) + b"\n")
            process.stdin.flush()
        self._errors = threading.Thread(target=self._read_errors, args=(process.stderr,), daemon=True)
        self._errors.start()

    def _read_answer(self) -> None:
        process = self._process
        assert process is not None
        assert process.stdout is not None
        line = process.stdout.readline()
        with contextlib.suppress(msgspec.DecodeError, OSError):
            self.started = msgspec.json.decode(line, type=BridgeStarted)
            if not self.started.error:
                self._note(process.pid)

    def _read_errors(self, stream: IO[bytes]) -> None:
        for line in stream:
            if text := line.decode(errors="replace").strip():
                self._last_line = text[:_MAX_TEXT]

    def poll(self) -> NoticeContent | None:
        """Start a bridge that has ended again, after a wait that grows; return the alarm of its end.

        The bridge of another command becomes that of this one.
        """
        now_s = time.monotonic()
        if self._is_watched:
            self._is_watched = False
            self._take_noted()
        if self._due_s:
            if now_s >= self._due_s:
                self._due_s = 0.0
                self._start_again()
            return None
        ended = self._end()
        if ended is None:
            return None
        if now_s - self._began_s > _STEADY_S:
            self._wait_s = _FIRST_WAIT_S
        self._due_s = now_s + self._wait_s
        self._wait_s = min(2.0 * self._wait_s, _MAX_WAIT_S)
        self._pid = 0
        return NoticeCode.BRIDGE_ENDED, {"cause": ended}

    def _start_again(self) -> None:
        if self._take_noted():  # the command that was replaced has started one
            return
        self._start()
        threading.Thread(target=self._read_answer, daemon=True).start()

    def _take_noted(self) -> bool:
        """Take over the bridge that runs; return False if there is none."""
        running = self._noted()
        if running is None or not _is_bridge(running.pid):
            return False
        self._process = None
        self._pid = running.pid
        self._note(running.pid)
        return True

    def _end(self) -> str | None:
        """Return how the bridge ended; None while it runs."""
        if self._process is None:
            return None if _is_bridge(self._pid) else "its process is gone"
        code = self._process.poll()
        if code is None:
            return None
        if code < 0:
            return how_ended(code)
        return self.started.error or self._last_line or how_ended(code)

    def end(self, *, goes_on: bool) -> None:
        """Wait for the end of the bridge, which command has told it; kill one that does not end.

        After an error, and when another command has the lease, it goes on as after a kill.
        """
        if goes_on:
            if self._process is not None and self._process.stdin is not None:
                self._process.stdin.close()
            return
        self._file.unlink(missing_ok=True)
        process = self._process
        if process is None:
            return  # it ends by itself, and is of no concern to the start of another one
        assert process.stdin is not None
        with contextlib.suppress(OSError):
            process.stdin.close()
        self._errors.join(_END_S)  # until the process has closed its output
        if process.poll() is None:
            process.kill()
        process.wait()
        remove_socket(self.settings.zenoh)
        with contextlib.suppress(OSError):
            Path(self.settings.zenoh.partition("/")[2]).parent.rmdir()


def _comparable(settings: BridgeSettings) -> BridgeSettings:
    """Return settings without what differs between two starts."""
    return msgspec.structs.replace(settings, zenoh="", ports={}, frames="")


def _is_bridge(pid: int) -> bool:
    """Return True if a process is a bridge: another program may have its number by now."""
    try:
        return b"gcs.service.bridge_process" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except FileNotFoundError:
        return sys.platform != "linux" and pid > 0 and is_running(pid)


def _end_other(pid: int) -> None:
    """End a bridge of other settings, and wait until it has released its ports."""
    with contextlib.suppress(OSError):
        os.kill(pid, signal.SIGTERM)
    until_s = time.monotonic() + _END_S
    while _is_bridge(pid) and time.monotonic() < until_s:
        time.sleep(0.05)
