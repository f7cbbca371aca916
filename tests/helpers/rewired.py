"""`gcs` as a program that connects by other ways and whose wall clock can be set.

``python -c "from helpers.rewired import main; main()"`` reads two variables of the environment:
`REWIRED_PATHS`, a JSON object from an endpoint of zenoh to the one that is used in its place to connect, and
`REWIRED_CLOCK`, a file with the nanoseconds by which the wall clock was set, as text.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from gcs.io import clock
from gcs.io.zenoh.session import ZenohSession
from helpers.wall_clock import WallClock


class _SetClock(WallClock):
    def __init__(self, file: Path) -> None:
        super().__init__()
        self._file = file

    def time_ns(self) -> int:
        self.set_by_ns = int(self._file.read_text() or 0)
        return super().time_ns()


def main() -> None:
    """Run `gcs`."""
    paths: dict[str, str] = json.loads(os.environ["REWIRED_PATHS"])
    plain = ZenohSession.__init__

    def connect_by_paths(self: ZenohSession, *, connect: str | None = None, **others: Any) -> None:
        found = connect and ",".join(paths.get(one, one) for one in connect.split(","))
        plain(self, connect=found, **others)

    ZenohSession.__init__ = connect_by_paths  # type: ignore[method-assign]
    clock.time = _SetClock(Path(os.environ["REWIRED_CLOCK"]))  # type: ignore[assignment]
    from gcs.cli import main as gcs

    gcs()
