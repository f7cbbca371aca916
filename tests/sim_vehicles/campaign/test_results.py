"""Figures of a campaign: intervals hold what they promise; loss detection is compared with the truth."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.model import NS_PER_S, AgentStatus, Picture, Track, Truth, TruthObject, read_only
from sim_vehicles.campaign.loss_detection import LossWatch
from sim_vehicles.campaign.results import Row, groups, mean, proportion, rate


def row(**changes: object) -> Row:
    values = {
        "digest": "", "scenario": "s", "value": "", "planner": "own", "seed": 1, "outcome": "complete",
        "reason": "", "duration_s": 100.0, "agents": 4, "arrived": 3, "lost": 1, "targets_total": 3,
        "targets_reached": 3, "losses_detected_after_s": [2.0], "false_losses": 0, "revivals": 0,
        "plain_losses_detected_after_s": [1.0], "plain_false_losses": 1, "plain_revivals": 2, "losses": 1,
        "agent_hours": 0.1, "ospa_agents_m": 2.0, "ospa_targets_m": None, "retasks": 3, "uploads": 7,
        "upload_failures": 0,
    }  # fmt: skip
    return Row(**{**values, **changes})


def test_intervals_are_those_of_the_textbooks():
    wilson = proportion(8, 10)
    assert (wilson.value, round(wilson.low, 3), round(wilson.high, 3)) == (0.8, 0.490, 0.943)
    none = rate(0, 2.0)
    assert (none.value, none.low) == (0.0, 0.0)
    assert none.high == pytest.approx(3.689 / 2.0, abs=1e-3)
    few = rate(3, 1.0)
    assert (few.low, few.high) == pytest.approx((0.6187, 8.7673), abs=1e-3)
    student = mean([1.0, 2.0, 3.0, None, math.nan], least=-math.inf)
    assert mean([1.0, 2.0, 3.0]).low == 0.0  # nothing that is counted is below nothing
    assert (student.low, student.high) == pytest.approx((2.0 - 2.4841, 2.0 + 2.4841), abs=1e-3)


def test_what_was_not_measured_is_no_number():
    assert math.isnan(proportion(0, 0).value)
    assert math.isnan(rate(0, 0.0).value)
    assert math.isnan(mean([None]).value)
    assert math.isnan(mean([1.0]).low)


@given(st.integers(0, 50), st.integers(1, 50))
def test_a_share_lies_within_its_interval_and_that_within_0_and_1(successes: int, more: int):
    share = proportion(successes, successes + more)
    assert 0.0 <= share.low <= share.value <= share.high <= 1.0


def test_the_time_that_trackers_cost_is_taken_in_pairs_of_one_world():
    rows = [
        row(seed=1, duration_s=110.0), row(seed=2, duration_s=220.0), row(seed=3, duration_s=50.0),
        row(seed=1, duration_s=100.0, planner="truth"), row(seed=2, duration_s=200.0, planner="truth"),
        row(seed=3, duration_s=400.0, planner="truth", outcome="incomplete"),
    ]  # fmt: skip
    own, truth = groups(rows)
    assert own.extra_time.value == pytest.approx(0.1)
    assert truth.extra_time.value == 0.0
    assert (own.missions, own.losses, own.plain_revivals) == (3, 3, 6)
    assert own.false_losses_per_h.value == 0.0
    assert own.plain_false_losses_per_h.value == pytest.approx(3 / 0.3)


def test_rows_survive_being_written():
    assert msgspec.json.decode(msgspec.json.encode(row()), type=Row) == row()


def picture(k: int, *tracks: tuple[tuple[int, int], float, float]) -> Picture:
    shown = tuple(
        Track(
            label,
            read_only([east, 0.0, 0.0, 0.0]),
            read_only(np.eye(4)),
            existence,
            estimated=existence > 0.5,
        )
        for label, east, existence in tracks
    )
    return Picture(k * NS_PER_S, k * NS_PER_S, "agents", shown, read_only([1.0]))


def watch(alive: str, existence: list[float], statuses: dict[int, str]) -> LossWatch:
    """One agent at 0 m: alive or dead at each second, the existence of its track, command's calls."""
    losses = LossWatch()
    for k, (state, value) in enumerate(zip(alive, existence, strict=True)):
        losses.add_truth(Truth(k * NS_PER_S, (TruthObject("agents", 1, 0.0, 0.0, state == "a"),)))
        losses.add_effect(picture(k, ((0, 1), 3.0, value), ((0, 2), 500.0, 1.0)))
        if k in statuses:
            losses.add_effect(AgentStatus(k * NS_PER_S, 1, statuses[k]))
    return losses


def test_a_clutter_point_revives_a_lost_agent_by_the_plain_rule_only():
    losses = watch("aaadddd", [1.0, 1.0, 1.0, 0.6, 0.2, 0.7, 0.1], {5: "lost"})
    assert (losses.plain().delays_s, losses.plain().revivals) == ((1.0,), 1)
    assert (losses.ours().delays_s, losses.ours().revivals) == ((2.0,), 0)
    assert losses.losses == 1
    assert losses.agent_hours == pytest.approx(2 / 3600)


def test_a_missed_detection_kills_the_living_for_the_plain_rule_only():
    losses = watch("aaaaa", [0.1, 1.0, 0.3, 0.4, 1.0], {})
    assert (losses.plain().false_losses, losses.plain().revivals) == (1, 0)
    assert losses.ours().false_losses == 0


def test_false_calls_of_central_command_are_counted():
    losses = watch("aaadd", [1.0] * 5, {1: "lost", 2: "active", 4: "lost"})
    assert (losses.ours().false_losses, losses.ours().delays_s) == (1, (1.0,))


def test_a_loss_after_arrival_is_not_counted():
    losses = watch("aaadd", [1.0, 1.0, 0.9, 0.1, 0.1], {2: "arrived"})
    assert losses.losses == 0
    assert losses.plain().delays_s == ()
