"""An operator would wait for ever: every vehicle circles at home after its failsafe, and nobody says so."""

from __future__ import annotations

from helpers.noticed import noticed

from gcs.config import read_text
from gcs.config.key_overrides import override_keys
from gcs.model import NS_PER_S, MissionEnded, Notice, NoticeCode, Order
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.vehicle.faults import FaultKind
from sim_vehicles.world.scenario import parse_scenario

RTL = {"FS_LONG_ACTN": 1, "NAV_RCL_ACT": 2}


class Mission:
    """Four vehicles, two of them PX4, that return when their radio control is lost."""

    def __init__(self) -> None:
        text, source = read_text("deterministic")
        settings = [f"simulation.parameters.{name}={value}" for name, value in RTL.items()]
        settings += ["simulation.px4=[3, 4]", "simulation.death.prescribed=[]"]
        settings += ["simulation.death.survival_probability=1.0"]
        scenario = parse_scenario(override_keys(text, settings, source), source)
        self.effects: list[object] = []
        self.run = VirtualRun(scenario, 1, on_effect=lambda _, effect: self.effects.append(effect))

    def fly(self, seconds: float) -> None:
        self.run.run((self.run.t_ns - START_T_NS) / NS_PER_S + seconds)

    def lose_radio_control(self, vehicles: tuple[int, ...]) -> None:
        for vehicle in vehicles:
            self.run.vehicles[f"vehicle:{vehicle}"].begin_fault(FaultKind.RC)

    def order(self, action: str, vehicles: tuple[int, ...]) -> None:
        self.run.order(Order(self.run.t_ns, f"{action}-{self.run.t_ns}", action, vehicles))

    def said(self, code: NoticeCode) -> list[Notice]:
        return noticed(self.effects, code)


def test_a_mission_whose_vehicles_circle_at_home_says_once_that_it_waits_and_goes_on_by_an_order() -> None:
    mission = Mission()
    mission.fly(15.0)
    mission.lose_radio_control((1, 2, 3))
    mission.fly(30.0)
    assert not mission.said(NoticeCode.STANDSTILL), "agent 4 flies on"
    mission.lose_radio_control((4,))
    mission.fly(90.0)
    (notice,) = mission.said(NoticeCode.STANDSTILL)
    assert notice.parameters["vehicles"] == "1, 2, 3, 4 (is in RTL and left alone)"
    assert not [effect for effect in mission.effects if isinstance(effect, MissionEnded)]
    vehicle = mission.run.vehicles["vehicle:3"]
    vehicle.end_fault(FaultKind.RC)
    mission.order("resume", (3,))
    mission.fly(20.0)
    assert [one.parameters["vehicles"] for one in mission.said(NoticeCode.STANDSTILL_OVER)] == ["3"]
    assert mission.run.engine.state.agents[3].routes.flown is not None


def test_a_mission_that_the_operator_holds_is_no_news() -> None:
    mission = Mission()
    mission.fly(15.0)
    mission.order("hold", (1, 2, 3, 4))
    mission.fly(40.0)
    assert not mission.said(NoticeCode.STANDSTILL)
