"""A user would not learn that a sensor lies, or would be alarmed by sensors that say the truth."""

from __future__ import annotations

import numpy as np
from helpers.noticed import noticed
from helpers.staging import S, track

from gcs.core.perception.sensor_contradictions import SensorContradictions
from gcs.model import NoticeCode, Scan, Sensor, read_only

CONTRADICT, AGREE = NoticeCode.SENSORS_CONTRADICT, NoticeCode.SENSORS_AGREE
WHOLE = (0.0, 0.0, 2000.0, 2000.0)
THERE = (1000.0, 500.0)
LABEL = (3, 1)


class Sky:
    """One agent track, and sensors with a scan a second that detect it or not."""

    def __init__(self, place=THERE):
        self.track = track(LABEL, place)
        self.contradictions = SensorContradictions()
        self.t_s = 0
        self.notices = []

    def second(self, field=WHOLE, p_d=0.9, **detects):
        """Process a scan of each sensor; True: it detects the agent."""
        self.t_s += 1
        for name, is_hit in detects.items():
            detector = Sensor(name, p_d, 4e-6, read_only(np.eye(2) * 10.0), field)
            z = np.reshape(self.track.mean[:2] if is_hit else [], (-1, 2))
            scan = Scan(self.t_s * S, self.t_s * S, detector, read_only(z))
            self.contradictions.update("agents", scan, [self.track], [self.track])
            self.notices += self.contradictions.notices(self.t_s * S, [("agents", self.track)])

    def seconds(self, n, **detects):
        for _ in range(n):
            self.second(**detects)


def test_a_sensor_that_misses_what_another_one_sees_is_named_with_it_and_the_place():
    sky = Sky()
    sky.seconds(7, radar=True, rogue=False)
    assert sky.notices == []
    sky.second(radar=True, rogue=False)
    [alarm] = noticed(sky.notices, CONTRADICT)
    assert (alarm.subject, alarm.parameters["other"]) == ("rogue", "radar")
    assert (alarm.parameters["east_m"], alarm.parameters["north_m"]) == THERE
    assert alarm.parameters["kind"] == "agent"


def test_the_alarm_is_raised_once_and_ends_when_both_see_the_object_again():
    sky = Sky()
    sky.seconds(30, radar=True, rogue=False)
    assert len(sky.notices) == 1
    sky.seconds(12, radar=True, rogue=True)
    [begin, end] = sky.notices
    assert end.code is AGREE
    assert end.ended == (begin.key,)


def test_the_alarm_ends_after_the_operator_has_stopped_one_of_the_sensors():
    for kept, is_hit in (("radar", True), ("rogue", False)):
        sky = Sky()
        sky.seconds(10, radar=True, rogue=False)
        if kept == "rogue":  # nothing else sees the object: its track ends
            sky.track = track((9, 9), (10.0, 10.0))
        sky.seconds(22, **{kept: is_hit})
        assert [one.code for one in sky.notices] == [CONTRADICT, AGREE], kept


def test_sensors_with_the_misses_that_they_announce_raise_no_alarm():
    rng = np.random.default_rng(5)
    sky = Sky()
    for _ in range(3000):
        sky.second(radar=rng.random() < 0.9, camera=rng.random() < 0.9, p_d=0.9)
        sky.second(radar=rng.random() < 0.5, camera=rng.random() < 0.5, p_d=0.5)
    assert sky.notices == []


def test_what_a_sensor_does_not_cover_up_to_the_edge_of_its_view_it_does_not_miss():
    for field in ((0.0, 0.0, 900.0, 2000.0), (0.0, 0.0, 1005.0, 2000.0)):
        sky = Sky()
        for _ in range(30):
            sky.second(radar=True)
            sky.second(field, camera=False)
        assert sky.notices == []
        assert sky.contradictions.seen_by_one("agents") == set()


def test_an_object_that_ends_is_missed_by_all_and_no_contradiction():
    sky = Sky()
    sky.seconds(20, radar=True, camera=True)
    sky.seconds(30, radar=False, camera=False)
    assert sky.notices == []


def test_a_track_has_a_seen_by_one_until_a_second_sensor_sees_it():
    sky = Sky()
    sky.seconds(20, rogue=True)
    assert sky.contradictions.seen_by_one("agents") == set()
    sky.seconds(8, rogue=True, radar=False)
    assert sky.contradictions.seen_by_one("agents") == {LABEL}
    sky.second(rogue=True, radar=False, camera=True)
    assert sky.contradictions.seen_by_one("agents") == set()
    sky.second(rogue=True, radar=True)
    assert sky.contradictions.seen_by_one("agents") == set()
