"""STATUSTEXT in chunks (https://mavlink.io/en/messages/common.html#STATUSTEXT). Sans-I/O.

A text of more than 50 characters comes as several messages with one `id` and a rising `chunk_seq`. The last
chunk has fewer than 50 characters.
"""

from __future__ import annotations

from typing import Final

from gcs.mavlink.frames.codec import Message
from gcs.safe_text import printable

_CHUNK_LENGTH: Final = 50
_MISSING: Final = "[...]"


class TextChunks:
    """Chunks of the text that one vehicle is sending."""

    def __init__(self) -> None:
        self._id = 0
        self._chunks: list[str] = []

    def add_chunk(self, message: Message) -> list[str]:
        """Add a STATUSTEXT; return the texts that it completes.

        A text without its end is returned when the next text begins. A lost chunk becomes [...]. The tab at
        the end of some PX4 texts is removed.
        """
        texts: list[str] = []
        if message.id != self._id:
            if self._chunks:
                texts.append("".join(self._chunks) + _MISSING)
            self._id, self._chunks = message.id, []
        text = printable(str(message.text), keep="\t")
        if not message.id:
            return [*texts, text.rstrip()]
        if message.chunk_seq > len(self._chunks):
            self._chunks += [_MISSING] * (message.chunk_seq - len(self._chunks))
        elif message.chunk_seq < len(self._chunks):
            return texts  # a repeated chunk
        self._chunks.append(text)
        if len(text) < _CHUNK_LENGTH:
            texts.append("".join(self._chunks).rstrip())
            self._id, self._chunks = 0, []
        return texts
