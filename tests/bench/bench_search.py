"""Search bench: one path, one to all and cost matrices, side by side with what PyPI has.

    pip install -e '.[bench]'
    python tests/bench/bench_search.py [--big]

Maps are random: a tenth to three tenths of the nodes blocked, 100 x 100 and 500 x 500, with --big 2000 x 2000
too. No corner is cut, and all costs of the exact peers (scipy, w9-pathfinding, rustworkx, networkx) are
compared with ours: the greatest difference is in the table. Peers get their graph ready made; our times hold
everything that a call needs but the search map, which is kept with its grid as the graph is. tcod and
scikit-image cannot forbid cut corners (and tcod counts in whole numbers), so only their times are shown.
Times are medians of CPU time on one thread, kernels compiled; peers are shown as multiples of ours.
"""

from __future__ import annotations

import argparse
import itertools
import math
import time
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from helpers.grid_paths import distances_m, find_path
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import dijkstra

from gcs.planning.assignment import assign
from gcs.planning.map.grid import Grid, Node, free_grid, random_obstacles
from gcs.planning.path.path_shaping import connect_to_grid
from gcs.planning.search import cost_matrix
from gcs.planning.search.neighbours import SearchMap, flat_index, search_map
from gcs.planning.warm_up import warm_up

ROOT_2 = math.sqrt(2.0)
_TURN_MS = 5.0
Works: TypeAlias = dict[str, Callable[[], object]]


def timed_ms(works: Works, budget_ms: float = 1500.0, least: int = 3) -> dict[str, float]:
    """Median CPU time of a call of each, taken in turns, so that what else the machine does meets all alike.

    A turn is as many calls as fill `_TURN_MS`; turns as many as the budget holds, from `least` to 50.
    """
    times: dict[str, list[float]] = {name: [] for name in works}
    spent_ms, turns = 0.0, 0
    while turns < least or (spent_ms < budget_ms and turns < 50):
        for name, work in works.items():
            begin, calls, took_ms = time.process_time_ns(), 0, 0.0
            while took_ms < _TURN_MS:
                work()
                calls, took_ms = calls + 1, (time.process_time_ns() - begin) / 1e6
            times[name].append(took_ms / calls)
            spent_ms += took_ms
        turns += 1
    return {name: float(np.median(each)) for name, each in times.items()}


def random_map(nodes: int, blocked: float, seed: int = 1) -> tuple[Grid, Node, Node]:
    """A map, and two nodes near opposite corners that are connected."""
    rng = np.random.default_rng(seed)
    grid = random_obstacles(free_grid((nodes, nodes), 1.0), blocked, rng)
    free = np.argwhere(search_map(grid).largest_component.reshape(nodes + 2, nodes + 2)[1:-1, 1:-1])
    ends = [free[np.argmin(np.abs(free - corner).sum(axis=1))] for corner in (2, nodes - 3)]
    return grid, tuple(ends[0].tolist()), tuple(ends[1].tolist())


def graph_of(smap: SearchMap) -> csr_matrix:
    """The same legal moves as a sparse matrix."""
    rows, cols, costs = [], [], []
    for move, step in enumerate(smap.offsets):
        nodes = np.flatnonzero((smap.moves >> np.uint8(move)) & 1)
        rows.append(nodes)
        cols.append(nodes + step)
        costs.append(np.full(len(nodes), 1.0 if move < 4 else ROOT_2))
    entries = (np.concatenate(costs), (np.concatenate(rows), np.concatenate(cols)))
    return coo_matrix(entries, shape=(smap.moves.size, smap.moves.size)).tocsr()


def w9_grid(grid: Grid):
    from w9_pathfinding import envs

    return envs.Grid(
        np.where(grid.blocked, -1.0, 1.0).tolist(),
        diagonal_movement=envs.DiagonalMovement.only_when_no_obstacle,
        diagonal_movement_cost_multiplier=ROOT_2,
    )


