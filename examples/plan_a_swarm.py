"""Plan the routes of a team on an occupancy grid, and draw them with --plot.

python examples/plan_a_swarm.py [--plot plan.png]
"""

import argparse

import numpy as np

from gcs.planning import plan_swarm

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--plot")
plot = parser.parse_args().plot

blocked = np.zeros((51, 51), dtype=bool)  # rows north, columns east
blocked[:35, 20] = blocked[15:, 35] = True  # two walls
agents_m = np.array([[100.0, 200.0], [100.0, 1000.0], [100.0, 1800.0]])  # east, north
targets_m = np.array([[1900.0, 300.0], [1800.0, 1500.0]])
plan = plan_swarm(blocked, 40.0, agents_m, targets_m, clearance_m=30.0, turn_radius_m=60.0)

for agent, (target, length_m) in enumerate(zip(plan.target, plan.lengths_m, strict=True)):
    print(f"agent {agent}: " + ("no target" if target < 0 else f"target {target}, {length_m:.0f} m"))
for note in plan.notes:
    print(note.line)
if plot:
    from matplotlib import pyplot as plt

    plt.imshow(blocked, origin="lower", extent=(-20.0, 2020.0, -20.0, 2020.0), cmap="Greys")
    for path_m in plan.paths_m:
        plt.plot(*path_m.T)
    plt.savefig(plot)
