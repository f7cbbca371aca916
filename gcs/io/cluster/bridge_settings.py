"""Settings of a bridge, which its process is started with."""

from __future__ import annotations

from pathlib import Path

import msgspec

from gcs.endpoints import Link
from gcs.io.recording.frame_log import FrameLog


class BridgeSettings(msgspec.Struct, frozen=True, kw_only=True):
    """What a bridge needs to know."""

    mission: str
    name: str
    links: tuple[Link, ...]
    vehicles: tuple[int, ...]
    lat_deg: float
    lon_deg: float
    alt_msl_m: float
    """Origin of the local frame."""
    keys: str | None
    """File of signing keys."""
    zenoh: str
    """Endpoint at which command connects."""
    failover_s: float
    is_only: bool = True
    """True if the mission has no other bridge."""
    tls: str | None = None
    """Folder of the certificate for zenoh."""
    frames: str = ""
    """Folder for the frames; empty: they are not kept."""
    max_frame_bytes: int = 0
    min_free_bytes: int = 0
    ports: dict[str, int] = {}
    """Ports of endpoints that listen on any free port: those of the bridge before."""

    @property
    def tls_folder(self) -> Path | None:
        """Folder of the certificate for zenoh; None: no TLS."""
        return None if self.tls is None else Path(self.tls)

    def frame_log(self) -> FrameLog | None:
        """Return the log of the frames, if they are kept."""
        if not (self.frames and self.max_frame_bytes):
            return None
        return FrameLog(Path(self.frames), self.max_frame_bytes, self.min_free_bytes)
