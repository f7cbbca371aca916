"""A service that was killed would be found, and the next one could not take its bridge over."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gcs.cli import app
from gcs.io.zenoh.discovery import announced, is_running


@pytest.mark.parametrize("command", ["foxglove", "status"])
def test_the_option_that_an_error_names_is_one_of_the_command(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error told `gcs foxglove` to choose by an option that it does not have."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    outputs = [CliRunner().invoke(app, [command]).output]
    with announced("a", "tcp/127.0.0.1:7447"):
        (folder,) = tmp_path.iterdir()
        (folder / "a-1.json").write_text('{"mission": "a", "zenoh": "tcp/127.0.0.1:7448", "pid": 1}')
        outputs.append(CliRunner().invoke(app, [command, "--mission", "a"]).output)
    for output in outputs:
        assert "--zenoh" in output.split()


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
