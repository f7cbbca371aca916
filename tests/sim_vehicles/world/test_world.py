"""A user would lose the yardstick: a truth that is not what the sensor saw, or not when."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs.model import NS_PER_S, TruthObject
from sim_vehicles.autopilots.mission_protocol import NEVER_NS
from sim_vehicles.world.scenario import load
from sim_vehicles.world.world import World

START = 1_767_225_600 * NS_PER_S
AGENTS = [
    TruthObject("agents", 3, 300.0, 100.0, True),
    TruthObject("agents", 1, 100.0, 100.0, True),
    TruthObject("agents", 2, 200.0, 100.0, False),
]


def test_scans_come_at_the_sensors_period_from_the_start_on() -> None:
    world = World(load("prescribed"), 0, START)
    assert [world.scan_t_ns(i) for i in (0, 1, 600)] == [START, START + NS_PER_S, START + 600 * NS_PER_S]


def test_the_truth_lists_everything_also_lost_and_unborn_objects() -> None:
    world = World(load("random-targets"), 4, START)
    truth = world.truth(START, AGENTS)
    assert [(t.kind, t.id) for t in truth.objects] == [("agents", v) for v in (1, 2, 3)] + [
        ("targets", i) for i in range(5)
    ]
    assert [t.alive for t in truth.objects[:3]] == [True, False, True]
    appears = {target.id: target.appears_s for target in world.targets}
    assert max(appears.values()) > 0.0
    for t_s in (0.0, 7.0, 13.0, 20.0):
        things = world.truth(START + round(t_s * NS_PER_S), AGENTS).objects
        alive = {thing.id for thing in things if thing.kind == "targets" and thing.alive}
        assert alive == {i for i, appears_s in appears.items() if appears_s <= t_s}


def test_the_order_of_agents_does_not_matter() -> None:
    world = World(load("prescribed"), 0, START)
    one, other = (world.truth(START, agents) for agents in (AGENTS, AGENTS[::-1]))
    assert one == other
    assert np.array_equal(world.scan(5, one).z_m, world.scan(5, other).z_m)


def test_targets_are_where_their_velocity_took_them_since_the_start_of_the_run() -> None:
    world, t_s = World(load("prescribed"), 0, START), 20.0
    truth = world.truth(START + round(t_s * NS_PER_S), [])
    for thing, target in zip(truth.objects, world.targets, strict=True):
        assert thing.east_m == target.east_m + t_s * target.v_east_m_s
        assert thing.north_m == target.north_m + t_s * target.v_north_m_s


def test_a_world_that_waits_stands_until_it_moves() -> None:
    began = START + 50 * NS_PER_S
    waiting, at_once = (
        World(load("random-targets"), 4, START, NEVER_NS),
        World(load("random-targets"), 4, START),
    )
    standing = waiting.truth(START + 60 * NS_PER_S, AGENTS)
    assert standing.objects == at_once.truth(START, AGENTS).objects
    waiting.moves_from_t_ns = began
    for t_s in (0, 7, 20):
        late = waiting.truth(began + t_s * NS_PER_S, AGENTS)
        assert late.objects == at_once.truth(START + t_s * NS_PER_S, AGENTS).objects
    assert [waiting.scan_t_ns(i) for i in (0, 1)] == [START, START + NS_PER_S]  # scans go on meanwhile


def test_a_run_that_starts_at_another_time_is_the_same_world() -> None:
    early, late = (World(load("random-targets"), 4, start) for start in (START, START + 10**15))
    for index in (0, 12):
        truths = [world.truth(world.scan_t_ns(index), AGENTS) for world in (early, late)]
        assert truths[0].objects == truths[1].objects
        scans = [world.scan(index, truth) for world, truth in zip((early, late), truths, strict=True)]
        assert np.array_equal(scans[0].z_m, scans[1].z_m)
        assert scans[1].measured_t_ns - scans[0].measured_t_ns == 10**15


def test_each_scan_has_noise_of_its_own_though_nothing_moved() -> None:
    world = World(load("deterministic"), 0, START)
    truth = world.truth(START, AGENTS)
    assert not np.array_equal(world.scan(0, truth).z_m, world.scan(1, truth).z_m)


def test_an_agents_loss_changes_no_detection_of_targets() -> None:
    world = World(load("prescribed"), 0, START)
    for index in range(30):
        t_ns = world.scan_t_ns(index)
        lost = [replace(agent, alive=False) for agent in AGENTS]
        before, after = (world.scan(index, world.truth(t_ns, agents)).z_m for agents in (AGENTS, lost))
        assert {tuple(z) for z in after.tolist()} <= {tuple(z) for z in before.tolist()}
        assert len(before) - len(after) <= 2
