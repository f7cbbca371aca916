"""Faults of vehicles in flight, on virtual time: whether the service tells, re-assigns, leaves alone.

``python tests/bench/bench_faults.py`` flies the table: every kind of fault, ArduPlane and PX4, in the
climb, en route and near the target, three seeds each. ``--missions 1000`` flies random missions instead: a
shipped scenario with a mixed swarm, and one to three random faults. Columns:

* how long after the vehicle's own telemetry showed the fault a notice named it;
* targets that another vehicle got within 5 s of the time at which the own vehicle came down or left its
  mission for a failsafe's mode, of those for which one was in the air without a target;
* flights in which a failsafe's mode was told as somebody's choice, in which a steering message was sent to a
  vehicle in a mode that is not ours, and in which a vehicle took off unasked;
* flights that were stuck: after ten minutes neither complete, nor with every vehicle landed, down or lost,
  nor told to stand still;
* flights that stood still: an alarm says that no vehicle left can be tasked, and why.

``--list`` prints the notices of each flight that missed one of these bars.
"""

import argparse
import itertools
import math
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
from fault_watch import FaultWatch, decoded, quantile

from gcs.config import read_text
from gcs.config.key_overrides import override_keys
from gcs.model import NS_PER_S, Notice, NoticeCode, Order
from sim_vehicles.campaign.campaign import warm_up
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.vehicle.faults import FaultKind
from sim_vehicles.vehicle.vehicle import SimVehicle
from sim_vehicles.world.scenario import Scenario, generator, parse_scenario
from sim_vehicles.world.vehicle_specs import vehicle_specs

KINDS = tuple(kind.value for kind in FaultKind)
MOMENTS = ("climb", "en route", "near the target")
AUTOPILOTS = ("ardupilot", "px4")
SCENARIOS = ("deterministic", "prescribed", "random-obstacles", "random-targets")
STEP_S = 0.5
NEAR_M = 150.0
TOLD_S, REASSIGNED_S = 3.0, 5.0
AFTER_FAULT_S = 150.0
LIMIT_S = 400.0
MISSION_LIMIT_S = 600.0
STANDSTILL_S = 30.0
FAILSAFES = {
    "FS_LONG_ACTN": 1.0, "FS_GCS_ENABL": 1.0, "BATT_FS_LOW_ACT": 1.0, "FENCE_ACTION": 1.0,
    "COM_LOW_BAT_ACT": 3.0, "NAV_RCL_ACT": 2.0, "NAV_DLL_ACT": 2.0, "GF_ACTION": 3.0,
}  # fmt: skip
FIELD = """
name = "faults"
[frame]
lat_deg = 33.2
lon_deg = -87.6
alt_msl_m = 70.0
[map]
width_m = 3000.0
height_m = 2000.0
nodes_east = 76
nodes_north = 51
discs_m = [[1000.0, 1000.0, 120.0], [1500.0, 600.0, 100.0]]
[mission]
altitude_rel_m = 80.0
layer_step_m = 30.0
layers = 4
[airframe]
speed_m_s = 18.0
[tracking.agents]
accel_psd_m2_s3 = 16.0
[tracking.targets]
accel_psd_m2_s3 = 0.25
[simulation]
forward_speed_m_s = 18.0
airframe = "banked"
[simulation.sensor]
clutter_per_scan = 5.0
"""
STARTS_M = ((200.0, 400.0), (200.0, 800.0), (200.0, 1200.0), (200.0, 1600.0))
TARGETS_M = ((2000.0, 500.0), (2100.0, 1000.0), (2000.0, 1500.0))


@dataclass(frozen=True)
class Job:
    """One flight."""

    seed: int
    kind: str = ""
    autopilot: str = ""
    moment: str = ""


@dataclass
class Result:
    """What one flight came to."""

    job: Job
    text: str
    told_s: list[tuple[str, float | None]] = field(default_factory=list)
    """Kind and delay of each fault that the vehicle showed; None for one that was not told."""
    reassigned_s: list[float | None] = field(default_factory=list)
    """Delay of each re-assignment that was possible; None for one that did not come."""
    misattributed: list[str] = field(default_factory=list)
    steered: list[str] = field(default_factory=list)
    unasked: list[int] = field(default_factory=list)
    stuck: str = ""
    stands_still: bool = False
    """True if the operator was told that no vehicle can be tasked, and it was so until the end."""
    notices: list[str] = field(default_factory=list)

    @property
    def problems(self) -> list[str]:
        """Bars that were missed."""
        told = [f"{kind} told after {late(s)}" for kind, s in self.told_s if s is None or s > TOLD_S]
        again = [
            f"target re-assigned after {late(s)}" for s in self.reassigned_s if s is None or s > REASSIGNED_S
        ]
        steered = []
        if self.steered:
            steered = [f"sent against a mode: {self.steered[0]} (and {len(self.steered) - 1} more)"]
        steered += [f"told as a person's choice: {text}" for text in self.misattributed]
        unasked = [f"vehicle {vehicle} took off unasked" for vehicle in self.unasked]
        return [*told, *again, *steered, *unasked, *([f"stuck: {self.stuck}"] * bool(self.stuck))]


