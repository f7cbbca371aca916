"""The journal: one file with a snapshot of the state, from which a restarted service continues.

It is replaced atomically (temporary file, fsync, rename). After SIGKILL or a power cut the newest version or
the one before it is there, never a part. It has a format version, a checksum, and the fingerprint of its
mission file and seed. If any of them is wrong, the service starts without it and says why. A journal moves no
aircraft: a route counts only when the vehicle's onboard mission reads back equal.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import msgspec

from gcs.errors import JournalError
from gcs.files import read_bytes
from gcs.io.private_files import make_private, private
from gcs.model import Snapshot

VERSION = 4
_MAX_BYTES = 64 * 1024 * 1024


class _Head(msgspec.Struct, frozen=True, kw_only=True):
    """The first line."""

    journal: int
    """Version of the format."""
    mission: str
    fingerprint: str
    """Of the mission file and the seed."""
    t_ns: int
    """Time of the snapshot."""
    checksum: str
    """Of the snapshot, which follows the line, and its time."""


_head_decoder = msgspec.json.Decoder(_Head)


def fingerprint(config_text: str, seed: int) -> str:
    """Return a hash that is equal for runs with the same mission file and seed."""
    return hashlib.sha256(f"{seed}\n{config_text}".encode()).hexdigest()


def _checksum(snapshot: Snapshot) -> str:
    return hashlib.sha256(f"{snapshot.t_ns}\n".encode() + snapshot.data).hexdigest()


class Journal:
    """The file of one mission.

    Parameters
    ----------
    path : Path
        The folder is created if it does not exist.
    """

    def __init__(self, path: Path, mission: str, belongs_to: str) -> None:
        self.path = path
        self._mission, self._belongs_to = mission, belongs_to

    def write(self, snapshot: Snapshot) -> None:
        """Replace the journal, and wait for the disk.

        Raises
        ------
        JournalError
            When it cannot be written; the previous file stays.
        """
        head = _Head(
            journal=VERSION,
            mission=self._mission,
            fingerprint=self._belongs_to,
            t_ns=snapshot.t_ns,
            checksum=_checksum(snapshot),
        )
        temporary = self.path.with_name(f"{self.path.name}.{os.getpid()}.new")
        try:
            make_private(self.path.parent, exist_ok=True)
            with open(temporary, "wb", opener=private) as file:
                file.write(msgspec.json.encode(head) + b"\n" + snapshot.data)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(self.path)
        except OSError as error:
            raise JournalError(str(self.path), f"cannot be written: {error.strerror}") from None

    def read(self) -> Snapshot | None:
        """Return the stored snapshot, or None without a journal.

        Raises
        ------
        JournalError
            When it is damaged, of another version, or of another mission.
        """
        try:
            data = read_bytes(self.path, _MAX_BYTES)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise JournalError(str(self.path), f"cannot be read: {error.strerror}") from None
        first, _, body = data.partition(b"\n")
        try:
            head = _head_decoder.decode(first)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            raise JournalError(str(self.path), "is damaged, or no journal") from None
        if head.journal != VERSION:
            raise JournalError(str(self.path), f"has version {head.journal}, this service reads {VERSION}")
        snapshot = Snapshot(head.t_ns, body)
        if _checksum(snapshot) != head.checksum:
            raise JournalError(str(self.path), "is damaged: its checksum differs")
        if head.fingerprint != self._belongs_to:
            raise JournalError(
                str(self.path), f"belongs to another mission file or seed ({head.mission}); it is not used"
            )
        return snapshot
