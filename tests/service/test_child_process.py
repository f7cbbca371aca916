"""A part of the service that fails would be gone, or started without end, or would outlive the service."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gcs.model import NoticeCode, NoticeContent
from gcs.service import child_process
from gcs.service.child_process import ChildProcess

READY = "print('{\"ready\": true}', flush=True); sys.stdin.read()"
FAILS = "sys.exit('no such thing')"


def child(program: str) -> ChildProcess:
    return ChildProcess("part", [sys.executable, "-c", f"import sys, time, signal; {program}"])


def told(one: ChildProcess) -> list[NoticeContent]:
    found = []
    while (content := one.notice()) is not None:
        found.append(content)
    return found


async def until(condition, within_s: float = 30.0) -> None:
    until_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < until_s
        await asyncio.sleep(0.02)


@pytest.fixture(autouse=True)
def _short_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child_process, "FIRST_PAUSE_S", 0.01)


def test_a_killed_process_is_started_again_and_that_is_told():
    async def run() -> None:
        one = child(READY)
        task = asyncio.create_task(one.run())
        await until(lambda: one.process is not None)
        first = one.process
        assert first is not None
        os.kill(first.pid, signal.SIGKILL)
        notices: list[NoticeContent] = []
        await until(lambda: notices.extend(told(one)) or len(notices) == 2)  # type: ignore[func-returns-value]
        assert [code for code, _ in notices] == [NoticeCode.PROCESS_ENDED, NoticeCode.PROCESS_AGAIN]
        assert notices[0][1]["error"] == "killed by SIGKILL"
        assert one.process is not first
        task.cancel()
        await one.close()
        assert one.process is not None
        assert one.process.returncode == 0

    asyncio.run(run())


def test_one_that_fails_each_time_is_left_alone_with_an_alarm_that_says_why():
    async def run() -> None:
        one = child(FAILS)
        await asyncio.wait_for(one.run(), 60.0)
        notices = told(one)
        assert [code for code, _ in notices] == [
            *[NoticeCode.PROCESS_ENDED] * (child_process.MAX_STARTS - 1),
            NoticeCode.PROCESS_GIVEN_UP,
        ]
        pauses_s = [parameters["pause_s"] for _, parameters in notices[:-1]]
        assert pauses_s == sorted(set(pauses_s))
        assert all("no such thing" in str(parameters["error"]) for _, parameters in notices)

    asyncio.run(run())


def test_a_program_that_is_not_there_is_an_alarm_too():
    async def run() -> None:
        one = ChildProcess("part", ["/nothing/here"])
        await asyncio.wait_for(one.run(), 60.0)
        code, parameters = told(one)[-1]
        assert code is NoticeCode.PROCESS_GIVEN_UP
        assert "cannot be started" in str(parameters["error"])

    asyncio.run(run())


def test_its_notices_are_passed_on_and_other_lines_are_not():
    line = '{"code": "console-failed", "parameters": {"error": "KeyError: 1"}}'

    async def run() -> None:
        one = child(f"print('hello'); print('x' * 200000); print('{line}'); {READY}")
        task = asyncio.create_task(one.run())
        notices: list[NoticeContent] = []
        await until(lambda: notices.extend(told(one)) or notices)  # type: ignore[func-returns-value]
        assert notices == [(NoticeCode.CONSOLE_FAILED, {"error": "KeyError: 1"})]
        task.cancel()
        await one.close()

    asyncio.run(run())


def test_one_that_does_not_end_is_killed(monkeypatch):
    monkeypatch.setattr(child_process, "_END_S", 0.3)

    async def run() -> None:
        one = child("signal.signal(signal.SIGTERM, signal.SIG_IGN); print('{}', flush=True); time.sleep(60)")
        task = asyncio.create_task(one.run())
        await until(lambda: one.process is not None)
        task.cancel()
        await one.close()
        assert one.process is not None
        assert one.process.returncode == -signal.SIGKILL

    asyncio.run(run())


PARENT = """
import asyncio, sys
from gcs.service.child_process import ChildProcess

async def run():
    one = ChildProcess("part", [sys.executable, "-c", "import sys; sys.stdin.read()"])
    task = asyncio.create_task(one.run())
    while one.process is None:
        await asyncio.sleep(0.01)
    print(one.process.pid, flush=True)
    await task

asyncio.run(run())
"""


def test_it_ends_when_its_parent_is_killed():
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        assert Path(f"/proc/{pid}").exists()
        parent.kill()
    until_s = time.monotonic() + 20.0
    while _runs(pid):
        assert time.monotonic() < until_s
        time.sleep(0.05)


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
