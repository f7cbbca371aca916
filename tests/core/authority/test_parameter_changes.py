"""Another station would switch off a failsafe in flight, and the operator would read "PARAM_SET"."""

from __future__ import annotations

import math

import pytest
from helpers.noticed import noticed
from helpers.other_station import AIR, SEAT, Stage
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.model import Notice, NoticeCode

REAL = dialect.MAV_PARAM_TYPE_REAL32
STATION = "system 254/190 at 10.0.1.1:9"
CODES = (
    NoticeCode.PARAMETER_SET,
    NoticeCode.PARAMETER_SET_WRONG,
    NoticeCode.PARAMETER_CHANGED,
    NoticeCode.PARAMETER_CHANGED_WRONG,
    NoticeCode.STATION_COMMANDS_ALL,
)
CHANGE = ("station", "name", "before", "value", "answer")


class Desk(Stage):
    """A vehicle, and a station that sets its parameters."""

    def set(self, name: str, value: float, target: int = 1) -> list[Notice]:
        message = dialect.MAVLink_param_set_message(target, 1, name.encode(), value, REAL)
        return self.notices(self.say(SEAT, message, peer="10.0.1.1:9"))

    def answer(self, name: str, value: float) -> list[Notice]:
        message = dialect.MAVLink_param_value_message(name.encode(), value, REAL, 100, 3)
        return self.notices(self.say(AIR, message, 1, 1))

    @staticmethod
    def notices(effects: list) -> list[Notice]:
        return noticed(effects, *CODES)


def change(notice: Notice) -> tuple[object, ...]:
    return tuple(notice.parameters[name] for name in CHANGE)


def test_each_change_of_another_station_is_told_with_name_old_and_new_value():
    desk = Desk()
    for number in range(20):
        desk.answer(f"SERVO{number}_TRIM", 1500.0)
    found = []
    for number in range(20):
        assert desk.set(f"SERVO{number}_TRIM", 1400.0 + number) == []
        desk.wait(0.05)
        found += desk.answer(f"SERVO{number}_TRIM", 1400.0 + number)
    assert [change(one) for one in found] == [
        (STATION, f"SERVO{number}_TRIM", "1500", f"{1400 + number}", "") for number in range(20)
    ]
    assert {(one.code, one.vehicle) for one in found} == {(NoticeCode.PARAMETER_SET, 1)}


@pytest.mark.parametrize(
    ("name", "before", "bad", "why"),
    [
        ("FS_LONG_ACTN", 1.0, 2.0, "glides into the ground"),
        ("FENCE_ENABLE", 1.0, 0.0, "nothing stops a vehicle"),
        ("SYSID_MYGCS", 255.0, 254.0, "another station's heartbeat"),
    ],
)
def test_a_value_that_preflight_would_not_accept_is_a_warning(name, before, bad, why):
    desk = Desk()
    desk.answer(name, before)
    desk.set(name, bad)
    (notice,) = desk.answer(name, bad)
    assert notice.code is NoticeCode.PARAMETER_SET_WRONG
    assert change(notice) == (STATION, name, f"{before:g}", f"{bad:g}", "")
    assert why in notice.parameters["problem"]
    desk.wait(11.0)
    desk.set(name, before)
    (back,) = desk.answer(name, before)
    assert back.code is NoticeCode.PARAMETER_SET


def test_a_change_without_an_answer_and_one_that_the_vehicle_refused_are_told_as_such():
    desk = Desk()
    desk.set("THR_FAILSAFE", 0.0)
    assert desk.notices(desk.wait(2.0)) == []
    (notice,) = desk.notices(desk.wait(1.1))
    assert notice.code is NoticeCode.PARAMETER_SET_WRONG
    assert change(notice) == (STATION, "THR_FAILSAFE", "an unknown value", "0", "has not confirmed it")
    desk.answer("NAVL1_PERIOD", 15.0)
    desk.set("NAVL1_PERIOD", 2.0)
    (notice,) = desk.answer("NAVL1_PERIOD", 15.0)
    assert notice.code is NoticeCode.PARAMETER_SET
    assert notice.parameters["answer"] == "answers 15"


def test_a_parameter_that_changes_all_the_time_is_told_every_ten_seconds_with_its_newest_value():
    desk, found = Desk(), []
    for number in range(200):
        desk.set("TRIM_THROTTLE", float(number))
        found += desk.answer("TRIM_THROTTLE", float(number))
        found += desk.notices(desk.wait(0.1))
    found += desk.notices(desk.wait(10.0))
    assert 2 <= len(found) <= 4
    assert found[-1].parameters["value"] == "199"


def test_repeated_frames_and_values_that_stay_are_not_told():
    desk = Desk()
    desk.answer("FENCE_ENABLE", 1.0)
    for _ in range(5):
        desk.set("FENCE_ENABLE", 1.0)
        assert desk.answer("FENCE_ENABLE", 1.0) == []
        assert desk.notices(desk.wait(5.0)) == []


def test_a_value_for_all_vehicles_is_told_for_the_vehicle_that_takes_it():
    desk = Desk()
    desk.answer("FENCE_ENABLE", 1.0)
    (broadcast,) = desk.set("FENCE_ENABLE", 0.0, target=0)
    assert broadcast.parameters["message"] == "PARAM_SET"
    (notice,) = desk.answer("FENCE_ENABLE", 0.0)
    assert (notice.code, notice.vehicle) == (NoticeCode.PARAMETER_SET_WRONG, 1)


def test_a_safety_parameter_that_is_set_over_another_link_is_told():
    desk = Desk()
    desk.answer("FENCE_ENABLE", 1.0)
    desk.answer("STAT_RUNTIME", 100.0)
    assert desk.answer("STAT_RUNTIME", 130.0) == []
    (notice,) = desk.answer("FENCE_ENABLE", 0.0)
    assert notice.code is NoticeCode.PARAMETER_CHANGED_WRONG
    assert (notice.parameters["name"], notice.parameters["before"]) == ("FENCE_ENABLE", "1")
    assert notice.parameters["value"] == "0"
    assert desk.answer("FENCE_ENABLE", 0.0) == []


def test_a_safety_parameter_that_stays_no_number_is_told_once():
    desk = Desk()
    desk.answer("FENCE_ENABLE", 1.0)
    (notice,) = desk.answer("FENCE_ENABLE", math.nan)
    assert notice.level == "warning"
    for _ in range(3):
        desk.wait(11.0)
        assert desk.answer("FENCE_ENABLE", math.nan) == []


def test_a_flood_of_names_is_bounded():
    desk = Desk()
    for number in range(2000):
        desk.set(f"X{number}", 1.0)
        desk.answer(f"Y{number}", 1.0)
    parameters = desk.engine.state.agents[1].authority.parameters
    assert len(parameters.sets) <= 500
    for number in range(20_000):
        desk.answer(f"Z{number}", 1.0)
    assert len(parameters.values) <= 10_000
