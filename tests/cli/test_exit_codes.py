"""A script could not tell a service that is not there from a mistake in its own arguments."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gcs.cli import app
from gcs.io.zenoh.discovery import announced
from sim_vehicles.cli import app as sim_vehicles

COMMANDS = (["status"], ["order", "hold", "1"], ["order", "plan"], ["order", "confirm"])


@pytest.fixture(autouse=True)
def _no_services(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


@pytest.mark.parametrize("command", COMMANDS)
def test_without_a_service_every_command_ends_with_1(command: list[str]) -> None:
    assert CliRunner().invoke(app, command).exit_code == 1


@pytest.mark.parametrize("command", COMMANDS)
def test_a_service_that_must_be_named_is_a_mistake_of_the_arguments(command: list[str]) -> None:
    with ExitStack() as stack:
        for mission in ("one", "other"):
            stack.enter_context(announced(mission, "tcp/127.0.0.1:1"))
        assert CliRunner().invoke(app, command).exit_code == 2


@pytest.mark.parametrize(("option", "words"), [("-h", "Usage"), ("--version", "sim-vehicles ")])
def test_simulated_vehicles_have_help_and_a_version(option: str, words: str) -> None:
    result = CliRunner().invoke(sim_vehicles, [option])
    assert (result.exit_code, words in result.output) == (0, True)


@pytest.mark.parametrize(
    "command", [["run", "prescribed"], ["world", "prescribed", "--link", "udpin:127.0.0.1:0"]]
)
def test_a_simulated_world_without_its_certificate_is_refused_before_it_starts(command: list[str]) -> None:
    """It ended with a traceback of one of its processes."""
    refused = CliRunner().invoke(sim_vehicles, [*command, "--zenoh", "tls/127.0.0.1:1"])
    assert refused.exit_code == 2
    assert "needs a certificate: --zenoh-tls FOLDER" in " ".join(refused.output.split())


def test_a_misspelt_word_of_a_mission_file_is_answered_with_the_words_it_may_be(tmp_path: Path) -> None:
    made = CliRunner().invoke(app, ["check", "prescribed"])
    assert made.exit_code == 0
    file = tmp_path / "m.toml"
    text = (Path(__file__).parents[2] / "config" / "reference.toml").read_text(encoding="utf-8")
    file.write_text(text.replace('retask = "auto"', 'retask = "never"', 1), encoding="utf-8")
    result = CliRunner().invoke(app, ["check", str(file)])
    assert result.exit_code == 2
    output = " ".join(result.output.split())
    assert 'planning.retask: expected one of "auto", "confirm", got' in output
