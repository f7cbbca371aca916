"""Long STATUSTEXTs, which come in pieces (https://mavlink.io/en/messages/common.html#STATUSTEXT). Sans-I/O.

A text of more than 50 characters is sent as several messages with one `id` and a rising `chunk_seq`; the last
piece is shorter than 50 characters. PX4 sends most of its reasons so.
"""

from __future__ import annotations

from typing import Final

from gcs.mavlink.frames.codec import Message
from gcs.safe_text import printable

_CHUNK: Final = 50
_MISSING: Final = "[...]"


class TextChunks:
    """The text that one vehicle is in the midst of saying."""

    def __init__(self) -> None:
        self._id = 0
        self._said: list[str] = []

    def joined(self, message: Message) -> list[str]:
        """Return the texts that a STATUSTEXT completes: none while pieces of it are to come.

        A text whose end was lost is returned when the next text begins, a lost piece is shown as [...].
        PX4 ends some of its texts with a tab, which is taken off.
        """
        texts: list[str] = []
        if message.id != self._id:
            if self._said:
                texts.append("".join(self._said) + _MISSING)
            self._id, self._said = message.id, []
        text = printable(str(message.text), keep="\t")
        if not message.id:
            return [*texts, text.rstrip()]
        if message.chunk_seq > len(self._said):
            self._said += [_MISSING] * (message.chunk_seq - len(self._said))
        elif message.chunk_seq < len(self._said):
            return texts  # a piece that came twice
        self._said.append(text)
        if len(text) < _CHUNK:
            texts.append("".join(self._said).rstrip())
            self._id, self._said = 0, []
        return texts
