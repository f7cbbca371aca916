"""Model of the lease: all interleavings of asks, answers, effects, ticks and restarts, breadth first.

Nodes and bridges are the functions of `gcs.core.lease`. The network loses, delays and reorders any message:
a sent message waits until it is delivered, now or never, and a number of messages are delivered twice. A
node or bridge that is down or cut off is one to which nothing happens. Restarts forget everything. Each
machine has its own clock; some of them may lose a tick.

States are equal when they can lead to the same. So times that have passed are forgotten, and effects that
no bridge will accept any more (`Model.settle`).

Effects need no moves of their own: a node sends one with each permit that it has, and a bridge may get it
at any later time. So each state is checked with all effects that were sent before it. One vehicle is
reached over all bridges.

A reign is a time in which effects of one process only would be accepted. The invariants, in each state:

holder   a bridge accepts effects of the process only that has its lease, or had it last
epoch    after effects of an epoch, a bridge accepts none of an epoch before; no epoch is granted twice
order    after effects of a reign, no bridge accepts effects of a reign before
one      effects of two processes that are sent now are not both accepted
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, TypeAlias, TypeVar

from gcs.core.lease import bridge_lease, node_lease
from gcs.core.lease.bridge_lease import BridgeLease
from gcs.core.lease.lease_messages import NO_STANDING, Answer, Ask, Epoch, LeaseTimes, NodeId, Permit
from gcs.core.lease.node_lease import BridgeView, NodeLease

T = TypeVar("T")
NODES = "AB"
NODE_CLOCK = 100
"""What the clocks of nodes show at first."""
BRIDGE_CLOCK = 1000
"""What the clocks of bridges show at first."""
TIMES = LeaseTimes(lease_ns=2, period_ns=1, margin_ns=0, claim_ns=1)
"""In ticks; without a margin, since clocks run equally here."""
DRIFT_TIMES = LeaseTimes(lease_ns=2, period_ns=1, margin_ns=1, claim_ns=1)
"""With a margin of one tick, for clocks of which one loses a tick."""


@dataclass(frozen=True)
class Rules:
    """The protocol; tests replace parts of it by wrong ones."""

    start_lease: Callable[..., BridgeLease] = bridge_lease.start_lease
    answer_ask: Callable[..., tuple[BridgeLease, Answer]] = bridge_lease.answer_ask
    accepts: Callable[..., bool] = bridge_lease.accepts
    receive_answer: Callable[..., NodeLease] = node_lease.receive_answer
    permit_for: Callable[..., Permit | None] = node_lease.permit_for
    new_boot: Callable[[int], int] = lambda restarts: restarts
    """Random number of a bridge after so many restarts of any bridge."""


@dataclass(frozen=True)
class Bounds:
    """Size of the model."""

    bridges: int = 1
    ticks: int = 6
    asks: tuple[int, ...] = (2, 2)
    """Asks of each node; one goes to every bridge that is due."""
    twice: int = 0
    """Messages that are delivered twice."""
    node_restarts: int = 0
    bridge_restarts: int = 0
    lost_ticks: int = 0
    """Ticks that a clock loses."""
    reach: tuple[str, ...] = ()
    """Bridges that each node reaches after the cut; empty for all."""
    cut_t: tuple[int, ...] = (0, 0)
    """Tick from which asks of each node reach only these bridges."""
    is_held: bool = True
    """True to begin with a lease of all bridges of the first node."""


class Effect(NamedTuple):
    """Effect that was sent; for one bridge, epoch and reign the one with the latest permit."""

    bridge: int
    node: NodeId
    permit: Permit
    reign: int


class Message(NamedTuple):
    """Message on its way."""

    bridge: int
    body: Ask | Answer


class Part:
    """Value of which one object exists, which makes states quick to compare; see `Model.part`."""

    __slots__ = ("value",)

    def __init__(self, value: Any) -> None:
        self.value = value


Move: TypeAlias = str | Part
"""Move in words, or the message that arrives."""


class State(NamedTuple):
    """State of the model; the last six are of the invariants."""

    t: int
    clocks: tuple[int, ...]
    """Lost ticks of nodes, then of bridges."""
    nodes: tuple[Part, ...]
    """Each a `NodeLease`."""
    bridges: tuple[Part, ...]
    """Each a `BridgeLease`."""
    messages: frozenset[Part]
    """Each a `Message`."""
    asks: tuple[int, ...]
    """Left for each node; so are the next three."""
    twice: int
    node_restarts: int
    bridge_restarts: int
    effects: frozenset[Effect] = frozenset()
    sender: NodeId | None = None
    reign: int = 0
    accepted_reign: int = 0
    grants: tuple[tuple[Epoch, ...], ...] = ()
    """Epochs of each bridge in the order of their grants."""
    accepted: tuple[int, ...] = ()
    """Index of the latest epoch of each bridge of which effects were accepted; -1 for none."""


class ViolationError(AssertionError):
    """An invariant does not hold; the text is its name and the moves that led there."""


class Model:
    """Explorer of all states."""

    def __init__(self, bounds: Bounds, rules: Rules | None = None, times: LeaseTimes = TIMES) -> None:
        self.bounds = bounds
        self.rules = rules or Rules()
        self.is_bridge_right = self.rules.answer_ask is bridge_lease.answer_ask
        self.is_node_right = self.rules.receive_answer is node_lease.receive_answer
        self.is_fenced = self.rules.accepts is bridge_lease.accepts and self.rules.new_boot(1) != 0
        self.times = times
        self.names = tuple("xyz"[: bounds.bridges])
        self.part = cache(Part)
        self.asked = cache(self._asked)
        self.answered = cache(self._answered)
        self.received = cache(self._received)
        self.permits = cache(self._permits)
        self.is_accepted = cache(self._is_accepted)
        self.settled_node = cache(self._settled_node)
        self.settled_bridge = cache(self._settled_bridge)
        self.is_spent = cache(self._is_spent)

    def start(self) -> State:
        """Return the first state."""
        bounds = self.bounds
        state = State(
            0,
            (0,) * (len(bounds.asks) + bounds.bridges),
            tuple(self.new_node(n, 0, NODE_CLOCK) for n in range(len(bounds.asks))),
            tuple(self.new_bridge(0, BRIDGE_CLOCK - self.times.lease_ns) for _ in self.names),
            frozenset(),
            bounds.asks,
            bounds.twice,
            bounds.node_restarts,
            bounds.bridge_restarts,
            grants=((),) * bounds.bridges,
            accepted=(-1,) * bounds.bridges,
        )
        if bounds.is_held:
            node, sent = self.asked(state.nodes[0], NODE_CLOCK)
            state = state._replace(nodes=_with(state.nodes, 0, node), messages=frozenset(sent))
            while state.messages:
                state = self.deliver(state, next(iter(state.messages)), is_kept=False)
        return self.settle(self.send_effects(state))

    def new_node(self, n: int, run: int, t: int) -> Part:
        """Return a node that starts."""
        is_only_node = len(self.bounds.asks) == 1
        return self.part(
            node_lease.start_node(
                NodeId(NODES[n], run), self.names, t, delay_ns=0, is_only_node=is_only_node, times=self.times
            )
        )

    def new_bridge(self, restarts: int, t: int) -> Part:
        """Return a bridge that starts."""
        is_only_bridge = self.bounds.bridges == 1
        boot = self.rules.new_boot(restarts)
        return self.part(self.rules.start_lease(boot, t, is_only_bridge=is_only_bridge, times=self.times))

    def time_of_node(self, state: State, n: int) -> int:
        """Return what the clock of a node shows."""
        return NODE_CLOCK + state.t - state.clocks[n]

    def time_of_bridge(self, state: State, b: int) -> int:
        """Return what the clock of a bridge shows."""
        return BRIDGE_CLOCK + state.t - state.clocks[len(self.bounds.asks) + b]

    # ---------------------------------------------------------------- moves

    def moves(self, state: State) -> Iterator[tuple[Move, State]]:
        """Yield each move that is possible in a state, and the state after it."""
        if state.t < self.bounds.ticks:
            yield "tick", state._replace(t=state.t + 1)
            if sum(state.clocks) < self.bounds.lost_ticks:
                for i in range(len(state.clocks)):
                    clocks = _with(state.clocks, i, state.clocks[i] + 1)
                    yield f"tick, clock {i} stands", state._replace(t=state.t + 1, clocks=clocks)
        for n in range(len(self.bounds.asks)):
            if state.asks[n] > 0:
                after = self.ask(state, n)
                if after is not state:
                    yield f"{NODES[n]} asks", after
            if state.node_restarts > 0:
                yield f"{NODES[n]} restarts", self.restart_node(state, n)
        if state.bridge_restarts > 0:
            for b in range(self.bounds.bridges):
                yield f"{self.names[b]} restarts", self.restart_bridge(state, b)
        for message in state.messages:
            yield message, self.deliver(state, message, is_kept=False)
            if state.twice > 0:
                after = self.deliver(state, message, is_kept=True)
                yield message, after._replace(twice=state.twice - 1)

    def ask(self, state: State, n: int) -> State:
        """Send the asks of a node that are due."""
        node, sent = self.asked(state.nodes[n], self.time_of_node(state, n))
        if not sent:
            return state
        if self.bounds.reach and state.t >= self.bounds.cut_t[n]:
            sent = [message for message in sent if self.names[message.value.bridge] in self.bounds.reach[n]]
        asks = _with(state.asks, n, state.asks[n] - 1)
        nodes = _with(state.nodes, n, node)
        return state._replace(nodes=nodes, messages=state.messages.union(sent), asks=asks)

    def _asked(self, node: Part, t: int) -> tuple[Part, list[Part]]:
        after, asks = node_lease.take_due_asks(node.value, t, self.times)
        sent = [self.part(Message(self.names.index(bridge), ask)) for bridge, ask in asks.items()]
        return self.part(after), sent

    def restart_node(self, state: State, n: int) -> State:
        """Start a new process of a node."""
        node = self.new_node(n, state.nodes[n].value.node.run + 1, self.time_of_node(state, n))
        return state._replace(nodes=_with(state.nodes, n, node), node_restarts=state.node_restarts - 1)

    def restart_bridge(self, state: State, b: int) -> State:
        """Start a new process of a bridge."""
        left = state.bridge_restarts - 1
        bridge = self.new_bridge(self.bounds.bridge_restarts - left, self.time_of_bridge(state, b))
        return state._replace(bridges=_with(state.bridges, b, bridge), bridge_restarts=left)

    def deliver(self, state: State, message: Part, *, is_kept: bool) -> State:
        """Deliver a message."""
        b, body = message.value
        messages = state.messages if is_kept else state.messages - {message}
        if isinstance(body, Answer):
            n = NODES.index(body.node.name)
            node = self.received(state.nodes[n], message, self.time_of_node(state, n))
            return state._replace(nodes=_with(state.nodes, n, node), messages=messages)
        after, answer = self.answered(state.bridges[b], message, self.time_of_bridge(state, b))
        state = self.note_grant(state, b, after.value)
        return state._replace(bridges=_with(state.bridges, b, after), messages=messages | {answer})

    def _received(self, node: Part, message: Part, t: int) -> Part:
        b, answer = message.value
        return self.part(self.rules.receive_answer(node.value, self.names[b], answer, t))

    def _answered(self, bridge: Part, message: Part, t: int) -> tuple[Part, Part]:
        b, ask = message.value
        after, answer = self.rules.answer_ask(bridge.value, ask, t, self.times)
        return self.part(after), self.part(Message(b, answer._replace(holder="")))

    def note_grant(self, state: State, b: int, after: BridgeLease) -> State:
        """Note the epoch that a bridge granted."""
        before = state.bridges[b].value
        if after.holder is None or (after.epoch, after.holder) == (before.epoch, before.holder):
            return state
        if after.epoch in state.grants[b]:
            raise ViolationError("epoch: granted twice")
        return state._replace(grants=_with(state.grants, b, (*state.grants[b], after.epoch)))

    # ---------------------------------------------------------------- effects and invariants

    def send_effects(self, state: State) -> State:
        """Send an effect with each permit; check the invariants with all effects that bridges accept."""
        sent: list[Effect] = []
        for n, node in enumerate(state.nodes):
            sent += self.permits(node, self.time_of_node(state, n))
        effects, sender, reign = state.effects, state.sender, state.reign
        arriving = sorted({effect.node for effect in sent if self.arrives(state, effect)})
        if len(arriving) > 1:
            raise ViolationError("one")
        if arriving and arriving[0] != sender:
            sender = arriving[0]
            reign += 1
        if sent:
            effects = _latest(effects, (e._replace(reign=reign if e.node == sender else 0) for e in sent))
        accepted_reign, accepted = state.accepted_reign, state.accepted
        for effect in sorted(effects, key=lambda effect: -effect.reign):
            if self.arrives(state, effect):
                accepted_reign, accepted = self.accept(state, effect, accepted_reign, accepted)
        return state._replace(
            effects=effects, sender=sender, reign=reign, accepted_reign=accepted_reign, accepted=accepted
        )

    def _permits(self, node: Part, t: int) -> list[Effect]:
        permits = [self.rules.permit_for(node.value, bridge, t, self.times) for bridge in self.names]
        return [
            Effect(b, node.value.node, permit, 0) for b, permit in enumerate(permits) if permit is not None
        ]

    def arrives(self, state: State, effect: Effect) -> bool:
        """Return True if the bridge accepts an effect now."""
        b = effect.bridge
        return self.is_accepted(state.bridges[b], effect.permit, self.time_of_bridge(state, b))

    def _is_accepted(self, bridge: Part, permit: Permit, t: int) -> bool:
        return self.rules.accepts(bridge.value, permit, t, self.times)

    def accept(
        self, state: State, effect: Effect, accepted_reign: int, accepted: tuple[int, ...]
    ) -> tuple[int, tuple[int, ...]]:
        """Check an accepted effect; return the latest reign, and the latest epoch of each bridge."""
        b = effect.bridge
        if effect.node != state.bridges[b].value.holder:
            raise ViolationError("holder")
        index = state.grants[b].index(effect.permit.epoch)
        if index < accepted[b]:
            raise ViolationError("epoch")
        if effect.reign < accepted_reign:
            raise ViolationError("order")
        return effect.reign, _with(accepted, b, index)

    # ---------------------------------------------------------------- equal states

    def settle(self, state: State) -> State:
        """Forget what makes no difference any more, as far as the rules are the right ones."""
        nodes = tuple(
            self.settled_node(node, self.time_of_node(state, n)) for n, node in enumerate(state.nodes)
        )
        bridges = tuple(
            self.settled_bridge(bridge, self.time_of_bridge(state, b))
            for b, bridge in enumerate(state.bridges)
        )
        messages = frozenset(m for m in state.messages if not self.is_spent(m, nodes))
        effects = state.effects
        if self.is_fenced:
            effects = frozenset(effect for effect in effects if self.arrives(state, effect))
        return state._replace(nodes=nodes, bridges=bridges, messages=messages, effects=effects)

    def _settled_node(self, part: Part, t: int) -> Part:
        """Replace times of a node that have passed."""
        node: NodeLease = part.value
        return self.part(node._replace(views=tuple(self._settled_view(view, t) for view in node.views)))

    def _settled_view(self, view: BridgeView, t: int) -> BridgeView:
        times = self.times
        hold = view.hold
        if hold is not None:
            since = max(hold.since_t_ns, t - times.lease_ns - times.margin_ns)
            hold = hold._replace(since_t_ns=since)
            if t >= hold.sent_t_ns + times.lease_ns and self.is_node_right:
                hold = hold._replace(permit=hold.permit._replace(t_ns=0), sent_t_ns=0)
        asked = max(view.asked_t_ns, t - times.period_ns)
        return view._replace(asked_t_ns=asked, free_t_ns=max(view.free_t_ns, t), hold=hold)

    def _settled_bridge(self, part: Part, t: int) -> Part:
        """Replace times of a bridge that have passed."""
        lease: BridgeLease = part.value
        times = self.times
        if self.is_bridge_right:
            lease = lease._replace(
                answered_t_ns=max(lease.answered_t_ns, t - times.lease_ns),
                opens_t_ns=max(lease.opens_t_ns, t),
                standing=lease.standing if bridge_lease.is_held(lease, t, times) else NO_STANDING,
            )
            if lease.claim is not None and t >= lease.claim.t_ns + times.claim_ns:
                lease = lease._replace(claim=None)
        return self.part(lease)

    def _is_spent(self, message: Part, nodes: tuple[Part, ...]) -> bool:
        """Return True for an answer that changes nothing any more."""
        b, body = message.value
        if isinstance(body, Ask):
            return False
        node: NodeLease = nodes[NODES.index(body.node.name)].value
        return self.is_node_right and (node.node != body.node or body.sent_t_ns < node.views[b].answered_t_ns)

    # ---------------------------------------------------------------- exploration

    def explore(self, max_states: int = 0, visit: Callable[[State], None] | None = None) -> int:
        """Visit all states, or so many; return their number.

        Raises
        ------
        ViolationError
            With the moves to the nearest state in which an invariant does not hold.
        """
        first = self.start()
        came: dict[State, tuple[State | None, Move]] = {first: (None, "")}
        queue = deque([first])
        while queue and not (max_states and len(came) >= max_states):
            state = queue.popleft()
            if visit is not None:
                visit(state)
            move: Move = ""
            moves = self.moves(state)
            try:
                for move, moved in moves:
                    after = self.settle(self.send_effects(moved))
                    if after not in came:
                        came[after] = (state, move)
                        queue.append(after)
            except ViolationError as error:
                text = "\n".join([str(error), *_moves_to(came, state), f"at the latest after {_text(move)}"])
                raise ViolationError(text) from None
        return len(came)


def _with(values: tuple[T, ...], index: int, value: T) -> tuple[T, ...]:
    """Return values with one replaced."""
    return (*values[:index], value, *values[index + 1 :])


def _latest(effects: frozenset[Effect], new: Iterable[Effect]) -> frozenset[Effect]:
    """Add effects; of those of one bridge, epoch and reign keep the one with the latest permit."""
    latest = {(e.bridge, e.permit.epoch, e.reign): e for e in effects}
    for effect in new:
        key = (effect.bridge, effect.permit.epoch, effect.reign)
        if key not in latest or latest[key].permit.t_ns < effect.permit.t_ns:
            latest[key] = effect
    return frozenset(latest.values())


def _moves_to(came: dict[State, tuple[State | None, Move]], state: State) -> list[str]:
    """Return the moves from the first state to another one."""
    moves = []
    before, move = came[state]
    while before is not None:
        moves.append(_text(move))
        before, move = came[before]
    return moves[::-1]


def _text(move: Move) -> str:
    """Return a move in words."""
    return move if isinstance(move, str) else f"{move.value} arrives"