def rustworkx_graph(graph: csr_matrix):
    import rustworkx

    result = rustworkx.PyDiGraph()
    result.add_nodes_from(range(graph.shape[0]))
    entries = graph.tocoo()
    result.add_edges_from(
        list(zip(entries.row.tolist(), entries.col.tolist(), entries.data.tolist(), strict=True))
    )
    return result


def pairs(nodes: int, blocked: float) -> None:
    """One path from corner to corner."""
    import networkx
    import rustworkx
    import tcod.path
    from w9_pathfinding import pf

    grid, start, goal = random_map(nodes, blocked)
    found = find_path(grid, start, goal)
    assert found is not None
    cells = w9_grid(grid)
    w9 = pf.AStar(cells)
    (y0, x0), (y1, x1) = start, goal
    works: Works = {
        "ours": lambda: find_path(grid, start, goal),
        "w9": lambda: w9.find_path((x0, y0), (x1, y1)),
    }
    errors = [abs(cells.calculate_cost(w9.find_path((x0, y0), (x1, y1))) - found.length_m)]
    cutting = tcod.path.AStar(np.where(grid.blocked, 0, 1).astype(np.int32), diagonal=ROOT_2)
    works["tcod*"] = lambda: cutting.get_path(*start, *goal)
    smap = search_map(grid)
    first, last = flat_index(smap, start), flat_index(smap, goal)
    if nodes <= 500:
        graph = rustworkx_graph(graph_of(smap))
        at = [divmod(node, smap.stride) for node in range(smap.moves.size)]
        end = at[last]

        def ahead(node: int) -> float:
            dr, dc = abs(at[node][0] - end[0]), abs(at[node][1] - end[1])
            return max(dr, dc) + (ROOT_2 - 1) * min(dr, dc)

        def search() -> object:
            return rustworkx.digraph_astar_shortest_path(
                graph, first, lambda node: node == last, lambda cost: cost, ahead
            )

        works["rustworkx"] = search
        path = search()
        cost = sum(graph.get_edge_data(a, b) for a, b in itertools.pairwise(path))
        errors.append(abs(cost - found.length_m))
        if nodes <= 100:
            plain = networkx.from_scipy_sparse_array(graph_of(smap), create_using=networkx.DiGraph)
            works["networkx"] = lambda: networkx.astar_path(plain, first, last, lambda a, _: ahead(a))
    _line(nodes, blocked, timed_ms(works), max(errors))


def to_all(nodes: int, blocked: float) -> None:
    """Distances from a corner to all nodes."""
    import skimage.graph
    import tcod.path
    from w9_pathfinding import pf

    grid, start, _ = random_map(nodes, blocked)
    smap = search_map(grid)
    found = distances_m(grid, start)
    graph, source = graph_of(smap), flat_index(smap, start)
    works: Works = {
        "ours": lambda: distances_m(grid, start),
        "scipy": lambda: dijkstra(graph, indices=source),
    }
    theirs = dijkstra(graph, indices=source).reshape(nodes + 2, nodes + 2)[1:-1, 1:-1]
    reached = np.isfinite(theirs)
    assert np.array_equal(reached, np.isfinite(found))
    errors = [np.abs(found[reached] - theirs[reached]).max()]
    cells = w9_grid(grid)
    far = np.unravel_index(int(np.argmax(np.where(reached, found, -1.0))), found.shape)
    begin, end = (start[1], start[0]), (int(far[1]), int(far[0]))
    works["w9"] = lambda: pf.ResumableDijkstra(cells, begin).distance(end)
    errors.append(abs(pf.ResumableDijkstra(cells, begin).distance(end) - found[far]))
    whole = np.where(grid.blocked, 0, 1).astype(np.int32)

    def tcod_field() -> object:
        field = tcod.path.maxarray(grid.shape, dtype=np.int32)
        field[start] = 0
        return tcod.path.dijkstra2d(field, whole, 10, 14, out=field)

    works["tcod*"] = tcod_field
    costs = np.where(grid.blocked, -1.0, 1.0)
    works["skimage*"] = lambda: skimage.graph.MCP_Geometric(costs).find_costs([start])
    _line(nodes, blocked, timed_ms(works), max(errors))


