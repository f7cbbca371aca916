"""A program would be written for fields and keys that are not sent."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import get_args

from helpers.messages_page import fields, messages_page

from gcs.io.record_json import encode_shown
from gcs.model import Effect, Notice, NoticeCode, Send

PAGE = Path(__file__).parents[1] / "docs" / "messages.md"
TEXT = PAGE.read_text(encoding="utf-8")


def test_the_page_is_what_the_records_say() -> None:
    assert messages_page() == TEXT, "run: python tests/helpers/messages_page.py > docs/messages.md"


def test_every_effect_that_is_published_is_a_section() -> None:
    titles = re.findall(r"^### (\w+)$", TEXT, re.MULTILINE)
    assert len(titles) == len(set(titles)) > 50
    assert {one.__name__ for one in get_args(Effect) if one is not Send} <= set(titles)


def test_a_notice_is_described_as_it_is_sent() -> None:
    notice = Notice(1, NoticeCode.PLAN_MADE, None, {"reason": "first plan", "routes": ""})
    assert set(json.loads(encode_shown(notice))) == {one.name for one in fields(Notice)}
