"""Detection of losses: central command's rule and a plain threshold, on the same pictures.

The plain rule is the paper's: an agent is active while the existence probability of its track reaches a
threshold at each scan. Clutter near a lost agent makes it active again, and a missed detection may make it
lost. Central command's rule has hysteresis (`gcs.core.perception.arrival_and_loss`).

The track of an agent follows from the ground truth: the nearest within `NEAR_M`, and after its loss the same
label. Both rules are evaluated until the agent arrives.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from gcs.model import NS_PER_S, AgentStatus, Effect, Label, Picture, Truth, TruthObject

NEAR_M = 50.0
PLAIN_EXISTENCE = 0.5


@dataclass(frozen=True, slots=True)
class LossDetection:
    """Result of one rule."""

    delays_s: tuple[float, ...]
    """Delay of the detection of each loss."""
    false_losses: int
    """Number of false detections."""
    revivals: int
    """Number of lost agents that became active again."""


@dataclass(slots=True)
class _Watched:
    """State of one agent by the plain rule."""

    label: Label | None = None
    seen: bool = False
    called_lost: bool = False
    lost_t_ns: int | None = None
    arrived: bool = False
    delay_s: float | None = None
    false_losses: int = 0
    revivals: int = 0


@dataclass(slots=True)
class LossWatch:
    """Evaluates the ground truth and the effects of a run in order; ground truth precedes its picture."""

    _ground_truth: dict[int, tuple[TruthObject, ...]] = field(default_factory=dict)
    _agents: dict[int, _Watched] = field(default_factory=dict)
    _statuses: list[AgentStatus] = field(default_factory=list)
    _flown_s: float = 0.0
    _last_t_ns: int | None = None

    def add_truth(self, truth: Truth) -> None:
        """Add the ground truth at one scan."""
        agents = tuple(thing for thing in truth.objects if thing.kind == "agents")
        self._ground_truth = {truth.t_ns: agents}
        elapsed_s = 0.0 if self._last_t_ns is None else (truth.t_ns - self._last_t_ns) / NS_PER_S
        self._last_t_ns = truth.t_ns
        for agent in agents:
            watched = self._agents.setdefault(agent.id, _Watched())
            if agent.alive and not watched.arrived:
                self._flown_s += elapsed_s
            elif not agent.alive and not watched.arrived and watched.lost_t_ns is None:
                watched.lost_t_ns = truth.t_ns

    def add_effect(self, effect: Effect) -> None:
        """Add an effect of central command."""
        match effect:
            case AgentStatus():
                self._statuses.append(effect)
                if effect.vehicle in self._agents:
                    self._agents[effect.vehicle].arrived |= effect.status == "arrived"
            case Picture(kind="agents"):
                for agent in self._ground_truth.get(effect.scan_t_ns, ()):
                    self._apply_plain_rule(agent, effect)

    @property
    def agent_hours(self) -> float:
        """Total flight time of agents until arrival or loss."""
        return self._flown_s / 3600.0

    @property
    def losses(self) -> int:
        """Agents that were lost before they arrived."""
        return sum(watched.lost_t_ns is not None for watched in self._agents.values())

    def plain(self) -> LossDetection:
        """Result of the plain threshold."""
        agents = self._agents.values()
        delays = tuple(watched.delay_s for watched in agents if watched.delay_s is not None)
        return LossDetection(delays, sum(w.false_losses for w in agents), sum(w.revivals for w in agents))

    def ours(self) -> LossDetection:
        """Result of central command."""
        delays = []
        false_losses = 0
        revivals = 0
        found = set[int]()
        for change in self._statuses:
            watched = self._agents.get(change.vehicle)
            if watched is None:
                continue
            is_lost = watched.lost_t_ns is not None and change.t_ns >= watched.lost_t_ns
            if change.status == "lost" and not is_lost:
                false_losses += 1
            elif change.status == "lost" and change.vehicle not in found:
                assert watched.lost_t_ns is not None
                delays.append((change.t_ns - watched.lost_t_ns) / NS_PER_S)
                found.add(change.vehicle)
            elif change.status == "active" and change.vehicle in found:
                revivals += 1
        return LossDetection(tuple(delays), false_losses, revivals)

    def _apply_plain_rule(self, agent: TruthObject, picture: Picture) -> None:
        watched = self._agents[agent.id]
        if watched.arrived:
            return
        if agent.alive:
            watched.label = _nearest(agent, picture) or watched.label
        existence = next((t.existence for t in picture.tracks if t.label == watched.label), 0.0)
        is_alive = existence >= PLAIN_EXISTENCE
        watched.seen = watched.seen or is_alive
        if not watched.seen:
            return
        if agent.alive:
            watched.false_losses += not is_alive and not watched.called_lost
        elif not is_alive and watched.delay_s is None and watched.lost_t_ns is not None:
            watched.delay_s = (picture.scan_t_ns - watched.lost_t_ns) / NS_PER_S
        elif is_alive and watched.called_lost:
            watched.revivals += watched.delay_s is not None
        watched.called_lost = not is_alive


def _nearest(agent: TruthObject, picture: Picture) -> Label | None:
    """Return the label of the most likely track of an agent: near, with the greatest existence."""
    near = [
        (-track.existence, track.label)
        for track in picture.tracks
        if math.hypot(track.mean[0] - agent.east_m, track.mean[1] - agent.north_m) <= NEAR_M
    ]
    return min(near)[1] if near else None
