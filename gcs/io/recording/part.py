"""One part of a recording: an MCAP file, and the tlog of the same period."""

from __future__ import annotations

import contextlib
import fcntl
import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Final, TypeAlias

from mcap.writer import CompressionType, Writer

from gcs.io.private_files import private
from gcs.io.record_json import encode
from gcs.io.recording.folder import (
    CONFIG_NAME,
    FORMAT_METADATA,
    FORMAT_VERSION,
    PROFILE,
    RUN_METADATA,
    VERSIONS_METADATA,
    Run,
)
from gcs.io.recording.schemas import json_schema
from gcs.io.recording.tlog import tlog_entries
from gcs.io.recording.topics import TOPICS, Recordable, topic_of
from gcs.model import Datagram, Picture, Send

PendingRecord: TypeAlias = tuple[Recordable, int, bytes]
"""Record, time of the run in nanoseconds, and the record as JSON (empty if it is not encoded yet)."""

_CHUNK_BYTES: Final = 1024 * 1024
"""Uncompressed size at which a chunk is compressed and written."""
_BUFFER_BYTES: Final = 256 * 1024
_MAX_TIME_NS: Final = 2**63 - 1
_SEQUENCE_MASK: Final = 0xFFFFFFFF


class RecordingPart:
    """An MCAP file with its tlog; every method may raise OSError.

    Raises
    ------
    FileExistsError
        If one of the files exists.
    """

    def __init__(self, mcap_path: Path, tlog_path: Path) -> None:
        self.paths = (mcap_path, tlog_path)
        self._files: list[io.FileIO] = []
        try:
            for path in self.paths:
                self._files.append(open(path, "xb", buffering=0, opener=private))  # noqa: SIM115  kept
        except OSError:
            for path, file in zip(self.paths, self._files, strict=False):
                file.close()
                path.unlink()
            raise
        with contextlib.suppress(OSError):  # some file systems have no locks
            fcntl.flock(self._files[0], fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._inode = os.fstat(self._files[0].fileno()).st_ino
        self._mcap, self._tlog = (io.BufferedWriter(file, _BUFFER_BYTES) for file in self._files)
        self._writer = Writer(self._mcap, _CHUNK_BYTES, CompressionType.ZSTD)
        self._channels: dict[str, int] = {}
        """Channel number of each topic."""

    @property
    def file_bytes(self) -> tuple[int, int]:
        """Size of the MCAP and of the tlog, without the open chunk."""
        return self._mcap.tell(), self._tlog.tell()

    def is_in_place(self) -> bool:
        """Return True if the MCAP is still at its path."""
        try:
            return self.paths[0].stat().st_ino == self._inode
        except FileNotFoundError:
            return False

    def begin(self, config_text: str, versions: dict[str, str], run: Run | None) -> None:
        """Write the metadata of the run, and every topic with its schema."""
        self._writer.start(PROFILE, PROFILE)
        self._writer.add_attachment(0, 0, CONFIG_NAME, "application/toml", config_text.encode())
        self._writer.add_metadata(FORMAT_METADATA, {"version": str(FORMAT_VERSION)})
        self._writer.add_metadata(VERSIONS_METADATA, versions)
        if run is not None:
            self._writer.add_metadata(RUN_METADATA, {"scenario": run.scenario, "seed": str(run.seed)})
        self._mcap.flush()
        for record_type, topic in TOPICS.items():
            schema = self._writer.register_schema(
                f"gcs.{record_type.__name__}", "jsonschema", json_schema(record_type)
            )
            topics = [f"{topic}/agents", f"{topic}/targets"] if record_type is Picture else [topic]
            for name in topics:
                self._channels[name] = self._writer.register_channel(name, "json", schema)

    def add(self, records: Sequence[PendingRecord], sequence: int) -> None:
        """Write records to the MCAP, and the frames of datagrams to the tlog.

        Parameters
        ----------
        records : sequence of PendingRecord
            Times outside the range of MCAP are clipped.
        sequence : int
            Number of the first record in the run. The MCAP has it modulo 2**32.
        """
        for number, (record, t_ns, payload) in enumerate(records, sequence):
            time_ns = min(max(t_ns, 0), _MAX_TIME_NS)
            channel = self._channels[topic_of(record)]
            data = payload or encode(record)
            self._writer.add_message(channel, time_ns, data, time_ns, number & _SEQUENCE_MASK)
            if isinstance(record, Datagram | Send):
                self._tlog.write(tlog_entries(time_ns, record.data))

    def flush(self) -> None:
        """Write the open chunk, and hand both files to the operating system."""
        self._writer.flush()
        self._tlog.flush()

    def finish(self) -> int:
        """Write the index and close both files; return their size together in bytes."""
        self._writer.finish()
        size = sum(self.file_bytes)
        self._mcap.close()
        self._tlog.close()
        return size

    def abandon(self) -> None:
        """Close both files without writing any more."""
        for file in self._files:
            file.close()
