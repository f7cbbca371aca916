"""What is wrong with a file of an elevation model."""

from __future__ import annotations

from gcs.errors import GcsError


class TerrainFileError(GcsError):
    """A file of an elevation model cannot be used; its text continues "davos.tif: ..."."""
