"""Short sessions with vehicles for preparations: parameters, fences, rally points."""
