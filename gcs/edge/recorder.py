"""A run's recording: everything that went into the fold and everything that came out, in order.

A recording is a folder::

    run.mcap        every event, effect and truth (https://mcap.dev), as JSON with schemas, for Foxglove
    link.tlog       the MAVLink traffic both ways, for QGroundControl, Mission Planner and MAVExplorer
    mission.toml    the mission file that was flown
    versions.json   of everything that a result depends on

In the MCAP a message's ``sequence`` counts all records of the run, so that the order in which the consumer
took them stays known whatever their times; ``log_time`` is the run's time. The mission file is also attached
to it; the versions are its metadata, and so is `Run`: what the run was started with beside that file.

Messages gather in a compressed chunk, of a megabyte at most, that `flush` writes: called once a second, it
leaves all but the last second readable after SIGKILL or on a full disk. It does not wait for the disk itself
(no fsync): a power cut may cost more.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from mcap.writer import CompressionType, Writer

from gcs.edge.schemas import json_schema
from gcs.edge.tlog import tlog_entries
from gcs.edge.wire import TOPICS, Recordable, encode, topic_of
from gcs.errors import RecordingError
from gcs.model import Datagram, Effect, Event, Picture, Send, Truth

MCAP_NAME, TLOG_NAME, CONFIG_NAME, VERSIONS_NAME = "run.mcap", "link.tlog", "mission.toml", "versions.json"
PROFILE = "swarm-gcs"
VERSIONS_METADATA, RUN_METADATA = "versions", "run"
_CHUNK_BYTES = 1024 * 1024
_BUFFER_BYTES = 256 * 1024
_MAX_T_NS = 2**64 - 1


@dataclass(frozen=True, slots=True)
class Run:
    """What a run was started with, beside its mission file."""

    scenario: str
    """Name in the mission file."""
    seed: int


class Recorder:
    """Writes a recording.

    Parameters
    ----------
    folder : Path
        Made when it is not there. One that holds a recording already is refused: a flight is never
        overwritten.
    config_text : str
        The mission file, as it was read.
    versions : mapping
        Version of each thing that a result depends on.
    run : Run, optional
        What else is needed to fly, or replay, the same again.

    Raises
    ------
    RecordingError
        When the folder cannot be written; also by every method, such as on a full disk. What was flushed
        before stays readable.
    """

    def __init__(
        self, folder: Path, config_text: str, versions: Mapping[str, str], run: Run | None = None
    ) -> None:
        self.folder = folder
        self._sequence = 0
        self._closed = False
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._files = [(folder / name).open("xb", buffering=0) for name in (MCAP_NAME, TLOG_NAME)]
        except FileExistsError:
            raise RecordingError(
                str(folder), "holds a recording already; choose another folder or move it away"
            ) from None
        except OSError as error:
            raise RecordingError(str(folder), f"cannot be written: {error.strerror}") from None
        self._mcap, self._tlog = (io.BufferedWriter(file, _BUFFER_BYTES) for file in self._files)
        self._writer = Writer(self._mcap, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        try:
            (folder / CONFIG_NAME).write_text(config_text, encoding="utf-8")
            (folder / VERSIONS_NAME).write_text(json.dumps(dict(versions), indent=2) + "\n", encoding="utf-8")
            self._channels = self._begin(config_text, versions, run)
        except OSError as error:
            raise self._failed(error) from None

    def _begin(self, config_text: str, versions: Mapping[str, str], run: Run | None) -> dict[str, int]:
        """Announce every topic with its schema, used or not; return the channel of each."""
        self._writer.start(profile=PROFILE)
        self._writer.add_attachment(0, 0, CONFIG_NAME, "application/toml", config_text.encode())
        self._writer.add_metadata(VERSIONS_METADATA, dict(versions))
        if run is not None:
            self._writer.add_metadata(RUN_METADATA, {"scenario": run.scenario, "seed": str(run.seed)})
        self._mcap.flush()
        channels = {}
        for record_type, topic in TOPICS.items():
            schema = self._writer.register_schema(
                f"gcs.{record_type.__name__}", "jsonschema", json_schema(record_type)
            )
            for kind in ("/agents", "/targets") if record_type is Picture else ("",):
                channels[topic + kind] = self._writer.register_channel(topic + kind, "json", schema)
        return channels

    def event(self, event: Event) -> None:
        """Record what goes into the fold; call it before the fold works it."""
        self._add(event, event.t_ns)
        if isinstance(event, Datagram):
            self._add_traffic(event.t_ns, event.data)

    def effect(self, effect: Effect, t_ns: int) -> None:
        """Record what came out of the fold at `t_ns`."""
        self._add(effect, t_ns)
        if isinstance(effect, Send):
            self._add_traffic(t_ns, effect.data)

    def truth(self, truth: Truth) -> None:
        """Record the truth of a simulated world."""
        self._add(truth, truth.t_ns)

    def flush(self) -> None:
        """Hand everything recorded so far to the operating system."""
        if self._closed:
            return
        try:
            self._writer.flush()
            self._tlog.flush()
        except OSError as error:
            raise self._failed(error) from None

    def close(self) -> None:
        """Finish the files; closing again, or after a failure, does nothing."""
        if self._closed:
            return
        try:
            self._writer.finish()
            self._mcap.close()
            self._tlog.close()
        except OSError as error:
            raise self._failed(error) from None
        self._closed = True

    def _add(self, record: Recordable, t_ns: int) -> None:
        if self._closed:
            raise RecordingError(str(self.folder), "is closed")
        log_time = min(max(t_ns, 0), _MAX_T_NS)
        channel = self._channels[topic_of(record)]
        try:
            self._writer.add_message(channel, log_time, encode(record), log_time, self._sequence)
        except OSError as error:
            raise self._failed(error) from None
        self._sequence = (self._sequence + 1) & 0xFFFFFFFF

    def _add_traffic(self, t_ns: int, datagram: bytes) -> None:
        try:
            self._tlog.write(tlog_entries(t_ns, datagram))
        except OSError as error:
            raise self._failed(error) from None

    def _failed(self, error: OSError) -> RecordingError:
        """Leave the files as they are now: finishing them would write on a disk that is full."""
        self._closed = True
        for file in self._files:
            file.close()
        return RecordingError(
            str(self.folder),
            f"cannot be written any further ({error.strerror}); what was recorded before stays readable",
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
