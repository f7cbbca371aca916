"""A vehicle would turn back to where it was when its mission was planned, not when it got it."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.areas import ALABAMA
from helpers.runway import Field
from helpers.staging import S

from gcs.core.replanning.kept_routes import KeptRoutes
from gcs.core.separation.separation_state import Avoidance
from gcs.mavlink.frames.codec import decode
from gcs.model import NoticeCode, Order, Plan, Send
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.campaign.virtual_run import LINK, START_T_NS, VirtualRun
from sim_vehicles.world.scenario import parse_scenario

TWO_TARGETS = (
    'name = "held"\n'
    + ALABAMA
    + """\
boxes_m = [[450.0, 2000.0, 1000.0, 2100.0]]
[[agents]]
system_id = 1
east_m = 300.0
north_m = 1500.0
course_deg = 90.0
[[births]]
east_m = 2700.0
north_m = 1500.0
priority = 1
[[births]]
east_m = 725.0
north_m = 2700.0
[planning]
shape = "flyable"
[simulation]
forward_speed_m_s = 15.0
airframe = "banked"
[[simulation.targets]]
east_m = 2700.0
north_m = 1500.0
[[simulation.targets]]
east_m = 725.0
north_m = 2700.0
"""
)


def hold_by_pause(engine, until_s):
    engine.state.agents[1].tasking.retry.paused_until_t_ns = START_T_NS + until_s * S


def hold_by_window(engine, until_s):
    window = engine.state.tasking.windows[LINK]
    window.active = window.window if until_s else 0


@pytest.mark.parametrize("hold", [hold_by_pause, hold_by_window])
def test_a_route_that_waited_starts_where_the_vehicle_is_when_its_upload_begins(hold):
    """It flies on for 25 s, 375 m: the west end of the wall was nearer then, the east end is now."""
    effects, begun = [], []

    def on_effect(t_ns, effect):
        effects.append(effect)
        if isinstance(effect, Send) and any(m.get_type() == "MISSION_COUNT" for m in decode(effect.data)[0]):
            begun.append(t_ns)

    run = VirtualRun(parse_scenario(TWO_TARGETS, "held.toml"), 1, None, on_effect)
    run.run(20.0)
    hold(run.engine, 45)
    run.order(Order(run.t_ns, "ignore", "ignore", None, target=(0, 0)))
    run.run(45.0)
    assert len(begun) == 1
    hold(run.engine, 0)
    run.run(50.0)
    assert begun[1] >= START_T_NS + 45 * S
    mission = run.engine.state.agents[1].tasking.onboard
    assert mission is not None
    assert min(east_m for east_m, north_m in mission.route.points_m.tolist() if north_m < 2200.0) > 1000.0
    assert mission.route.is_same(run.engine.state.agents[1].routes.flown)
    last = [effect for effect in effects if isinstance(effect, Plan)][-1]
    assert (last.causes, last.changed) == (("upload waited",), (1,))


@pytest.mark.parametrize(
    ("is_low", "led_apart", "is_kept"), [(True, True, True), (False, True, False), (True, False, False)]
)
def test_a_vehicle_whose_late_mission_would_be_too_low_keeps_the_one_that_it_flies(
    is_low, led_apart, is_kept, monkeypatch
):
    """One flew 25 m above the ground: it had got its mission 5 s late, beyond the place to climb.

    Only what was to lead it apart from another one is dropped.
    """
    plans = []
    run = VirtualRun(
        parse_scenario(TWO_TARGETS, "held.toml"),
        1,
        on_effect=lambda _, effect: plans.append(effect) if isinstance(effect, Plan) else None,
    )
    run.run(20.0)
    agent = run.engine.state.agents[1]
    onboard = agent.tasking.onboard
    bend_m = agent.routes.flown.points_m[-1:] - [[200.0, 100.0]]
    agent.routes.flown = replace(
        onboard.route, points_m=np.vstack((bend_m, onboard.route.points_m[-1:])), wait_m=onboard.route.wait_m
    )
    agent.routes.layer_t_ns = run.t_ns if led_apart else 0
    hold_by_pause(run.engine, 30)
    run.engine.stages.tasking.enqueue_upload(agent.routes.flown, run.t_ns)
    monkeypatch.setattr(KeptRoutes, "is_low", lambda *_: is_low)
    run.run(34.0)
    late = [plan for plan in plans if "upload waited" in plan.causes]
    assert late[-1].changed == (() if is_kept else (1,))
    assert (agent.tasking.onboard is onboard) == is_kept
    assert agent.routes.flown.is_same(agent.tasking.onboard.route)
    assert run.engine.state.tasking.stage(1) == ""
    assert run.vehicles["vehicle:1"].autopilot.mode is Mode.AUTO


@pytest.mark.parametrize("held", [True, False])
def test_a_vehicle_that_holds_does_not_keep_a_mission_that_nobody_would_start_again(held):
    run = VirtualRun(parse_scenario(TWO_TARGETS, "held.toml"), 1)
    run.run(20.0)
    stages = run.engine.stages
    agent = run.engine.state.agents[1]
    if held:
        agent.separation.avoidance = Avoidance("agent 2", run.t_ns)
    inputs = stages.planning_inputs.build(run.t_ns, run.t_ns)
    expected = None if held else agent.tasking.onboard.route
    assert stages.replanner._flown_on(1, inputs) is expected


def test_a_take_off_that_waited_is_planned_again_when_its_turn_comes():
    field = Field((8.0, "hold"), (11.0, "arm"), (14.0, "resume"), ready=()).run(20.0)
    (waiting,) = [notice.vehicle for notice in field.noticed(NoticeCode.TAKEOFF_WAITS)]
    field.run(90.0)
    (again,) = [e for e in field.effects if isinstance(e, Plan) and "upload waited" in e.causes]
    assert again.changed == (waiting,)
