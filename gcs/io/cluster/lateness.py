"""Lateness of messages between two processes whose clocks differ, and the greatest that is accepted.

The sender puts its monotonic time into each message. The least difference to the receiver's monotonic time
stands for a message that was not delayed; what a message has more is its delay. The least difference follows
a slow drift of the clocks.

Command does not take from a bridge what is late: a heartbeat of five seconds ago does not show the mode of a
vehicle. (In the other direction the permit of the lease ends.)
"""

from __future__ import annotations

from typing import Final

from gcs.model import NS_PER_S

MAX_LATE_NS: Final = NS_PER_S
"""What is later is not taken."""
_DRIFT: Final = 2e-4
"""Clocks of computers differ by less."""


class Lateness:
    """Delays of the messages of one sender."""

    def __init__(self) -> None:
        self._sender = 0
        self._least_ns = 0
        self._now_ns = 0

    def of(self, sender: int, sent_ns: int, now_ns: int) -> int:
        """Return by how much a message is late, in nanoseconds.

        Parameters
        ----------
        sender : int
            A number that changes when the sender starts again: its clock may be another one then.
        sent_ns, now_ns : int
            Monotonic times of the sender when it was sent, and of the receiver now.
        """
        difference_ns = now_ns - sent_ns
        if sender != self._sender:
            self._sender = sender
            self._least_ns = difference_ns
        else:
            drift_ns = int(_DRIFT * (now_ns - self._now_ns))
            self._least_ns = min(self._least_ns + drift_ns, difference_ns)
        self._now_ns = now_ns
        return difference_ns - self._least_ns
