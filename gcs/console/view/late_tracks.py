"""Paths of the tracks by the estimates some scans late (`tracking.lag_scans`)."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Final

from gcs.console.view.page_records import LatePath
from gcs.model import Kind, LaggedPicture, track_name

_MAX_TRACKS: Final = 200
"""Of more, those that ended first are forgotten."""
_MAX_POINTS: Final = 400


class LateTracks:
    """The last estimates of each track."""

    def __init__(self) -> None:
        self._paths: dict[str, deque[tuple[float, float] | None]] = {}
        """The one that was estimated last is the last one."""
        self._estimated: dict[Kind, set[str]] = {}
        """Tracks of the last picture."""

    def paths(self) -> dict[str, LatePath]:
        """Return the path of each track."""
        return {name: list(path) for name, path in self._paths.items()}

    def add(self, pictures: Iterable[LaggedPicture]) -> dict[str, LatePath]:
        """Add pictures; return what is new of each path. A track that was not estimated has a gap."""
        new: dict[str, LatePath] = {}
        for picture in pictures:
            before = self._estimated.get(picture.kind, set())
            names = [track_name(picture.kind, track.label) for track in picture.tracks]
            for name, track in zip(names, picture.tracks, strict=True):
                east_m, north_m = track.mean[:2].round(1).tolist()
                path = self._paths.pop(name, deque(maxlen=_MAX_POINTS))
                added: LatePath = [None] if path and name not in before else []
                added.append((east_m, north_m))
                path.extend(added)
                self._paths[name] = path
                new.setdefault(name, []).extend(added)
            self._estimated[picture.kind] = set(names)
        while len(self._paths) > _MAX_TRACKS:
            del self._paths[next(iter(self._paths))]
        return new
