"""A standby would take over too late, or from a command that is alive; or a bridge would keep no command."""

from __future__ import annotations

import heapq
import itertools
from dataclasses import dataclass, field

import msgspec
import pytest

from gcs.core.lease.bridge_lease import accepts, answer_ask, is_held, start_lease
from gcs.core.lease.lease_messages import NO_STANDING, Answer, Ask, Epoch, NodeId, Permit
from gcs.core.lease.node_lease import (
    Duty,
    NodeLease,
    are_most,
    duty,
    epochs_held,
    permit_for,
    receive_answer,
    start_node,
    take_due_asks,
)
from gcs.model import NS_PER_S

MS = NS_PER_S // 1000
STEP_NS = 10 * MS


@dataclass
class World:
    """Nodes and bridges with the default times, in steps of 10 ms; messages take 20 ms."""

    bridges: tuple[str, ...]
    delays_ms: dict[str, int]
    """Delay of each node when a lease has run out."""
    t_ns: int = 0
    nodes: dict[str, NodeLease] = field(default_factory=dict)
    stopped: set[str] = field(default_factory=set)
    cut: set[tuple[str, str]] = field(default_factory=set)
    """Nodes and bridges that do not reach each other."""

    def __post_init__(self) -> None:
        self.leases = {
            name: start_lease(7, 0, is_only_bridge=len(self.bridges) == 1) for name in self.bridges
        }
        self.waiting: list[tuple[int, int, str, str, Ask | Answer]] = []
        self.count = itertools.count()

    def start(self, name: str) -> None:
        delay_ns = self.delays_ms[name] * MS
        self.nodes[name] = start_node(
            NodeId(name, 1), self.bridges, self.t_ns, delay_ns=delay_ns, is_only_node=False
        )

    def run(self, ms: int) -> list[str]:
        """Run for a time; return the nodes that commanded, in the order in which they began."""
        began: list[str] = []
        for _ in range(ms * MS // STEP_NS):
            self.t_ns += STEP_NS
            self.step()
            commanding = [name for name in self.nodes if self.duty(name) is Duty.COMMANDS]
            assert len(commanding) < 2
            began += [name for name in commanding if not began or began[-1] != name]
        return began

    def step(self) -> None:
        while self.waiting and self.waiting[0][0] <= self.t_ns:
            _, _, node, bridge, body = heapq.heappop(self.waiting)
            if isinstance(body, Ask):
                self.leases[bridge], answer = answer_ask(self.leases[bridge], body, self.t_ns)
                self.send(node, bridge, answer)
            elif node not in self.stopped:
                self.nodes[node] = receive_answer(self.nodes[node], bridge, body, self.t_ns)
        for name in self.nodes.keys() - self.stopped:
            self.nodes[name], asks = take_due_asks(self.nodes[name], self.t_ns)
            for bridge, ask in asks.items():
                self.send(name, bridge, ask)

    def send(self, node: str, bridge: str, body: Ask | Answer) -> None:
        if (node, bridge) not in self.cut:
            heapq.heappush(self.waiting, (self.t_ns + 20 * MS, next(self.count), node, bridge, body))

    def duty(self, name: str) -> Duty:
        return Duty.STANDBY if name in self.stopped else duty(self.nodes[name], self.t_ns)

    def held(self, name: str) -> list[str]:
        return list(epochs_held(self.nodes[name], self.t_ns))


def flying(bridges: tuple[str, ...] = ("x",), **delays_ms: int) -> World:
    """Return a world in which A commands, and others stand by."""
    world = World(bridges, {"A": 0} | delays_ms)
    world.start("A")
    world.run(3000)
    for name in delays_ms:
        world.start(name)
    assert world.run(2000) == ["A"]
    return world


@pytest.mark.parametrize("phase_ms", range(0, 1600, 70))
@pytest.mark.parametrize("bridges", [("x",), ("x", "y", "z")])
def test_a_standby_commands_within_two_seconds_after_the_end_of_command(
    bridges: tuple[str, ...], phase_ms: int
) -> None:
    world = flying(bridges, B=300)
    world.run(phase_ms)
    world.stopped.add("A")
    assert world.run(2000) == ["B"]
    assert world.held("B") == list(bridges)


@pytest.mark.parametrize("phase_ms", range(0, 1600, 70))
def test_a_command_that_stands_still_for_a_second_keeps_the_lease(phase_ms: int) -> None:
    world = flying(B=0)
    world.run(phase_ms)
    epoch = world.leases["x"].epoch
    world.stopped.add("A")
    world.run(1000)
    world.stopped.remove("A")
    assert world.run(5000) == ["A"]
    assert world.leases["x"].epoch == epoch


def test_effects_of_a_command_that_stood_still_for_long_are_dropped() -> None:
    world = flying(B=0)
    permit = permit_for(world.nodes["A"], "x", world.t_ns)
    assert permit is not None
    assert accepts(world.leases["x"], permit, world.t_ns)
    world.stopped.add("A")
    world.run(3000)
    world.stopped.remove("A")
    assert not accepts(world.leases["x"], permit, world.t_ns)
    assert permit_for(world.nodes["A"], "x", world.t_ns) is None
    assert world.run(10_000) == ["B"]


def test_of_two_standbys_one_gets_all_bridges_and_keeps_them() -> None:
    world = flying(("x", "y", "z"), B=0, C=150)
    world.stopped.add("A")
    assert world.run(10_000) == ["B"]
    assert world.held("C") == []


def test_no_lease_changes_hands_while_all_are_well() -> None:
    world = flying(("x", "y"), B=0, C=0)
    epochs = epochs_held(world.nodes["A"], world.t_ns)
    assert world.run(60_000) == ["A"]
    assert epochs_held(world.nodes["A"], world.t_ns) == epochs


def test_a_node_alone_goes_on_with_its_epoch_after_a_long_pause() -> None:
    """Nothing was commanded in between: nothing is reconciled."""
    world = flying()
    epoch = world.leases["x"].epoch
    world.stopped.add("A")
    world.run(20_000)
    assert not is_held(world.leases["x"], world.t_ns)
    world.stopped.remove("A")
    assert world.run(1000) == ["A"]
    assert world.leases["x"].epoch == epoch


def test_in_a_partition_the_node_with_most_bridges_commands_and_the_other_says_so() -> None:
    world = flying(("x", "y", "z"), B=0)
    world.cut = {("A", "y"), ("A", "z"), ("B", "x")}
    assert world.run(6000) == ["A", "B"]
    assert world.duty("A") is Duty.HOLDS_FEWER
    assert world.held("B") == ["y", "z"]


def test_after_a_partition_the_node_with_fewer_gives_its_bridge_to_the_other() -> None:
    world = flying(("x", "y", "z"), B=0)
    world.cut = {("A", "y"), ("A", "z"), ("B", "x")}
    world.run(6000)
    world.cut = set()
    assert world.run(4000) == ["B"]
    assert world.held("B") == ["x", "y", "z"]
    assert world.held("A") == []


def test_of_two_nodes_with_a_bridge_each_the_one_with_the_first_commands() -> None:
    world = flying(("x", "y"), B=0)
    world.cut = {("A", "x"), ("B", "y")}
    assert world.run(6000) == ["A", "B"]
    assert (world.held("A"), world.held("B")) == (["y"], ["x"])
    assert world.duty("A") is Duty.HOLDS_FEWER


def test_two_nodes_without_most_bridges_do_not_block_each_other() -> None:
    """The third bridge is down: one of the others must change hands."""
    world = World(("x", "y", "z"), {"A": 0, "B": 0})
    world.cut = {("A", "z"), ("B", "z"), ("A", "y"), ("B", "x")}
    world.start("A")
    world.start("B")
    assert world.run(6000) == []
    world.cut = {("A", "z"), ("B", "z")}
    assert world.run(6000) == ["A"]


def test_a_restarted_bridge_grants_a_new_epoch() -> None:
    world = flying()
    before = world.leases["x"].epoch
    permit = permit_for(world.nodes["A"], "x", world.t_ns)
    assert permit is not None
    world.leases["x"] = start_lease(8, world.t_ns, is_only_bridge=True)
    assert not accepts(world.leases["x"], permit, world.t_ns)
    world.run(500)
    assert world.leases["x"].epoch.number == before.number + 1
    assert world.leases["x"].epoch.boot != before.boot
    assert accepts(world.leases["x"], permit_for(world.nodes["A"], "x", world.t_ns) or permit, world.t_ns)


def test_a_late_claim_of_a_node_does_not_end_a_lease() -> None:
    world = flying(("x", "y", "z"), B=0)
    world.cut = {("B", "y"), ("B", "z"), ("A", "x"), ("A", "y"), ("A", "z")}
    world.run(4000)
    assert world.held("B") == ["x"]
    late = Ask(NodeId("A", 1), 0, 0, (3, 0))
    world.leases["x"], _ = answer_ask(world.leases["x"], late, world.t_ns)
    epoch = world.leases["x"].epoch
    world.run(3000)
    assert world.held("B") == ["x"]
    assert world.leases["x"].epoch == epoch


def test_the_only_node_of_a_mission_commands_with_any_bridge() -> None:
    node = start_node(NodeId("A", 1), ("x", "y"), 0, delay_ns=0, is_only_node=True)
    node, asks = take_due_asks(node, 0)
    _, answer = answer_ask(start_lease(1, 0, is_only_bridge=True), asks["y"], 0)
    node = receive_answer(node, "y", answer, 0)
    assert duty(node, 0) is Duty.COMMANDS
    assert permit_for(node, "y", 0) == answer.permit
    assert permit_for(node, "x", 0) is None


def test_an_ask_says_what_the_node_knows() -> None:
    node = start_node(NodeId("A", 1), ("x",), 0, delay_ns=0, is_only_node=False)
    _, asks = take_due_asks(node, 5)
    assert asks == {"x": Ask(NodeId("A", 1), 5, 0, NO_STANDING)}


@pytest.mark.parametrize(
    "message",
    [
        Ask(NodeId("A", 2**63 - 1), 5, 3, (2, -1)),
        Answer(NodeId("A", 1), 5, Permit(Epoch(1, 2**63 - 1), 7), "A", 1, 9),
        Answer(NodeId("A", 1), 5, None, "B", 1, 9),
    ],
)
def test_messages_pass_through_msgpack(message: Ask | Answer) -> None:
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(message), type=type(message)) == message


@pytest.mark.parametrize(
    ("held", "is_most"), [("", False), ("a", False), ("ab", True), ("ac", True), ("bc", False), ("bcd", True)]
)
def test_half_of_the_bridges_are_most_with_the_first(held: str, is_most: bool) -> None:
    assert are_most(held, ("a", "b", "c", "d")) is is_most
