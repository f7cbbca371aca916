"""A target would have no agent while a vehicle's autopilot rejects every mission, and nobody would know why.

Simulated PX4s reject missions by MIS_TKO_LAND_REQ.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers.areas import AUSTRALIA
from helpers.noticed import alarms
from helpers.staging import S
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.state import Agent
from gcs.core.tasking.rejections import Rejections
from gcs.mavlink.services.parameter_protocol import encode_value
from gcs.model import Authority, Notice, NoticeCode, Order, OrderAnswer, UploadReport
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.vehicle.vehicle import SimVehicle
from sim_vehicles.world.scenario import parse_scenario
from sim_vehicles.world.vehicle_specs import vehicle_specs

FIELD = (
    'name = "two"\n'
    + AUSTRALIA
    + """\
[[agents]]
system_id = 1
east_m = 1500.0
north_m = 1000.0
[[agents]]
system_id = 2
east_m = 700.0
north_m = 500.0
[[births]]
east_m = 2600.0
north_m = 2500.0
[simulation]
forward_speed_m_s = 15.0
parameters = { ARMING_DELAY_S = 1.0 }
[[simulation.targets]]
east_m = 2600.0
north_m = 2500.0
"""
)
SECOND_TARGET = "[[births]]\neast_m = 400.0\nnorth_m = 2500.0\n"
SECOND_TRUTH = "[[simulation.targets]]\neast_m = 400.0\nnorth_m = 2500.0\n"
REQUIRES_LANDING, REQUIRES_NOTHING = 2.0, 0.0
CAUSE = "Mission rejected: Landing waypoint/pattern required"


class Flight:
    """PX4s, of which vehicle 1 is near the target and requires a landing that no mission has."""

    def __init__(self, text: str = FIELD, *, airborne: bool) -> None:
        scenario = parse_scenario(text, "two.toml")
        self.effects: list = []
        self.flight = VirtualRun(scenario, 1, None, lambda _, effect: self.effects.append(effect))
        specs = [replace(one, airborne=airborne, autopilot="px4") for one in vehicle_specs(scenario, 1)]
        self.planes = {one.system_id: SimVehicle(one, scenario.frame, START_T_NS) for one in specs}
        self.flight.vehicles = {f"vehicle:{number}": plane for number, plane in self.planes.items()}
        self.set_parameter(REQUIRES_LANDING)
        for plane in self.planes.values() if not airborne else ():
            plane.autopilot.set_mode(Mode.LOITER)

    def set_parameter(self, value: float) -> None:
        """Set the parameter as a station on another link does: its PARAM_VALUE comes to all."""
        kind = dialect.MAV_PARAM_TYPE_INT32
        message = dialect.MAVLink_param_set_message(
            1, 1, b"MIS_TKO_LAND_REQ", encode_value(value, kind, bytewise=True), kind
        )
        link = dialect.MAVLink(None, 250, 190)
        self.planes[1].receive_datagram(message.pack(link), self.flight.t_ns)

    def wait(self, seconds: float) -> Flight:
        self.flight.run((self.flight.t_ns - START_T_NS) / S + seconds)
        return self

    def wait_for_rejection(self) -> None:
        for _ in range(120):
            self.wait(0.5)
            if Authority.REJECTING in self.agent(1).control.claims:
                return
        pytest.fail("no mission was rejected within a minute")

    def order(self, action: str) -> OrderAnswer:
        self.flight.order(Order(self.flight.t_ns, f"{action}-{self.flight.t_ns}", action, (1,)))
        self.wait(0.2)
        return self.all(OrderAnswer)[-1]

    def all(self, kind) -> list:
        return [effect for effect in self.effects if isinstance(effect, kind)]

    def uploads(self) -> int:
        """Return the number of uploads to vehicle 1 that have ended."""
        return sum(report.vehicle == 1 for report in self.all(UploadReport))

    def alarms(self) -> list[Notice]:
        """Return the alarms about vehicle 1, without its own texts."""
        return [one for one in alarms(self.effects, 1) if one.code is not NoticeCode.AUTOPILOT_ALARM]

    def agent(self, vehicle: int) -> Agent:
        return self.flight.engine.state.agents[vehicle]


@pytest.mark.parametrize("airborne", [False, True])
def test_the_target_of_a_vehicle_that_rejects_its_mission_goes_to_another(airborne: bool) -> None:
    """A grounded agent kept its target for 165 s, and the vehicle's own words were not quoted."""
    flight = Flight(airborne=airborne)
    flight.wait_for_rejection()
    report = flight.all(UploadReport)[0]
    assert (report.vehicle, report.ok) == (1, False)
    assert report.detail == f"the vehicle's navigator rejects the mission: {CAUSE}"
    (alarm,) = flight.alarms()
    assert (alarm.code, alarm.parameters["cause"]) == (NoticeCode.MISSION_REJECTED, CAUSE)
    flight.wait(5.0)
    assert flight.agent(1).routes.flown is None
    assert flight.agent(2).routes.flown is not None
    assert flight.agent(2).tasking.onboard is not None


