"""STATUSTEXT in chunks (https://mavlink.io/en/messages/common.html#STATUSTEXT). Sans-I/O.

A text of more than 50 characters comes as several messages with one `id` and a rising `chunk_seq`. The last
chunk has fewer than 50 characters.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from gcs.mavlink.frames.codec import Message
from gcs.model import NS_PER_S
from gcs.safe_text import printable

_CHUNK_LENGTH: Final = 50
_MISSING: Final = "[...]"
_MAX_TEXTS_PER_S: Final = 5


@dataclass(slots=True)
class TextChunks:
    """Chunks of the text that one vehicle is sending, and the rate of its texts."""

    text_id: int = 0
    """Number of the text; 0 for none."""
    chunks: list[str] = field(default_factory=list)
    second: int = -1
    """Second of the last text."""
    count: int = 0
    """Texts in that second."""

    def add_chunk(self, message: Message) -> list[str]:
        """Add a STATUSTEXT; return the texts that it completes.

        A text without its end is returned when the next text begins. A lost chunk becomes [...]. The tab at
        the end of some PX4 texts is removed.
        """
        texts: list[str] = []
        if message.id != self.text_id:
            if self.chunks:
                texts.append("".join(self.chunks) + _MISSING)
            self.text_id, self.chunks = message.id, []
        text = printable(str(message.text), keep="\t")
        if not message.id:
            return [*texts, text.rstrip()]
        if message.chunk_seq > len(self.chunks):
            self.chunks += [_MISSING] * (message.chunk_seq - len(self.chunks))
        elif message.chunk_seq < len(self.chunks):
            return texts  # a repeated chunk
        self.chunks.append(text)
        if len(text) < _CHUNK_LENGTH:
            texts.append("".join(self.chunks).rstrip())
            self.text_id, self.chunks = 0, []
        return texts

    def count_text(self, t_ns: int) -> bool:
        """Count a text; return True if it is within the rate that is shown."""
        second = t_ns // NS_PER_S
        self.second, self.count = second, self.count + 1 if second == self.second else 1
        return self.count <= _MAX_TEXTS_PER_S
