"""MCAP for Foxglove: the messages of a run (`gcs.report.export.foxglove`) with their schemas."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import msgspec
from mcap.writer import CompressionType, Writer

from gcs.errors import RecordingError
from gcs.io.recording.schemas import json_schema
from gcs.report.export.foxglove import SCHEMAS, Message

_CHUNK_BYTES: Final = 1024 * 1024


def write_mcap(out: Path, messages: Iterable[Message]) -> int:
    """Write messages as JSON with the names of the well-known schemas; return their number.

    Raises
    ------
    RecordingError
        When the file cannot be written.
    """
    count = 0
    try:
        with out.open("wb") as file:
            writer = Writer(file, _CHUNK_BYTES, CompressionType.ZSTD)
            writer.start("", "swarm-gcs")
            schemas: dict[type, int] = {
                kind: writer.register_schema(f"foxglove.{kind.__name__}", "jsonschema", json_schema(kind))
                for kind in SCHEMAS
            }
            channels: dict[str, int] = {}
            for message in messages:
                count += 1
                channel = _channel(writer, channels, message, schemas)
                t_ns = max(message.t_ns, 0)
                writer.add_message(channel, t_ns, msgspec.json.encode(message.value), t_ns)
            writer.finish()
    except OSError as error:
        raise RecordingError(str(out), f"cannot be written: {error.strerror}") from None
    return count


def _channel(writer: Any, channels: dict[str, int], message: Message, schemas: dict[type, int]) -> int:
    if message.topic not in channels:
        channels[message.topic] = writer.register_channel(message.topic, "json", schemas[type(message.value)])
    return channels[message.topic]
