"""Golden runs: short flights whose results are kept, so that nothing changes unnoticed.

Each `NAME.mcap` here is a recording as every run leaves one. It is replayed through a fresh central command,
and its effects are compared with the recorded ones: pictures, plans, uploads, statuses, answers to orders.
Messages to vehicles and the wording of notices are left out: they change for good reasons, and what they
bring about is compared.

The engine is deterministic, but its numbers are those of libraries and of code that numba compiles
for the processor at hand: another version, or a processor that fuses a multiplication with an addition, may
round the last digit otherwise. So results are compared byte for byte where all versions and the processor are
those of the recording, and elsewhere by value, where floats may differ by `TOLERANCE` (relative, and absolute
in the unit of the field). All that is no float (labels, who flies where, numbers of scans, times) must be
equal in either case.

A changed behaviour fails here. When it was meant to change, `python tests/recordings/renew.py` flies all of
them anew and says what is different.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import Any

import msgspec

from gcs.cli.analyse.whatif import Comparison
from gcs.config import Config, parse
from gcs.io.record_json import encode
from gcs.io.recording.folder import Run, versions
from gcs.io.recording.reader import Damage, Record, read, read_info
from gcs.io.recording.recorder import Recorder
from gcs.io.recording.topics import topic_of
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    Effect,
    Kind,
    MissionEnded,
    NoFlyZone,
    Order,
    OrderAnswer,
    Picture,
    Plan,
    Proposal,
    Truth,
    UploadReport,
)
from gcs.report.run.evaluation import Evaluator
from gcs.service.replay import Replay, Window
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import Scenario, load, parse_scenario

HERE = Path(__file__).parent
COMPARED = (Picture, Plan, UploadReport, AgentStatus, MissionEnded, OrderAnswer, Proposal)
TOLERANCE = 1e-6


# ---------------------------------------------------------------- the flights


@dataclass(frozen=True)
class Golden:
    """One flight."""

    name: str
    shows: str
    scenario: str
    duration_s: float
    changes: tuple[tuple[str, str], ...] = ()
    """Text of the scenario and what stands there instead, at each place."""
    loss: float = 0.0
    orders: tuple[Order, ...] = ()

    @property
    def path(self) -> Path:
        return HERE / f"{self.name}.mcap"


def _order(at_s: float, action: Any, *vehicles: int, **fields: Any) -> Order:
    t_ns = START_T_NS + round(at_s * NS_PER_S)
    return Order(t_ns, f"{action}-{at_s:g}", action, tuple(vehicles) or None, **fields)


_EARLY = ("{ system_id = 2, at_s = 50.0 }", "{ system_id = 2, at_s = 9.0 }")
_NEAR = ("east_m = 1750.0\nnorth_m = 250.0", "east_m = 420.0\nnorth_m = 250.0")
_WALL = NoFlyZone("wall", polygon_m=((700.0, 1150.0), (900.0, 1150.0), (900.0, 1500.0), (700.0, 1500.0)))

GOLDEN = (
    Golden("death", "an arrival, a death, its re-task", "prescribed", 30.0, (_EARLY, _NEAR)),
    Golden("radars", "two radars and a camera, late scans, births anywhere", "radars", 15.0),
    Golden("loss", "every fifth datagram lost, each way", "prescribed", 20.0, (_NEAR,), loss=0.2),
    Golden(
        "orders",
        "a no-fly zone, one vehicle held and resumed, one sent home",
        "prescribed",
        25.0,
        orders=(
            _order(6.0, "no-fly-zone", no_fly_zone=_WALL),
            _order(9.0, "hold", 4),
            _order(15.0, "resume", 4),
            _order(18.0, "return", 1),
        ),
    ),
)


def fly(golden: Golden, folder: Path) -> Path:
    """Fly it and record it below `folder`; return the recording."""
    run = VirtualRun(_scenario(golden), seed=1, loss=golden.loss, orders=golden.orders)
    config = run.scenario.config
    with Recorder(folder / golden.name, run.scenario.text, versions(), Run(config.name, 1)) as recorder:
        run.on_event = recorder.record_event
        run.on_effect = recorder.record_effect
        run.on_truth = recorder.record_truth
        run.run(golden.duration_s)
    return folder / golden.name / "run.mcap"


def _scenario(golden: Golden) -> Scenario:
    text = load(golden.scenario).text
    for old, new in golden.changes:
        if old not in text:
            raise ValueError(
                f"{golden.name}: {golden.scenario} no longer holds {old!r}; see GOLDEN in golden.py"
            )
        text = text.replace(old, new)
    return parse_scenario(text, golden.name)


# ---------------------------------------------------------------- the comparison


@dataclass(frozen=True)
class Difference:
    """The first thing that is not as it was."""

    t_s: float
    topic: str
    what: str
    """Field, as in ``tracks[2].mean[0]``."""
    before: str
    after: str

    def __str__(self) -> str:
        return f"at {self.t_s:.3f} s, {self.topic}, {self.what}: was {self.before}, is {self.after}"


@dataclass
class Result:
    """A recording held against what is made of it now."""

    exact: bool
    """Whether bytes were compared, or values."""
    compared: int
    different: int
    first: Difference | None
    outcome: list[tuple[str, str, str]]
    """What, before, after."""

    def __str__(self) -> str:
        how = (
            "byte for byte" if self.exact else f"by value, within {TOLERANCE:g}: other versions or processor"
        )
        if self.first is None:
            return f"all {self.compared} results are as they were ({how})"
        lines = [f"{self.different} of {self.compared} results differ ({how}); the first {self.first}"]
        width = max(len(what) for what, _, _ in self.outcome)
        for what, before, after in self.outcome:
            changed = before if before == after else f"{before}  ->  {after}"
            lines.append(f"  {'  ' if before == after else '* '}{what:{width}}  {changed}")
        lines.append("  (the recorded vehicles fly on as they did: missions that differ go unanswered)")
        return "\n".join(lines)


def compare(path: Path) -> Result:
    """Replay a recording and hold the result against what it holds."""
    made_with = read_info(path)
    assert made_with.run is not None, f"{path} does not say its seed"
    config = parse(made_with.config_text, str(path))
    records = list(read(path))
    broken = [record.value.problem for record in records if isinstance(record.value, Damage)]
    assert not broken, f"{path}: {broken}"
    exact = made_with.versions == versions()
    replay = Replay(config, made_with.run.seed, records, Window())
    fields, course, ospa = _Fields(exact, records[0].t_ns), Comparison(), _Ospa(config, records)
    replay.watchers += [fields, course, ospa]
    asyncio.run(replay.run(asyncio.Event(), math.inf))
    outcome = [(row.what, row.recorded, row.replayed) for row in course.rows(records[0].t_ns)]
    return Result(exact, fields.compared, fields.different, fields.first, [*ospa.rows(), *outcome])


@dataclass
class _Fields:
    """Compares event by event, and field by field where something differs."""

    exact: bool
    start_t_ns: int
    compared: int = 0
    different: int = 0
    first: Difference | None = None
    _t_ns: int = 0
    _now: list[Effect] = field(default_factory=list)
    _then: list[Effect] = field(default_factory=list)

    def event(self, number: int, t_ns: int, effects: list[Effect], *, in_window: bool) -> None:
        self._close()
        self._now.extend(effect for effect in effects if isinstance(effect, COMPARED))
        self._t_ns = t_ns

    def recorded(self, record: Record, effect: Effect) -> None:
        if isinstance(effect, COMPARED):
            self._then.append(effect)

    def end(self, number: int, t_ns: int, *, broken_off: bool) -> None:
        self._close()

    def _close(self) -> None:
        """Judge what came of one event: like with like, so that one effect too few is one difference."""
        for topic in dict.fromkeys(map(topic_of, [*self._then, *self._now])):
            of_topic = ([one for one in side if topic_of(one) == topic] for side in (self._then, self._now))
            for then, now in zip_longest(*of_topic):
                self.compared += 1
                found = self._difference(topic, then, now)
                if found is not None:
                    self.different += 1
                    self.first = self.first or found
        self._then.clear()
        self._now.clear()

    def _difference(self, topic: str, then: Effect | None, now: Effect | None) -> Difference | None:
        t_s = (self._t_ns - self.start_t_ns) / NS_PER_S
        if then is None or now is None:
            return Difference(t_s, topic, "the whole", _short(then), _short(now))
        before, after = encode(then), encode(now)
        if before == after:
            return None
        tolerance = 0.0 if self.exact else TOLERANCE
        for what, one, other in differences(
            msgspec.json.decode(before), msgspec.json.decode(after), tolerance
        ):
            return Difference(t_s, topic, what, one, other)
        return None


def differences(before: Any, after: Any, tolerance: float, at: str = "") -> Iterator[tuple[str, str, str]]:
    """Yield the fields in which two decoded JSON values differ: where, before, after."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in {**before, **after}:
            yield from differences(before.get(key), after.get(key), tolerance, f"{at}.{key}" if at else key)
    elif isinstance(before, list) and isinstance(after, list):
        if len(before) != len(after):
            yield f"length of {at}", str(len(before)), str(len(after))
        for index, (one, other) in enumerate(zip(before, after, strict=False)):
            yield from differences(one, other, tolerance, f"{at}[{index}]")
    elif isinstance(before, float) and isinstance(after, float):
        if not math.isclose(before, after, rel_tol=tolerance, abs_tol=tolerance):
            yield at, repr(before), repr(after)
    elif before != after:
        yield at, _short(before), _short(after)


