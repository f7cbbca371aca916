"""Settings of a bridge, from the mission file: its process is started with them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec

from gcs.config import Config
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


_NAME: Final = "main"
"""Name of the only bridge of a mission that names none."""


def bridge_settings(
    config: Config, source: str, links: Sequence[Link], name: str = _NAME, folder: Path | None = None
) -> BridgeSettings:
    """Return the settings of a bridge of a mission, whose file is `source`; it keeps frames in `folder`."""
    frame = config.frame
    frames = "" if folder is None else str((folder / f"{config.name}-bridge-{name}").absolute())
    keys = config.links.key_file(source)
    named = {one.name: one.zenoh for one in config.links.bridges}
    tls = config.links.tls_folder(source) if named else None
    return BridgeSettings(
        mission=config.name,
        name=name,
        links=tuple(link for link in links if link.bridge in ("", name)),
        vehicles=tuple(agent.vehicle for agent in config.agents),
        lat_deg=frame.lat_deg,
        lon_deg=frame.lon_deg,
        alt_msl_m=frame.alt_msl_m,
        keys=None if keys is None else str(keys.resolve()),
        zenoh=named.get(name, ""),
        tls=None if tls is None else str(tls.resolve()),
        failover_s=config.links.failover_s,
        is_only=len(named) < 2,
        frames=frames,
        max_frame_bytes=int(config.recording.bridge_mb * 1e6),
        min_free_bytes=int(config.recording.min_free_mb * 1e6),
    )
