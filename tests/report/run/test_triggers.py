"""A report groups plans by what caused them: as plans tell it, and in older recordings as their words do."""

from typing import get_args

import pytest

from gcs.model import Cause, Plan
from gcs.report.run.triggers import COLOURS, count_by_trigger, triggers_of


def plan(reason: str, causes: tuple[Cause, ...] = ()) -> Plan:
    return Plan(0, 0, (), (), (), reason, (), causes)


def test_every_cause_has_a_row_of_its_own_colour() -> None:
    assert set(COLOURS) == {*get_args(Cause), "other"}
    assert len(set(COLOURS.values())) == len(COLOURS)


def test_what_a_plan_carries_counts_and_not_its_words() -> None:
    told = plan("keep-out agent 7 lost closed; agent 2 has had enough", ("map changed", "agent set aside"))
    assert triggers_of(told) == ("map changed", "agent set aside")


@pytest.mark.parametrize(
    ("reason", "causes"),
    [
        ("first plan", ("first plan",)),
        ("agent 2 lost; target 3.2 appeared", ("agent lost", "target appeared")),
        ("agent 2 is in RTL and left alone", ("agent set aside",)),
        ("agent 1 is held by order; agent 1 joined", ("agent set aside", "agent joined")),
        ("agent 2 has no route; target 0.0 lost", ("agent idle", "target lost")),
        ("agent 1 would hit an obstacle", ("agent in danger",)),
        ("agent 1 cannot get back on its route", ("agent in danger",)),
        ("agent 1 passed target 0.0", ("agent passed its target",)),
        ("target 0.0 moved 50 m; target 0.4 moved 93 m", ("target moved",)),
        ("plan 3 confirmed: target 0.0 moved 50 m", ("target moved",)),
        ("keep-out quarry closed", ("map changed",)),
        ("taken up again; agent 4 lost", ("taken up again", "agent lost")),
        ("words of nobody", ("other",)),
    ],
)
def test_recordings_without_causes_are_read_by_their_words(reason: str, causes: tuple[str, ...]) -> None:
    assert triggers_of(plan(reason)) == causes


def test_plans_are_counted_by_cause_the_most_frequent_first() -> None:
    told = [("agent lost", "target moved"), ("target moved",), ("first plan",)]
    assert count_by_trigger(told) == "2 target moved, 1 agent lost, 1 first plan"
    assert count_by_trigger([]) == ""
