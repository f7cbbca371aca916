"""Staging of plans: agents and targets at chosen places, checks at chosen times."""

from gcs.core.airspace.obstacle_map import mission_grid
from gcs.core.replanning.inputs import PlanningInputs
from gcs.core.replanning.replanner import Replanner
from gcs.core.state import State, flown_routes
from helpers.staging import at, mission, track, zones

CAPTURE_M, MOVED_M, PERIOD_S = 40.0, 50.0, 5.0


def replanner(config, state=None):
    state = state or State.initial(range(1, 20))
    return Replanner(config, zones(config), state.agents, state.replanning)


class Desk:
    """A planner's desk: agents, targets and assignments; it checks at times a test chooses."""

    def __init__(self, agents, targets, *, tables="", expected_targets=None):
        count = len(targets) if expected_targets is None else expected_targets
        config = mission(
            agents=list(agents.values()), births=[(1900.0, 100.0 * i) for i in range(count)], tables=tables
        )
        self.grid = mission_grid(config, 0)
        state = State.initial(range(1, 20))
        self.replanner, self.state, self.vehicles = replanner(config, state), state.replanning, state.agents
        self.agents, self.targets, self.arrived = dict(agents), dict(targets), set()
        self.lost, self.velocities, self.plans = set(), {}, []

    def check(self, t_s):
        """Check if a plan is due; return it."""
        if not self.replanner.is_due(at(t_s)):
            return None
        inputs = PlanningInputs(
            at(t_s),
            at(t_s),
            {
                v: track((0, v), place, self.velocities.get(v, (0.0, 0.0)))
                for v, place in sorted(self.agents.items())
            },
            {label: track(label, place) for label, place in sorted(self.targets.items())},
            frozenset(self.arrived),
            lost=frozenset(self.lost),
        )
        plan = self.replanner.check(inputs)
        if plan is not None:
            self.plans.append(plan)
            assert plan.causes
        return plan

    def arrive(self, vehicle):
        label = self.assigned[vehicle]
        self.vehicles[vehicle].routes.drop()
        self.arrived.add(vehicle)
        del self.agents[vehicle], self.targets[label]

    def lose(self, vehicle):
        self.lost.add(vehicle)
        self.vehicles[vehicle].routes.drop()
        del self.agents[vehicle]

    @property
    def assigned(self):
        return {vehicle: route.target for vehicle, route in flown_routes(self.vehicles).items()}


A, B, C = (0, 0), (0, 1), (3, 2)


def pair(**changes):
    """Two agents in the west, two targets straight east of them, one planned."""
    desk = Desk({1: (100.0, 200.0), 2: (100.0, 800.0)}, {A: (1500.0, 200.0), B: (1500.0, 800.0)}, **changes)
    plan = desk.check(0.0)
    assert plan.changed == (1, 2)
    assert desk.assigned == {1: A, 2: B}
    return desk
