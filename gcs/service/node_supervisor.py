"""Supervision of a node of a mission with a standby: one that ends by a fault is started again.

`supervise_node` forks: the parent waits, the child is the node. A node that is killed, fails or was replaced
is started again after a pause, in which the other node takes over, and then follows that one. A node that
ends in order, or whose first start fails by a mistake of the user, ends its supervisor with its exit code.

The node is a process group of its own: the supervisor passes signals of the terminal on, each once. It ends
when its supervisor ends, however that happens, as if it were killed. systemd starts services again.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import FrameType
from typing import Final

from gcs.service.child_process import MAX_STARTS, STEADY_S, how_ended

FIRST_PAUSE_S: Final = 4.0
"""In which the other node, which has the newest state, takes over: a lease, or the 3 s after which it starts
a bridge again that has ended as well. Doubled with each end."""
_FINAL_CODES: Final = (0, 130)
"""Exit codes of a node that is not started again: it ended in order, or was interrupted."""
_MISTAKE: Final = 2
"""Later, an endpoint that is in use is no mistake of the user: the other node may just have opened it."""
_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_POLL_S: Final = 0.05


def is_supervised_by_system() -> bool:
    """Return True if systemd has started this process and will start it again."""
    return "NOTIFY_SOCKET" in os.environ


def supervise_node(tell: Callable[[str], None]) -> int:
    """Fork; return the number of the start, from 1, in each child.

    The parent does not return. Call it before threads are started and files are opened.

    Raises
    ------
    SystemExit
        In the parent, when the node has ended for good.
    """
    supervisor = _Supervisor()
    for number in _SIGNALS:
        signal.signal(number, supervisor.pass_on)
    start = row = 1
    while True:
        began_s = time.monotonic()
        if supervisor.fork():
            return start
        code = supervisor.wait()
        if time.monotonic() - began_s >= STEADY_S:
            row = 1
        is_final = code in _FINAL_CODES or (code == _MISTAKE and start == 1)
        if supervisor.ends or is_final or row >= MAX_STARTS:
            raise SystemExit(code if code >= 0 else 128 - code)
        pause_s = FIRST_PAUSE_S * 2.0 ** (row - 1)
        tell(f"this node ended ({how_ended(code)}) and starts again in {pause_s:g} s, as a standby")
        supervisor.sleep(pause_s)
        start += 1
        row += 1


@dataclass(slots=True)
class _Supervisor:
    node: int = 0
    """Process of the node; 0 while there is none."""
    ends: bool = False
    """True after a signal to end."""
    life: int = -1
    """Pipe whose closing ends the node."""

    def fork(self) -> bool:
        """Start a node; return True in it."""
        ends_node, self.life = os.pipe()
        node = os.fork()
        if node:
            os.close(ends_node)
            self.node = node
            return False
        os.close(self.life)
        os.setpgid(0, 0)
        signal.signal(signal.SIGTTOU, signal.SIG_IGN)  # it prints from the background
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        threading.Thread(target=_end_with, args=(ends_node,), daemon=True).start()
        return True

    def wait(self) -> int:
        """Wait for the end of the node; return its exit code, negative for a signal."""
        _, status = os.waitpid(self.node, 0)
        self.node = 0
        os.close(self.life)
        return os.waitstatus_to_exitcode(status)

    def pass_on(self, number: int, _frame: FrameType | None) -> None:
        """Pass a signal on to the node; after SIGHUP it flies on."""
        self.ends = self.ends or number != signal.SIGHUP
        if self.node:
            os.kill(self.node, number)

    def sleep(self, pause_s: float) -> None:
        """Wait; raise `SystemExit` after a signal to end."""
        until_s = time.monotonic() + pause_s
        while time.monotonic() < until_s:
            if self.ends:
                raise SystemExit(130)
            time.sleep(_POLL_S)


def _end_with(pipe: int) -> None:
    """End this process as by a kill when the supervisor has ended."""
    os.read(pipe, 1)
    os.kill(os.getpid(), signal.SIGKILL)
