"""What one sensor with a valid certificate can do alone: simulated missions with a second, hostile sensor.

`prescribed` is flown with its radar (a scan a second) and position reports at 4 Hz. From 60 s on the hostile
sensor announces itself as nearly perfect over the whole map. It reports every object truly, except for one
lie:

- ``kill an agent``: agent 3, which flies and reports, is left out. Seconds until it counts as lost.
- ``kill a target``: target 0 is left out. Seconds until no track is near it.
- ``ghost``: a target where nothing is. Seconds until a vehicle is sent there.
- ``move a target``: target 0 is dragged away (`--drag-m-s`). Seconds in which no probable track is near it,
  and how long after the beginning the last of them was.
- ``move an agent``: agent 3 is dragged away. Greatest distance from it to the nearest track, in metres.
- ``revive``: agent 2, which crashes at 50 s, flies on. Seconds after the crash until it counts as lost.

Each for hostile scans at 1, 2 and 10 Hz, within 60 s; "no" if it does not come about.

Behind each the seconds until an alarm says that the two sensors contradict each other.

    python tests/bench/bench_rogue_sensor.py [--seeds 3] [--lies revive ghost] [--drag-m-s 5]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gcs.model import NS_PER_S, AgentStatus, Effect, Notice, NoticeCode, Picture, Plan, Scan, Sensor, Truth
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import load

BEGIN_S, END_S, CRASH_S = 60.0, 120.0, 50.0
AGENT, CRASHED, TARGET = 3, 2, 0
GHOST_M: Final = np.array([1500.0, 1850.0])
NEAR_M = 40.0
FIELD_M = (-200.0, -200.0, 2200.0, 2200.0)
LIES = ("none", "kill an agent", "kill a target", "ghost", "move a target", "move an agent", "revive")


@dataclass
class Watch:
    """What central command says, and the ground truth."""

    pictures: dict[str, Picture] = field(default_factory=dict)
    truths: list[Truth] = field(default_factory=list)
    lost_s: dict[int, float] = field(default_factory=dict)
    to_ghost_s: float | None = None
    alarm_s: float | None = None
    """First time that two sensors contradict each other."""

    def effect(self, t_ns: int, effect: Effect) -> None:
        """Note pictures, losses, and the first route to the ghost."""
        t_s = (t_ns - START_T_NS) / NS_PER_S
        if isinstance(effect, Picture):
            self.pictures[effect.kind] = effect
        elif isinstance(effect, AgentStatus) and effect.status == "lost":
            self.lost_s.setdefault(effect.vehicle, t_s)
        elif isinstance(effect, Notice) and effect.code is NoticeCode.SENSORS_CONTRADICT:
            self.alarm_s = t_s if self.alarm_s is None else self.alarm_s
        elif isinstance(effect, Plan) and self.to_ghost_s is None and "targets" in self.pictures:
            ghosts = {
                track.label
                for track in self.pictures["targets"].tracks
                if np.hypot(*(track.mean[:2] - GHOST_M)) < NEAR_M
            }
            if any(route.target in ghosts for route in effect.routes):
                self.to_ghost_s = t_s

    def distance_m(self, kind: str, place: np.ndarray) -> float:
        """Return the distance from a place to the nearest probable track."""
        tracks = [track for track in self.pictures[kind].tracks if track.existence > 0.5]
        return min((float(np.hypot(*(track.mean[:2] - place))) for track in tracks), default=np.inf)

    def targets(self, t_ns: int) -> dict[int, np.ndarray]:
        """Return the true positions of targets, from the last two ground truths."""
        before, last = self.truths[-2:]
        old = {one.id: one for one in before.objects if one.kind == "targets"}
        part = (t_ns - last.t_ns) / (last.t_ns - before.t_ns)
        found = {}
        for one in last.objects:
            if one.kind == "targets" and one.id in old:
                now = np.array([one.east_m, one.north_m])
                found[one.id] = now + part * (now - np.array([old[one.id].east_m, old[one.id].north_m]))
        return found


class Rogue:
    """The hostile sensor."""

    def __init__(self, lie: str, drag_m_s: float, run: VirtualRun, watch: Watch) -> None:
        self.lie, self.drag_m_s, self.run, self.watch = lie, drag_m_s, run, watch
        self.rng = np.random.default_rng(1)
        self.wreck: tuple[np.ndarray, np.ndarray] | None = None
        """Place and velocity of the crashed agent before its crash."""

    def agents(self) -> dict[int, np.ndarray]:
        """Return the true positions of living agents."""
        vehicles = self.run.vehicles.values()
        return {v.system_id: np.array([v.east_m, v.north_m]) for v in vehicles if v.alive}

    def scan(self, t_s: float) -> Scan:
        """Return a scan of now."""
        t_ns = self.run.t_ns
        agents, targets = self.agents(), self.watch.targets(t_ns)
        away = np.array([0.0, self.drag_m_s * (t_s - BEGIN_S)])
        match self.lie:
            case "kill an agent":
                agents.pop(AGENT)
            case "kill a target":
                targets.pop(TARGET)
            case "ghost":
                targets[99] = GHOST_M
            case "move a target":
                targets[TARGET] = targets[TARGET] + away
            case "move an agent":
                agents[AGENT] = agents[AGENT] + away
            case "revive" if self.wreck is not None:
                place, velocity = self.wreck
                agents[CRASHED] = place + velocity * (t_s - CRASH_S)
        places = np.array([*agents.values(), *targets.values()])
        detections = places + self.rng.normal(0.0, 1.0, places.shape)
        sensor = Sensor("rogue", 0.99, 1e-9, np.eye(2), FIELD_M)
        return Scan(t_ns, t_ns, sensor, detections)


def fly(lie: str, drag_m_s: float, rate_hz: float, seed: int) -> str:
    """Fly; return what came of the lie, and when an alarm named both sensors."""
    watch = Watch()
    run = VirtualRun(load("prescribed"), seed, on_effect=watch.effect, on_truth=watch.truths.append)
    rogue = Rogue(lie, drag_m_s, run, watch)
    begin_s = CRASH_S if lie == "revive" else BEGIN_S
    run.run(CRASH_S - 1.0)
    before = rogue.agents()[CRASHED]
    run.run(CRASH_S - 0.5)
    wreck = rogue.agents()[CRASHED]
    rogue.wreck = wreck, (wreck - before) / 0.5
    worst_m = 0.0
    gone_s: list[float] = []
    """Times at which no track is near target 0."""
    next_s = begin_s
    while (t_s := (run.t_ns - START_T_NS) / NS_PER_S) < END_S and not run.ended:
        run.run(t_s + 0.01)
        if t_s < next_s:
            continue
        next_s += 1.0 / rate_hz
        if lie != "none":
            run._step(rogue.scan(t_s))
        if lie in ("move an agent", "kill an agent"):
            worst_m = max(worst_m, watch.distance_m("agents", rogue.agents()[AGENT]))
        elif t_s > BEGIN_S:
            distance_m = watch.distance_m("targets", watch.targets(run.t_ns)[TARGET])
            worst_m = max(worst_m, distance_m)
            if distance_m > NEAR_M:
                gone_s.append(t_s)
    came = outcome(lie, watch, gone_s, worst_m)
    if lie == "move a target":
        last = f", last {seconds(gone_s[-1], BEGIN_S)}" if gone_s else ""
        came = f"{len(gone_s) / rate_hz:.1f} s{last}"
    return f"{came} (alarm {seconds(watch.alarm_s, begin_s)})"


def outcome(lie: str, watch: Watch, gone_s: list[float], worst_m: float) -> str:
    """Return what came of the lie."""
    match lie:
        case "kill an agent":
            return seconds(watch.lost_s.get(AGENT), BEGIN_S)
        case "kill a target":
            return seconds(min(gone_s, default=None), BEGIN_S)
        case "ghost":
            return seconds(watch.to_ghost_s, BEGIN_S)
        case "revive":
            return seconds(watch.lost_s.get(CRASHED), CRASH_S)
        case "none":
            return f"{worst_m:.0f} m, agent 2 lost after {seconds(watch.lost_s.get(CRASHED), CRASH_S)}"
    return f"{worst_m:.0f} m"


def seconds(t_s: float | None, since_s: float) -> str:
    """Return a duration as text."""
    return "no" if t_s is None else f"{t_s - since_s:.1f} s"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--lies", nargs="+", choices=LIES, default=LIES)
    parser.add_argument("--drag-m-s", type=float, default=5.0, help="speed of the drag")
    arguments = parser.parse_args()
    for lie in arguments.lies:
        for rate_hz in (1.0, 2.0, 10.0):
            results = [fly(lie, arguments.drag_m_s, rate_hz, seed) for seed in range(1, arguments.seeds + 1)]
            print(f"{lie:15} {rate_hz:4.0f} Hz  {'; '.join(results)}", flush=True)


if __name__ == "__main__":
    main()
