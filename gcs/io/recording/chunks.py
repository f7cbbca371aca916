"""Chunks of MCAP files, unpacked within bounds.

A few kilobytes can unpack to gigabytes. What a chunk claims is checked first; unpacking stops where the claim
is passed; and all chunks of a file together may only grow with the bytes that were read.
"""

from __future__ import annotations

import zlib
from typing import Final

import lz4.frame
import zstandard
from mcap.records import Chunk

MAX_CHUNK_BYTES: Final = 64 * 1024 * 1024
"""Larger chunks are none of ours (the recorder's have about a megabyte)."""
_MAX_RATIO: Final = 100
"""Of all chunks of a file: recordings have 4, and 20 where nothing happens."""


class UnpackingError(Exception):
    """A chunk is refused; the text says why."""


class Unpacker:
    """Unpacks the chunks of one file."""

    def __init__(self) -> None:
        self._packed_bytes = self._unpacked_bytes = 0

    def unpack(self, chunk: Chunk) -> bytes:
        """Return the content of a chunk.

        Raises
        ------
        UnpackingError
            When it is not what it claims to be, or unpacks to more than it may.
        zstandard.ZstdError, RuntimeError
            When it is damaged.
        """
        size = chunk.uncompressed_size
        if size > MAX_CHUNK_BYTES:
            raise UnpackingError(f"a chunk claims more than {MAX_CHUNK_BYTES} bytes")
        self._packed_bytes += len(chunk.data)
        self._unpacked_bytes += size
        if self._unpacked_bytes > MAX_CHUNK_BYTES + _MAX_RATIO * self._packed_bytes:
            raise UnpackingError(
                f"its chunks unpack to more than {_MAX_RATIO} times their size, as no recording does"
            )
        content = _unpacked(chunk.compression, chunk.data, size)
        if len(content) != size:
            raise UnpackingError(f"a chunk does not unpack to the {size} bytes that it claims")
        if chunk.uncompressed_crc not in (0, zlib.crc32(content)):
            raise UnpackingError("the checksum of a chunk differs")
        return content


def _unpacked(compression: str, data: bytes, size: int) -> bytes:
    """Return at most one byte more than `size`."""
    if compression == "zstd":
        if zstandard.frame_content_size(data) > size:  # else the library would make room for it
            raise UnpackingError(f"a chunk unpacks to more than the {size} bytes that it claims")
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=max(size, 1))
    if compression == "lz4":
        content: bytes = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
        return content
    if compression:
        raise UnpackingError(f"a chunk is compressed by {compression[:20]!r}, which is not known here")
    return data
