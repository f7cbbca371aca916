"""Terminals in which the commands of a page are typed, word for word, in a folder with its files."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gcs.io.zenoh.session import free_endpoint
from helpers.pages import ROOT, SAVED, text_of, words_of
from helpers.processes import GCS, free_port

PROGRAMS = {"gcs": GCS, "sim-vehicles": [sys.executable, "-P", "-m", "sim_vehicles"]}
DOCS = ROOT / "docs"


class Desk:
    """Terminals in one folder with the files that a page has saved, on links of their own."""

    def __init__(self, folder: Path, page: str = "") -> None:
        self.folder = folder
        self.zenoh = free_endpoint()
        self.port = free_port()
        self.links = f'\n[links]\nmavlink = "udpin:127.0.0.1:{self.port}"\nzenoh = "{self.zenoh}"\n'
        for name, language, text in SAVED.findall(text_of(DOCS / page)) if page else ():
            self.save(name, text + self.links if language == "toml" else text)
        self.processes: list[subprocess.Popen[bytes]] = []
        """Those of `started`, in the order of their terminals."""
        self.environment = {**os.environ, "XDG_RUNTIME_DIR": str(folder), "COLUMNS": "200"}

    def save(self, name: str, text: str) -> None:
        (self.folder / name).write_text(text)

    def words(self, line: str) -> list[str]:
        program, *words = words_of(line)
        more = ["--gcs", f"127.0.0.1:{self.port}", "--zenoh", self.zenoh] if program == "sim-vehicles" else []
        more += ["--console", "off"] if words[:1] == ["run"] and program == "gcs" else []
        return [*PROGRAMS[program], *words, *more]

    def run(self, line: str, code: int = 0) -> str:
        """Type a command, and `y` where it asks; return what it prints."""
        ours, theirs = os.openpty()
        os.write(ours, b"y\n")
        done = subprocess.run(
            self.words(line), cwd=self.folder, env=self.environment, stdin=theirs, timeout=60.0, check=False,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        os.close(ours)
        os.close(theirs)
        assert done.returncode == code, f"{line}: {done.stdout}"
        return done.stdout

    @contextmanager
    def started(self, words: list[str], until: str) -> Iterator[Path]:
        """Start a command in a terminal of its own, and wait until its file has some text."""
        log = self.folder / f"{len(list(self.folder.glob('*.log')))}.log"
        with log.open("wb") as output:
            process = subprocess.Popen(
                words, cwd=self.folder, env=self.environment, stdout=output, stderr=subprocess.STDOUT
            )
        self.processes.append(process)
        try:
            await_text(log, until)
            yield log
        finally:
            process.terminate()
            process.wait(30.0)


def await_text(log: Path, text: str) -> None:
    deadline = time.monotonic() + 60.0
    while text not in log.read_text():
        assert time.monotonic() < deadline, log.read_text()
        time.sleep(0.1)
