"""File of a run that `gcs replay` and `gcs report` open: a recording, or a telemetry log with its mission."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from gcs.config import Config
from gcs.errors import RecordingError
from gcs.io.recording.reader import Record, is_recording
from gcs.service.foreign_logs import DetectionFile, load_detections, refuse_detections, telemetry_records


@dataclass(frozen=True, slots=True)
class RunFile:
    """A recording or a log, and the options that say how to read it."""

    path: Path
    config: str | None = None
    """Mission file to use instead of the recorded one."""
    seed: int | None = None
    """Seed to use instead of the recorded one."""
    detections: Path | None = None
    """Detections to add to a log."""
    model: Path | None = None
    """Sensor model of the detections, if their file has none."""
    offset_s: float = 0.0
    """Seconds to add to the times of the detections."""

    @property
    def has_other_settings(self) -> bool:
        """True if a recording is replayed with another mission file or seed than it was made with."""
        return self.config is not None or self.seed is not None

    @property
    def title(self) -> str:
        """Path, and the settings that differ from the recorded ones."""
        config = "" if self.config is None else f", {self.config}"
        return f"{self.path}{config}{'' if self.seed is None else f', seed {self.seed}'}"

    def is_recording(self) -> bool:
        """Return True for a recording of this project, False for a log.

        Raises
        ------
        RecordingError
            When the file cannot be read, has detections only, or detections are to be added to a recording.
        """
        if not is_recording(self.path):
            refuse_detections(self.path)
            return False
        if self.detections is not None:
            raise RecordingError(str(self.path), "is a recording with scans; --detections is for logs")
        return True

    def load_detections(self) -> DetectionFile | None:
        """Return the detections to add to the log, if any.

        Raises
        ------
        GcsError
            When their file cannot be read, has no sensor model, or the mission is missing.
        """
        if self.detections is None:
            return None
        if self.config is None:
            raise RecordingError(
                str(self.path), "--detections needs the mission of the detections: name it with --config"
            )
        return load_detections(self.detections, self.model, self.offset_s)

    def log_records(self, config: Config, detections: DetectionFile | None) -> Iterator[Record]:
        """Return the events of the log: frames of the mission's vehicles, ticks and scans."""
        return telemetry_records(self.path, [agent.vehicle for agent in config.agents], detections)
