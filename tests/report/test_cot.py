"""A TAK user would see vehicles and targets in other places, as friends of another kind, or not at all."""

from __future__ import annotations

import dataclasses
import math
from datetime import datetime
from itertools import islice
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from msgspec.structs import replace

from gcs.config import load
from gcs.core.engine import Engine
from gcs.io.recording.reader import read
from gcs.model import AgentRecord, Notice, NoticeCode, Picture, Plan, SwarmStatus
from gcs.report.export.cot import CotEvents, CotStyle, Now
from gcs.report.export.mission_frame import MissionFrame

DEATH = Path(__file__).parents[1] / "recordings" / "death.mcap"
CONFIG = load("prescribed")
FRAME = MissionFrame.of(CONFIG)
NOW = Now(t_ns=60_000_000_000, unix_ns=1_800_000_000_000_000_000)
HOSTILE = '</remarks><event uid="x">&\x00\x1b[2J\u202e"'


@pytest.fixture
def cot() -> CotEvents:
    return CotEvents(CONFIG.name, FRAME, CotStyle(geoid_m=40.0))


def status_of(**fields: object) -> SwarmStatus:
    status = Engine(CONFIG, 1).stages.status_report.build(0)
    known = {"position_m": (300.0, 900.0), "alt_msl_m": 250.0, "heard_age_s": 0.4, "course_rad": 1.0,
             "ground_speed_m_s": 17.2, "battery_percent": 81}  # fmt: skip
    first: AgentRecord = replace(status.agents[0], **(known | fields))
    return replace(status, agents=(first, *status.agents[1:]))


def parsed(events: object) -> list[ElementTree.Element]:
    return [ElementTree.fromstring(event) for event in events]


def seconds_between(event: ElementTree.Element, first: str, last: str) -> float:
    return (
        datetime.fromisoformat(event.attrib[last]) - datetime.fromisoformat(event.attrib[first])
    ).total_seconds()


def test_a_vehicle_is_a_friendly_unmanned_aeroplane_where_it_reports(cot: CotEvents) -> None:
    (event,) = parsed(cot.vehicles(status_of(), NOW))  # the others were never heard
    assert event.attrib["type"] == "a-f-A-M-F-Q"
    assert event.attrib["uid"] == "swarm-gcs.prescribed.vehicle-1"
    point = event.find("point").attrib
    east_m, north_m = FRAME.local.to_local(float(point["lat"]), float(point["lon"]))
    assert (east_m, north_m) == pytest.approx((300.0, 900.0), abs=0.02)
    assert float(point["hae"]) == 290.0
    track = event.find("detail/track").attrib
    assert (float(track["course"]), float(track["speed"])) == (57.3, 17.2)
    assert event.find("detail/status").attrib["battery"] == "81"


def test_a_vehicle_that_is_not_heard_turns_stale(cot: CotEvents) -> None:
    (event,) = parsed(cot.vehicles(status_of(heard_age_s=40.0), NOW))
    assert event.attrib["time"] == "2027-01-15T08:00:00.000Z"
    assert seconds_between(event, "start", "time") == 40.0
    assert seconds_between(event, "start", "stale") == 15.0  # in the past: greyed out


def test_the_circle_of_a_target_is_one_sigma_of_its_longer_axis(cot: CotEvents) -> None:
    pictures = (record.value for record in read(DEATH, only=(Picture,)))
    (picture,) = islice((one for one in pictures if one.kind == "targets" and len(one.tracks) > 3), 1)
    now = Now(picture.scan_t_ns + 2_000_000_000, NOW.unix_ns)
    events = parsed(cot.targets(picture, now))
    shown = [track for track in picture.tracks if track.estimated]
    assert len(events) == len(shown) > 0
    for event, track in zip(events, shown, strict=True):
        assert event.attrib["type"] == "a-u-G"
        assert event.attrib["uid"].startswith("swarm-gcs.prescribed.target-T")
        point = event.find("point").attrib
        variances = np.linalg.eigvals(track.cov[:2, :2])
        assert float(point["ce"]) == pytest.approx(math.sqrt(max(variances)), abs=0.06)
        place = FRAME.local.to_local(float(point["lat"]), float(point["lon"]))
        assert place == pytest.approx(track.mean[:2], abs=0.02)
        assert seconds_between(event, "start", "time") == 2.0


