"""Sensors that are late, or whose clock is wrong: the mission is flown, and no waypoint leaves the map."""

from dataclasses import replace

import msgspec
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.frames.codec import scan as frames_of
from gcs.model import NS_PER_S, AgentStatus, Effect, Event, MissionEnded, Notice, NoticeCode, Scan, Send
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import Scenario, load


def with_latency(name: str, delay_s: float) -> Scenario:
    scenario = load(name)
    sensor = msgspec.structs.replace(scenario.simulation.sensor, delay_s=delay_s)
    return replace(scenario, simulation=msgspec.structs.replace(scenario.simulation, sensor=sensor))


class ShiftedSensor(VirtualRun):
    """A run whose sensor's clock is off by `shift_s` from `from_s` on."""

    from_s = 40.0
    shift_s = 0.0

    def _step(self, event: Event) -> None:
        if isinstance(event, Scan) and event.t_ns >= START_T_NS + self.from_s * NS_PER_S:
            event = replace(event, measured_t_ns=event.measured_t_ns + round(self.shift_s * NS_PER_S))
        super()._step(event)


def is_false(agent: AgentStatus, run: VirtualRun) -> bool:
    return agent.status == "lost" and run.vehicles[f"vehicle:{agent.vehicle}"].alive


@pytest.mark.parametrize("name", ["deterministic", "prescribed", "random-obstacles", "random-targets"])
def test_a_mission_is_flown_with_a_sensor_that_is_three_seconds_late(name: str) -> None:
    false_losses, ended = [], []

    def on_effect(_t_ns: int, effect: Effect) -> None:
        if isinstance(effect, AgentStatus) and is_false(effect, run):
            false_losses.append(effect)
        elif isinstance(effect, MissionEnded):
            ended.append(effect)

    run = VirtualRun(with_latency(name, 3.0), 1, on_effect=on_effect)
    run.run()
    assert ended
    assert not false_losses


@pytest.mark.parametrize("shift_s", [-3600.0, -20.0, 20.0])
def test_a_sensors_clock_that_is_set_in_flight_costs_seconds_and_no_vehicle(shift_s: float) -> None:
    notices, false_losses, ended, outside = [], [], [], []
    scenario = load("prescribed")

    def on_effect(_t_ns: int, effect: Effect) -> None:
        if isinstance(effect, Notice):
            notices.append(effect)
        elif isinstance(effect, AgentStatus) and is_false(effect, run):
            false_losses.append(effect)
        elif isinstance(effect, MissionEnded):
            ended.append(effect)
        elif isinstance(effect, Send):
            for frame in frames_of(effect.data).frames:
                if frame.message_id == mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT:
                    item = frame.message()
                    east_m, north_m = scenario.frame.to_local(item.x * 1e-7, item.y * 1e-7)
                    if item.x and not (-50.0 <= east_m <= 2050.0 and -50.0 <= north_m <= 2050.0):
                        outside.append((east_m, north_m))

    run = ShiftedSensor(scenario, 1, on_effect=on_effect)
    run.shift_s = shift_s
    run.run()
    assert ended
    assert not false_losses
    assert not outside
    side = "behind" if shift_s < 0 else "ahead of"
    (alarm,) = [notice for notice in notices if notice.code is NoticeCode.SENSOR_CLOCK_OFF]
    assert (round(alarm.parameters["off_s"], 1), alarm.parameters["side"]) == (abs(shift_s), side)
