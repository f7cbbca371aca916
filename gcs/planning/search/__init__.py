"""Shortest paths on the grid: A*, Dijkstra, the cost matrix of all pairs."""
