"""A service that was killed would be found, and the next one could not take its bridge over."""

import subprocess
import sys
import time

from gcs.io.zenoh.discovery import is_running


def test_a_process_that_has_ended_does_not_run_although_its_parent_has_not_waited_for_it() -> None:
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    assert is_running(process.pid)
    assert process.stdin is not None
    process.stdin.close()
    until_s = time.monotonic() + 20.0
    while is_running(process.pid) and time.monotonic() < until_s:
        time.sleep(0.02)
    assert not is_running(process.pid)
    process.wait()
    assert not is_running(process.pid)
