"""Grid search.

In reading order: legal moves (`neighbours`), the plain A* (`astar`), the canonical ordering of moves
(`canonical_ordering`), the fast A* (`bucket_astar`), one-to-all Dijkstra (`dijkstra`), and the cost matrix of
all pairs (`cost_matrix`).
"""
