"""What replanning changes in flight, and what it costs: uploads, changed routes and metres flown.

``python tests/bench/bench_retask.py [SCENARIO ...] [--seeds 3] [--no-losses]`` flies missions on virtual time
and prints a table. A changed route is the first of its vehicle, leads to another target than before, or
to another place where the same target is met. "in one plan": most changed routes of a plan whose only
trigger is that targets moved. The excess is the total cost of an assignment beyond that of the optimum.

With ``--no-losses`` no vehicle is lost: missions of two versions differ in fewer ways.
"""

import argparse
import math
from collections import Counter
from dataclasses import dataclass, field, replace

import msgspec
import numpy as np

from gcs.model import Effect, Plan, Route, Truth, UploadReport
from gcs.planning import team_routes
from gcs.planning.warm_up import warm_up as warm_up_planning
from gcs.tracking.glmb.filter import warm_up as warm_up_tracking
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import Scenario, load

_with_change_costs, _assign = team_routes.with_change_costs, team_routes.assign_agents


@dataclass
class Flight:
    """Counts of one mission."""

    uploads: int = 0
    kinds: Counter = field(default_factory=Counter)
    most: int = 0
    flown_m: float = 0.0
    duration_s: float = 0.0
    excesses: list = field(default_factory=list)
    _routes: dict[int, Route] = field(default_factory=dict)
    _places: dict[int, tuple[float, float]] = field(default_factory=dict)

    def note_effect(self, _t_ns: int, effect: Effect) -> None:
        """Count uploads, and the changed routes of a plan."""
        self.uploads += isinstance(effect, UploadReport)
        if isinstance(effect, Plan):
            routes = {route.vehicle: route for route in effect.routes}
            self.kinds.update(self._kind(routes[vehicle]) for vehicle in effect.changed)
            if effect.causes == ("target moved",):
                self.most = max(self.most, len(effect.changed))
            self._routes |= routes

    def _kind(self, route: Route) -> str:
        before = self._routes.get(route.vehicle)
        if before is None:
            return "first"
        return "same target" if before.target == route.target else "other target"

    def note_truth(self, truth: Truth) -> None:
        """Add the metres that living agents flew since the last truth."""
        for one in truth.objects:
            if one.kind == "agents" and one.alive:
                place = (one.east_m, one.north_m)
                self.flown_m += math.dist(place, self._places.get(one.id, place))
                self._places[one.id] = place


def fly(scenario: Scenario, seed: int) -> Flight:
    flight, true_costs = Flight(), {}

    def with_change_costs(costs, *rest):
        true_costs["newest"] = costs
        return _with_change_costs(costs, *rest)

    def assign(costs, *rest):
        found, best = (_assign(one, *rest) for one in (costs, true_costs["newest"]))
        total, least = (sum(true_costs["newest"][pair] for pair in pairs.items()) for pairs in (found, best))
        flight.excesses += [total / least - 1.0] if len(found) == len(best) and least > 0.0 else []
        return found

    team_routes.with_change_costs, team_routes.assign_agents = with_change_costs, assign
    run = VirtualRun(scenario, seed, on_effect=flight.note_effect, on_truth=flight.note_truth)
    flight.duration_s = run.run()
    return flight


def without_losses(scenario: Scenario) -> Scenario:
    death = msgspec.structs.replace(scenario.simulation.death, survival_probability=1.0)
    return replace(scenario, simulation=msgspec.structs.replace(scenario.simulation, death=death))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", default=["swarm-50"])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--no-losses", action="store_true")
    options = parser.parse_args()
    warm_up_planning()
    warm_up_tracking()
    print(
        "| scenario | uploads | first route | other target | same target | in one plan | mission, s "
        "| km flown | excess: mean, most |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name in options.scenarios:
        scenario = without_losses(load(name)) if options.no_losses else load(name)
        flights = [fly(scenario, seed) for seed in range(1, options.seeds + 1)]
        kinds = sum((flight.kinds for flight in flights), Counter())
        excesses = [100.0 * one for flight in flights for one in flight.excesses]
        counts = [sum(flight.uploads for flight in flights), *map(kinds.get, ("first", "other target"))]
        cells = [f"{(one or 0) / len(flights):.1f}" for one in (*counts, kinds["same target"])]
        cells += [f"{max(flight.most for flight in flights)}"]
        cells += [f"{np.mean([flight.duration_s for flight in flights]):.1f}"]
        cells += [f"{np.mean([flight.flown_m for flight in flights]) / 1000.0:.2f}"]
        cells += [f"{np.mean(excesses):.2f} %, {max(excesses):.2f} %"]
        print(f"| `{name}` | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