def late(seconds: float | None) -> str:
    return "never" if seconds is None else f"{seconds:.1f} s"


def field_text(autopilot: str, failsafes: dict[str, float], speed_m_s: float = 18.0) -> str:
    """Return four vehicles west of an open field and three targets in its east, as a mission file."""
    text = FIELD.replace("speed_m_s = 18.0", f"speed_m_s = {speed_m_s}")
    if autopilot == "px4":
        text = text.replace("[simulation]\n", "[simulation]\npx4 = [1, 2, 3, 4]\n")
    values = ", ".join(f"{name} = {value}" for name, value in failsafes.items())
    text = text.replace("[simulation]\n", f"[simulation]\nparameters = {{ {values} }}\n")
    for number, (east_m, north_m) in enumerate(STARTS_M, 1):
        text += (
            f"[[agents]]\nsystem_id = {number}\neast_m = {east_m}\nnorth_m = {north_m}\ncourse_deg = 90.0\n"
        )
    for east_m, north_m in TARGETS_M:
        text += f"[[births]]\neast_m = {east_m}\nnorth_m = {north_m}\n"
        text += f"[[simulation.targets]]\neast_m = {east_m}\nnorth_m = {north_m}\n"
    return text


def field_scenario(autopilot: str) -> Scenario:
    """Return the field's scenario for one autopilot."""
    return parse_scenario(field_text(autopilot, FAILSAFES), "faults.toml")


class Flight:
    """One mission whose vehicles break at moments of their flight."""

    def __init__(self, scenario: Scenario, seed: int, from_ground: bool = False) -> None:
        self.run = VirtualRun(scenario, seed, on_event=self._on_event, on_effect=self._on_effect)
        self.watches: list[FaultWatch] = []
        self.stands_still_since_ns: int | None = None
        if from_ground:
            specs = [replace(spec, airborne=False) for spec in vehicle_specs(scenario, seed)]
            self.run.vehicles = {
                f"vehicle:{spec.system_id}": SimVehicle(spec, scenario.frame, START_T_NS) for spec in specs
            }

    def _on_event(self, event: object) -> None:
        messages = decoded(event)
        for watch in self.watches:
            watch.event(event, messages)

    def _on_effect(self, t_ns: int, effect: object) -> None:
        if isinstance(effect, Notice) and effect.code is NoticeCode.STANDSTILL:
            self.stands_still_since_ns = t_ns
        if isinstance(effect, Notice) and effect.code is NoticeCode.STANDSTILL_OVER:
            self.stands_still_since_ns = None
        for watch in self.watches:
            watch.effect(t_ns, effect)

    @property
    def stands_still(self) -> bool:
        """True if the operator was told so a while ago, and not that it goes on."""
        since_ns = self.stands_still_since_ns
        return since_ns is not None and self.run.t_ns - since_ns >= STANDSTILL_S * NS_PER_S

    @property
    def t_s(self) -> float:
        return (self.run.t_ns - START_T_NS) / NS_PER_S

    def vehicle(self, number: int) -> SimVehicle:
        return self.run.vehicles[f"vehicle:{number}"]

    def fly(self, seconds: float = STEP_S) -> None:
        self.run.run(self.t_s + seconds)

    def order(self, action: str, vehicles: tuple[int, ...] | None = None) -> None:
        self.order_at(self.t_s, action, vehicles)

    def order_at(self, t_s: float, action: str, vehicles: tuple[int, ...] | None = None) -> None:
        t_ns = START_T_NS + round(t_s * NS_PER_S)
        self.run.order(Order(t_ns, f"{action}-{t_ns}-{vehicles}", action, vehicles))

    def break_down(self, watch: FaultWatch) -> None:
        broken = {one.vehicle for one in self.watches if one.fault_ns is not None}
        watch.begin(self.run.t_ns, broken)
        self.vehicle(watch.vehicle).begin_fault(FaultKind(watch.kind))