class _Ospa:
    """Judges both courses against the recorded truth."""

    def __init__(self, config: Config, records: list[Record]) -> None:
        agents = [agent.vehicle for agent in config.agents]
        self._evaluators = [Evaluator(config.planning.capture_radius_m, agents) for _ in range(2)]
        for record in records:
            if isinstance(record.value, Truth):
                for evaluator in self._evaluators:
                    evaluator.add_truth(record.value)

    def event(self, number: int, t_ns: int, effects: list[Effect], *, in_window: bool) -> None:
        for effect in effects:
            self._evaluators[1].add_effect(effect)

    def recorded(self, record: Record, effect: Effect) -> None:
        self._evaluators[0].add_effect(effect)

    def end(self, number: int, t_ns: int, *, broken_off: bool) -> None:
        pass

    def rows(self) -> list[tuple[str, str, str]]:
        then, now = self._evaluators
        kinds: tuple[Kind, ...] = ("agents", "targets")
        return [
            (f"OSPA of {kind}", f"{then.ospa(kind).mean_m:.4f} m", f"{now.ospa(kind).mean_m:.4f} m")
            for kind in kinds
        ]


def _short(value: Any) -> str:
    text = "nothing" if value is None else value if isinstance(value, str) else ""
    if not text:
        text = encode(value).decode() if isinstance(value, COMPARED) else repr(value)
    return text if len(text) <= 120 else f"{text[:119]}…"
