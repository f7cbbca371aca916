"""Separation of flown vehicles on virtual time: random missions, the truth, and the alarms.

A mission is drawn from its seed: four to six vehicles (a third of them PX4), some on the ground and some in
the air; targets; orders to arm, hold, resume and return, to one vehicle or to all, at random moments; in some
missions a failsafe that sends all home. Half of the swarms return at one height, the others a layer apart.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import msgspec
import numpy as np

from gcs.core.separation.look_ahead import LOOK_AHEAD_S
from gcs.model import NS_PER_S, Effect, Notice, NoticeCode, Order, OrderAnswer
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.vehicle.vehicle import SimVehicle
from sim_vehicles.world.scenario import Scenario, WindTable, parse_scenario
from sim_vehicles.world.vehicle_specs import vehicle_specs

NEAR_M, NEAR_HEIGHT_M = 30.0, 15.0
"""No pair may be nearer than both in the air."""
LOWEST_M = 2.0
"""Height above which a vehicle is in the air, after its take-off run."""
SAMPLE_S = 0.2
_GUST_SHARE = 0.25
BASE_M, STEP_M, LAYERS = 60.0, 20.0, 6
_FIELD = """
name = "separation"
[frame]
lat_deg = 33.2
lon_deg = -87.6
alt_msl_m = 70.0
[map]
width_m = 2400.0
height_m = 2400.0
nodes_east = 49
nodes_north = 49
[airframe]
speed_m_s = {speed}
bank_deg = 35.0
[planning]
shape = "flyable"
when = "events"
[mission]
altitude_rel_m = {base}
layer_step_m = {step}
layers = {layers}
accept_radius_m = 20.0
loiter_radius_m = 60.0
end = "{end}"
[simulation]
forward_speed_m_s = {speed}
airframe = "banked"
px4 = [{px4}]
parameters = {{ ARMING_DELAY_S = 2.0, MIS_TKO_LAND_REQ = 0.0 }}
[simulation.sensor]
clutter_per_scan = 0.0
period_s = 2.0
"""


@dataclass(frozen=True)
class Drawn:
    """One random mission."""

    scenario: Scenario
    seed: int
    grounded: frozenset[int]
    heights_m: dict[int, float]
    """Height of vehicles that start in the air."""
    return_heights_m: dict[int, float]
    orders: tuple[Order, ...]
    failsafe_s: float | None
    """Time at which a failsafe sends all home."""


@dataclass
class Pair:
    """Two vehicles too near to each other: one interval of time."""

    seed: int
    vehicles: tuple[int, int]
    begin_s: float
    end_s: float
    distance_m: float
    height_m: float
    what: str
    """Modes of both, heights."""
    alarm_s: float | None = None
    """Time of the first alarm of both that still held when it began."""

    @property
    def lead_s(self) -> float | None:
        return None if self.alarm_s is None else self.begin_s - self.alarm_s


@dataclass
class Flown:
    """What one mission showed."""

    seed: int
    pairs: list[Pair] = field(default_factory=list)
    alarms: int = 0
    """Approaches that were told."""
    false_alarms: int = 0
    """Approaches that were told, and whose pair stayed apart: by `separation_m`, or by 15 m in height."""
    avoided: int = 0
    """Those of them in which the mode of one changed after the alarm."""
    undecided: int = 0
    """Approaches that were told less than `LOOK_AHEAD_S` before the end, and not near until then."""
    nearest: dict[tuple[int, int], float] = field(default_factory=dict)
    takeoffs: int = 0
    landings: int = 0
    in_air_s: float = 0.0
    refused: int = 0
    told: list[tuple[float, str]] = field(default_factory=list)
    answered: dict[tuple[str, int], float | None] = field(default_factory=dict)
    """Time from an accepted order to hold or return until its vehicle did so, by order and vehicle; None if
    it never did. Orders that a newer one replaced are left out."""
    held: int = 0
    """Vehicles that the service held for others by itself."""


def draw(seed: int, duration_s: float, *, all_at_once: bool = False) -> Drawn:
    """Draw a mission; with `all_at_once` each order to hold, return or resume is to all vehicles."""
    rng = np.random.default_rng([seed, 25])
    n, speed = int(rng.integers(4, 7)), float(rng.choice([15.0, 18.0, 22.0]))
    px4 = [v for v in range(1, n + 1) if rng.random() < 1 / 3]
    text = _FIELD.format(
        base=BASE_M,
        step=STEP_M,
        layers=LAYERS,
        speed=speed,
        end="land" if rng.random() < 0.4 else "loiter",
        px4=", ".join(map(str, px4)),
    )
    is_side_by_side = rng.random() < 0.5
    course = float(rng.uniform(0.0, 360.0))
    for number in range(1, n + 1):
        place = (900.0 + 35.0 * number, 700.0) if is_side_by_side else rng.uniform(500.0, 1500.0, 2)
        text += (
            f"[[agents]]\nsystem_id = {number}\neast_m = {place[0]:.1f}\nnorth_m = {place[1]:.1f}\n"
            f"course_deg = {course:.1f}\n"
        )
    for _ in range(n):
        east_m, north_m = rng.uniform(200.0, 2200.0, 2)
        v_east, v_north = rng.normal(0.0, 1.5, 2)
        place = f"east_m = {east_m:.1f}\nnorth_m = {north_m:.1f}\n"
        text += f"[[births]]\n{place}[[simulation.targets]]\n{place}"
        text += f"v_east_m_s = {v_east:.2f}\nv_north_m_s = {v_north:.2f}\n"
    vehicles = list(range(1, n + 1))
    grounded = frozenset(v for v in vehicles if rng.random() < 0.6)
    is_equal = rng.random() < 0.5
    returns = {v: 100.0 if is_equal else BASE_M + STEP_M * (v - 1) for v in vehicles}
    heights = {v: BASE_M + STEP_M * (v - 1) for v in vehicles if v not in grounded}
    return Drawn(
        parse_scenario(text, f"separation-{seed}"),
        seed,
        grounded,
        heights,
        returns,
        tuple(_orders(rng, vehicles, grounded, duration_s, 1.0 if all_at_once else 0.3)),
        float(rng.uniform(40.0, duration_s - 30.0)) if rng.random() < 0.2 else None,
    )


def draw_return(seed: int, duration_s: float) -> Drawn:
    """Draw a mission of vehicles in the air, which are all ordered to return once, to places 35 m apart."""
    rng = np.random.default_rng([seed, 28])
    drawn = next(
        d for d in (draw(int(rng.integers(1 << 30)), duration_s) for _ in range(100)) if _is_strip(d)
    )
    vehicles = range(1, len(drawn.return_heights_m) + 1)
    given_t_ns = START_T_NS + round(rng.uniform(30.0, 60.0) * NS_PER_S)
    return replace(
        drawn,
        seed=seed,
        grounded=frozenset(),
        heights_m={v: BASE_M + STEP_M * (v - 1) for v in vehicles},
        return_heights_m=dict.fromkeys(vehicles, 100.0),
        orders=(Order(given_t_ns, "return-0", "return", None),),
        failsafe_s=None,
    )


def _is_strip(drawn: Drawn) -> bool:
    agents = drawn.scenario.config.agents
    return math.dist((agents[0].east_m, agents[0].north_m), (agents[1].east_m, agents[1].north_m)) < 40.0


def _orders(
    rng: np.random.Generator,
    vehicles: Sequence[int],
    grounded: frozenset[int],
    duration_s: float,
    all_share: float,
) -> list[Order]:
    found: list[tuple[float, str, tuple[int, ...] | None]] = [(1.0, "hold", (v,)) for v in sorted(grounded)]
    found += [(4.0, "resume", (v,)) for v in sorted(grounded)]
    for vehicle in sorted(grounded):  # repeated: a take-off may have to wait
        first_s = rng.uniform(6.0, 0.5 * duration_s)
        found += [(t_s, "arm", (vehicle,)) for t_s in np.arange(first_s, duration_s, 15.0)]
    for _ in range(int(rng.integers(2, 8))):
        t_s = rng.uniform(15.0, duration_s - 10.0)
        what = str(rng.choice(["hold", "hold", "return", "resume"]))
        who = None if rng.random() < all_share else (int(rng.choice(vehicles)),)
        found.append((t_s, what, who))
        if what != "resume":  # most of them go on some time later
            found.append((t_s + rng.uniform(4.0, 40.0), "resume", who if rng.random() < 0.8 else None))
    return [
        Order(START_T_NS + round(t_s * NS_PER_S), f"{what}-{i}", what, who)  # type: ignore[arg-type]
        for i, (t_s, what, who) in enumerate(found)
        if t_s < duration_s
    ]


class FlownMission:
    """A flight of a drawn mission with its truth."""

    def __init__(self, drawn: Drawn, *, near_m: float = NEAR_M, near_height_m: float = NEAR_HEIGHT_M) -> None:
        self.drawn, self.flown = drawn, Flown(drawn.seed)
        self._near_m, self._near_height_m = near_m, near_height_m
        self._separation_m = drawn.scenario.config.planning.separation_m
        self._open: dict[tuple[int, int], Pair] = {}
        self._told: dict[tuple[int, int], float] = {}
        self._was_near: dict[tuple[int, int], float] = {}
        self._modes_told: dict[tuple[int, int], tuple[Mode, Mode] | None] = {}
        """Modes at the alarm; None once one has changed."""
        self.run = VirtualRun(drawn.scenario, drawn.seed, on_effect=self._on_effect, orders=drawn.orders)
        vehicles = [
            SimVehicle(
                replace(
                    spec,
                    airborne=spec.system_id not in drawn.grounded,
                    alt_rel_m=drawn.heights_m.get(spec.system_id, 0.0),
                    parameters=spec.parameters
                    | {
                        "RTL_ALTITUDE": drawn.return_heights_m[spec.system_id],
                        "RTL_RETURN_ALT": drawn.return_heights_m[spec.system_id],
                    },
                ),
                drawn.scenario.frame,
                START_T_NS,
            )
            for spec in vehicle_specs(drawn.scenario, drawn.seed)
        ]
        self.run.vehicles = {f"vehicle:{one.system_id}": one for one in vehicles}
        self._flew: dict[int, bool] = {one.system_id: one.autopilot.flying for one in vehicles}

    def fly(self, duration_s: float) -> Flown:
        has_failed = self.drawn.failsafe_s is None
        for t_s in np.arange(SAMPLE_S, duration_s, SAMPLE_S).tolist():
            self.run.run(t_s)
            self.run.ended = False  # fly on: holds and returns go on after the last target
            if not has_failed and self.drawn.failsafe_s is not None and t_s >= self.drawn.failsafe_s:
                has_failed = True
                for vehicle in self.run.vehicles.values():
                    if vehicle.autopilot.flying:
                        vehicle.autopilot.set_mode(Mode.RTL)
            self._look(t_s)
        for vehicles, told_s in list(self._told.items()):
            if told_s > duration_s - LOOK_AHEAD_S and self._was_near.get(vehicles, -math.inf) < told_s:
                del self._told[vehicles]
                self.flown.undecided += 1
            else:
                self._end_alarm(vehicles)
        self.flown.pairs += self._open.values()
        return self.flown

    def _look(self, t_s: float) -> None:
        in_air = []
        for vehicle in self.run.vehicles.values():
            flies = vehicle.autopilot.flying
            before, self._flew[vehicle.system_id] = self._flew[vehicle.system_id], flies
            self.flown.takeoffs += flies and not before
            self.flown.landings += before and not flies
            if flies and vehicle.alt_rel_m > LOWEST_M:
                in_air.append(vehicle)
        self.flown.in_air_s += SAMPLE_S * len(in_air)
        for one, other in itertools.combinations(in_air, 2):
            vehicles = (one.system_id, other.system_id)
            distance_m = math.hypot(one.east_m - other.east_m, one.north_m - other.north_m)
            height_m = abs(one.alt_rel_m - other.alt_rel_m)
            is_near = distance_m < self._near_m and height_m < self._near_height_m
            if height_m < self._near_height_m:
                nearest = self.flown.nearest
                nearest[vehicles] = min(nearest.get(vehicles, math.inf), distance_m)
            pair = self._open.get(vehicles)
            modes = (one.autopilot.mode, other.autopilot.mode)
            if vehicles in self._told and self._modes_told.setdefault(vehicles, modes) != modes:
                self._modes_told[vehicles] = None
            if distance_m < self._separation_m and height_m < self._near_height_m:
                self._was_near[vehicles] = t_s
            if is_near:
                if pair is None:
                    what = ", ".join(
                        f"{v.autopilot.mode.name} {v.autopilot.seq} {v.alt_rel_m:.0f} m" for v in (one, other)
                    )
                    alarm_s = self._told.get(vehicles)
                    pair = Pair(self.drawn.seed, vehicles, t_s, t_s, distance_m, height_m, what, alarm_s)
                    self._open[vehicles] = pair
                pair.end_s = t_s
                if distance_m < pair.distance_m:
                    pair.distance_m, pair.height_m = distance_m, height_m
            elif pair is not None:
                self.flown.pairs.append(self._open.pop(vehicles))

    def _end_alarm(self, vehicles: tuple[int, int]) -> None:
        begin_s = self._told.pop(vehicles)
        self.flown.alarms += 1
        is_false = self._was_near.get(vehicles, -math.inf) < begin_s
        has_changed = self._modes_told.pop(vehicles, None) is None
        self.flown.false_alarms += is_false
        self.flown.avoided += is_false and has_changed

    def _on_answer(self, t_ns: int, answer: OrderAnswer) -> None:
        self.flown.refused += answer.state == "refused"
        if answer.action not in ("hold", "return"):
            return
        answered = self.flown.answered
        if answer.state == "accepted":
            answered.update({(answer.order_id, vehicle): None for vehicle in answer.waiting})
        elif answer.vehicle is not None and (answer.order_id, answer.vehicle) in answered:
            if answer.state == "done":
                given_t_ns = next(one.t_ns for one in self.drawn.orders if one.order_id == answer.order_id)
                answered[answer.order_id, answer.vehicle] = (t_ns - given_t_ns) / NS_PER_S
            elif answer.detail.startswith("replaced"):
                del answered[answer.order_id, answer.vehicle]

    def _on_effect(self, t_ns: int, effect: Effect) -> None:
        if isinstance(effect, OrderAnswer):
            self._on_answer(t_ns, effect)
        if not isinstance(effect, Notice) or effect.vehicle is None:
            return
        t_s = (t_ns - START_T_NS) / NS_PER_S
        self.flown.held += effect.code.value == "avoids"
        if effect.level != "info" or effect.code is NoticeCode.APART_AGAIN:
            self.flown.told.append((t_s, f"{effect.level} {effect.vehicle} {effect.text}"))
        other = effect.parameters.get("other", 0)
        if effect.code in (NoticeCode.COMES_NEAR, NoticeCode.SEPARATION_LOST):
            self._told.setdefault((effect.vehicle, other), t_s)
        elif effect.code is NoticeCode.APART_AGAIN:
            vehicles = (effect.vehicle, other)
            if vehicles in self._told:
                self._end_alarm(vehicles)


def in_wind(drawn: Drawn, share: float) -> Drawn:
    """Return a mission in wind of a share of the airspeed from a direction of its own, with gusts."""
    config, simulation = drawn.scenario.config, drawn.scenario.simulation
    wind_m_s = share * config.airframe.speed_m_s
    towards_rad = np.random.default_rng([drawn.seed, 33]).uniform(0.0, 2.0 * math.pi)
    wind = WindTable(
        east_m_s=wind_m_s * math.sin(towards_rad),
        north_m_s=wind_m_s * math.cos(towards_rad),
        gust_std_m_s=_GUST_SHARE * wind_m_s,
    )
    planned_m_s = (1.0 + _GUST_SHARE) * wind_m_s
    airframe = msgspec.structs.replace(config.airframe, wind_m_s=planned_m_s)
    scenario = replace(
        drawn.scenario,
        config=msgspec.structs.replace(config, airframe=airframe),
        simulation=msgspec.structs.replace(simulation, wind=wind),
    )
    return replace(drawn, scenario=scenario)


def fly(
    seed: int,
    duration_s: float = 150.0,
    *,
    all_at_once: bool = False,
    home: bool = False,
    wind: float = 0.0,
) -> Flown:
    """Draw and fly one mission; with `home` one of `draw_return`, with `wind` in a share of the airspeed."""
    drawn = draw_return(seed, duration_s) if home else draw(seed, duration_s, all_at_once=all_at_once)
    return FlownMission(in_wind(drawn, wind) if wind else drawn).fly(duration_s)
