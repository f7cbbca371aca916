"""How the service selects a mission in flight decides how its first leg is flown; here it is flown."""

from __future__ import annotations

import pytest

from gcs.mavlink.mission import _upload_actions
from gcs.mavlink.services import command_sender
from gcs.model import AgentStatus, Notice, NoticeCode
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.vehicle.guidance import ToPoint
from sim_vehicles.world.scenario import load


def by_one_command(vehicle, profile, item):
    """As the service selected once: DO_SET_MISSION_CURRENT, sent once."""
    return command_sender.command_long(vehicle, 224, max(item, profile.home_items))


def flown(seed, seconds=300.0):
    """Fly `prescribed`; return the largest cross-track error in metres, notices of first legs, arrivals."""
    notices, arrived, most_m = [], set(), 0.0

    def keep(_t_ns, effect):
        if isinstance(effect, Notice) and effect.code is NoticeCode.FIRST_LEG_WRONG:
            notices.append(effect.code)
        elif isinstance(effect, AgentStatus) and effect.status == "arrived":
            arrived.add(effect.vehicle)

    run = VirtualRun(load("prescribed"), seed, on_effect=keep)
    t_s = run.run(10.0)
    while not run.ended and t_s < seconds:
        t_s = run.run(t_s + 0.5)
        for vehicle in run.vehicles.values():
            goal = vehicle.autopilot.goal
            if vehicle.alive and isinstance(goal, ToPoint):
                most_m = max(most_m, abs(goal.cross_track_m(vehicle.airframe)))
    return most_m, notices, arrived


def test_re_tasked_vehicles_stay_near_the_lines_of_their_missions():
    most_m, notices, arrived = flown(1)
    assert most_m < 60.0
    assert not notices
    assert arrived == {1, 3, 4}


def test_a_command_sent_once_starts_first_legs_hundreds_of_metres_off_with_a_notice(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(_upload_actions, "set_current_item", by_one_command)
    most_m, notices, _ = flown(3)
    assert most_m > 200.0
    assert notices
