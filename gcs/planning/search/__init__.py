"""Grid search: moves and canonical ordering, A*, one-to-all Dijkstra, the cost matrix of all pairs."""
