"""An operator in the field, without internet, would not find what an alarm means."""

from __future__ import annotations

import re

import pytest

from gcs.console.web.alarm_guide import link_of, page


@pytest.mark.parametrize(
    ("text", "entry"),
    [
        ("agent 3: link down: not heard for 5 s", "alarm <code>link down: not heard for … s</code>"),
        ("agent 2:17: not heard for 2.5 s", "warning <code>not heard for … s</code>"),
        ("agent 2: lost", "alarm <code>lost</code> (of an agent)"),
        ("no scan of sensor radar for 5 s: is the sensor there?", "no scan of sensor … for … s: is"),
        ("zenoh: accepts no output for 3 s", "warning <code>zenoh:</code>"),
        ("journal: accepts no output for 3 s", "alarm <code>journal:</code> <code>accepts"),
    ],
)
def test_an_alarm_leads_to_its_own_entry(text: str, entry: str) -> None:
    anchor = link_of(text).partition("#")[2]
    (row,) = re.findall(f'<tr id="{anchor}"><td>(.*?)</td>', page())
    assert entry in row


def test_a_message_of_an_autopilot_leads_to_what_such_messages_are() -> None:
    path, _, anchor = link_of("agent 3: GPS <b>lost</b>").partition("#")
    assert path == "/alarms"
    assert f'<p id="{anchor}">Autopilots' in page()


def test_each_entry_has_an_anchor_of_its_own() -> None:
    anchors = re.findall(' id="(.*?)"', page())
    assert len(anchors) > 100
    assert len(anchors) == len(set(anchors))


def test_the_page_needs_no_other_page(fly) -> None:
    with fly() as flight:
        code, body, _ = flight.request("/alarms?about=agent%202:%20lost")  # a redirect is followed
        assert code == 200
        text = body.decode()
        assert "# Alarms" not in text
        assert {link[:1] for link in re.findall('<a href="(.*?)"', text)} <= {"#"}
        for path in re.findall('(?:href|src)="(/.*?)"', text):
            assert flight.request(path)[0] == 200
