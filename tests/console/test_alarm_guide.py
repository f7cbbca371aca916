"""An operator in the field, without internet, would not find what an alarm means."""

from __future__ import annotations

import re

from gcs.console.web.alarm_guide import page
from gcs.model import NoticeCode


def test_each_code_has_an_entry_with_its_own_anchor() -> None:
    anchors = re.findall('<tr id="(.*?)"', page())
    assert anchors == [code.value for code in NoticeCode]


def test_an_entry_says_what_to_do() -> None:
    (row,) = re.findall('<tr id="link-down">(.*?)</tr>', page())
    assert f"<code>{NoticeCode.LINK_DOWN.text.replace('{silence_s:.1f}', '…')}</code>" in row
    assert NoticeCode.LINK_DOWN.action in row


def test_the_page_needs_no_other_page(fly) -> None:
    with fly() as flight:
        code, body, _ = flight.request("/alarms")
        assert code == 200
        text = body.decode()
        assert "<a " not in text
        for path in re.findall('(?:href|src)="(/.*?)"', text):
            assert flight.request(path)[0] == 200