def matrices(nodes: int, blocked: float, n: int, m: int) -> None:
    """Cost matrix and assignment, agents and targets anywhere."""
    from w9_pathfinding import pf

    grid, _, _ = random_map(nodes, blocked)
    smap = search_map(grid)
    rng = np.random.default_rng(2)
    largest_component = np.argwhere(smap.largest_component.reshape(nodes + 2, nodes + 2)[1:-1, 1:-1])
    ends = [largest_component[rng.choice(len(largest_component), count, replace=False)] for count in (n, m)]

    def places(nodes_at: np.ndarray) -> cost_matrix.Endpoints:
        xy = nodes_at[:, ::-1].astype(np.float64)
        return cost_matrix.Endpoints(
            xy, *connect_to_grid(grid.blocked, smap.largest_component, smap.tight_nodes, smap.stride, xy)
        )

    def ours() -> np.ndarray:
        lengths, way = cost_matrix.shortest_paths(grid, smap, places(ends[0]), places(ends[1]), 0.0)
        for i, j in assign(lengths).items():
            way(i, j)
        return lengths

    graph = graph_of(smap)
    sources = [flat_index(smap, tuple(node)) for node in ends[0]]
    goals = [flat_index(smap, tuple(node)) for node in ends[1]]
    works: Works = {"ours": ours, "scipy": lambda: [dijkstra(graph, indices=s)[goals] for s in sources]}
    theirs = np.array([dijkstra(graph, indices=s)[goals] for s in sources])
    error = np.abs(ours() - theirs).max()
    if n * m * nodes <= 400 * 500:
        search = pf.AStar(w9_grid(grid))
        tuples = [[(int(c), int(r)) for r, c in side] for side in ends]
        works["w9"] = lambda: [search.find_path(a, b) for a in tuples[0] for b in tuples[1]]
    one_by_one = cost_matrix.is_pairwise_faster(smap, *(side[:, ::-1].astype(np.float64) for side in ends))
    how = f"{n} x {m}, {'pair by pair' if one_by_one else 'one to all'}"
    _line(nodes, blocked, timed_ms(works, least=2), error, how)


def _line(nodes: int, blocked: float, took_ms: dict[str, float], error: float, what: str = "") -> None:
    ours = took_ms.pop("ours")
    peers = "".join(f"{name:>11} {ms / ours:6.1f}" for name, ms in took_ms.items())
    print(f"  {nodes:5d}^2 {blocked:4.0%} {what:<24}{ours:10.3f} ms{peers}   error {error:.0e}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--big", action="store_true", help="maps of 2000 x 2000 as well")
    sizes = (100, 500, 2000) if parser.parse_args().big else (100, 500)
    warm_up()
    for title, work in (("one path (* cuts corners)", pairs), ("one to all (* cuts corners)", to_all)):
        print(f"\n{title}: ours, peers as multiples of it")
        for nodes in sizes:
            for blocked in (0.1, 0.2, 0.3):
                work(nodes, blocked)
    print("\ncost matrix, assignment and the paths of those assigned: ours, peers as multiples of it")
    for nodes, blocked, n, m in (
        *((51, 0.05, 4, 5), (51, 0.2, 4, 5), (100, 0.2, 20, 20)),
        *((500, 0.0, 2, 2), (500, 0.02, 2, 2), (500, 0.2, 2, 2), (500, 0.2, 20, 20), (500, 0.2, 5, 100)),
        *(((2000, 0.2, 5, 5), (2000, 0.2, 20, 20)) if 2000 in sizes else ()),
    ):
        matrices(nodes, blocked, n, m)


if __name__ == "__main__":
    main()
