"""An operator would read of an alarm that no program raises, or find none of one that it does."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from gcs.io.record_json import decode, encode
from gcs.model import Notice, NoticeCode
from gcs.planning.plan_notes import PlanNote
from gcs.report.alarms_page import alarms_page, sections

ROOT = Path(__file__).parent.parent
PLANNING = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "gcs" / "planning").rglob("*.py"))
RAISED = {NoticeCode[name] for name in re.findall(r"NoticeCode\.([A-Z_]+)", PLANNING)}
PLAN_NOTES = sorted({NoticeCode.NO_LAYER_LEFT, *(code for code in RAISED if code.level != "info")})
TABLE = ROOT / "gcs" / "model" / "notice_codes.py"


def test_the_page_is_made_from_the_table():
    page = (ROOT / "docs" / "alarms.md").read_text(encoding="utf-8")
    assert page == alarms_page(), "run: python -m gcs.report.alarms_page > docs/alarms.md"


def test_each_code_has_one_section():
    listed = [code for _, codes in sections() for code in codes]
    assert listed == list(NoticeCode)


def test_each_code_is_raised_somewhere():
    source = "".join(
        path.read_text(encoding="utf-8") for path in (ROOT / "gcs").rglob("*.py") if path != TABLE
    )
    raised = set(re.findall(r"NoticeCode\.([A-Z_]+)", source))
    assert set(NoticeCode.__members__) - raised == {"UNKNOWN"}


@pytest.mark.parametrize("code", list(NoticeCode))
def test_an_entry_is_whole(code):
    assert code.value == code.name.lower().replace("_", "-"), "a program that knows one knows the other"
    assert code.level == "info" or code.meaning
    for ended in code.ended:
        assert (ended.about, ended.by) == (code.about, code.by), "both are about the same subject"
        assert ended.level != "info"
        assert ended is not code


def test_optional_parts_are_left_out_with_their_parameters():
    about = {"phase": "en route", "lat_deg": 1.0, "lon_deg": 2.0, "causes": "", "target": "T0.1"}
    text = Notice(0, NoticeCode.CAME_DOWN, 513, about).line
    assert text.startswith(
        "agent 2:1: came down while en route, at 1.000000, 2.000000; its target T0.1 needs"
    )
    assert text.endswith("`gcs order ready --vehicle 2:1`")


@pytest.mark.parametrize(
    ("remedy", "codes"),
    [
        (
            "`gcs order resume --vehicle 1`",
            "overridden failsafe second-commander mission-differs mission-unread",
        ),
        ("`gcs order ready --vehicle 1`", "came-down landed"),
        ("`gcs order continue`", "targets-unattended"),
        ("--no-resume", "resumed"),
        ("order it again", "order-ended"),
        ("rder it to resume", "clearing-given-up station-upload-broken station-upload-mixed"),
        ("rder it again to ", "order-waits"),
        ("hold or return one, or let a pilot take it over", "comes-near separation-lost"),
        ("hold or return it", "zone-on-return"),
        ("hold it, or return it", "first-leg-still-wrong"),
        ("open the zone, return it, or let a pilot lead it out", "zone-entered"),
    ],
)
def test_a_text_names_what_the_operator_can_do(remedy, codes):
    for code in map(NoticeCode, codes.split()):
        assert remedy in Notice(0, code, 1 if code.about == "vehicle" else None).text


def test_a_line_names_its_vehicle_once():
    for code in NoticeCode:
        if code.about == "vehicle":
            assert Notice(0, code, 1).line.count("agent 1") == 1


def test_a_code_of_a_later_version_ends_no_reading_of_a_recording():
    payload = encode(Notice(0, NoticeCode.LINK_DOWN, 1, {"silence_s": 5.0})).replace(b"link-down", b"later")
    assert decode("test", payload, Notice).code is NoticeCode.UNKNOWN


def test_missing_and_wrong_parameters_are_shown_as_they_are():
    assert Notice(0, NoticeCode.LINK_DOWN, 1).text.startswith("link down: not heard for –")
    assert "not heard for hours" in Notice(0, NoticeCode.LINK_DOWN, 1, {"silence_s": "hours"}).text


def test_conditions_are_told_apart_by_what_the_table_says():
    first = Notice(0, NoticeCode.COMES_NEAR, 1, {"other": 2, "after_s": 20.0})
    again = Notice(9, NoticeCode.COMES_NEAR, 1, {"other": 2, "after_s": 9.0})
    third = Notice(9, NoticeCode.COMES_NEAR, 1, {"other": 3, "after_s": 9.0})
    over = Notice(20, NoticeCode.APART_AGAIN, 1, {"other": 2})
    assert first.key == again.key
    assert first.key in over.ended
    assert third.key not in over.ended


@pytest.mark.parametrize("code", PLAN_NOTES)
def test_each_condition_of_a_plan_has_an_end_of_its_own(code):
    note = PlanNote(code, 1 if code.about == "vehicle" else None, {"target": "T0.1", "vehicles": (1, 2)})
    over = note.over.at(9)
    assert over.ended == (note.key,)
    assert "–" not in over.text, "its text has all that it needs"


def test_a_verified_mission_ends_the_alarms_of_the_one_before():
    """After an order to resume a vehicle gets another mission, and the older one is not read back."""
    older = {"mission-unread", "mission-differs", "mission-changed", "mission-count-changed"}
    assert older <= set(NoticeCode.MISSION_VERIFIED.ends)
