"""Programs that follow a running service and pass on what it shows: to TAK, to Foxglove.

They ask as consoles do (`gcs.console.remote`), so they cost the flight as much as an open page, and delay
nothing: a slow one asks later. They see, and give no orders.
"""

from __future__ import annotations

import asyncio
import base64
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np

from gcs.console.remote.remote_run import find_run
from gcs.console.source import Source
from gcs.console.view.news import News, NewsRequest
from gcs.console.view.page_records import MissionInfo
from gcs.geo import LocalFrame
from gcs.io.zenoh.discovery import choose_service
from gcs.io.zenoh.session import ZenohSession
from gcs.report.export.mission_frame import MissionFrame
from gcs.terrain.elevation_grid import Elevation

FIND_S: Final = 10.0
"""Time in which the service must answer."""


def address_of(
    zenoh: str | None, mission: str | None, tls: Path | None
) -> tuple[str, str | None, Path | None]:
    """Return zenoh endpoint, mission and certificate of a service: the named one, or that on this machine.

    Raises
    ------
    LinkError
        When no endpoint is named, and there is none here, or more than one.
    """
    if zenoh is not None:
        return zenoh, mission, tls
    found = choose_service(mission, None, tls)
    return found.zenoh, found.mission, found.tls


@contextmanager
def followed(zenoh: str | None, mission: str | None, tls: Path | None) -> Iterator[Source]:
    """Find a service, and stay connected while the context lasts.

    Raises
    ------
    LinkError
        When none is found.
    """
    endpoint, name, folder = address_of(zenoh, mission, tls)
    with ZenohSession(connect=endpoint, tls=folder) as bus:
        yield asyncio.run(find_run(bus, name, FIND_S))


async def news_of(source: Source, period_s: float) -> AsyncIterator[News]:
    """Yield what is new of a service, for ever; nothing while it does not answer."""
    request = NewsRequest(is_watched=True)
    while True:
        news = await source.pull(request)
        if news is not None:
            request = request.after(news)
            yield news
        if news is None or not news.has_more:
            await asyncio.sleep(period_s)


def frame_of(mission: MissionInfo) -> MissionFrame:
    """Return the frame of a mission, with its ground as the console has it."""
    local = LocalFrame(*mission.origin_deg, mission.origin_alt_m)
    found = mission.elevation
    if found is None:
        return MissionFrame(local, mission.layers_rel_m)
    steps = np.frombuffer(base64.b64decode(found.heights), "<u2").reshape(found.shape)
    heights_m = found.lowest_msl_m + found.step_m * steps
    elevation = Elevation(found.origin_m, found.spacing_m, heights_m)
    return MissionFrame(local, mission.layers_rel_m, elevation)
