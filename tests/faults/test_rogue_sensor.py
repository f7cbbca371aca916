"""A user would believe one sensor that lies: a crashed agent would fly on in the picture for ever."""

from __future__ import annotations

import numpy as np
from helpers.noticed import noticed

from gcs.model import NS_PER_S, AgentStatus, Effect, NoticeCode, Scan, Sensor, read_only
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import load

CRASHED, CRASH_S = 2, 50.0


def test_a_crashed_agent_that_one_sensor_claims_to_see_is_lost_with_an_alarm_that_names_the_sensor():
    effects: list[Effect] = []
    run = VirtualRun(load("prescribed"), 1, on_effect=lambda _t_ns, effect: effects.append(effect))
    run.run(CRASH_S - 0.5)
    wreck = next(one for one in run.vehicles.values() if one.system_id == CRASHED)
    place = np.array([wreck.east_m, wreck.north_m])
    run.run(CRASH_S - 0.3)
    velocity = (np.array([wreck.east_m, wreck.north_m]) - place) / 0.2
    rogue = Sensor("rogue", 0.99, 1e-9, read_only(np.eye(2)), (-200.0, -200.0, 2200.0, 2200.0))
    for tenth in range(5, 105):
        t_s = 0.1 * tenth
        run.run(CRASH_S - 0.5 + t_s)
        others = [[v.east_m, v.north_m] for v in run.vehicles.values() if v.alive and v is not wreck]
        z = read_only([*others, place + velocity * t_s])
        run._step(Scan(run.t_ns, run.t_ns, rogue, z))
    lost = [one for one in effects if isinstance(one, AgentStatus) and one.status == "lost"]
    assert [one.vehicle for one in lost] == [CRASHED]
    assert 5.0 < (lost[0].t_ns - START_T_NS) / NS_PER_S - CRASH_S < 9.0
    [alarm] = [
        one
        for one in noticed(effects, NoticeCode.SENSORS_CONTRADICT)
        if (one.subject, one.parameters["kind"]) == ("radar", "agent")
    ]
    assert alarm.parameters["other"] == "rogue"


def test_two_radars_and_a_camera_that_say_the_truth_contradict_each_other_nowhere():
    effects: list[Effect] = []
    VirtualRun(load("radars"), 3, on_effect=lambda _t_ns, effect: effects.append(effect)).run(300.0)
    assert [one.vehicle for one in effects if isinstance(one, AgentStatus) and one.status == "lost"] == [2]
    assert noticed(effects, NoticeCode.SENSORS_CONTRADICT) == []