def test_a_route_has_its_points_in_order_and_fits_into_a_datagram(cot: CotEvents) -> None:
    plan = next(record.value for record in read(DEATH, only=(Plan,)))
    for event, route in zip(parsed(cot.routes(plan.routes, NOW)), plan.routes, strict=True):
        assert event.attrib["type"] == "b-m-r"
        links = event.findall("detail/link")
        places = [tuple(map(float, link.attrib["point"].split(","))) for link in links]
        flown = [FRAME.local.to_local(lat_deg, lon_deg) for lat_deg, lon_deg, _ in places]
        assert np.allclose(flown, route.flown_m, atol=0.02)
        assert len({link.attrib["uid"] for link in links}) == len(links)
    points_m = np.column_stack((np.arange(5000.0), np.zeros(5000)))
    long = dataclasses.replace(plan.routes[0], points_m=points_m, wait_m=None, heights_msl_m=None)
    (event,) = list(cot.routes([long], NOW))
    assert len(event) < 60_000


def test_an_alarm_ends_with_its_condition(cot: CotEvents) -> None:
    list(cot.vehicles(status_of(), NOW))
    down = Notice(1, NoticeCode.LINK_DOWN, 1, {"silence_s": 5.1})
    again = Notice(2, NoticeCode.HEARD_AGAIN, 1, {"silence_s": 9.0})
    (alarm,) = parsed(cot.alarm(down, NOW))
    assert alarm.attrib["type"] == "b-a-o-tbl"
    assert alarm.find("detail/emergency").attrib["type"] == "911 Alert"
    assert alarm.find("detail/remarks").text == f"agent 1: {down.text}"
    point = alarm.find("point").attrib
    place = FRAME.local.to_local(float(point["lat"]), float(point["lon"]))
    assert place == pytest.approx((300.0, 900.0), abs=0.02)
    (end,) = parsed(cot.alarm(again, NOW))
    assert end.attrib["uid"] == alarm.attrib["uid"]
    assert end.attrib["type"] == "b-a-o-can"
    assert end.find("detail/emergency").attrib["cancel"] == "true"
    assert list(cot.alarm(again, NOW)) == []
    assert list(cot.alarm(Notice(3, NoticeCode.LINK_STALE, 1, {"silence_s": 2.6}), NOW)) == []  # a warning


def test_alarms_that_never_end_do_not_keep_later_ones_from_ending(cot: CotEvents) -> None:
    for number in range(1000):
        list(cot.alarm(Notice(1, NoticeCode.AUTOPILOT_ALARM, 1, {"said": f"text {number}"}), NOW))
    list(cot.alarm(Notice(1, NoticeCode.LINK_DOWN, 2, {"silence_s": 5.1}), NOW))
    assert len(list(cot.alarm(Notice(2, NoticeCode.HEARD_AGAIN, 2, {"silence_s": 9.0}), NOW))) == 1


def test_texts_from_outside_stay_texts(cot: CotEvents) -> None:
    notice = Notice(1, NoticeCode.AUTOPILOT_ALARM, 1, {"said": HOSTILE})
    (event,) = parsed(cot.alarm(notice, NOW))
    assert '</remarks><event uid="x">&' in event.find("detail/remarks").text
    assert len(event.findall("detail/*")) == 3
    (event,) = parsed(cot.vehicles(status_of(reason=HOSTILE, problems=(HOSTILE,)), NOW))
    text = event.find("detail/remarks").text
    assert "\x00" not in text
    assert "\u202e" not in text
