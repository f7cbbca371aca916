"""The recording of a run that tests share, made once."""

from pathlib import Path

import pytest
from helpers.recorded import CONFIG, VERSIONS, a_run, record

from gcs.io.recording.recorder import Recorder
from gcs.io.recording.topics import Recordable


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Recordable]]:
    folder = tmp_path_factory.mktemp("runs") / "a" / "run"
    with Recorder(folder, CONFIG, VERSIONS) as recorder:
        values = record(recorder, a_run(20))
    return folder, values
