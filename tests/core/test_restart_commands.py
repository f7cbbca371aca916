"""A restarted service would fly a vehicle that a pilot has taken over, or arm one minutes after the order."""

from __future__ import annotations

from typing import Any

import pytest
from helpers.noticed import noticed
from helpers.ordered_flight import SEED, flight_with_a_restart, flown, load, order
from helpers.staging import S
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.operator.operator_state import Command, OrderInProgress
from gcs.core.snapshot import decode_state, encode_state
from gcs.mavlink.frames.codec import decode as decode_frames
from gcs.mavlink.services.command_sender import CommandSender, command_long, set_mode
from gcs.model import Effect, NoticeCode, OrderAnswer, Send, Snapshot
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun


@pytest.mark.parametrize("outage_s", [2.0, 30.0])
def test_nothing_is_commanded_to_a_vehicle_before_it_is_heard_again(outage_s: float) -> None:
    """A pilot may have taken over while an upload, or its command to fly in AUTO, was on its way."""
    first = VirtualRun(load("prescribed"), SEED)
    while not first.engine.state.tasking.uploads:
        first.run((first.t_ns - START_T_NS) / S + 0.05)
    for begun_s in (0.1, 0.3, 0.5, 0.8):
        at_s = (first.t_ns - START_T_NS) / S + begun_s

        def taken_over(run: VirtualRun) -> None:
            run.vehicles["vehicle:3"].autopilot.set_mode(Mode.FBWA)

        flight = flight_with_a_restart(at_s, outage_s, at_s + outage_s + 20.0, meanwhile=taken_over)
        assert flight.mode(3) is Mode.FBWA
        modes = [m for m in flight.messages_to(3, at_s + 0.01, at_s + outage_s + 20.0) if is_mode(m)]
        assert modes == []


def is_mode(message: Any) -> bool:
    return message.get_type() == "COMMAND_LONG" and message.command == dialect.MAV_CMD_DO_SET_MODE


def after_an_order(action: str, sender: CommandSender, outage_s: float) -> tuple[VirtualRun, list[Effect]]:
    """Return a flight whose service was killed with a command to vehicle 2 in progress."""
    run = flown(load("prescribed"), 20.0).run
    state = decode_state("test", run.snapshot().data)
    number = state.operator.begin(OrderInProgress(order(19.9, action, 2), (2,)))
    state.agents[2].orders.command = Command(sender, number, state.operator.orders[number].order.action)
    effects: list[Effect] = []
    run.on_effect = lambda _, effect: effects.append(effect)
    run.restart(outage_s, Snapshot(run.t_ns, encode_state(state)))
    run.run(32.0 + outage_s)
    return run, effects


@pytest.mark.parametrize("outage_s", [1.0, 120.0])
def test_an_order_to_arm_ends_with_the_service(outage_s: float) -> None:
    """Sent again minutes later, it would start propellers beside people."""
    request = command_long(2, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
    _, effects = after_an_order("arm", CommandSender.begin(request, START_T_NS, armed=True), outage_s)
    sent = [m for e in effects if isinstance(e, Send) for m in decode_frames(e.data)[0]]
    assert sent
    assert request.command not in [getattr(message, "command", None) for message in sent]
    (answer,) = [effect for effect in effects if isinstance(effect, OrderAnswer)]
    assert (answer.state, answer.vehicle) == ("failed", 2)
    assert "order it again" in answer.detail
    assert [one.parameters["action"] for one in noticed(effects, NoticeCode.ORDER_ENDED)] == ["arm"]


@pytest.mark.parametrize(("outage_s", "outcome"), [(3.0, "done"), (60.0, "failed")])
def test_a_hold_under_way_goes_on_after_a_short_outage_alone(outage_s: float, outcome: str) -> None:
    request = set_mode(2, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, "LOITER")
    run, effects = after_an_order("hold", CommandSender.begin(request, START_T_NS, mode="LOITER"), outage_s)
    (answer,) = [effect for effect in effects if isinstance(effect, OrderAnswer)]
    assert (answer.state, answer.vehicle) == (outcome, 2)
    assert (run.vehicles["vehicle:2"].autopilot.mode is Mode.LOITER) is (outcome == "done")
