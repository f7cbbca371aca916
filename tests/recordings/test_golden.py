"""A change to the results of trackers, planner or transfers would go out unnoticed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from golden import GOLDEN, HERE, Golden, compare, differences

from gcs.io.recording.reader import Damage, read, read_info
from gcs.io.recording.recorder import Recorder
from gcs.model import AgentStatus, Event, OrderAnswer, Picture, Plan, Truth, UploadReport, read_only

RENEW = "when this was meant to change: python tests/recordings/renew.py"


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden.name)
def test_a_golden_run_gives_its_recorded_effects(golden: Golden) -> None:
    result = compare(golden.path)
    assert result.compared > 30
    if result.first is not None:
        pytest.fail(f"{golden.name} ({golden.shows}): {result}\n{RENEW}", pytrace=False)


def test_the_golden_runs_are_small_and_none_is_left_over() -> None:
    paths = set(HERE.glob("*.mcap"))
    assert paths == {golden.path for golden in GOLDEN}
    assert sum(path.stat().st_size for path in paths) < 1_000_000


def test_the_golden_runs_contain_their_cases() -> None:
    held = {golden.name: [record.value for record in read(golden.path)] for golden in GOLDEN}
    statuses = [value.status for value in held["death"] if isinstance(value, AgentStatus)]
    assert {"arrived", "lost"} <= set(statuses)
    assert sum(isinstance(value, Plan) for value in held["death"]) >= 2
    answers = [value.state for value in held["orders"] if isinstance(value, OrderAnswer)]
    assert answers.count("done") >= 4
    assert any(isinstance(value, UploadReport) and value.ok for value in held["loss"])


def changed(source: Path, folder: Path) -> Path:
    """Write a golden run again, with one number of one picture changed, and one agent status left out."""
    made_with = read_info(source)
    pictures = 0
    with Recorder(folder, made_with.config_text, made_with.versions, made_with.run) as recorder:
        for record in read(source):
            value = record.value
            assert not isinstance(value, Damage)
            if isinstance(value, Picture) and value.kind == "targets":
                pictures += 1
                if pictures == 6:
                    value = replace(value, cardinality=read_only(value.cardinality + 0.25))
            if isinstance(value, Event):
                recorder.record_event(value)
            elif isinstance(value, Truth):
                recorder.record_truth(value)
            elif not (isinstance(value, AgentStatus) and value.status == "lost"):
                recorder.record_effect(record.t_ns, value)
    return folder / "run.mcap"


def test_a_difference_is_reported_legibly(tmp_path: Path) -> None:
    result = compare(changed(HERE / "death.mcap", tmp_path / "run"))
    assert result.different == 2
    assert result.first is not None
    assert (result.first.topic, result.first.t_s) == ("/effect/picture/targets", 5.0)
    assert result.first.what.startswith("cardinality[")
    assert float(result.first.before) == pytest.approx(float(result.first.after) + 0.25)
    text = str(result)
    assert "* agent 2" in text
    assert "active  ->  lost" in text
    assert "OSPA of targets" in text
    assert "missions delivered" in text


def test_another_version_is_forgiven_the_last_digits_and_nothing_else() -> None:
    def found(before: object, after: object, tolerance: float = 1e-6) -> list[str]:
        return [what for what, _, _ in differences(before, after, tolerance)]

    before = {"mean": [1500.0, -0.25], "label": [3, 1], "why": "death"}
    nearly = {"mean": [1500.0 * (1 + 1e-9), -0.25 + 1e-9], "label": [3, 1], "why": "death"}
    assert found(before, nearly) == []
    assert found(before, nearly, 0.0) == ["mean[0]", "mean[1]"]
    assert found(before, before | {"mean": [1500.01, -0.25]}) == ["mean[0]"]
    assert found(before, before | {"label": [3, 2]}) == ["label[1]"]
    assert found(before, before | {"mean": [1500.0]}) == ["length of mean"]
    assert found(before, before | {"why": None, "more": 1}) == ["why", "more"]
