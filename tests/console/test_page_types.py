"""The page or a program would read fields that the server does not send."""

from __future__ import annotations

import json
import time
from typing import Any

import msgspec
import pytest
from helpers.page_types import TARGET, page_types

from gcs.console.view.page_records import (
    ChartsReply,
    FeedMessage,
    MarksReply,
    PlanReply,
    PreflightReply,
    Sections,
    VehicleDetail,
)
from gcs.model import SwarmStatus, read_only

REPLIES = {
    "status": SwarmStatus,
    "plan": PlanReply,
    "vehicles/1": VehicleDetail,
    "preflight": PreflightReply,
    "marks": MarksReply,
    "charts": ChartsReply,
}


def decoded(content: bytes | str, kind: Any) -> Any:
    return msgspec.json.decode(content, type=kind, dec_hook=lambda _, value: read_only(value))


def test_the_types_of_the_page_are_those_of_the_records() -> None:
    assert TARGET.read_text(encoding="utf-8") == page_types()


def test_a_section_of_the_feed_that_no_record_has_is_noticed() -> None:
    with pytest.raises(msgspec.ValidationError, match="unknown field `extra`"):
        decoded(b'{"type": "update", "extra": 1}', FeedMessage)


def test_what_pages_and_programs_get_are_the_records(fly, launch) -> None:
    with fly() as flight, flight.page() as page:
        launch(flight)
        zone = {"name": "a", "circle": [700, 500, 60]}
        flight.request("/api/orders", {"action": "no-fly-zone", "no_fly_zone": zone})
        seen: set[str] = set()
        of_scans = {"scans", "agents_tracks", "targets_tracks", "fields_of_view"}
        wanted = set(Sections.__struct_fields__) - of_scans
        until_s = time.monotonic() + 20.0
        while not wanted <= seen and time.monotonic() < until_s:
            message = page.recv(timeout=5.0)
            decoded(message, FeedMessage)
            seen |= json.loads(message).keys()
        assert wanted <= seen
        for name, kind in REPLIES.items():
            code, body, _ = flight.request(f"/api/{name}")
            assert code == 200
            decoded(body, kind)