def test_arming_a_vehicle_that_rejects_its_mission_is_refused_with_the_cause() -> None:
    flight = Flight(airborne=False).wait(15.0)
    answer = flight.order("arm")
    assert answer.state == "refused"
    assert CAUSE in answer.detail


def both_targets() -> str:
    text = FIELD.replace("[simulation]", f"{SECOND_TARGET}[simulation]")
    return text + SECOND_TRUTH


def test_a_corrected_parameter_starts_the_next_attempt_at_once() -> None:
    """Only another route cured it."""
    flight = Flight(both_targets(), airborne=False)
    flight.wait_for_rejection()
    flight.wait(3.0)
    assert flight.agent(1).tasking.onboard is None
    flight.set_parameter(REQUIRES_NOTHING)
    flight.wait(5.0)
    assert not flight.agent(1).control.claims
    assert flight.agent(1).tasking.onboard is not None
    assert flight.agent(1).tasking.rejections.count == 0
    flight.order("arm")
    flight.wait(30.0)
    assert flight.planes[1].alt_rel_m > 20.0


def test_rejected_missions_are_tried_again_after_growing_pauses_and_not_without_end() -> None:
    """Each attempt occupies the link, and a person who reads the same alarm again learns nothing."""
    flight = Flight(both_targets(), airborne=False).wait(450.0)
    assert flight.uploads() == 6
    first, last = flight.alarms()
    assert "follows in 10 s" in first.parameters["outlook"]
    assert "`gcs order resume --vehicle 1`" in last.parameters["outlook"]
    flight.wait(200.0)
    assert flight.uploads() == 6
    assert flight.order("resume").state == "done"
    flight.wait(10.0)
    assert flight.uploads() == 7


def test_a_parameter_that_changes_all_the_time_starts_no_upload_all_the_time() -> None:
    flight = Flight(both_targets(), airborne=False).wait(15.0)
    for number in range(240):
        flight.set_parameter((REQUIRES_LANDING, 3.0)[number % 2])
        flight.wait(0.5)
    assert flight.uploads() <= 9


def test_a_cause_that_comes_late_is_told_and_a_consequence_is_no_cause() -> None:
    agent = Agent.initial(1)
    rejections = Rejections({1: agent})

    def say(text: str, t_ns: int) -> list[object]:
        message = dialect.MAVLink_statustext_message(2, text.encode())
        return [one.parameters["cause"] for one in rejections.receive(1, message, t_ns)]

    say("No valid mission available, loitering", 9 * S)
    (notice,) = rejections.begin(1, 10 * S)
    assert notice.parameters["cause"].startswith("it names no cause")
    assert say(CAUSE, 11 * S) == [CAUSE]
    assert agent.control.reason == f"rejects its mission: {CAUSE}"
    assert say(CAUSE, 12 * S) == []
