"""Decompression of MCAP chunks within bounds.

A few kilobytes can unpack to gigabytes. The size that a chunk declares is checked first, and decompression
stops beyond it. The total of all chunks is limited by the number of bytes read.
"""

from __future__ import annotations

import zlib
from typing import Final

import lz4.frame
import zstandard
from mcap.records import Chunk

MAX_CHUNK_BYTES: Final = 64 * 1024 * 1024
"""Chunks of the recorder have about 1 MB."""
_MAX_RATIO: Final = 100
"""Maximum compression ratio of all chunks of a file. Recordings have 4 to 20."""


class UnpackingError(Exception):
    """A chunk is refused; the message has the reason."""


class Unpacker:
    """Decompresses the chunks of one file."""

    def __init__(self) -> None:
        self._compressed_bytes = self._unpacked_bytes = 0

    def unpack(self, chunk: Chunk) -> bytes:
        """Decompress a chunk.

        Raises
        ------
        UnpackingError
            If its size or checksum is wrong, or it exceeds a bound.
        zstandard.ZstdError, RuntimeError
            If it is damaged.
        """
        size = chunk.uncompressed_size
        if size > MAX_CHUNK_BYTES:
            raise UnpackingError(f"a chunk claims more than {MAX_CHUNK_BYTES} bytes")
        self._compressed_bytes += len(chunk.data)
        self._unpacked_bytes += size
        if self._unpacked_bytes > MAX_CHUNK_BYTES + _MAX_RATIO * self._compressed_bytes:
            raise UnpackingError(
                f"its chunks unpack to more than {_MAX_RATIO} times their size, as no recording does"
            )
        content = _decompress(chunk.compression, chunk.data, size)
        if len(content) != size:
            raise UnpackingError(f"a chunk does not unpack to the {size} bytes that it claims")
        if chunk.uncompressed_crc not in (0, zlib.crc32(content)):
            raise UnpackingError("the checksum of a chunk differs")
        return content


def _decompress(compression: str, data: bytes, size: int) -> bytes:
    """Return the content, or its first `size` + 1 bytes if it is larger."""
    if compression == "zstd":
        if zstandard.frame_content_size(data) > size:  # the library would allocate it
            raise UnpackingError(f"a chunk unpacks to more than the {size} bytes that it claims")
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=max(size, 1))
    if compression == "lz4":
        content: bytes = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
        return content
    if compression:
        raise UnpackingError(f"a chunk is compressed by {compression[:20]!r}, which is not known here")
    return data