def result_of(job: Job, text: str, watches: list[FaultWatch]) -> Result:
    """Return what one flight came to, from its watches."""
    result = Result(job, text)
    for watch in watches:
        if watch.shown_ns is not None:
            result.told_s.append((watch.kind, watch.delay_s(watch.told_ns, watch.shown_ns)))
        if watch.target is not None and watch.spare and watch.left_ns is not None:
            delay_s = watch.delay_s(watch.reassigned_ns, watch.left_ns)
            result.reassigned_s.append(None if delay_s is None else max(delay_s, 0.0))
        result.misattributed += [watch.misattributed] * bool(watch.misattributed)
        result.steered += watch.steered
        result.unasked += watch.unasked
        result.notices += [f"{watch.kind} {watch.vehicle} {t_s:6.1f} {said}" for t_s, said in watch.texts]
    return result


def is_at_moment(flight: Flight, watch: FaultWatch, moment: str) -> bool:
    """Return True when the vehicle that is to break is where it is to break."""
    vehicle = flight.vehicle(watch.vehicle)
    if watch.vehicle not in watch.targets:
        return False
    if moment == "climb":
        return 25.0 < vehicle.alt_rel_m < 70.0 and vehicle.autopilot.flying
    target_m = min(math.dist((vehicle.east_m, vehicle.north_m), place) for place in TARGETS_M)
    if moment == "en route":
        return vehicle.east_m > 900.0
    return target_m < NEAR_M


def fly_moment(job: Job) -> Result:
    """Fly one cell of the table."""
    flight = Flight(field_scenario(job.autopilot), job.seed, from_ground=job.moment == "climb")
    watch = FaultWatch(job.kind, 0)
    flight.watches.append(watch)
    arms = itertools.cycle((1, 2, 3, 4))
    if job.moment == "climb":
        flight.order_at(3.0, "hold")  # On the ground they are in no mode of ours.
        flight.order_at(6.0, "resume")
    while flight.t_s < LIMIT_S and watch.fault_ns is None:
        flight.fly()
        if job.moment == "climb" and flight.t_s > 25.0 and flight.t_s % 3.0 < STEP_S:
            flight.order("arm", (next(arms),))
        if not watch.vehicle and watch.targets:
            watch.vehicle = sorted(watch.targets)[job.seed % len(watch.targets)]
        if watch.vehicle and is_at_moment(flight, watch, job.moment):
            flight.break_down(watch)
    text = f"{job.autopilot} {job.kind} {job.moment} seed {job.seed}"
    if watch.fault_ns is None:
        return Result(job, text, stuck=f"the moment never came: {watch.targets}")
    end_s = flight.t_s + AFTER_FAULT_S
    while flight.t_s < end_s and not flight.run.ended:
        flight.fly(5.0)
    return result_of(job, text, flight.watches)


def random_faults(rng: np.random.Generator, agents: list[int]) -> list[tuple[float, str, int, float]]:
    """Return (time, kind, vehicle, duration or 0) of one to three different faults."""
    faults: dict[tuple[str, int], tuple[float, str, int, float]] = {}
    for _ in range(int(rng.integers(1, 4))):
        kind = str(rng.choice(KINDS))
        lasts_s = 0.0 if kind in ("crash", "fence") or rng.random() < 0.6 else float(rng.uniform(8.0, 40.0))
        at_s, vehicle = float(rng.uniform(5.0, 90.0)), int(rng.choice(agents))
        faults[kind, vehicle] = (at_s, kind, vehicle, lasts_s)
    return sorted(faults.values())


def fly_random(job: Job) -> Result:
    """Fly one random mission."""
    rng = generator(job.seed, "faults")
    name = SCENARIOS[job.seed % len(SCENARIOS)]
    text, source = read_text(name)
    numbers = [agent.system_id for agent in parse_scenario(text, source).config.agents]
    px4 = [number for number in numbers if rng.random() < 0.5]
    settings = [f"simulation.px4={px4}", "simulation.death.prescribed=[]"]
    settings.append("simulation.death.survival_probability=1.0")
    settings += [f"simulation.parameters.{key}={value}" for key, value in FAILSAFES.items()]
    flight = Flight(parse_scenario(override_keys(text, settings, source), source), job.seed)
    due = random_faults(rng, numbers)
    ends: list[tuple[float, FaultWatch]] = []
    flight.watches += [FaultWatch(kind, vehicle) for _, kind, vehicle, _ in due]
    changes_until_s = max(at_s + lasts_s for at_s, _, _, lasts_s in due)
    while flight.t_s < MISSION_LIMIT_S and not flight.run.ended:
        if flight.stands_still and flight.t_s > changes_until_s + STANDSTILL_S:
            break
        for (at_s, _, _, lasts_s), watch in zip(due, flight.watches, strict=True):
            flies = flight.vehicle(watch.vehicle).autopilot.flying  # a wreck does not break again
            if watch.fault_ns is None and flight.t_s >= at_s and flies:
                flight.break_down(watch)
                ends += [(at_s + lasts_s, watch)] * bool(lasts_s)
        for at_s, watch in ends:
            if watch.end_ns is None and flight.t_s >= at_s:
                watch.end_ns = flight.run.t_ns
                flight.vehicle(watch.vehicle).end_fault(FaultKind(watch.kind))
        flight.fly()
    faults = ", ".join(f"{kind} {vehicle} at {at_s:.0f} s" for at_s, kind, vehicle, _ in due)
    result = result_of(job, f"{name} seed {job.seed}: {faults}", flight.watches)
    if flight.stands_still:
        result.stands_still = True
    elif left := vehicles_left(flight):
        modes = ", ".join(f"{vehicle.system_id} in {vehicle.autopilot.mode.name}" for vehicle in left)
        result.stuck = f"after {flight.t_s:.0f} s in the air: {modes}"
    return result


