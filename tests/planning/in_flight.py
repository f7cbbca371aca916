"""Make plans of all kinds after the warm-up; print the kernels that had to be compiled for them.

A program of its own: other tests call kernels with other types.
"""

import numpy as np

from gcs.planning import warm_up
from gcs.planning.map import line_of_sight
from gcs.planning.map.grid import free_grid, random_obstacles
from gcs.planning.planner_inputs import AgentState, PlanOptions
from gcs.planning.team_routes import plan_routes

AGENTS = {1: AgentState(3.0, 4.0, 0.5), 2: AgentState(390.0, 15.0), 3: AgentState(200.0, 200.0)}
TARGETS = {(0, 0): (350.0, 380.0), (0, 1): (5.0, 390.0), (1, 0): (4.0, 3.0)}
OPTIONS = (
    PlanOptions(),
    PlanOptions(shape="pulled", clearance_m=15.0),
    PlanOptions("pulled", 25.0),
)

warm_up.warm_up()
for seed in range(3):
    grid = random_obstacles(free_grid((21, 21), 20.0), 0.2, np.random.default_rng(seed), [], 40.0)
    for options in OPTIONS:
        plan_routes(grid, AGENTS, TARGETS, {}, options)
        plan_routes(grid, AGENTS, dict([*TARGETS.items()][:1]), {}, options)
    line_of_sight.line_of_sight(grid, (0.0, 0.0), (300.0, 200.0), 5.0)
for kernel in dict.fromkeys(call[0] for call in warm_up.warm_up_calls()):
    if len(kernel.signatures) != 1:
        print(kernel.__name__, kernel.signatures)
