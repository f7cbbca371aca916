"""STATUSTEXT in chunks (https://mavlink.io/en/messages/common.html#STATUSTEXT). Sans-I/O.

A text of more than 50 characters comes as several messages with one `id` and a rising `chunk_seq`. The last
chunk has fewer than 50 characters.

A vehicle on the ground repeats the reason why it cannot fly: ArduPlane each 30 s (PREARM_DISPLAY_PERIOD), PX4
whenever a check changes. Such a text is shown when it begins, and again after `_ENDED_NS` without it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Final

from gcs.mavlink.frames.codec import Message
from gcs.mavlink.services.retry import ns
from gcs.model import NS_PER_S
from gcs.safe_text import printable

_CHUNK_LENGTH: Final = 50
_MISSING: Final = "[...]"
_MAX_TEXTS_PER_S: Final = 5
_ENDED_NS: Final = ns(120.0)
"""A text that was not said for this time has ended."""
_MEASURED: Final = re.compile(r"\d+\.\d+|\d{2,}")
"""A measured value; a single digit is the number of a sensor."""
_MAX_REPEATED: Final = 32


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
    said_t_ns: dict[str, int] = field(default_factory=dict)
    """Last time of each text, without measured values; the oldest first."""

    def add_chunk(self, message: Message) -> list[str]:
        """Add a STATUSTEXT; return the texts that it completes.

        A text without its end is returned when the next text begins. A lost chunk becomes [...]. The tab at
        the end of some PX4 texts is removed.
        """
        texts: list[str] = []
        if message.id != self.text_id:
            if self.chunks:
                texts.append("".join(self.chunks) + _MISSING)
            self.text_id = message.id
            self.chunks = []
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
            self.text_id = 0
            self.chunks = []
        return texts

    def count_text(self, t_ns: int) -> bool:
        """Count a text; return True if it is within the rate that is shown."""
        second = t_ns // NS_PER_S
        self.count = self.count + 1 if second == self.second else 1
        self.second = second
        return self.count <= _MAX_TEXTS_PER_S

    def is_repeated(self, text: str, t_ns: int) -> bool:
        """Note a text; return True if it was said within `_ENDED_NS`."""
        key = _MEASURED.sub("", text)
        last_t_ns = self.said_t_ns.pop(key, None)
        self.said_t_ns[key] = t_ns
        if len(self.said_t_ns) > _MAX_REPEATED:
            del self.said_t_ns[next(iter(self.said_t_ns))]
        return last_t_ns is not None and t_ns - last_t_ns < _ENDED_NS