def vehicles_left(flight: Flight) -> list[SimVehicle]:
    """Return the vehicles in the air of a mission that did not end, but those that arrived or are lost."""
    if flight.run.ended:
        return []
    last = flight.watches[0].statuses
    flying = [
        vehicle for vehicle in flight.run.vehicles.values() if vehicle.alive and vehicle.autopilot.flying
    ]
    return [one for one in flying if last.get(one.system_id, "active") not in ("lost", "arrived")]


def jobs_of(options: argparse.Namespace) -> list[Job]:
    if options.missions:
        return [Job(seed) for seed in range(options.first, options.first + options.missions)]
    seeds = range(options.first, options.first + options.seeds)
    cells = itertools.product(options.autopilots, options.kinds, options.moments, seeds)
    return [Job(seed, kind, autopilot, moment) for autopilot, kind, moment, seed in cells]


def results_of(jobs: list[Job], workers: int) -> Iterator[Result]:
    fly = fly_moment if jobs[0].kind else fly_random
    if workers == 1:
        warm_up()
        yield from map(fly, jobs)
        return
    with ProcessPoolExecutor(workers, initializer=warm_up) as pool:
        yield from pool.map(fly, jobs)


def row(name: str, results: list[Result], kind: str = "") -> str:
    """Return one row of the table; of one kind's delays, if it is given."""
    delays = [s for result in results for what, s in result.told_s if kind in ("", what)]
    in_time = sum(s is not None and s <= TOLD_S for s in delays)
    again = [s for result in results for s in result.reassigned_s]
    again_in_time = sum(s is not None and s <= REASSIGNED_S for s in again)
    return (
        f"| {name} | {len(results)} | {in_time} of {len(delays)} "
        f"| {quantile(delays, 0.5)}, {quantile(delays, 0.95)}, {quantile(delays, 1.0)} "
        f"| {again_in_time} of {len(again)} | {quantile(again, 0.5)}, {quantile(again, 1.0)} "
        f"| {sum(bool(result.misattributed) for result in results)} "
        f"| {sum(bool(result.steered) for result in results)} "
        f"| {sum(bool(result.unasked) for result in results)} "
        f"| {sum(bool(result.stuck) for result in results)} "
        f"| {sum(result.stands_still for result in results)} |"
    )


def print_table(results: list[Result], is_random: bool) -> None:
    print("| faults | flights | told within 3 s | delay, s: median, 95 %, most | re-assigned within 5 s "
          "| delay, s: median, most | told as a person's choice | sent against a mode "
          "| take-offs unasked | stuck | told to stand still |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    if is_random:
        for kind in KINDS:
            having = [result for result in results if any(what == kind for what, _ in result.told_s)]
            print(row(kind, having, kind))
    else:
        for autopilot, kind in itertools.product(AUTOPILOTS, KINDS):
            having = [r for r in results if (r.job.autopilot, r.job.kind) == (autopilot, kind)]
            if having:
                print(row(f"{autopilot}, {kind}", having))
    print(row("all", results))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--missions", type=int, default=0, help="random missions; 0: the table")
    parser.add_argument("--first", type=int, default=1, help="the first seed; default 1")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--kinds", nargs="*", choices=KINDS, default=KINDS)
    parser.add_argument("--moments", nargs="*", choices=MOMENTS, default=MOMENTS)
    parser.add_argument("--autopilots", nargs="*", choices=AUTOPILOTS, default=AUTOPILOTS)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--list", action="store_true", help="print what missed a bar, with its notices")
    options = parser.parse_args()
    results = []
    for result in results_of(jobs_of(options), options.workers):
        results.append(result)
        if options.list and result.problems:
            print(f"{result.text}: {'; '.join(result.problems)}", flush=True)
            for notice in result.notices:
                print(f"    {notice}")
    print_table(results, bool(options.missions))


if __name__ == "__main__":
    main()
