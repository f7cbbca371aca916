"""Notices among effects, found by their codes: what a notice says may be reworded."""

from __future__ import annotations

from collections.abc import Iterable

from gcs.model import Notice, NoticeCode


def noticed(effects: Iterable[object], *codes: NoticeCode) -> list[Notice]:
    """Return the notices with one of these codes, in their order."""
    return [effect for effect in effects if isinstance(effect, Notice) and effect.code in codes]


def alarms(effects: Iterable[object], vehicle: int | None = None) -> list[Notice]:
    """Return the alarms, of one vehicle or of all."""
    found = [effect for effect in effects if isinstance(effect, Notice) and effect.level == "alarm"]
    return [notice for notice in found if vehicle in (None, notice.vehicle)]
