"""Makes the run that tests of recordings share importable, and its recording, once."""

import sys
from pathlib import Path

import pytest

from gcs.io.recording.topics import Recordable
from gcs.io.recording.writer import Recorder

sys.path.insert(0, str(Path(__file__).parent))

from recorded import CONFIG, VERSIONS, a_run, record


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Recordable]]:
    folder = tmp_path_factory.mktemp("runs") / "a" / "run"
    with Recorder(folder, CONFIG, VERSIONS) as recorder:
        values = record(recorder, a_run(20))
    return folder, values
