"""Two command nodes would both send to one vehicle, or none would after one has died.

`lease_model` says what is explored and which invariants are checked.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers.lease_model import (
    BRIDGE_CLOCK,
    DRIFT_TIMES,
    NODE_CLOCK,
    TIMES,
    Bounds,
    Model,
    Rules,
    State,
    ViolationError,
)

from gcs.core.lease import bridge_lease, node_lease
from gcs.core.lease.bridge_lease import BridgeLease
from gcs.core.lease.lease_messages import Answer, Ask, LeaseTimes, Permit
from gcs.core.lease.node_lease import Duty, NodeLease

ONE = Bounds(ticks=3, asks=(2, 2))
RESTARTS = Bounds(ticks=2, asks=(1, 1), node_restarts=1, bridge_restarts=1)
CUT = Bounds(bridges=2, ticks=5, asks=(1, 2), reach=("y", "x"), cut_t=(1, 0))
"""The first node holds both bridges; then it reaches only the second one, and the other node the first."""
CUT_RESTART = replace(CUT, ticks=2, cut_t=(0, 0), bridge_restarts=1)
LATE = Bounds(bridges=2, ticks=4, asks=(1, 2), reach=("y", "x"), cut_t=(1, 0), is_held=False)
"""The first node asks both bridges and is then cut off; the answers may be late."""


# ---------------------------------------------------------------- the protocol holds


@pytest.mark.parametrize(
    "bounds",
    [
        ONE,
        replace(ONE, ticks=2, twice=1),
        RESTARTS,
        CUT_RESTART,
        replace(CUT, ticks=4),
        Bounds(bridges=2, ticks=2, asks=(1, 1)),
    ],
    ids=["one bridge", "twice", "restarts", "cut and restart", "cut", "two bridges"],
)
def test_no_interleaving_breaks_an_invariant(bounds: Bounds) -> None:
    assert Model(bounds).explore() > 3000


@pytest.mark.parametrize("bounds", [replace(ONE, ticks=2), replace(CUT, ticks=3)], ids=["one bridge", "cut"])
def test_a_clock_may_lose_the_margin(bounds: Bounds) -> None:
    assert Model(replace(bounds, lost_ticks=1), times=DRIFT_TIMES).explore() > 1000


COMPLETE = [
    (Bounds(ticks=4), TIMES),
    (Bounds(ticks=3, asks=(1, 1), node_restarts=1, bridge_restarts=1), TIMES),
    (Bounds(ticks=4, lost_ticks=1), DRIFT_TIMES),
    (CUT, TIMES),
    (LATE, TIMES),
    (replace(CUT, ticks=4, lost_ticks=1), DRIFT_TIMES),
    (replace(CUT_RESTART, ticks=3), TIMES),
    (Bounds(bridges=2, ticks=2, asks=(1, 2)), TIMES),
]
"""All states are visited."""
BEGUN = [
    (Bounds(ticks=6), TIMES),
    (Bounds(ticks=4, asks=(3, 3)), TIMES),
    (Bounds(ticks=4, twice=1), TIMES),
    (replace(CUT, asks=(2, 2)), TIMES),
    (replace(CUT, ticks=4, reach=("y", "xy")), TIMES),
    (replace(CUT_RESTART, ticks=4), TIMES),
]
"""The million states that are nearest to the first one are visited."""


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(("bounds", "times"), COMPLETE + BEGUN)
def test_no_interleaving_breaks_an_invariant_in_larger_models(bounds: Bounds, times: LeaseTimes) -> None:
    assert Model(bounds, times=times).explore(1_000_000) > 20_000


# ---------------------------------------------------------------- mistakes are found


def accepts_older(lease: BridgeLease, permit: Permit, t_ns: int, times: LeaseTimes) -> bool:
    is_young = t_ns < permit.t_ns + times.lease_ns
    return lease.holder is not None and permit.epoch <= lease.epoch and is_young


def accepts_late(lease: BridgeLease, permit: Permit, t_ns: int, times: LeaseTimes) -> bool:
    return lease.holder is not None and permit.epoch == lease.epoch


def counts_from_receipt(node: NodeLease, bridge: str, answer: Answer, t_ns: int) -> NodeLease:
    return node_lease.receive_answer(node, bridge, answer._replace(sent_t_ns=t_ns), t_ns)


def takes_answers_to_an_earlier_process(node: NodeLease, bridge: str, answer: Answer, t_ns: int) -> NodeLease:
    return node_lease.receive_answer(node, bridge, answer._replace(node=node.node), t_ns)


def opens_at_once(boot: int, t_ns: int, *, is_only_bridge: bool, times: LeaseTimes) -> BridgeLease:
    return bridge_lease.start_lease(boot, t_ns, is_only_bridge=True, times=times)


def grants_while_held(
    lease: BridgeLease, ask: Ask, t_ns: int, times: LeaseTimes
) -> tuple[BridgeLease, Answer]:
    is_other = lease.holder != ask.node
    return bridge_lease.answer_ask(lease._replace(holder=None) if is_other else lease, ask, t_ns, times)


def commands_with_any_bridge(node: NodeLease, bridge: str, t_ns: int, times: LeaseTimes) -> Permit | None:
    hold = node.views[node.bridges.index(bridge)].hold
    return hold.permit if hold and bridge in node_lease.epochs_held(node, t_ns, times) else None


def does_not_wait(node: NodeLease, bridge: str, t_ns: int, times: LeaseTimes) -> Permit | None:
    held = node_lease.epochs_held(node, t_ns, times)
    is_most = node_lease.are_most(held, node.bridges)
    return commands_with_any_bridge(node, bridge, t_ns, times) if is_most else None


MISTAKES = {
    "accepts older epochs": (Rules(accepts=accepts_older), RESTARTS, "holder"),
    "a restart forgets the epoch": (Rules(new_boot=lambda _: 0), RESTARTS, "epoch"),
    "answers to an earlier process": (
        Rules(receive_answer=takes_answers_to_an_earlier_process),
        RESTARTS,
        "holder",
    ),
    "accepts late effects": (Rules(accepts=accepts_late), CUT, "order"),
    "counts from the receipt": (Rules(receive_answer=counts_from_receipt), LATE, "order"),
    "grants after a restart at once": (Rules(start_lease=opens_at_once), CUT_RESTART, "order"),
    "grants while held": (Rules(answer_ask=grants_while_held), replace(CUT, ticks=2, cut_t=(0, 0)), "order"),
    "any bridge suffices": (Rules(permit_for=commands_with_any_bridge), CUT, "one"),
    "does not wait for late effects": (Rules(permit_for=does_not_wait), CUT, "order"),
}


LONG = {"counts from the receipt"}
"""Mistakes that need many moves."""


@pytest.mark.parametrize(
    "mistake", [pytest.param(one, marks=pytest.mark.slow if one in LONG else ()) for one in MISTAKES]
)
def test_a_mistake_in_the_protocol_is_found(mistake: str) -> None:
    rules, bounds, invariant = MISTAKES[mistake]
    with pytest.raises(ViolationError, match=f"^{invariant}"):
        Model(bounds, rules).explore()


@pytest.mark.slow
def test_clocks_that_differ_by_more_than_the_margin_are_found() -> None:
    times = DRIFT_TIMES._replace(margin_ns=0)
    bounds = replace(CUT, ticks=4, lost_ticks=2)
    with pytest.raises(ViolationError, match=r"^(order|one)"):
        Model(bounds, times=times).explore()


# ---------------------------------------------------------------- one node commands


class Network:
    """Network that has become healthy: messages arrive at once, and those from before are lost."""

    def __init__(self, model: Model, state: State) -> None:
        self.t = state.t
        self.times = model.times
        self.names = model.names
        self.nodes = [part.value for part in state.nodes]
        self.bridges = [part.value for part in state.bridges]

    def run(self, ticks: int, order: tuple[int, ...]) -> list[set[int]]:
        """Run for some ticks; return which nodes command in each."""
        return [self.tick(order) for _ in range(ticks)]

    def tick(self, order: tuple[int, ...]) -> set[int]:
        self.t += 1
        t = NODE_CLOCK + self.t
        for n in order:
            node, asks = node_lease.take_due_asks(self.nodes[n], t, self.times)
            for name, ask in asks.items():
                b = self.names.index(name)
                self.bridges[b], answer = bridge_lease.answer_ask(
                    self.bridges[b], ask, BRIDGE_CLOCK + self.t, self.times
                )
                node = node_lease.receive_answer(node, name, answer, t)
            self.nodes[n] = node
        return {n for n in order if node_lease.duty(self.nodes[n], t, self.times) is Duty.COMMANDS}


@pytest.mark.parametrize(
    "bounds",
    [
        replace(ONE, ticks=2),
        replace(RESTARTS, ticks=1),
        replace(CUT, ticks=3, asks=(1, 1)),
        replace(LATE, ticks=1),
    ],
    ids=["one bridge", "restarts", "cut", "late answers"],
)
def test_from_every_state_one_node_commands_soon_and_stays(bounds: Bounds) -> None:
    """A lease and a wait for each node, and then no change while both are well, or one is."""
    model = Model(bounds)
    states = set[tuple[object, ...]]()

    def heal(state: State) -> None:
        key = (state.t, state.nodes, state.bridges)
        if key in states:
            return
        states.add(key)
        for order in ((0, 1), (1, 0), (1,)):
            commanding = Network(model, state).run(14, order)[9:]
            assert all(len(nodes) == 1 for nodes in commanding), (state, commanding)
            assert len(set().union(*commanding)) == 1, (state, commanding)

    model.explore(visit=heal)
    assert len(states) > 100
