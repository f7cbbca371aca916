"""A user would lose tasks to a vehicle called lost that reports: several that take off from one place.

Their tracks lie on one another for half a minute, and their labels come apart in any order.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.staging import RADAR, at, mission
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.core.engine import Engine
from gcs.mavlink.frames.codec import Encoder
from gcs.model import AgentStatus, Datagram, Plan, Scan, Tick, read_only

PLACE = (1000.0, 300.0)
VEHICLES = (1, 2, 3, 4)
SPEED_M_S = 22.0
CONFIG = mission(
    agents=[PLACE] * 4, births=[(300.0, 1800.0), (900.0, 1800.0), (1400.0, 1800.0), (1800.0, 1500.0)]
)
TARGETS = [(birth.east_m, birth.north_m) for birth in CONFIG.births]


def flown(vehicle: int, t_s: float) -> tuple[float, float, float, float]:
    """East, north, speed, course: they climb out together, and turn off one after the other."""
    begins_s, turns_s = 5.0, 16.0 + 3.0 * vehicle
    straight_s = min(max(t_s - begins_s, 0.0), turns_s - begins_s)
    course_rad = math.radians(-50.0 + 20.0 * vehicle)
    aside_s = max(t_s - turns_s, 0.0)
    east_m = PLACE[0] + SPEED_M_S * aside_s * math.sin(course_rad)
    north_m = PLACE[1] + SPEED_M_S * (straight_s + aside_s * math.cos(course_rad))
    return east_m, north_m, SPEED_M_S * (t_s > begins_s), course_rad * (t_s > turns_s)


class Flight:
    """Four vehicles that start at one place, a sensor with clutter, and central command."""

    def __init__(
        self, seed: int, *, gone_s: dict[int, float] | None = None, silent_s: dict[int, float] | None = None
    ) -> None:
        self.engine, self.rng = Engine(CONFIG, 1), np.random.default_rng(seed)
        self.encoders = {vehicle: Encoder(vehicle, 1) for vehicle in VEHICLES}
        self.gone_s, self.silent_s = gone_s or {}, silent_s or {}
        self.effects: list[tuple[float, object]] = []

    def step(self, t_s: float, event: object) -> None:
        self.effects += [(t_s, effect) for effect in self.engine.step(event)]

    def run(self, duration_s: float) -> None:
        for quarter in range(round(duration_s * 4)):
            t_s = quarter / 4
            there = [v for v in VEHICLES if t_s < self.gone_s.get(v, math.inf)]
            for vehicle in there:
                if t_s < self.silent_s.get(vehicle, math.inf):
                    self.report(vehicle, t_s)
            if quarter % 4 == 0:
                self.scan(t_s, there)
            self.step(t_s, Tick(at(t_s)))

    def report(self, vehicle: int, t_s: float) -> None:
        east_m, north_m, speed_m_s, course_rad = flown(vehicle, t_s)
        lat_deg, lon_deg = CONFIG.local_frame.to_geodetic(
            east_m + self.rng.normal(0, 1.0), north_m + self.rng.normal(0, 1.0)
        )
        v_north, v_east = speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad)
        encode = self.encoders[vehicle]
        frames = encode(dialect.MAVLink_heartbeat_message(1, 3, 217, 10, 4, 3)) + encode(
            dialect.MAVLink_global_position_int_message(
                round(t_s * 1000) + 60_000, round(lat_deg * 1e7), round(lon_deg * 1e7), 170_000, 100_000,
                round(v_north * 100), round(v_east * 100), 0, 0,
            )
        )  # fmt: skip
        self.step(t_s, Datagram(at(t_s), "udp", f"10.0.0.{vehicle}:5", frames))

    def scan(self, t_s: float, there: list[int]) -> None:
        places = [flown(vehicle, t_s)[:2] for vehicle in there] + TARGETS
        seen = [self.rng.normal(place, math.sqrt(10.0)) for place in places if self.rng.random() < 0.95]
        clutter = self.rng.uniform(0.0, 2000.0, (self.rng.poisson(16), 2))
        z_m = read_only(np.vstack((np.reshape(seen, (-1, 2)), clutter)))
        self.step(t_s, Scan(at(t_s), at(t_s), RADAR, z_m))

    def lost(self) -> list[tuple[float, object]]:
        losses = [
            (t, e.vehicle) for t, e in self.effects if isinstance(e, AgentStatus) and e.status == "lost"
        ]
        gone = {"agent lost", "agent not tracked"}
        return losses + [(t, e.reason) for t, e in self.effects if isinstance(e, Plan) and gone & {*e.causes}]


@pytest.mark.parametrize("seed", [2, 9])
def test_vehicles_that_start_at_one_place_and_report_are_never_called_lost(seed: int) -> None:
    flight = Flight(seed)
    flight.run(40.0)
    assert flight.lost() == []


@pytest.mark.parametrize("seed", [1, 3])
def test_the_one_that_is_gone_is_called_lost_and_not_one_that_reports(seed: int) -> None:
    flight = Flight(seed, gone_s={2: 12.0})
    flight.run(30.0)
    assert [what for _, what in flight.lost()] == [2, "agent 2 is not tracked"]
    assert all(t_s < 24.0 for t_s, _ in flight.lost())


def test_one_whose_link_is_silent_and_that_sensors_see_is_not_called_lost() -> None:
    flight = Flight(1, silent_s={2: 12.0})
    flight.run(40.0)
    assert flight.lost() == []
